"""A finger as MJCF that plain MuJoCo can simulate: what the live finger computes for itself, in the
words that MuJoCo has.

Linear springs are exact.  A torque curve becomes MuJoCo's polynomial of third degree about its
rest, fitted where the curve is no stop.  A limit becomes MuJoCo's own, at the angle where ours
bears BEARING; ours gives way with the fourth root of the torque, so that one tenth or ten times of
BEARING are 0.2 and 0.3 degrees away.  Damping and armature that a case does not state are chosen
for a stable simulation and change no equilibrium.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cosim.port import Array, Hand
from rigid.chain.joint_torques import JointLaw, TorqueCurve
from rigid.mjcf.hood import HeldModel, HoodParts, add_hood, compile_model
from rigid.mjcf.write import mirror_tree, mjcf_tree
from rigid.model import FingerModel, Surface

BEARING = 0.03
"""N m, beyond springs and curve, that a limit bears at the angle that the file states."""
STOP = 1.5
"""A curve is a stop where it is so many times as stiff as at its rest; it is not fitted there."""
FLAT = 1e-3
"""Of the largest slope: below it a curve counts as flat."""
SMALL_TORQUE = 0.05
"""Of the largest torque: below it a curve's fit asks for the same difference everywhere."""
DAMPING, ARMATURE = 1e-3, 1e-5
"""N m s/rad of joints without a stated damping, and kg m2: small beside muscles, large enough for
steps of TIMESTEP with the inertia of a fingertip."""
TIMESTEP = 1e-3
"""s."""
CELL = 1.5e-3
"""m, the size of the details that a bone's surface keeps in the file."""
ANATOMY = "anatomical_range_"
"""Before a joint's name: the number that keeps its range where the file's limits are narrower."""
WIDEST = np.radians(180.0)


def simulation_xml(
    model: FingerModel,
    law: JointLaw,
    posture: Mapping[str, float],
    tension: Mapping[str, float],
    gravity: Sequence[float] = (0.0, 0.0, 0.0),
    losses: Sequence[str] = (),
    hood: HoodParts | None = None,
    hand: Hand = "right",
) -> str:
    """Return the finger as a MuJoCo model (MJCF text) with the passive torques and limits of `law`,
    with a hood, and the keyframe "posture": joint angles (rad) and tensions (N).  `gravity` (3,)
    m/s2; `losses`: what else the file lacks, for its first lines; `hand`: the left one is the
    finger's mirror image."""
    meshes = {body: coarse_surface(surface) for body, surface in model.meshes.items()}
    root = mjcf_tree(replace(model, meshes=meshes), gravity)
    root[:0] = [ET.Comment(f" {text} ") for text in (*losses, *_deviations(law))]
    option = root.find("option")
    assert option is not None
    option.attrib |= {"timestep": repr(TIMESTEP), "integrator": "implicitfast"}
    custom = ET.SubElement(root, "custom")
    for joint in root.iter("joint"):
        i = law.joints.index(joint.attrib["name"])
        _add_anatomy(custom, joint)
        joint.attrib |= _passive(law, i)
    muscles, slides = model.muscles, dict[str, float]()
    if hood is not None:
        held = HeldModel(compile_model(add_hood(root, hood)), law.joints, hood)
        angles = np.array([posture.get(joint, 0.0) for joint in law.joints])
        held.settle(angles, {name: tension[name] for name in hood.muscles})
        muscles, slides = (*muscles, *hood.muscles), held.slides()
    frame = {
        "name": "posture",
        "qpos": _numbers([*(posture.get(joint, 0.0) for joint in law.joints), *slides.values()]),
    }
    if muscles:
        frame["ctrl"] = _numbers(tension[name] for name in muscles)
    ET.SubElement(ET.SubElement(root, "keyframe"), "key", frame)
    if hand == "left":
        mirror_tree(root)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode")


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(x)) for x in values)


