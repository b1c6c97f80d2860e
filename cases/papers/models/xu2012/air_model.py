"""Paper 003's polynomial model of the air, identified from the plant of `rigid.air.plant`.

    dP/dt = a0 + a2 V^2 + a3 V^3 + b0 P + b1 P V + b2 P V^2 + b3 P V^3        (section IV)

with P above the atmosphere and V the voltage as commanded, 0 to 10 V.  The printed equation has no
a1 V; `FULL_TERMS` has it.  The plant is observed as the paper's is: the pressure averaged over 10
ms and kept at 100 Hz, each value at the end of its batch; dP/dt by central differences.

An equation without memory cannot know of a dead time.  The voltage that it takes is therefore that
of `lag` samples before, a whole number that is identified with the coefficients; `lag = 0` is the
equation as printed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cosim.errors import InputError
from cosim.port import Array
from rigid.air.plant import ATMOSPHERE, FULL, NEUTRAL, Pneumatics, at_rest, step

SAMPLE = 0.01
"""s between two values (100 Hz), each the average of this time (paper 003: 500 at 50 kHz)."""
STEP = 1e-3
"""s, of the plant."""
PARTS = round(SAMPLE / STEP)
PRINTED_TERMS = ((0, 0), (2, 0), (3, 0), (0, 1), (1, 1), (2, 1), (3, 1))
"""Powers of V and of P, in the paper's order: a0, a2, a3, b0, b1, b2, b3."""
FULL_TERMS = ((0, 0), (1, 0), *PRINTED_TERMS[1:])
TERM_NAMES = {(v, p): f"{'ab'[p]}{v}" for v, p in FULL_TERMS}
MOST_LAG = 8
"""Samples that are tried."""
BLOCK = 50
"""Samples that the intervals take as one: residuals of neighbours are alike."""
SURE = 1.959963984540054
"""Standard deviations of a 95 % interval."""
TRAINING = (0.5, 1.0, 2.0, 4.0)
"""Hz, of the voltage from which the model is identified; ours, the paper does not print its own."""
UNSEEN = (0.7, 1.5, 3.0, 5.0)
"""Hz, of the voltage on which the model is judged; ours too."""
AMPLITUDE = 0.5
"""V about the middle: the underlap, over which the valve sets a pressure and not only a speed."""
DURATION = 10.0
"""s of each record: whole periods of all of them."""
Command = Callable[[float], Array]
"""(n,) V at a time in s."""


@dataclass(frozen=True)
class PressureRecord:
    """What is logged at 100 Hz of n cylinders: k values each."""

    time: Array
    """(k,) s."""
    voltage: Array
    """(k, n) V, commanded at those times."""
    pressure: Array
    """(k, n) Pa above the atmosphere, the average of the 10 ms before."""

    @property
    def rate(self) -> Array:
        """The pressures' rates (k - 2, n) Pa/s, of all but the first and the last value."""
        return np.asarray((self.pressure[2:] - self.pressure[:-2]) / (2.0 * SAMPLE))


@dataclass(frozen=True)
class AirModel:
    """The identified equation.  Coefficients (m,) in Pa/s and 1/s per power of V, each with half
    its 95 % interval."""

    terms: tuple[tuple[int, int], ...]
    coefficients: Array
    interval: Array
    lag: int
    """Samples by which the voltage is older than the pressure."""

    def rate(self, pressure: Array, voltage: Array) -> Array:
        """Pa/s at pressures above the atmosphere and voltages of `lag` samples before."""
        return _columns(self.terms, voltage, pressure) @ self.coefficients

    def ahead(self, pressure: Array, voltages: Array, dt: float = SAMPLE) -> Array:
        """The pressures (n,) Pa that follow after as many times dt as there are rows in `voltages`
        (j, n): those given already, the oldest first, whose effect the lag still holds back.

        Exact for the equation, which is linear in P: with dP/dt = a + b P over a time h,
        P(h) = P + (a + b P) (e^(b h) - 1) / b."""
        for v in voltages:
            here = self.rate(pressure, v)
            b = self.rate(np.ones_like(v), v) - self.rate(np.zeros_like(v), v)
            grown = np.where(b == 0.0, dt, np.expm1(b * dt) / np.where(b == 0.0, 1.0, b))
            pressure = pressure + here * grown
        return pressure


