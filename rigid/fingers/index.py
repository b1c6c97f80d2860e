"""The index finger's tendons.

An et al. 1979 in the form used by AnyBody's AMMR (index finger after Wu 2008); see `anatomy`.
"""

from __future__ import annotations

from collections.abc import Mapping

from meshes.skeleton import Skeleton
from rigid.fingers.anatomy import CENTRAL, FLEXORS, FingerAnatomy, Way, assemble, extensor
from rigid.model import FingerModel, Surface

O2O3 = 0.020
"""m: the middle phalanx between its two joint frames."""
ROWS = {
    "MCP": {
        "FDP": ((-0.400, -0.559, 0.004), (0.118, -0.386, 0.031)),
        "FDS": ((-0.400, -0.589, -0.114), (0.118, -0.477, -0.074)),
        "RI": ((-0.400, -0.262, 0.450), (0.318, -0.033, 0.443)),
        "LU": ((-0.400, -0.404, 0.441), (0.318, -0.148, 0.370)),
        "UI": ((-0.400, -0.279, -0.442), (0.318, -0.039, -0.461)),
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
OFFSET = {"DIP": 0.224, "PIP": 0.288, "MCP": 0.432}

INTRINSIC = {"LUM": "LU", "FPI": "UI"}
"""The tendons that join a hood from the sides, by their MCP rows."""
# Both heads of the first dorsal interosseous insert where An has one (RI).
ON_BONES: Mapping[str, tuple[Way, ...]] = {
    **FLEXORS,
    "FDIm": ((1.0, (("MCP", "RI"),)),),
    "FDIl": ((1.0, (("MCP", "RI"),)),),
}


def hood_strands(central: float = CENTRAL) -> Mapping[str, tuple[Way, ...]]:
    """The muscles of the hood where its slips carry fixed shares.  EI runs with EDC: the normative
    model has one long extensor (LE)."""
    return {
        "EDC": extensor("LE", ("RB", "UB"), central),
        "EI": extensor("LE", ("RB", "UB"), central),
        "LUM": extensor("LU", ("RB",), central),
        "FPI": extensor("UI", ("UB",), central),
    }


def finger_model(
    skeleton: Skeleton,
    o2o3: float = O2O3,
    bones: Mapping[str, Surface] | None = None,
    central: float | None = None,
) -> FingerModel:
    """Return the finger over a skeleton, with the muscles that act on the bones; where `central` is
    given (0 to 1) those of the hood too, that share of each going to the central slip.

    o2o3: m, the unit of the tendon paths; bones: surfaces by body, drawn instead of capsules.

    >>> from meshes.skeleton import index_finger
    >>> from rigid.fingers.index import finger_model
    >>> finger_model(index_finger()).muscles
    ('FDP', 'FDS', 'FDIm', 'FDIl')
    >>> finger_model(index_finger(), central=0.5).muscles[:4]
    ('EDC', 'EI', 'LUM', 'FPI')
    """
    hood = {} if central is None else hood_strands(central)
    anatomy = FingerAnatomy("index finger", ROWS, OFFSET, {**hood, **ON_BONES})
    return assemble(anatomy, skeleton, o2o3, bones)
