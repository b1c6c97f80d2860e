"""What Xu et al. 2012 print of their robotic finger (tables I and III), and what had to be chosen
beside it.

The paper's tendon paths are in an appendix that is not at hand.  The points below are choices of
ours, in mm, x distal, y radial, z dorsal, each in its bone's frame; `None` marks the coordinates
that `finger` solves table III for.  Table II is `rigid.fingers.anatomy.RANGES`.
"""

from __future__ import annotations

import numpy as np

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
SMALLEST = 0.1
"""mm: an entry of table III below this is a zero, whose sign means nothing."""

LONG, SHORT = 0.5, 0.25
"""The extensor pulley's weights (section V)."""
MOST_FORCE = 40.0
"""N: section VII."""

ORIGIN = -45.0
"""mm, x of the point on the metacarpal from which every tendon runs straight to its cylinder."""
HEAD_RADIUS = 10.0
"""mm, of the sphere that is the metacarpal's head, over which flexors, abduction and adduction run.
The paper's objects are "spheres or cylinders" without saying which where; its abduction tendon
"presses on the joint capsule and curves over it", and the simplified model that one of its authors
published later (MyoFinger, github.com/MyoHub/myo_sim, finger/finger_v0.xml) has a sphere at the MCP
and cylinders at PIP and DIP.  Small enough to leave the default posture's ways straight, 10.45 mm
off.  The extensor stays on a cylinder: with the MCP flexed by 90 deg its ends are more than half a
turn apart about the head, where no way over a sphere is the shortest."""
FLEXOR_GUIDE = (-20.0, 0.0, -13.47)
"""This and the extensor's guide are near the joint (in that model at 10.7 mm, by the length of the
proximal phalanx), the flexors' not so near that their arms fall to nothing at 90 deg.  Between
points a and b away from the MCP a tension T turns an abducted finger further, by T a b / (a + b)
N m/rad: far guides make poses that no controller holds through the air's delay."""
FLEXOR_PROXIMAL, FLEXOR_MIDDLE, FLEXOR_DISTAL = 14.0, 10.0, 7.0
"""mm, x of the flexors' guide on the proximal phalanx, of the one on the middle phalanx (where the
PIP flexor ends), and of the DIP flexor's end on the distal one; their z are solved for."""
EXTENSOR_GUIDE = (-8.0, 0.0, 10.0)
EXTENSOR_PROXIMAL = (8.0, 0.0, 9.0)
"""The short branch that ends on the proximal phalanx ends here; the others pass through."""
EXTENSOR_BEFORE_PIP, EXTENSOR_AFTER_PIP = (45.0, 0.0, 1.5), (7.0, 0.0, 1.5)
"""The other short branch ends at the second."""
EXTENSOR_BEFORE_DIP, EXTENSOR_DISTAL = (25.0, 0.0, 1.2), (6.0, 0.0, 1.2)
SIDE_GUIDE = (-8.0, 11.0, -4.0)
"""The abduction tendon's guide; the adduction tendon's is its mirror image. Chosen with `SIDE_END`
so that no arm over table II falls below 2.8 mm."""
SIDE_END = 14.0
"""mm, x of the ends on the proximal phalanx; their y and z are solved for."""
