"""The little finger: joints and bones of MyoHand, tendons of An et al. 1979 (see `ring`, which has
the sources)."""

from __future__ import annotations

from collections.abc import Mapping

from meshes.skeleton import Skeleton, myohand_finger
from rigid.fingers.anatomy import Row
from rigid.fingers.normative import BOTH, NormativeFinger

O2O3 = 0.01628
"""m: 21.00 mm from joint to joint over 1 + 0.29."""
# Assumption: at the MCP the flexors pass radial of the joint, and abduct the finger radially, as An
# has them.  MyoHand's abduct ulnarly.  `cases/README.md` (little) has what speaks for either; no
# force decides, and `cases/data/not_measured.csv` has what would.
ROWS: Mapping[str, Mapping[str, Row]] = {
    "MCP": {
        "FDP": ((-0.300, -0.584, 0.112), (0.060, -0.413, 0.076)),
        "FDS": ((-0.300, -0.653, 0.129), (0.060, -0.489, 0.117)),
        "RI": ((-0.400, -0.145, 0.473), (0.260, 0.066, 0.430)),
        "LU": ((-0.400, -0.363, 0.469), (0.260, -0.056, 0.423)),
        "UI": ((-0.400, -0.304, -0.590), (0.260, -0.100, -0.502)),
        "LE": ((0.000, 0.477, 0.111), (-0.040, 0.414, 0.035)),
    },
    "PIP": {
        "FDP": ((-0.400, -0.359, 0.058), (0.210, -0.317, 0.017)),
        "FDS": ((-0.400, -0.310, -0.008), (0.210, -0.271, 0.004)),
        "RB": ((-0.100, 0.182, 0.224), (0.110, 0.203, 0.184)),
        "UB": ((-0.100, 0.113, -0.293), (0.110, 0.110, -0.321)),
        "ES": ((0.000, 0.257, 0.006), (0.040, 0.272, -0.012)),
    },
    "DIP": {
        # Transcribed as 0.030 proximal of the centre; every other finger has 0.300.
        "FDP": ((-0.300, -0.236, -0.020), (0.010, -0.187, -0.075)),
        "TE": ((0.000, 0.187, -0.119), (0.010, 0.199, -0.132)),
    },
}


def skeleton() -> Skeleton:
    """MyoHand's fifth ray."""
    return myohand_finger("little")


LITTLE = NormativeFinger(
    "little finger",
    O2O3,
    skeleton,
    ROWS,
    {"DIP": 0.21, "PIP": 0.29, "MCP": 0.49},
    # EDC (MyoHand's EDC5) and EDM, the extensor digiti minimi, share the normative long extensor;
    # LUM is the fourth lumbrical (LU_RB5), RI the third palmar interosseous (RI5), ADM the abductor
    # digiti minimi, which is the table's UI (MyoHand's UI_UB5) and pulls at a hood's ulnar side.
    {
        "EDC": ("LE", BOTH),
        "EDM": ("LE", BOTH),
        "LUM": ("LU", ("RB",)),
        "RI": ("RI", ("RB",)),
        "ADM": ("UI", ("UB",)),
    },
    # Assumptions as the ring finger's: 236.8 / 212.4, 75.3 / 258.8 and, for EDM, 72.4 / 94.4 N; ADM
    # as the middle finger's RI.  EDC half of EDM: MyoHand's 139.4 N would make the thinnest slip,
    # which many hands lack, the strongest extensor.
    {"FDP": 4.57, "FDS": 1.22, "EDC": 0.65, "EDM": 1.30, "LUM": 0.09, "RI": 1.04, "ADM": 1.33},
    "assumption: the middle finger's by MyoHand's greatest forces and by O2O3^2",
    bones="little",
    # Two slips, one to the base of the phalanx and one to the hood: equal parts are an assumption,
    # as the middle finger's radial interosseous has them.
    to_bone={"ADM": 0.5},
    # Assumption: its flexors lie deeper than any other's in its unit, and would turn into extensors
    # of the MCP at 88 deg.
    reach={"MCP": (0.35, 0.35)},
)
