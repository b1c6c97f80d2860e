"""One description of a finger for two engines: the dynamic model of the thesis (section 2.2) in
plain numbers, which MuJoCo with our time steps and OpenSim both run.

Segments of 46, 28 and 20 mm with parallel flexion axes, posture 30/45/15 deg, coordinate limits of
+-5 deg about it, no passive spring, no gravity.  Tendons are the normative paths of `index_finger`
without wrapping; the extensor is the fixed split there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cosim.port import Array
from meshes.skeleton import JOINTS, Skeleton
from rigid.chain.joint_torques import JointLaw, joint_law
from rigid.fingers.index import finger_model
from rigid.model import FingerModel, Strand, Tendon, Via

LENGTHS = (0.046, 0.028, 0.020)
"""m, proximal to distal: the dynamic model's segments (assumption: the thesis does not print them;
the numbers are those of the earlier twin of it)."""
POSTURE: Mapping[str, float] = {
    "MCP": float(np.radians(30.0)),
    "MCP_abduction": 0.0,
    "PIP": float(np.radians(45.0)),
    "DIP": float(np.radians(15.0)),
}
"""rad (thesis, section 2.2.2)."""
TENSIONS: Mapping[str, float] = {
    "EDC": 3.469,
    "EI": 3.547,
    "FDP": 7.912,
    "FDS": 5.89,
    "FPI": 3.094,
    "LUM": 2.504,
}
"""N: 10 % of the greatest isometric forces (thesis, table 2)."""
LIMIT_DAMPING = float(np.degrees(0.01))
"""0.01 N m s/deg in N m s/rad; the thesis has 1, with which an explicit integrator crawls.  The
reaction at rest does not depend on it."""


def twin_model() -> FingerModel:
    """The finger; every tendon is a line through points."""
    axis = np.array([[0.0, 1, 0], [0, 0, 1], [0, 1, 0], [0, 1, 0]])
    skeleton = Skeleton(np.array([0.0, *LENGTHS]), np.tile(np.eye(3), (3, 1, 1)), axis, {})
    model = finger_model(skeleton, central=0.5).with_only(*TENSIONS)
    return replace(model, tendons=tuple(_straight(t) for t in model.tendons))


def twin_law() -> JointLaw:
    """Coordinate limits +-5 deg about the posture, and nothing else."""
    return joint_law(JOINTS, limit_damping=LIMIT_DAMPING).hold_about(POSTURE)


def tensions(tendons: tuple[str, ...], *muscles: str) -> Array:
    """The tensions (nt,) N of the muscles that pull."""
    return np.array([TENSIONS[t] if t in muscles else 0.0 for t in tendons])


def _straight(tendon: Tendon) -> Tendon:
    strands = tuple(
        Strand(tuple(e for e in s.path if isinstance(e, Via)), s.share) for s in tendon.strands
    )
    return Tendon(tendon.name, strands)
