"""Tension field: the relaxed energy of a sheet too thin to bear compression.

Wrinkles add a positive semidefinite strain P that costs nothing (Pipkin 1986, IMA J Appl Math
36:85; Steigmann 1990, Proc R Soc A 429:141; as a search over P, for any law, Mosler 2008, Comput
Methods Appl Mech Eng 198:697):

    W*(E) = min over P >= 0 of W(E + P)

The sheet is taut where P = 0, slack where its stress is zero, and wrinkled where P and the stress
have one direction each.  W* has kinks in its slope from the one to the other, over which a Newton
iteration stumbles; a barrier, as of an interior-point method (Boyd and Vandenberghe 2004, Convex
Optimization, chapter 11), rounds them off:

    W*(E) = min over P > 0 of W(E + P) - mu log det P,    S(E + P) = mu P^-1

with mu = k d^2 of the law's lesser modulus k at rest and a strain d, the smoothing: where wrinkles
have taken up a strain p, the sheet keeps a stress of k d^2 / p across them, and a taut sheet under
the stress s gives way by k d^2 / s.  That its tangent is never singular, wrinkles also cost r k P:P
/ 2, so that a slack sheet resists with the share r of its modulus, the RESIDUAL.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, is_dataclass, replace
from enum import IntEnum
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from cosim.port import Array, Mask
from fe_solver.materials.linear import Law, Real, Stress, require

FEW_STEPS, MOST_STEPS = 6, 20
"""From the first guess, and for each height of the barrier."""
CONVERGED, ROUGHLY = 1e-6, 0.1
"""The last step in P, over P, at the barrier's own height and on the way there."""
TURNS = 5
TINY = np.finfo(float).tiny
DECADES = 2
"""By which the barrier is lowered at a time."""
CENTRAL = 0.1
"""Strain by which a barrier smooths from which its path begins."""
TO_THE_EDGE = 0.95
"""Share of the step at which P is no longer positive."""
LEAST_SLOPE = 1e-4
HALVINGS = 30
STIFF = 1e-3
"""Share of the tangent's largest entry: the first guess takes no line of the sheet for softer."""
ROUNDING = 1e-2
"""Share of the barrier below which a rise of the energy is a rounding error."""
RESIDUAL = 1e-6
SQUARED = np.array([1.0, 1.0, 0.5])
"""P:P from the squares of P11, P22 and 2 P12."""
SEEN = 100.0
"""Times the strain at which stress and wrinkles are as large: wrinkles that `State` tells of."""


class State(IntEnum):
    """What a point of a sheet without compression is: in how many directions it has wrinkles."""

    TAUT = 0
    WRINKLED = 1
    SLACK = 2


@dataclass(frozen=True)
class TensionField:
    """A law without compression, relaxed with a `smoothing` (a strain).

    Use it for the membrane strain; bending is the base law's.

    >>> import numpy as np
    >>> from fe_solver.materials.linear import Isotropic
    >>> from fe_solver.materials.tension_field import TensionField
    >>> law = TensionField(Isotropic(1e8, 0.4))
    >>> law.state(np.array([[0.01, 0.0, 0.0], [0.01, -0.02, 0.0], [-0.01, -0.01, 0.0]]))
    array([0, 1, 2])
    """

    base: Law
    smoothing: float = 1e-6

    def __post_init__(self) -> None:
        fine = 0 < self.smoothing <= 0.1
        require(self, "smoothing", self.smoothing, fine, "it must be above 0 and at most 0.1")

    def response(self, strain: Array) -> Stress:
        """See `materials.linear.Law.response`."""
        w = self._relaxation(strain)
        C, T = w.base.tangent, w.by_growth
        tangent = C - C @ T @ _solve(w.curvature, np.swapaxes(T, 1, 2) @ C)
        tangent = (tangent + np.swapaxes(tangent, 1, 2)) / 2
        fine = w.solved[:, None]
        shape = np.shape(strain)
        return Stress(
            np.where(w.solved, w.energy, np.inf).reshape(shape[:-1]),
            np.where(fine, w.base.stress, 0.0).reshape(shape),
            np.where(fine[:, None], tangent, 0.0).reshape(*shape, 3),
        )

    def state(self, strain: Array) -> NDArray[np.intp]:
        """The `State` (...,) at strains (..., 3)."""
        p = _strain(self._relaxation(strain).factor) * np.array([1.0, 1.0, 0.5])
        wrinkled = _principal_values(p)[0] > SEEN * self.smoothing
        return wrinkled.sum(axis=1).reshape(np.shape(strain)[:-1])

    def elastic_strain(self, strain: Array) -> Array:
        """The strain (..., 3) of the base law at strains (..., 3): what wrinkles have taken up is
        added to it."""
        wrinkles = _strain(self._relaxation(strain).factor)
        return np.asarray(strain + wrinkles.reshape(np.shape(strain)))

    def shear(self) -> tuple[Real, Real]:
        return self.base.shear()

    def _relaxation(self, strain: Array) -> _Relaxation:
        strain = np.asarray(strain, dtype=float)
        law = _law_at(self.base, np.ones(strain.shape[:-1], dtype=bool))
        flat = strain.reshape(-1, 3)
        rest = law.response(np.zeros_like(flat)).tangent
        modulus = np.minimum(rest[:, 0, 0], rest[:, 1, 1])
        cost = _Cost(modulus * self.smoothing**2, modulus * RESIDUAL)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return _relax(law, flat, cost, self.smoothing)


