"""The muscle's characteristic curves: quintic Bezier splines, C2, linear outside their domain.

Each segment is a *corner*: it leaves its first point along one tangent, arrives at its last along
another, and `curviness` draws it towards the point where both tangents meet.  Doubling the inner
control points makes the curvature vanish at both ends, hence C2 (Millard, Uchida, Seth, Delp 2013,
J Biomech Eng 135:021005, appendix; construction points and default parameters as in OpenSim 4's
ActiveForceLengthCurve, FiberForceLengthCurve, ForceVelocityCurve and TendonForceLengthCurve).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.errors import ConvergenceError, InputError
from cosim.port import Array

Function = Callable[[Array], tuple[Array, Array]]

LIMIT = 120
"""Most iterations."""
STEEP = 1e-30
"""Least slope that is divided by: a flat function sends Newton out of the bracket, to bisection."""
BERNSTEIN = np.array(
    [
        [1, 0, 0, 0, 0, 0],
        [-5, 5, 0, 0, 0, 0],
        [10, -20, 10, 0, 0, 0],
        [-10, 30, -30, 10, 0, 0],
        [5, -20, 30, -20, 5, 0],
        [-1, 5, -10, 10, -5, 1],
    ],
    dtype=float,
)
"""Power coefficients (rising) of a quintic from its control points."""


class Knot(NamedTuple):
    """A point of a curve and its slope there."""

    x: float
    y: float
    slope: float


def corner(first: Knot, last: Knot, curviness: float) -> Array:
    """The control points x, y (2, 6) of the segment between two knots; curviness 0 to 1 (sharp)."""
    turn = first.slope - last.slope
    if abs(turn) > np.sqrt(np.finfo(float).eps):
        x = (last.y - first.y - last.x * last.slope + first.x * first.slope) / turn
    else:
        x = 0.5 * (first.x + last.x)
    flatter = min(first, last, key=lambda knot: abs(knot.slope))  # a level end stays level
    meeting = np.array([x, flatter.y + (x - flatter.x) * flatter.slope])
    ends = np.array([first[:2], last[:2]])
    inner = ends + (0.1 + 0.8 * curviness) * (meeting - ends)
    return np.stack([ends[0], inner[0], inner[0], inner[1], inner[1], ends[1]], axis=1)


@dataclass(frozen=True, eq=False)
class Curve:
    """y(x) through knots, a corner between each two of them."""

    control: Array
    """(segments, 2, 6) control points."""

    @staticmethod
    def through(knots: Sequence[Knot], curviness: float | Sequence[float]) -> Curve:
        """The curve through the knots.  Raises InputError where a corner would not be a function of
        x or turn back."""
        bends = np.broadcast_to(curviness, len(knots) - 1)
        pairs = zip(knots[:-1], knots[1:], bends, strict=True)
        control = np.array([corner(a, b, float(c)) for a, b, c in pairs])
        if not ((bends >= 0) & (bends <= 1)).all():
            raise InputError(f"muscle curve: curviness {curviness}: expected 0 to 1")
        if (np.diff(control[:, 0]) < 0).any() or not np.isfinite(control).all():
            raise InputError(
                f"muscle curve through {[tuple(k) for k in knots]}: the tangents of neighbouring "
                "points must meet between them; expected rising x and slopes that fit the points"
            )
        return Curve(control)

    @cached_property
    def power(self) -> Array:
        """The rising power coefficients (2, segments, 6) of x(u) and y(u), u in [0, 1]."""
        return np.moveaxis(self.control @ BERNSTEIN.T, 1, 0)

    @property
    def knots(self) -> Array:
        """The knots' x and y, (2, segments + 1)."""
        return np.concatenate([self.control[:, :, 0].T, self.control[-1:, :, 5].T], axis=1)

    @property
    def domain(self) -> tuple[float, float]:
        """x of the first knot and of the last; beyond, the curve is straight."""
        return float(self.control[0, 0, 0]), float(self.control[-1, 0, 5])

    @property
    def end_slopes(self) -> Array:
        """The slopes (2,) of the linear continuation below and above."""
        first, last = self.control[0, :, 1] - self.control[0, :, 0], self.control[-1, :, 5]
        last = last - self.control[-1, :, 4]
        return np.array([first[1] / first[0], last[1] / last[0]])

    def evaluate(self, x: Array) -> tuple[Array, Array, Array]:
        """Value, first and second derivative at `x` (any shape), to rounding."""
        x = np.asarray(x, dtype=float)
        inside = np.clip(x, *self.domain)
        (_, dx, ddx), (y, dy, ddy) = self._at(inside, axis=0)
        below, above = self.end_slopes
        slope = np.where(x < inside, below, np.where(x > inside, above, dy / dx))
        curvature = np.where(x == inside, (ddy * dx - dy * ddx) / dx**3, 0.0)
        return y + slope * (x - inside), slope, curvature

    def value(self, x: Array) -> Array:
        """The value alone."""
        return self.evaluate(x)[0]

    def inverse(self, y: Array) -> Array:
        """x with value(x) = y of a rising curve; on a level continuation the end of the domain."""
        y = np.asarray(y, dtype=float)
        inside = np.clip(y, *self.knots[1, [0, -1]])
        (x, _, _), _ = self._at(inside, axis=1)
        slope = self.end_slopes[np.where(y < inside, 0, 1)]
        beyond = np.divide(y - inside, slope, out=np.zeros_like(inside), where=slope > 0)
        return np.asarray(x + beyond)

    def _at(self, target: Array, axis: int) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        """x and y with two u-derivatives each, where x (axis 0) or y (axis 1) is `target`."""
        knots = self.knots[axis]
        segment = np.clip(np.searchsorted(knots, target, side="right") - 1, 0, len(knots) - 2)
        wanted = self.power[axis][segment]

        def gap(u: Array) -> tuple[Array, Array]:
            value, slope, _ = quintic(wanted, u)
            return value - target, slope

        ends = np.zeros_like(target), np.ones_like(target)
        u = increasing_root(gap, *ends, 0.5 * ends[1], np.full_like(target, 1e-14))
        return quintic(self.power[0][segment], u), quintic(self.power[1][segment], u)


