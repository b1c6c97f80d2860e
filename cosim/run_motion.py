"""A coupled motion from a case to its result: begun, or gone on with from a checkpoint."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from cosim.adaptive import Control
from cosim.build_forward import special_states, together
from cosim.case import resolved_toml
from cosim.case_schema import Case, Forward
from cosim.checkpoint import Kept, read_checkpoint, write_checkpoint
from cosim.motion import Frame, Moment, Moves, moments
from cosim.observe_motion import motion_result
from cosim.paced import paced
from cosim.port import ConvergenceError
from cosim.results import Result

Progress = Callable[[str], None]
RATE, WINDOW = 1e-3, 0.1
"""rad/s that no joint exceeds over the last WINDOW s of a finger that came to rest."""


def moved_together(
    case: Case, forward: Forward, progress: Progress, folder: Path | None = None
) -> Result:
    """The motion of finger and hood; with a `folder` (which holds the case as `case.toml`)
    checkpoints go there, and a motion that has one there goes on from it.

    Raises InputError and ConvergenceError."""
    started = time.perf_counter()
    progress("building the models")
    both = together(case, forward)
    begun = both.moves.begin(both.finger.begin(both.posture))
    kept = Kept(begun, (both.moves.frame(begun),), (both.finger.tip_wrench(begun.coupled.finger),))
    special = special_states(both.hood, both.finger) if folder is not None else {}
    text = resolved_toml(case)
    if folder is not None and (folder / "checkpoint.npz").exists():
        kept = read_checkpoint(folder, text, kept, special)
        progress(f"going on from t = {kept.moment.coupled.time:.6g} s")
    try:
        for done, now in _on(both.moves, forward, kept, progress):
            frames = [both.moves.frame(at) for at in now]
            tips = [both.finger.tip_wrench(at.coupled.finger) for at in now]
            kept = Kept(now[-1], (*kept.frames, *frames), (*kept.tips, *tips))
            due = forward.checkpoint and not done % forward.checkpoint
            if folder is not None and due:
                write_checkpoint(folder, text, kept, special)
    except KeyboardInterrupt:
        if folder is None:
            raise
        write_checkpoint(folder, text, kept, special)
        at = kept.moment.coupled.time
        raise ConvergenceError(
            f"stopped at t = {at:.6g} s; go on with: cosim resume {folder}"
        ) from None
    _rested(forward, kept.frames)
    wall = time.perf_counter() - started
    return motion_result(case, both, kept.frames, kept.tips, kept.moment, wall)


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
