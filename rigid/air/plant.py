"""Air behind a piston that pulls a tendon: valve, chamber and cylinder, from first principles.

A spool opens two edges, one from the supply and one to the atmosphere, whose mass flow is that of
ISO 6358-1: with sonic conductance C, critical pressure ratio b and r = p2 / p1,

    m' = s C p1 rho0 sqrt(T0 / T1) psi(r),
    psi = 1 for r <= b,  sqrt(1 - ((r - b) / (1 - b))^2) above, linear from `LAMINAR` to r = 1,

s being how far the edge is open.  The chamber is a balance of mass and of energy: the first law for
an open system with an ideal gas, T = p V / (m R), and walls at room temperature T0 that give `heat`
W per K,

    dm/dt = m'_in - m'_out,
    V dp/dt = (gamma - 1) [cp (T0 m'_in - T m'_out) + heat (T0 - T)] - gamma p dV/dt.

Without heat it is adiabatic (p V^gamma constant where nothing flows), with much of it isothermal
(p V constant): the same valve fills the chamber gamma times as fast in the first case as in the
second.  All arrays are (n,) over cylinders; parameters are numbers or (n,) too.  SI; pressures are
absolute.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from cosim.errors import InputError
from cosim.port import Array

GAS_CONSTANT = 288.0
"""J/(kg K), air at 65 % relative humidity: the reference atmosphere of ISO 6358-1 (ISO 8778)."""
REFERENCE_DENSITY = 1.185
"""kg/m^3, of the reference atmosphere at 100 kPa and 20 deg C."""
ROOM = 293.15
"""K, 20 deg C, of the room."""
GAMMA = 1.4
HEAT_CAPACITY = GAMMA * GAS_CONSTANT / (GAMMA - 1.0)
"""J/(kg K), at constant pressure."""
ATMOSPHERE = 101325.0
"""Pa."""
PSI = 6894.757293168
"""Pa, a pound-force per square inch."""
LAMINAR = 0.995
"""Pressure ratio above which the flow is linear in the pressure difference; its slope would be
infinite at 1 (0.995 to 0.999 are usual)."""
NEUTRAL, FULL = 5.0, 5.0
"""V at which the spool is in the middle, and V from there to an end (paper 003: 0 to 10 V)."""
STABLE = 1.0
"""Largest step times the fastest rate; Runge and Kutta's fourth-order method is stable to 2.78."""

Numbers = Array | float


@dataclass(frozen=True)
class Valve:
    """A proportional 5/3 valve of which one outlet is used."""

    conductance: Numbers = 3.8e-9
    """m^3/(s Pa) of an edge wide open.  Assumed: 100 l/min from 7 to 6 bar absolute, the nominal
    flow remembered of a valve of this size (nominal diameter 2 mm); no data sheet was seen."""
    critical_ratio: Numbers = 0.35
    """Assumed, of a spool's edge; 0.528 would be that of an ideal nozzle."""
    underlap: Numbers = 0.1
    """Opening of both edges in the middle, over the full opening.  Assumed; above 0 because in the
    paper an intermediate voltage leads to an intermediate pressure."""
    lag: Numbers = 1.0 / (2.0 * np.pi * 125.0)
    """s, of the spool behind the voltage; first order with an assumed critical frequency of
    125 Hz."""
    delay: Numbers = 0.03
    """s, dead time from the command on: output, valve and tube together.  A FIT: the one number
    that is sized, to the paper's 50 ms between a step and its largest effect in the 100 Hz signal
    (`cases.papers.models.xu2012.air_model.latency`)."""
    supply: Numbers = ATMOSPHERE + 90.0 * PSI
    """Pa, 90 psi above the atmosphere (paper 003, section III)."""

    def __post_init__(self) -> None:
        _positive("valve", self, "conductance", "lag")
        if np.any(np.asarray(self.delay) < 0) or np.any(np.asarray(self.underlap) <= 0):
            raise InputError("valve: delay must not be negative, and underlap above 0")
        b = np.asarray(self.critical_ratio)
        if np.any((b <= 0) | (b >= LAMINAR)):
            raise InputError(f"valve: the critical pressure ratio lies between 0 and {LAMINAR}")
        if np.any(np.asarray(self.supply) <= ATMOSPHERE):
            raise InputError("valve: the supply's pressure must exceed the atmosphere's")


