"""The hoods in lumped form, live."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from cosim.errors import InputError
from cosim.hoods.kind import BuiltHood, HoodBuilder, MujocoHood, Site
from cosim.hoods.lesion import LesionConfig
from cosim.hoods.lumped.table import (
    JOINTS,
    ArmConfig,
    ConnectingTendonConfig,
    NetworkHoodConfig,
    ReductionConfig,
    TwoBandHoodConfig,
)
from cosim.port import Motion
from rigid.chain.hinge import BODIES
from rigid.hoods.joint_angles import flexion_joints, hinges_between, joints_of
from rigid.hoods.joint_hood import JointHood, JointState
from rigid.hoods.network import Arms, Network
from rigid.hoods.network_hood import NetworkHood
from rigid.hoods.reduced import ReducedHood
from rigid.hoods.reduced import ReducedPotential as ReducedPotential
from rigid.hoods.reduction import HELD
from rigid.hoods.reduction import Sample as Sample
from rigid.hoods.reduction import reduce_hood as reduce_hood
from rigid.hoods.reduction import stack as stack
from rigid.hoods.two_band import arms, band_stiffnesses
from rigid.model import FingerModel


def build(hood: NetworkHoodConfig, site: Site) -> BuiltHood:
    """The network as a lesion leaves it."""
    left, model = apply_lesion_to_network(hood, site.lesion), site.anatomy.model
    return BuiltHood(build_lumped_hood(left, model, site.rest), slips=partial(slip_forces, left))


def build_two_bands(hood: TwoBandHoodConfig, site: Site) -> BuiltHood:
    """The network of the two bands, live on a finger."""
    return build(as_network(hood), site)


def apply_lesion_to_network(
    network: NetworkHoodConfig, lesion: LesionConfig | None
) -> NetworkHoodConfig:
    """A hood in lumped form without the connecting tendons that are cut, others shorter or longer.

    Raises InputError where a muscle would be left to pull on nothing."""
    if lesion is None:
        return network
    cut = {tendon for part in lesion.cut for tendon in _tendons(network, part, "cut")}
    left = {name: t for name, t in network.connecting.items() if name not in cut}
    for part, more in lesion.length_changes().items():
        for name in _tendons(network, part, "shorten" if more < 0 else "lengthen"):
            if name in left:
                tendon = left[name]
                left[name] = tendon.model_copy(update={"rest": tendon.rest + more})
    pulling = {t.muscle for t in left.values()}
    if idle := [t.muscle for t in network.connecting.values() if t.muscle not in pulling]:
        raise InputError(f"lesion.cut: leaves no connecting tendon for {idle[0]} to pull; cut less")
    return network.model_copy(update={"connecting": left})


def _tendons(hood: NetworkHoodConfig, part: str, key: str) -> list[str]:
    """The connecting tendons of a part: those that cross the PIP last are the central slip, those
    that cross the DIP the terminal one.  Raises InputError where there are none."""
    if part in hood.connecting:
        return [part]
    last = {"central_slip": JOINTS[1], "terminal_slip": JOINTS[2]}[part]
    names = [
        n for n, t in hood.connecting.items() if [j for j in JOINTS if j in t.arms][-1] == last
    ]
    if not names:
        raise InputError(f"lesion.{key}: no connecting tendon ends where a {part} does")
    return names


def build_lumped_hood(
    hood: NetworkHoodConfig, model: FingerModel | None, rest: Motion
) -> JointHood:
    """The network on the flexion angles of a finger (None: hinges in a plane), excursions counted
    from the poses `rest`."""
    if hood.reduced is not None:
        return build_reduced_hood(potential(hood.reduced), model, rest.bodies)
    hinges = hinges_between(JOINTS, BODIES) if model is None else flexion_joints(model)
    return NetworkHood(_network(hood), hinges, rest, operating_force=hood.operating_force)


def build_reduced_hood(
    reduced: ReducedPotential, model: FingerModel | None, bodies: tuple[str, ...]
) -> ReducedHood:
    """A potential behind the port, on every hinge of a finger (None: hinges in a plane)."""
    hinges = hinges_between(reduced.joints, bodies) if model is None else joints_of(model)
    return ReducedHood(reduced, hinges, bodies)


def slip_forces(hood: NetworkHoodConfig, state: JointState) -> dict[str, float]:
    """What bears on the middle phalanx ("central": it crosses the PIP last) and on the distal one
    ("terminal") of a hood's connecting tendons, N."""
    at = state.angles.value
    if hood.reduced is not None:
        return potential(hood.reduced).slip_forces(at, state.derived.torque)
    network = _network(hood)
    if hood.operating_force is None:
        _, tension = network.solve(at, state.tension)
    else:
        share = network.distribution(at, np.full(len(network.muscles), hood.operating_force))
        tension = share @ state.tension
    return slips_of(hood, dict(zip(hood.connecting, map(float, tension), strict=True)))


