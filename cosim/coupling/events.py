"""Parts of a hood that give way or begin to act: what they bear, when, and what is kept of it."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from cosim.port import Array, Hood, Mask, State

NO_EVENTS = np.zeros((0, 8))
FAILS, BEGINS = 0.0, 1.0
TIME_ROUNDING = 1e-12
"""s, by which times that are the same may differ."""


class Event(NamedTuple):
    """A row of a motion's events."""

    part: float
    """Its number among the hood's; of a splint, after these."""
    time: float
    """s."""
    force: float
    """N; of a splint its torque, N m."""
    stretch: float
    """m."""
    freed: float
    """J that it had stored."""
    lost: float
    """J that the whole hood lost, with what its tendons put in at once; of several at once a part
    each."""
    kind: float
    """FAILS or BEGINS."""
    together: float
    """With how many others, the order not told."""


class Bearing(NamedTuple):
    """What the parts (k,) bear."""

    force: Array
    """N."""
    stretch: Array
    """m, where each is longest beyond its length at rest."""
    energy: Array
    """J."""
    share: Array
    """The largest of force, stretch and energy over what each can bear; 0 without such a limit."""
    left: Array
    """The share of its stiffness that each has left."""


class Schedule(NamedTuple):
    """Times (k,) s by part, inf where there is none."""

    begins: Array
    ends: Array
    over_time: Array
    """How long each takes to let go; 0 of a brittle one."""
    over_stretch: Array
    """m that each stretches further as it lets go; 0 of a brittle one."""


class GivingHood(Hood, Protocol):
    """A hood of which k parts give way or begin to act."""

    @property
    def names(self) -> tuple[str, ...]:
        """What the parts are called."""
        ...

    @property
    def schedule(self) -> Schedule:
        """When they do by the clock, and how."""
        ...

    def with_left(self, state: State, left: Array, begin: Mask) -> State:
        """The state with other shares (k,), not in equilibrium; parts that `begin` (k,) are free of
        stress in its shape."""
        ...

    def bearing(self, state: State) -> Bearing:
        """What the parts bear in a state that `advance` returned."""
        ...

    def energy(self, state: State) -> float:
        """J stored in the hood."""
        ...
