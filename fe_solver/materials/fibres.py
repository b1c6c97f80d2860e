"""Fibre-reinforced sheets, incompressible or with a finite bulk modulus (see `hyperelastic`).

With a = J^(-2/3) and b = J^(4/3) the deviatoric invariants of a sheet are

    I1~ = a I + b / D,    I2~ = a^2 D + I / (a D),    I4~ = a f

A law may have a second fibre family with its own moduli and direction (`crossed_fibres`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import expi

from fe_solver.materials.hyperelastic import Expansion, Invariants, response
from fe_solver.materials.linear import (
    Array,
    Real,
    Stress,
    require,
    require_not_negative,
    require_positive,
)

LARGEST_EXPONENT = 700.0
"""exp of more is beyond floating point."""


def _check_bulk(law: object, k: Real) -> None:
    finite = np.isfinite(k)
    fine = np.greater(k, 0) & (finite.all() or not finite.any())
    require(law, "k", k, fine, "it must be positive, and finite or infinite for all elements alike")


def axial(angle: Real) -> tuple[Real, Real, Real]:
    """cos^2, sin^2 and sin cos of a fibre's angle (rad) from axis 1, as `Potential.fibres`."""
    cos, sin = np.cos(angle), np.sin(angle)
    return cos * cos, sin * sin, sin * cos


class ExponentialToe:
    """One fibre family of Weiss, Maker and Govindjee 1996 by its stretch l:

        l dF/dl = 0 (l < 1),  c3 (exp(c4 (l - 1)) - 1) (l < lam_max),  c5 l + c6 beyond

    c6 makes the fibre's tension continuous, and F is so too (as FEBio's manual writes it, F jumps
    at lam_max).  It bears no compression.  c3 and c5 in Pa."""

    c3: Real
    c4: Real
    c5: Real
    lam_max: Real

    def check_fibre(self) -> None:
        """Check the parameters.  Raises InputError for those that are not allowed."""
        require_not_negative(self, c3=self.c3, c5=self.c5)
        require_positive(self, c4=self.c4)
        require(self, "lam_max", self.lam_max, np.greater(self.lam_max, 1), "it must exceed 1")
        small = np.multiply(self.c4, self.lam_max) < LARGEST_EXPONENT
        words = f"c4 lam_max must be below {LARGEST_EXPONENT:g}, or exp(c4 lam_max) overflows"
        require(self, "c4", self.c4, small, words)

    def tension(self, stretch: Array) -> tuple[Array, Array]:
        """l dF/dl (Pa) of the fibre and l times its derivative by l."""
        x = np.exp(self.c4 * (np.clip(stretch, 1.0, self.lam_max) - 1))
        beyond = stretch >= self.lam_max
        rate = np.where(beyond, self.c5, self.c3 * self.c4 * x) * (stretch >= 1)
        return (
            self.c3 * (x - 1) + self.c5 * np.maximum(stretch - self.lam_max, 0),
            rate * stretch,
        )

    def fibre_energy(self, stretch: Array) -> Array:
        """F (J/m3): the integral of the tension over ln l, from 1."""
        toe = np.clip(stretch, 1.0, self.lam_max)
        ratio = np.maximum(stretch / self.lam_max, 1.0)
        integral = np.exp(-np.asarray(self.c4)) * (expi(self.c4 * toe) - expi(self.c4))
        c6 = self.c3 * np.expm1(self.c4 * (self.lam_max - 1)) - self.c5 * self.lam_max
        linear = self.c5 * self.lam_max * (ratio - 1) + c6 * np.log(ratio)
        return self.c3 * (integral - np.log(toe)) + linear