def slips_of(hood: NetworkHoodConfig, tension: Mapping[str, float]) -> dict[str, float]:
    """What bears on the middle phalanx and on the distal one, N, of the tensions (N) of a hood's
    connecting tendons by name."""
    last = {name: _last_joint(tendon.arms) for name, tendon in hood.connecting.items()}
    return {
        slip: sum((tension[name] for name, crossed in last.items() if crossed == joint), 0.0)
        for slip, joint in (("central", JOINTS[1]), ("terminal", JOINTS[2]))
    }


def _last_joint(arms: Mapping[str, ArmConfig]) -> str:
    """The last joint that a tendon crosses at an arm other than zero; empty of none."""
    crossed = [j for j in JOINTS if j in arms and (arms[j].constant or arms[j].slope)]
    return crossed[-1] if crossed else ""


def potential(hood: ReductionConfig) -> ReducedPotential:
    """The potential that a case states."""
    low, high = np.array(list(hood.angles.values())).T
    return ReducedPotential(
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


def _network(hood: NetworkHoodConfig) -> Network:
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


def as_network(hood: TwoBandHoodConfig) -> NetworkHoodConfig:
    """The same two springs on one junction."""
    middle, lateral = band_stiffnesses(hood.elasticity, hood.lateral_share)
    return NetworkHoodConfig.model_construct(
        kind="network",
        muscles=hood.muscles,
        connecting={
            "middle_band": ConnectingTendonConfig.model_construct(
                muscle=hood.extensor, stiffness=middle, rest=0.0, arms=hood.middle
            ),
            "lateral_band": ConnectingTendonConfig.model_construct(
                muscle=hood.extensor, stiffness=lateral, rest=0.0, arms=hood.lateral
            ),
        },
        operating_force=None,
        reduced=None,
    )


def _arms(columns: Sequence[dict[str, ArmConfig]]) -> Arms:
    return arms([{j: (a.constant, a.slope) for j, a in column.items()} for column in columns])


def in_mujoco(hood: NetworkHoodConfig, lesion: LesionConfig | None) -> MujocoHood:
    """A network's junctions and tendons, or what comes near to a reduced hood, in plain MuJoCo.
    Raises InputError for shares that do not follow from forces."""
    if hood.reduced is not None:
        return _reduced_in_mujoco(potential(hood.reduced))
    from rigid.mjcf.hood import network_parts

    if hood.operating_force is not None:
        raise InputError(
            "hood.operating_force: shares that depend on posture alone are no mechanism of springs "
            "and junctions; leave it out, and they follow the forces"
        )
    left = apply_lesion_to_network(hood, lesion)
    parts = network_parts(_network(left), tuple(left.connecting))
    return MujocoHood(
        "network", JOINTS, None, lambda *_: parts, lambda tension, *_: slips_of(left, tension)
    )


def two_bands_in_mujoco(hood: TwoBandHoodConfig, lesion: LesionConfig | None) -> MujocoHood:
    """The network of the two bands in plain MuJoCo."""
    return in_mujoco(as_network(hood), lesion)


def _reduced_in_mujoco(reduced: ReducedPotential) -> MujocoHood:
    from rigid.mjcf.reduced import reduced_parts, states_of

    ends = zip(map(float, reduced.low), map(float, reduced.high), strict=True)
    angles = dict(zip(reduced.joints, ends, strict=True))
    return MujocoHood(
        "reduced",
        reduced.joints,
        (angles, dict(zip(reduced.muscles, map(float, reduced.most), strict=True))),
        lambda angle, tension, maps: reduced_parts(
            reduced, states_of(reduced, angle, tension), maps
        ),
        lambda _, angle, torque: reduced.slip_forces(angle, torque),
        tuple(j for j, (low, high) in angles.items() if high - low <= 2 * HELD + 1e-6),
    )


NETWORK = HoodBuilder(build, in_mujoco=in_mujoco)
TWO_BANDS = HoodBuilder(build_two_bands, in_mujoco=two_bands_in_mujoco)
