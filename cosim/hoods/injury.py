"""A hood as an injury or its repair leaves it: meshes and nets before they are built."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce

import numpy as np

from cosim.errors import InputError
from cosim.hoods.lesion import LesionConfig
from cosim.port import Array, Motion
from meshes.cable_net import CableNet
from meshes.hood_mesh import Attachment, HoodMesh
from meshes.hull import DIP, PIP
from meshes.severed import cut_net, cut_part

STRUT = 5e-3
"""m, of the three springs at right angles by which a bone holds a node in every direction; long
against what the node gives way."""


@dataclass(frozen=True)
class Adhesion:
    """What holds a part on a bone: three springs at each node, `stiffness` N/m of all of them."""

    held: Attachment
    stiffness: float


def apply_lesion_to_mesh(mesh: HoodMesh, lesion: LesionConfig | None) -> HoodMesh:
    """The mesh with all cuts made.  Raises InputError."""
    return reduce(cut_part, lesion.cut if lesion else (), mesh)


def apply_lesion_to_net(net: CableNet, lesion: LesionConfig | None) -> CableNet:
    """The net with all cuts made.  Raises InputError."""
    return reduce(cut_net, lesion.cut if lesion else (), net)


def longer(extra: Mapping[str, float], lesion: LesionConfig | None) -> dict[str, float]:
    """m, how much longer than laid each part is, with what a lesion adds to it or takes."""
    out = dict(extra)
    for name, more in (lesion.length_changes() if lesion else {}).items():
        out[name] = out.get(name, 0.0) + more
    return out


def adhesions(
    lesion: LesionConfig | None, hood: HoodMesh | CableNet, points: Array, rest: Motion
) -> dict[str, Adhesion]:
    """By part and bone, what holds the parts of a mesh or net that have grown onto bones; its nodes
    lie at `points` (n, 3) m in the poses `rest`.  Raises InputError."""
    out = {}
    for part in lesion.adhere if lesion else ():
        nodes = _nodes(hood, part)
        beneath = _bone_beneath(hood.station[nodes])
        for i in np.unique(beneath):
            body, own = rest.bodies[i], nodes[beneath == i]
            local = (points[own] - rest.position[i]) @ rest.rotation[i]
            anchors = (local[:, None] + STRUT * np.eye(3)).reshape(-1, 3)
            stiffness = 3 * lesion.adhesion * len(own) / len(nodes) if lesion else 0.0
            held = Attachment(body, np.repeat(own, 3), anchors)
            out[f"adhesion_{part}_{body}"] = Adhesion(held, stiffness)
    return out


def _bone_beneath(station: Array) -> np.ndarray:
    """(n,) index of the bone that a place (mm along the finger) lies over, from joint to joint."""
    return np.searchsorted([0.0, PIP, DIP], station, side="right")


def _nodes(hood: HoodMesh | CableNet, part: str) -> np.ndarray:
    """The free nodes of a part.  Raises InputError where it has none."""
    fixed = np.concatenate([*hood.ends.values(), *hood.tied.values()])
    nodes = np.setdiff1d(hood.part_cells(part), fixed)
    if not len(nodes):
        raise InputError(f"lesion.adhere: the hood has no {part} that could grow onto a bone")
    return nodes
