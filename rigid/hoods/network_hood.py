"""A tendon network on a finger's bones: its moment arms at joints become moments on bodies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Motion
from rigid.hoods.joint_angles import Joint
from rigid.hoods.joint_hood import PROXIMAL, Derived, JointHood
from rigid.hoods.network import Network
from rigid.model import Vector


class NetworkHood(JointHood):
    """A network on the bones, see `JointHood`; torques by the direct arms and by the connecting
    tendons.

    rest: the motion at which the unloaded tendons' excursions are zero; operating_force: N, for
    tension shares that depend on posture alone, as they are at this force of every muscle (9),
    instead of on the forces themselves.
    Raises InputError for hinges that do not fit or a force that is not positive."""

    sources, name = ("direct", "network"), "network hood"

    def __init__(
        self,
        network: Network,
        hinges: Sequence[Joint],
        rest: Motion,
        direction: Vector = PROXIMAL,
        operating_force: float | None = None,
    ) -> None:
        super().__init__(network.joints, network.muscles, hinges, rest.bodies, direction)
        if operating_force is not None and not operating_force > 0:
            raise InputError(f"network hood: operating force {operating_force} N is not positive")
        self.network, self._operating = network, operating_force
        self._rest = np.zeros(len(self.tendons))
        self._rest = self.start(rest).derived.excursion

    def derived(self, angle: Array, tension: Array) -> Derived:
        """The network's derivatives; excursions are counted from those at rest."""
        if self._operating is None:
            made = _at_forces(self.network, angle, tension)
        else:
            made = _at_constant_force(self.network, angle, tension, self._operating)
        return made._replace(excursion=made.excursion - self._rest)


def _at_forces(network: Network, angle: Array, force: Array) -> Derived:
    """Shares that follow from the forces themselves (8)."""
    position, tension = network.solve(angle, force)
    share = network.sharing_at(angle, position)
    bearing = network.stiffness[:, None] * (share > 0)
    spring = share @ bearing.T - np.diag(bearing.sum(axis=1))
    stretch = np.divide(1.0, bearing.sum(axis=0), out=np.zeros(len(force)), where=share.any(axis=0))
    excursion = network.direct.lengths(angle) + position
    return _in_joints(network, angle, force, tension, share, spring, excursion, stretch)


def _at_constant_force(network: Network, angle: Array, force: Array, operating: float) -> Derived:
    """Shares of posture alone (9): what the operating force makes, in proportion to the force."""
    same = np.full(len(force), operating)
    share = network.distribution(angle, same)
    bears = network.sharing(angle, same)
    bearing = network.stiffness[:, None] * (bears > 0) * force / operating
    spring = bears @ bearing.T - np.diag(bearing.sum(axis=1))
    excursion = network.constant_force_excursion(angle, same)
    still = np.zeros(len(force))
    return _in_joints(network, angle, force, share @ force, share, spring, excursion, still)


def _in_joints(
    network: Network,
    angle: Array,
    force: Array,
    tension: Array,
    share: Array,
    spring: Array,
    excursion: Array,
    stretch: Array,
) -> Derived:
    """Connecting tensions (k,), their derivatives by forces (k, m) and lengths (k, k), and the
    excursions, seen from the joints."""
    direct, connecting = network.direct.at(angle), network.connecting.at(angle)
    turning = network.direct.slope @ force + network.connecting.slope @ tension
    return Derived(
        np.stack([direct @ force, connecting @ tension]),
        excursion,
        np.diag(turning) + connecting @ spring @ connecting.T,
        direct + connecting @ share,
        np.diag(stretch),
    )
