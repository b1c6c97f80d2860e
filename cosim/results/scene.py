"""What a picture shows."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cosim.build.models import Models
from cosim.coupling.equilibrium import Equilibrium
from cosim.hoods.view import HoodView, hood_field
from cosim.port import Array, Motion, Triangles
from cosim.results.parts import Scene


def scene(models: Models, e: Equilibrium, view: HoodView | None) -> Scene:
    """The loaded finger."""
    paths = {**models.lines(e.motion), **models.finger.tendon_paths(e.finger_state)}
    tendons = tuple(paths.items())
    tip = (models.finger.tip(e.finger_state), models.finger.tip_force(e.finger_state))
    hood = None if view is None else hood_field(view)
    return Scene(hood, bones_in_world(models.bones, e.motion), tendons, tip)


def bones_in_world(
    bones: Mapping[str, Triangles], motion: Motion
) -> tuple[tuple[str, Array, np.ndarray], ...]:
    """Name, vertices (n, 3) m in the world, and triangles of each bone."""
    out = []
    for body, (vertices, faces) in bones.items():
        position, rotation = motion.of(body)
        out.append((body, vertices @ rotation.T + position, faces))
    return tuple(out)
