"""The angles of two hinges in a row, which no body stands between, from the poses of the bodies.

With Q = R_p^T R_c Z^T = R(n1, a) R(n2, b), axes n1 and n2 in the parent's frame at zero angles,

    Q n2 = R(n1, a) n2   and   n1^T Q = n1^T R(n2, b),

so that a is the turn about n1 of n2's image and b that about n2 of n1's preimage: exact whether or
not the axes are normal to each other, and smooth functions of any Q near by.  `Angles` of
`hinge_angle` holds them with their derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.port import Array, Motion
from rigid.hoods.hinge_angle import Angles, HingeAngle
from rigid.hoods.reduced_kernels import chain_angles
from rigid.model import FingerModel, Segment, Vector, vector


@dataclass(frozen=True)
class Universal:
    """Two hinges from `parent` to `child`; unit axes in the parent's frame at zero angles, `zero`
    the child's rotation in its parent there."""

    names: tuple[str, str]
    parent: str
    child: str
    axes: tuple[Vector, Vector]
    zero: tuple[Vector, Vector, Vector]


Joint = HingeAngle | Universal


def joints_of(model: FingerModel) -> tuple[Joint, ...]:
    """Every joint of a finger, in its order."""
    pairs = zip(model.segments[:-1], model.segments[1:], strict=True)
    return tuple(_joint(before.name, body) for before, body in pairs if body.hinges)


def _joint(parent: str, body: Segment) -> Joint:
    axes = [_unit(np.array(body.rotation) @ hinge.axis) for hinge in body.hinges]
    names = [hinge.name for hinge in body.hinges]
    if len(axes) == 1:
        return HingeAngle(names[0], parent, body.name, vector(axes[0]), body.rotation)
    first, second = axes
    both = (vector(first), vector(second))
    return Universal((names[0], names[1]), parent, body.name, both, body.rotation)


def names_of(joints: Sequence[Joint]) -> tuple[str, ...]:
    """Names of the joints' angles."""
    return tuple(name for joint in joints for name in joint.names)


class UniversalChain(NamedTuple):
    """Joints in numbers, as `reduced_kernels.chain_angles` takes them."""

    place: NDArray[np.int64]
    axes: Array
    zero: Array


def chain_of(joints: Sequence[Joint], bodies: Sequence[str]) -> UniversalChain:
    """Between bodies by name."""
    place, axes, zero = [], [], []
    for joint in joints:
        ends = [bodies.index(body) for body in (joint.parent, joint.child)]
        for kind in (0,) if len(joint.names) == 1 else (1, 2):
            place.append([*ends, kind])
            axes.append(joint.axes)
            zero.append(joint.zero)
    return UniversalChain(np.array(place, dtype=np.int64), np.array(axes), np.array(zero))


def all_angles(chain: UniversalChain, motion: Motion) -> Angles:
    """The angles of every joint, in order."""
    rotation = np.ascontiguousarray(motion.rotation)
    return Angles(*chain_angles(chain.place, chain.axes, chain.zero, rotation))


def _unit(v: Array) -> Array:
    out: Array = v / np.linalg.norm(v)
    return out
