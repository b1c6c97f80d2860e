"""Hoods in lumped form on the index finger: each with motions to pass through, tensions (nt,) N and
the tolerance of its derivatives at the conformance suite's step."""

from __future__ import annotations

import numpy as np

from cases.papers.models.networks.human_network import OPERATING_FORCE, human_finger
from cosim.port import Array, Hood, Motion
from meshes.skeleton import BODIES, index_finger
from rigid.fingers.index import finger_model
from rigid.hoods.joint_angles import flexion_joints
from rigid.hoods.network import Network
from rigid.hoods.network_hood import NetworkHood
from rigid.hoods.two_band import two_band

Subject = tuple[Hood, list[Motion], Array, float]
POSTURES = (
    {},
    {"MCP": 0.25, "MCP_abduction": 0.05, "PIP": 0.4, "DIP": 0.1},
    {"MCP": 0.5, "MCP_abduction": -0.1, "PIP": 0.8, "DIP": 0.23},
)
"""rad; the last by the coupling curve."""


def network_hood() -> Subject:
    """Last, EDC and UI bear in all their tendons and LUM in one."""
    return _on_index(human_finger(), np.array([10.0, 1.0, 7.0, 2.0, 20.0, 15.0]), None)


def constant_force_hood() -> Subject:
    tension = np.array([10.0, 1.0, 7.0, 2.0, 20.0, 15.0])
    return _on_index(human_finger(), tension, OPERATING_FORCE)


def two_band_hood() -> Subject:
    return _on_index(two_band(), np.array([15.0, 5.0, 1.0, 2.0, 0.5]), None)


def _on_index(network: Network, tension: Array, operating: float | None) -> Subject:
    skeleton = index_finger()
    motions = [Motion(BODIES, *skeleton.pose(posture)) for posture in POSTURES]
    hinges = flexion_joints(finger_model(skeleton))
    hood = NetworkHood(network, hinges, motions[0], operating_force=operating)
    return hood, motions, tension, 1e-6
