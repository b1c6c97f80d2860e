"""What a shell hood looks like solved."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from cosim.build_ends import guide_depth
from cosim.port import Array, State

if TYPE_CHECKING:
    from fe_solver.shell_hood import ShellHood as FeHood
    from meshes.hood_mesh import HoodMesh
    from meshes.markers import Markers

CENTRAL = ("extensor_tendon_distal", "central_band", "central_slip")


@dataclass(frozen=True)
class HoodLook:
    """What there is to see of a solved shell hood; means over each quad, local axes 1 along the
    fibre (in the central region: along the finger), 2 across it."""

    points: Array
    """(n, 3) m, deformed."""
    reference: Array
    """(n, 3) m, as laid."""
    quads: np.ndarray
    region: np.ndarray
    """(ne,) index into REGIONS."""
    strain: Array
    """(ne, 3) Green-Lagrange E11, E22, 2 E12 of the mid-surface."""
    faces: Array
    """(ne, 2) E11 at the two faces."""
    stress: Array
    """(ne, 3) second Piola-Kirchhoff S11, S22, S12, Pa."""
    area: Array
    """(ne,) m2."""
    central: np.ndarray
    """(ne,) bool, the region over which strains are summed up: extensor tendon distal to the MCP,
    central band and central slip."""
    pressure: Array
    """(n,) Pa of the bones on the nodes."""
    spring_force: Mapping[str, float]
    """N, magnitude of each spring set's summed force."""
    spring_tension: Array
    """(ns,) N of every spring."""
    spring_set: tuple[str, ...]
    """(ns,) the set it is of."""
    spring_node: np.ndarray
    """(ns,) node of the hood that it holds."""
    penetration: float
    """m, the deepest."""
    guide_depth: float
    """m, of `build_ends.guide_depth`."""
    markers: Markers
    """Over the central region, along and across the finger."""


def looking_at(hood: FeHood, mesh: HoodMesh) -> Callable[[State], HoodLook]:
    """What there is to see at a state."""
    from meshes.markers import markers

    return partial(_look, hood, mesh, guide_depth(hood), markers(mesh, CENTRAL))


def _look(hood: FeHood, mesh: HoodMesh, depth: float, placed: Markers, state: State) -> HoodLook:
    from fe_solver.fields import contact_pressure, fields
    from fe_solver.springs import spring_state

    springs, forces = hood.model.springs, hood.group_forces(state)
    c = state.configuration
    field = fields(hood.model, c)
    return HoodLook(
        c.x,
        hood.model.reference,
        hood.model.quads,
        mesh.region,
        field.strain,
        field.faces,
        field.stress,
        hood.model.tables.weight.sum(axis=1),
        mesh.cells(*CENTRAL),
        contact_pressure(hood.model, c),
        {name: float(np.linalg.norm(forces[name])) for name in hood.groups},
        spring_state(springs, c.x, c.position, c.rotation).force,
        tuple(hood.groups[i] for i in springs.group),
        springs.node,
        max(0.0, -float(hood.gap(state).min())),
        depth,
        placed,
    )
