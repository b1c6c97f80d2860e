"""Plane-stress laws of a sheet: stress and tangent from the in-plane Green-Lagrange strain.

Axes are local and orthonormal: 1 along the fibre, 2 across it, 3 through the thickness.  The linear
laws live here, the others in `hyperelastic` and `fibres`, the relaxed one in
`tension_field`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple, Protocol, Self

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Mask
from fe_solver.given import fill, numbers

Real = Array | float


class Stress(NamedTuple):
    """The response at material points."""

    energy: Array
    """(...,) J/m3 per reference volume."""
    stress: Array
    """(..., 3) second Piola-Kirchhoff S11, S22, S12, Pa."""
    tangent: Array
    """(..., 3, 3) dS/dE against (E11, E22, 2 E12), Pa, symmetric; may be a read-only view."""


class Law(Protocol):
    """A sheet's material; its parameters are floats or arrays that broadcast against the points."""

    def response(self, strain: Array) -> Stress:
        """At the strain (..., 3): Green-Lagrange E11, E22, 2 E12.

        Where a nonlinear law has no answer (C = 1 + 2 E not positive definite, NaN, or an energy
        beyond floating point) the energy is inf and stress and tangent are zero, so that a line
        search cuts back.  The linear laws answer at any strain."""

    def shear(self) -> tuple[Real, Real]:
        """Initial transverse shear moduli G13, G23, Pa."""


def require(law: object, name: str, value: Real, allowed: Mask | bool, words: str) -> None:
    """Refuse a parameter that is not `allowed` everywhere (NaN never is): InputError."""
    fine = np.broadcast_to(allowed, np.broadcast_shapes(np.shape(allowed), np.shape(value)))
    if not np.all(fine):
        first = np.broadcast_to(value, fine.shape)[~fine][0]
        raise InputError(f"{type(law).__name__}: {name} = {first:g} is not allowed: {words}")


def _real(law: object, name: str, value: Real) -> Real:
    """A parameter as it was given, a list as an array, which becomes the law's.  Raises InputError
    where it is no number."""
    array = numbers(f"{type(law).__name__}: {name}", value)
    if array.ndim == 0:
        return value
    fill(law, **{name: array})
    return array


def require_positive(law: object, **values: Real) -> None:
    """Raise InputError unless all values are positive and finite."""
    for name, given in values.items():
        value = _real(law, name, given)
        fine = np.greater(value, 0) & np.isfinite(value)
        require(law, name, value, fine, "it must be positive and finite")


def require_not_negative(law: object, **values: Real) -> None:
    """Raise InputError unless all values are finite and not negative."""
    for name, given in values.items():
        value = _real(law, name, given)
        fine = np.greater_equal(value, 0) & np.isfinite(value)
        require(law, name, value, fine, "it must be zero or positive, and finite")


def require_poisson(law: object, nu: Real) -> None:
    """Raise InputError for a Poisson's ratio that the material cannot have."""
    nu = _real(law, "nu", nu)
    fine = np.greater(nu, -1) & np.less(nu, 0.5)
    require(law, "nu", nu, fine, "Poisson's ratio must lie between -1 and 0.5, both excluded")


def symmetric(entries: dict[tuple[int, int], Real], shape: tuple[int, ...]) -> Array:
    """The matrix `(*shape, 3, 3)` from entries of the upper triangle; absent ones are zero."""
    out = np.zeros((*shape, 3, 3))
    for (i, j), value in entries.items():
        out[..., i, j] = value
        if i != j:
            out[..., j, i] = value
    return out


@dataclass(frozen=True)
class LinearLaw(ABC):
    """Saint Venant-Kirchhoff: S = Q E, W = E.Q.E / 2, with a constant plane-stress stiffness."""

    @abstractmethod
    def plane(self) -> Array:
        """The stiffness Q (..., 3, 3) Pa against (E11, E22, 2 E12); axes 1 and 2 are its own, so
        that Q13 = Q23 = 0."""

    @abstractmethod
    def shear(self) -> tuple[Real, Real]:
        """Transverse shear moduli G13, G23, Pa."""

    def response(self, strain: Array) -> Stress:
        """See `Law.response`; the tangent is a read-only view of `plane`."""
        Q = self.plane()
        e1, e2, e3 = strain[..., 0], strain[..., 1], strain[..., 2]
        stress = np.empty(strain.shape)
        stress[..., 0] = Q[..., 0, 0] * e1 + Q[..., 0, 1] * e2
        stress[..., 1] = Q[..., 0, 1] * e1 + Q[..., 1, 1] * e2
        stress[..., 2] = Q[..., 2, 2] * e3
        energy = np.einsum("...i,...i->...", strain, stress) / 2
        return Stress(energy, stress, np.broadcast_to(Q, (*strain.shape, 3)))


