"""Fibre-reinforced sheets, incompressible or with a finite bulk modulus (see `hyperelastic`).

With a = J^(-2/3) and b = J^(4/3) the deviatoric invariants of a sheet are

    I1~ = a I + b / D,    I2~ = a^2 D + I / (a D),    I4~ = a f
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import expi

from .hyperelastic import Expansion, Invariants, response
from .materials import Array, Real, Stress, require, require_not_negative, require_positive

LARGEST_EXPONENT = 700.0
"""exp of more is beyond floating point."""


def _check_bulk(law: object, k: Real) -> None:
    finite = np.isfinite(k)
    fine = np.greater(k, 0) & (finite.all() or not finite.any())
    require(law, "k", k, fine, "it must be positive, and finite or infinite for all elements alike")


@dataclass(frozen=True)
class TransIsoMooneyRivlin:
    """FEBio's `trans iso Mooney-Rivlin` (Weiss, Maker and Govindjee 1996; FEBio feature manual):

        W = c1 (I1~ - 3) + c2 (I2~ - 3) + F(l) + k/2 (ln J)^2,   l = sqrt(I4~)
        l dF/dl = 0 (l < 1),  c3 (exp(c4 (l - 1)) - 1) (l < lam_max),  c5 l + c6 beyond

    c6 makes the fibre's tension continuous, and F is so too (as the manual writes it, F jumps at
    lam_max).  The fibre lies along axis 1 and bears no compression.  c1, c2, c3, c5 and the bulk
    modulus k in Pa; k = inf is incompressible."""

    c1: Real
    c2: Real
    c3: Real
    c4: Real
    c5: Real
    lam_max: Real
    k: Real = math.inf

    def __post_init__(self) -> None:
        require_not_negative(self, c1=self.c1, c2=self.c2, c3=self.c3, c5=self.c5)
        require_positive(self, c4=self.c4)
        matrix = np.add(self.c1, self.c2) > 0
        require(self, "c1", self.c1, matrix, "c1 + c2 must be positive, for the matrix to hold")
        require(self, "lam_max", self.lam_max, np.greater(self.lam_max, 1), "it must exceed 1")
        small = np.multiply(self.c4, self.lam_max) < LARGEST_EXPONENT
        words = f"c4 lam_max must be below {LARGEST_EXPONENT:g}, or exp(c4 lam_max) overflows"
        require(self, "c4", self.c4, small, words)
        _check_bulk(self, self.k)

    def response(self, strain: Array) -> Stress:
        """See `materials.Law.response`."""
        return response(self, strain)

    def shear(self) -> tuple[Real, Real]:
        """Of the matrix: to first order shear out of the plane does not stretch the fibre."""
        G = 2 * (self.c1 + self.c2)
        return G, G

    def fibres(self) -> tuple[tuple[Real, Real, Real], ...]:
        return ((1.0, 0.0, 0.0),)

    def incompressible(self) -> bool:
        return not np.isfinite(self.k).any()

    def start(self, p: Invariants) -> Array:
        return np.zeros(p.det.shape)

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
            stiffness=self.volumetric(p, np.asarray(j))[1],
        )


class _Family(NamedTuple):
    """psi(E) of one fibre family and its derivatives by E, and E's by I1~ (kappa) and by j."""

    energy: Array
    slope: Array
    curvature: Array
    by_volume: Array
    by_volume_twice: Array


