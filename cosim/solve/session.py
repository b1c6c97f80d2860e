"""What cases share, held by whoever runs them: a command, a study, a validation."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, replace
from pathlib import Path
from threading import RLock

import numpy as np

from cosim.case.schema import Case
from cosim.coupling.equilibrium import Equilibrium, first_answer
from cosim.errors import InputError, Progress
from cosim.models.build import Models, build_any, with_own_finger
from cosim.port import Array, Motion, PairState, Response, Tensions
from cosim.solve.equilibrium import solve_equilibrium
from cosim.tendons.muscles import live_muscles


@dataclass
class _SharedHood:
    """What cases with one hood share: its key, and the hood's first answer at a pose."""

    key: str
    motion: Motion | None = None
    answer: Response | None = None

    def first_answer(self, models: Models, start: PairState, tension: Array) -> Response:
        """The hood's first answer under the tensions (nt,) N at rest.  Raises ConvergenceError."""
        motion, known = models.finger.motion(start.finger), self.motion
        if self.answer is None or known is None or not _is_same(motion, known):
            self.motion, self.answer = motion, first_answer(models.pair, start, tension)
        return self.answer


@dataclass
class _Setting:
    """What cases that differ only in their tendons share."""

    models: Models
    hood: _SharedHood
    unloaded: Equilibrium | None = None


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
    checkpoints until it has ended, in NAME.unfinished; None: it keeps none.

    Threads may share a session: their cases are solved one after the other.

    Raises InputError."""

    def __init__(self, most: int = 4, checkpoints: str | Path | None = None) -> None:
        if most < 1:
            raise InputError(f"Session: most must be 1 or more settings, got {most}")
        self.checkpoints = None if checkpoints is None else Path(checkpoints)
        self.lock = RLock()
        self._most = most
        self._settings: OrderedDict[str, _Setting] = OrderedDict()

    def models(self, case: Case, progress: Progress) -> Models:
        """The models of a case, with its own muscles.  Raises InputError."""
        shared = self._setting(case, progress).models
        return replace(shared, muscles=live_muscles(case.tendons))

    def unloaded_equilibrium(self, case: Case, progress: Progress) -> Equilibrium:
        """The equilibrium with every tendon at its resting tension.

        Raises InputError and ConvergenceError."""
        setting = self._setting(case, progress)
        if setting.unloaded is None:
            setting.unloaded = _unloaded_equilibrium(case, setting, progress)
        return setting.unloaded

    def _setting(self, case: Case, progress: Progress) -> _Setting:
        key = case.setting_key()
        if key not in self._settings:
            progress("building the models")
            self._settings[key] = self._build(case)
        self._settings.move_to_end(key)
        while len(self._settings) > self._most:
            self._settings.popitem(last=False)
        return self._settings[key]

    def _build(self, case: Case) -> _Setting:
        """The setting of a case, with the hood of another one that has the same."""
        key = case.hood_key()
        for setting in self._settings.values():
            if setting.hood.key == key and case.finger.is_native:
                return _Setting(with_own_finger(setting.models, case), setting.hood)
        return _Setting(build_any(case), _SharedHood(key))


def _unloaded_equilibrium(case: Case, setting: _Setting, progress: Progress) -> Equilibrium:
    models, start = setting.models, setting.models.start()
    idle = Tensions(
        np.full(len(models.hood.tendons), models.resting),
        np.full(len(models.finger.tendons), models.resting),
    )
    return solve_equilibrium(
        case,
        models,
        start,
        idle,
        lambda text: progress(f"unloaded: {text}"),
        lambda: setting.hood.first_answer(models, start, idle.hood),
    )


def _is_same(a: Motion, b: Motion) -> bool:
    return np.array_equal(a.position, b.position) and np.array_equal(a.rotation, b.rotation)
