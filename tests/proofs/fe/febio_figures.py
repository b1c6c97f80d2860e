"""FEBio's published figures for five models of a sheet over three bones.

FEBio 4.11, one thread, PARDISO, shell elements `q4ans`; from the README that comes with the models,
by the names of their files.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

SOURCE = "FEBio 4.11, q4ans shells, one thread: the models' README"
REFERENCE_S = 0.95
"""CPU seconds of the reference job on FEBio's machine (0.91 to 1.06)."""


@dataclass(frozen=True)
class Published:
    """FEBio's last state."""

    displacement: Mapping[int, tuple[float, float, float]]
    """mm, by node number."""
    contact: tuple[float, ...]
    """N, resultants along z on the first two bodies."""
    largest: float
    """N, of the springs' forces."""
    total: float
    """N, sum of the springs' forces."""
    active: int
    """How many springs act."""
    penetration: float
    """um, the deepest, of a penalty without augmentation."""
    cpu_s: float
    """CPU seconds."""
    peak_mb: float
    """Peak memory, MB."""


PUBLISHED = {
    "free_iso_2000": Published(
        {
            11: (-0.846692, 0.0, -1.490595),
            1: (-0.739305, 0.202972, -1.706770),
            1271: (-0.003352, 0.0, -0.155221),
        },
        (),
        6.458,
        6.46,
        1,
        0.0,
        25.1,
        240,
    ),
    "hood_iso_500": Published(
        {
            6: (-0.436311, 0.0, 0.073390),
            1: (-0.469208, -0.009983, 0.125914),
            336: (0.000708, 0.0, 0.011817),
        },
        (-22.463, -8.229),
        3.570,
        36.88,
        91,
        3.3,
        1.5,
        159,
    ),
    "hood_iso_2000": Published(
        {
            11: (-0.489158, 0.0, 0.061405),
            1: (-0.520013, 0.000369, 0.105599),
            1271: (0.000043, 0.0, 0.001317),
        },
        (-18.261, -2.503),
        3.623,
        25.24,
        91,
        3.1,
        8.5,
        240,
    ),
    "hood_tiMR_500": Published(
        {
            6: (-0.447081, 0.0, 0.022884),
            1: (-0.444215, 0.013154, 0.059901),
            336: (0.000239, 0.0, 0.004860),
        },
        (-11.998, -2.657),
        5.825,
        21.55,
        21,
        5.1,
        1.3,
        159,
    ),
    "hood_flex30_500": Published(
        {
            6: (1.709827, 0.0, -0.020983),
            1: (1.601530, 0.033101, 0.022085),
            336: (2.605416, 0.0, -2.786901),
        },
        (-58.731, -22.921),
        22.659,
        98.92,
        21,
        13.5,
        25.1,
        159,
    ),
}
