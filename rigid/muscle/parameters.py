"""The parameters of a set of muscles, checked, and the curves that they share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.errors import InputError
from cosim.port import Array
from rigid.muscle import curves
from rigid.muscle.curves import Curve

MAX_PENNATION = math.acos(0.1)
"""rad, OpenSim's largest pennation angle."""


@dataclass(frozen=True, eq=False)
class MuscleCurves:
    """The four curves that a set of muscles shares; by default those of the damped muscle."""

    active: Curve
    passive: Curve
    velocity: Curve
    tendon: Curve

    @cached_property
    def table(self) -> CurveTable:
        """All four, in that order."""
        return CurveTable.of([self.active, self.passive, self.velocity, self.tendon])


DAMPED = MuscleCurves(
    curves.active_force_length(),
    curves.passive_force_length(),
    curves.force_velocity(),
    curves.tendon_force_length(),
)
"""The default curves of OpenSim's muscle with fibre damping (f_AL falls to 0)."""
POSITIVE = (
    "max_force",
    "optimal_fibre_length",
    "tendon_slack_length",
    "max_velocity",
    "activation_time",
    "deactivation_time",
)


@dataclass(frozen=True, eq=False)
class Muscles:
    """n muscles; a scalar stands for the same value in all of them.  Defaults are OpenSim's."""

    names: tuple[str, ...]
    max_force: Array
    """N, isometric, at optimal fibre length."""
    optimal_fibre_length: Array
    """m."""
    tendon_slack_length: Array
    """m."""
    pennation: Array
    """rad, at optimal fibre length."""
    max_velocity: Array | float = 10.0
    """Optimal fibre lengths per second."""
    damping: Array | float = 0.1
    """beta, F0 per unit of normalised velocity."""
    activation_time: Array | float = 0.010
    """s."""
    deactivation_time: Array | float = 0.040
    """s."""
    min_activation: Array | float = 0.01
    """Activations and excitations below are raised to it."""
    curves: MuscleCurves = DAMPED
    rigid_tendon: bool = False

    def __post_init__(self) -> None:
        for key in POSITIVE:
            self._settle(key, np.nextafter(0.0, 1.0), np.finfo(float).max, "a number above 0")
        self._settle("pennation", 0.0, MAX_PENNATION, f"0 to {MAX_PENNATION:.4f} rad")
        self._settle("damping", 0.0, np.finfo(float).max, "a number of at least 0")
        self._settle("min_activation", 0.0, 1.0, "0 to 1")
        undamped = np.asarray(self.damping) == 0.0
        level = self.curves.velocity.end_slopes.min() <= 0.0
        if level and undamped.any() and not self.rigid_tendon:
            raise InputError(
                f"muscle {self.first(undamped)}, damping: 0 leaves the velocity undetermined "
                "where the force-velocity curve is level; expected damping above 0, a rigid "
                "tendon, or curves=curves_without_damping()"
            )

    def _settle(self, key: str, lower: float, upper: float, wanted: str) -> None:
        """Replaces a parameter by its checked array (n,)."""
        given = np.asarray(getattr(self, key), dtype=float)
        if given.shape not in ((), (len(self.names),)):
            raise InputError(
                f"muscles, {key}: expected a number or one for each of the {len(self.names)} "
                f"muscles, got shape {given.shape}"
            )
        value = np.broadcast_to(given, len(self.names)).copy()
        bad = ~((value >= lower) & (value <= upper))
        if bad.any():
            raise InputError(
                f"muscle {self.first(bad)}, {key}: expected {wanted}, got {value[bad][0]:g}"
            )
        object.__setattr__(self, key, value)

    def first(self, where: NDArray[np.bool_]) -> str:
        """Name of the first muscle that a mask (..., n or 1) marks."""
        where = np.broadcast_to(where, np.broadcast_shapes(where.shape, (len(self.names),)))
        return self.names[int(np.argmax(where.reshape(-1, len(self.names)).any(axis=0)))]

    def check(self, what: str, given: ArrayLike, lower: float, upper: float) -> Array:
        """`given` as floats ending in the muscles' axis.  Raises InputError, naming the muscle."""
        value = np.asarray(given, dtype=float)
        if value.shape[-1:] not in ((), (1,), (len(self.names),)):
            raise InputError(
                f"{what}: expected the last axis to be {len(self.names)} muscles {self.names}, "
                f"got shape {value.shape}"
            )
        bad = ~((value >= lower) & (value <= upper))
        if bad.any():
            raise InputError(
                f"muscle {self.first(bad)}, {what}: expected {lower:g} to {upper:g}, got "
                f"{value[bad].flat[0]:g}"
            )
        return value

    def effective(self, activation: Array) -> Array:
        """Activation, at least the smallest one."""
        return np.maximum(activation, self.min_activation)

    @cached_property
    def width(self) -> Array:
        """The constant distance (n,) m that the fibres span across the line of pull."""
        return self.optimal_fibre_length * np.sin(self.pennation)

    @cached_property
    def shortest_fibre(self) -> Array:
        """The shortest fibre lengths (n,) m: where f_AL begins, or where the pennation angle is
        largest."""
        active = self.curves.active.knots[0, 0] * self.optimal_fibre_length
        return np.maximum(active, self.width / math.sin(MAX_PENNATION))

    @cached_property
    def shortest_along(self) -> Array:
        """The extent (n,) m of the shortest fibre along the tendon."""
        return np.sqrt(self.shortest_fibre**2 - self.width**2)

    @cached_property
    def scales(self) -> Scales:
        """What the force balance divides by."""
        return Scales(
            self.width**2,
            1.0 / self.optimal_fibre_length,
            1.0 / (self.max_velocity * self.optimal_fibre_length),
            1.0 / self.tendon_slack_length,
            np.minimum(self.optimal_fibre_length, self.tendon_slack_length),
        )


