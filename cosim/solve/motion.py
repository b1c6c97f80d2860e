"""The motion of a case, from the start or from a checkpoint."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cosim.case.cache_key import code_version
from cosim.case.file import moved_toml, resolved_toml
from cosim.case.schema import Case, ForwardConfig
from cosim.coupling.adaptive import Control
from cosim.coupling.checkpoint import NAME, MotionHistory, read_checkpoint, write_checkpoint
from cosim.coupling.motion import CoupledMotion, MotionState, motion_states
from cosim.coupling.paced import adaptive_states
from cosim.coupling.state_arrays import Special
from cosim.errors import (
    ConvergenceError,
    InputError,
    PatienceError,
    Progress,
    StoppedError,
    quiet,
)
from cosim.files import shown_path, write_text
from cosim.hoods.view import HoodView, arrays_of, audit_arrays, hood_field
from cosim.models.motion import MovingModels, moving_models, special_states
from cosim.port import Array, State
from cosim.solve.session import Session
from cosim.stopwatch import timed

RATE, CHANGE, WINDOW = 1e-3, 1e-3, 0.1
"""rad/s that no joint exceeds, and N by which no component of the fingertip force strays from its
end, over the last WINDOW s of a finger that came to rest.  In a cage with friction rest is where
creep has ended: Simbody's friction is viscous below its transition velocity, so that a finger
slides until a face, a corner, a limit or the passive joints hold it without friction."""
PAUSE = 10.0
"""s of computing from one checkpoint to the next, where the case states no number of steps."""
GLANCE = 2.0
"""s of computing from one time to the next at which who watches a motion is shown it so far."""
SHAPE_ROUNDING = 1e-9
"""The part of the time between two shapes by which one is taken before it is due."""
UNFINISHED = ".unfinished"
"""What the folder of a motion that has not ended is called after its case's name."""


@dataclass(frozen=True)
class RestCheck:
    """How still a finger is at a motion's end: the largest over the last WINDOW s."""

    rate: float
    """rad/s, of a joint."""
    change: float
    """N, of a component of the fingertip force from its end."""

    @property
    def is_reached(self) -> bool:
        """Whether the finger is at rest: rate and change within RATE and CHANGE."""
        return self.rate <= RATE and self.change <= CHANGE


@dataclass(frozen=True)
class SolvedMotion:
    """The models of a motion, what is kept of it, and whether it came to rest."""

    models: MovingModels
    history: MotionHistory
    rest: RestCheck
    must_rest: bool
    """Whether the case asks for a finger at rest."""
    failure: ConvergenceError | None = None
    """Why a step was not made, of a motion that did not reach its end."""


def solve_motion(case: Case, session: Session, progress: Progress = quiet) -> SolvedMotion:
    """The motion of a case with a table [forward], up to a step that is not made where there is
    one.  With `session.checkpoints` it keeps checkpoints there, and goes on from one that is there.

    Raises InputError, ConvergenceError where not one step is made, and StoppedError where Ctrl-C
    ends it."""
    forward = case.forward
    assert forward is not None
    progress("building the models")
    both = moving_models(case, forward)
    progress("the hood at rest, before the motion")
    with timed("hood at rest"):
        begun = both.moves.begin(both.initial_state)
    recorder = ShapeRecorder(both.built.view, forward.duration, case.output.frames)
    kept = MotionHistory(
        begun,
        (both.moves.frame(begun),),
        (both.finger.tip_wrench(begun.coupled.finger),),
        recorder.begin(begun),
    )
    keeper = _keeper(case, forward, both, session.checkpoints, progress)
    if keeper is not None and (keeper.folder / NAME).exists():
        kept, code = keeper.read(kept)
        if code != code_version():
            progress(f"kept by another version of the program ({code}): last digits may differ")
        progress(f"going on from t = {kept.moment.coupled.time:.6g} s")
    frames, tips, shapes = list(kept.frames), list(kept.tips), list(kept.shapes)
    failure, shown = None, time.monotonic()
    try:
        for done, new_states in _advance(both.moves, forward, kept, progress):
            frames += [both.moves.frame(at) for at in new_states]
            tips += [both.finger.tip_wrench(at.coupled.finger) for at in new_states]
            for at in new_states:
                shapes += recorder.next(at, shapes)
            kept = MotionHistory(new_states[-1], frames, tips, shapes)
            if session.watch is not None and time.monotonic() - shown > GLANCE:
                session.watch(case, SolvedMotion(both, kept, _rest(kept), forward.must_rest))
                shown = time.monotonic()
            if keeper is not None and keeper.is_due(done):
                keeper.write(kept)
    except ConvergenceError as error:
        if len(frames) == 1:
            raise
        failure = error
        if keeper is not None:
            keeper.write(kept)
    except PatienceError as error:
        if len(frames) == 1:
            raise
        failure = ConvergenceError(
            f"{error} (t = {kept.moment.coupled.time:.6g} s of {forward.duration:g} s is reached). "
            f"Try a longer solve.patience or a longer step{_resume_text(keeper)}"
        )
        if keeper is not None:
            keeper.write(kept)
    except KeyboardInterrupt:
        if keeper is None:
            raise
        keeper.write(kept)
        raise StoppedError(
            f"stopped at t = {kept.moment.coupled.time:.6g} s of {forward.duration:g} s; all up to "
            f"there is kept. Go on with: cosim run --resume {keeper.folder}"
        ) from None
    return SolvedMotion(both, kept, _rest(kept), forward.must_rest, failure)


