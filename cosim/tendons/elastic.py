"""Tendons that stretch between what draws them and their paths."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cosim.port import Array
from cosim.tendons.table import TendonConfig


def stretch_of(tendons: Sequence[TendonConfig]) -> tuple[Array, Array]:
    """By how much tendons stretch (n,) m/N, and their slack (n,) m; zero of one that keeps its
    length."""
    elastic = [t.elastic for t in tendons]
    give = [0.0 if e is None else 1.0 / e.rate for e in elastic]
    return np.array(give), np.array([0.0 if e is None else e.slack for e in elastic])
