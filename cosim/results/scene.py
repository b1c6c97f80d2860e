"""What a picture shows."""

from __future__ import annotations

from cosim.build.models import Models
from cosim.coupling.equilibrium import Equilibrium
from cosim.hoods.view import HoodView, drawn
from cosim.results.data import Scene


def scene(models: Models, e: Equilibrium, view: HoodView | None) -> Scene:
    """The loaded finger."""
    bones = []
    for body, (vertices, faces) in models.bones.items():
        position, rotation = e.motion.of(body)
        bones.append((body, vertices @ rotation.T + position, faces))
    paths = {**models.lines(e.motion), **models.finger.tendon_paths(e.finger_state)}
    tendons = tuple(paths.items())
    tip = (models.finger.tip(e.finger_state), e.balance.tip_force)
    return Scene(None if view is None else drawn(view), tuple(bones), tendons, tip)
