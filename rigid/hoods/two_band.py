"""The extensor digitorum over the PIP as two bands: Buchner, Hines and Hemami 1988, J Biomech 21.

The middle band ends behind the PIP, the lateral one beyond the DIP.  As the finger flexes each must
give way by its shift, and the tendon by the larger one (equation 5); where the shifts differ by

    e = R'12 phi2^2 - R13 phi3                                                             (15)

the tension F1 parts, with the share a of the lateral band at e = 0 and the elasticity K, as

    F6 = (1 - a) F1 + K e    (middle),     F7 = a F1 - K e    (lateral).                   (16)

These are two springs on one junction, of stiffness K / a and K / (1 - a); with springs that bear
tension only the bounds (18) keep themselves, and the larger shift is where the junction lies
without tension.  So this hood is a network of two connecting tendons.

Table 1 is scanned badly; each entry says how certain it is.  Those of ED (PIP, DIP) and
of the interossei (PIP) follow from the paper's own results, those of FDP reproduce its end forces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cosim.errors import InputError
from cosim.port import Array
from rigid.hoods.network import Arms, Network

JOINTS = ("MCP", "PIP", "DIP")
ELASTICITY = 500.0
"""N/m, K."""


@dataclass(frozen=True)
class Entry:
    """R (m) and R' (m/rad) of a tendon at a joint, e = +-(R +- R' phi) phi, and how surely the
    scan of table 1 says so."""

    radius: float
    slope: float = 0.0
    certainty: str = "certain"


LIKELY, UNCERTAIN = "likely", "uncertain"
TABLE_1: Mapping[tuple[str, str], Entry] = {
    ("ED", "MCP"): Entry(10e-3, 0.0, LIKELY),
    ("ED", "PIP"): Entry(5e-3, 1.21e-3),
    ("ED", "DIP"): Entry(3.5e-3),
    ("FDP", "MCP"): Entry(11.2e-3, 2.08e-3, LIKELY),
    ("FDP", "PIP"): Entry(9.6e-3, 2.23e-3, LIKELY),
    ("FDP", "DIP"): Entry(4.55e-3, 0.26e-3, LIKELY),
    ("FDS", "MCP"): Entry(10e-3, 2.05e-3, LIKELY),
    ("FDS", "PIP"): Entry(7e-3, 0.0, UNCERTAIN),
    ("Int", "MCP"): Entry(5e-3, 0.0, LIKELY),
    ("Int", "PIP"): Entry(5e-3),
    ("Lum", "MCP"): Entry(11.5e-3, 0.0, UNCERTAIN),
    ("Lum", "PIP"): Entry(4.34e-3, -0.45e-3, UNCERTAIN),
    ("Lum", "DIP"): Entry(3.5e-3, 0.0, LIKELY),
}
MUSCLES = ("ED", "FDP", "FDS", "Int", "Lum")


def arms(columns: Sequence[Mapping[str, tuple[float, float]]]) -> Arms:
    """Constants (m) and slopes (m/rad) by joint, a column for each tendon."""
    both = np.zeros((2, len(JOINTS), len(columns)))
    for k, column in enumerate(columns):
        for joint, value in column.items():
            both[:, JOINTS.index(joint), k] = value
    return Arms(both[0], both[1])


def middle_band(table: Mapping[tuple[str, str], Entry] = TABLE_1) -> dict[str, tuple[float, float]]:
    """Arm of the middle band: the derivative of -R12 phi2 (4b)."""
    return {"PIP": (-table["ED", "PIP"].radius, 0.0)}


def lateral_band(
    table: Mapping[tuple[str, str], Entry] = TABLE_1,
) -> dict[str, tuple[float, float]]:
    """Arms of lateral and terminal band: of -(R12 - R'12 phi2) phi2 - R13 phi3 (4a, 4c)."""
    pip = table["ED", "PIP"]
    return {"PIP": (-pip.radius, 2 * pip.slope), "DIP": (-table["ED", "DIP"].radius, 0.0)}


def direct_arms(
    table: Mapping[tuple[str, str], Entry] = TABLE_1,
) -> list[Mapping[str, tuple[float, float]]]:
    """The derivatives of (3) for ED (before it splits), FDP, FDS, Int and Lum; the lumbrical's
    origin moves with FDP (3e)."""

    def flexor(name: str) -> dict[str, tuple[float, float]]:
        return {j: (e.radius, 2 * e.slope) for (m, j), e in table.items() if m == name}

    profundus, of_lumbrical = flexor("FDP"), flexor("Lum")
    lumbrical = {"MCP": _sum(of_lumbrical["MCP"], profundus["MCP"], -1.0)}
    for joint in ("PIP", "DIP"):
        both = _sum(of_lumbrical[joint], profundus[joint], 1.0)
        lumbrical[joint] = (-both[0], -both[1])
    interossei = {"MCP": flexor("Int")["MCP"], "PIP": (-table["Int", "PIP"].radius, 0.0)}
    extensor = {"MCP": (-table["ED", "MCP"].radius, 0.0)}
    return [extensor, profundus, flexor("FDS"), interossei, lumbrical]


def _sum(a: tuple[float, float], b: tuple[float, float], sign: float) -> tuple[float, float]:
    return a[0] + sign * b[0], a[1] + sign * b[1]


def band_stiffnesses(elasticity: float, lateral_share: float) -> tuple[float, float]:
    """N/m, of the middle and the lateral band's spring.

    Raises InputError for a share that is not between 0 and 1: a band that bears nothing of its own
    when both shifts agree, or all, is no spring."""
    if not 0.0 < lateral_share < 1.0 or not elasticity > 0.0:
        raise InputError(
            f"two bands: expected a lateral share between 0 and 1 and a positive elasticity (N/m); "
            f"got {lateral_share} and {elasticity}"
        )
    return elasticity / lateral_share, elasticity / (1.0 - lateral_share)


def two_band(
    elasticity: float = ELASTICITY,
    lateral_share: float = 0.5,
    table: Mapping[tuple[str, str], Entry] = TABLE_1,
) -> Network:
    """The paper's finger: ED over two bands, FDP, FDS, Int and Lum straight to the bones."""
    springs = np.array(band_stiffnesses(elasticity, lateral_share))
    on_ed = np.zeros((2, len(MUSCLES)))
    on_ed[:, 0] = 1.0
    bands = arms([middle_band(table), lateral_band(table)])
    return Network(JOINTS, MUSCLES, arms(direct_arms(table)), bands, springs, on_ed, np.zeros(2))


def excursions(angle: Array, table: Mapping[tuple[str, str], Entry] = TABLE_1) -> Array:
    """The excursions (..., 5) m of `MUSCLES` at joint angles (..., 3) rad, positive where a muscle
    shortens (3): that of ED with the larger shift of either band (5)."""
    out = arms(direct_arms(table)).lengths(angle)
    bands = arms([middle_band(table), lateral_band(table)]).lengths(angle)
    out[..., 0] += bands.min(axis=-1)
    return out


def shift_difference(
    pip: Array, dip: Array, table: Mapping[tuple[str, str], Entry] = TABLE_1
) -> Array:
    """The difference of the bands' shifts, m: e of (15) at angles in rad; zero on the coupling
    curve (6)."""
    return table["ED", "PIP"].slope * pip**2 - table["ED", "DIP"].radius * dip


def band_forces(
    total: Array, difference: Array, elasticity: float, lateral_share: float
) -> tuple[Array, Array]:
    """The forces, N, of the middle and the lateral band (16), neither below zero (18)."""
    middle = np.clip((1.0 - lateral_share) * total + elasticity * difference, 0.0, total)
    return middle, total - middle


def coupled_dip(pip: Array, table: Mapping[tuple[str, str], Entry] = TABLE_1) -> Array:
    """The DIP angle, rad, on the coupling curve (6): a parabola in the PIP angle (rad)."""
    return table["ED", "PIP"].slope / table["ED", "DIP"].radius * pip**2