@dataclass(frozen=True)
class TransIsoMooneyRivlin(ExponentialToe):
    """FEBio's `trans iso Mooney-Rivlin` (Weiss, Maker and Govindjee 1996; FEBio feature manual):

        W = c1 (I1~ - 3) + c2 (I2~ - 3) + F(l) + k/2 (ln J)^2,   l = sqrt(I4~)

    with the fibre energy F of `ExponentialToe` along axis 1.  Raises InputError for parameters out
    of their range.

    >>> import numpy as np
    >>> from fe_solver.materials.fibres import TransIsoMooneyRivlin
    >>> law = TransIsoMooneyRivlin(c1=1e6, c2=0.0, c3=1e6, c4=50.0, c5=200e6, lam_max=1.03)
    >>> tension, slope = law.tension(np.array([0.98, 1.0, 1.02, 1.05]))  # by the fibre's stretch
    >>> (tension / 1e6).round(2)  # MPa: slack, a toe, straight beyond lam_max
    array([0.  , 0.  , 1.72, 7.48])
    """

    c1: Real
    """Pa, of the matrix."""
    c2: Real
    """Pa, of the matrix."""
    c3: Real
    """Pa, scale of the toe."""
    c4: Real
    """Steepness of the toe."""
    c5: Real
    """Pa, slope of the straight fibres' tension."""
    lam_max: Real
    """Stretch beyond which the fibres are straight."""
    k: Real = math.inf
    """Pa, the bulk modulus; inf is incompressible."""

    def __post_init__(self) -> None:
        require_not_negative(self, c1=self.c1, c2=self.c2)
        matrix = np.add(self.c1, self.c2) > 0
        require(self, "c1", self.c1, matrix, "c1 + c2 must be positive, for the matrix to hold")
        self.check_fibre()
        _check_bulk(self, self.k)

    def response(self, strain: Array) -> Stress:
        """See `materials.linear.Law.response`."""
        return response(self, strain)

    def shear(self) -> tuple[Real, Real]:
        """Shear moduli of the matrix: to first order shear out of the plane does not stretch the
        fibre."""
        G = 2 * (self.c1 + self.c2)
        return G, G

    def fibres(self) -> tuple[tuple[Real, Real, Real], ...]:
        """Components (cos^2, sin^2, sin cos) of each fibre family's direction, from axis 1."""
        return ((1.0, 0.0, 0.0),)

    def incompressible(self) -> bool:
        """Whether the law admits no change of volume."""
        return not np.isfinite(self.k).any()

    def start(self, p: Invariants) -> Array:
        return np.zeros(p.det.shape)

    def volumetric(self, p: Invariants, j: Array) -> tuple[Array, Array]:
        a = np.exp(-2 / 3 * j)
        tension, rate = self.tension(np.sqrt(a * p.fibres[0]))
        first, first_3 = self.c1 * a * p.trace, self.c1 / (a * a * p.det)
        second, second_3 = self.c2 * a * a * p.det, self.c2 * p.trace / (a * p.det)
        slope = 2 / 3 * (2 * first_3 - first + second_3 - 2 * second) - tension / 3 + self.k * j
        convex = 4 / 9 * (first + 4 * first_3 + 4 * second + second_3) + rate / 9 + self.k
        return slope, convex

    def expansion(self, p: Invariants, j: Real) -> Expansion:
        I, D, f = p.trace, p.det, p.fibres[0]  # noqa: E741
        a = np.exp(-2 / 3 * np.asarray(j))
        b = 1 / (a * a)
        stretch = np.sqrt(a * f)
        tension, rate = self.tension(stretch)
        matrix = self.c1 * (a * I + b / D - 3) + self.c2 * (a * a * D + I / (a * D) - 3)
        volume = 0.0 if self.incompressible() else self.k / 2 * np.square(j)
        c1b, c2a, c2i = self.c1 * b / D**2, self.c2 / (a * D), self.c2 * a * a
        return Expansion(
            energy=matrix + self.fibre_energy(stretch) + volume,
            slope=(self.c1 * a + c2a, c2i - c1b - c2a * I / D, tension / (2 * f)),
            curvature={
                (0, 1): -c2a / D,
                (1, 1): 2 * c1b / D + 2 * c2a * I / D**2,
                (2, 2): (rate - 2 * tension) / (4 * f * f),
            },
            mixed=(
                2 / 3 * (c2a - self.c1 * a),
                -2 / 3 * (2 * c1b + 2 * c2i + c2a * I / D),
                -rate / (6 * f),
            ),
            stiffness=0.0 if self.incompressible() else self.volumetric(p, np.asarray(j))[1],
        )


@dataclass(frozen=True)
class ExponentialFamily(ExponentialToe):
    """A fibre family of the trans iso Mooney-Rivlin law alone: F(l), l = sqrt(I4~)."""

    c3: Real
    c4: Real
    c5: Real
    lam_max: Real

    def __post_init__(self) -> None:
        self.check_fibre()

    def volumetric(self, p: Invariants, j: Array) -> tuple[Array, Array]:
        """W_j and W_jj; `p` has this family's squared stretch alone."""
        tension, rate = self.tension(np.sqrt(np.exp(-2 / 3 * j) * p.fibres[0]))
        return -tension / 3, rate / 9

    def expansion(self, p: Invariants, j: Real) -> Expansion:
        """W(I, D, f, j); `p` has this family's squared stretch alone."""
        f = p.fibres[0]
        stretch = np.sqrt(np.exp(-2 / 3 * np.asarray(j)) * f)
        tension, rate = self.tension(stretch)
        return Expansion(
            energy=self.fibre_energy(stretch),
            slope=(0.0, 0.0, tension / (2 * f)),
            curvature={(2, 2): (rate - 2 * tension) / (4 * f * f)},
            mixed=(0.0, 0.0, -rate / (6 * f)),
            stiffness=rate / 9,
        )


