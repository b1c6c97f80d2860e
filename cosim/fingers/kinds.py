"""The kinds of finger: one line in FINGERS and one in the union for each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from cosim.errors import InputError
from cosim.fingers import fmu, hinge, index, normative, planar, robot
from cosim.fingers.chain import check_ways
from cosim.fingers.common import Extensor, MassiveFingerConfig
from cosim.fingers.kind import Anatomy, FingerKind
from cosim.fingers.own import AnatomicalFingerConfig, with_own_anatomy
from cosim.port import Finger, Triangles

if TYPE_CHECKING:
    from meshes.skeleton import Skeleton
    from rigid.chain.statics import ChainFinger
    from rigid.mjcf.hood import HoodParts
    from rigid.model import FingerModel

FINGERS: Mapping[str, FingerKind[Any]] = {
    kind.name: with_own_anatomy(kind)
    for kind in (index.KIND, *normative.KINDS, planar.KIND, hinge.KIND, robot.KIND, fmu.KIND)
}
NativeFinger = (
    index.IndexFingerConfig
    | normative.MiddleFingerConfig
    | normative.RingFingerConfig
    | normative.LittleFingerConfig
    | planar.PlanarFingerConfig
    | hinge.HingeFingerConfig
    | robot.RobotFingerConfig
)
"""The tables of those of our own."""
AnyFinger = NativeFinger | fmu.FmuFingerConfig
LEAST_ARM = 1e-3
"""m, of the joints about a held tip; some 2 deg of flexion in all."""


def native(finger: AnyFinger) -> NativeFinger:
    """The table of a finger of ours.  Raises InputError for one in an FMU."""
    if finger.kind == "fmu":
        kinds = words(kind for kind, of in FINGERS.items() if of.table.is_native)
        raise InputError(
            f'finger.kind = "fmu" can only be run; for this take another kind of finger: {kinds}'
        )
    return finger


def unit(finger: AnyFinger) -> fmu.FmuFingerConfig:
    """The table of a finger in an FMU.  Raises InputError for one of ours."""
    if finger.kind != "fmu":
        raise InputError(f'finger.kind = "{finger.kind}" is no FMU')
    return finger


def tip_support_kind(finger: AnyFinger) -> str:
    """What holds the fingertip: the word of `finger.tip.kind`; "fmu" of a unit's."""
    return finger.kind if finger.kind == "fmu" else finger.tip.kind


def live_finger(finger: NativeFinger, extensor: Extensor) -> ChainFinger:
    """The finger, with those tendons of its own that the hood leaves to it.

    Raises InputError for one that cannot be held where the case holds it."""
    build = FINGERS[finger.kind].build
    assert build is not None
    live = build(finger, extensor)
    if isinstance(finger, AnatomicalFingerConfig) and finger.tie:
        check_ways(finger, live, bones_of(finger, extensor))
    if finger.tip.kind not in ("point", "clamped"):
        return live
    if live.support_arm(live.start(finger.posture.angles())) < LEAST_ARM:
        # Its fingertip force would be as large as rounding and the hood's slightest pull make it.
        raise InputError(
            "finger.posture: a straight finger cannot be held at its tip (finger.tip.kind = "
            f'"{finger.tip.kind}"): no joint torque balances a force along it. Bend PIP or DIP by '
            'some degrees, or write finger.tip.kind = "free"'
        )
    return live


def finger_model(finger: NativeFinger, extensor: Extensor) -> FingerModel:
    """Bones, joints and tendons in words.  Raises InputError for a finger without a MuJoCo
    model."""
    model = FINGERS[finger.kind].model
    if model is None:
        raise InputError(f'finger.kind = "{finger.kind}" has no MuJoCo model; take another kind')
    return model(finger, extensor)


def mjcf(
    finger: NativeFinger,
    extensor: Extensor,
    tension: float,
    losses: Sequence[str] = (),
    hood: HoodParts | None = None,
) -> str:
    """The finger as MJCF that plain MuJoCo simulates, with a hood, all tendons at `tension` N; its
    first lines say what differs, `losses` among it.

    Raises InputError for one without a MuJoCo model."""
    from cosim.fingers.chain import joint_torques
    from rigid.mjcf.simulation import simulation_xml

    model = replace(finger_model(finger, extensor), meshes=bones_of(finger, extensor))
    left_out = {
        "ties from bone to bone (finger.tie): left out": getattr(finger, "tie", {}),
        "splints that are put on and taken off: left out": [
            s for s in finger.splint.values() if s.has_times
        ],
    }
    losses = *losses, *(words for words, some in left_out.items() if some)
    return simulation_xml(
        model,
        joint_torques(finger, model.joints),
        finger.posture.angles(),
        dict.fromkeys((*model.muscles, *(() if hood is None else hood.muscles)), tension),
        cast(MassiveFingerConfig, finger).gravity,
        losses,
        hood,
        finger.side(),
    )


def native_tendons(finger: AnyFinger, extensor: Extensor) -> tuple[str, ...]:
    """The finger's own, under a hood that leaves it so much."""
    if finger.kind == "fmu":
        return finger.tendons
    kind = FINGERS[finger.kind]
    return kind.tendons(finger) if kind.model is None else kind.model(finger, extensor).muscles


def skeleton_of(finger: NativeFinger) -> Skeleton:
    """Joints and lengths.  Raises InputError for a finger that no hood is laid out on."""
    skeleton = FINGERS[finger.kind].skeleton
    if skeleton is None:
        raise InputError(f'finger.kind = "{finger.kind}" has no skeleton; take another kind')
    return skeleton(finger)


def bones_of(finger: NativeFinger, extensor: Extensor) -> Mapping[str, Triangles]:
    """Surfaces in the bodies' frames, m."""
    bones = FINGERS[finger.kind].bones
    assert bones is not None
    return bones(finger, extensor)


def anatomy_of(finger: AnyFinger, extensor: Extensor) -> Anatomy:
    """What a hood is laid out on; of a finger in an FMU nothing is known."""
    kind = FINGERS[finger.kind]
    model = None if kind.model is None else kind.model(finger, extensor)
    hooded: tuple[str, ...] = ()
    if kind.model is not None and model is not None and extensor.central is not None:
        bare = kind.model(finger, Extensor()).muscles
        hooded = tuple(name for name in model.muscles if name not in bare)
    return Anatomy(
        kind.name,
        finger.anatomy_key(),
        None if kind.skeleton is None else kind.skeleton(finger),
        {} if kind.bones is None else kind.bones(finger, extensor),
        kind.width(finger),
        kind.eyelets(finger),
        model,
        hooded,
    )


def joint_ranges(finger: Finger) -> dict[str, tuple[float, float]]:
    """The range (rad) of each joint: the finger's own, or where it states none those of a posture
    in a case; without end of a joint that neither knows."""
    from rigid.fingers.anatomy import RANGES

    stated = {joint: r for joint, r in finger.ranges.items() if np.isfinite(r).all()}
    endless = (-np.inf, np.inf)
    return {joint: stated.get(joint, RANGES.get(joint, endless)) for joint in finger.joints}


def with_mass() -> str:
    """The kinds of ours that have mass, in words."""
    return words(k for k, of in FINGERS.items() if of.table.is_native and of.table.has_mass)


def words(kinds: Iterable[str]) -> str:
    """`finger.kind = "a", "b" or "c"`."""
    *first, last = (f'"{kind}"' for kind in kinds)
    return f"finger.kind = {', '.join(first)} or {last}"
