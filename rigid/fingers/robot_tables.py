"""What Xu et al. 2012 print of their robotic finger (tables I and III), and what had to be chosen
beside it.

The paper's tendon paths are in an appendix that is not at hand: the guides below are choices of
ours, in mm, x distal, y radial, z dorsal, each in its bone's frame.  Table II is
`rigid.fingers.anatomy.RANGES`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rigid.fingers.pulley_tendons import TendonRoute

JOINTS = ("MCP", "MCP_abduction", "PIP", "DIP")
TENDONS = ("extensor", "dip_flexor", "pip_flexor", "abduction", "adduction")
SECOND_EXTENSOR = "second_extensor"
LENGTHS = (0.0534, 0.0320, 0.0237)
"""m: table I, proximal, middle and distal phalanx."""
MASSES = (0.0055, 0.0020, 0.0012)
"""kg: table I."""
TABLE_III = np.array(
    [
        [10.93, -13.47, -13.47, -6.17, -6.06],
        [0.00, 0.00, 0.00, -8.44, 8.86],
        [1.81, -7.99, -7.99, 0.00, 0.00],
        [1.13, -6.14, 0.00, 0.00, 0.00],
    ]
)
"""mm: lengthening of each of `TENDONS` (columns) per rad of each of `JOINTS` (rows) in the default
posture, here taken for all angles zero, with flexion and (radial) abduction positive."""

LONG, SHORT = 0.5, 0.25
"""The extensor pulley's weights (section V)."""

Arms = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Guides:
    """Where the tendons run, mm: x distal, y radial, z dorsal of the bone's proximal joint."""

    origin: float = -45.0
    """x of the point on the metacarpal from which every tendon runs straight to its cylinder."""
    head_radius: float = 10.0
    """The radius of the sphere that is the metacarpal's head, over which flexors, abduction and
    adduction run.
    The paper's objects are "spheres or cylinders" without saying which where; its abduction tendon
    "presses on the joint capsule and curves over it", and the simplified model that one of its
    authors published later (MyoFinger, github.com/MyoHub/myo_sim, finger/finger_v0.xml) has a
    sphere at the MCP and cylinders at PIP and DIP.  Small enough to leave the default posture's
    ways straight, 10.45 mm off.  The extensor stays on a cylinder: with the MCP flexed by 90 deg
    its ends are more than half a turn apart about the head, where no way over a sphere is the
    shortest."""
    flexor_x: float = -20.0
    """This and the extensor's guide are near the joint (in that model at 10.7 mm, by the length of
    the proximal phalanx), the flexors' not so near that their arms fall to nothing at 90 deg.
    Between points a and b away from the MCP a tension T turns an abducted finger further, by
    T a b / (a + b) N m/rad: far guides make poses that no controller holds through the air's
    delay."""
    flexor_z: float = -13.47
    flexor_proximal: float = 14.0
    """x of the flexors' guide on the proximal phalanx; its z and those below are solved for."""
    flexor_middle: float = 10.0
    """x of the guide on the middle phalanx, where the PIP flexor ends."""
    flexor_distal: float = 7.0
    """x of the DIP flexor's end on the distal phalanx."""
    extensor_x: float = -8.0
    extensor_z: float = 10.0
    extensor_proximal_x: float = 8.0
    """The place of the extensor's guide on the proximal phalanx, where the short branch ends."""
    extensor_proximal_z: float = 9.0
    before_pip: float = 8.4
    """How far proximal of the PIP axis the extensor's guide on the proximal phalanx is."""
    after_pip: float = 7.0
    """How far distal of the PIP axis its guide on the middle phalanx is, where the short branch to
    it ends."""
    pip_height: float = 1.5
    """z of both."""
    before_dip: float = 7.0
    distal: float = 6.0
    """x of the extensor's end on the distal phalanx."""
    dip_height: float = 1.2
    side_x: float = -8.0
    """The place of the abduction tendon's guide; the adduction tendon's is its mirror image.
    Chosen with `side_end` so that no arm over table II falls below 2.8 mm."""
    side_y: float = 11.0
    side_z: float = -4.0
    side_end: float = 14.0
    """x of the ends on the proximal phalanx; their y and z are solved for."""


@dataclass(frozen=True)
class RobotDesign:
    """What makes one robotic finger of this kind differ from another; the paper's by default."""

    lengths: tuple[float, float, float] = LENGTHS
    """m, of the phalanges."""
    masses: tuple[float, float, float] = MASSES
    """kg, of the phalanges."""
    lengthening: Arms = tuple(tuple(map(float, row)) for row in TABLE_III)
    """mm, table III: of `TENDONS` (columns) per rad of `JOINTS` (rows) in the straight finger."""
    long_share: float = LONG
    """The share of the extensor's tension that its pulley leaves to the distal phalanx; its other
    two branches share the rest equally."""
    guides: Guides = field(default_factory=Guides)
    routes: tuple[TendonRoute, ...] = ()
    """Tendons beside those of the paper, or in place of one of the same name."""
    keeps_paper_tendons: bool = True

    @property
    def short_share(self) -> float:
        """That of each of the two short branches."""
        return (1.0 - self.long_share) / 2


XU2012 = RobotDesign()