class _Cost(NamedTuple):
    """What wrinkles cost at m points: - barrier log det P + residual P:P / 2."""

    barrier: Array
    """(m,) J/m3."""
    residual: Array
    """(m,) Pa."""

    def of(self, points: Mask) -> _Cost:
        return _Cost(self.barrier[points], self.residual[points])

    def higher(self, times: float) -> _Cost:
        return _Cost(times * self.barrier, self.residual)


class _Relaxation(NamedTuple):
    """The balance at m points, with the wrinkles' strain P = A A'.  By a growth X of the wrinkles,
    P becomes A (1 + X) A'."""

    factor: Array
    """(m, 2, 2) A."""
    energy: Array
    """(m,) J/m3, the barrier's included."""
    base: Stress
    """The base law at E + P."""
    by_growth: Array
    """(m, 3, 3) derivatives of P, as E11, E22, 2 E12, by X11, X22, X12."""
    curvature: Array
    """(m, 3, 3) Pa, second derivatives of the energy by X11, X22, X12."""
    solved: Mask


def _law_at(law: Law, points: Mask) -> Law:
    """The law of some points (a mask), its parameters that differ by point those of them."""
    return cast(Law, _parameters_at(law, points))


def _parameters_at(part: Any, points: Mask) -> Any:
    values: dict[str, Any] = {}
    for name, value in vars(part).items():
        if is_dataclass(value):
            values[name] = _parameters_at(value, points)
        elif np.ndim(value):
            values[name] = np.broadcast_to(value, points.shape)[points]
    return replace(part, **values) if values else part


def _strain(A: Array) -> Array:
    """The strain A A' (m, 3) as E11, E22, 2 E12."""
    (a, b), (c, d) = np.moveaxis(A, 0, 2)
    return np.stack([a * a + b * b, c * c + d * d, 2 * (a * c + b * d)], axis=1)


def _dyad(p: Array) -> Array:
    """The strain p p' (m, 3) of vectors (m, 2), as `_strain`."""
    p1, p2 = p.T
    return np.stack([p1 * p1, p2 * p2, 2 * p1 * p2], axis=1)


