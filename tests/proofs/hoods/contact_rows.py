"""Hard point contact: the network settles where the optimal share says."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cases.papers.models.networks.human_network import MUSCLES, STIFFNESS, TENDONS, human_finger
from cases.papers.models.networks.point_contact import best_share, distal_torque, settle
from cosim.port import Array
from rigid.chain.planar_chain import BUCHNER
from rigid.hoods.network import Network
from rigid.hoods.two_band import TABLE_1, coupled_dip
from tests.helpers.rows import Row

PAPER = (
    "Development and Validation of Modeling Framework for Interconnected Tendon Networks in "
    "Robotic and Human Fingers, section IV-C: optimum and settled simulation are identical"
)
SPRINGS = "both of EDC's ways bear while their lengths differ by less than force / stiffness"
START = np.array([0.4, 0.8, 0.3])
"""rad."""
EDC = 10.0
"""N."""
LOADS: tuple[dict[str, float], ...] = ({}, {"FDP": 3.0}, {"FDP": 3.0, "FDS": 4.0})
"""N beside EDC; the paper's own are in its figure alone."""
SLIP = TENDONS.index("EDC slip")
SOFTER = min(STIFFNESS[SLIP], STIFFNESS[SLIP - 1] + STIFFNESS[SLIP + 1])
"""N/m, of EDC's two ways: the slip, and both lateral bands."""


def rows() -> Iterator[Row]:
    """EDC alone, with FDP, and with FDS too."""
    network = human_finger()
    for others in LOADS:
        name = " + ".join(["EDC 10 N", *(f"{m} {f:g} N" for m, f in others.items())])
        force = np.array([{"EDC": EDC, **others}.get(muscle, 0.0) for muscle in MUSCLES])
        angle = settle(BUCHNER.length, network, force, START, time=50.0)
        bears = float(network.solve(angle, force)[1][SLIP] / EDC)
        apart = abs(_optimum(network, angle, force) - bears)
        yield Row(name, "optimal share less the settled one", 1e-6, apart, 0.0, PAPER, "bound")
        away = abs(float(angle[2] - coupled_dip(angle[1])))
        most = EDC / SOFTER / TABLE_1["ED", "DIP"].radius
        yield Row(name, "DIP away from the coupling curve, rad", most, away, 0.0, SPRINGS, "bound")


def _optimum(network: Network, angle: Array, force: Array) -> float:
    """The share of EDC to the slip that leaves the least torque on the distal phalanx."""
    direct, bands = network.direct.at(angle) @ force, network.connecting.at(angle)
    ways = (bands[:, SLIP + 1], bands[:, SLIP])
    ends = [distal_torque(BUCHNER.length, angle, direct + EDC * way) for way in ways]
    return best_share(*ends)
