"""Hard point contact through the orchestrator: a case is run, and its arrays are read.

A force on the fingertip and a torque on the distal phalanx alone make joint torques tau = J' f_x
(equation 12 of paper 000); of those that some muscles make, f_x is their part of what the fingertip
passes on.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import cast

import numpy as np

from cosim.case.file import load_case
from cosim.hoods.lumped.table import JOINTS
from cosim.hoods.lumped.table import NetworkHoodConfig as NetworkTable
from cosim.models.build import build
from cosim.pipeline import run_case
from cosim.port import STATIC, Array, Motion
from rigid.chain.kinematics import Chain, body_jacobian, tip_jacobian
from rigid.hoods.network import Network
from rigid.hoods.network_hood import NetworkHood
from rigid.mujoco.finger import MujocoFinger
from rigid.papers.networks.point_contact import best_share

EXTENSORS = ("EDC", "LUM", "FPI")
SETTLED = (0.995, 1.995, 2.995)
"""s, before the next muscle begins to pull."""


@dataclass(frozen=True)
class ContactRun:
    """A run, over n times."""

    time: Array
    """(n,) s."""
    force: dict[str, Array]
    """(n,) N, by muscle."""
    angle: Array
    """(n, 3) rad, of MCP, PIP and DIP in flexion."""
    tendon: Array
    """(n, k) N, of the connecting tendons."""
    names: tuple[str, ...]
    """The connecting tendons' names."""
    tip_force: Array
    """(n, 3) N of the fingertip on the world."""
    extensors: Array
    """(n, 4) N and N m: f_x of the extensor mechanism's muscles alone."""
    optimum: Array
    """(n,) the share of EDC to the slip that leaves the least torque on the distal phalanx, all
    else as it is."""

    def at(self, time: float) -> int:
        """The index of the time that is nearest to `time`, s."""
        return int(np.abs(self.time - time).argmin())

    @property
    def share(self) -> Array:
        """(n,) of EDC's force that its slip bears."""
        return self.tendon[:, self.names.index("edc_slip")] / self.force["EDC"]


@lru_cache(maxsize=4)
def contact(case: str, settings: tuple[str, ...] = ()) -> ContactRun:
    """The motion of a case with a network and a finger on MuJoCo, as `cosim run` makes it.

    Raises InputError and ConvergenceError."""
    loaded = load_case(case, settings)
    data = run_case(loaded).data
    models = build(loaded)
    stated = cast(NetworkTable, loaded.hood)
    hood, finger = cast(NetworkHood, models.hood), cast(MujocoFinger, models.finger)
    flexion = data.angle.sel(joint=list(JOINTS)).values
    tension, own = data.tension.values, data.own_tension.values
    _, tendons = hood.network.solve(flexion, tension)
    begun = finger.chain(data.angle.values[0]).motion
    parts, best = [], []
    for k, angles in enumerate(data.angle.values):
        chain = finger.chain(angles)
        extending = np.where(np.isin(hood.tendons, EXTENSORS), tension[k], 0.0)
        by_others = finger.own_torques(angles, own[k])
        rest = sum(by_others.values()) + _torques(hood, begun, chain, tension[k] - extending)
        extensors = _torques(hood, begun, chain, extending)
        parts.append(_tip_effect(chain, extensors))
        way = _change_by_split(hood.network, flexion[k], tendons[k], tension[k], finger.joints)
        best.append(best_share(*(_tip_effect(chain, rest + extensors + w)[3] for w in way)))
    names = (*hood.tendons, *finger.tendons)
    pulls = np.hstack([tension, own])
    return ContactRun(
        data.time.values,
        {name: pulls[:, k] for k, name in enumerate(names)},
        flexion,
        tendons,
        tuple(stated.connecting),
        data.tip_force.values,
        np.array(parts),
        np.array(best),
    )


def _torques(hood: NetworkHood, begun: Motion, chain: Chain, tension: Array) -> Array:
    """(nq,) N m of the hood on the joints."""
    load = hood.advance(hood.start(begun), chain.motion, tension, STATIC).load
    return np.asarray(body_jacobian(chain).T @ load.total().ravel())


def _tip_effect(chain: Chain, torque: Array) -> Array:
    """(4,) N and N m: f_x of joint torques (nq,), on the fingertip and about the last axis."""
    tip = tip_jacobian(chain)
    rows = np.vstack([tip[:3], chain.axis[-1] @ tip[3:]])
    found: Array = np.linalg.lstsq(rows.T, torque, rcond=None)[0]
    return found


def _change_by_split(
    network: Network, flexion: Array, tendon: Array, tension: Array, joints: tuple[str, ...]
) -> tuple[Array, Array]:
    """(nq,) N m each: what joint torques change by where all of EDC's force runs over the lateral
    bands, or all over the slip."""
    edc = network.muscles.index("EDC")
    own = network.connection[:, edc] > 0
    distal = network.connecting.constant[-1] != 0
    arms = np.zeros((len(joints), len(tendon)))
    for joint, row in zip(network.joints, network.connecting.at(flexion), strict=True):
        arms[joints.index(joint)] = row
    ways = []
    for way in (own & distal, own & ~distal):
        stiffness = np.where(way, network.stiffness, 0.0)
        alone = stiffness / stiffness.sum() * tension[edc]
        ways.append(arms @ (alone - np.where(own, tendon, 0.0)))
    return ways[0], ways[1]