@dataclass(frozen=True)
class PneumaticCylinder:
    """A double-acting cylinder that pulls: air before the piston, the atmosphere behind."""

    bore: Numbers = 9.3e-3
    """m.  Assumed, of the paper's model M9D37.5NT2 (its 9 is a nominal bore in mm)."""
    rod: Numbers = 3.0e-3
    """m, diameter.  Assumed."""
    stroke: Numbers = 37.5e-3
    """m (paper 003: 3.75 cm)."""
    dead_volume: Numbers = 5.0e-6
    """m^3, of the tube (1 m of 2.5 mm inside: assumed) and the ports."""
    friction: Numbers = 0.05
    """N.  Assumed: the piston falls under its own weight (paper 003), here some 5 g."""
    heat: Numbers = 0.5
    """W/K, walls to air.  Assumed: 60 W/(m^2 K) over the tube's and the chamber's wall."""

    def __post_init__(self) -> None:
        _positive("cylinder", self, "bore", "stroke", "dead_volume")
        if np.any(np.asarray(self.rod) < 0) or np.any(np.asarray(self.rod >= self.bore)):
            raise InputError("cylinder: its rod must be thinner than its bore")
        if np.any(np.asarray(self.friction) < 0) or np.any(np.asarray(self.heat) < 0):
            raise InputError("cylinder: friction and heat must not be negative")

    @property
    def area(self) -> Numbers:
        """m^2, of the piston less the rod: the pressure that pulls acts on the rod's side."""
        return np.pi / 4.0 * (self.bore**2 - self.rod**2)

    def volume(self, drawn: Numbers) -> Numbers:
        """m^3, with the piston drawn in by so many m of its stroke."""
        return self.dead_volume + self.area * drawn


@dataclass(frozen=True)
class Pneumatics:
    """Valve and cylinder."""

    valve: Valve = field(default_factory=Valve)
    cylinder: PneumaticCylinder = field(default_factory=PneumaticCylinder)


class AirState(NamedTuple):
    """The state of n cylinders and their valves, (n,) each."""

    spool: Array
    """V, at which the spool stands."""
    pressure: Array
    """Pa."""
    mass: Array
    """Mass of the air in chamber and tube, kg."""
    volume: Array
    """Volume of the chamber, m^3."""

    @property
    def temperature(self) -> Array:
        """K."""
        return self.pressure * self.volume / (self.mass * GAS_CONSTANT)


def flow_function(ratio: Numbers, critical: Numbers) -> Array:
    """psi of the module's text at pressure ratios downstream over upstream, 0 to 1."""
    r, b = np.asarray(ratio, dtype=float), np.asarray(critical)
    bent = np.maximum(np.minimum(r, LAMINAR) - b, 0.0) / (1.0 - b)
    linear = np.minimum((1.0 - r) / (1.0 - LAMINAR), 1.0)
    return np.asarray(np.sqrt(1.0 - bent * bent) * linear)


def mass_flow(
    conductance: Numbers, critical: Numbers, upstream: Numbers, downstream: Numbers, warmth: Numbers
) -> Array:
    """kg/s through an orifice, negative where it flows back; `warmth`: K, of the air that flows."""
    high, low = np.maximum(upstream, downstream), np.minimum(upstream, downstream)
    size = conductance * high * (REFERENCE_DENSITY * np.sqrt(ROOM / np.asarray(warmth)))
    way = np.sign(np.subtract(upstream, downstream))
    return np.asarray(way * size * flow_function(low / high, critical))


def openings(valve: Valve, spool: Numbers) -> Array:
    """How far open a valve is, (2, ...) of the edges to supply and atmosphere, 0 to 1, at a spool's
    place in V."""
    off = (np.asarray(spool) - NEUTRAL) / FULL
    both = np.stack(np.broadcast_arrays(valve.underlap + off, valve.underlap - off))
    return np.minimum(np.maximum(both, 0.0), 1.0)


def rates(air: Pneumatics, state: AirState, voltage: Array, swelling: Array) -> AirState:
    """d state / dt, while the volume grows by `swelling` (n,) m^3/s.  Air that flows back into the
    supply leaves with the chamber's temperature; air from the atmosphere comes at the room's."""
    valve, p = air.valve, state.pressure
    warm = state.temperature
    far = np.stack(np.broadcast_arrays(valve.supply, ATMOSPHERE, p))[:2]
    warmth = np.where(far > p, ROOM, warm)
    wide = valve.conductance * openings(valve, state.spool)
    flow = mass_flow(wide, valve.critical_ratio, far, p, warmth)
    energy = HEAT_CAPACITY * (flow * warmth).sum(axis=0) + air.cylinder.heat * (ROOM - warm)
    return AirState(
        (voltage - state.spool) / valve.lag,
        ((GAMMA - 1.0) * energy - GAMMA * p * swelling) / state.volume,
        flow.sum(axis=0),
        swelling,
    )


