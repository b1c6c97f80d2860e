"""The wrinkles of least energy (`wrinkles`): Newton's method in their growth, point by point.

From a guess near the sheet's own axes it takes a few steps.  Where that leads nowhere it begins
anew from a better guess, and at last follows the path of ever lower barriers, as an interior-point
method does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from cosim.port import Array, Mask
from fe_solver.materials.kernels import (
    CENTRAL,
    CONVERGED,
    DECADES,
    ENERGY_ROUNDING,
    FEW_STEPS,
    HALVINGS,
    LEAST_SLOPE,
    MOST_STEPS,
    ROUGHLY,
    STIFF,
    TINY,
    TO_THE_EDGE,
    TURNS,
)
from fe_solver.materials.linear import Stress
from fe_solver.materials.wrinkles import (
    WrinkledSheet,
    grow,
    principal_values,
    solve_symmetric,
)

HALF_SHEAR = np.array([1.0, 1.0, 0.5])
"""Makes E11, E22, E12 of E11, E22, 2 E12."""


def find_wrinkles(sheet: WrinkledSheet, smoothing: float) -> tuple[Array, Mask]:
    """The wrinkles A (m, 2, 2) in balance, and where they were found."""
    left = np.asarray(np.isfinite(sheet.strain).all(axis=1))
    flat = sheet.law.response(sheet.strain)
    has_flat = np.isfinite(flat.energy)
    A = np.tile(np.sqrt(smoothing) * np.eye(2), (len(left), 1, 1))

    def search(points: Mask, guess: Callable[..., Array], path: Sequence[float], most: int) -> None:
        if not points.any():
            return
        some = sheet.at(points)
        start = guess(some, Stress(*(x[points] for x in flat)))
        A[points], arrived = _follow_path(some, start, path, most)
        left[points] = ~arrived

    search(left & has_flat, _guess_by_axes, (1.0,), FEW_STEPS)
    search(left & has_flat, _guess_by_turning, (1.0,), FEW_STEPS)
    search(left, _guess_inside, _barrier_path(smoothing), MOST_STEPS)
    return A, ~left


def _guess_by_axes(sheet: WrinkledSheet, flat: Stress) -> Array:
    """The guess A where the lesser principal stress of the flat sheet, with its own stiffness, were
    in balance, and then the greater one with what that changes of it."""
    stress, axes = principal_values(flat.stress)
    c, s = axes[:, 0], axes[:, 1]
    unit = np.stack([c * c, s * s, 2 * s * c], axis=2)
    C = unit @ flat.tangent @ np.swapaxes(unit, 1, 2)
    barrier, least = sheet.cost.barrier, _least_stiffness(flat)
    lesser = _strain_in_balance(stress[:, 1], np.maximum(C[:, 1, 1], least), barrier)
    greater = stress[:, 0] + C[:, 0, 1] * lesser
    sizes = [_strain_in_balance(greater, np.maximum(C[:, 0, 0], least), barrier), lesser]
    return axes * np.sqrt(np.stack(sizes, axis=1))[:, None]


def _guess_by_turning(sheet: WrinkledSheet, flat: Stress) -> Array:
    """The guess A = (p, t) with p of the least W(E + p p') by TURNS Newton steps from the axis of
    the lesser principal stress, and t across it in balance."""
    p = _guess_by_axes(sheet, flat)[:, :, 1]
    base = sheet.law.response(sheet.strain + _dyad(p))
    for _ in range(TURNS):
        p = p + _turning_step(p, base)
        base = sheet.law.response(sheet.strain + _dyad(p))
    size = np.linalg.norm(p, axis=1, keepdims=True)
    t = np.stack([-p[:, 1], p[:, 0]], axis=1) / np.maximum(size, TINY)
    unit = _dyad(t)
    stiff = np.einsum("mi,mij,mj->m", unit, base.tangent, unit)
    stiff = np.maximum(stiff, _least_stiffness(base))
    stress = np.einsum("mi,mi->m", unit, base.stress)
    across = _strain_in_balance(stress, stiff, sheet.cost.barrier)
    return np.stack([p, np.sqrt(across)[:, None] * t], axis=2)


def _guess_inside(sheet: WrinkledSheet, flat: Stress) -> Array:
    """The guess A that makes up for every shortening, and for CENTRAL more."""
    size, axes = principal_values(sheet.strain * HALF_SHEAR)
    return axes * np.sqrt(np.maximum(-size, 0.0) + CENTRAL)[:, None]


def _least_stiffness(base: Stress) -> Array:
    """The stiffness (m,) Pa below which a guess takes no line of the sheet."""
    return np.asarray(STIFF * np.abs(base.tangent).max(axis=(1, 2)))


def _strain_in_balance(stress: Array, stiff: Array, barrier: Array) -> Array:
    """The p > 0 (m,) of stress + stiff p = barrier / p."""
    root = np.sqrt(stress * stress + 4 * stiff * barrier)
    pulled = 2 * barrier / (root + np.abs(stress))
    return np.where(stress > 0, pulled, (root - stress) / (2 * stiff))


def _dyad(p: Array) -> Array:
    """The strain p p' (m, 3) of vectors (m, 2), as E11, E22, 2 E12."""
    p1, p2 = p.T
    return np.stack([p1 * p1, p2 * p2, 2 * p1 * p2], axis=1)


def _turning_step(p: Array, base: Stress) -> Array:
    """Newton's step (m, 2) in p towards the least W(E + p p'), no longer than p."""
    p1, p2 = p.T
    zero = np.zeros_like(p1)
    by_p = 2 * np.moveaxis(np.array([[p1, zero], [zero, p2], [p2, p1]]), 2, 0)
    slope = np.einsum("mij,mi->mj", by_p, base.stress)
    S1, S2, S12 = base.stress.T
    curved = np.swapaxes(by_p, 1, 2) @ base.tangent @ by_p
    H11, H22, H12 = curved[:, 0, 0] + 2 * S1, curved[:, 1, 1] + 2 * S2, curved[:, 0, 1] + 2 * S12
    values, axes = principal_values(np.stack([H11, H22, H12], axis=1))
    along = np.einsum("mij,mi->mj", axes, slope) / np.maximum(np.abs(values), TINY)
    step = -np.einsum("mij,mj->mi", axes, along)
    longest, size = np.linalg.norm(p, axis=1), np.linalg.norm(step, axis=1)
    return step * np.minimum(1.0, longest / np.maximum(size, TINY))[:, None]


def _barrier_path(smoothing: float) -> tuple[float, ...]:
    """Heights of the barrier, over its own, from a smoothing of CENTRAL down."""
    return (*10.0 ** np.arange(2 * np.log10(CENTRAL / smoothing), 0, -DECADES), 1.0)


def _follow_path(
    sheet: WrinkledSheet, A: Array, path: Sequence[float], most: int
) -> tuple[Array, Mask]:
    """The wrinkles A (m, 2, 2) of balance at the end of a path of barriers, with at most so many
    steps at each, and where Newton arrived there."""
    A, base = A.copy(), Stress(*map(np.array, sheet.base(A)))
    for times in path:
        todo = np.ones(len(A), dtype=bool)
        for _ in range(most):
            some, now = sheet.at(todo).with_barrier(times), Stress(*(x[todo] for x in base))
            step = _newton_step(some, A[todo], now)
            size = np.hypot(np.hypot(step[:, 0], step[:, 1]), np.sqrt(2) * step[:, 2])
            near = size <= (CONVERGED if times == 1 else ROUGHLY)
            A[todo], after = _search_along(some, A[todo], now, step, near)
            for mine, new in zip(base, after, strict=True):
                mine[todo] = new
            todo[todo] = ~near
            if not todo.any():
                break
    return A, ~todo


def _newton_step(sheet: WrinkledSheet, A: Array, base: Stress) -> Array:
    """Newton's step X (m, 3) in the growth, or one straight down where that would rise."""
    slope = sheet.slope(A, base)
    X = -solve_symmetric(sheet.curvature(A, base), slope[:, :, None])[:, :, 0]
    rising = ~(np.einsum("mi,mi->m", slope, X) < 0)
    X[rising] = -slope[rising] / sheet.cost.barrier[rising, None]
    return X


def _search_along(
    sheet: WrinkledSheet, A: Array, base: Stress, X: Array, near: Mask
) -> tuple[Array, Stress]:
    """The wrinkles (m, 2, 2) after as much of a step X (m, 3) as keeps them positive and, except
    where the last step is `near`, lowers the energy; and the law there."""
    level, barrier = sheet.energy(A, base), sheet.cost.barrier
    along = np.einsum("mi,mi->m", sheet.slope(A, base), X)
    least = principal_values(X)[0][:, 1]
    share = 1 / np.maximum(1.0, -least / TO_THE_EDGE)
    noise = ENERGY_ROUNDING * (barrier + np.abs(level) * 1e-13)
    for _ in range(HALVINGS):
        grown = grow(A, share[:, None] * X)
        after = sheet.base(grown)
        rise = sheet.energy(grown, after) - level
        high = ~near & ~(rise <= LEAST_SLOPE * share * along + noise)
        if not high.any():
            break
        share[high] /= 2
    return grown, after
