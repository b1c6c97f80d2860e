"""What cases share, held by whoever runs them: a command, a study, a validation."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from threading import RLock
from typing import Any
from zlib import crc32

import numpy as np

from cosim.case.schema import Case, as_stated
from cosim.coupling.equilibrium import CouplingOptions, Equilibrium, equilibrium, first_answer
from cosim.coupling.fixed_point import fixed_point
from cosim.errors import ConvergenceError, InputError, Progress, named_progress, unexpected
from cosim.files import path_from
from cosim.models.build import Models, accelerator_of, build_any, with_own_finger
from cosim.port import Array, Motion, PairState, Response, State, StorableHood, Tensions
from cosim.schema.fields import is_number
from cosim.stopwatch import timed
from cosim.tendons.muscles import live_muscles

EVERY = 10
"""Among so many cases that begin near by one is solved from the hood as it is laid too."""


@dataclass
class _SharedHood:
    """What cases with one hood share: its key, and the hood's first answer at a pose."""

    key: str
    motion: Motion | None = None
    answer: Response | None = None

    def first_answer(self, models: Models, start: PairState, tension: Array) -> Response:
        """The hood's first answer under the tensions (nt,) N at rest.  Raises ConvergenceError."""
        motion, known = models.finger.motion(start.finger), self.motion
        if (
            self.answer is None
            or known is None
            or not (
                np.array_equal(motion.position, known.position)
                and np.array_equal(motion.rotation, known.rotation)
            )
        ):
            self.motion, self.answer = motion, first_answer(models.pair, start, tension)
        return self.answer


@dataclass
class _Setting:
    """What cases that differ only in their tendons share."""

    models: Models
    hood: _SharedHood
    unloaded: Equilibrium | None = None
    from_nearby: bool = False
    """Whether the unloaded equilibrium began near by."""


@dataclass(frozen=True)
class _LastSolved:
    """The equilibria that a session solved last, and on what."""

    bones: str
    models: Models
    unloaded: Equilibrium
    loaded: Equilibrium


class Session:
    """Models and unloaded equilibria of the settings that were solved last, for the next cases that
    differ from them only in their tendons; and their hoods, for those that differ in what holds the
    fingertip too.

    >>> import cosim
    >>> session, case = cosim.Session(), cosim.load("pulley_edc")
    >>> weak, strong = (
    ...     cosim.run(case.replace({"tendons.EDC.tension": force}), session)
    ...     for force in ("1 N", "2 N")
    ... )
    >>> strong.tip_force["dorsal"] > weak.tip_force["dorsal"]
    True

    `most`: settings kept at once.  `checkpoints`: the folder where a coupled motion keeps its
    checkpoints until it has ended, in NAME.unfinished; None: it keeps none.  `warm`: an equilibrium
    begins at the last one of a hood whose mesh has as many nodes, which takes a third of the time;
    its last digits, and of a hood with several equilibria which one is found, depend on what was
    solved before.  `watch` is called now and then with the case of a motion on its way and what is
    solved of it (a `SolvedMotion`).

    Threads may share a session: their cases are solved one after the other.

    Raises InputError."""

    def __init__(
        self,
        most: int = 4,
        checkpoints: str | Path | None = None,
        warm: bool = False,
        watch: Callable[[Case, Any], None] | None = None,
    ) -> None:
        number = as_stated(most)
        if not is_number(number) or not number >= 1:
            raise unexpected("Session: most", "1 or more settings", most)
        self.checkpoints = None if checkpoints is None else path_from("checkpoints", checkpoints)
        self.watch = watch
        self.lock = RLock()
        self._most, self._warm = most, warm
        self._last: _LastSolved | None = None
        self._settings: OrderedDict[str, _Setting] = OrderedDict()

    def models(self, case: Case, progress: Progress) -> Models:
        """The models of a case, with its own muscles.  Raises InputError."""
        shared = self._setting(case, progress).models
        return replace(shared, muscles=live_muscles(case.tendons))

    def unloaded_equilibrium(self, case: Case, progress: Progress) -> Equilibrium:
        """The equilibrium with every tendon at its resting tension.

        Raises InputError and ConvergenceError."""
        setting = self._setting(case, progress)
        both_ways = is_solved_both_ways(case)
        if setting.unloaded is None or (both_ways and setting.from_nearby):
            near = None if both_ways else self.start_near(case, setting.models, loaded=False)
            setting.unloaded = _unloaded_equilibrium(case, setting, progress, near)
            setting.from_nearby = near is not None
        return setting.unloaded

    def start_near(self, case: Case, models: Models, loaded: bool) -> PairState | None:
        """Where a warm session, or a case that begins near by, begins an equilibrium: at the last
        one, `loaded` or not; None where there is none of a hood on the same bones whose mesh has as
        many nodes."""
        last = self._last if self._warm or case.solve.start == "nearby" else None
        if last is None or not case.finger.is_native or last.bones != case.finger.anatomy_key():
            return None
        e = last.loaded if loaded else last.unloaded
        if models.hood is last.models.hood and models.finger is last.models.finger:
            return PairState(e.finger_state, e.response.state)
        match last.models.hood, models.hood:
            case StorableHood() as solved, StorableHood() as hood:
                try:
                    state = hood.from_arrays(solved.to_arrays(e.response.state))
                except InputError:  # a lesion has cut the mesh
                    return None
                return PairState(_turned(last.models, e, models), state)
        return None

    def remember(
        self, case: Case, models: Models, unloaded: Equilibrium, loaded: Equilibrium
    ) -> None:
        """Keep the equilibria of a case for the next one that begins near by."""
        if self._warm or case.solve.start == "nearby":
            self._last = _LastSolved(case.finger.anatomy_key(), models, unloaded, loaded)

    def _setting(self, case: Case, progress: Progress) -> _Setting:
        key = case.setting_key()
        for ended in [k for k, setting in self._settings.items() if not setting.models.is_alive]:
            del self._settings[ended]
        if key not in self._settings:
            progress("building the models")
            self._settings[key] = self._build(case)
        self._settings.move_to_end(key)
        while len(self._settings) > self._most:
            self._settings.popitem(last=False)
        return self._settings[key]

    @timed("models")
    def _build(self, case: Case) -> _Setting:
        """The setting of a case, with the hood of another one that has the same."""
        key = case.hood_key()
        for setting in self._settings.values():
            if setting.hood.key == key and case.finger.is_native:
                return _Setting(with_own_finger(setting.models, case), setting.hood)
        return _Setting(build_any(case), _SharedHood(key))


