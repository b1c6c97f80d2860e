"""FEBio's laws with all six strains, for elements whose thickness is free (FEBio user manual,
Materials; Weiss, Maker and Govindjee 1996, Comput Methods Appl Mech Eng 135:107; Gasser, Ogden and
Holzapfel 2006, J R Soc Interface 3:15).

Components are in the order of `PAIRS`; strains are Green-Lagrange with engineering shears, stresses
second Piola-Kirchhoff, axis 1 along the fibre, axis 3 through the thickness.

The hyperelastic laws are energies U(ln J) + W(I1~, I2~, I4~, ...) of the deviatoric invariants

    I1~ = J^(-2/3) tr C,    I2~ = J^(-4/3) (tr(C)^2 - tr(C^2)) / 2,    I4~ = J^(-2/3) a.C.a

so that S = 2 dW/dC and its derivative 4 d2W/dC2 follow by the chain rule (`_isochoric`).  A second
fibre family adds its energy, of its own I4~, to that of the first law (`crossed_fibres`).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from cosim.errors import InputError
from cosim.port import Array
from fe_solver.materials.crossed_fibres import CrossedFibres
from fe_solver.materials.fibres import (
    DispersedFamily,
    ExponentialToe,
    Family,
    HolzapfelGasserOgden,
    TransIsoMooneyRivlin,
)
from fe_solver.materials.hyperelastic import NeoHookean
from fe_solver.materials.linear import Isotropic, Law, Orthotropic, Real

Fibrous = TransIsoMooneyRivlin | HolzapfelGasserOgden

PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
FIRST, SECOND = np.array(PAIRS).T
SHEAR = FIRST != SECOND
ONE = np.array([1.0, 1, 1, 0, 0, 0])
IDENTITY = np.diag(np.where(SHEAR, 0.5, 1.0))
"""The symmetric identity of fourth order."""


def law_obstacle(law: Law) -> str | None:
    """Why `solid_stress` does not know the law, in words; None where it does."""
    varies = "varies within the part" if _varies(law) else None
    match law:
        case CrossedFibres():
            within = "varies within the part" if _varies(law.second) else law_obstacle(law.base)
            return varies or within
        case TransIsoMooneyRivlin() | HolzapfelGasserOgden():
            return varies or (
                None if np.isfinite(law.k) else "is incompressible: give it a finite k"
            )
        case Orthotropic():
            if varies:
                return varies
            stable = np.linalg.eigvalsh(_orthotropic_compliance(law)).min() > 0
            return None if stable else "is not positive definite with E3, v23 and v31"
        case Isotropic() | NeoHookean():
            return varies
    return "is not known with all six strains"


def _varies(law: object) -> bool:
    """Whether a parameter is an array of several numbers."""
    return any(np.size(value) != 1 for value in vars(law).values())


def solid_stress(law: Law, strain: Array) -> tuple[Array, Array]:
    """Stress (..., 6), Pa, and its derivative (..., 6, 6) at strains (..., 6); not finite where the
    law has no answer.

    Raises InputError for a law that is not known."""
    reason = law_obstacle(law)
    if reason is not None:
        raise InputError(f"{type(law).__name__}: {reason}")
    match law:
        case Isotropic() | Orthotropic():
            stiff = _linear_stiffness(law)
            return strain @ stiff, np.broadcast_to(stiff, (*strain.shape, 6))
        case NeoHookean():
            return _neo_hookean(law, _Strained(_right_cauchy_green(strain)))
        case TransIsoMooneyRivlin() | HolzapfelGasserOgden() | CrossedFibres():
            return _sum_terms(_terms(law, _Strained(_right_cauchy_green(strain))))
    raise AssertionError(law)  # that law_obstacle knows


def in_situ_strain(stretch: float) -> tuple[Array, Array]:
    """The factors p (6,) and the strain E0 (6,) of a sheet whose fibres are stretched in situ.

    With F_p = diag(g), g = (s, s^-1/2, s^-1/2), the law answers to C_e = F_p C F_p, which is
    E_e = p E + E0 with p_ij = g_i g_j and E0 = (F_p^2 - 1)/2.  F_p keeps the volume, so that
    S = F_p S_e F_p = p S_e and dS/dE = p p^T dS_e/dE_e."""
    g = stretch ** np.array([1.0, -0.5, -0.5])
    factors = g[FIRST] * g[SECOND]
    return factors, (factors - 1) / 2 * ONE


def normal_modulus(law: Law, stretch: float = 1.0) -> float:
    """The modulus (Pa) of a pull through the thickness of the sheet as laid out with fibres
    stretched in situ, its sides free: 1 / the compliance.

    Raises InputError for a law that is not known."""
    factors, strain = in_situ_strain(stretch)
    stiff = _outer(factors, factors) * solid_stress(law, strain)[1]
    return float(1 / np.linalg.inv(stiff)[2, 2])


def _linear_stiffness(law: Isotropic | Orthotropic) -> Array:
    if isinstance(law, Orthotropic):
        return np.asarray(np.linalg.inv(_orthotropic_compliance(law)))
    mu = float(law.E) / (2 * (1 + float(law.nu)))
    stiff = 2 * mu * float(law.nu) / (1 - 2 * float(law.nu)) * np.outer(ONE, ONE)
    return np.asarray(stiff + 2 * mu * IDENTITY)


def _orthotropic_compliance(law: Orthotropic) -> Array:
    """Compliance (6, 6) 1/Pa, engineering shears (FEBio user manual, orthotropic elastic)."""
    E1, E2, nu12, G12, G13, G23 = (
        float(v) for v in (law.E1, law.E2, law.nu12, law.G12, law.G13, law.G23)
    )
    E3 = E2 if law.E3 is None else float(law.E3)
    out = np.diag([1 / E1, 1 / E2, 1 / E3, 1 / G12, 1 / G23, 1 / G13])
    contraction = (-nu12 / E1, -float(law.nu23) / E2, -float(law.nu31) / E3)
    for (i, j), value in zip(((0, 1), (1, 2), (2, 0)), contraction, strict=True):
        out[i, j] = out[j, i] = value
    return out


class _Strained:
    """C (..., 3, 3) with its components, its inverse's, ln J, and what they are differentiated
    with."""

    def __init__(self, C: Array) -> None:
        inverse = np.asarray(np.linalg.inv(C), dtype=float)
        self.c: Array = C[..., FIRST, SECOND]
        self.ci: Array = inverse[..., FIRST, SECOND]
        self.log = np.log(np.linalg.det(C)) / 2
        self.both = _outer(self.ci, self.ci)
        self.turn = _pair(inverse)
        """(..., 6, 6) minus the derivative of the inverse by C."""

    @cached_property
    def first(self) -> tuple[Array, Array, Array]:
        """I1~ and its derivatives."""
        return _isochoric(self, 1, self.c @ ONE, ONE)


def _right_cauchy_green(strain: Array) -> Array:
    C = np.zeros((*strain.shape[:-1], 3, 3))
    C[..., FIRST, SECOND] = C[..., SECOND, FIRST] = strain * np.where(SHEAR, 1.0, 2.0)
    return C + np.eye(3)


def _volumetric(x: _Strained, slope: Array, curvature: Array | float) -> tuple[Array, Array]:
    """First and second derivative by C of U(ln J), from dU/d(ln J) and its derivative."""
    first = slope[..., None] / 2 * x.ci
    curved = np.asarray(curvature)[..., None, None] / 4 * x.both
    return first, curved - slope[..., None, None] / 2 * x.turn


def _isochoric(
    x: _Strained, degree: int, value: Array, slope: Array, curvature: Array | None = None
) -> tuple[Array, Array, Array]:
    """J^(-2 degree / 3) g with its first and second derivative by C, for g homogeneous of that
    degree: its value (...,), slope (..., 6) and curvature (..., 6, 6)."""
    m = degree / 3
    scale = np.exp(-2 * m * x.log)
    slope = np.asarray(np.broadcast_to(slope, x.ci.shape))
    mixed = _outer(slope, x.ci)
    mixed = mixed + np.swapaxes(mixed, -1, -2)
    second = value[..., None, None] * (m * m * x.both + m * x.turn) - m * mixed
    if curvature is not None:
        second = second + curvature
    first = slope - m * value[..., None] * x.ci
    return scale * value, scale[..., None] * first, scale[..., None, None] * second


def _second(x: _Strained) -> tuple[Array, Array, Array]:
    """I2~ and its derivatives."""
    trace = x.c @ ONE
    squares = x.c**2 @ np.where(SHEAR, 2.0, 1.0)
    slope = trace[..., None] * ONE - x.c
    return _isochoric(x, 2, (trace**2 - squares) / 2, slope, np.outer(ONE, ONE) - IDENTITY)


def _along(x: _Strained, angle: Real) -> tuple[Array, Array, Array]:
    """I4~ of fibres at an angle (rad) from axis 1 in the sheet, and its derivatives."""
    angle = np.asarray(angle).item()
    cos, sin = np.cos(angle), np.sin(angle)
    direction = np.array([cos * cos, sin * sin, 0, cos * sin, 0, 0])
    return _isochoric(x, 1, x.c @ (direction * np.where(SHEAR, 2.0, 1.0)), direction)


def _sum_terms(terms: Iterator[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Stress and its derivative from terms' derivatives by C."""
    first, second = (sum(t) for t in zip(*terms, strict=True))
    return np.asarray(2 * first), np.asarray(4 * second)


