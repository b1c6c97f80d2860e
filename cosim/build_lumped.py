"""From a case's hood in lumped form to a live one.  One of the files that know the solvers by
name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cosim.build_finger import AnyFinger, finger_model
from cosim.case_finger import HingeFinger
from cosim.case_lumped import JOINTS, Arm, NetworkHood, TwoBandHood
from cosim.port import Hood, Motion

if TYPE_CHECKING:
    from rigid.hinge_angle import HingeAngle
    from rigid.network import Arms, Network


def lumped_hood(hood: NetworkHood | TwoBandHood, finger: AnyFinger, rest: Motion) -> Hood:
    """The network on the flexion angles of a finger, excursions counted from the poses `rest`."""
    from rigid.network_hood import NetworkHood as OnBodies

    network = _network(hood) if isinstance(hood, NetworkHood) else _two_bands(hood)
    operating = hood.operating_force if isinstance(hood, NetworkHood) else None
    return OnBodies(network, _hinges(hood, finger), rest, operating_force=operating)


def _hinges(hood: NetworkHood | TwoBandHood, finger: AnyFinger) -> tuple[HingeAngle, ...]:
    from rigid.hinge import BODIES
    from rigid.hinge_angle import HingeAngle, flexion_angles

    if not isinstance(finger, HingeFinger):
        return flexion_angles(finger_model(finger, hood))
    joints = zip(JOINTS, BODIES[:-1], BODIES[1:], strict=True)
    return tuple(HingeAngle(*names) for names in joints)


def _network(hood: NetworkHood) -> Network:
    from rigid.network import Network

    muscles, tendons = tuple(hood.muscles), list(hood.connecting.values())
    connection = np.array([[t.muscle == m for m in muscles] for t in tendons], dtype=float)
    return Network(
        JOINTS,
        muscles,
        _arms(list(hood.muscles.values())),
        _arms([t.arms for t in tendons]),
        np.array([t.stiffness for t in tendons]),
        connection.reshape(len(tendons), len(muscles)),
        np.array([t.rest for t in tendons]),
    )


def _two_bands(hood: TwoBandHood) -> Network:
    from rigid.network import Network
    from rigid.two_band import band_stiffnesses

    muscles = tuple(hood.muscles)
    connection = np.array([[m == hood.extensor for m in muscles]] * 2, dtype=float)
    return Network(
        JOINTS,
        muscles,
        _arms(list(hood.muscles.values())),
        _arms([hood.middle, hood.lateral]),
        np.array(band_stiffnesses(hood.elasticity, hood.lateral_share)),
        connection,
        np.zeros(2),
    )


def _arms(columns: Sequence[dict[str, Arm]]) -> Arms:
    from rigid.two_band import arms

    return arms([{j: (a.constant, a.slope) for j, a in column.items()} for column in columns])
