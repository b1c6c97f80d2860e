"""From normative tendon points to a finger model: bones in a row, tendons that part, wrapping.

The tables are those of An, Chao, Cooney and Linscheid 1979, J Biomech 12:775-788, and of what was
built on them: for each joint and each row (a tendon or a part of the extensor) a point on the bone
before the joint, from the joint's centre, and one on the bone after it, from that bone's frame O,
which lies `offset` distal of the centre.  Units of O2O3; x distal, y dorsal, z radial.

A straight line between them cuts through the joint, or leaves it, where the joint bends far:

* what passes dorsal (LE, ES) slides over a cylinder about the joint's axis, of the radius at which
  the straight line passes the straight joint; the lateral bands (RB, UB) over one of `LEAST_ARM`,
  so that they never become flexors;
* flexors stay inside a ring about the axis, which their sheath forms there.  At the MCP (A1) and
  for FDP at the PIP (A3) it lets them leave the joint no further than the straight line does at
  `SHEATH_ANGLE`.  FDS lies palmar of FDP at the MCP, and at the PIP dorsal of it in the same
  sheath, by `BENEATH_FDP`.  At the DIP, A5 holds FDP within `A5_RADIUS`.  Since the two points
  would pass each other near 90 deg and turn the flexor into an extensor, both are moved away from
  the joint by `SHEATH_REACH` along their line, which leaves the straight finger's moment arms as
  they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from cosim.port import Array
from meshes.skeleton import BODIES, JOINTS, Skeleton
from rigid.model import (
    FingerModel,
    Hinge,
    PathElement,
    Segment,
    Strand,
    Surface,
    Tendon,
    Vector,
    Via,
    WrapCylinder,
    vector,
)

Row = tuple[Vector, Vector]
Way = tuple[float, tuple[tuple[str, str], ...]]
"""A strand: its share of the tension and its (joint, row) from proximal to distal."""

CROSSES = {"MCP": (0, 1), "PIP": (1, 2), "DIP": (2, 3)}
SLIDES_OVER = ("LE", "ES")
BANDS = ("RB", "UB")
LEAST_ARM = 0.35e-3
"""m: the lateral band's at a PIP of 110 deg after Buchner et al. 1988, table 1 (5 - 2.42 phi)."""
SHEATHED = (("MCP", "FDP"), ("MCP", "FDS"), ("PIP", "FDP"), ("PIP", "FDS"), ("DIP", "FDP"))
SHEATH_ANGLE = float(np.radians(45.0))
"""Assumption.  With it FDP's largest arm at the PIP is 10.1 mm in the index finger and 9.8 mm in
the middle finger; Ketchum et al. 1978 have 9.8 and 10.7 mm, MyoHand's largest are 10.4 and 12.0."""
BENEATH_FDP = 0.08
"""O2O3: FDP's arm at the PIP less FDS's by Ketchum et al. 1978, 1.5 mm in the index finger and
2.0 mm in the middle finger (as quoted in a handbook of ergonomics, table 45.3)."""
A5_RADIUS = 0.22
"""O2O3: with it FDP's arm at the DIP is on average over 0 to 70 deg the index finger's measured
one, 4.1 mm (An et al. 1983, J Biomech 16:419-425, as quoted in secondary sources).  The straight
finger's is 4.2 mm by An et al. 1979: there is no bowstringing to speak of."""
SHEATH_REACH = {"MCP": (0.15, 0.15), "PIP": (0.8, 0.2), "DIP": (0.15, 0.15)}
"""In O2O3, on the proximal and on the distal bone; assumption.  At the PIP as far as the bones have
room, so that FDP's arm stays above FDS's up to 110 deg."""
CLEARANCE = 1e-4
"""m, by which a cylinder is smaller than the straight way's distance, so that it does not touch."""
ORIGIN_REACH = 0.040
"""m, assumption: muscles pull parallel to the metacarpal from this far proximal of their first
point."""