def coarse_surface(surface: Surface, cell: float = CELL) -> Surface:
    """Return a surface with one vertex, the mean, in each cube of `cell` m, rounded to 1 um."""
    vertices, faces = np.asarray(surface[0]), np.asarray(surface[1])
    _, cube = np.unique(np.floor(vertices / cell).astype(int), axis=0, return_inverse=True)
    cube = cube.ravel()
    count = np.bincount(cube)
    mean = np.stack([np.bincount(cube, weights=x) / count for x in vertices.T], axis=1)
    kept = cube[faces]
    a, b, c = kept.T
    kept = kept[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(np.sort(kept, axis=1), axis=0, return_index=True)
    used, renamed = np.unique(kept[np.sort(first)], return_inverse=True)
    triangles: Any = renamed.reshape(-1, 3)
    return np.round(mean[used], 6), triangles


def _deviations(law: JointLaw) -> list[str]:
    """What the file's torques differ by from the law's, in words."""
    out = []
    for joint, curve in law.curves.items():
        rest, coefficients, angle = _polynomial(curve)
        torque = np.array([curve(q)[0] for q in angle])
        off = 1e3 * np.abs(_powers(angle - rest) @ coefficients + torque).max()
        ends = " to ".join(f"{np.degrees(q):.1f}" for q in (angle[0], angle[-1]))
        out.append(f"{joint}: polynomial, at most {off:.2g} N mm off its curve from {ends} deg")
    if np.isfinite([law.lower, law.upper]).any() or law.curves:
        out.append(
            f"limits: MuJoCo's, where ours bear {1e3 * BEARING:g} N mm; ours give way by up to 0.3 "
            "deg more or less between 3 and 300 N mm"
        )
    return out


def _add_anatomy(custom: ET.Element, joint: ET.Element) -> None:
    if "range" in joint.attrib:
        facts = {"name": ANATOMY + joint.attrib["name"], "data": joint.attrib["range"]}
        ET.SubElement(custom, "numeric", facts)


def _passive(law: JointLaw, i: int) -> dict[str, str]:
    """MuJoCo's words for the torques of a joint, which has a spring or a curve."""
    damping = 0.0 if law.damping is None else float(law.damping[i])
    facts = {"damping": repr(damping or DAMPING), "armature": repr(ARMATURE)}
    curve = law.curves.get(law.joints[i])
    rest, coefficients = float(law.rest[i]), np.array([float(law.stiffness[i])])
    if curve is not None:
        rest, coefficients, _ = _polynomial(curve)
    if coefficients.any():
        stiffness = " ".join(repr(float(k)) for k in coefficients)
        facts |= {"stiffness": stiffness, "springref": repr(float(rest))}
    low, high = (_bearing_angle(law, i, rest, coefficients, sign) for sign in (-1, 1))
    if low > -WIDEST or high < WIDEST:
        facts |= {
            "limited": "true",
            "range": f"{low!r} {high!r}",
            "solreflimit": f"{2 * TIMESTEP!r} 1",
            "solimplimit": "0.99 0.999 0.001",
        }
    return facts


def _polynomial(curve: TorqueCurve) -> tuple[float, Array, Array]:
    """The angle (rad) without torque, stiffnesses (3,) of first to third power of the way from
    there, and the angles at which they were fitted, the more closely the smaller the torque."""
    angle = np.linspace(curve.angle[0], curve.angle[-1], 501)
    torque, slope = np.array([curve(q) for q in angle]).T
    at = int(np.argmin(np.abs(torque)))
    rest = float(angle[at] - torque[at] / slope[at]) if slope[at] else float(angle[at])
    stop = np.abs(slope) > STOP * max(abs(slope[at]), FLAT * np.abs(slope).max())
    low = angle[:at][stop[:at]]
    high = angle[at:][stop[at:]]
    within = (angle > (low[-1] if low.size else -np.inf)) & (
        angle < (high[0] if high.size else np.inf)
    )
    if within.sum() > len(_powers(angle[:1])[0]):
        angle, torque = angle[within], torque[within]
    weight = 1 / (np.abs(torque) + SMALL_TORQUE * np.abs(torque).max())
    powers = _powers(angle - rest)
    scale = np.abs(powers).max(axis=0)
    fitted = np.linalg.lstsq(weight[:, None] * powers / scale, -weight * torque, rcond=None)[0]
    return rest, fitted / scale, angle


def _powers(way: Array) -> Array:
    return np.stack([way, way**2, way**3], axis=1)


def _bearing_angle(law: JointLaw, i: int, rest: float, coefficients: Array, sign: int) -> float:
    """The angle (rad) to one side at which our law bears BEARING more than the file's spring;
    WIDEST where it never does."""

    def excess(q: float) -> float:
        at = law.rest.copy()
        at[i] = q
        whole = float(law.passive(at)[0][i] + law.limit(at)[0][i])
        spring = float(_powers(np.array([q - rest]))[0, : len(coefficients)] @ coefficients)
        return -sign * (whole + spring) - BEARING

    start = min(max(rest, float(law.lower[i])), float(law.upper[i]))
    for q in start + sign * np.arange(0.0, WIDEST, np.radians(1.0)):
        beyond = q + sign * np.radians(1.0)
        if excess(beyond) >= 0:
            from scipy.optimize import brentq

            return float(brentq(excess, q, beyond)) if excess(q) < 0 else float(q)
    return sign * WIDEST
