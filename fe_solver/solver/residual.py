"""How far a configuration is from an equilibrium, and whether its directors stand upright."""

from __future__ import annotations

import numpy as np

from cosim.port import Array
from fe_solver.solver.assembly import DOFS
from fe_solver.solver.model import Configuration, Evaluation, ShellModel

ITERATION = "the hood's iteration {}, residual {:.1e} N against forces of {:.1e} N"
"""What a solve says of an iteration."""

UPRIGHT = 0.05
"""Cosine of the angle between a director and its elements' normals that no step goes below."""


def length_scale(model: ShellModel) -> float:
    """Root of the mean element area, or the mean length of cells where there are but cables, m."""
    if not len(model.quads):
        return float(model.cables.length.mean())
    return float(np.sqrt(model.tables.weight.sum() / len(model.quads)))


def residual_norm(model: ShellModel, e: Evaluation) -> tuple[float, float]:
    """Largest residual and largest nodal force, both N."""
    left = e.reduced[model.free]
    turns = model.free % DOFS > 2
    left[turns] /= length_scale(model)
    forces = [np.abs(e.gradient_x).max(), np.abs(e.points.gradient).max(initial=0.0)]
    return float(np.abs(left).max(initial=0.0)), float(max(forces))


def rounding(c: Configuration, stiffest: float) -> float:
    """What of the residual is rounding error (N): the tangent's stiffest entry (N/m) times the last
    bit of the coordinates."""
    return float(0.2 * np.finfo(float).eps * stiffest * np.abs(c.x).max())


def stiffest_entry(model: ShellModel, data: Array) -> float:
    """The largest entry (N/m) of the tangent's blocks by the nodes' displacements."""
    return float(np.abs(data[model.pattern.diagonal[:, :3, :3]]).max())


def is_folded(model: ShellModel, c: Configuration) -> bool:
    """Whether a director lies, or nearly, in the plane of one of its elements."""
    return bool(director_cosines(model, c).min(initial=1.0) <= UPRIGHT)


def director_cosines(model: ShellModel, c: Configuration) -> Array:
    """The cosines (ne, 4) of the angles between the quads' normals and their corners' directors, on
    the side on which these were at first."""
    return model.side * model.cosines(c.x, c.d)
