"""Samples of a hood that a potential is fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from cosim.port import Array


@dataclass(frozen=True)
class Sample:
    """A hood's equilibrium on held bones, n joints and m muscles: of one state, or of s states with
    s first."""

    angle: Array
    """(n,) rad."""
    tension: Array
    """(m,) N."""
    torque: Array
    """(n,) N m of the hood."""
    excursion: Array
    """(m,) m."""
    stiffness: Array
    """(n, n) N m/rad, derivative of the torques by the angles."""
    arms: Array
    """(n, m) m, of the torques by the tensions."""
    compliance: Array
    """(m, m) m/N, of the excursions by the tensions."""
    slip: Array
    """(2,) N, central and terminal; NaN of a hood without slips."""


def stack(samples: Sequence[Sample]) -> Sample:
    """The states as one sample, states first."""
    return Sample(
        *(np.array([getattr(s, field.name) for s in samples]) for field in fields(Sample))
    )
