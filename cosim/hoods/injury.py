"""A hood as an injury or its repair leaves it: meshes and nets before they are built."""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce

from cosim.hoods.lesion import LesionConfig
from meshes.cable_net import CableNet
from meshes.hood_mesh import HoodMesh
from meshes.severed import cut_net, cut_part


def apply_lesion_to_mesh(mesh: HoodMesh, lesion: LesionConfig | None) -> HoodMesh:
    """The mesh with all cuts made.  Raises InputError."""
    return reduce(cut_part, lesion.cut if lesion else (), mesh)


def apply_lesion_to_net(net: CableNet, lesion: LesionConfig | None) -> CableNet:
    """The net with all cuts made.  Raises InputError."""
    return reduce(cut_net, lesion.cut if lesion else (), net)


def longer(extra: Mapping[str, float], lesion: LesionConfig | None) -> dict[str, float]:
    """How much longer (m) than laid each part is, with what a lesion adds to it or takes."""
    out = dict(extra)
    for name, more in (lesion.length_changes() if lesion else {}).items():
        out[name] = out.get(name, 0.0) + more
    return out
