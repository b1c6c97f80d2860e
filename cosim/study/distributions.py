"""What a parameter of a study may be: a distribution to sample, or an axis of a grid."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, log, sqrt
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np

from cosim.errors import InputError
from cosim.port import Array

if TYPE_CHECKING:
    from typing_extensions import TypeIs

Word = float | str | bool
"""A value on an axis: a number in the parameter's unit, or a word of the case."""


class Distribution(Protocol):
    """A continuous distribution of one number."""

    def quantile(self, probability: Array) -> Array:
        """The inverse of the cumulative distribution: (n,) in (0, 1) -> (n,)."""
        ...


@dataclass(frozen=True)
class Normal:
    mean: float
    sd: float

    def __post_init__(self) -> None:
        _positive(self.sd)

    def quantile(self, probability: Array) -> Array:
        return _freeze("norm", self.mean, self.sd).ppf(probability)


@dataclass(frozen=True)
class TruncatedNormal:
    """A normal distribution of which only what lies in [low, high] is kept; mean and SD are those
    of the whole one, before it is cut."""

    mean: float
    sd: float
    low: float
    high: float

    def __post_init__(self) -> None:
        _positive(self.sd)
        _rising(self.low, self.high)

    def quantile(self, probability: Array) -> Array:
        ends = ((end - self.mean) / self.sd for end in (self.low, self.high))
        return _freeze("truncnorm", *ends, self.mean, self.sd).ppf(probability)


@dataclass(frozen=True)
class Lognormal:
    """A lognormal distribution by mean and SD of the number itself, not of its logarithm."""

    mean: float
    sd: float

    def __post_init__(self) -> None:
        _positive(self.sd)
        if self.mean <= 0:
            raise InputError("mean: must be above 0, since a lognormal number is")

    def quantile(self, probability: Array) -> Array:
        spread = sqrt(log(1 + (self.sd / self.mean) ** 2))
        median = self.mean / exp(spread**2 / 2)
        return _freeze("lognorm", spread, 0, median).ppf(probability)


@dataclass(frozen=True)
class Uniform:
    low: float
    high: float

    def __post_init__(self) -> None:
        _rising(self.low, self.high)

    def quantile(self, probability: Array) -> Array:
        return self.low + (self.high - self.low) * np.asarray(probability)


@dataclass(frozen=True)
class GridAxis:
    """Values to take one after the other."""

    values: tuple[Word, ...]

    @property
    def is_numeric(self) -> bool:
        """Whether the values are numbers and not words."""
        return all(type(v) is float for v in self.values)


Law = Normal | TruncatedNormal | Lognormal | Uniform | GridAxis


def is_axis(law: Law) -> TypeIs[GridAxis]:
    """Whether its values are taken one after the other, and not sampled."""
    return isinstance(law, GridAxis)


def axis(first: float, last: float, count: int, spacing: Literal["linear", "log"]) -> GridAxis:
    """So many values from first to last, both in it.  Raises InputError."""
    if spacing == "log" and not (first > 0 and last > 0):
        raise InputError('spacing: "log" needs from and to above 0')
    values = (np.geomspace if spacing == "log" else np.linspace)(first, last, count)
    return GridAxis(tuple(map(float, values)))


def middle(law: Law) -> Word:
    """The median of a distribution, the first value of an axis."""
    return law.values[0] if is_axis(law) else float(law.quantile(np.array([0.5]))[0])


def _freeze(name: str, *numbers: float) -> Any:
    from scipy import stats

    return getattr(stats, name)(*numbers)


def _positive(sd: float) -> None:
    if sd <= 0:
        raise InputError("sd: must be above 0")


def _rising(low: float, high: float) -> None:
    if not low < high:
        raise InputError("low: must be below high")
