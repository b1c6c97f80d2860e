"""The robotic finger as a finger model: five tendons, or six with a second extensor, and a
builder's own.

A fit to table III, not a reconstruction: the paper's points are not at hand.  Ten unknowns make its
20 numbers, or those that a `RobotDesign` states in their place:

* radii of the cylinders about the MCP, PIP and DIP axes that the extensor wraps (in the default
  posture too, so that a radius is the arm): R, (long + short share) r_PIP, long share r_DIP;
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

from collections.abc import Callable, Mapping
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq, fsolve

from cosim.errors import InputError
from cosim.port import Array
from rigid.fingers import robot_tables as tables
from rigid.fingers.anatomy import RANGES
from rigid.fingers.pulley_tendons import routed_tendon
from rigid.fingers.robot_tables import XU2012, RobotDesign
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
AXES = {"MCP_abduction": (0.0, 0.0, 1.0)}
Point = tuple[float, float, float]


@lru_cache(maxsize=64)
def robot_finger(second_extensor: bool = False, design: RobotDesign = XU2012) -> FingerModel:
    """The finger of tables I to III; with the second extensor, one to the proximal phalanx alone,
    and the central one left to the middle and distal phalanges (the paper says that it rearranged
    the attachments and not how: both are assumptions).

    Raises InputError for a design whose tendons no guides lead."""
    segments, tendons = _segments(design), {}
    if design.keeps_paper_tendons:
        tendons = {t.name: t for t in _Paths(design).tendons(second_extensor)}
    tendons |= {route.name: routed_tendon(route, segments) for route in design.routes}
    tip = (design.lengths[2], 0.0, 0.0)
    name = "robotic finger" + (", six tendons" if second_extensor else "")
    return FingerModel(name, segments, tip, tuple(tendons.values()))


def _segments(design: RobotDesign) -> tuple[Segment, ...]:
    metacarpal = Segment("metacarpal", design.guides.origin * MM, radius=0.006)
    joints = (("MCP", "MCP_abduction"), ("PIP",), ("DIP",))
    phalanges = zip(
        ("proximal", "middle", "distal"),
        design.lengths,
        design.masses,
        joints,
        (0.0, *design.lengths[:2]),
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


class _Paths:
    """The paper's tendons in a design: points mm in the bones' frames."""

    def __init__(self, design: RobotDesign) -> None:
        self.design, self.guides = design, design.guides
        self.head = WrapSphere("metacarpal", (0.0, 0.0, 0.0), self.guides.head_radius * MM)
        proximal, middle, distal = (1e3 * length for length in design.lengths)
        self.proximal, self.middle = proximal, middle
        self.before_pip = round(proximal - self.guides.before_pip, 9)
        self.before_dip = round(middle - self.guides.before_dip, 9)
        self._check_stations({"proximal": proximal, "middle": middle, "distal": distal})

    def _check_stations(self, lengths: Mapping[str, float]) -> None:
        """Check that guides and ends lie on their bones (mm).  Raises InputError."""
        g = self.guides
        stations = {
            "proximal": {
                "flexor_proximal": g.flexor_proximal,
                "extensor_proximal_x": g.extensor_proximal_x,
                "before_pip": self.before_pip,
                "side_end": g.side_end,
            },
            "middle": {
                "flexor_middle": g.flexor_middle,
                "after_pip": g.after_pip,
                "before_dip": self.before_dip,
            },
            "distal": {"flexor_distal": g.flexor_distal, "distal": g.distal},
        }
        for bone, of_bone in stations.items():
            for key, along in of_bone.items():
                if not 0.0 < along < lengths[bone]:
                    raise InputError(
                        f"robotic finger: a guide stands beyond the end of the {bone} phalanx of "
                        f"{lengths[bone]:.4g} mm (finger.guides.{key}, {along:.4g} mm along it); "
                        "move finger.guides with finger.lengths"
                    )
        for key in ("flexor_x", "extensor_x", "side_x"):
            if not g.origin < getattr(g, key):
                raise InputError(
                    f"robotic finger: finger.guides.origin, {g.origin:.4g} mm along the "
                    f"metacarpal, is not proximal of finger.guides.{key}, "
                    f"{getattr(g, key):.4g} mm; a tendon begins before its guide"
                )

    def tendons(self, second_extensor: bool) -> tuple[Tendon, ...]:
        """The paper's, in the order of table III."""
        five: tuple[Tendon, ...] = (
            self._extensor(tables.TENDONS[0], to_proximal=not second_extensor),
            *self._flexors(),
            self._side_tendon("abduction", 1.0),
            self._side_tendon("adduction", -1.0),
        )
        if not second_extensor:
            return five
        return *five, Tendon(tables.SECOND_EXTENSOR, (Strand(self._over_mcp()),))

    def _lengthening(self, joint: str, tendon: str) -> float:
        """mm per rad, of table III."""
        row = self.design.lengthening[tables.JOINTS.index(joint)]
        return float(row[tables.TENDONS.index(tendon)])

    def _extensor(self, name: str, to_proximal: bool) -> Tendon:
        """The pulley: half the tension to the distal phalanx, a quarter each to two more ends;
        where the proximal phalanx has an extensor of its own, both quarters to the middle one."""
        g, long, short = self.guides, self.design.long_share, self.design.short_share
        shorts = 1 if to_proximal else 2
        before_pip, after_pip = (self.before_pip, g.pip_height), (g.after_pip, g.pip_height)
        before_dip, distal = (self.before_dip, g.dip_height), (g.distal, g.dip_height)
        radius = self._lengthening("PIP", name) / (long + short)
        over_pip = self._dorsal("proximal", "PIP", self.proximal, radius, before_pip, after_pip)
        radius = self._lengthening("DIP", name) / long
        over_dip = self._dorsal("middle", "DIP", self.middle, radius, before_dip, distal)
        to_middle = (
            *self._over_mcp(),
            _in_plane("proximal", before_pip),
            over_pip,
            _in_plane("middle", after_pip),
        )
        to_distal = (
            *to_middle,
            _in_plane("middle", before_dip),
            over_dip,
            _in_plane("distal", distal),
        )
        strands = [Strand(to_distal, long), *[Strand(to_middle, short)] * shorts]
        if to_proximal:
            strands.append(Strand(self._over_mcp(), short))
        return Tendon(name, tuple(strands))

    def _over_mcp(self) -> tuple[PathElement, ...]:
        g = self.guides
        guide = (g.extensor_x, g.extensor_z)
        beyond = (g.extensor_proximal_x, g.extensor_proximal_z)
        radius = self._lengthening("MCP", tables.TENDONS[0])
        return (
            _in_plane("metacarpal", (g.origin, g.extensor_z)),
            _in_plane("metacarpal", guide),
            self._dorsal("metacarpal", "MCP", 0.0, radius, guide, beyond),
            _in_plane("proximal", beyond),
        )

    def _dorsal(
        self,
        body: str,
        joint: str,
        joint_x: float,
        radius: float,
        before: tuple[float, float],
        after: tuple[float, float],
    ) -> WrapCylinder:
        """About a flexion axis, between guides at (x, z) in the frames of the bones before and
        after; the tendon's side is half-way along the arc that it covers.  Raises InputError where
        the straight finger's tendon would clear it, so that the radius were not the arm, or where
        it would swallow a guide."""
        a, b = np.array([before[0] - joint_x, before[1]]), np.array(after)
        along = (b - a) / np.linalg.norm(b - a)
        if not abs(a[0] * along[1] - a[1] * along[0]) <= radius < min(map(np.linalg.norm, (a, b))):
            raise InputError(
                f"robotic finger: the extensor's pulley at the {joint} has a radius of "
                f"{radius:.4g} mm (finger.arms.extensor.{joint}), and its guides stand at "
                f"{a[0]:.4g} and {b[0]:.4g} mm along, {a[1]:.4g} and {b[1]:.4g} mm dorsal of the "
                "axis: it must reach the line between them, and neither of them. Change the arm, "
                "or finger.guides"
            )
        aside = 1.5 * radius * np.sqrt(0.5) * MM
        centre = (joint_x * MM, 0.0, 0.0)
        return WrapCylinder(body, centre, FLEXION, radius * MM, (centre[0] + aside, 0.0, aside))

    def _flexors(self) -> tuple[Tendon, Tendon]:
        """To the distal and to the middle phalanx, through the same guides."""
        g = self.guides
        arms = (-self._lengthening(joint, "dip_flexor") for joint in ("MCP", "PIP", "DIP"))
        at_mcp, at_pip, at_dip = arms
        first = _height((g.flexor_x, g.flexor_z), g.flexor_proximal, at_mcp, "MCP")
        second = _height((g.flexor_proximal - self.proximal, first), g.flexor_middle, at_pip, "PIP")
        third = _height((g.flexor_middle - self.middle, second), g.flexor_distal, at_dip, "DIP")
        common = (
            _in_plane("metacarpal", (g.origin, g.flexor_z)),
            _in_plane("metacarpal", (g.flexor_x, g.flexor_z)),
            self.head,
            _in_plane("proximal", (g.flexor_proximal, first)),
            _in_plane("middle", (g.flexor_middle, second)),
        )
        to_distal = (*common, _in_plane("distal", (g.flexor_distal, third)))
        return Tendon("dip_flexor", (Strand(to_distal),)), Tendon("pip_flexor", (Strand(common),))

    def _side_tendon(self, name: str, side: float) -> Tendon:
        """Beside the MCP; `side`: +1 radial, -1 ulnar."""
        g = self.guides
        guide = np.array([g.side_x, side * g.side_y, g.side_z])
        wanted = np.array([-self._lengthening(j, name) for j in ("MCP", "MCP_abduction")])

        def miss(end: Array) -> Array:
            point = np.array([g.side_end, *end])
            along = guide - point
            return np.cross(point, along / np.linalg.norm(along))[1:] - wanted

        end_y, end_z = _solve(
            lambda: fsolve(miss, [wanted[1], -wanted[0]], xtol=1e-13, full_output=True),
            f"finger.arms.{name}",
        )
        path = (
            _via("metacarpal", (g.origin, float(guide[1]), g.side_z)),
            _via("metacarpal", (g.side_x, float(guide[1]), g.side_z)),
            self.head,
            _via("proximal", (g.side_end, float(end_y), float(end_z))),
        )
        return Tendon(name, (Strand(path),))


