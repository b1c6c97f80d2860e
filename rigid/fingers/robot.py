"""The robotic finger as a finger model: five tendons, or six with a second extensor.

A fit to table III, not a reconstruction: the paper's points are not at hand.  Ten unknowns make its
20 numbers:

* radii of the cylinders about the MCP, PIP and DIP axes that the extensor wraps (in the default
  posture too, so that a radius is the arm): R, (LONG + SHORT) r_PIP, LONG r_DIP;
* z of the flexors' guides on proximal, middle and distal phalanx (equal columns of table III at
  MCP and PIP say that both flexors run through the same ones);
* y and z of the ends of the abduction and the adduction tendon, straight lines beside the joint.

In other postures the tendons but the extensor also touch a sphere about the MCP, the metacarpal's
head; in the default one they clear it.

The nine zeros hold by symmetry, or since a tendon ends before the joint.  The extensor's long
branch ends on the distal phalanx, one short one on the middle, one on the proximal phalanx: the
three insertions of the human extensor (assumption; the paper prints the weights alone).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.optimize import brentq, fsolve

from cosim.port import Array
from rigid.fingers import robot_tables as tables
from rigid.fingers.anatomy import RANGES
from rigid.fingers.robot_tables import LONG, SHORT, TABLE_III
from rigid.model import (
    FingerModel,
    Hinge,
    PathElement,
    Segment,
    Strand,
    Tendon,
    Via,
    WrapCylinder,
    WrapSphere,
)

MM = 1e-3
ROD_RADIUS = 0.005
"""m, assumption: the phalanges' inertia is that of uniform rods of this radius."""
FLEXION = (0.0, 1.0, 0.0)
HEAD = WrapSphere("metacarpal", (0.0, 0.0, 0.0), tables.HEAD_RADIUS * MM)
AXES = {"MCP_abduction": (0.0, 0.0, 1.0)}
Point = tuple[float, float, float]


@lru_cache(maxsize=2)
def robot_finger(second_extensor: bool = False) -> FingerModel:
    """The finger of tables I to III; with the second extensor, one to the proximal phalanx alone,
    and the central one left to the middle and distal phalanges (the paper says that it rearranged
    the attachments and not how: both are assumptions)."""
    tendons: tuple[Tendon, ...] = (
        _extensor(tables.TENDONS[0], to_proximal=not second_extensor),
        *_flexors(),
        _side_tendon("abduction", 1.0),
        _side_tendon("adduction", -1.0),
    )
    if second_extensor:
        tendons += (Tendon(tables.SECOND_EXTENSOR, (Strand(_over_mcp()),)),)
    tip = (tables.LENGTHS[2], 0.0, 0.0)
    name = "robotic finger" + (", six tendons" if second_extensor else "")
    return FingerModel(name, _segments(), tip, tendons)


def _segments() -> tuple[Segment, ...]:
    metacarpal = Segment("metacarpal", tables.ORIGIN * MM, radius=0.006)
    joints = (("MCP", "MCP_abduction"), ("PIP",), ("DIP",))
    phalanges = zip(
        ("proximal", "middle", "distal"),
        tables.LENGTHS,
        tables.MASSES,
        joints,
        (0.0, *tables.LENGTHS[:2]),
        strict=True,
    )
    return metacarpal, *(_phalanx(*each) for each in phalanges)


def _phalanx(
    name: str, length: float, mass: float, joints: tuple[str, ...], before: float
) -> Segment:
    across = mass * (3 * ROD_RADIUS**2 + length**2) / 12
    return Segment(
        name,
        length,
        (before, 0.0, 0.0),
        hinges=tuple(Hinge(j, AXES.get(j, FLEXION), RANGES[j]) for j in joints),
        mass=mass,
        inertia=(mass * ROD_RADIUS**2 / 2, across, across),
        centre=(length / 2, 0.0, 0.0),
        radius=ROD_RADIUS,
    )


def _via(body: str, point: Point) -> Via:
    x, y, z = point
    return Via(body, (x * MM, y * MM, z * MM))


def _dorsal(body: str, joint_x: float, radius: float) -> WrapCylinder:
    """About a flexion axis; the tendon's side is half-way along the arc that it covers."""
    aside = 1.5 * radius * np.sqrt(0.5) * MM
    centre = (joint_x * MM, 0.0, 0.0)
    return WrapCylinder(body, centre, FLEXION, radius * MM, (centre[0] + aside, 0.0, aside))