def quintic(c: Array, u: Array) -> tuple[Array, Array, Array]:
    """Value and two derivatives of sum c[..., k] u^k."""
    p, d, h = c[..., 5], np.zeros_like(u), np.zeros_like(u)
    for k in range(4, -1, -1):
        h = h * u + 2.0 * d
        d = d * u + p
        p = p * u + c[..., k]
    return p, d, h


def active_force_length(
    shortest: float = 0.4441,
    transition: float = 0.73,
    longest: float = 1.8123,
    shallow_slope: float = 0.8616,
    minimum: float = 0.0,
) -> Curve:
    """Active force over normalised fibre length; 1 at 1.

    Defaults as OpenSim's ActiveForceLengthCurve, but `minimum` 0, which the damped muscle takes
    (the curve's own default, 0.1, is for the undamped one)."""
    flat = 0.05
    bend = 1.0 - flat
    low = 1.0 - shallow_slope * (bend - transition)
    steep = Knot(0.5 * (shortest + transition), 0.5 * low, 1.25 * low / (transition - shortest))
    shallow = Knot(0.5 * (transition + bend), 0.5 * (low + 1.0), shallow_slope)
    middle = 0.5 * (1.0 + flat + longest)
    falling = Knot(middle, 0.5, -1.0 / (longest - 1.0 - 2.0 * flat))
    ends = Knot(shortest, minimum, 0.0), Knot(longest, minimum, 0.0)
    return Curve.through([ends[0], steep, shallow, Knot(1.0, 1.0, 0.0), falling, ends[1]], 1.0)


