"""The potential of a hood from what it did on held bones, by linear least squares.

Every sample gives the gradient of the potential in angles and tensions (torques and excursions)
and its second derivatives (stiffness, arms, compliance), to which one polynomial is fitted at once,
so that what is measured as a torque and what is measured as an excursion agree.  The slips' forces
are fitted beside it.  Each kind of row is divided by its root mean square over the samples, each
joint's torques by their own, and the second derivatives count CURVES of the first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from cosim.port import Array, InputError
from rigid.reduced_basis import Basis
from rigid.reduced_network import Potential

CURVES = 0.03
"""Chosen, and Order.angle with it, by leaving postures of the fitted samples out in turn."""
NOTHING = 1e-10
"""Of a column's length: a combination of terms that the samples do not tell is left at zero."""
HELD = 0.1
"""rad."""
STILL = 1e-9
"""rad."""
DEFAULT_TOE = 0.03
MEASURED = ("torque", "excursion", "stiffness", "arms", "compliance")
AT_ONCE = 200
"""Samples whose rows are in memory."""


@dataclass(frozen=True)
class Data:
    """s samples of a hood with n joints and m muscles."""

    angle: Array
    """(s, n) rad."""
    tension: Array
    """(s, m) N."""
    torque: Array
    """(s, n) N m."""
    excursion: Array
    """(s, m) m."""
    stiffness: Array
    """(s, n, n) N m/rad."""
    arms: Array
    """(s, n, m) m."""
    compliance: Array
    """(s, m, m) m/N."""
    slip: Array
    """(s, 2) N, NaN of a hood without slips."""


@dataclass(frozen=True)
class Order:
    """How rich the potential is."""

    angle: int = 6
    """Total degree in the joints that the samples move."""
    held: int = 2
    """Degree in the joints that they all leave where they are, whose torques and stiffnesses they
    tell; it counts twice against `angle`, but terms of degree 1 beside it always stay."""
    toe: float | None = 0.03
    """Of the greatest tensions, where that of an exponential spring ends; without it springs are
    straight."""


DEFAULT, SLIP_ORDER = Order(), Order(angle=2, held=0)


def angle_powers(moves: NDArray[np.bool_], order: Order) -> NDArray[np.intp]:
    """(A, n) whole numbers, of the joints (n,) that move or are held."""
    most = [order.angle if move else order.held for move in moves]
    powers = np.array(list(product(*(range(p + 1) for p in most))))
    held = powers[:, ~moves].sum(axis=1)
    left = np.where(held > 0, np.maximum(order.angle - 2 * held + 1, 1), order.angle)
    found: NDArray[np.intp] = powers[(powers[:, moves].sum(axis=1) <= left) & (held <= order.held)]
    return found


def tension_terms(muscles: int, order: Order) -> NDArray[np.intp]:
    """(G, m): none, each muscle alone, and pairs of different ones."""
    one, functions = np.eye(muscles, dtype=int), (1, 2) if order.toe is None else (1, 2, 3)
    alone = [k * row for row in one for k in functions]
    pairs = [one[i] + one[k] for i in range(muscles) for k in range(i)]
    return np.array([np.zeros(muscles, dtype=int), *alone, *pairs])


