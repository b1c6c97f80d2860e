"""A coupled motion from a case to its result: begun, or gone on with from a checkpoint."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from cosim.build_forward import special_states, together
from cosim.case import resolved_toml
from cosim.case_schema import Case, Forward
from cosim.checkpoint import Kept, read_checkpoint, write_checkpoint
from cosim.motion import moments
from cosim.observe_motion import motion_result
from cosim.port import Array, ConvergenceError
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
    begun = both.moves.begin(both.finger.begin(both.models.posture))
    kept = Kept(begun, (both.moves.frame(begun),), (both.finger.tip_wrench(begun.coupled.finger),))
    special = special_states(both.models) if folder is not None else {}
    text = resolved_toml(case)
    if folder is not None and (folder / "checkpoint.npz").exists():
        kept = read_checkpoint(folder, text, kept, special)
        progress(f"going on from t = {kept.moment.coupled.time:.6g} s")
    left = round(forward.duration / forward.step) - (len(kept.frames) - 1)
    try:
        for now in moments(both.moves, kept.moment, left, progress):
            frame, tip = both.moves.frame(now), both.finger.tip_wrench(now.coupled.finger)
            kept = Kept(now, (*kept.frames, frame), (*kept.tips, tip))
            due = forward.checkpoint and not (len(kept.frames) - 1) % forward.checkpoint
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
    _rested(forward, [frame.rates for frame in kept.frames])
    wall = time.perf_counter() - started
    return motion_result(case, both, kept.frames, kept.tips, kept.moment, wall)


def _rested(forward: Forward, rates: list[Array]) -> None:
    last = rates[-(round(WINDOW / forward.step) + 1) :]
    fastest = max(float(abs(rate).max()) for rate in last)
    if forward.must_rest and fastest > RATE:
        raise ConvergenceError(
            f"the finger did not come to rest in {forward.duration:g} s: over the last {WINDOW:g} "
            f"s a joint turned at up to {fastest:.1e} rad/s (at rest: {RATE:g}). Try a longer "
            "motion, damping of the joints, or write forward.must_rest = false"
        )
