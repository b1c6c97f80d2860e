"""The potential of a hood from what it did on held bones, by linear least squares.

Every sample gives the gradient of the potential in angles and tensions (torques and excursions)
and its second derivatives (stiffness, arms, compliance), to which one polynomial is fitted at once,
so that what is measured as a torque and what is measured as an excursion agree.  The slips' forces
are fitted beside it.

Rows are the numbers that the samples measured, each kind over its root mean square and each joint's
torques over their own, second derivatives by CURVES.  Where joint torques cancel at the fingertip
little of them makes much of its force: with a map from torques to that force its components are
rows too, over the force's own size and times TIP.

The columns are products of Legendre polynomials of the angles, which are written in powers at the
end.  So they are independent enough for the normal equations, summed in parts and factored by
Cholesky; repeating the solution with what it leaves of the rows themselves takes out rounding, and
the effect of what holds terms that no sample tells (corrected seminormal equations, Bjorck 1987).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from cosim.errors import InputError
from cosim.port import Array
from rigid.hoods.reduced import ReducedPotential
from rigid.hoods.reduced_basis import Basis, legendre, loadings, to_powers, unscale

HELD = 0.1
"""rad."""
STILL = 1e-9
"""rad."""
DEFAULT_TOE = 0.03
MEASURED = ("torque", "excursion", "stiffness", "arms", "compliance")
CURVES, TIP = 0.1, 4.0
"""Chosen, and with them the greatest Order.angle and ENOUGH, by states that were not fitted."""
LEAST_FORCE = 0.1
"""Share of the median fingertip force: a smaller one counts as if it were as large."""
NOTHING = (1e-14, 1e-12, 1e-10)
"""Shares of a column's square that hold terms that the samples do not determine at zero; the first
with which there is a factor is taken."""
REPEATED = 2
AT_ONCE = 100
"""Samples whose rows are in memory."""
Rows = Iterator[tuple[Array, Array]]
"""Rows (r, k) and what they should make (r,), in parts."""


@dataclass(frozen=True)
class Sample:
    """A hood's equilibrium on held bones, n joints and m muscles: of one state, or of s states with
    s first."""

    angle: Array
    """(n,) rad."""
    tension: Array
    """(m,) N."""
    torque: Array
    """(n,) N m of the hood."""
    excursion: Array
    """(m,) m."""
    stiffness: Array
    """(n, n) N m/rad, derivative of the torques by the angles."""
    arms: Array
    """(n, m) m, of the torques by the tensions."""
    compliance: Array
    """(m, m) m/N, of the excursions by the tensions."""
    slip: Array
    """(2,) N, central and terminal; NaN of a hood without slips."""


def stack(samples: Sequence[Sample]) -> Sample:
    """The states as one sample, states first."""
    return Sample(
        *(np.array([getattr(s, field.name) for s in samples]) for field in fields(Sample))
    )


@dataclass(frozen=True)
class Order:
    """How rich the potential is."""

    angle: int = 9
    """Total degree in the joints that the samples move."""
    held: int = 2
    """Degree in the joints that they all leave where they are, whose torques and stiffnesses they
    tell; it counts twice against `angle`, but terms of degree 1 beside it always stay."""
    toe: float | None = 0.03
    """Share of the greatest tensions where the toe of an exponential spring ends; without it
    springs are straight."""


RICHEST, SLIP_ORDER = Order(), Order(angle=2, held=0)
ENOUGH = 9
"""Numbers to a term: with fewer the potential follows its samples and errs between them."""


def angle_powers(moves: NDArray[np.bool_], order: Order) -> NDArray[np.intp]:
    """The powers (A, n) of the potential's terms, whole numbers, of the joints (n,) that move or
    are held."""
    most = [order.angle if move else order.held for move in moves]
    powers = np.array(list(product(*(range(p + 1) for p in most))))
    held = powers[:, ~moves].sum(axis=1)
    left = np.where(held > 0, np.maximum(order.angle - 2 * held + 1, 1), order.angle)
    kept: NDArray[np.intp] = powers[(powers[:, moves].sum(axis=1) <= left) & (held <= order.held)]
    return kept


def tension_terms(muscles: int, order: Order) -> NDArray[np.intp]:
    """The terms (G, m) in the tensions: none, each muscle alone, and pairs of different ones."""
    one, functions = np.eye(muscles, dtype=int), (1, 2) if order.toe is None else (1, 2, 3)
    alone = [k * row for row in one for k in functions]
    pairs = [one[i] + one[k] for i in range(muscles) for k in range(i)]
    return np.array([np.zeros(muscles, dtype=int), *alone, *pairs])


def richest_order(numbers: int, moves: NDArray[np.bool_], muscles: int) -> Order:
    """The richest order with ENOUGH numbers to a term, of at least degree 1."""
    per_angle = ENOUGH * len(tension_terms(muscles, RICHEST))
    orders = (replace(RICHEST, angle=degree) for degree in range(RICHEST.angle, 1, -1))
    fitting = (o for o in orders if len(angle_powers(moves, o)) * per_angle <= numbers)
    return next(fitting, replace(RICHEST, angle=1))


def reduce_hood(
    data: Sample,
    joints: tuple[str, ...],
    muscles: tuple[str, ...],
    order: Order | None = None,
    maps: Array | None = None,
) -> ReducedPotential:
    """The potential over the box of the samples, without `order` as rich as they bear; joints that
    all samples hold still get a box of HELD to either side.  With `maps` (s, 3, n), N/(N m), from
    joint torques to the force of a fingertip, the fit is to that force too.

    Raises InputError where there are fewer numbers than terms."""
    low, high = data.angle.min(axis=0), data.angle.max(axis=0)
    moves = high - low > STILL
    numbers = sum(getattr(data, name).size for name in MEASURED)
    order = richest_order(numbers, moves, len(muscles)) if order is None else order
    powers, terms = angle_powers(moves, order), tension_terms(len(muscles), order)
    none = np.zeros((len(powers), len(terms)))
    empty = ReducedPotential(
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
    if numbers < none.size:
        raise InputError(
            f"reduction: {numbers} numbers of {len(data.angle)} samples are too few for "
            f"{none.size} terms; take more postures or loads"
        )
    fitted = replace(empty, energy=energy(empty, data, maps))
    return replace(fitted, slip=slips(fitted, data))


def energy(potential: ReducedPotential, data: Sample, maps: Array | None) -> Array:
    """The coefficients (A, G) J of a potential's terms; see `reduce_hood`."""
    sizes, tip = _sizes(data), tip_rows(data, maps)
    coefficients = least_squares(lambda: _rows(potential, data, sizes, tip))
    return to_powers(potential.angle_powers).T @ coefficients.reshape(potential.energy.shape)


