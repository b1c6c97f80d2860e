"""The middle finger of Synek et al. 2019, PeerJ 7:e7470, in its normative (uncalibrated) form.

The third digit after An et al. 1979, whose axes are parallel; see `anatomy`.  The authors' own
calibrated points were fitted to the fingertip forces that this finger is compared with, and are
not used here.  The radial interosseous and the terminal slip are those of another source
(`RADIAL_INTEROSSEOUS`, `TERMINAL_SLIP`).  Under a hood it has MyoHand's bones of this finger, each
as long as the phalanx here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from meshes.skeleton import Skeleton
from rigid.fingers.anatomy import Row
from rigid.fingers.normative import BOTH, NormativeFinger

O2O3 = 0.02363
"""m."""
TIP_REACH = 0.015
"""m, O0O1: from the distal phalanx's frame to its tip."""
LENGTHS = ((1.62 + 0.37) * O2O3, (1.0 + 0.22) * O2O3, 0.17 * O2O3 + TIP_REACH)
"""m, from joint to joint: O4O5 + O5O6, O2O3 + O3O4, O1O2 + O0O1."""
Source = Literal["myohand", "an1979"]
RADIAL_INTEROSSEOUS: Mapping[Source, Row] = {
    "myohand": ((-1.065, -0.231, 0.419), (0.161, -0.113, 0.303)),
    "an1979": ((-0.400, -0.565, 0.471), (0.380, -0.038, 0.331)),
}
"""RI's row at the MCP, in two sources.

"myohand": the last point on the third metacarpal and the one on the proximal phalanx of MyoHand's
RI3 (MyoHub/myo_sim at 2cef885, Apache-2.0; after Lee et al. 2015, PLoS ONE 10:e0121712), from the
joint's centre, x towards the PIP's, y the flexion axis made normal to x; all lengths times the
ratio of the proximal phalanges, 47.02 / 44.68 mm.

"an1979": the normative table.  Its proximal point lies as deep as the superficial flexor (0.574)
and twice as deep as the ulnar interosseous (0.264), while both interossei pass dorsal of the deep
transverse metacarpal ligament.  Its arm is 8.1 mm in the straight finger; MyoHand's is 3.6 mm, and
the index finger's first dorsal interosseous (0.262) has 4.2 mm at this finger's size.  0.565 is
perhaps a misprint for 0.265; that is not proven."""
TERMINAL_SLIP: Mapping[Source, Row] = {
    "myohand": ((0.007, 0.140, -0.012), (0.101, 0.165, 0.023)),
    "an1979": ((0.000, 0.168, -0.015), (0.050, 0.154, -0.022)),
}
"""TE's row at the DIP, in two sources, as RI's: the points of MyoHand's EDC3 on either side of the
joint, and the normative table's.

Its arm is 3.3 mm by the first and 4.0 mm by the second, where the normative index finger has 2.0
mm.  Its own bone (1.9 mm over the axis) and half of a slip that lies on it make 2.4 mm.  MyoHand's
is the nearer one; chosen by anatomy and arms, not by a force."""
ROWS: Mapping[str, Mapping[str, Row]] = {
    "MCP": {
        "FDP": ((-0.300, -0.470, 0.012), (0.180, -0.330, 0.023)),
        "FDS": ((-0.300, -0.574, 0.019), (0.180, -0.393, 0.039)),
        "RI": RADIAL_INTEROSSEOUS["myohand"],
        "LU": ((-0.400, -0.623, 0.422), (0.380, -0.140, 0.328)),
        # Printed as +0.264; the authors had the sign error confirmed by K.-N. An.
        "UI": ((-0.400, -0.264, -0.358), (0.380, 0.036, -0.357)),
        "LE": ((0.000, 0.393, -0.039), (0.080, 0.322, -0.018)),
    },
    "PIP": {
        "FDP": ((-0.400, -0.266, -0.004), (0.280, -0.273, -0.004)),
        "FDS": ((-0.400, -0.217, -0.016), (0.280, -0.207, 0.001)),
        "RB": ((-0.100, 0.100, 0.242), (0.180, 0.172, 0.227)),
        "UB": ((-0.100, 0.076, -0.279), (0.180, 0.161, -0.247)),
        "ES": ((0.000, 0.236, -0.019), (0.030, 0.247, -0.024)),
    },
    "DIP": {
        "FDP": ((-0.300, -0.254, 0.033), (0.050, -0.141, 0.032)),
        "TE": TERMINAL_SLIP["myohand"],
    },
}


def skeleton() -> Skeleton:
    """Bones in line at zero angles, parallel flexion axes, abduction normal to them."""
    axis = np.array([[0.0, 1, 0], [0, 0, 1], [0, 1, 0], [0, 1, 0]])
    return Skeleton(np.array([0.0, *LENGTHS]), np.tile(np.eye(3), (3, 1, 1)), axis, {})


MIDDLE = NormativeFinger(
    "middle finger",
    O2O3,
    skeleton,
    ROWS,
    {"DIP": 0.17, "PIP": 0.22, "MCP": 0.37},
    {
        "EDC": ("LE", BOTH),
        "LUM": ("LU", ("RB",)),
        "RI": ("RI", ("RB",)),
        "UI": ("UI", ("UB",)),
    },
    {"FDP": 4.1, "FDS": 4.2, "EDC": 1.7, "LUM": 0.2, "UI": 2.2, "RI": 2.8},
    "Chao 1989, digit III, in Synek 2019",
    bones="middle",
    to_bone={"RI": 0.5},  # the same source's share that ends on the proximal phalanx
)


def record(interosseous: Source = "myohand", terminal: Source = "myohand") -> NormativeFinger:
    """The finger with the radial interosseous' and the terminal slip's rows by source."""
    mcp = {**ROWS["MCP"], "RI": RADIAL_INTEROSSEOUS[interosseous]}
    dip = {**ROWS["DIP"], "TE": TERMINAL_SLIP[terminal]}
    return replace(MIDDLE, rows={**ROWS, "MCP": mcp, "DIP": dip})