@dataclass(frozen=True)
class HolzapfelGasserOgden:
    """Dispersed fibres (Gasser, Ogden and Holzapfel 2006; FEBio feature manual):

        W = c/2 (I1~ - 3) + k1 / (2 k2) sum (exp(k2 <E>^2) - 1) + k/2 ((J^2 - 1)/2 - ln J)
        E = kappa (I1~ - 3) + (1 - 3 kappa) (I4~ - 1)

    over two families at +-gamma (rad) from axis 1; gamma = 0 lays them on one another: one family
    of twice k1, as in FEBio.  c, k1 and the bulk modulus k in Pa; k = inf is incompressible."""

    c: Real
    k1: Real
    k2: Real
    kappa: Real
    gamma: Real
    k: Real = math.inf

    def __post_init__(self) -> None:
        require_positive(self, c=self.c, k2=self.k2)
        require_not_negative(self, k1=self.k1)
        fine = np.greater_equal(self.kappa, 0) & np.less_equal(self.kappa, 1 / 3)
        require(self, "kappa", self.kappa, fine, "it must lie between 0 (aligned) and 1/3")
        require(self, "gamma", self.gamma, np.isfinite(self.gamma), "it must be an angle in rad")
        _check_bulk(self, self.k)

    def response(self, strain: Array) -> Stress:
        """See `materials.Law.response`."""
        return response(self, strain)

    def shear(self) -> tuple[Real, Real]:
        """Of the matrix: to first order shear out of the plane does not stretch the fibres."""
        return self.c, self.c

    def fibres(self) -> tuple[tuple[Real, Real, Real], ...]:
        cos, sin = np.cos(self.gamma), np.sin(self.gamma)
        return (cos * cos, sin * sin, sin * cos), (cos * cos, sin * sin, -sin * cos)

    def incompressible(self) -> bool:
        return not np.isfinite(self.k).any()

    def start(self, p: Invariants) -> Array:
        return np.zeros(p.det.shape)

    def _families(self, p: Invariants, a: Array) -> list[_Family]:
        along = 1 - 3 * np.asarray(self.kappa)
        first, first_3 = a * p.trace, 1 / (a * a * p.det)
        matrix = self.kappa * (first + first_3 - 3)
        by_volume = self.kappa * 2 / 3 * (2 * first_3 - first)
        twice = self.kappa * 4 / 9 * (first + 4 * first_3)
        out = []
        for f in p.fibres:
            strain = matrix + along * (a * f - 1)
            taut = np.maximum(strain, 0)
            power = self.k2 * taut * taut
            x = self.k1 * np.exp(power)
            out.append(
                _Family(
                    energy=(x - self.k1) / (2 * self.k2),
                    slope=x * taut,
                    curvature=x * (1 + 2 * power) * (strain >= 0),
                    by_volume=by_volume - 2 / 3 * along * a * f,
                    by_volume_twice=twice + 4 / 9 * along * a * f,
                )
            )
        return out

    def volumetric(self, p: Invariants, j: Array) -> tuple[Array, Array]:
        a = np.exp(-2 / 3 * j)
        first, first_3 = self.c / 2 * a * p.trace, self.c / 2 / (a * a * p.det)
        J2 = np.exp(2 * j)
        slope = 2 / 3 * (2 * first_3 - first) + self.k / 2 * (J2 - 1)
        convex = 4 / 9 * (first + 4 * first_3) + self.k * J2
        for w in self._families(p, a):
            slope = slope + w.slope * w.by_volume
            convex = convex + w.slope * w.by_volume_twice + w.curvature * w.by_volume**2
        return slope, convex

    def expansion(self, p: Invariants, j: Real) -> Expansion:
        D, a = p.det, np.exp(-2 / 3 * np.asarray(j))
        along, families = 1 - 3 * np.asarray(self.kappa), self._families(p, a)
        m = self.c / 2 + self.kappa * sum(w.slope for w in families)
        by_det = -1 / (a * a * D * D)
        energy = self.c / 2 * (a * p.trace - by_det * D - 3) + sum(w.energy for w in families)
        if not self.incompressible():
            energy = energy + self.k / 2 * (np.expm1(2 * np.asarray(j)) / 2 - j)
        curvature: dict[tuple[int, int], Real] = {(1, 1): -2 * m * by_det / D}
        mixed: list[Real] = [-2 / 3 * m * a, 4 / 3 * m * by_det]
        mixed += [-2 / 3 * along * a * w.slope for w in families]
        for n, w in enumerate(families):
            strain = {0: self.kappa * a, 1: self.kappa * by_det, 2 + n: along * a}
            for q, by_q in strain.items():
                stiff = w.curvature * by_q
                mixed[q] = mixed[q] + stiff * w.by_volume
                for r in (r for r in strain if r <= q):
                    curvature[r, q] = curvature.get((r, q), 0.0) + stiff * strain[r]
        slope = [m * a, m * by_det, *(along * a * w.slope for w in families)]
        return Expansion(energy, slope, curvature, mixed, self.volumetric(p, np.asarray(j))[1])