# rad: range of motion in table II of Xu et al. 2012.
RANGES = {
    "MCP": (np.radians(-30.0), np.radians(90.0)),
    "MCP_abduction": (np.radians(-35.0), np.radians(35.0)),
    "PIP": (0.0, np.radians(110.0)),
    "DIP": (0.0, np.radians(70.0)),
}
# kg and kg m2 about x, y, z: AMMR index finger after Wu 2008.  Assumptions: the centre of mass is
# at mid-length, the published axes are ours, and other fingers weigh the same.
SEGMENTS = {
    "proximal": (0.0155, (0.648e-6, 2.86e-6, 2.83e-6)),
    "middle": (0.00679, (2.32e-7, 4.84e-7, 4.51e-7)),
    "distal": (0.00391, (1.04e-7, 1.90e-7, 1.70e-7)),
}
VIEW_RADIUS = {"metacarpal": 0.0041, "proximal": 0.0039, "middle": 0.0028, "distal": 0.0020}
VIEW_METACARPAL = -0.040  # m, how much of the metacarpal is drawn

CENTRAL = 0.5
"""The central slip's share of every extensor's tension in the normative models (An et al. 1979, as
in Synek et al. 2019, PeerJ 7:e7470)."""
FLEXORS: Mapping[str, tuple[Way, ...]] = {
    "FDP": ((1.0, (("MCP", "FDP"), ("PIP", "FDP"), ("DIP", "FDP"))),),
    "FDS": ((1.0, (("MCP", "FDS"), ("PIP", "FDS"))),),
}


@dataclass(frozen=True)
class FingerAnatomy:
    """What one finger differs in from another."""

    name: str
    rows: Mapping[str, Mapping[str, Row]]
    """By joint and name."""
    offset: Mapping[str, float]
    """Offset of each distal frame O from its joint's centre, in O2O3."""
    ways: Mapping[str, tuple[Way, ...]]
    """By muscle."""
    reach: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """By joint, where it is not `SHEATH_REACH`."""


def extensor(row: str, bands: Sequence[str], central: float) -> tuple[Way, ...]:
    """The strands of a muscle that enters the hood at the MCP row `row`: `central` of its tension
    to the central slip, the rest through the lateral `bands` in equal parts to the terminal one."""
    middle: Way = (central, (("MCP", row), ("PIP", "ES")))
    lateral = (1.0 - central) / len(bands)
    ways = [(lateral, (("MCP", row), ("PIP", band), ("DIP", "TE"))) for band in bands]
    return tuple(way for way in (middle, *ways) if way[0] > 0.0)


def eyelets(
    rows: Mapping[str, Mapping[str, Row]], tendons: Mapping[str, str], along: float, across: float
) -> dict[str, Vector]:
    """Points that hold the intrinsic tendons, m distal of the MCP, dorsal and radial, by tendon:
    the proximal point of its MCP row, the last that the metacarpal holds (An's: where it passes the
    deep transverse metacarpal ligament). `along`, `across`: m, the unit of the tables along the
    finger and across it."""
    unit = np.array([along, across, across])
    return {name: vector(unit * rows["MCP"][row][0]) for name, row in tendons.items()}


def assemble(
    anatomy: FingerAnatomy,
    skeleton: Skeleton,
    o2o3: float,
    bones: Mapping[str, Surface] | None = None,
) -> FingerModel:
    """The finger over a skeleton; o2o3: m, the unit of the tables; bones: surfaces by body, drawn
    instead of capsules."""
    tendons = tuple(
        Tendon(name, tuple(Strand(_path(anatomy, skeleton, o2o3, rows), s) for s, rows in ways))
        for name, ways in anatomy.ways.items()
    )
    segments = tuple(_segment(skeleton, i) for i in range(len(BODIES)))
    tip = (float(skeleton.length[3]), 0.0, 0.0)
    return FingerModel(anatomy.name, segments, tip, tendons, bones or {})


