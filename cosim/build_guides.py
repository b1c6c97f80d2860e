"""Where the tendons' ends slide: whether their lines clear the bone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from fe_solver.shell_hood import ShellHood as FeHood

STEPS = 50


def guide_depth(hood: FeHood) -> float:
    """m, how deep under the metacarpal's contact level the lines run on which the extensor tendons'
    ends slide, from where these were laid to the MCP; 0 where all stay above it.

    The bone would pinch the sheet against such a line, with a force that grows as the mesh gets
    finer.  (Intrinsic tendons, which run palmar of the axis, pass beside the head.)"""
    model = hood.model
    start = (model.reference[model.guides.node] - hood.rest.position[0]) @ hood.rest.rotation[0]
    start = start[start[:, 2] > 0]
    way = np.repeat(start[:, None], STEPS, axis=1)
    way[..., 0] = np.linspace(start[:, 0], 0.0, STEPS, axis=1)
    depths = (
        contact.offset.max() - contact.surface.distance(way.reshape(-1, 3)).value
        for contact in model.contacts
        if contact.body == 0
    )
    return max((float(d.max(initial=0.0)) for d in depths), default=0.0)