def _by_growth(A: Array) -> Array:
    """The derivatives (m, 3, 3) of the wrinkles' strain by their growth, see `_Relaxation`."""
    (a, b), (c, d) = np.moveaxis(A, 0, 2)
    rows = [
        [a * a, b * b, 2 * a * b],
        [c * c, d * d, 2 * c * d],
        [2 * a * c, 2 * b * d, 2 * (a * d + b * c)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _wrinkle_energy(cost: _Cost, A: Array) -> Array:
    """The energy (m,) J/m3 that wrinkles A A' cost."""
    (a, b), (c, d) = np.moveaxis(A, 0, 2)
    residual = cost.residual / 2 * (np.square(_strain(A)) @ SQUARED)
    return np.asarray(residual - 2 * cost.barrier * np.log(np.abs(a * d - b * c)))


def _principal_values(x: Array) -> tuple[Array, Array]:
    """The principal values (m, 2) of tensors (m, 3) of components 11, 22, 12, and their directions
    (m, 2, 2), as columns."""
    mean, radius = (x[:, 0] + x[:, 1]) / 2, np.hypot((x[:, 0] - x[:, 1]) / 2, x[:, 2])
    angle = np.arctan2(x[:, 2], (x[:, 0] - x[:, 1]) / 2) / 2
    c, s = np.cos(angle), np.sin(angle)
    axes = np.moveaxis(np.array([[c, -s], [s, c]]), 2, 0)
    return np.stack([mean + radius, mean - radius], axis=1), axes


def _axes_guess(law: Law, strain: Array, cost: _Cost, full: Stress) -> Array:
    """The guess A (m, 2, 2) where the lesser principal stress of the base law, with its own
    stiffness, were in balance, and then the greater one with what that changes of it."""
    stress, axes = _principal_values(full.stress)
    c, s = axes[:, 0], axes[:, 1]
    unit = np.stack([c * c, s * s, 2 * s * c], axis=2)
    C = unit @ full.tangent @ np.swapaxes(unit, 1, 2)
    least = STIFF * np.abs(full.tangent).max(axis=(1, 2))
    barrier = cost.barrier
    lesser = _strain_in_balance(stress[:, 1], np.maximum(C[:, 1, 1], least), barrier)
    greater = stress[:, 0] + C[:, 0, 1] * lesser
    sizes = [_strain_in_balance(greater, np.maximum(C[:, 0, 0], least), barrier), lesser]
    return axes * np.sqrt(np.stack(sizes, axis=1))[:, None]


def _strain_in_balance(stress: Array, stiff: Array, barrier: Array) -> Array:
    """The p > 0 (m,) of stress + stiff p = barrier / p."""
    root = np.sqrt(stress * stress + 4 * stiff * barrier)
    pulled = 2 * barrier / (root + np.abs(stress))
    return np.where(stress > 0, pulled, (root - stress) / (2 * stiff))


def _central_guess(law: Law, strain: Array, cost: _Cost, full: Stress) -> Array:
    """The guess A (m, 2, 2) that makes up for every shortening, and for CENTRAL more."""
    size, axes = _principal_values(strain * np.array([1.0, 1.0, 0.5]))
    return axes * np.sqrt(np.maximum(-size, 0.0) + CENTRAL)[:, None]


def _guess_by_turning(law: Law, strain: Array, cost: _Cost, full: Stress) -> Array:
    """The guess A = (p, t) (m, 2, 2) with p of the least W(E + p p') by TURNS Newton steps from the
    axis of the lesser principal stress, and t across it in balance."""
    p = _axes_guess(law, strain, cost, full)[:, :, 1]
    for _ in range(TURNS):
        base = law.response(strain + _dyad(p))
        p = p + _turning_step(p, base)
    size = np.linalg.norm(p, axis=1, keepdims=True)
    t = np.stack([-p[:, 1], p[:, 0]], axis=1) / np.maximum(size, TINY)
    base = law.response(strain + _dyad(p))
    unit = _dyad(t)
    stiff = np.einsum("mi,mij,mj->m", unit, base.tangent, unit)
    stiff = np.maximum(stiff, STIFF * np.abs(base.tangent).max(axis=(1, 2)))
    across = _strain_in_balance(np.einsum("mi,mi->m", unit, base.stress), stiff, cost.barrier)
    return np.stack([p, np.sqrt(across)[:, None] * t], axis=2)


def _turning_step(p: Array, base: Stress) -> Array:
    """Newton's step (m, 2) in p towards the least W(E + p p'), no longer than p."""
    p1, p2 = p.T
    zero = np.zeros_like(p1)
    by_p = 2 * np.moveaxis(np.array([[p1, zero], [zero, p2], [p2, p1]]), 2, 0)
    slope = np.einsum("mij,mi->mj", by_p, base.stress)
    S1, S2, S12 = base.stress.T
    curved = np.swapaxes(by_p, 1, 2) @ base.tangent @ by_p
    H11, H22, H12 = curved[:, 0, 0] + 2 * S1, curved[:, 1, 1] + 2 * S2, curved[:, 0, 1] + 2 * S12
    values, axes = _principal_values(np.stack([H11, H22, H12], axis=1))
    along = np.einsum("mij,mi->mj", axes, slope) / np.maximum(np.abs(values), TINY)
    step = -np.einsum("mij,mj->mi", axes, along)
    longest, size = np.linalg.norm(p, axis=1), np.linalg.norm(step, axis=1)
    return step * np.minimum(1.0, longest / np.maximum(size, TINY))[:, None]


def _relax(law: Law, strain: Array, cost: _Cost, smoothing: float) -> _Relaxation:
    """The least energy over P, each point for itself: from a first guess, where that leads nowhere
    from a better one, and else along the path of ever lower barriers."""
    full = law.response(strain)
    finite, left = np.isfinite(full.energy), np.asarray(np.isfinite(strain).all(axis=1))
    A = np.tile(np.sqrt(smoothing) * np.eye(2), (len(strain), 1, 1))
    for guess in (_axes_guess, _guess_by_turning, _central_guess):
        on = left if guess is _central_guess else left & finite
        if not on.any():
            continue
        points = _law_at(law, on), strain[on], cost.of(on)
        start = guess(*points, Stress(*(x[on] for x in full)))
        path = _path(smoothing) if guess is _central_guess else (1.0,)
        A[on], near = _follow_path(*points, start, path)
        left[on] = ~near
    base, T = law.response(strain + _strain(A)), _by_growth(A)
    energy = base.energy + _wrinkle_energy(cost, A) + 2 * cost.barrier * np.log(smoothing)
    solved = ~left & np.isfinite(energy)
    return _Relaxation(A, energy, base, T, _curvature(T, base, cost), solved)


def _path(smoothing: float) -> tuple[float, ...]:
    """Heights of the barrier, over its own, from a smoothing of CENTRAL down."""
    return (*10.0 ** np.arange(2 * np.log10(CENTRAL / smoothing), 0, -DECADES), 1.0)


def _follow_path(
    law: Law, strain: Array, cost: _Cost, A: Array, path: Sequence[float]
) -> tuple[Array, Mask]:
    """The A (m, 2, 2) of balance at the end of a path of barriers, in times the cost's, and where
    Newton arrived there."""
    A, base = A.copy(), Stress(*map(np.array, law.response(strain + _strain(A))))
    for times in path:
        todo = np.ones(len(A), dtype=bool)
        for _ in range(FEW_STEPS if len(path) == 1 else MOST_STEPS):
            points = _law_at(law, todo), strain[todo], cost.of(todo).higher(times)
            now = A[todo], Stress(*(x[todo] for x in base))
            A[todo], after, near = _newton_step(*points, *now, CONVERGED if times == 1 else ROUGHLY)
            for mine, new in zip(base, after, strict=True):
                mine[todo] = new
            todo[todo] = ~near
            if not todo.any():
                break
    return A, ~todo


def _curvature(T: Array, base: Stress, cost: _Cost) -> Array:
    """The second derivatives (m, 3, 3) of energy and cost by the growth, T as `_by_growth`."""
    stiff = base.tangent + cost.residual[:, None, None] * np.diag(SQUARED)
    barrier = cost.barrier[:, None, None] * np.diag([1.0, 1.0, 2.0])
    return np.asarray(np.swapaxes(T, 1, 2) @ stiff @ T + barrier)


def _solve(matrix: Array, right: Array) -> Array:
    """The solutions (m, 3, k) of symmetric matrices (m, 3, 3), of the like of singular ones too."""
    scale = 1 / np.sqrt(np.diagonal(matrix, axis1=1, axis2=2))[:, :, None]
    even = matrix * scale * np.swapaxes(scale, 1, 2) + np.finfo(float).eps * np.eye(3)
    return np.asarray(scale * np.linalg.solve(even, scale * right))


def _newton_step(
    law: Law, strain: Array, cost: _Cost, A: Array, base: Stress, converged: float
) -> tuple[Array, Stress, Mask]:
    """The A (m, 2, 2) after a step from where the law is `base`, the law there, and whether that
    was short enough for the last."""
    T, mu, level = _by_growth(A), cost.barrier, base.energy + _wrinkle_energy(cost, A)
    stress = base.stress + cost.residual[:, None] * SQUARED * _strain(A)
    slope = np.einsum("mij,mi->mj", T, stress) - mu[:, None] * np.array([1.0, 1.0, 0.0])
    X = -_solve(_curvature(T, base, cost), slope[:, :, None])[:, :, 0]
    along = np.einsum("mi,mi->m", slope, X)
    rising = ~(along < 0)
    X[rising] = -slope[rising] / mu[rising, None]
    along[rising] = np.einsum("mi,mi->m", slope, X)[rising]
    near = np.hypot(np.hypot(X[:, 0], X[:, 1]), np.sqrt(2) * X[:, 2]) <= converged
    least = (X[:, 0] + X[:, 1]) / 2 - np.hypot((X[:, 0] - X[:, 1]) / 2, X[:, 2])
    size = 1 / np.maximum(1.0, -least / TO_THE_EDGE)
    noise = ROUNDING * (mu + np.abs(level) * 1e-13)
    for _ in range(HALVINGS):
        grown = A @ _growth_factor(size[:, None] * X)
        after = law.response(strain + _strain(grown))
        rise = after.energy + _wrinkle_energy(cost, grown) - level
        high = ~near & ~(rise <= LEAST_SLOPE * size * along + noise)
        if not high.any():
            break
        size[high] /= 2
    return grown, after, near


def _growth_factor(X: Array) -> Array:
    """The lower triangular L (m, 2, 2) with L L' = 1 + X, of X (m, 3) as X11, X22, X12."""
    out = np.zeros((len(X), 2, 2))
    out[:, 0, 0] = np.sqrt(1 + X[:, 0])
    out[:, 1, 0] = X[:, 2] / out[:, 0, 0]
    out[:, 1, 1] = np.sqrt(1 + X[:, 1] - out[:, 1, 0] ** 2)
    return out
