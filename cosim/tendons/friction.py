"""Friction along the tendons of a case's finger.

One of the files that know the solvers by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, cast

import numpy as np

from cosim.port import Array, OpenFinger, State
from cosim.tendons.table import Sliding, TendonConfig

if TYPE_CHECKING:
    from rigid.chain.statics import ChainFinger
    from rigid.mujoco.finger import MujocoFinger


def with_friction(
    finger: OpenFinger, tendons: Mapping[str, TendonConfig], sliding: Sliding | None = None
) -> OpenFinger:
    """The finger of ours with the friction that the case states of its own tendons, each as it
    slides there, or all sliding one way.  Raises InputError."""
    from rigid.mujoco.tendon_friction import PRESLIDING, TendonFriction

    friction = {
        name: TendonFriction(
            float(tendon.friction),
            sliding or tendon.sliding or "loading",
            tendon.presliding or PRESLIDING,
            np.inf if tendon.elastic is None else tendon.elastic.rate,
        )
        for name, tendon in tendons.items()
        if tendon.friction is not None
    }
    return cast("ChainFinger", finger).with_friction(friction)


def without_friction(finger: OpenFinger) -> OpenFinger:
    """The finger of ours with tendons that glide freely."""
    return cast("ChainFinger", finger).with_friction({})


def beyond_guides(
    finger: OpenFinger, state: State, tension: Array
) -> Mapping[str, tuple[float, float]]:
    """The tension (N) left at the insertions of each tendon with friction together, under tensions
    (nt,) N, and the angle (rad) by which it turns at guides."""
    return cast("MujocoFinger", finger).beyond_guides(finger.angles(state), tension)
