"""What pulls the tendons: the seam between wanted tendon forces and the finger, and a stand-in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from cosim.port import Array

MOST_FORCE = 40.0
"""N: section VII."""
PERIOD = 0.01
"""s: the paper's control loop."""
LATENCY = 0.05
"""s: "about 50 ms to reach its maximum effect" (section IV)."""
State = TypeVar("State")


class Actuator(Protocol[State]):
    """Turns wanted tendon forces into forces, in advance of what delays it; the state is a value of
    its own kind.  A sample is: one `command`, then `advance` over `PERIOD`."""

    def begin(self, force: Array, length: Array) -> State:
        """The state in which it has long borne `force` (nt,) N on tendons `length` (nt,) m long."""

    def command(self, state: State, wanted: Array) -> State:
        """Return the state after the command to make `wanted` (nt,) N, given once in a sample."""

    def advance(self, state: State, length: Array, dt: float) -> State:
        """`dt` s later, the tendons having become `length` (nt,) m long."""

    def force(self, state: State) -> Array:
        """The tendons' forces (nt,) N, none negative."""


class Lagged(NamedTuple):
    """The state of actuators of first order, (nt,) N each."""

    force: Array
    aim: Array


@dataclass(frozen=True)
class Lag:
    """A stand-in for the air: of first order, at 95 % after the latency, whatever the tendons'
    motion."""

    time: float = LATENCY / 3
    """s."""
    most: float = MOST_FORCE

    def begin(self, force: Array, length: Array) -> Lagged:
        """At rest at what the supply can hold."""
        held = np.clip(force, 0.0, self.most)
        return Lagged(held, held)

    def command(self, state: Lagged, wanted: Array) -> Lagged:
        """The aim that takes the force to `wanted` within a sample, as far as the supply allows."""
        gain = 1.0 / (1.0 - np.exp(-PERIOD / self.time))
        aim = np.clip(state.force + gain * (wanted - state.force), 0.0, self.most)
        return state._replace(aim=aim)

    def advance(self, state: Lagged, length: Array, dt: float) -> Lagged:
        """Towards the aim, exactly."""
        left = np.exp(-dt / self.time)
        return state._replace(force=state.aim + (state.force - state.aim) * left)

    def force(self, state: Lagged) -> Array:
        return state.force
