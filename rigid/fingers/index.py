"""The index finger's tendons.

An et al. 1979 in the form used by AnyBody's AMMR (index finger after Wu 2008); see `anatomy`.  The
intrinsic tendons may have another source's path at the MCP (`INTRINSIC_ROWS`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

from meshes.skeleton import Skeleton, index_finger
from rigid.fingers.anatomy import FLEXORS, Row
from rigid.fingers.normative import BOTH, NormativeFinger
from rigid.model import FingerModel, Surface

O2O3 = 0.020
"""m: the middle phalanx between its two joint frames."""
Intrinsics = Literal["an1979", "myohand"]
INTRINSIC_ROWS: Mapping[Intrinsics, Mapping[str, Row]] = {
    "an1979": {
        "LU": ((-0.400, -0.404, 0.441), (0.318, -0.148, 0.370)),
        "UI": ((-0.400, -0.279, -0.442), (0.318, -0.039, -0.461)),
    },
    "myohand": {
        "LU": ((-0.057, -0.169, 0.348), (0.044, -0.078, 0.340)),
        "UI": ((-0.036, -0.187, -0.342), (0.321, -0.015, -0.354)),
    },
}
"""The lumbrical's and the palmar interosseous' rows at the MCP, in two sources.

"an1979": the normative table.  "myohand": the last points on the second metacarpal and those on the
proximal phalanx of MyoHand's LU_RB2 and UI_UB2 (MyoHub/myo_sim at 2cef885, Apache-2.0; after Lee et
al. 2015, PLoS ONE 10:e0121712), taken over as the middle finger's radial interosseous is; the bones
are of one size.  At MCP 0, 30 and 60 deg LU's arm is 6.0, 8.8 and 10.9 mm by the first and 3.0, 3.7
and 3.5 mm by the second, UI's 4.0, 6.6, 8.5 and 3.6, 3.6, 2.4 mm.

The normative table is the default by anatomy: its proximal points lie where the tendons pass the
deep transverse metacarpal ligament, the lumbrical palmar of it and the interosseous dorsal.
MyoHand's last points on the metacarpal lie 1 mm from the joint's centre, the lumbrical's dorsal of
the interosseous'.  Nobody measured either arm."""
ROWS: Mapping[str, Mapping[str, Row]] = {
    "MCP": {
        "FDP": ((-0.400, -0.559, 0.004), (0.118, -0.386, 0.031)),
        "FDS": ((-0.400, -0.589, -0.114), (0.118, -0.477, -0.074)),
        "RI": ((-0.400, -0.262, 0.450), (0.318, -0.033, 0.443)),
        **INTRINSIC_ROWS["an1979"],
        "LE": ((0.000, 0.483, -0.026), (0.018, 0.421, -0.033)),
    },
    "PIP": {
        "FDP": ((-0.400, -0.409, 0.027), (0.212, -0.308, 0.009)),
        "FDS": ((-0.400, -0.311, 0.028), (0.212, -0.249, 0.015)),
        "RB": ((-0.100, 0.181, 0.268), (0.112, 0.186, 0.223)),
        "UB": ((-0.100, 0.131, -0.312), (0.112, 0.151, -0.290)),
        "ES": ((0.000, 0.266, -0.026), (0.038, 0.278, -0.027)),
    },
    "DIP": {
        "FDP": ((-0.300, -0.245, 0.054), (-0.004, -0.184, 0.026)),
        "TE": ((0.000, 0.100, -0.009), (-0.004, 0.199, -0.010)),
    },
}

INDEX = NormativeFinger(
    "index finger",
    O2O3,
    index_finger,
    ROWS,
    {"DIP": 0.224, "PIP": 0.288, "MCP": 0.432},
    # EI runs with EDC: the normative model has one long extensor (LE).
    {"EDC": ("LE", BOTH), "EI": ("LE", BOTH), "LUM": ("LU", ("RB",)), "FPI": ("UI", ("UB",))},
    {
        **{"FDP": 4.79, "FDS": 4.79, "EDC": 1.39, "EI": 1.12, "LUM": 0.28},
        **{"FPI": 2.80, "UI": 2.80, "FDIm": 3.53 / 2, "FDIl": 3.53 / 2},
    },  # FPI is its UI, the two heads of FDI share its RI equally
    "Wu 2008, in AnyBody's index finger",
    # Both heads of the first dorsal interosseous insert where An has one (RI).
    on_bones={
        **FLEXORS,
        "FDIm": ((1.0, (("MCP", "RI"),)),),
        "FDIl": ((1.0, (("MCP", "RI"),)),),
    },
)


def record(intrinsics: Intrinsics = "an1979") -> NormativeFinger:
    """The finger with the intrinsic tendons' rows at the MCP by their source."""
    return replace(INDEX, rows={**ROWS, "MCP": {**ROWS["MCP"], **INTRINSIC_ROWS[intrinsics]}})


def finger_model(
    skeleton: Skeleton,
    o2o3: float = O2O3,
    bones: Mapping[str, Surface] | None = None,
    central: float | None = None,
    intrinsics: Intrinsics = "an1979",
) -> FingerModel:
    """Return the finger over a skeleton, with the muscles that act on the bones; where `central` is
    given (0 to 1) those of the hood too, that share of each going to the central slip.

    o2o3: m, the unit of the tendon paths; bones: surfaces by body, drawn instead of capsules;
    intrinsics: source of the intrinsic tendons' path at the MCP.

    >>> from meshes.skeleton import index_finger
    >>> from rigid.fingers.index import finger_model
    >>> finger_model(index_finger()).muscles
    ('FDP', 'FDS', 'FDIm', 'FDIl')
    >>> finger_model(index_finger(), central=0.5).muscles[:4]
    ('EDC', 'EI', 'LUM', 'FPI')
    """
    finger = record(intrinsics)
    ways = finger.on_bones if central is None else finger.strands(central)
    return finger.model(ways, skeleton, o2o3, bones)