def _extensor(name: str, to_proximal: bool) -> Tendon:
    """The pulley: half the tension to the distal phalanx, a quarter each to two more ends; where
    the proximal phalanx has an extensor of its own, both quarters to the middle one."""
    proximal, middle = (1e3 * length for length in tables.LENGTHS[:2])
    shorts = 1 if to_proximal else 2
    over_pip = _dorsal("proximal", proximal, TABLE_III[2, 0] / (LONG + SHORT))
    over_dip = _dorsal("middle", middle, TABLE_III[3, 0] / LONG)
    to_middle = (
        *_over_mcp(),
        _via("proximal", tables.EXTENSOR_BEFORE_PIP),
        over_pip,
        _via("middle", tables.EXTENSOR_AFTER_PIP),
    )
    to_distal = (
        *to_middle,
        _via("middle", tables.EXTENSOR_BEFORE_DIP),
        over_dip,
        _via("distal", tables.EXTENSOR_DISTAL),
    )
    strands = [Strand(to_distal, LONG), *[Strand(to_middle, SHORT)] * shorts]
    if to_proximal:
        strands.append(Strand(_over_mcp(), SHORT))
    return Tendon(name, tuple(strands))


def _over_mcp() -> tuple[PathElement, ...]:
    x, y, z = tables.EXTENSOR_GUIDE
    return (
        _via("metacarpal", (tables.ORIGIN, y, z)),
        _via("metacarpal", (x, y, z)),
        _dorsal("metacarpal", 0.0, TABLE_III[0, 0]),
        _via("proximal", tables.EXTENSOR_PROXIMAL),
    )


def _flexors() -> tuple[Tendon, Tendon]:
    """To the distal and to the middle phalanx, through the same guides."""
    x, y, z = tables.FLEXOR_GUIDE
    proximal, middle = (1e3 * length for length in tables.LENGTHS[:2])
    first = _height((x, z), tables.FLEXOR_PROXIMAL, _arm(0, 1))
    second = _height((tables.FLEXOR_PROXIMAL - proximal, first), tables.FLEXOR_MIDDLE, _arm(2, 1))
    third = _height((tables.FLEXOR_MIDDLE - middle, second), tables.FLEXOR_DISTAL, _arm(3, 1))
    common = (
        _via("metacarpal", (tables.ORIGIN, y, z)),
        _via("metacarpal", (x, y, z)),
        HEAD,
        _via("proximal", (tables.FLEXOR_PROXIMAL, 0.0, first)),
        _via("middle", (tables.FLEXOR_MIDDLE, 0.0, second)),
    )
    to_distal = (*common, _via("distal", (tables.FLEXOR_DISTAL, 0.0, third)))
    return Tendon("dip_flexor", (Strand(to_distal),)), Tendon("pip_flexor", (Strand(common),))


def _arm(joint: int, tendon: int) -> float:
    """The moment arm, mm, positive where the tendon turns the joint in its positive sense."""
    return -float(TABLE_III[joint, tendon])


def _height(before: tuple[float, float], x: float, arm: float) -> float:
    """The height, mm: z of the point at `x` that a straight line from `before` (x, z) must run to,
    to pass `arm` palmar of the origin."""

    def miss(z: float) -> float:
        along = np.array([before[0] - x, before[1] - z])
        return float((z * along[0] - x * along[1]) / np.hypot(*along)) - arm

    return float(brentq(miss, -3 * arm, 0.0, xtol=1e-13))


def _side_tendon(name: str, side: float) -> Tendon:
    """Beside the MCP; `side`: +1 radial, -1 ulnar."""
    k = tables.TENDONS.index(name)
    x, y, z = tables.SIDE_GUIDE
    guide = np.array([x, side * y, z])
    wanted = np.array([_arm(0, k), _arm(1, k)])

    def miss(end: Array) -> Array:
        point = np.array([tables.SIDE_END, *end])
        along = guide - point
        return np.cross(point, along / np.linalg.norm(along))[1:] - wanted

    end_y, end_z = fsolve(miss, [wanted[1], -wanted[0]], xtol=1e-13)
    path = (
        _via("metacarpal", (tables.ORIGIN, float(guide[1]), z)),
        _via("metacarpal", (x, float(guide[1]), z)),
        HEAD,
        _via("proximal", (tables.SIDE_END, float(end_y), float(end_z))),
    )
    return Tendon(name, (Strand(path),))
