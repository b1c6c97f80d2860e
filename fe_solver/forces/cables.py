"""Cables as line cells between nodes: finite displacements, tension only, a smooth toe.

With the engineering strain e = l / l0 - 1 a cell of modulus E and section A pulls with

    N(e) = E A m(e) + T0 l / l0,    m(e) = 0 (e < 0),  e^2 / (2 t) (0 < e < t),  e - t/2 (e > t)

quadratic over the toe t, so that N is C1.  T0 is a residual tension: a spring of no length and of
stiffness T0 / l0, the force density of form finding (Schek 1974, Comput Methods Appl Mech Eng
3:115).  A slack cable without it is a mechanism; with it a cell pulls and stiffens in every
direction at any length, and the energy of a net is strictly convex in the nodes' positions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Ints
from fe_solver.forces.ramp import ramp
from fe_solver.forces.springs import PairForces


@dataclass(frozen=True)
class Cables:
    """k line cells.  Raises InputError for what is not positive, naming the cell."""

    nodes: Ints
    """(k, 2) indices."""
    length: Array
    """(k,) m, free of stress."""
    modulus: Array
    """(k,) Pa."""
    section: Array
    """(k,) m2."""
    toe: Array
    """(k,) strain at which the law becomes straight."""
    residual: Array
    """(k,) N, tension that is left at that length."""

    def __post_init__(self) -> None:
        for name in ("length", "modulus", "section", "toe", "residual"):
            value = np.asarray(getattr(self, name), dtype=float)
            if value.shape != (len(self.nodes),):
                raise InputError(
                    f"cables: expected {len(self.nodes)} values of {name}, got {value.shape}"
                )
            if (bad := np.flatnonzero(~(np.isfinite(value) & (value > 0)))).size:
                raise InputError(
                    f"cables: {name} of cell {bad[0]} must be positive, got {value[bad[0]]:g}"
                )

    @staticmethod
    def none() -> Cables:
        """No cables."""
        f = np.zeros(0)
        return Cables(np.zeros((0, 2), dtype=np.intp), f, f, f, f, f)


class CableResponse(NamedTuple):
    """What cells do at their lengths, each (k,)."""

    energy: Array
    """J."""
    force: Array
    """N, the residual tension included."""
    slope: Array
    """N/m."""
    strain: Array
    """Engineering strain."""


def law(cables: Cables, length: Array) -> CableResponse:
    """The cells at lengths (k,) m."""
    stretch = length / cables.length
    stiffness, half = cables.modulus * cables.section, cables.toe / 2
    work, value, slope = ramp(stretch - 1 - half, half)
    return CableResponse(
        cables.length * (stiffness * work + cables.residual * stretch**2 / 2),
        stiffness * value + cables.residual * stretch,
        (stiffness * slope + cables.residual) / cables.length,
        stretch - 1,
    )


def cable_state(cables: Cables, x: Array) -> CableResponse:
    """The cells at node positions x (n, 3) m."""
    return law(cables, np.linalg.norm(x[cables.nodes[:, 1]] - x[cables.nodes[:, 0]], axis=1))


def cable_forces(cables: Cables, x: Array) -> PairForces:
    """Energy, gradients and exact Hessian, positive definite across and along each cell, at node
    positions x (n, 3) m."""
    reach = x[cables.nodes[:, 1]] - x[cables.nodes[:, 0]]
    length = np.linalg.norm(reach, axis=1)
    pull = law(cables, length)
    # of a cell of no length the residual tension alone is left: T0 / l0 in every direction
    across = np.divide(pull.force, length, out=cables.residual / cables.length, where=length > 0)
    unit = reach / np.where(length > 0, length, 1.0)[:, None]
    along = (pull.slope - across)[:, None, None] * unit[:, :, None] * unit[:, None, :]
    block = across[:, None, None] * np.eye(3) + along
    force = across[:, None] * reach
    return PairForces(
        float(pull.energy.sum()),
        np.stack([-force, force], axis=1),
        np.block([[block, -block], [-block, block]]),
    )


def cable_masses(cables: Cables, density: float, n: int) -> Array:
    """The masses (n,) kg of the nodes: half of each cell's at either end; density kg/m3."""
    half = density * cables.section * cables.length / 2
    mass = np.bincount(cables.nodes.ravel(), weights=np.repeat(half, 2), minlength=n)
    return mass.astype(float)