def _neo_hookean(law: NeoHookean, x: _Strained) -> tuple[Array, Array]:
    """W = mu/2 (I1 - 3) - mu ln J + lambda/2 (ln J)^2."""
    lam, mu = law.lame()
    first, second = _volumetric(x, lam * x.log - mu, lam)
    return 2 * first + mu * ONE, 4 * second


def _terms(law: Fibrous | CrossedFibres, x: _Strained) -> Iterator[tuple[Array, Array]]:
    """First and second derivatives by C of the law's energies."""
    match law:
        case CrossedFibres():
            yield from _terms(law.base, x)
            yield _family(law.second, x, law.angle)
        case TransIsoMooneyRivlin():
            yield from _mooney_rivlin(law, x)
        case HolzapfelGasserOgden():
            yield from _gasser(law, x)


def _mooney_rivlin(law: TransIsoMooneyRivlin, x: _Strained) -> Iterator[tuple[Array, Array]]:
    """W = c1 (I1~ - 3) + c2 (I2~ - 3) + F(sqrt I4~) + k/2 (ln J)^2."""
    yield _volumetric(x, law.k * x.log, law.k)
    _, d1, h1 = x.first
    yield law.c1 * d1, law.c1 * h1
    if np.any(law.c2):
        _, d2, h2 = _second(x)
        yield law.c2 * d2, law.c2 * h2
    yield _exponential(law, x, 0.0)


