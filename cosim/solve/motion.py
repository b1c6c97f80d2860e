"""A coupled motion of a case: begun, or gone on with from a checkpoint."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from cosim.build.motion import Together, together
from cosim.build.states import special_states
from cosim.case.file import resolved_toml
from cosim.case.schema import Case, Forward
from cosim.coupling.adaptive import Control
from cosim.coupling.checkpoint import NAME, Kept, read_checkpoint, write_checkpoint
from cosim.coupling.motion import Frame, Moment, Moves, moments
from cosim.coupling.paced import paced
from cosim.coupling.state_arrays import Special
from cosim.port import ConvergenceError, InputError, Progress, StoppedError

RATE, WINDOW = 1e-3, 0.1
"""rad/s that no joint exceeds over the last WINDOW s of a finger that came to rest."""
PAUSE = 10.0
"""s of computing from one checkpoint to the next, where the case states no number of steps."""


def moved_together(
    case: Case, forward: Forward, progress: Progress, folder: Path | None = None
) -> tuple[Together, Kept]:
    """The models of finger and hood, and what is kept of their motion; with a `folder` (which holds
    the case as `case.toml`) checkpoints go there, and a motion that has one there goes on from it.

    Raises InputError, ConvergenceError, and StoppedError where Ctrl-C ends it."""
    progress("building the models")
    both = together(case, forward)
    begun = both.moves.begin(both.finger.begin(both.posture))
    kept = Kept(begun, (both.moves.frame(begun),), (both.finger.tip_wrench(begun.coupled.finger),))
    keeper = _keeper(case, forward, both, folder, progress)
    if keeper is not None and (keeper.folder / NAME).exists():
        kept = keeper.read(kept)
        progress(f"going on from t = {kept.moment.coupled.time:.6g} s")
    try:
        for done, now in _on(both.moves, forward, kept, progress):
            frames = [both.moves.frame(at) for at in now]
            tips = [both.finger.tip_wrench(at.coupled.finger) for at in now]
            kept = Kept(now[-1], (*kept.frames, *frames), (*kept.tips, *tips))
            if keeper is not None and keeper.is_due(done):
                keeper.write(kept)
    except KeyboardInterrupt:
        if keeper is None:
            raise
        keeper.write(kept)
        raise StoppedError(
            f"stopped at t = {kept.moment.coupled.time:.6g} s of {forward.duration:g} s; all up to "
            f"there is kept. Go on with: cosim resume {keeper.folder}"
        ) from None
    _rested(forward, kept.frames)
    return both, kept


@dataclass
class _Keeper:
    """Where a motion's checkpoints go, and when: every so many steps, or every PAUSE s."""

    folder: Path
    case: str
    special: Special
    every: int | None
    last: float = field(default_factory=time.monotonic)

    def is_due(self, done: int) -> bool:
        if self.every is None:
            return time.monotonic() - self.last > PAUSE
        return done % self.every == 0

    def write(self, kept: Kept) -> None:
        write_checkpoint(self.folder, self.case, kept, self.special)
        self.last = time.monotonic()

    def read(self, template: Kept) -> Kept:
        return read_checkpoint(self.folder, self.case, template, self.special)


def _keeper(
    case: Case, forward: Forward, both: Together, folder: Path | None, progress: Progress
) -> _Keeper | None:
    """None for a motion that keeps no checkpoints: that has no folder, asks for none, or asks for
    nothing and cannot write its state.

    Raises InputError where it asks for checkpoints and cannot write its state."""
    if folder is None or forward.checkpoint == 0:
        return None
    try:
        special = special_states(both.hood, both.finger)
    except InputError as error:
        if forward.checkpoint is not None:
            raise
        progress(f"keeps no checkpoints: {error}")
        return None
    return _Keeper(folder, resolved_toml(case), special, forward.checkpoint)


def _on(
    moves: Moves, forward: Forward, kept: Kept, progress: Progress
) -> Iterator[tuple[int, tuple[Moment, ...]]]:
    """After each step to the motion's end how many have been made, and the states in it: of a step
    whose length follows from its error, after each half."""
    if forward.adaptive is not None:
        control = Control(forward.adaptive.tolerance, forward.adaptive.floor, forward.step)
        for both in paced(moves, control, kept.moment, forward.duration, progress):
            yield both[-1].pace.accepted, both
        return
    done = len(kept.frames) - 1
    left = round(forward.duration / forward.step) - done
    for k, now in enumerate(moments(moves, kept.moment, left, progress), done + 1):
        yield k, (now,)


def _rested(forward: Forward, frames: Sequence[Frame]) -> None:
    since = frames[-1].time - WINDOW * (1 + 1e-9)
    fastest = max(float(abs(frame.rates).max()) for frame in frames if frame.time >= since)
    if forward.must_rest and fastest > RATE:
        raise ConvergenceError(
            f"the finger did not come to rest in {forward.duration:g} s: over the last {WINDOW:g} "
            f"s a joint turned at up to {fastest:.1e} rad/s (at rest: {RATE:g}). Try a longer "
            "motion, damping of the joints, or write forward.must_rest = false"
        )
