"""The air: the chamber against closed forms, the paper's model against the plant."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cases.papers.models.xu2012.air_model import (
    STEPPED_DOWN,
    STEPPED_UP,
    TRAINING,
    UNSEEN,
    identification,
    identify,
    latency,
    r_squared,
    steps,
)
from cosim.port import Array
from rigid.air.plant import (
    GAMMA,
    GAS_CONSTANT,
    REFERENCE_DENSITY,
    ROOM,
    AirState,
    PneumaticCylinder,
    Pneumatics,
    Valve,
    at_rest,
    openings,
    resting_pressure,
    resting_voltage,
    step,
)
from tests.helpers.rows import Row

FIRST_LAW = "closed form: balance of mass and energy, sonic flow of ISO 6358-1"
PAPER = "Xu et al. 2012, section IV"
VOLUME = np.array([6e-6])
"""m^3."""
MUCH_HEAT = 100.0
"""W/K: isothermal but for some parts in a thousand, which fall as its inverse."""
FILLING, EMPTYING = np.array([5.6]), np.array([4.4])
"""V at which one edge is shut and the other sonic for some hundredths of a second."""


def chamber(heat: float) -> Pneumatics:
    """A valve whose spool stands where it is told, on a chamber with walls of `heat` W/K."""
    return Pneumatics(Valve(lag=1e-4), PneumaticCylinder(heat=heat))


def run(air: Pneumatics, state: AirState, voltage: Array, time: float, dt: float) -> AirState:
    """The state after a time at constant voltage and volume."""
    for _ in range(round(time / dt)):
        state = step(air, state, voltage, state.volume, dt)
    return state


def chamber_rows() -> Iterator[Row]:
    """Fill, discharge, compression and rest."""
    yield from fill_rows()
    yield from discharge_rows()
    yield from compression_rows()
    yield from rest_rows()


def fill_rows() -> Iterator[Row]:
    """Below the critical ratio pressure and mass rise linearly in time."""
    time = 0.01
    for name, heat, exponent, tolerance in (
        ("adiabatic", 0.0, GAMMA, 1e-12),
        ("isothermal", MUCH_HEAT, 1.0, 1e-2),
    ):
        air = chamber(heat)
        start = at_rest(air, np.zeros(1), VOLUME)._replace(spool=FILLING)
        end = run(air, start, FILLING, time, 1e-3)
        wide = openings(air.valve, FILLING)[0]
        mass = time * wide * air.valve.conductance * air.valve.supply * REFERENCE_DENSITY
        rise = exponent * GAS_CONSTANT * ROOM * mass / VOLUME
        for what, target, found in (
            ("mass gained in 10 ms, kg", mass, end.mass - start.mass),
            ("pressure gained in 10 ms, Pa", rise, end.pressure - start.pressure),
        ):
            some = 1e-12 if "mass" in what else tolerance
            yield Row(
                f"sonic fill, {name}", what, float(target[0]), float(found[0]), some, FIRST_LAW
            )


def discharge_rows() -> Iterator[Row]:
    """Above it a chamber empties as exp(-a t / gamma) isothermally, and adiabatically as
    (1 + e a t)^(-1/e) with e = (gamma - 1) / (2 gamma)."""
    time, e = 0.02, (GAMMA - 1.0) / (2.0 * GAMMA)
    for name, heat, tolerance in (("adiabatic", 0.0, 1e-8), ("isothermal", MUCH_HEAT, 1e-2)):
        air = chamber(heat)
        start = at_rest(air, np.full(1, 10.0), VOLUME)._replace(spool=EMPTYING)
        end = run(air, start, EMPTYING, time, 1e-3)
        wide = openings(air.valve, EMPTYING)[1] * air.valve.conductance
        a = GAMMA * wide * REFERENCE_DENSITY * GAS_CONSTANT * ROOM / VOLUME
        left = np.exp(-a * time / GAMMA) if heat else (1.0 + e * a * time) ** (-1.0 / e)
        found = float((end.pressure / start.pressure)[0])
        quantity = "share of the pressure left after 20 ms"
        name = f"sonic discharge, {name}"
        yield Row(name, quantity, float(left[0]), found, tolerance, FIRST_LAW)


def compress(heat: float, count: int) -> float:
    """Pressure over the first, of a shut chamber whose volume halves in 0.1 s in so many steps."""
    air = Pneumatics(Valve(conductance=1e-20, lag=1e3), PneumaticCylinder(heat=heat))
    state = at_rest(air, np.full(1, 5.0), VOLUME)
    first = state.pressure
    for k in range(1, count + 1):
        state = step(air, state, state.spool, VOLUME * (1.0 - 0.5 * k / count), 0.1 / count)
    return float((state.pressure / first)[0])


def compression_rows() -> Iterator[Row]:
    """p V^n constant, n = gamma without heat and 1 with much of it; the integrator's order."""
    exact = 2.0**GAMMA
    coarse, fine = (abs(compress(0.0, n) - exact) for n in (8, 16))
    order = float(np.log2(coarse / fine))
    name, what = "compression to half", "pressure over the first"
    yield Row(f"{name}, adiabatic", what, exact, compress(0.0, 100), 1e-8, "p V^gamma constant")
    yield Row(f"{name}, isothermal", what, 2.0, compress(MUCH_HEAT, 100), 1e-2, "p V constant")
    source = "Runge and Kutta's method is of fourth order"
    yield Row("compression", "order in time", 4.0, order, 0.2, source, "absolute", order)


