"""What a run leaves behind: numbers, fields and pictures in a folder that is whole or not there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.port import Array

if TYPE_CHECKING:
    import xarray

STRAIN = "longitudinal_strain"
"""The hood's cell data that pictures show, dimensionless."""
LEDGER_HEADER = ("state", "body", "source", "Fx_N", "Fy_N", "Fz_N", "Mx_Nmm", "My_Nmm", "Mz_Nmm")


@dataclass(frozen=True)
class HoodField:
    """The deformed hood with its fields; pictures show `cell_data[STRAIN]`."""

    points: Array
    """(n, 3) deformed positions, m, world frame."""
    quads: np.ndarray
    """(m, 4) node numbers; of a hood of cables (m, 2)."""
    point_data: Mapping[str, Array]
    """(n,) or (n, 3) each."""
    cell_data: Mapping[str, Array]
    """(m,) or (m, 3) each."""


@dataclass(frozen=True)
class Scene:
    """What there is to see, m, world frame."""

    hood: HoodField | None
    bones: tuple[tuple[str, Array, np.ndarray], ...]
    """Name, vertices (n, 3), triangles (m, 3) turning counter-clockwise as seen from outside."""
    tendons: tuple[tuple[str, Array], ...]
    """Name, points (k, 3) in order."""
    tip: tuple[Array, Array] | None = None
    """The fingertip point (3,) and the force of the fingertip on the world (3,) N."""


@dataclass(frozen=True)
class LedgerRow:
    """One force on one body from one source, world frame."""

    state: str
    body: str
    source: str
    force: Array
    """(3,) N."""
    moment: Array
    """(3,) N m about the body's origin."""


@dataclass(frozen=True)
class Result:
    """Everything that a run found."""

    summary: Mapping[str, Any]
    """The numbers one asks for first; every key ends in its unit; written as JSON."""
    dataset: xarray.Dataset
    ledger: tuple[LedgerRow, ...]
    scene: Scene