def simulate_record(air: Pneumatics, command: Command, duration: float, n: int) -> PressureRecord:
    """The plant from rest at the first command on, its pistons fixed at half their stroke (as in
    the paper's experiments).  Raises InputError for less than three values."""
    count = round(duration / SAMPLE)
    if count < 3:
        raise InputError(f"air: a record of {duration:g} s has less than three values at 100 Hz")
    valve, cylinder = air.valve, air.cylinder
    volume = np.broadcast_to(cylinder.volume(0.5 * np.asarray(cylinder.stroke)), n).astype(float)
    late = np.broadcast_to(valve.delay, n)
    state = at_rest(air, _late(command, 0.0, late), volume)
    pressure = [state.pressure]
    for k in range(count * PARTS):
        state = step(air, state, _late(command, (k + 0.5) * STEP, late), volume, STEP)
        pressure.append(state.pressure)
    p = np.array(pressure) - ATMOSPHERE
    middle = 0.5 * (p[1:] + p[:-1])
    time = SAMPLE * np.arange(1.0, count + 1.0)
    voltage = np.array([np.broadcast_to(command(t), n) for t in time])
    return PressureRecord(np.asarray(time), voltage, middle.reshape(count, PARTS, n).mean(axis=1))


def _late(command: Command, time: float, delay: Array) -> Array:
    """The voltages (n,) V that reach the valves at a time, each commanded its delay before; the
    first before."""
    if np.all(delay == delay[0]):
        return np.broadcast_to(command(max(time - delay[0], 0.0)), delay.shape)
    return np.array([command(max(time - d, 0.0))[i] for i, d in enumerate(delay)])


def sines(
    air: Pneumatics,
    frequencies: tuple[float, ...],
    amplitude: float = AMPLITUDE,
    duration: float = DURATION,
    middle: float = NEUTRAL,
) -> PressureRecord:
    """One cylinder for each frequency in Hz, its voltage a sine about `middle`, V."""
    if not 0.0 < amplitude <= FULL:
        raise InputError(f"air: the amplitude lies between 0 and {FULL:g} V")
    turning = 2.0 * np.pi * np.array(frequencies)
    return simulate_record(
        air, lambda t: middle + amplitude * np.sin(turning * t), duration, len(turning)
    )


def _columns(terms: tuple[tuple[int, int], ...], voltage: Array, pressure: Array) -> Array:
    """The model's terms V^v P^p, (..., m)."""
    return np.stack([voltage**v * pressure**p for v, p in terms], axis=-1)


def pair_rows(record: PressureRecord, lag: int) -> tuple[Array, Array, Array]:
    """Voltages, pressures and rates that belong together, (j, n) each."""
    rows = np.arange(max(lag, 1), len(record.time) - 1)
    return record.voltage[rows - lag], record.pressure[rows], record.rate[rows - 1]