@dataclass(frozen=True)
class Isotropic(LinearLaw):
    """The Saint Venant-Kirchhoff law of Young's modulus E (Pa) and Poisson's ratio nu.

    Raises InputError for a modulus that is not positive and a ratio outside of -1 to 0.5.

    >>> from fe_solver.materials.linear import Isotropic
    >>> (Isotropic(100e6, 0.25).plane() / 1e6).round(1)
    array([[106.7,  26.7,   0. ],
           [ 26.7, 106.7,   0. ],
           [  0. ,   0. ,  40. ]])
    """

    E: Real
    nu: Real

    def __post_init__(self) -> None:
        require_positive(self, E=self.E)
        require_poisson(self, self.nu)

    def plane(self) -> Array:
        q = self.E / (1 - np.square(self.nu))
        entries = {(0, 0): q, (1, 1): q, (0, 1): q * self.nu, (2, 2): self.shear()[0]}
        return symmetric(entries, np.broadcast_shapes(np.shape(self.E), np.shape(self.nu)))

    def shear(self) -> tuple[Real, Real]:
        G = self.E / (2 * (1 + self.nu))
        return G, G


@dataclass(frozen=True)
class Orthotropic(LinearLaw):
    """The Saint Venant-Kirchhoff law of an orthotropic sheet.  A sheet in plane stress does not ask
    for E3, nu23 and nu31, a solid does (`q4ans.laws`).

    Raises InputError where the parameters make no positive definite law.

    >>> import numpy as np
    >>> from fe_solver.materials.linear import Orthotropic
    >>> fibrous = Orthotropic(E1=100e6, E2=2e6, nu12=0.4, G12=1e6, G13=1e6, G23=1e6)
    >>> pull = fibrous.response(np.array([0.01, -0.004, 0.0])).stress  # contraction is free
    >>> (pull / 1e6).round(3)
    array([1., 0., 0.])
    """

    E1: Real
    """Pa, along the fibre."""
    E2: Real
    """Pa, across it in the sheet."""
    nu12: Real
    """Contraction across a pull along the fibre."""
    G12: Real
    """Pa, shear in the sheet."""
    G13: Real
    """Pa, transverse shear along the fibre."""
    G23: Real
    """Pa, transverse shear across it."""
    E3: Real | None = None
    """Pa, through the thickness; None takes E2."""
    nu23: Real = 0.0
    """Contraction through the thickness of a pull across the fibre."""
    nu31: Real = 0.0
    """Contraction along the fibre of a pull through the thickness."""

    def __post_init__(self) -> None:
        require_positive(self, E1=self.E1, E2=self.E2, G12=self.G12, G13=self.G13, G23=self.G23)
        definite = np.square(self.nu12) * self.E2 < np.asarray(self.E1)
        words = "nu12^2 must be below E1/E2, or the stiffness is not positive definite"
        require(self, "nu12", self.nu12, definite, words)

    @classmethod
    def transversely_isotropic(cls, E1: Real, E2: Real, nu12: Real, G12: Real, nu23: Real) -> Self:
        """One fibre direction, isotropic around it: G13 = G12, G23 = E2 / 2 (1 + nu23).

        Raises InputError where the solid, and not only the sheet, is not positive definite."""
        law = cls(E1, E2, nu12, G12, G12, E2 / (2 * (1 + np.asarray(nu23))))
        left = 1 - np.asarray(nu23) - 2 * np.square(nu12) * E2 / E1
        words = "1 - nu23 - 2 nu12^2 E2/E1 must be positive, or the solid is not stable"
        require(law, "nu23", nu23, left > 0, words)
        return law

    def plane(self) -> Array:
        nu21 = self.nu12 * self.E2 / self.E1
        d = 1 - self.nu12 * nu21
        entries = {
            (0, 0): self.E1 / d,
            (1, 1): self.E2 / d,
            (0, 1): nu21 * self.E1 / d,
            (2, 2): self.G12,
        }
        return symmetric(entries, np.broadcast_shapes(*map(np.shape, (*entries.values(),))))

    def shear(self) -> tuple[Real, Real]:
        return self.G13, self.G23