def is_solved_both_ways(case: Case) -> bool:
    """Whether a case that begins near by is among those, one in `EVERY`, that begin as laid too."""
    if case.solve.start != "nearby":
        return False
    text = case.model_dump_json(exclude={"name", "source"})
    return crc32(text.encode()) % EVERY == 0


def _turned(known: Models, e: Equilibrium, models: Models) -> State:
    """The finger in its posture, turned from there as another one is in its equilibrium."""
    start, unknowns = models.finger.start(models.posture), known.finger.unknowns
    turn = unknowns(e.finger_state) - unknowns(known.finger.start(known.posture))
    if turn.shape != models.finger.unknowns(start).shape:  # the fingertip is held otherwise
        return start
    return models.finger.displace(start, turn)


@timed("unloaded equilibrium")
def _unloaded_equilibrium(
    case: Case, setting: _Setting, progress: Progress, near: PairState | None
) -> Equilibrium:
    """From the state `near`, or where there is no way from there from the hood as it is laid."""
    models, start = setting.models, setting.models.start()
    idle = Tensions(
        np.full(len(models.hood.tendons), models.resting),
        np.full(len(models.finger.tendons), models.resting),
    )

    say = named_progress(progress, "unloaded")
    if near is not None:
        with suppress(ConvergenceError):
            return solve_equilibrium(case, models, near, idle, say)
    say("the hood on the bones at rest")
    return solve_equilibrium(
        case, models, start, idle, say, lambda: setting.hood.first_answer(models, start, idle.hood)
    )


def solve_equilibrium(
    case: Case,
    models: Models,
    start: PairState,
    tensions: Tensions,
    progress: Progress,
    first: Callable[[], Response] | None = None,
) -> Equilibrium:
    """The equilibrium from the states `start`, under tensions in N; `first` gives what
    `first_answer` does.  Raises ConvergenceError."""
    coupling = case.coupling
    options = CouplingOptions(case.solve.tolerances[0], case.solve.max_iterations)
    if coupling.scheme != "implicit":
        known = None if first is None else first()
        return equilibrium(models.pair, start, tensions, options, progress, known)
    accelerator = accelerator_of(coupling)
    turn = coupling.tolerance
    return fixed_point(models.pair, start, tensions, options, accelerator, turn, progress)