def reduced(
    data: Data, joints: tuple[str, ...], muscles: tuple[str, ...], order: Order = DEFAULT
) -> Potential:
    """The potential over the box of the samples; joints that all samples hold still get a box of
    HELD to either side.

    Raises InputError where there are fewer numbers than terms."""
    low, high = data.angle.min(axis=0), data.angle.max(axis=0)
    moves = high - low > STILL
    powers, terms = angle_powers(moves, order), tension_terms(len(muscles), order)
    none = np.zeros((len(powers), len(terms)))
    empty = Potential(
        joints,
        muscles,
        np.where(moves, low, low - HELD),
        np.where(moves, high, high + HELD),
        data.tension.max(axis=0),
        powers,
        terms,
        DEFAULT_TOE if order.toe is None else order.toe,
        none,
        slip_powers := angle_powers(moves, SLIP_ORDER),
        np.zeros((2, len(slip_powers), 1 + len(joints))),
    )
    numbers = sum(getattr(data, name).size for name in MEASURED)
    if numbers < none.size:
        raise InputError(
            f"reduction: {numbers} numbers of {len(data.angle)} samples are too few for "
            f"{none.size} terms; take more postures or loads"
        )
    triangle = _triangle(empty, data)
    energy = _least_squares(triangle[:, :-1], triangle[:, -1]).reshape(none.shape)
    found = replace(empty, energy=energy)
    return replace(found, slip=_slips(found, data))


def _triangle(potential: Potential, data: Data) -> Array:
    """(k, A G + 1): rows and what they should make, with the same least squares as all samples'
    rows, some of which are enough to fill a computer's memory."""
    sizes, found = _sizes(data), np.zeros((0, potential.energy.size + 1))
    for start in range(0, len(data.angle), AT_ONCE):
        part = Data(
            **{f.name: getattr(data, f.name)[start : start + AT_ONCE] for f in fields(data)}
        )
        rows = np.column_stack(_rows(*potential.bases(part.angle, part.tension), part, sizes))
        found = np.asarray(np.linalg.qr(np.vstack([found, rows]), mode="r"))
    return found


def _sizes(data: Data) -> list[float]:
    """Root mean square of each kind of row, in their order."""
    away = data.excursion - data.excursion.mean(axis=0)
    rest = [getattr(data, name) for name in MEASURED[2:]]
    return [float(np.sqrt((x**2).mean())) or 1.0 for x in (*data.torque.T, away, *rest)]


def _rows(angle: Basis, tension: Basis, data: Data, sizes: Sequence[float]) -> tuple[Array, Array]:
    """Rows (r, A G) and what they should make (r,), each kind over its size."""
    a, g, n = angle, tension, data.angle.shape[1]
    kinds = [
        *(("sa,sg->sag", a.slope[..., j], g.value, data.torque[:, j], 1.0) for j in range(n)),
        ("sa,sgm->smag", a.value, g.slope, data.excursion, 1.0),
        ("saij,sg->sijag", a.curve, g.value, data.stiffness, CURVES),
        ("sai,sgm->simag", a.slope, g.slope, data.arms, CURVES),
        ("sa,sgmk->smkag", a.value, g.curve, data.compliance, CURVES),
    ]
    rows, wanted = [], []
    for (how, left, right, found, weight), size in zip(kinds, sizes, strict=True):
        made = np.einsum(how, left, right).reshape(found.size, -1)
        rows.append(weight / size * made)
        wanted.append(weight / size * found.ravel())
    return np.vstack(rows), np.concatenate(wanted)


def _least_squares(rows: Array, wanted: Array) -> Array:
    """Over columns of equal length, each held to zero by NOTHING of it."""
    length = np.sqrt((rows**2).sum(axis=0))
    length[length == 0] = 1.0
    count = rows.shape[1]
    whole = np.vstack(
        [np.column_stack([rows / length, wanted]), NOTHING * np.eye(count, count + 1)]
    )
    triangle = np.asarray(np.linalg.qr(whole, mode="r"))
    found: Array = solve_triangular(triangle[:count, :count], triangle[:count, count]) / length
    return found


def _slips(potential: Potential, data: Data) -> Array:
    """(2, B, 1 + n) of the slips, from the torques of the samples; zero for a hood without them."""
    if np.isnan(data.slip).any():
        return np.zeros_like(potential.slip)
    rows = potential.slip_rows(data.angle, data.torque).reshape(len(data.slip), -1)
    found = [_least_squares(rows, data.slip[:, k]) for k in range(2)]
    return np.reshape(found, potential.slip.shape)
