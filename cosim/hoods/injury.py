"""A hood as an injury or its repair leaves it: meshes, nets and networks before they are built."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from typing import TYPE_CHECKING

import numpy as np

from cosim.hoods.lesion import Lesion
from cosim.hoods.lumped.table import JOINTS, ConnectingTendon, NetworkHood, TwoBandHood
from cosim.port import Array, InputError, Motion

if TYPE_CHECKING:
    from meshes.cable_net import CableNet
    from meshes.hood_mesh import Attachment, HoodMesh

STRUT = 5e-3
"""m, of the three springs at right angles by which a bone holds a node in every direction; long
against what the node gives way."""


@dataclass(frozen=True)
class Adhesion:
    """What holds a part on a bone: three springs at each node, `stiffness` N/m of all of them."""

    held: Attachment
    stiffness: float


def injured_mesh(mesh: HoodMesh, lesion: Lesion | None) -> HoodMesh:
    """The mesh with all cuts made.  Raises InputError."""
    from meshes.severed import severed

    return reduce(severed, lesion.cut if lesion else (), mesh)


def injured_net(net: CableNet, lesion: Lesion | None) -> CableNet:
    """The net with all cuts made.  Raises InputError."""
    from meshes.severed import severed_net

    return reduce(severed_net, lesion.cut if lesion else (), net)


def longer(extra: Mapping[str, float], lesion: Lesion | None) -> dict[str, float]:
    """m, how much longer than laid each part is, with what a lesion adds to it or takes."""
    out = dict(extra)
    for name, more in (lesion.length_changes() if lesion else {}).items():
        out[name] = out.get(name, 0.0) + more
    return out


def adhesions(
    lesion: Lesion | None, hood: HoodMesh | CableNet, points: Array, rest: Motion
) -> dict[str, Adhesion]:
    """By part and bone, what holds the parts of a mesh or net that have grown onto bones; its nodes
    lie at `points` (n, 3) m in the poses `rest`.  Raises InputError."""
    from meshes.hood_mesh import Attachment

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
    from meshes.hull import DIP, PIP

    return np.searchsorted([0.0, PIP, DIP], station, side="right")


def _nodes(hood: HoodMesh | CableNet, part: str) -> np.ndarray:
    """The free nodes of a part.  Raises InputError where it has none."""
    from meshes.cable_net import CableNet

    if isinstance(hood, CableNet):
        cells = hood.cells[hood.strand == _place(hood.strands, part)]
    else:
        cells = hood.quads[hood.cells(part)]
    fixed = np.concatenate([*hood.ends.values(), *hood.tied.values()])
    nodes = np.setdiff1d(cells, fixed)
    if not len(nodes):
        raise InputError(f"lesion.adhere: the hood has no {part} that could grow onto a bone")
    return nodes


def _place(names: tuple[str, ...], name: str) -> int:
    return names.index(name) if name in names else -1


def injured_network(
    hood: NetworkHood | TwoBandHood, lesion: Lesion | None
) -> NetworkHood | TwoBandHood:
    """A hood in lumped form without the connecting tendons that are cut, others shorter or longer.

    Raises InputError where a muscle would be left to pull on nothing."""
    if lesion is None:
        return hood
    network = _as_network(hood) if isinstance(hood, TwoBandHood) else hood
    cut = {tendon for part in lesion.cut for tendon in _tendons(network, part, "cut")}
    left = {name: t for name, t in network.connecting.items() if name not in cut}
    for part, more in lesion.length_changes().items():
        for name in _tendons(network, part, "shorten" if more < 0 else "lengthen"):
            if name in left:
                tendon = left[name]
                left[name] = tendon.model_copy(update={"rest": tendon.rest + more})
    pulling = {t.muscle for t in left.values()}
    if idle := [t.muscle for t in network.connecting.values() if t.muscle not in pulling]:
        raise InputError(f"lesion.cut: leaves no connecting tendon for {idle[0]} to pull; cut less")
    return network.model_copy(update={"connecting": left})


def _tendons(hood: NetworkHood, part: str, key: str) -> list[str]:
    """The connecting tendons of a part: those that cross the PIP last are the central slip, those
    that cross the DIP the terminal one.  Raises InputError where there are none."""
    if part in hood.connecting:
        return [part]
    last = {"central_slip": JOINTS[1], "terminal_slip": JOINTS[2]}[part]
    found = [
        n for n, t in hood.connecting.items() if [j for j in JOINTS if j in t.arms][-1] == last
    ]
    if not found:
        raise InputError(f"lesion.{key}: no connecting tendon ends where a {part} does")
    return found


def _as_network(hood: TwoBandHood) -> NetworkHood:
    """The same two springs on one junction."""
    from cosim.hoods.lumped.build import band_tendons

    middle, lateral = band_tendons(hood)
    return NetworkHood.model_construct(
        kind="network",
        muscles=hood.muscles,
        connecting={
            "middle_band": ConnectingTendon.model_construct(
                muscle=hood.extensor, stiffness=middle, rest=0.0, arms=hood.middle
            ),
            "lateral_band": ConnectingTendon.model_construct(
                muscle=hood.extensor, stiffness=lateral, rest=0.0, arms=hood.lateral
            ),
        },
        operating_force=None,
        reduced=None,
    )