def _gasser(law: HolzapfelGasserOgden, x: _Strained) -> Iterator[tuple[Array, Array]]:
    """W = c/2 (I1~ - 3) + k/2 ((J^2 - 1)/2 - ln J) and two families of `_dispersed_terms`."""
    J2 = np.exp(2 * x.log)
    yield _volumetric(x, law.k / 2 * (J2 - 1), law.k * J2)
    _, d1, h1 = x.first
    yield law.c / 2 * d1, law.c / 2 * h1
    family = DispersedFamily(law.k1, law.k2, law.kappa)
    for sign in (1, -1):
        yield _dispersed_terms(family, x, sign * law.gamma)


def _family(law: Family, x: _Strained, angle: Real) -> tuple[Array, Array]:
    """One fibre family at an angle (rad) from axis 1."""
    if isinstance(law, DispersedFamily):
        return _dispersed_terms(law, x, angle)
    return _exponential(law, x, angle)


def _exponential(law: ExponentialToe, x: _Strained, angle: Real) -> tuple[Array, Array]:
    """W = F(sqrt I4~)."""
    i4, d4, h4 = _along(x, angle)
    tension, rate = law.tension(np.sqrt(i4))
    return _of_invariant(tension / (2 * i4), (rate - 2 * tension) / (4 * i4**2), d4, h4)


def _dispersed_terms(law: DispersedFamily, x: _Strained, angle: Real) -> tuple[Array, Array]:
    """W = k1 / (2 k2) (exp(k2 <E>^2) - 1), E = kappa (I1~ - 3) + (1 - 3 kappa) (I4~ - 1)."""
    kappa, along = law.kappa, 1 - 3 * law.kappa
    (i1, d1, h1), (i4, d4, h4) = x.first, _along(x, angle)
    strain = kappa * (i1 - 3) + along * (i4 - 1)
    taut = np.maximum(strain, 0)
    stiff = law.k1 * np.exp(law.k2 * taut**2)
    curvature = stiff * (1 + 2 * law.k2 * taut**2) * (strain > 0)
    slope = kappa * d1 + along * d4
    return _of_invariant(stiff * taut, curvature, slope, kappa * h1 + along * h4)


def _of_invariant(slope: Array, curvature: Array, d: Array, h: Array) -> tuple[Array, Array]:
    """Derivatives by C of W(I), from those of W by I and of I by C."""
    return slope[..., None] * d, slope[..., None, None] * h + curvature[..., None, None] * _outer(
        d, d
    )


def _outer(a: Array, b: Array) -> Array:
    return a[..., :, None] * b[..., None, :]


def _pair(inverse: Array) -> Array:
    """Minus the derivative (..., 6, 6) of C's inverse by C."""
    i, j, k, l = FIRST[:, None], SECOND[:, None], FIRST, SECOND  # noqa: E741
    straight = inverse[..., i, k] * inverse[..., j, l]
    return np.asarray((straight + inverse[..., i, l] * inverse[..., j, k]) / 2)
