"""A hood that keeps what it was asked, for the tests of the coupling in time."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cosim.errors import ConvergenceError
from cosim.port import Array, HoodJacobian, Motion, Response
from tests.helpers.moving_hinge import MovingHinge
from tests.proofs.coupling.pairs import Drum, stiff_pair


@dataclass
class RecordingHood:
    """A hood that keeps what it was asked; its state counts the steps to it."""

    inner: Drum
    asked: list[tuple[Motion, Array, float]] = field(default_factory=list)
    tangents: int = 0
    most_tension: float = np.inf

    bodies = property(lambda self: self.inner.bodies)
    tendons = property(lambda self: self.inner.tendons)
    sources = property(lambda self: self.inner.sources)

    def start(self, motion: Motion) -> int:
        return 0

    def advance(self, state: int, motion: Motion, tension: Array, dt: float) -> Response:
        if tension.max() > self.most_tension:
            raise ConvergenceError("the hood tears")
        self.asked.append((motion, tension, dt))
        return self.inner.advance(None, motion, tension, dt)._replace(state=state + 1)

    def jacobian(self, state: int) -> HoodJacobian:
        self.tangents += 1
        return self.inner.jacobian(None)

    def with_tolerance(self, tolerance: float) -> RecordingHood:
        return self


def recording_pair(joints: int = 1) -> tuple[MovingHinge, RecordingHood]:
    finger, hood = stiff_pair(joints)
    return finger, RecordingHood(hood)
