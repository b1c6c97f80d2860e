"""What cases share, held by whoever runs them: a command, a study, a validation."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cosim.build.models import Models, build_any
from cosim.case.schema import Case
from cosim.coupling.equilibrium import Equilibrium
from cosim.errors import Progress
from cosim.port import Tensions
from cosim.solve.equilibrium import solve_equilibrium
from cosim.tendons.muscles import live_muscles


@dataclass
class _Setting:
    """What cases that differ only in their tendons share."""

    models: Models
    unloaded: Equilibrium | None = None


class Session:
    """Models and unloaded equilibria of the settings that were solved last, for the next cases that
    differ from them only in their tendons.

    >>> import cosim
    >>> session, case = cosim.Session(), cosim.load("pulley_edc")
    >>> weak, strong = (
    ...     cosim.run(case.replace({"tendons.EDC.tension": force}), session)
    ...     for force in ("1 N", "2 N")
    ... )
    >>> strong.tip_force["dorsal"] > weak.tip_force["dorsal"]
    True

    `most`: settings kept at once.  `checkpoints`: the folder where a coupled motion keeps its
    checkpoints until it has ended, in NAME.unfinished; None: it keeps none."""

    def __init__(self, most: int = 4, checkpoints: str | Path | None = None) -> None:
        self.checkpoints = None if checkpoints is None else Path(checkpoints)
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
            setting.unloaded = _unloaded_equilibrium(case, setting.models, progress)
        return setting.unloaded

    def _setting(self, case: Case, progress: Progress) -> _Setting:
        key = case.setting_key()
        if key not in self._settings:
            progress("building the models")
            self._settings[key] = _Setting(build_any(case))
        self._settings.move_to_end(key)
        while len(self._settings) > self._most:
            self._settings.popitem(last=False)
        return self._settings[key]


def _unloaded_equilibrium(case: Case, models: Models, progress: Progress) -> Equilibrium:
    idle = Tensions(
        np.full(len(models.hood.tendons), models.resting),
        np.full(len(models.finger.tendons), models.resting),
    )
    return solve_equilibrium(
        case, models, models.start(), idle, lambda text: progress(f"unloaded: {text}")
    )
