"""The human finger of Development and Validation of Modeling Framework for Interconnected Tendon
Networks in Robotic and Human Fingers, section III.

Stiffnesses, connections, rest lengths and the arm of the extensor slip are the paper's; its other
arms, taken from a work of others, are not printed.  They are Buchner's here (`two_band.TABLE_1`),
which are of the same form: constant at the DIP, first order in the PIP angle at the lateral bands.
The paper does not say which of an intrinsic muscle's two tendons (43 and 75 N/mm) is the slip's:
here the stiffer one, as of EDC's.  RI inserts into the proximal phalanx, with the arm of Buchner's
interossei.
"""

from __future__ import annotations

import numpy as np

from rigid.hoods.network import Network
from rigid.hoods.two_band import JOINTS, TABLE_1, arms, direct_arms, lateral_band, middle_band

MUSCLES = ("EDC", "LUM", "UI", "RI", "FDP", "FDS")
TENDONS = (
    "UI lateral",
    "UI slip",
    "EDC ulnar",
    "EDC slip",
    "EDC radial",
    "LUM slip",
    "LUM lateral",
)
OPERATING_FORCE = 10.0
"""N, f_m0."""
STIFFNESS = 1e3 * np.array([43.0, 75.0, 40.0, 126.0, 40.0, 75.0, 43.0])
"""N/m."""
CONNECTIONS = ((1, 3), (2, 3), (3, 1), (4, 1), (5, 1), (6, 2), (7, 2))
"""Tendon and muscle, counted from 1 as the paper does."""


def human_finger() -> Network:
    """Joints MCP, PIP, DIP; six muscles and seven connecting tendons."""
    connection = np.zeros((len(TENDONS), len(MUSCLES)))
    for tendon, muscle in CONNECTIONS:
        connection[tendon - 1, muscle - 1] = 1.0
    slip, lateral = middle_band(), lateral_band()
    bands = [slip if name.endswith("slip") else lateral for name in TENDONS]
    extensor, profundus, superficialis, interossei, _ = direct_arms()
    lumbrical = {"MCP": (TABLE_1["Lum", "MCP"].radius, 0.0)}
    to_bone = {"MCP": interossei["MCP"]}
    direct = [extensor, lumbrical, to_bone, to_bone, profundus, superficialis]
    rest = np.zeros(len(TENDONS))
    return Network(JOINTS, MUSCLES, arms(direct), arms(bands), STIFFNESS, connection, rest)
