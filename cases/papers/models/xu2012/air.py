"""The air as the finger's actuators: the plant of `rigid.air.plant` behind every tendon, and the
pressure loop that commands it.

At each sample the loop knows the pressures averaged over the 10 ms before and the voltages that it
has sent.  With the identified model of the paper, dP/dt = A(V) + B(V) P, which answers L samples
late, it

1. looks ahead over the voltages that are still on their way, P^ = P(t + L) (a Smith predictor's
   part: what was sent is not sent again),
2. asks for the rate that takes P^ to the wanted pressure (force over area) in `CLOSING`, and
3. inverts the model at P^ for the voltage.

`bias`, what the pressure rises faster than the model says, is filtered from sample to sample and
added to the model's rate: the plant's own misfit, and the air that a moving piston compresses.  At
rest the model with it is exact, so that the force has no offset.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from cases.papers.models.xu2012.actuators import PERIOD
from cases.papers.models.xu2012.air_model import TRAINING, AirModel, identify, sines
from cases.papers.models.xu2012.plant import STEP
from cosim.port import Array
from rigid.air.plant import (
    ATMOSPHERE,
    AirState,
    Pneumatics,
    at_rest,
    resting_voltage,
    step,
    tension,
)

CLOSING = 0.03
"""s, of the pressure loop: three samples; the model's rates are right to some tenths."""
TRUST = 0.2
"""Share of a sample's misfit that enters the bias: over 45 ms, about the delay until the loop
answers."""
MIDDLE, AMPLITUDE = 4.75, 0.25
"""V, of the sines from which the loop's model is identified: where the valve settles at what the
finger needs, up to 26 N.  Over twice that (figure 6) the model's slope over V at a resting finger's
low pressures is less than half the plant's, and the loop swings."""
VOLTAGES = np.linspace(MIDDLE - AMPLITUDE, MIDDLE + AMPLITUDE, 101)


@lru_cache(maxsize=1)
def identify_air() -> AirModel:
    """The paper's model of this plant."""
    return identify(sines(Pneumatics(), TRAINING, AMPLITUDE, middle=MIDDLE))


class PressureLoopState(NamedTuple):
    """What the pressure loop remembers."""

    sent: Array
    """(lag + 1, nt) V, the oldest first."""
    pressure: Array
    """(nt,) Pa above the atmosphere, at the sample before."""
    bias: Array
    """(nt,) Pa/s."""


@dataclass(frozen=True)
class PressureLoop:
    """From wanted and measured pressures (nt,) above the atmosphere to voltages (nt,)."""

    model: AirModel

    def begin(self, voltage: Array, pressure: Array) -> PressureLoopState:
        """At rest."""
        sent = np.tile(voltage, (self.model.lag + 1, 1))
        return PressureLoopState(sent, pressure, -self.model.rate(pressure, voltage))

    def advance(self, loop: PressureLoopState, wanted: Array, measured: Array) -> PressureLoopState:
        """A sample later: the voltage to send is the last of `sent`."""
        told = self.model.ahead(loop.pressure, loop.sent[:1]) - loop.pressure
        misfit = (measured - loop.pressure - told) / PERIOD
        bias = loop.bias + TRUST * (misfit - loop.bias)
        ahead = measured
        for v in loop.sent[1:]:
            ahead = self.model.ahead(ahead, v[None]) + PERIOD * bias
        voltage = self._invert(ahead, (wanted - ahead) / CLOSING - bias)
        return PressureLoopState(np.vstack([loop.sent[1:], voltage]), measured, bias)

    @cached_property
    def _lines(self) -> tuple[Array, Array]:
        """A and B of the model at `VOLTAGES`."""
        still = self.model.rate(np.zeros_like(VOLTAGES), VOLTAGES)
        return still, self.model.rate(np.ones_like(VOLTAGES), VOLTAGES) - still

    def _invert(self, pressure: Array, rate: Array) -> Array:
        """The voltages (nt,) V of `VOLTAGES` at which the model has that rate (Pa/s), the nearest
        end else."""
        still, slope = self._lines
        rates = still[:, None] + np.outer(slope, pressure)
        rising = np.maximum.accumulate(rates, axis=0)
        return np.array([np.interp(r, x, VOLTAGES) for r, x in zip(rate, rising.T, strict=True)])


class Driven(NamedTuple):
    """Cylinders and their loop in time."""

    chamber: AirState
    drawn: Array
    """(nt,) m, of the pistons into their cylinders."""
    inward: Array
    """(nt,) m/s."""
    coming: Array
    """(n, nt) V on their way to the valves, one for each `STEP`, the next first."""
    summed: Array
    """(nt,) Pa s above the atmosphere, since the sample began."""
    loop: PressureLoopState


@dataclass(frozen=True)
class Air:
    """A cylinder and valve for every tendon."""

    longest: Array
    """(nt,) m, of the tendons over the finger's range: there each piston is drawn out."""
    plant: Pneumatics = field(default_factory=Pneumatics)
    loop: PressureLoop = field(default_factory=lambda: PressureLoop(identify_air()))

    def begin(self, force: Array, length: Array) -> Driven:
        """The state in which the cylinders hold these forces.  Raises InputError for forces beyond
        the supply."""
        drawn = self.longest - length
        gauge = force / np.asarray(self.plant.cylinder.area)
        voltage = resting_voltage(self.plant.valve, ATMOSPHERE + gauge)
        late = round(float(self.plant.valve.delay) / STEP)
        return Driven(
            at_rest(self.plant, voltage, np.asarray(self.plant.cylinder.volume(drawn))),
            drawn,
            np.zeros_like(drawn),
            np.tile(voltage, (late, 1)),
            gauge * PERIOD,
            self.loop.begin(voltage, gauge),
        )

    def command(self, state: Driven, wanted: Array) -> Driven:
        most = np.asarray(self.plant.valve.supply) - ATMOSPHERE
        pressure = np.minimum(wanted / np.asarray(self.plant.cylinder.area), most)
        loop = self.loop.advance(state.loop, pressure, state.summed / PERIOD)
        return state._replace(loop=loop, summed=np.zeros_like(wanted))

    def advance(self, state: Driven, length: Array, dt: float) -> Driven:
        """`dt` must be `STEP`."""
        coming = np.vstack([state.coming, state.loop.sent[-1]])
        drawn = self.longest - length
        volume = np.asarray(self.plant.cylinder.volume(drawn))
        chamber = step(self.plant, state.chamber, coming[0], volume, dt)
        middle = 0.5 * (state.chamber.pressure + chamber.pressure) - ATMOSPHERE
        return Driven(
            chamber,
            drawn,
            (drawn - state.drawn) / dt,
            coming[1:],
            state.summed + dt * middle,
            state.loop,
        )

    def force(self, state: Driven) -> Array:
        return tension(self.plant.cylinder, state.chamber.pressure, state.inward)