def rest_rows() -> Iterator[Row]:
    """The pressure at which a voltage settles, by the plant and by both closed forms."""
    air = Pneumatics()
    volts = np.array([4.6, 4.8, 5.0, 5.2, 5.4])
    rest = resting_pressure(air.valve, volts)
    start = at_rest(air, np.full(5, 5.0), np.broadcast_to(VOLUME, 5).astype(float))
    end = run(air, start, volts, 3.0, 5e-3).pressure
    gap = float(np.abs(end / rest - 1.0).max())
    name = "rest at 4.6 to 5.4 V"
    yield Row(name, "plant after 3 s over the closed form, less 1", 0.0, gap, 1e-4, FIRST_LAW,
              "absolute")  # fmt: skip
    back = float(np.abs(resting_voltage(air.valve, rest) - volts).max())
    yield Row(
        name, "V, closed form of its inverse", 0.0, back, 1e-12, "its own inverse", "absolute"
    )


def model_rows() -> Iterator[Row]:
    """Unexplained share of dP/dt at unseen frequencies; latency of steps."""
    air = Pneumatics()
    done = identification(air)
    whole, each = r_squared(done.model, done.unseen)
    heard = ", ".join(f"{f:g}" for f in TRAINING)
    name = f"polynomial model, from {heard} Hz"
    asked = f"{PAPER}: R2 > 0.9 on unseen frequencies"
    yield Row(name, "1 - R2, unseen frequencies together", 0.1, 1.0 - whole, 0.0, asked, "bound")
    for f, r2 in zip(UNSEEN, each, strict=True):
        yield Row(name, f"1 - R2 at {f:g} Hz", 0.1, 1.0 - float(r2), 0.0, asked, "bound")
    still = r_squared(identify(done.training, 0), done.unseen)[0]
    said = f"{PAPER}; the equation knows no dead time"
    quantity = "R2 without the identified delay"
    yield Row(name, quantity, 0.9, still, 0.1, said, "comparison")
    yield from latency_rows(air)


def latency_rows(air: Pneumatics) -> Iterator[Row]:
    """A check of the fit, not a prediction: the dead time was sized to it."""
    source = f"{PAPER}: about 50 ms (the plant's dead time of 30 ms is fitted to it)"
    for name, start, ends in (
        ("steps from an empty chamber", 0.0, STEPPED_UP),
        ("steps from a full chamber", 10.0, STEPPED_DOWN),
    ):
        found = latency(steps(air, start, ends, 0.4))
        for what, value in (("median", np.median(found)), ("longest", found.max())):
            quantity = f"ms to the largest effect at 100 Hz, {what}"
            yield Row(name, quantity, 50.0, 1e3 * float(value), 10.0, source, "absolute")
