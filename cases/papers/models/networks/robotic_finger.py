"""A finger like the robotic one of Development and Validation of Modeling Framework for
Interconnected Tendon Networks in Robotic and Human Fingers, section IV.

The paper prints what is there (four muscles, EDC and LUM over a slip and lateral bands of similar
stiffness, so that one share holds for both) and none of its numbers.  Taken here instead: the arms
and links of Buchner, Hines and Hemami 1988 (tables 1 and 2), of the form that the paper identifies;
for EDC and LUM alike the stiffnesses of the paper's human EDC, 126 N/mm the slip and 2 x 40 N/mm
the bands; flexors as stiff as a slip; no rest lengths.
"""

from __future__ import annotations

import numpy as np

from rigid.chain.planar_chain import BUCHNER
from rigid.hoods.network import Network
from rigid.hoods.two_band import JOINTS, TABLE_1, arms, direct_arms, lateral_band, middle_band

MUSCLES = ("FDP", "FDS", "EDC", "LUM")
TENDONS = ("FDP", "FDS", "EDC slip", "EDC lateral", "LUM slip", "LUM lateral")
SLIP, LATERAL = 126e3, 80e3
"""N/m."""
OWNERS = (0, 1, 2, 2, 3, 3)
"""The muscle of each tendon."""
SLIP_OF = {"EDC": 2, "LUM": 4}
"""Where a muscle's slip stands among the tendons; its lateral bands follow."""
LENGTH = BUCHNER.length


def robotic_finger() -> Network:
    """Muscles cross the MCP themselves; a flexor's way on is a connecting tendon of its own."""
    extensor, profundus, superficialis, _, _ = direct_arms()
    beyond = [{j: way[j] for j in JOINTS[1:] if j in way} for way in (profundus, superficialis)]
    ways = [*beyond, middle_band(), lateral_band(), middle_band(), lateral_band()]
    at_mcp = [profundus["MCP"], superficialis["MCP"], extensor["MCP"]]
    at_mcp.append((TABLE_1["Lum", "MCP"].radius, 0.0))
    connection = np.zeros((len(TENDONS), len(MUSCLES)))
    connection[np.arange(len(TENDONS)), OWNERS] = 1.0
    return Network(
        JOINTS,
        MUSCLES,
        arms([{"MCP": arm} for arm in at_mcp]),
        arms(ways),
        np.array([SLIP, SLIP, SLIP, LATERAL, SLIP, LATERAL]),
        connection,
        np.zeros(len(TENDONS)),
    )
