"""Hyperelastic sheets: static condensation of the volume, and the compressible neo-Hookean law.

A sheet has C13 = C23 = 0.  With the plane's trace I = C11 + C22, its determinant D, the squared
stretches f of the fibres, and the logarithm of the volume ratio j = ln J as unknown in place of
C33 = exp(2 j) / D, every law here is an energy W(I, D, f, j) that is convex in j.  S33 = 0 is
dW/dj = 0, one scalar equation a point; an incompressible sheet has j = 0 and no equation.  The
condensed tangent is W_pq - W_pj W_qj / W_jj; with j as unknown nothing cancels as the bulk modulus
grows.  (Static condensation: de Borst 1991, Eng Comput 8:99; FEBio's laws: FEBio feature manual.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from fe_solver.materials.linear import (
    Array,
    Law,
    Mask,
    Real,
    Stress,
    require_poisson,
    require_positive,
    symmetric,
)

LONGEST = 1.0
"""Longest step in ln J: a factor of e in volume."""
CONVERGED = 1e-12
"""The last step in ln J; those before it double the digits."""
MOST_STEPS = 80
"""Bracketed: bisection alone would reach 1e-12 in some 45."""


class Invariants(NamedTuple):
    """Invariants of the plane's right Cauchy-Green tensor, each (...,)."""

    trace: Array
    det: Array
    fibres: tuple[Array, ...]
    """Squared stretch along each fibre family."""


class Expansion(NamedTuple):
    """An energy to second order in p = (trace, det, *fibres) and j = ln J."""

    energy: Array
    slope: Sequence[Real]
    curvature: dict[tuple[int, int], Real]
    """Upper triangle of W_pq; absent entries are zero."""
    mixed: Sequence[Real]
    """W_pj."""
    stiffness: Real
    """W_jj; an incompressible sheet's, which nobody asks for, may be anything."""


@runtime_checkable
class Potential(Law, Protocol):
    """A hyperelastic law as an energy of the plane's invariants and ln J."""

    def fibres(self) -> tuple[tuple[Real, Real, Real], ...]:
        """cos^2, sin^2 and sin cos of each fibre family's angle from axis 1."""

    def incompressible(self) -> bool:
        """Whether ln J = 0 by constraint."""

    def start(self, p: Invariants) -> Array:
        """The value (...,) of ln J where the search for it begins."""

    def volumetric(self, p: Invariants, j: Array) -> tuple[Array, Array]:
        """W_j and W_jj."""

    def expansion(self, p: Invariants, j: Real) -> Expansion:
        """The energy and its derivatives."""


class _Plane(NamedTuple):
    """C and its invariants at points where it is positive definite; elsewhere C = 1."""

    C: tuple[Array, Array, Array]
    p: Invariants
    admissible: Mask


def _plane(law: Potential, strain: Array) -> _Plane:
    C11, C22, C12 = 1 + 2 * strain[..., 0], 1 + 2 * strain[..., 1], strain[..., 2]
    det = C11 * C22 - C12 * C12
    admissible = (C11 > 0) & (det > 0) & np.isfinite(det)
    if not admissible.all():
        C11, C22, det = (np.where(admissible, x, 1.0) for x in (C11, C22, det))
        C12 = np.where(admissible, C12, 0.0)
    fibres = tuple(cc * C11 + ss * C22 + 2 * sc * C12 for cc, ss, sc in law.fibres())
    return _Plane((C11, C22, C12), Invariants(C11 + C22, det, fibres), admissible)


def _log_volume(law: Potential, p: Invariants) -> tuple[Real, Mask]:
    """ln J at which S33 = 0, and where it was found: Newton, kept in a bracket by bisection."""
    if law.incompressible():
        return 0.0, np.ones(p.det.shape, dtype=bool)
    j = law.start(p)
    low, high = np.full(j.shape, -np.inf), np.full(j.shape, np.inf)
    done = np.zeros(j.shape, dtype=bool)
    for _ in range(MOST_STEPS):
        slope, stiffness = law.volumetric(p, j)
        low, high = np.where(slope < 0, j, low), np.where(slope > 0, j, high)
        step = np.clip(-slope / stiffness, -LONGEST, LONGEST)
        near = np.abs(step) <= CONVERGED
        new = j + step
        outside = ~near & ((new <= low) | (new >= high))
        if outside.any():
            new = np.where(outside, (low + high) / 2, new)
        j = np.where(done, j, new)
        done |= near
        if done.all():
            break
    return j, done & np.isfinite(j)


def _dot(a: Sequence[Real], b: Sequence[Real]) -> Real:
    """Sum of products, without those that are zero for every point."""
    products = (x * y for x, y in zip(a, b, strict=True) if not (_none(x) or _none(y)))
    return sum(products, 0.0)


def _none(x: Real) -> bool:
    return isinstance(x, float) and x == 0.0


def _curvature(x: Expansion, condensed: bool) -> list[list[Real]]:
    """W_pq with ln J eliminated."""
    n = len(x.slope)
    H: list[list[Real]] = [[0.0] * n for _ in range(n)]
    for p in range(n):
        for q in range(p, n):
            H[p][q] = x.curvature.get((p, q), 0.0)
            if condensed:
                H[p][q] = H[p][q] - x.mixed[p] * (x.mixed[q] / x.stiffness)
            H[q][p] = H[p][q]
    return H