def _solve(root: Callable[[], tuple[Array, dict[str, Array], int, str]], key: str) -> Array:
    """The end of a tendon for arms that a key states.  Raises InputError where there is none."""
    found, _, ended, _ = root()
    if ended != 1:
        raise InputError(
            f"robotic finger: no straight line from its guide has the arms of {key}; choose "
            "smaller ones, or move the guide (finger.guides)"
        )
    return found


def _via(body: str, point: Point) -> Via:
    x, y, z = point
    return Via(body, (x * MM, y * MM, z * MM))


def _in_plane(body: str, point: tuple[float, float]) -> Via:
    return _via(body, (point[0], 0.0, point[1]))


def _height(before: tuple[float, float], x: float, arm: float, joint: str) -> float:
    """The height, mm: z of the point at `x` that a straight line from `before` (x, z) must run to,
    to pass `arm` palmar of the origin.  Raises InputError where there is none."""

    def miss(z: float) -> float:
        along = np.array([before[0] - x, before[1] - z])
        return float((z * along[0] - x * along[1]) / np.hypot(*along)) - arm

    try:
        return float(brentq(miss, -3 * arm, 0.0, xtol=1e-13))
    except ValueError:
        raise InputError(
            f"robotic finger: from a guide {-before[1]:.4g} mm palmar no straight line passes the "
            f"{joint} axis at {arm:.4g} mm (finger.arms.flexors.{joint}); choose arms that are "
            "nearer to each other, or move the guides (finger.guides)"
        ) from None