def _resume_text(keeper: _Keeper | None) -> str:
    if keeper is None:
        return ""
    return f", or go on for as long again: cosim run --resume {shown_path(keeper.folder)}"


@dataclass(frozen=True)
class ShapeRecorder:
    """What a hood looks like over a motion: at its start, and at the first state at or after each
    of `count` times that are evenly spaced over `duration` s."""

    view: Callable[[State], HoodView] | None
    duration: float
    count: int

    def begin(self, at: MotionState) -> list[Mapping[str, Array]]:
        """The first shape; none of a hood without one, and where none are asked for."""
        return [] if self.view is None or self.count == 0 else [self._shape(at)]

    def next(
        self, at: MotionState, shapes: Sequence[Mapping[str, Array]]
    ) -> list[Mapping[str, Array]]:
        """The shape of a state, if one is due after those `shapes`."""
        if not shapes or self._number(at.coupled.time) == self._number(float(shapes[-1]["time"])):
            return []
        return [self._shape(at)]

    def _number(self, time: float) -> int:
        """How many of the times are reached at `time` s."""
        return int(self.count * time / self.duration + SHAPE_ROUNDING)

    def _shape(self, at: MotionState) -> Mapping[str, Array]:
        assert self.view is not None
        view, time = self.view(at.coupled.hood), np.array(at.coupled.time)
        return {"time": time, **arrays_of(hood_field(view)), **audit_arrays(view)}


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

    def write(self, kept: MotionHistory) -> None:
        write_checkpoint(self.folder, self.case, kept, self.special, code_version())
        self.last = time.monotonic()

    def read(self, template: MotionHistory) -> tuple[MotionHistory, str]:
        return read_checkpoint(self.folder, self.case, template, self.special)


def _keeper(
    case: Case,
    forward: ForwardConfig,
    both: MovingModels,
    checkpoints: Path | None,
    progress: Progress,
) -> _Keeper | None:
    """None for a motion that keeps no checkpoints: that has no folder, asks for none, or asks for
    nothing and cannot write its state.

    Raises InputError where it asks for checkpoints and cannot write its state."""
    folder = checkpoint_folder(case, checkpoints)
    if folder is None:
        return None
    try:
        special = special_states(both.hood, both.finger)
    except InputError as error:
        if forward.checkpoint is not None:
            raise
        progress(f"keeps no checkpoints: {error}")
        return None
    text = moved_toml(resolved_toml(case), folder)
    if _stored_case_text(folder) != text:
        if (folder / NAME).is_file():
            raise InputError(_other_case_message(folder))
        write_text(folder / "case.toml", text)
    return _Keeper(folder, text, special, forward.checkpoint)


def _other_case_message(folder: Path) -> str:
    where = shown_path(folder)
    return (
        f"{where}: holds a part of a run of another case of this name, which {where}/case.toml "
        f"states. Go on with that one: cosim run --resume {where}; or add --restart to throw it "
        "away, or choose another --out"
    )


def checkpoint_folder(case: Case, checkpoints: Path | None) -> Path | None:
    """Where a case keeps its checkpoints, beside `case.toml`; None for one that keeps none."""
    if checkpoints is None or case.forward is None or case.forward.checkpoint == 0:
        return None
    return checkpoints / f"{case.name}{UNFINISHED}"


def check_not_begun(case: Case, checkpoints: Path) -> None:
    """Check that no part of this case, or of another one of its name, is kept there, which a new
    run would throw away.  Raises InputError."""
    folder = checkpoint_folder(case, checkpoints)
    if folder is None or not (folder / NAME).is_file():
        return
    if _stored_case_text(folder) != moved_toml(resolved_toml(case), folder):
        raise InputError(_other_case_message(folder))
    where = shown_path(folder)
    raise InputError(
        f"{where}: holds a part of this run, which was stopped, killed or failed. Go on with: "
        f"cosim run --resume {where}; or add --restart to begin anew"
    )


def _stored_case_text(folder: Path) -> str | None:
    file = folder / "case.toml"
    return file.read_text(encoding="utf-8") if file.is_file() else None


def _advance(
    moves: CoupledMotion, forward: ForwardConfig, kept: MotionHistory, progress: Progress
) -> Iterator[tuple[int, tuple[MotionState, ...]]]:
    """After each step to the motion's end how many have been made, and the states in it: of a step
    whose length follows from its error, after each half."""
    if forward.adaptive is not None:
        control = Control(forward.adaptive.tolerance, forward.adaptive.floor, forward.step)
        for both in adaptive_states(moves, control, kept.moment, forward.duration, progress):
            yield both[-1].pace.accepted, both
        return
    done = len(kept.frames) - 1
    left = round(forward.duration / forward.step) - done
    for k, state in enumerate(motion_states(moves, kept.moment, left, progress), done + 1):
        yield k, (state,)


def _rest(kept: MotionHistory) -> RestCheck:
    since = kept.frames[-1].time - WINDOW * (1 + 1e-9)
    last = [k for k, frame in enumerate(kept.frames) if frame.time >= since]
    rates = np.array([kept.frames[k].rates for k in last])
    forces = np.array([kept.tips[k][:3] for k in last])
    return RestCheck(float(np.abs(rates).max()), float(np.abs(forces - forces[-1]).max()))