def passive_force_length(
    zero_strain: float = 0.0,
    one_strain: float = 0.7,
    low_stiffness: float = 0.2,
    one_stiffness: float | None = None,
    curviness: float = 0.75,
) -> Curve:
    """Passive force over normalised fibre length; 1 at 1 + `one_strain`.

    `one_stiffness` defaults to 2 / (one_strain - zero_strain), as OpenSim's FiberForceLengthCurve
    does."""
    span = one_strain - zero_strain
    stiffness = 2.0 / span if one_stiffness is None else one_stiffness
    toe = min(0.1 / stiffness, 0.1 * span)
    start = 1.0 + zero_strain
    low = Knot(start + toe, 0.5 * toe * low_stiffness, low_stiffness)
    end = Knot(1.0 + one_strain, 1.0, stiffness)
    return Curve.through([Knot(start, 0.0, 0.0), low, end], curviness)


def force_velocity(
    concentric: tuple[float, float] = (0.0, 0.25),
    isometric: float = 5.0,
    eccentric: tuple[float, float] = (0.0, 0.15),
    eccentric_force: float = 1.4,
    curviness: tuple[float, float] = (0.6, 0.9),
) -> Curve:
    """Force multiplier over normalised fibre velocity (lengthening positive); 1 at 0.

    `concentric` and `eccentric` are the slopes at and near the largest velocity.  Defaults as
    OpenSim's ForceVelocityCurve."""
    near = 0.9
    slow = 0.5 * (1.0 - near)
    shortening = Knot(-near, slow * sum(concentric), concentric[1])
    lengthening = Knot(near, eccentric_force - slow * sum(eccentric), eccentric[1])
    fastest = Knot(-1.0, 0.0, concentric[0]), Knot(1.0, eccentric_force, eccentric[0])
    knots = [fastest[0], shortening, Knot(0.0, 1.0, isometric), lengthening, fastest[1]]
    return Curve.through(knots, np.repeat(curviness, 2).tolist())


def tendon_force_length(
    one_strain: float = 0.049,
    one_stiffness: float | None = None,
    toe_force: float = 2.0 / 3.0,
    curviness: float = 0.5,
) -> Curve:
    """Tendon force over tendon length by slack length; 1 at 1 + `one_strain`.

    `one_stiffness` defaults to 1.375 / one_strain, as OpenSim's TendonForceLengthCurve does.
    The curve ends where the toe does, at `toe_force`; beyond, it is linear."""
    stiffness = 1.375 / one_strain if one_stiffness is None else one_stiffness
    toe = 1.0 + one_strain - (1.0 - toe_force) / stiffness
    foot = 1.0 + 0.1 * (toe - 1.0)
    halfway = 1.0 + one_strain - (1.0 - 0.5 * toe_force) / stiffness
    slope = 0.5 * toe_force / (halfway - foot)
    bend = 0.5 * (foot + halfway)
    middle = Knot(bend, slope * (bend - foot), slope)
    return Curve.through([Knot(1.0, 0.0, 0.0), middle, Knot(toe, toe_force, stiffness)], curviness)


class NotConverged(ConvergenceError):
    """`where` marks the elements that are still moving."""

    def __init__(self, message: str, where: NDArray[np.bool_] | None = None) -> None:
        super().__init__(message)
        self.where = np.zeros(0, dtype=np.bool_) if where is None else where


def increasing_root(
    function: Function, lower: Array, upper: Array, start: Array, tolerance: Array
) -> Array:
    """x with function(x) = 0 in [lower, upper], element by element, to `tolerance` in x.

    `function` returns value and slope; its value must be negative below the root and positive
    above it.  Where it is positive (negative) all over the bracket, the lower (upper) end is
    returned.  Newton's step is taken where it is at most half of the last one, bisection elsewhere.
    Raises NotConverged, which a function that returns no NaN does not cause."""
    x = np.clip(start, lower, upper)
    last = upper - lower
    for _ in range(LIMIT):
        value, slope = function(x)
        below = value < 0.0
        lower, upper = np.where(below, x, lower), np.where(below, upper, x)
        newton = np.clip(x - value / np.maximum(slope, STEEP), lower, upper)
        crawls = np.abs(newton - x) > 0.5 * last
        new = np.where(crawls, 0.5 * (lower + upper), newton)
        last = np.abs(new - x)
        x = new
        if (last <= tolerance).all():
            return x
    moves = ~(last <= tolerance)
    message = f"{moves.sum()} of {moves.size} scalar equations did not converge"
    raise NotConverged(message, moves)
