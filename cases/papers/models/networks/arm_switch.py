"""Where an extensor's tension passes from its lateral bands to its slip.

Development and Validation of Modeling Framework for Interconnected Tendon Networks in Robotic and
Human Fingers, section III-A and figure 3: with l_LB - l_ES = d(theta), both ways bear while

    -f_m0 / k_LB < d < f_m0 / k_ES,                                                       (6, 7)

so that the switch is as wide as the operating force f_m0 and narrower the stiffer the tendons.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from cosim.port import Array
from rigid.hoods.network import Network

PIP, DIP = 1, 2
RANGE = (0.0, np.radians(120.0))
"""rad, of the PIP."""


class Ways(NamedTuple):
    """The tendons of a muscle that end at the middle phalanx, and those that go on."""

    slip: Array
    """(k,) bool."""
    lateral: Array
    """(k,) bool."""


class Switch(NamedTuple):
    """PIP angles, rad: up to `begin` the slip is slack, from `end` on the lateral bands are."""

    begin: float
    end: float

    @property
    def width(self) -> float:
        """The range of PIP angles, rad, at which slip and lateral bands are both taut."""
        return self.end - self.begin


def ways(network: Network, muscle: int) -> Ways:
    """Return which connecting tendons of a muscle end at the middle phalanx and which go on."""
    own = network.connection[:, muscle] > 0
    distal = (network.connecting.constant[DIP] != 0) | (network.connecting.slope[DIP] != 0)
    return Ways(own & ~distal, own & distal)


def switch(network: Network, muscle: int, dip: float, force: float) -> Switch:
    """The switch of a muscle at a DIP angle (rad) and an operating force (N), read off the
    network's own equilibrium."""
    slip, lateral = ways(network, muscle)
    forces = np.full(len(network.muscles), force)
    k_slip, k_lateral = (float(network.stiffness[way].sum()) for way in (slip, lateral))

    def spring_pulls(pip: float) -> tuple[float, float]:
        """The pull, N, in either way; negative where it is slack, by its slack's worth."""
        angle = np.array([0.0, pip, dip])
        position, length = network.solve(angle, forces)[0][muscle], network.lengths(angle)
        pulls = position - length[slip][0], position - length[lateral][0]
        return k_slip * float(pulls[0]), k_lateral * float(pulls[1])

    return Switch(
        brentq(lambda pip: spring_pulls(pip)[0], *RANGE, xtol=1e-14),
        brentq(lambda pip: spring_pulls(pip)[1], *RANGE, xtol=1e-14),
    )


def predict(network: Network, muscle: int, dip: float, force: float) -> Switch:
    """The same from the inequality above, for a slip and lateral bands of arms without slope at the
    DIP and a slope at the PIP in the bands alone: d is a parabola in the PIP angle."""
    slip, lateral = ways(network, muscle)
    arms, rest = network.connecting, network.rest
    s, b = (int(np.flatnonzero(way)[0]) for way in (slip, lateral))
    parabola = np.array(
        [
            0.5 * (arms.slope[PIP, b] - arms.slope[PIP, s]),
            arms.constant[PIP, b] - arms.constant[PIP, s],
            arms.constant[DIP, b] * dip + rest[b] - rest[s],
        ]
    )
    ends = (
        -force / float(network.stiffness[lateral].sum()),
        force / float(network.stiffness[slip].sum()),
    )
    roots = [max(np.roots(parabola - [0.0, 0.0, end]).real) for end in ends]
    return Switch(float(roots[0]), float(roots[1]))
