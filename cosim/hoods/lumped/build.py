"""From a case's hood in lumped form to a live one.  One of the files that know the solvers by
name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from cosim.fingers.hinge import HingeFinger
from cosim.fingers.kinds import AnyFinger, finger_model
from cosim.hoods.lumped.table import JOINTS, Arm, NetworkHood, Reduced, TwoBandHood
from cosim.hoods.split import SplitHood
from cosim.port import Array, Hood, Motion, State
from rigid.hoods.reduced_sample import Sample as Sample
from rigid.hoods.reduced_sample import stacked as stacked

if TYPE_CHECKING:
    from rigid.hoods.hinge_angle import HingeAngle
    from rigid.hoods.network import Arms, Network
    from rigid.hoods.reduced import Potential as Potential
    from rigid.hoods.reduced import ReducedHood


def lumped_hood(hood: NetworkHood | TwoBandHood, finger: AnyFinger, rest: Motion) -> Hood:
    """The network on the flexion angles of a finger, excursions counted from the poses `rest`."""
    from rigid.hoods.network_hood import NetworkHood as OnBodies

    if isinstance(hood, NetworkHood) and hood.reduced is not None:
        return reduced_hood(potential(hood.reduced), finger, rest.bodies)
    network = _network(hood) if isinstance(hood, NetworkHood) else _two_bands(hood)
    operating = hood.operating_force if isinstance(hood, NetworkHood) else None
    return OnBodies(network, _hinges(hood, finger), rest, operating_force=operating)


def slips_of(hood: object, finger: AnyFinger) -> Callable[[State], Mapping[str, float]] | None:
    """`slip_forces` of a hood of that kind, None for another."""
    if not isinstance(hood, NetworkHood | TwoBandHood):
        return None
    return lambda state: slip_forces(hood, finger, state)


def slip_forces(
    hood: NetworkHood | TwoBandHood, finger: AnyFinger, state: State
) -> dict[str, float]:
    """N, what bears on the middle phalanx ("central": it crosses the PIP last) and on the distal
    one ("terminal") of a hood's connecting tendons."""
    from rigid.hoods.hinge_angle import angles

    if isinstance(hood, NetworkHood) and hood.reduced is not None:
        made = reduced_hood(potential(hood.reduced), finger, state.motion.bodies)
        return made.slip_forces(state)
    network = _network(hood) if isinstance(hood, NetworkHood) else _two_bands(hood)
    at = angles(_hinges(hood, finger), state.motion).value
    operating = hood.operating_force if isinstance(hood, NetworkHood) else None
    if operating is None:
        _, tension = network.solve(at, state.tension)
    else:
        share = network.distribution(at, np.full(len(network.muscles), operating))
        tension = share @ state.tension
    _, beyond_pip, beyond_dip = (network.connecting.at(at) != 0) | (network.connecting.slope != 0)
    return {
        "central": float(tension[beyond_pip & ~beyond_dip].sum()),
        "terminal": float(tension[beyond_dip].sum()),
    }


def split_slips(
    finger: AnyFinger, hood: SplitHood, tension: Mapping[str, float]
) -> dict[str, float]:
    """N, of the strands that end on the middle and on the distal phalanx, of the tendons (by name,
    N) that a fixed split has and the bare finger has not."""
    from meshes.skeleton import BODIES

    if isinstance(finger, HingeFinger):
        return {}
    bare, ends = finger_model(finger, None).muscles, {"central": BODIES[2], "terminal": BODIES[3]}
    strands = [
        (strand.path[-1].body, strand.share * tension[tendon.name])
        for tendon in finger_model(finger, hood).tendons
        if tendon.name not in bare
        for strand in tendon.strands
    ]
    return {slip: sum(f for body, f in strands if body == end) for slip, end in ends.items()}


def _hinges(hood: NetworkHood | TwoBandHood, finger: AnyFinger) -> tuple[HingeAngle, ...]:
    from rigid.chain.hinge import BODIES
    from rigid.hoods.hinge_angle import HingeAngle, flexion_angles

    if not isinstance(finger, HingeFinger):
        return flexion_angles(finger_model(finger, hood))
    joints = zip(JOINTS, BODIES[:-1], BODIES[1:], strict=True)
    return tuple(HingeAngle(*names) for names in joints)


def reduced_hood(made: Potential, finger: AnyFinger, bodies: tuple[str, ...]) -> ReducedHood:
    """A potential behind the port, on every hinge of a finger."""
    from rigid.hoods.hinge_angle import HingeAngle
    from rigid.hoods.reduced import ReducedHood
    from rigid.hoods.universal_angle import Joint, joints_of

    hinges: tuple[Joint, ...]
    if isinstance(finger, HingeFinger):
        joints = zip(made.joints, bodies[:-1], bodies[1:], strict=True)
        hinges = tuple(HingeAngle(*names) for names in joints)
    else:
        hinges = joints_of(finger_model(finger, None))
    return ReducedHood(made, hinges, bodies)


def fitted(
    samples: Sample,
    joints: tuple[str, ...],
    tendons: tuple[str, ...],
    maps: Array | None = None,
) -> Potential:
    """The potential of a hood from samples of it, see `rigid.hoods.reduction.reduced`."""
    from rigid.hoods.reduction import reduced

    return reduced(samples, joints, tendons, maps=maps)


def potential(hood: Reduced) -> Potential:
    """The potential that a case states."""
    from rigid.hoods.reduced import Potential

    low, high = np.array(list(hood.angles.values())).T
    return Potential(
        tuple(hood.angles),
        tuple(hood.tensions),
        low,
        high,
        np.array(list(hood.tensions.values())),
        np.array(hood.angle_powers),
        np.array(hood.tension_terms),
        hood.toe,
        np.array(hood.energy),
        np.array(hood.slip_powers),
        np.array(hood.slips),
    )


def _network(hood: NetworkHood) -> Network:
    from rigid.hoods.network import Network

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


def band_tendons(hood: TwoBandHood) -> tuple[float, float]:
    """N/m, of the middle and of the lateral band."""
    from rigid.hoods.two_band import band_stiffnesses

    return band_stiffnesses(hood.elasticity, hood.lateral_share)


def _two_bands(hood: TwoBandHood) -> Network:
    from rigid.hoods.network import Network

    muscles = tuple(hood.muscles)
    connection = np.array([[m == hood.extensor for m in muscles]] * 2, dtype=float)
    return Network(
        JOINTS,
        muscles,
        _arms(list(hood.muscles.values())),
        _arms([hood.middle, hood.lateral]),
        np.array(band_tendons(hood)),
        connection,
        np.zeros(2),
    )


def _arms(columns: Sequence[dict[str, Arm]]) -> Arms:
    from rigid.hoods.two_band import arms

    return arms([{j: (a.constant, a.slope) for j, a in column.items()} for column in columns])
