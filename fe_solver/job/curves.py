"""Curves that drive loads and motions: values over time by points, by a formula, or by a product.

Points have a rule between them and one beyond; the rules are those of FEBio's load curves
(FECore/PointCurve.cpp)."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import TypeAlias

import numpy as np

from cosim.errors import InputError, unexpected
from fe_solver.given import fill, listed, numbers
from fe_solver.job.expressions import Expression


class Interpolation(StrEnum):
    """Between the points: straight lines; the value of the next point; parabolas through three
    points, blended linearly; or a quintic step with flat ends."""

    LINEAR = "LINEAR"
    STEP = "STEP"
    SMOOTH = "SMOOTH"
    SMOOTH_STEP = "SMOOTH STEP"


class Extension(StrEnum):
    """Beyond the points: the end's value; the end's slope; the same again; the same again on top
    of what was reached."""

    CONSTANT = "CONSTANT"
    EXTRAPOLATE = "EXTRAPOLATE"
    REPEAT = "REPEAT"
    REPEAT_OFFSET = "REPEAT OFFSET"


@dataclass(frozen=True)
class LoadCurve:
    """Values over time.

    Raises InputError where there are no points, a number is not finite, the times go back, or
    (smooth curves) two times are equal.

    >>> from fe_solver.job.curves import LoadCurve
    >>> ramp = LoadCurve(times=(0.0, 1.0, 2.0), values=(0.0, 1.0, 0.0))
    >>> ramp.at(0.5), ramp.at(1.5), ramp.at(3.0)
    (0.5, 0.5, 0.0)
    """

    times: tuple[float, ...]
    """s, in ascending order."""
    values: tuple[float, ...]
    """One for each time."""
    interpolation: Interpolation = Interpolation.LINEAR
    """How the value runs between two times."""
    extension: Extension = Extension.CONSTANT
    """How it goes on before the first time and after the last."""

    def __post_init__(self) -> None:
        for name in ("times", "values"):
            fill(self, **{name: tuple(numbers(name, getattr(self, name), None).tolist())})
        if not self.times or len(self.times) != len(self.values):
            raise InputError(
                f"a curve needs as many values as times and at least one of each, got "
                f"{len(self.times)} times and {len(self.values)} values"
            )
        if not all(map(math.isfinite, self.times + self.values)):
            raise InputError("a curve's times and values must be finite numbers")
        steps = [b - a for a, b in zip(self.times, self.times[1:], strict=False)]
        if any(s < 0 for s in steps):
            raise InputError("a curve's times must ascend")
        if self.interpolation == Interpolation.SMOOTH and any(s == 0 for s in steps):
            raise InputError("a smooth curve must not have two points at one time")

    def at(self, time: float) -> float:
        """The value at a time."""
        first, last = self.times[0], self.times[-1]
        if first <= time <= last or first == last:
            return self._inside(time)
        if self.extension == Extension.CONSTANT:
            return self.values[0] if time < first else self.values[-1]
        if self.extension == Extension.EXTRAPOLATE:
            return self._extrapolate(time)
        turns = math.floor((time - first) / (last - first))
        back = min(max(time - turns * (last - first), first), last)
        again = self._inside(back)
        if self.extension == Extension.REPEAT:
            return again
        return again + turns * (self.values[-1] - self.values[0])

    def _inside(self, time: float) -> float:
        t, f = self.times, self.values
        n = min(bisect_left(t, time), len(t) - 1)
        if n == 0 or time == t[n]:
            return f[n]
        if self.interpolation == Interpolation.STEP:
            return f[n]
        share = (time - t[n - 1]) / (t[n] - t[n - 1])
        if self.interpolation == Interpolation.SMOOTH_STEP:
            share = share**3 * (10 - 15 * share + 6 * share**2)
        elif self.interpolation == Interpolation.SMOOTH and len(t) > 2:
            low = self._parabola(max(n - 2, 0), time)
            high = self._parabola(min(n - 1, len(t) - 3), time)
            return low + (high - low) * share
        return f[n - 1] + (f[n] - f[n - 1]) * share

    def _parabola(self, first: int, time: float) -> float:
        """Through the three points from number `first` on."""
        (a, b, c), f = self.times[first : first + 3], self.values[first : first + 3]
        return (
            f[0] * (time - b) * (time - c) / ((a - b) * (a - c))
            + f[1] * (time - a) * (time - c) / ((b - a) * (b - c))
            + f[2] * (time - a) * (time - b) / ((c - a) * (c - b))
        )

    def _extrapolate(self, time: float) -> float:
        before = time < self.times[0]
        end, value = (
            (self.times[0], self.values[0]) if before else (self.times[-1], self.values[-1])
        )
        if self.interpolation in (Interpolation.STEP, Interpolation.SMOOTH_STEP):
            return value
        span = 1e-3 * (self.times[-1] - self.times[0])
        if self.interpolation == Interpolation.LINEAR:
            span = (self.times[1] - end) if before else (end - self.times[-2])
        near = end + span if before else end - span
        if near == end:
            return value
        return value + (time - end) * (self._inside(near) - value) / (near - end)


class Outside(StrEnum):
    """Beyond a formula's interval: nothing; the end's value; the same again."""

    ZERO = "zero"
    CONSTANT = "constant"
    REPEAT = "repeat"


@dataclass(frozen=True)
class FormulaCurve:
    """A formula of the time t (s).

    Raises InputError where it is no arithmetic of t, or the interval has no length; `at` raises it
    where the formula has no finite value.

    >>> from fe_solver.job.curves import FormulaCurve
    >>> FormulaCurve("2*t^2").at(3.0)
    18.0
    """

    text: str
    interval: tuple[float, float] | None = None
    """s, outside which the formula is not asked; None is everywhere."""
    before: Outside = Outside.CONSTANT
    """How it goes on before the interval."""
    after: Outside = Outside.CONSTANT
    """How it goes on after the interval."""

    def __post_init__(self) -> None:
        _ = self._formula
        if self.interval is not None and not self.interval[0] < self.interval[1]:
            raise InputError(f"a formula's interval must ascend, got {self.interval}")

    @cached_property
    def _formula(self) -> Expression:
        return Expression(self.text, ("t",))

    def at(self, time: float) -> float:
        """The value at a time."""
        if self.interval is not None and not self.interval[0] <= time <= self.interval[1]:
            low, high = self.interval
            how = self.before if time < low else self.after
            if how == Outside.ZERO:
                return 0.0
            repeated = low + (time - low) % (high - low)
            time = repeated if how == Outside.REPEAT else min(max(time, low), high)
        return float(self._formula.value({"t": time}))


@dataclass(frozen=True)
class ProductCurve:
    """The product of curves."""

    factors: tuple[Curve, ...]

    def at(self, time: float) -> float:
        """The value at a time."""
        return math.prod(f.at(time) for f in self.factors)


@dataclass(frozen=True)
class SumCurve:
    """The sum of quantities over time."""

    terms: tuple[Drive, ...]

    def at(self, time: float) -> float:
        """The value at a time."""
        return sum(term.at(time) for term in self.terms)


Curve: TypeAlias = LoadCurve | FormulaCurve | ProductCurve | SumCurve


def product_of(*curves: Curve | None) -> Curve | None:
    """The product of those curves that are given; None where there are none."""
    factors = tuple(c for c in curves if c is not None)
    return ProductCurve(factors) if len(factors) > 1 else next(iter(factors), None)


def sum_of(drives: Sequence[Drive]) -> Drive:
    """The sum of quantities over time."""
    terms = tuple(d for d in drives if d.value)
    return Drive(1.0, SumCurve(terms)) if len(terms) > 1 else next(iter(terms), Drive())


@dataclass(frozen=True)
class Drive:
    """A quantity over time: `value` times the curve, or `value` at all times."""

    value: float = 0.0
    curve: Curve | None = None

    def at(self, time: float) -> float:
        """Return the quantity at a time (s), in the unit of `value`."""
        return self.value * (1.0 if self.curve is None else self.curve.at(time))


def drive_from(place: str, given: object) -> Drive:
    """A quantity over time, or a number that it is at all times.  Raises InputError."""
    if isinstance(given, Drive):
        return given
    value = numbers(place, given)
    if value.ndim or not np.isfinite(value):
        raise unexpected(place, "a Drive or a finite number", given)
    return Drive(float(value))


def drives_from(place: str, given: object) -> tuple[Drive, ...]:
    """Three quantities along x, y, z, each as `drive_from` takes it.  Raises InputError."""
    members = listed(given)
    if members is None or len(members) != 3:
        raise unexpected(place, "three quantities along x, y, z", given)
    return tuple(drive_from(place, d) for d in members)


def check_curve(given: object) -> None:
    """Check a curve.  Raises InputError."""
    if given is not None and not hasattr(given, "at"):
        raise unexpected("curve", "a LoadCurve, a FormulaCurve or None", given)
