"""Sheets with two fibre families: a law of one family, and a second family with its own moduli.

The second family lies at an angle from axis 1 (counter-clockwise about axis 3), the direction of
the first.  Its energy is added to the first law's; what the two do to one another comes through the
strain that they share.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cosim.port import Array
from fe_solver.materials.fibres import (
    Family,
    HolzapfelGasserOgden,
    TransIsoMooneyRivlin,
    axial,
    with_family,
)
from fe_solver.materials.hyperelastic import Expansion, Invariants, response
from fe_solver.materials.linear import LinearLaw, Real, Stress, require, require_positive


def _check_angle(law: object, angle: Real) -> None:
    require(law, "angle", angle, np.isfinite(angle), "it must be an angle in rad")


@dataclass(frozen=True)
class CrossedLinear(LinearLaw):
    """A linear law and a second family of straight fibres:

        Q = Q_base + modulus v v^T,   v = (cos^2, sin^2, sin cos)

    so that v . (E11, E22, 2 E12) is the strain along them; they bear tension and compression
    alike."""

    base: LinearLaw
    modulus: Real
    """Pa, of the fibres over the whole section of the sheet."""
    angle: Real
    """rad, of the fibres from axis 1."""

    def __post_init__(self) -> None:
        require_positive(self, modulus=self.modulus)
        _check_angle(self, self.angle)

    def plane(self) -> Array:
        v = np.stack(np.broadcast_arrays(*axial(self.angle)), axis=-1)
        added = np.asarray(self.modulus)[..., None, None] * v[..., :, None] * v[..., None, :]
        return self.base.plane() + added

    def shear(self) -> tuple[Real, Real]:
        """That of the base: to first order shear out of the plane does not stretch fibres."""
        return self.base.shear()

    def response(self, strain: Array) -> Stress:
        """See `materials.linear.Law.response`; the tangent is a read-only view of `plane`."""
        Q = self.plane()
        stress = np.einsum("...ij,...j->...i", np.broadcast_to(Q, (*strain.shape, 3)), strain)
        energy = np.einsum("...i,...i->...", strain, stress) / 2
        return Stress(energy, stress, np.broadcast_to(Q, (*strain.shape, 3)))


@dataclass(frozen=True)
class CrossedFibres:
    """A hyperelastic law with fibres, and a second family at `angle` (rad) from axis 1:

        W = W_base(I, D, f_1, ..., j) + W_second(I, D, f, j)

    with f the squared stretch along the second family."""

    base: TransIsoMooneyRivlin | HolzapfelGasserOgden
    second: Family
    angle: Real

    def __post_init__(self) -> None:
        _check_angle(self, self.angle)

    def response(self, strain: Array) -> Stress:
        """See `materials.linear.Law.response`."""
        return response(self, strain)

    def shear(self) -> tuple[Real, Real]:
        """That of the matrix: to first order shear out of the plane does not stretch fibres."""
        return self.base.shear()

    def fibres(self) -> tuple[tuple[Real, Real, Real], ...]:
        """Components (cos^2, sin^2, sin cos) of each fibre family's direction, from axis 1."""
        return (*self.base.fibres(), axial(self.angle))

    def incompressible(self) -> bool:
        """Whether the law admits no change of volume."""
        return self.base.incompressible()

    def start(self, p: Invariants) -> Array:
        return self.base.start(_split(p)[0])

    def volumetric(self, p: Invariants, j: Array) -> tuple[Array, Array]:
        first, second = _split(p)
        slope, convex = self.base.volumetric(first, j)
        more = self.second.volumetric(second, j)
        return slope + more[0], convex + more[1]

    def expansion(self, p: Invariants, j: Real) -> Expansion:
        first, second = _split(p)
        return with_family(self.base.expansion(first, j), self.second.expansion(second, j))


def _split(p: Invariants) -> tuple[Invariants, Invariants]:
    """The invariants of the base law, and those of the second family."""
    return p._replace(fibres=p.fibres[:-1]), p._replace(fibres=p.fibres[-1:])