def _by_strain(law: Potential, plane: _Plane, x: Expansion, shape: tuple[int, ...]) -> Stress:
    """Chain rule from the invariants to (E11, E22, 2 E12)."""
    C11, C22, C12 = plane.C
    fibres = [(2 * cc, 2 * ss, 2 * sc) for cc, ss, sc in law.fibres()]
    gradients: list[tuple[Real, Real, Real]] = [(2.0, 2.0, 0.0), (2 * C22, 2 * C11, -2 * C12)]
    columns = list(zip(*gradients, *fibres, strict=True))
    H = _curvature(x, not law.incompressible())
    stress = np.empty((*shape, 3))
    entries: dict[tuple[int, int], Real] = {}
    for i in range(3):
        stress[..., i] = _dot(x.slope, columns[i])
        row = [_dot(h, columns[i]) for h in H]
        for k in range(i, 3):
            entries[i, k] = _dot(row, columns[k])
    entries[0, 1] = entries[0, 1] + 4 * x.slope[1]
    entries[2, 2] = entries[2, 2] - 2 * x.slope[1]
    return Stress(np.broadcast_to(x.energy, shape), stress, symmetric(entries, shape))


def response(law: Potential, strain: Array) -> Stress:
    """Stress and tangent of a hyperelastic sheet, S33 = 0; see `materials.linear.Law.response`."""
    strain = np.asarray(strain, dtype=float)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        plane = _plane(law, strain)
        j, solved = _log_volume(law, plane.p)
        out = _by_strain(law, plane, law.expansion(plane.p, j), strain.shape[:-1])
        fine = plane.admissible & solved
        if fine.all() and np.isfinite(sum(map(np.sum, out))):
            return out
        fine &= np.isfinite(out.energy + out.stress.sum(-1) + out.tangent.sum((-2, -1)))
    return Stress(
        np.where(fine, out.energy, np.inf),
        np.where(fine[..., None], out.stress, 0.0),
        np.where(fine[..., None, None], out.tangent, 0.0),
    )


def volume_ratio(law: Potential, strain: Array) -> Array:
    """The volume ratio J (...,) of the sheet at the strain (..., 3); NaN where the law has no
    answer.  The thickness stretches by J / sqrt(det C) with C the plane's."""
    strain = np.asarray(strain, dtype=float)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        plane = _plane(law, strain)
        j, solved = _log_volume(law, plane.p)
        return np.where(plane.admissible & solved, np.exp(j), np.nan)


@dataclass(frozen=True)
class NeoHookean:
    """The compressible law W = mu/2 (I1 - 3) - mu ln J + lambda/2 (ln J)^2 (FEBio feature manual,
    `neo-Hookean`; Bonet and Wood 1997), of Young's modulus E (Pa) and Poisson's ratio nu at rest.

    With nu < 0 a crushed sheet (nu = -0.3: to a quarter of its area, -0.9: to 0.6) has no thickness
    at which S33 = 0; its energy is then inf.

    Raises InputError for a modulus that is not positive and a ratio outside of -1 to 0.5.

    >>> import numpy as np
    >>> from fe_solver.materials.hyperelastic import NeoHookean
    >>> strain = np.array([[1e-6, 0.0, 0.0], [0.5, 0.0, 0.0]])  # E11, E22, 2 E12
    >>> secant = NeoHookean(1e6, 0.3).response(strain).stress[:, 0] / strain[:, 0]
    >>> (secant / 1e6).round(3)  # MPa: it softens
    array([1.099, 0.491])
    """

    E: Real
    nu: Real

    def __post_init__(self) -> None:
        require_positive(self, E=self.E)
        require_poisson(self, self.nu)

    def lame(self) -> tuple[Real, Real]:
        """lambda and mu, Pa."""
        mu = self.E / (2 * (1 + self.nu))
        return 2 * mu * self.nu / (1 - 2 * self.nu), mu

    def response(self, strain: Array) -> Stress:
        """See `materials.linear.Law.response`."""
        return response(self, strain)

    def shear(self) -> tuple[Real, Real]:
        mu = self.lame()[1]
        return mu, mu

    def fibres(self) -> tuple[tuple[Real, Real, Real], ...]:
        """Components (cos^2, sin^2, sin cos) of each fibre family's direction, from axis 1."""
        return ()

    def incompressible(self) -> bool:
        """Whether the law admits no change of volume."""
        return False

    def start(self, p: Invariants) -> Array:
        """C33 = 1, from where Newton's iterates pass the solution at most once."""
        return np.log(p.det) / 2

    def volumetric(self, p: Invariants, j: Array) -> tuple[Array, Array]:
        lam, mu = self.lame()
        C33 = np.exp(2 * j) / p.det
        return mu * (C33 - 1) + lam * j, 2 * mu * C33 + lam

    def expansion(self, p: Invariants, j: Real) -> Expansion:
        lam, mu = self.lame()
        C33 = np.exp(2 * j) / p.det
        by_det = -mu * C33 / (2 * p.det)
        return Expansion(
            energy=mu / 2 * (p.trace + C33 - 3) - mu * j + lam / 2 * np.square(j),
            slope=(mu / 2, by_det),
            curvature={(1, 1): -2 * by_det / p.det},
            mixed=(0.0, 2 * by_det),
            stiffness=2 * mu * C33 + lam,
        )
