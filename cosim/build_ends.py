"""The ends of a hood of finite elements: what its slips bear, and whether the lines on which its
tendons' ends slide clear the bone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cosim.port import State
from meshes.hull import to_the_joint

if TYPE_CHECKING:
    from fe_solver.shell_hood import ShellHood as FeHood


def slip_forces(hood: FeHood, state: State) -> dict[str, float]:
    """N, central (0 where nothing but the sheet holds it) and terminal."""
    forces = hood.group_forces(state)
    central = forces.get("central_slip", np.zeros(3))
    return {
        "central": float(np.linalg.norm(central)),
        "terminal": float(np.linalg.norm(forces["terminal_slip"])),
    }


def guide_depth(hood: FeHood) -> float:
    """m, how deep under the metacarpal's contact level the lines run on which the extensor tendons'
    ends slide, from where these were laid to the MCP; 0 where all stay above it.

    The bone would pinch the sheet against such a line, with a force that grows as the mesh gets
    finer.  (Intrinsic tendons, which run palmar of the axis, pass beside the head.)"""
    model = hood.model
    start = (model.reference[model.guides.node] - hood.rest.position[0]) @ hood.rest.rotation[0]
    way = to_the_joint(start[start[:, 2] > 0]).reshape(-1, 3)
    depths = (
        contact.offset.max() - contact.surface.distance(way).value
        for contact in model.contacts
        if contact.body == 0
    )
    return max((float(d.max(initial=0.0)) for d in depths), default=0.0)
