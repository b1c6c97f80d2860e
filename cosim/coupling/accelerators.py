"""Faster ways to a fixed point x = F(x), as functions of a history that is a value.

With x_k the iterate, y_k = F(x_k) and the residual r_k = y_k - x_k:

    constant   x_k+1 = x_k + w r_k
    Aitken     the same, w_k+1 = -(x_k+1 - x_k) . (r_k+1 - r_k) / |r_k+1 - r_k|^2
               (Irons and Tuck 1969)
    IQN-ILS    x_k+1 = y_k + W c,  c = argmin |V c + r_k|,  columns of V and W the differences of
               r and of y between iterations, the newest first
               (Degroote, Bathe and Vierendeels 2009)

Differences survive the step in which they were made.  A column of V that lies in the span of newer
ones but for a part of `filter` is dropped (QR2: Haelterman et al. 2016), and
there are never more columns than unknowns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cosim.errors import InputError
from cosim.port import Array


@dataclass(frozen=True)
class ConstantRelaxation:
    """The same share `factor` of each residual; 1 is the plain fixed point."""

    factor: float = 1.0


@dataclass(frozen=True)
class Aitken:
    """`first` is the share in the very first iteration; each step goes on with the last one's."""

    first: float = 0.5


@dataclass(frozen=True)
class QuasiNewton:
    """IQN-ILS; `first` is the share of a residual while there are no columns.

    `reuse`: columns of earlier steps stay.  `least`: a difference of residuals no larger is noise
    and makes no column; in the unknowns' unit."""

    first: float = 0.5
    filter: float = 1e-2
    reuse: bool = True
    least: float = 1e-12


Accelerator = ConstantRelaxation | Aitken | QuasiNewton


@dataclass(frozen=True)
class History:
    """What an accelerator remembers of n unknowns; numbers and arrays only."""

    factor: float
    last: Array
    """(2, n) residual r and image y of the iteration before; empty (2, 0) in a step's first."""
    residuals: Array
    """(n, m) columns V, m <= n."""
    images: Array
    """(n, m) columns W."""


def initial_history(accelerator: Accelerator, unknowns: int) -> History:
    """The history before the first step.  Raises InputError for a share that is not positive."""
    factor = (
        accelerator.factor if isinstance(accelerator, ConstantRelaxation) else accelerator.first
    )
    if not factor > 0:
        raise InputError(f"accelerator: expected a positive share of the residual, got {factor}")
    nothing = np.zeros((unknowns, 0))
    return History(factor, np.zeros((2, 0)), nothing, nothing)


def start_step(accelerator: Accelerator, history: History) -> History:
    """The history with which another step begins."""
    kept = replace(history, last=np.zeros((2, 0)))
    if isinstance(accelerator, QuasiNewton) and accelerator.reuse:
        return kept
    return replace(kept, residuals=kept.residuals[:, :0], images=kept.images[:, :0])


def reset_history(accelerator: Accelerator, history: History) -> History:
    """A new history, without the columns that a changed active set (a tendon gone slack, a contact
    opened) has made wrong."""
    return initial_history(accelerator, len(history.residuals))


def accelerate(
    accelerator: Accelerator, history: History, x: Array, image: Array
) -> tuple[Array, History]:
    """The next iterate (n,) after `x` (n,) was mapped to `image` = F(x) (n,), and its history."""
    residual, last = image - x, np.stack([image - x, image])
    match accelerator:
        case QuasiNewton():
            history = _with_column(accelerator, history, last)
            return _least_squares(history, residual, image), replace(history, last=last)
        case Aitken():
            history = replace(history, factor=_aitken(history, last))
    return x + history.factor * residual, replace(history, last=last)


def _aitken(history: History, last: Array) -> float:
    if not history.last.size:
        return history.factor
    change, image = last - history.last
    size = float(change @ change)
    return -float((image - change) @ change) / size if size > 0 else history.factor


def _with_column(accelerator: QuasiNewton, history: History, last: Array) -> History:
    if not history.last.size:
        return history
    change = last - history.last
    if np.abs(change[0]).max() <= accelerator.least:
        return history
    V = np.column_stack([change[0], history.residuals])
    W = np.column_stack([change[1], history.images])
    keep = independent(V, accelerator.filter)
    # The same layout as when read from a file, for the same bits.
    V, W = np.ascontiguousarray(V[:, keep]), np.ascontiguousarray(W[:, keep])
    return replace(history, residuals=V, images=W)


def independent(columns: Array, tolerance: float) -> list[int]:
    """Indices of the columns (n, m) whose part outside the span of the earlier kept ones is at
    least `tolerance` of their length; at most n."""
    keep: list[int] = []
    basis = np.zeros((len(columns), 0))
    for i, column in enumerate(columns.T):
        rest = column - basis @ (basis.T @ column)
        rest -= basis @ (basis.T @ rest)
        length = np.linalg.norm(rest)
        fresh = length > 0 and length >= tolerance * np.linalg.norm(column)
        if fresh and len(keep) < len(columns):
            keep.append(i)
            basis = np.column_stack([basis, rest / length])
    return keep


def _least_squares(history: History, residual: Array, image: Array) -> Array:
    if not history.residuals.shape[1]:
        return image - (1 - history.factor) * residual
    Q, R = np.linalg.qr(history.residuals)
    moved: Array = image - history.images @ np.linalg.solve(R, Q.T @ residual)
    return moved
