"""The ring finger: joints and bones of MyoHand, tendons of An et al. 1979.

The normative table of digit IV as AnyBody's AMMR transcribes it (Plzen-HandModelParameters.any at
6bf2ab4; what it transcribes of digit III is Synek's table to the last digit, but for one swap of
columns, LE at the MCP).  The offsets of the joint frames are not in it; they follow from the
points, which lie in every finger equally far from the joints' centres (0.45, 0.55 and 0.75 O2O3 at
the MCP, 0.25, 0.40 and 0.50 at the PIP, 0.22 at the DIP).  O2O3 is that of MyoHand's middle
phalanx.
"""

from __future__ import annotations

from collections.abc import Mapping

from meshes.skeleton import Skeleton, myohand_finger
from rigid.fingers.anatomy import Row
from rigid.fingers.normative import BOTH, NormativeFinger

O2O3 = 0.02058
"""m: 24.90 mm from joint to joint over 1 + 0.21."""
ROWS: Mapping[str, Mapping[str, Row]] = {
    "MCP": {
        "FDP": ((-0.300, -0.463, 0.012), (0.210, -0.278, 0.006)),
        "FDS": ((-0.300, -0.517, 0.036), (0.210, -0.338, 0.038)),
        "RI": ((-0.400, -0.211, 0.283), (0.410, 0.000, 0.275)),
        "LU": ((-0.400, -0.415, 0.213), (0.410, -0.059, 0.165)),
        "UI": ((-0.400, -0.330, -0.207), (0.410, 0.012, -0.199)),
        "LE": ((0.000, 0.388, 0.010), (0.110, 0.326, 0.002)),
    },
    "PIP": {
        "FDP": ((-0.400, -0.291, 0.010), (0.290, -0.278, -0.016)),
        "FDS": ((-0.400, -0.228, -0.004), (0.290, -0.234, -0.009)),
        "RB": ((-0.100, 0.110, 0.237), (0.190, 0.140, 0.163)),
        "UB": ((-0.100, 0.072, -0.246), (0.190, 0.141, -0.228)),
        "ES": ((0.000, 0.202, 0.006), (0.040, 0.208, -0.016)),
    },
    "DIP": {
        "FDP": ((-0.300, -0.253, 0.032), (0.070, -0.145, 0.001)),
        "TE": ((0.000, 0.141, -0.025), (0.070, 0.144, -0.030)),
    },
}


def skeleton() -> Skeleton:
    """MyoHand's fourth ray."""
    return myohand_finger("ring")


RING = NormativeFinger(
    "ring finger",
    O2O3,
    skeleton,
    ROWS,
    {"DIP": 0.15, "PIP": 0.21, "MCP": 0.34},
    # EDC is MyoHand's EDC4, LUM the third lumbrical (LU_RB4), RI the second palmar interosseous, UI
    # the fourth dorsal one (UI_UB4).  Both interossei enter the hood whole (assumption).
    {
        "EDC": ("LE", BOTH),
        "LUM": ("LU", ("RB",)),
        "RI": ("RI", ("RB",)),
        "UI": ("UI", ("UB",)),
    },
    # Assumptions: FDP, FDS and EDC are the middle finger's times MyoHand's ratio of greatest forces
    # (172.9 / 212.4, 171.2 / 258.8, 109.2 / 94.4 N), RI and UI its UI, LUM its LUM times O2O3^2.
    {"FDP": 3.34, "FDS": 2.78, "EDC": 1.97, "LUM": 0.15, "RI": 1.67, "UI": 1.67},
    "assumption: the middle finger's by MyoHand's greatest forces and by O2O3^2",
    bones="ring",
)
