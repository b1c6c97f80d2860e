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

`wrinkles` has the energy, its balance and its tangent, `wrinkle_search` finds the P of the least.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from cosim.port import Array, Mask
from fe_solver.materials.linear import Law, Real, Stress, require
from fe_solver.materials.wrinkle_search import HALF_SHEAR, find_wrinkles
from fe_solver.materials.wrinkles import (
    WrinkleCost,
    WrinkledSheet,
    parameters_at,
    principal_values,
    wrinkle_strain,
)

RESIDUAL = 1e-6
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
        shape = np.shape(strain)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            sheet, A, solved = self._wrinkles(strain)
            base = sheet.base(A)
            at_rest = sheet.cost.barrier * 2 * np.log(self.smoothing)
            energy, tangent = sheet.energy(A, base) + at_rest, sheet.tangent(A, base)
        solved &= np.isfinite(energy)
        return Stress(
            np.where(solved, energy, np.inf).reshape(shape[:-1]),
            np.where(solved[:, None], base.stress, 0.0).reshape(shape),
            np.where(solved[:, None, None], tangent, 0.0).reshape(*shape, 3),
        )

    def state(self, strain: Array) -> NDArray[np.intp]:
        """The `State` (...,) at strains (..., 3)."""
        wrinkles = wrinkle_strain(self._wrinkles(strain)[1]) * HALF_SHEAR
        seen = principal_values(wrinkles)[0] > SEEN * self.smoothing
        return seen.sum(axis=1).reshape(np.shape(strain)[:-1])

    def elastic_strain(self, strain: Array) -> Array:
        """The strain (..., 3) of the base law at strains (..., 3): what wrinkles have taken up is
        added to it."""
        wrinkles = wrinkle_strain(self._wrinkles(strain)[1])
        return np.asarray(strain + wrinkles.reshape(np.shape(strain)))

    def shear(self) -> tuple[Real, Real]:
        return self.base.shear()

    def cost(self, shape: tuple[int, ...]) -> WrinkleCost:
        """What wrinkles cost at points of that shape, by the lesser modulus at rest."""
        rest = self.base.response(np.zeros((*shape, 3))).tangent
        modulus = np.minimum(rest[..., 0, 0], rest[..., 1, 1])
        return WrinkleCost(modulus * self.smoothing**2, modulus * RESIDUAL)

    def _wrinkles(self, strain: Array) -> tuple[WrinkledSheet, Array, Mask]:
        """The sheet at m points, its wrinkles in balance, and where they were found."""
        strain = np.asarray(strain, dtype=float)
        shape = strain.shape[:-1]
        law = parameters_at(self.base, np.ones(shape, dtype=bool))
        cost = WrinkleCost(*(x.reshape(-1) for x in self.cost(shape)))
        sheet = WrinkledSheet(law, strain.reshape(-1, 3), cost)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return sheet, *find_wrinkles(sheet, self.smoothing)
