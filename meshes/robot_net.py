"""The cable hood of a finger whose one extensor pulls: the net without what its other muscles pull,
and the bones of a finger of other lengths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cosim.port import Array, Ints
from meshes.bones import bone_surface
from meshes.cable_net import CableNet, cable_of
from meshes.skeleton import BODIES, Skeleton, index_finger

OTHERS = ("indicis_tendon", "intrinsic_tendon")


def straight_skeleton(lengths: tuple[float, float, float]) -> Skeleton:
    """Phalanges (m) in one line at zero angles, all joints about y but the abduction about z."""
    flexion, abduction = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    axes = np.array([flexion, abduction, flexion, flexion])
    return Skeleton(np.array([0.0, *lengths]), np.tile(np.eye(3), (3, 1, 1)), axes, {})


def _longer(skeleton: Skeleton) -> Array:
    """The ratios (3,) of the phalanges' lengths to the human index finger's."""
    return np.asarray(skeleton.length[1:] / index_finger().length[1:])


def wider(skeleton: Skeleton) -> float:
    """The finger's breadth over the human index finger's: the mean of its phalanges' lengths over
    that finger's."""
    return float(_longer(skeleton).mean())


def bones_of(skeleton: Skeleton) -> dict[str, tuple[Array, Ints]]:
    """The human index finger's, each as long as its phalanx of the skeleton and all wider by the
    phalanges' mean, as is the metacarpal longer: vertices (n, 3) m and faces, in their frames."""
    along = np.concatenate([[wider(skeleton)], _longer(skeleton)])
    return {
        body: bone_surface(body, float(factor), wider(skeleton))
        for body, factor in zip(BODIES, along, strict=True)
    }


def keep_extensor(net: CableNet) -> CableNet:
    """The net whose only loaded end is the extensor's: other muscles' tendons left out, its nodes
    numbered anew."""
    left = [name for name in net.strands if cable_of(name) not in OTHERS]
    kept = np.array([name in left for name in net.strands])[net.strand]
    nodes = np.unique(net.cells[kept])
    new = np.full(len(net.points), -1)
    new[nodes] = np.arange(len(nodes))
    strands = [net.strands[i] for i in net.strand[kept]]
    return replace(
        net,
        points=net.points[nodes],
        cells=new[net.cells[kept]],
        strand=np.array([left.index(name) for name in strands]),
        strands=tuple(left),
        ends={"central": new[net.ends["central"]]},
        springs={name: replace(held, nodes=new[held.nodes]) for name, held in net.springs.items()},
        tied={name: new[nodes] for name, nodes in net.tied.items()},
        station=net.station[nodes],
    )
