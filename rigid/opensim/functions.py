"""OpenSim's functions of one number, and the quartics of MuJoCo that stand for them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cosim.port import Array
from rigid.opensim.xml import OsimTag

DEGREE = 4
"""The degree of the polynomial of MuJoCo's equality of two joints."""
SAMPLES = 201
STRAIGHT = 1e-12
"""How far the knots of a spline may lie from a line, of their range, to be read as one."""


@dataclass(frozen=True)
class Curve:
    """A function of a number: `at` takes arrays.  Of a straight line slope and intercept."""

    at: Callable[[Array], Array]
    line: tuple[float, float] | None = None

    def __call__(self, value: float) -> float:
        return float(self.at(np.array([value]))[0])

    def times(self, factor: float) -> Curve:
        """The function times a factor."""
        line = None if self.line is None else (factor * self.line[0], factor * self.line[1])
        return Curve(lambda x: factor * self.at(x), line)


@dataclass(frozen=True)
class Quartic:
    """c0 + c1 q + ... + c4 q^4, and how far it is off the function over the range of q."""

    coefficients: tuple[float, ...]
    error: float


def straight(slope: float, intercept: float) -> Curve:
    """The straight line."""
    return Curve(lambda x: slope * x + intercept, (slope, intercept))


def quartic(curve: Curve, low: float, high: float) -> Quartic:
    """The quartic nearest to a function from `low` to `high`, by least squares at Chebyshev's
    points, where it is close to the best."""
    if curve.line is not None:
        slope, intercept = curve.line
        return Quartic((intercept, slope, 0.0, 0.0, 0.0), 0.0)
    half, middle = max((high - low) / 2, 1e-9), (low + high) / 2
    x = np.cos(np.pi * (np.arange(SAMPLES) + 0.5) / SAMPLES)
    fit = np.polynomial.Polynomial.fit(x, curve.at(middle + half * x), DEGREE, domain=[-1, 1])
    shifted = fit(np.polynomial.Polynomial([-middle / half, 1 / half]))
    out = np.zeros(DEGREE + 1)
    out[: len(shifted.coef)] = shifted.coef
    at = np.linspace(low, high, 4 * SAMPLES)
    off = np.abs(np.polynomial.polynomial.polyval(at, out) - curve.at(at)).max()
    return Quartic(tuple(map(float, out)), float(off))


def read_function(tag: OsimTag) -> Curve:
    """Read a function.  Raises InputError for a kind that is not known, or of other values."""
    tag.used = True
    if tag.kind == "function" and len(tag.children) == 1 and tag.one("x") is None:
        return read_function(tag.children[0])
    kind = tag.attributes.get("type", tag.kind) if tag.kind == "function" else tag.kind
    if kind == "Constant":
        return straight(0.0, tag.value("value", 0.0))
    if kind == "LinearFunction":
        slope, intercept = tag.values("coefficients", (1.0, 0.0))
        return straight(slope, intercept)
    if kind == "PolynomialFunction":
        given = tag.one("coefficients")
        coefficients = given.numbers() if given else [0.0]
        polynomial = np.polynomial.Polynomial(coefficients[::-1])
        return _as_line(Curve(lambda x: np.asarray(polynomial(x), dtype=float)), coefficients)
    if kind == "MultiplierFunction":
        inner = tag.one("function")
        if inner is None:
            raise tag.fault("expected one function within <function>")
        inner.used = True
        return read_function(inner).times(tag.value("scale", 1.0))
    if kind in SPLINES:
        return _through_knots(tag, SPLINES[kind])
    raise tag.fault(f"a {kind} cannot be imported; known are {', '.join(KNOWN)}")


def _as_line(curve: Curve, coefficients: list[float]) -> Curve:
    if any(coefficients[:-2]):
        return curve
    low = [0.0, 0.0, *coefficients][-2:]
    return straight(low[0], low[1])


def _through_knots(tag: OsimTag, make: Callable[[Array, Array], Callable[[Array], Array]]) -> Curve:
    knots = [tag.one("x"), tag.one("y")]
    x, y = [np.array(k.numbers()) if k else np.zeros(0) for k in knots]
    if len(x) != len(y) or len(x) < 2 or not (np.diff(x) > 0).all():
        raise tag.fault("expected at least two knots, as many in <y> as in <x>, <x> increasing")
    slope = (y[-1] - y[0]) / (x[-1] - x[0])
    off = np.abs(y - y[0] - slope * (x - x[0])).max()
    if off <= STRAIGHT * max(np.ptp(y), np.ptp(x)):
        return straight(float(slope), float(y[0] - slope * x[0]))
    return Curve(make(x, y))


def _simm(x: Array, y: Array) -> Callable[[Array], Array]:
    """The cubic spline of SIMM: its third derivative at an end is that of the cubic through the
    four knots there (Forsythe, Malcolm and Moler 1977); beyond the ends it goes on straight."""
    from scipy.interpolate import CubicHermiteSpline, CubicSpline
    from scipy.linalg import solve_banded

    n, h = len(x), np.diff(x)
    if n < 3:
        return _on_straight(CubicSpline(x, y, bc_type="natural"), x)
    m = np.diff(y) / h
    diagonal, right = np.empty(n), np.zeros(n)
    diagonal[1:-1], right[1:-1] = 2 * (h[:-1] + h[1:]), np.diff(m)
    diagonal[[0, -1]] = -h[0], -h[-1]
    if n > 3:
        first = right[2] / (x[3] - x[1]) - right[1] / (x[2] - x[0])
        last = right[-2] / (x[-1] - x[-3]) - right[-3] / (x[-2] - x[-4])
        right[0], right[-1] = (
            first * h[0] ** 2 / (x[3] - x[0]),
            -last * h[-1] ** 2 / (x[-1] - x[-4]),
        )
    bands = np.array([np.r_[0, h], diagonal, np.r_[h, 0]])
    bend = solve_banded((1, 1), bands, right)
    slopes = np.r_[m - h * (bend[1:] + 2 * bend[:-1]), m[-1] + h[-1] * (bend[-2] + 2 * bend[-1])]
    return _on_straight(CubicHermiteSpline(x, y, slopes), x)


def _on_straight(spline: Callable[..., Array], x: Array) -> Callable[[Array], Array]:
    """A spline that goes on straight beyond its knots."""

    def at(value: Array) -> Array:
        inside = np.clip(value, x[0], x[-1])
        out: Array = spline(inside) + spline(inside, 1) * (value - inside)
        return out

    return at


def _natural(x: Array, y: Array) -> Callable[[Array], Array]:
    from scipy.interpolate import CubicSpline

    return _on_straight(CubicSpline(x, y, bc_type="natural"), x)


def _piecewise(x: Array, y: Array) -> Callable[[Array], Array]:
    from scipy.interpolate import make_interp_spline

    return _on_straight(make_interp_spline(x, y, k=1), x)


def _gcv(x: Array, y: Array) -> Callable[[Array], Array]:
    """OpenSim's GCVSpline without smoothing: a natural quintic."""
    from scipy.interpolate import make_interp_spline

    if len(x) < 6:
        return _natural(x, y)
    ends = [(3, 0.0), (4, 0.0)]
    return _on_straight(make_interp_spline(x, y, k=5, bc_type=(ends, ends)), x)


SPLINES = {
    "SimmSpline": _simm,
    "NaturalCubicSpline": _natural,
    "PiecewiseLinearFunction": _piecewise,
    "GCVSpline": _gcv,
}
KNOWN = ("Constant", "LinearFunction", "PolynomialFunction", "MultiplierFunction", *SPLINES)