def _segment(skeleton: Skeleton, i: int) -> Segment:
    name = BODIES[i]
    if i == 0:
        return Segment(name, VIEW_METACARPAL, radius=VIEW_RADIUS[name])
    mass, inertia = SEGMENTS[name]
    hinges = tuple(
        Hinge(joint, vector(axis), RANGES[joint])
        for joint, axis in zip(JOINTS, skeleton.axis, strict=True)
        if CROSSES[joint.removesuffix("_abduction")][1] == i
    )
    length = float(skeleton.length[i])
    before = float(skeleton.length[i - 1]) if i > 1 else 0.0
    turn = skeleton.zero[i - 1]
    return Segment(
        name,
        length,
        (before, 0.0, 0.0),
        (vector(turn[0]), vector(turn[1]), vector(turn[2])),
        hinges,
        mass,
        inertia,
        (length / 2, 0.0, 0.0),
        VIEW_RADIUS[name],
    )


def _path(
    anatomy: FingerAnatomy, skeleton: Skeleton, o2o3: float, rows: Sequence[tuple[str, str]]
) -> tuple[PathElement, ...]:
    path: list[PathElement] = []
    for joint, row in rows:
        i, k = CROSSES[joint]
        before, after = anatomy.rows[joint][row]
        centre = np.array([skeleton.length[i] if i else 0.0, 0.0, 0.0])
        start = _in_our_axes(before, 0.0, o2o3)
        end = _in_our_axes(after, anatomy.offset[joint], o2o3)
        axis = skeleton.zero[k - 1] @ skeleton.axis[JOINTS.index(joint)]
        guide = []
        if (joint, row) in SHEATHED:
            radius = o2o3 * _ring(anatomy, joint, row)
            guide = [WrapCylinder(BODIES[i], vector(centre), vector(axis), radius, vector(centre))]
            unit = o2o3 * (end - start) / np.linalg.norm(end - start)
            proximal, distal = anatomy.reach.get(joint, SHEATH_REACH[joint])
            start, end = start - proximal * unit, end + distal * unit
        elif row in SLIDES_OVER or row in BANDS:
            radius = LEAST_ARM if row in BANDS else _distance(start, end, 0.0) - CLEARANCE
            side = vector(centre + _beside(radius))
            guide = [WrapCylinder(BODIES[i], vector(centre), vector(axis), radius, side)]
        path.append(Via(BODIES[i], vector(centre + start)))
        path += guide
        path.append(Via(BODIES[k], vector(end)))
    first = path[0]
    assert isinstance(first, Via)
    origin = np.array(first.point) - [ORIGIN_REACH, 0.0, 0.0]
    return (Via(first.body, vector(origin)), *path)


def _ring(anatomy: FingerAnatomy, joint: str, row: str) -> float:
    """O2O3: the radius within which the sheath holds a flexor's row at a joint."""
    if joint == "DIP":
        return A5_RADIUS
    if (joint, row) == ("PIP", "FDS"):
        return _ring(anatomy, "PIP", "FDP") - BENEATH_FDP
    before, after = anatomy.rows[joint][row]
    start, end = _in_our_axes(before, 0.0, 1.0), _in_our_axes(after, anatomy.offset[joint], 1.0)
    return abs(_distance(start, end, SHEATH_ANGLE))


def _in_our_axes(point: Vector, offset: float, o2o3: float) -> Array:
    x, dorsal, radial = point
    return o2o3 * np.array([x + offset, radial, dorsal])


def _beside(radius: float) -> Array:
    """From a cylinder's axis to a point dorsal and distal of it: mid-way along the arc that a
    tendon covers, or it jumps to the other side in deep flexion."""
    return 1.5 * max(radius, 1e-3) * np.sqrt(0.5) * np.array([1.0, 0.0, 1.0])


def _distance(start: Array, end: Array, angle: float) -> float:
    """The distance, m, of the straight line in the plane of flexion from the joint's centre, dorsal
    positive."""
    c, s = np.cos(angle), np.sin(angle)
    p, d = start[[0, 2]], np.array([[c, s], [-s, c]]) @ end[[0, 2]]
    along = (d - p) / np.linalg.norm(d - p)
    return float(p[1] * along[0] - p[0] * along[1])
