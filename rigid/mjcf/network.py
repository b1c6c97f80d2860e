"""A tendon network as parts of a MuJoCo model.

Junction positions s and connecting tendons k [s - l(theta)]^+ are MuJoCo's own words, see
`rigid.mjcf.hood`.  A length l is linear in the angles where its arms are constant; where an arm is
linear in its joint's angle, l has that angle's square, which is a follower of that joint.
"""

from __future__ import annotations

from collections.abc import Sequence

from rigid.hoods.network import Network
from rigid.mjcf.hood import Band, Follower, HoodParts

SQUARE = (0.0, 0.0, 1.0, 0.0, 0.0)


def network_parts(network: Network, tendons: Sequence[str]) -> HoodParts:
    """A network's parts, with the names (k,) of its connecting tendons."""
    slopes = abs(network.direct.slope).sum(axis=1) + abs(network.connecting.slope).sum(axis=1)
    bent = [joint for joint, slope in zip(network.joints, slopes, strict=True) if slope]
    owner = [network.muscles[i] for i in network.connection.argmax(axis=1)]
    muscles = {
        name: ({_junction(name): -1.0} if name in owner else {}) | _lengths(network, "direct", i)
        for i, name in enumerate(network.muscles)
    }
    bands = {
        name: Band(
            {_junction(owner[k]): 1.0} | _lengths(network, "connecting", k),
            float(network.rest[k]),
            float(network.stiffness[k]),
        )
        for k, name in enumerate(tendons)
    }
    junctions = tuple(_junction(name) for name in network.muscles if name in owner)
    return HoodParts(
        muscles, junctions, bands, {_square(j): Follower({j: 1.0}, SQUARE) for j in bent}
    )


def _lengths(network: Network, which: str, column: int) -> dict[str, float]:
    """What shortens a tendon, with a minus, by joint and square."""
    arms = getattr(network, which)
    out = {}
    for i, joint in enumerate(network.joints):
        if arms.constant[i, column]:
            out[joint] = -float(arms.constant[i, column])
        if arms.slope[i, column]:
            out[_square(joint)] = -float(arms.slope[i, column]) / 2
    return out


def _junction(muscle: str) -> str:
    return f"{muscle}_junction"


def _square(joint: str) -> str:
    return f"{joint}_square"