class Scales(NamedTuple):
    """Numbers that a solve takes over and over, (n,) each: squared width, the reciprocals of
    lengths and of the largest velocity, and the shorter one of fibre and tendon."""

    width2: Array
    per_fibre: Array
    per_velocity: Array
    per_tendon: Array
    shorter: Array


CELLS = 8192
"""A curve: within 1e-11 of the Bezier splines' values and 2e-7 of their slopes (tested)."""


@dataclass(frozen=True, eq=False)
class CurveTable:
    """k curves, each evaluated at its own points."""

    first: Array
    """(k, 1) where the first cell begins, in cells."""
    per_unit: Array
    """(k, 1) cells per unit of x."""
    offset: NDArray[np.intp]
    """(k, 1) number of each curve's first cell."""
    last: float
    """Index of a curve's last cell."""
    power: Array
    """(4, k * cells) rising power coefficients over a cell's own coordinate."""

    @staticmethod
    def of(curves: Sequence[Curve], cells: int = CELLS) -> CurveTable:
        """Cubic Hermite polynomials; the outermost cells hold the linear continuations."""
        ends = np.array([curve.domain for curve in curves])
        per_unit = (cells - 2) / np.ptp(ends, axis=1, keepdims=True)
        power = np.hstack([hermite(curve, cells) for curve in curves])
        offset = cells * np.arange(len(curves), dtype=np.intp)[:, None]
        return CurveTable(ends[:, :1] * per_unit - 1.0, per_unit, offset, cells - 1.0, power)

    def __call__(self, x: Array) -> tuple[Array, Array]:
        """Values and slopes (k, ...) at `x` (k, ...), row i by curve i."""
        place = x.reshape(len(x), -1) * self.per_unit - self.first
        cell = np.minimum(np.maximum(place, 0.0), self.last).astype(np.intp)
        t = place - cell
        c0, c1, c2, c3 = self.power.take(cell + self.offset, axis=1)
        high = c3 * t
        mixed = high + c2
        value = (mixed * t + c1) * t + c0
        slope = ((high + mixed + mixed) * t + c1) * self.per_unit
        return value.reshape(x.shape), slope.reshape(x.shape)


def hermite(curve: Curve, cells: int) -> Array:
    """The coefficients (4, cells) over [0, 1] of each cell, one cell beyond either end."""
    lower, upper = curve.domain
    width = (upper - lower) / (cells - 2)
    y, slope, _ = curve.evaluate(lower + width * np.arange(-1.0, cells))
    d, rise = slope * width, np.diff(y)
    bend = np.stack([3 * rise - 2 * d[:-1] - d[1:], d[:-1] + d[1:] - 2 * rise])
    bend[:, [0, -1]] = 0.0  # rounding there would grow with the cube of the distance
    return np.vstack([y[:-1], d[:-1], bend])
