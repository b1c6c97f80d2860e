"""What a picture shows."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cosim.build.models import Models
from cosim.coupling.equilibrium import Equilibrium
from cosim.hoods.cable.build import CableLook
from cosim.hoods.shell.view import HoodLook
from cosim.port import Array, Motion, Triangles
from cosim.results.parts import STRAIN, HoodField, Scene
from cosim.results.strokes import FAMILIES
from meshes.hood_mesh import flat

Look = HoodLook | CableLook


def scene(models: Models, e: Equilibrium, look: Look | None) -> Scene:
    """The loaded finger."""
    paths = {**models.strings(e.motion), **models.finger.tendon_paths(e.finger_state)}
    tendons = tuple(paths.items())
    tip = (models.finger.tip(e.finger_state), e.balance.tip_force)
    return Scene(drawn_hood(look), placed_bones(models.bones, e.motion), tendons, tip)


def placed_bones(
    bones: Mapping[str, Triangles], motion: Motion
) -> tuple[tuple[str, Array, np.ndarray], ...]:
    """Name, vertices (n, 3) m in the world, and triangles of each bone."""
    out = []
    for body, (vertices, faces) in bones.items():
        position, rotation = motion.of(body)
        out.append((body, vertices @ rotation.T + position, faces))
    return tuple(out)


def drawn_hood(look: Look | None) -> HoodField | None:
    """The hood as pictures and mesh files show it; None where there is no deformable one."""
    if look is None:
        return None
    if isinstance(look, CableLook):
        return HoodField(
            look.points,
            look.cells,
            {"displacement": look.points - look.reference, "contact_force": look.contact_force},
            {
                STRAIN: np.maximum(look.strain, 0.0),  # a slack cable has none
                "end_to_end_strain": look.strain,
                "tension": look.tension,
                "strand": look.strand,
            },
        )
    quads = flat(look.quads)
    each = len(quads) // len(look.quads)
    cell_data = {
        STRAIN: look.strain[:, 0],
        "transverse_strain": look.strain[:, 1],
        "shear_strain": look.strain[:, 2] / 2,
        "inner_face_strain": look.faces[:, 0],
        "outer_face_strain": look.faces[:, 1],
        "fibre_stress": look.stress[:, 0],
        "transverse_stress": look.stress[:, 1],
        "region": look.region,
    }
    cell_data |= dict(zip(FAMILIES, look.fibres, strict=False))
    if (look.tension >= 0).any():
        cell_data["tension_state"] = look.tension
    return HoodField(
        look.points,
        quads,
        {"displacement": look.points - look.reference, "contact_pressure": look.pressure},
        {name: np.repeat(values, each, axis=0) for name, values in cell_data.items()},
    )