@dataclass(frozen=True)
class DispersedFamily:
    """A fibre family of the Holzapfel-Gasser-Ogden law alone, k1 in Pa:

    W = k1 / (2 k2) (exp(k2 <E>^2) - 1),   E = kappa (I1~ - 3) + (1 - 3 kappa) (I4~ - 1)"""

    k1: Real
    k2: Real
    kappa: Real

    def __post_init__(self) -> None:
        require_positive(self, k2=self.k2)
        require_not_negative(self, k1=self.k1)
        fine = np.greater_equal(self.kappa, 0) & np.less_equal(self.kappa, 1 / 3)
        require(self, "kappa", self.kappa, fine, "it must lie between 0 (aligned) and 1/3")

    def _by_strain(self, strain: Array) -> tuple[Array, Array, Array]:
        """W and its first and second derivative by E."""
        taut = np.maximum(strain, 0)
        power = self.k2 * taut * taut
        x = self.k1 * np.exp(power)
        curvature = x * (1 + 2 * power) * (strain >= 0)
        return self.k1 * np.expm1(power) / (2 * self.k2), x * taut, curvature

    def _strain(self, p: Invariants, a: Array) -> tuple[Array, Array, Array]:
        """E and its first and second derivative by j; a = J^(-2/3)."""
        along = (1 - 3 * np.asarray(self.kappa)) * a * p.fibres[0]
        first, first_3 = a * p.trace, 1 / (a * a * p.det)
        strain = self.kappa * (first + first_3 - 3) + along - (1 - 3 * np.asarray(self.kappa))
        by_volume = self.kappa * 2 / 3 * (2 * first_3 - first) - 2 / 3 * along
        return strain, by_volume, self.kappa * 4 / 9 * (first + 4 * first_3) + 4 / 9 * along

    def volumetric(self, p: Invariants, j: Array) -> tuple[Array, Array]:
        """W_j and W_jj; `p` has this family's squared stretch alone."""
        strain, by_j, by_jj = self._strain(p, np.exp(-2 / 3 * j))
        _, slope, curvature = self._by_strain(strain)
        return slope * by_j, slope * by_jj + curvature * by_j**2

    def expansion(self, p: Invariants, j: Real) -> Expansion:
        """W(I, D, f, j); `p` has this family's squared stretch alone."""
        a = np.exp(-2 / 3 * np.asarray(j))
        strain, by_j, by_jj = self._strain(p, a)
        energy, slope, curvature = self._by_strain(strain)
        along, by_det = (1 - 3 * np.asarray(self.kappa)) * a, -self.kappa / (a * a * p.det**2)
        by = (self.kappa * a, by_det, along)
        by_and_j = (-2 / 3 * self.kappa * a, 4 / 3 * by_det, -2 / 3 * along)
        bent: dict[tuple[int, int], Real] = {
            (q, r): curvature * by[q] * by[r] for q in range(3) for r in range(q, 3)
        }
        bent[1, 1] = bent[1, 1] - 2 * slope * by_det / p.det
        return Expansion(
            energy=energy,
            slope=[slope * q for q in by],
            curvature=bent,
            mixed=[curvature * q * by_j + slope * r for q, r in zip(by, by_and_j, strict=True)],
            stiffness=slope * by_jj + curvature * by_j**2,
        )


Family = ExponentialFamily | DispersedFamily


def with_family(base: Expansion, family: Expansion) -> Expansion:
    """The sum of an energy of `(trace, det, *fibres)` and a family's of `(trace, det, f)`, whose
    `f` comes last."""
    last = len(base.slope)
    place = {0: 0, 1: 1, 2: last}
    slope, mixed = [*base.slope, 0.0], [*base.mixed, 0.0]
    curvature = dict(base.curvature)
    for q, at in place.items():
        slope[at] = slope[at] + family.slope[q]
        mixed[at] = mixed[at] + family.mixed[q]
    for (q, r), value in family.curvature.items():
        pair = place[q], place[r]
        curvature[pair] = curvature.get(pair, 0.0) + value
    energy, stiffness = base.energy + family.energy, base.stiffness + family.stiffness
    return Expansion(energy, slope, curvature, mixed, stiffness)