def identify(
    record: PressureRecord,
    lag: int | None = None,
    terms: tuple[tuple[int, int], ...] = PRINTED_TERMS,
) -> AirModel:
    """The coefficients of least squares over all cylinders of a record; without a `lag` that of the
    least residual per value.

    The intervals are those of White's covariance with blocks of 0.5 s for single values (Liang and
    Zeger 1986, Biometrika 73:13), since what is left over is the equation's own misfit, which is
    alike from one sample to the next.  Raises InputError where the record cannot tell the
    coefficients apart."""
    if lag is None:
        tried = [identify(record, k, terms) for k in range(MOST_LAG + 1)]
        return min(tried, key=lambda m: float(np.mean(_residual(m, record) ** 2)))
    voltage, pressure, rate = pair_rows(record, lag)
    x = _columns(terms, voltage, pressure)
    scale = np.sqrt(np.mean(x**2, axis=(0, 1)))
    x = x / np.where(scale > 0.0, scale, 1.0)
    flat = x.reshape(-1, len(terms))
    found, _, rank, _ = np.linalg.lstsq(flat, rate.ravel(), rcond=1e-12)
    if rank < len(terms):
        raise InputError(
            f"air: the record tells only {rank} of {len(terms)} coefficients apart; excite the "
            "valve with more frequencies or a larger amplitude"
        )
    apart = spread(x, rate - x @ found)
    return AirModel(terms, found / scale, SURE * apart / scale, lag)


def spread(x: Array, residual: Array) -> Array:
    """The standard deviations (m,) from (j, n, m) and (j, n), each cylinder cut into blocks."""
    m = x.shape[-1]
    scores = x * residual[..., None]
    sums = np.add.reduceat(scores, np.arange(0, len(x), BLOCK), axis=0).reshape(-1, m)
    flat = x.reshape(-1, m)
    inverse = np.linalg.inv(flat.T @ flat)
    return np.sqrt(np.diag(inverse @ (sums.T @ sums) @ inverse))


def _residual(model: AirModel, record: PressureRecord) -> Array:
    voltage, pressure, rate = pair_rows(record, model.lag)
    return np.asarray(rate - model.rate(pressure, voltage))


def r_squared(model: AirModel, record: PressureRecord) -> tuple[float, Array]:
    """1 less the residual's share of the variance of dP/dt: of all cylinders together, and (n,) of
    each by itself."""
    rate, off = pair_rows(record, model.lag)[2], _residual(model, record)
    each = 1.0 - (off**2).sum(axis=0) / ((rate - rate.mean(axis=0)) ** 2).sum(axis=0)
    return float(1.0 - (off**2).sum() / ((rate - rate.mean()) ** 2).sum()), each


@dataclass(frozen=True)
class Identification:
    """A model, the record that it is from, and one at other frequencies."""

    model: AirModel
    training: PressureRecord
    unseen: PressureRecord


def identification(
    air: Pneumatics, amplitude: float = AMPLITUDE, duration: float = DURATION
) -> Identification:
    """Excitation at TRAINING and UNSEEN, Hz, in one go, and the model of the first."""
    both = sines(air, TRAINING + UNSEEN, amplitude, duration)
    n = len(TRAINING)
    training = PressureRecord(both.time, both.voltage[:, :n], both.pressure[:, :n])
    unseen = PressureRecord(both.time, both.voltage[:, n:], both.pressure[:, n:])
    return Identification(identify(training), training, unseen)


STEPPED_UP = (4.6, 4.8, 5.0, 5.2, 5.5, 6.0, 8.0)
"""V, to which a step goes from an empty chamber (0 V); ours, the paper's are not printed."""
STEPPED_DOWN = (2.0, 4.0, 4.5, 4.8, 5.0, 5.2)
"""V, to which a step goes from a full chamber (10 V); ours too."""
AT = 0.05
"""s, when the step comes."""


def steps(
    air: Pneumatics, start: float, ends: tuple[float, ...], duration: float = 1.0
) -> PressureRecord:
    """Steps of the voltage from rest at `start`, one cylinder for each end; pistons fixed.  The
    paper's steps last 2.5 s, of which the first 0.2 s matter here."""
    to = np.array(ends)
    return simulate_record(air, lambda t: np.where(t < AT, start, to), duration, len(to))


def latency(record: PressureRecord) -> Array:
    """Each cylinder's delay (n,) s, from the step to the largest |dP/dt| of the 100 Hz signal, to
    its 10 ms."""
    at = np.abs(record.rate).argmax(axis=0) + 1
    return np.asarray(record.time[at] - AT)