def step(air: Pneumatics, state: AirState, voltage: Array, volume: Array, dt: float) -> AirState:
    """Return the state `dt` s later, the voltage (n,) V (which has had its delay) constant and the
    volume having become `volume` (n,) m^3 at a constant rate: Runge and Kutta's fourth-order method
    in as many parts as its stability asks for.

    >>> import numpy as np
    >>> from rigid.air.plant import Pneumatics, at_rest, resting_pressure, resting_voltage, step
    >>> air = Pneumatics()
    >>> start, goal = (resting_voltage(air.valve, np.array([p])) for p in (2e5, 3e5))
    >>> volume = np.asarray(air.cylinder.volume(np.array([0.01])))
    >>> state = at_rest(air, start, volume)
    >>> after = step(air, state, goal, volume, 0.01)
    >>> bool(2e5 < after.pressure[0] < 3e5)  # Pa, absolute
    True
    """
    swelling = (volume - state.volume) / dt
    parts = int(np.ceil(dt * fastest(air, state, voltage, volume) / STABLE))
    h, at = dt / parts, np.array(state)
    for _ in range(parts):
        at = _advance(air, at, voltage, swelling, h)
    return AirState(at[0], at[1], at[2], np.array(volume, dtype=float))


def _advance(air: Pneumatics, at: Array, voltage: Array, swelling: Array, h: float) -> Array:
    def slope(now: Array) -> Array:
        return np.array(rates(air, AirState(*now), voltage, swelling))

    a = slope(at)
    b = slope(at + 0.5 * h * a)
    c = slope(at + 0.5 * h * b)
    return np.asarray(at + h / 6.0 * (a + 2.0 * (b + c) + slope(at + h * c)))


def fastest(air: Pneumatics, state: AirState, voltage: Array, volume: Array) -> float:
    """1/s, a bound of the rates at which the state can decay in a step: of the spool, or of the
    pressure through the edges opened widest (where the flow is linear) and by the heat.

    Filling warms the air to gamma times the room's temperature at most."""
    valve, least = air.valve, np.minimum(state.volume, volume)
    steep = flow_function(LAMINAR, valve.critical_ratio) / (1.0 - LAMINAR)
    wide = np.maximum(openings(valve, state.spool), openings(valve, voltage)).sum(axis=0)
    through = REFERENCE_DENSITY * GAS_CONSTANT * ROOM * valve.conductance * wide * steep
    cooled = (GAMMA - 1.0) * air.cylinder.heat * ROOM / ATMOSPHERE
    decay = GAMMA * (np.sqrt(GAMMA) * through + cooled) / least
    return float(np.max(np.maximum(1.0 / np.asarray(valve.lag), decay)))


def resting_voltage(valve: Valve, pressure: Numbers) -> Array:
    """V at which the chamber rests at a pressure between the atmosphere's and the supply's.

    At rest what comes in goes out, (u + v) ps psi(p / ps) = (u - v) p psi(pa / p) with the underlap
    u and the spool's place v, so that v = u (E - S) / (E + S)."""
    p, b = np.asarray(pressure, dtype=float), valve.critical_ratio
    if np.any((p < ATMOSPHERE) | (p > valve.supply)):
        raise InputError("air: a chamber rests between the atmosphere's pressure and the supply's")
    inward = valve.supply * flow_function(p / valve.supply, b)
    outward = p * flow_function(ATMOSPHERE / p, b)
    return np.asarray(NEUTRAL + FULL * valve.underlap * (outward - inward) / (outward + inward))


def resting_pressure(valve: Valve, voltage: Numbers) -> Array:
    """The pressure, Pa, at which the chamber rests at a voltage: `resting_voltage` inverted by
    bisection."""
    shape = np.broadcast(voltage, valve.supply, valve.underlap).shape
    low, high = np.full(shape, ATMOSPHERE), np.broadcast_to(valve.supply, shape)
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = resting_voltage(valve, middle) < voltage
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.asarray(np.where(voltage >= resting_voltage(valve, valve.supply), valve.supply, low))


def at_rest(air: Pneumatics, voltage: Array, volume: Array) -> AirState:
    """The state (n,) in which nothing changes at a voltage and a volume, at room temperature."""
    p = np.broadcast_to(resting_pressure(air.valve, voltage), np.shape(voltage)).astype(float)
    mass = p * volume / (GAS_CONSTANT * ROOM)
    return AirState(np.array(voltage, dtype=float), p, mass, np.array(volume, dtype=float))


def tension(cylinder: PneumaticCylinder, pressure: Array, inward: Numbers = 0.0) -> Array:
    """The tendons' tensions (n,) N while the piston moves inward at so many m/s: the area times the
    pressure difference less friction, and never below 0."""
    rubbing = cylinder.friction * np.tanh(np.asarray(inward) / CREEP)
    return np.asarray(np.maximum(cylinder.area * (pressure - ATMOSPHERE) - rubbing, 0.0))


CREEP = 1e-2
"""m/s at which three quarters of the friction act.  Below it fades, slowly enough for steps of 1 ms
with a friction that follows the speed of the step before."""


def _positive(what: str, table: Valve | PneumaticCylinder, *names: str) -> None:
    for name in names:
        value = np.asarray(getattr(table, name))
        if not (np.isfinite(value).all() and (value > 0).all()):
            raise InputError(f"{what}: {name} must be above 0")
