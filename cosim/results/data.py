"""What a run leaves behind: numbers, fields and pictures in a folder that is whole or not there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.hoods.view import HoodField
from cosim.port import Array

if TYPE_CHECKING:
    import xarray

LEDGER_HEADER = ("state", "body", "source", "Fx_N", "Fy_N", "Fz_N", "Mx_Nmm", "My_Nmm", "Mz_Nmm")


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