def slips(potential: ReducedPotential, data: Sample) -> Array:
    """The coefficients (2, B, 1 + n) of the slips, from the torques of the samples; zero for a hood
    without them."""
    if np.isnan(data.slip).any():
        return np.zeros_like(potential.slip)
    rows = potential.slip_rows(data.angle, data.torque).reshape(len(data.slip), -1)
    coefficients = [least_squares(partial(_at_once, rows, force)) for force in data.slip.T]
    return np.reshape(coefficients, potential.slip.shape)


def _at_once(rows: Array, wanted: Array) -> Rows:
    yield rows, wanted


def least_squares(parts: Callable[[], Rows]) -> Array:
    """The solution (k,) by columns scaled to equal length.  Raises InputError where the rows tell
    too little."""
    gram, right = np.zeros((1, 1)), np.zeros(1)
    for rows, wanted in parts():
        gram, right = gram + rows.T @ rows, right + rows.T @ wanted
    length = np.sqrt(np.diag(gram))
    length[length == 0] = 1.0
    gram /= length[:, None] * length
    factor = _cholesky(gram)
    solution: Array = cho_solve(factor, right / length) / length
    for _ in range(REPEATED):
        left = sum(rows.T @ (wanted - rows @ solution) for rows, wanted in parts())
        solution = solution + cho_solve(factor, left / length) / length
    return solution