@dataclass(frozen=True)
class HolzapfelGasserOgden:
    """The law of dispersed fibres (Gasser, Ogden and Holzapfel 2006; FEBio feature manual):

        W = c/2 (I1~ - 3) + k1 / (2 k2) sum (exp(k2 <E>^2) - 1) + k/2 ((J^2 - 1)/2 - ln J)
        E = kappa (I1~ - 3) + (1 - 3 kappa) (I4~ - 1)

    over two families at +-gamma from axis 1; gamma = 0 lays them on one another: one family of
    twice k1, as in FEBio.  Raises InputError for parameters out of their range.

    >>> import numpy as np
    >>> from fe_solver.materials.fibres import HolzapfelGasserOgden
    >>> artery = HolzapfelGasserOgden(c=1e6, k1=5e6, k2=10.0, kappa=0.1, gamma=np.pi / 6)
    >>> (artery.response(np.array([0.05, 0.0, 0.0])).stress / 1e6).round(2)
    array([0.77, 0.29, 0.  ])
    """

    c: Real
    """Pa, of the matrix."""
    k1: Real
    """Pa, of the fibres."""
    k2: Real
    """Steepness of the fibres' energy."""
    kappa: Real
    """Dispersion, from 0 (aligned) to 1/3 (isotropic)."""
    gamma: Real
    """rad, of the families to either side of axis 1."""
    k: Real = math.inf
    """Pa, the bulk modulus; inf is incompressible."""

    def __post_init__(self) -> None:
        require_positive(self, c=self.c, k2=self.k2)
        require_not_negative(self, k1=self.k1)
        fine = np.greater_equal(self.kappa, 0) & np.less_equal(self.kappa, 1 / 3)
        require(self, "kappa", self.kappa, fine, "it must lie between 0 (aligned) and 1/3")
        require(self, "gamma", self.gamma, np.isfinite(self.gamma), "it must be an angle in rad")
        _check_bulk(self, self.k)

    def response(self, strain: Array) -> Stress:
        """See `materials.linear.Law.response`."""
        return response(self, strain)

    def shear(self) -> tuple[Real, Real]:
        """Shear moduli of the matrix: to first order shear out of the plane does not stretch the
        fibres."""
        return self.c, self.c

    def fibres(self) -> tuple[tuple[Real, Real, Real], ...]:
        """Components (cos^2, sin^2, sin cos) of each fibre family's direction, from axis 1."""
        return axial(self.gamma), axial(-np.asarray(self.gamma))

    def incompressible(self) -> bool:
        """Whether the law admits no change of volume."""
        return not np.isfinite(self.k).any()

    def start(self, p: Invariants) -> Array:
        return np.zeros(p.det.shape)

    def _families(self, p: Invariants) -> list[tuple[DispersedFamily, Invariants]]:
        """Both families, each with the invariants that it depends on."""
        family = DispersedFamily(self.k1, self.k2, self.kappa)
        return [(family, p._replace(fibres=(f,))) for f in p.fibres]

    def volumetric(self, p: Invariants, j: Array) -> tuple[Array, Array]:
        a = np.exp(-2 / 3 * j)
        first, first_3 = self.c / 2 * a * p.trace, self.c / 2 / (a * a * p.det)
        J2 = np.exp(2 * j)
        slope = 2 / 3 * (2 * first_3 - first) + self.k / 2 * (J2 - 1)
        convex = 4 / 9 * (first + 4 * first_3) + self.k * J2
        for family, invariants in self._families(p):
            more = family.volumetric(invariants, j)
            slope, convex = slope + more[0], convex + more[1]
        return slope, convex

    def _matrix(self, p: Invariants, j: Array) -> Expansion:
        """c/2 (I1~ - 3) and the volume's energy, of (trace, det, j)."""
        D, a = p.det, np.exp(-2 / 3 * j)
        by_det = -1 / (a * a * D * D)
        energy = self.c / 2 * (a * p.trace - by_det * D - 3)
        stiffness = self.c * 2 / 9 * (a * p.trace - 4 * by_det * D)
        if not self.incompressible():
            energy = energy + self.k / 2 * (np.expm1(2 * j) / 2 - j)
            stiffness = stiffness + self.k * np.exp(2 * j)
        return Expansion(
            energy=energy,
            slope=(self.c / 2 * a, self.c / 2 * by_det),
            curvature={(1, 1): -self.c * by_det / D},
            mixed=(-self.c / 3 * a, self.c * 2 / 3 * by_det),
            stiffness=stiffness,
        )

    def expansion(self, p: Invariants, j: Real) -> Expansion:
        out = self._matrix(p, np.asarray(j))
        for family, invariants in self._families(p):
            out = with_family(out, family.expansion(invariants, j))
        return out
