"""The live pneumatic cylinders of a case.  One of the files that know the solvers by
name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cosim.errors import ConvergenceError, InputError
from cosim.port import Array
from cosim.tendons.drive_tables import PneumaticConfig
from cosim.tendons.signals import factor_of
from cosim.tendons.table import TendonConfig

if TYPE_CHECKING:
    from rigid.air.plant import AirState, PneumaticCylinder, Pneumatics, Valve

MOST_VOLTAGE = 10.0
"""V."""
SLACK = 1e-9
"""m, by which a piston may be beyond an end of its stroke."""


@dataclass(frozen=True)
class Cylinders:
    """The pneumatic cylinders of a case, (n,), and where they stand among its tendons."""

    names: tuple[str, ...]
    where: Array
    air: Pneumatics
    initial_position: Array
    """(n,) m, of each piston into its cylinder at t = 0."""
    command: Callable[[float], Array]
    """(n,) V at a time in s, before the delay."""

    def voltages_at(self, time: float) -> Array:
        """The voltages (n,) V that reach the valves: those commanded a delay before, the first ones
        before."""
        delay = np.broadcast_to(self.air.valve.delay, len(self.names))
        by_delay = {d: self.command(max(time - d, 0.0)) for d in set(delay.tolist())}
        return np.array([by_delay[d][i] for i, d in enumerate(delay.tolist())])


class CylinderStep(NamedTuple):
    """What cylinders make of a step, (n,) each."""

    tension: Array
    """N."""
    stiffness: Array
    """N/m: the air's as a spring, adiabatic, by which the tension follows the path in a step."""
    state: AirState


def check_air(tables: Mapping[str, TendonConfig], in_motion: bool) -> None:
    """Check that cylinders are used in a motion and that their parts fit.  Raises InputError."""
    for name in _pneumatic_names(tables):
        if not in_motion:
            raise InputError(
                f"tendons.{name}.actuation: air takes time to act, and an equilibrium has none; "
                "add a table [forward], or state the tension (area times pressure, for example "
                'tension = "10 N")'
            )
        try:
            _command(tables[name])(0.0)
        except InputError as error:
            raise InputError(f"tendons.{name}.actuation: {error}") from None


def cylinders(tables: Mapping[str, TendonConfig], tendons: tuple[str, ...]) -> Cylinders | None:
    """A case's cylinders among these tendons; None where air pulls nothing.  Raises InputError."""
    names = tuple(n for n in tendons if n in _pneumatic_names(tables))
    if not names:
        return None
    air_tables = [_table(tables[n]) for n in names]
    air = _stack([parts(table) for table in air_tables])
    commands = [_command(tables[n]) for n in names]
    drawn = np.array([table.start for table in air_tables]) * air.cylinder.stroke
    where = np.array([tendons.index(n) for n in names])
    return Cylinders(names, where, air, drawn, lambda t: np.array([f(t) for f in commands]))


def parts(table: PneumaticConfig) -> Pneumatics:
    """Valve and cylinder of a table.  Raises InputError."""
    from rigid.air.plant import ATMOSPHERE, PneumaticCylinder, Pneumatics, Valve

    stated = {name: value for name, value in table if value is not None}
    if table.supply is not None:
        stated["supply"] = ATMOSPHERE + table.supply
    valve = {f.name: stated[f.name] for f in fields(Valve) if f.name in stated}
    cylinder = {f.name: stated[f.name] for f in fields(PneumaticCylinder) if f.name in stated}
    return Pneumatics(Valve(**valve), PneumaticCylinder(**cylinder))


def initial_air(c: Cylinders) -> AirState:
    """The air at rest under the first command."""
    from rigid.air.plant import at_rest

    return at_rest(c.air, c.voltages_at(0.0), np.asarray(c.air.cylinder.volume(c.initial_position)))


def step_cylinders(
    c: Cylinders, state: AirState, time: float, inward: Array, dt: float
) -> CylinderStep:
    """The cylinders at `time` s, `dt` s after `state`, the pistons moved inward by (n,) m since the
    start.  Raises ConvergenceError where one has reached an end of its stroke."""
    from rigid.air.plant import GAMMA, step, tension

    cylinder = c.air.cylinder
    area = np.asarray(cylinder.area)
    if dt == 0.0:
        return CylinderStep(tension(cylinder, state.pressure), np.zeros(len(c.names)), state)
    volume = np.asarray(cylinder.volume(_within(c, inward)))
    speed = (volume - state.volume) / (area * dt)
    after = step(c.air, state, c.voltages_at(time - 0.5 * dt), volume, dt)
    pull = tension(cylinder, after.pressure, speed)
    spring = GAMMA * after.pressure * area**2 / volume
    return CylinderStep(pull, np.where(pull > 0.0, spring, 0.0), after)


def _within(c: Cylinders, inward: Array) -> Array:
    """How far (n,) m the pistons are drawn in."""
    drawn = c.initial_position + inward
    stroke = np.broadcast_to(c.air.cylinder.stroke, drawn.shape)
    off = np.maximum(-drawn, drawn - stroke)
    worst = int(np.argmax(off))
    if off[worst] > SLACK:
        end = "out to" if drawn[worst] < 0 else "in to"
        raise ConvergenceError(
            f"tendons.{c.names[worst]}.actuation: the piston was drawn {end} the end of its stroke "
            f"of {1e3 * stroke[worst]:.3g} mm; state another start or a longer stroke"
        )
    return np.asarray(drawn)


def _pneumatic_names(tables: Mapping[str, TendonConfig]) -> list[str]:
    return [name for name, t in tables.items() if isinstance(t.actuation, PneumaticConfig)]


def _table(tendon: TendonConfig) -> PneumaticConfig:
    table = tendon.actuation
    assert isinstance(table, PneumaticConfig)  # of those that _pneumatic_names gives
    return table


def _command(tendon: TendonConfig) -> Callable[[float], float]:
    """V at a time in s."""
    from rigid.air.plant import ATMOSPHERE, resting_voltage

    table, factor = _table(tendon), factor_of(tendon.signal)
    valve = parts(table).valve
    if table.voltage is not None:
        volts = table.voltage
        return lambda t: min(volts * factor(t), MOST_VOLTAGE)
    most, wanted = float(np.asarray(valve.supply)), float(table.pressure or 0.0)
    if ATMOSPHERE + wanted > most:
        raise InputError(
            f"pressure: {wanted / 1e6:.4g} MPa is more than the supply's "
            f"{(most - ATMOSPHERE) / 1e6:.4g} MPa; both count from the atmosphere's"
        )
    return lambda t: float(resting_voltage(valve, min(ATMOSPHERE + wanted * factor(t), most)))


def _stack(each: list[Pneumatics]) -> Pneumatics:
    from rigid.air.plant import PneumaticCylinder, Pneumatics, Valve

    def of(tables: list[Valve] | list[PneumaticCylinder]) -> dict[str, Array]:
        return {f.name: np.array([getattr(t, f.name) for t in tables]) for f in fields(tables[0])}

    return Pneumatics(
        Valve(**of([e.valve for e in each])), PneumaticCylinder(**of([e.cylinder for e in each]))
    )