def _cholesky(gram: Array) -> tuple[Array, bool]:
    """Cholesky's, of a matrix whose diagonal is one."""
    for nothing in NOTHING:
        gram[np.diag_indices(len(gram))] = 1.0 + nothing
        with suppress(LinAlgError):
            factor: tuple[Array, bool] = cho_factor(gram)
            return factor
    raise InputError(
        f"reduction: the samples do not tell {len(gram)} terms apart; take more postures or loads"
    )


@dataclass(frozen=True)
class _Sizes:
    """Root mean squares over the samples."""

    torque: Array
    excursion: float
    stiffness: float
    arms: float
    compliance: float


def _sizes(data: Sample) -> _Sizes:
    away = data.excursion - data.excursion.mean(axis=0)
    rest = (away, data.stiffness, data.arms, data.compliance)
    torque = np.sqrt((data.torque**2).mean(axis=0))
    return _Sizes(
        np.where(torque > 0, torque, 1.0),
        *(float(np.sqrt((x**2).mean())) or 1.0 for x in rest),
    )


def tip_rows(data: Sample, maps: Array | None) -> Array:
    """The rows (s, r, n), 1/(N m), of the fingertip's force: TIP times fingertip forces over their
    size, by joint torques; none without maps."""
    if maps is None:
        return np.zeros((len(data.angle), 0, data.angle.shape[1]))
    size = np.linalg.norm(np.einsum("sij,sj->si", maps, data.torque), axis=1)
    least = LEAST_FORCE * float(np.median(size)) or 1.0
    out: Array = TIP * maps / np.maximum(size, least)[:, None, None]
    return out


def _rows(potential: ReducedPotential, data: Sample, sizes: _Sizes, tip: Array) -> Rows:
    for start in range(0, len(data.angle), AT_ONCE):
        some = slice(start, start + AT_ONCE)
        part = type(data)(*(getattr(data, f.name)[some] for f in fields(data)))
        made = _bases(potential, part)
        yield _weigh(made, part, sizes, tip[some])


def _bases(potential: ReducedPotential, data: Sample) -> tuple[Basis, Basis]:
    u, powers = potential.scaled_angle(data.angle), potential.angle_powers
    angle = unscale(legendre(powers, u), potential.half)
    load = loadings(potential.tension_terms, data.tension / potential.most, potential.toe)
    return angle, unscale(load, potential.most)


def _weigh(
    made: tuple[Basis, Basis], data: Sample, sizes: _Sizes, tip: Array
) -> tuple[Array, Array]:
    """Rows (r, A G) and what they should make (r,); of symmetric matrices one half, counted
    twice."""
    a, g = made
    torque = np.einsum("san,sg->snag", a.slope, g.value)
    (i, k), (p, q) = np.triu_indices(data.angle.shape[1]), np.triu_indices(data.tension.shape[1])
    bent, yielding = (
        CURVES / sizes.stiffness * _twice(i, k),
        CURVES / sizes.compliance * _twice(p, q),
    )
    kinds = [
        (torque / sizes.torque[:, None, None], data.torque / sizes.torque),
        (np.einsum("sin,snag->siag", tip, torque), np.einsum("sin,sn->si", tip, data.torque)),
        (
            np.einsum("sa,sgm->smag", a.value, g.slope / sizes.excursion),
            data.excursion / sizes.excursion,
        ),
        (
            np.einsum("sar,sg->srag", a.curve[..., i, k] * bent, g.value),
            data.stiffness[:, i, k] * bent,
        ),
        (
            np.einsum("san,sgm->snmag", a.slope, CURVES / sizes.arms * g.slope),
            CURVES / sizes.arms * data.arms,
        ),
        (
            np.einsum("sa,sgr->srag", a.value, g.curve[..., p, q] * yielding),
            data.compliance[:, p, q] * yielding,
        ),
    ]
    columns = a.value.shape[1] * g.value.shape[1]
    rows = [made.reshape(-1, columns) for made, _ in kinds]
    return np.vstack(rows), np.concatenate([wanted.ravel() for _, wanted in kinds])


def _twice(i: np.ndarray, k: np.ndarray) -> Array:
    return np.where(i == k, 1.0, np.sqrt(2.0))
