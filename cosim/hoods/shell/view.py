"""What a shell hood looks like solved."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from cosim.hoods.fe_view import Lines, Look, guide_depth, look_at
from cosim.hoods.shell.region_forces import Crossing, middle_crossings, region_forces
from cosim.port import Array, State
from meshes.skeleton import JOINTS

if TYPE_CHECKING:
    from fe_solver.hood.shell_hood import ShellHood as FeHood
    from meshes.hood_mesh import HoodMesh
    from meshes.markers import Markers
    from meshes.skeleton import Skeleton

SAME_LINE = 1e-9
"""rad, fibres and mesh lines nearer than that are one."""
CENTRAL = ("extensor_tendon_distal", "central_band", "central_slip")


@dataclass(frozen=True, kw_only=True)
class HoodLook(Look):
    """What there is to see of a solved shell hood; means over each quad, local axes 1 along the
    (first) fibre, 2 across it."""

    quads: np.ndarray
    region: np.ndarray
    """(ne,) index into REGIONS."""
    strain: Array
    """(ne, 3) Green-Lagrange E11, E22, 2 E12 of the mid-surface."""
    line_strain: Array
    """(ne, 3) the same along and across the mesh's own lines: along the finger, in sagittal bands
    round it.  Fibres whose direction a case gives lie at an angle to them."""
    faces: Array
    """(ne, 2) E11 at the two faces."""
    stress: Array
    """(ne, 3) second Piola-Kirchhoff S11, S22, S12, Pa."""
    tension: np.ndarray
    """(ne,) 0 taut, 1 wrinkled, 2 slack; -1 where the sheet bears compression."""
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
    region_force: Mapping[str, float]
    """N by region, of `cosim.hoods.shell.region_forces`."""


def looking_at(hood: FeHood, mesh: HoodMesh, skeleton: Skeleton) -> Callable[[State], HoodLook]:
    """What there is to see at a state; the mesh lies on a finger of that skeleton."""
    from meshes.bands import sheet_bands
    from meshes.glide import sheet_places
    from meshes.markers import markers

    turn = _line_angle(hood, mesh)
    lines = Lines(sheet_places(mesh), sheet_bands(mesh), skeleton.axis[JOINTS.index("PIP")])
    crossings = middle_crossings(mesh, skeleton)
    depth, placed = guide_depth(hood), markers(mesh, CENTRAL)
    return partial(_look, hood, mesh, depth, lines, placed, turn, crossings)


def _line_angle(hood: FeHood, mesh: HoodMesh) -> Array:
    """(ne,) rad from the fibre to the mesh's own line in each element, 0 where they are one."""
    from cosim.hoods.shell.fibres import at_gauss_points
    from fe_solver.elements.fibres import angle_between

    fibre, lines = hood.model.tables.frame[:, :, 0], at_gauss_points(mesh, mesh.fibre)
    angle = angle_between(hood.model.reference, mesh.quads, fibre, lines)
    twice = np.stack([np.cos(2 * angle), np.sin(2 * angle)]).mean(axis=2)
    mean = np.arctan2(twice[1], twice[0]) / 2
    return np.where(np.abs(mean) < SAME_LINE, 0.0, mean)


def _turned(strain: Array, angle: Array) -> Array:
    """(ne, 3) strains E11, E22, 2 E12 (ne, 3) on axes turned by angle (ne,), rad."""
    c, s = np.cos(angle), np.sin(angle)
    e1, e2, shear = strain.T
    along = c * c * e1 + s * s * e2 + s * c * shear
    across = s * s * e1 + c * c * e2 - s * c * shear
    return np.stack([along, across, 2 * s * c * (e2 - e1) + (c * c - s * s) * shear], axis=1)


def _look(
    hood: FeHood,
    mesh: HoodMesh,
    depth: float,
    lines: Lines,
    placed: Markers,
    turn: Array,
    crossings: Mapping[str, Crossing],
    state: State,
) -> HoodLook:
    from fe_solver.hood.fibre_families import fibre_families
    from fe_solver.solver.fields import contact_pressure, fields

    field = fields(hood.model, state.configuration)
    return HoodLook(
        **vars(look_at(hood, depth, lines, state)),
        quads=hood.model.quads,
        region=mesh.region,
        strain=field.strain,
        line_strain=_turned(field.strain, turn),
        faces=field.faces,
        stress=field.stress,
        tension=field.tension,
        area=hood.model.tables.weight.sum(axis=1),
        central=mesh.cells(*CENTRAL),
        pressure=contact_pressure(hood.model, state.configuration),
        fibres=fibre_families(hood.model, state.configuration),
        markers=placed,
        region_force=region_forces(hood, crossings, state),
    )
