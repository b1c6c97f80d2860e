"""Least squares for the coefficients of a reduced hood.

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

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, fields
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from cosim.errors import InputError
from cosim.port import Array
from rigid.hoods.reduced_basis import Basis, legendre, loadings, to_powers, unscale

if TYPE_CHECKING:
    from rigid.hoods.reduced import ReducedPotential
    from rigid.hoods.reduced_sample import Sample

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


def energy(potential: ReducedPotential, data: Sample, maps: Array | None) -> Array:
    """(A, G) J of a potential's terms; see `rigid.hoods.reduction.reduce_hood`."""
    sizes, tip = _sizes(data), tip_rows(data, maps)
    found = least_squares(lambda: _rows(potential, data, sizes, tip))
    return to_powers(potential.angle_powers).T @ found.reshape(potential.energy.shape)


def slips(potential: ReducedPotential, data: Sample) -> Array:
    """(2, B, 1 + n) of the slips, from the torques of the samples; zero for a hood without them."""
    if np.isnan(data.slip).any():
        return np.zeros_like(potential.slip)
    rows = potential.slip_rows(data.angle, data.torque).reshape(len(data.slip), -1)
    found = [least_squares(partial(_at_once, rows, force)) for force in data.slip.T]
    return np.reshape(found, potential.slip.shape)


def _at_once(rows: Array, wanted: Array) -> Rows:
    yield rows, wanted


def least_squares(parts: Callable[[], Rows]) -> Array:
    """(k,) over columns of equal length.  Raises InputError where the rows tell too little."""
    gram, right = np.zeros((1, 1)), np.zeros(1)
    for rows, wanted in parts():
        gram, right = gram + rows.T @ rows, right + rows.T @ wanted
    length = np.sqrt(np.diag(gram))
    length[length == 0] = 1.0
    gram /= length[:, None] * length
    factor = _cholesky(gram)
    found: Array = cho_solve(factor, right / length) / length
    for _ in range(REPEATED):
        left = sum(rows.T @ (wanted - rows @ found) for rows, wanted in parts())
        found = found + cho_solve(factor, left / length) / length
    return found


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
    """(s, r, n), 1/(N m): TIP times fingertip forces over their size, by joint torques; none
    without maps."""
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
