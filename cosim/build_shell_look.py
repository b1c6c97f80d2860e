"""What a shell hood looks like solved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from cosim.build_ends import Look, guide_depth, look_at
from cosim.port import Array, State

if TYPE_CHECKING:
    from fe_solver.shell_hood import ShellHood as FeHood
    from meshes.hood_mesh import HoodMesh
    from meshes.markers import Markers

CENTRAL = ("extensor_tendon_distal", "central_band", "central_slip")


@dataclass(frozen=True, kw_only=True)
class HoodLook(Look):
    """What there is to see of a solved shell hood; means over each quad, local axes 1 along the
    fibre (in the central region: along the finger), 2 across it."""

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
    fibres: Array
    """(nf, ne, 3) unit directions of the fibre families, zero on quads without; nf may be 0."""
    markers: Markers
    """Over the central region, along and across the finger."""


def looking_at(hood: FeHood, mesh: HoodMesh) -> Callable[[State], HoodLook]:
    """What there is to see at a state."""
    from meshes.markers import markers

    return partial(_look, hood, mesh, guide_depth(hood), markers(mesh, CENTRAL))


def _look(hood: FeHood, mesh: HoodMesh, depth: float, placed: Markers, state: State) -> HoodLook:
    from fe_solver.fibre_families import fibre_families
    from fe_solver.fields import contact_pressure, fields

    field = fields(hood.model, state.configuration)
    return HoodLook(
        **vars(look_at(hood, depth, state)),
        quads=hood.model.quads,
        region=mesh.region,
        strain=field.strain,
        faces=field.faces,
        stress=field.stress,
        area=hood.model.tables.weight.sum(axis=1),
        central=mesh.cells(*CENTRAL),
        pressure=contact_pressure(hood.model, state.configuration),
        fibres=fibre_families(hood.model, state.configuration),
        markers=placed,
    )
