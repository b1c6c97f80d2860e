"""A hood as an injury or its repair leaves it: meshes and nets before they are built."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial, reduce

from cosim.hoods.lesion import LesionConfig
from meshes.cable_net import CableNet
from meshes.hood_mesh import HoodMesh
from meshes.severed import cut_net, cut_part, cut_part_of


def apply_lesion_to_mesh(mesh: HoodMesh, lesion: LesionConfig | None) -> HoodMesh:
    """The mesh with all cuts made.  Raises InputError."""
    if lesion is None:
        return mesh
    partly = (partial(cut_part_of, part=part, share=s) for part, s in lesion.cut_partly.items())
    whole = (partial(cut_part, part=part) for part in lesion.cut)
    cut = reduce(lambda left, make: make(left), (*partly, *whole), mesh)
    return replace(cut, whole=mesh)


def apply_lesion_to_net(net: CableNet, lesion: LesionConfig | None) -> CableNet:
    """The net with all cuts made.  Raises InputError."""
    if lesion is None:
        return net
    return replace(reduce(cut_net, lesion.cut, net), whole=net)


def longer(extra: Mapping[str, float], lesion: LesionConfig | None) -> dict[str, float]:
    """How much longer (m) than laid each part is, with what a lesion adds to it or takes."""
    out = dict(extra)
    for name, more in (lesion.length_changes() if lesion else {}).items():
        out[name] = out.get(name, 0.0) + more
    return out
