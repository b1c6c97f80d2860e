"""The main path: case -> models -> coupled equilibria -> result.  Read this file first."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from cosim.build import Models, build, tensions
from cosim.case_schema import Case
from cosim.couple import CouplingOptions, Equilibrium, equilibrium, reciprocity
from cosim.results import Result

Progress = Callable[[str], None]
AUDIT_STEP = 2e-5
"""rad, joint step of the reciprocity audit: small against the contact's smoothing."""


@dataclass(frozen=True)
class Setting:
    """What cases that differ only in their tendons share, and so need solve only once."""

    key: str
    case: Case = field(compare=False)
    progress: Progress = field(compare=False)


@dataclass(frozen=True)
class States:
    """The two equilibria of an isometric case, and the audit of the loaded one."""

    unloaded: Equilibrium
    loaded: Equilibrium
    reciprocity: float | None
    """None where the hood has no tendons to pull."""


def run_case(case: Case, progress: Progress = lambda text: None) -> Result:
    """Build, solve and summarise a case.  Raises InputError and ConvergenceError."""
    from cosim.observe import result

    started = time.perf_counter()
    models, states = solve(case, progress)
    progress("summing up")
    return result(case, models, states, time.perf_counter() - started)


def solve(case: Case, progress: Progress = lambda text: None) -> tuple[Models, States]:
    """The equilibrium with every tendon at its resting tension, then the loaded one."""
    models, unloaded = settled(Setting(case.setting_key(), case, progress))
    hood_tension, finger_tension = tensions(case, models)
    pulled = not np.array_equal(hood_tension, unloaded.hood_tension)
    state = unloaded.response.state
    loaded = equilibrium(
        models.finger,
        models.hood,
        unloaded.finger_state,
        models.hood.start(unloaded.motion) if pulled else state,
        hood_tension,
        finger_tension,
        _options(case),
        lambda text: progress(f"loaded: {text}"),
    )
    if not len(hood_tension):
        return models, States(unloaded, loaded, None)
    progress("auditing reciprocity")
    strongest = int(np.argmax(hood_tension))
    gap = reciprocity(models.finger, models.hood, loaded, strongest, AUDIT_STEP)
    return models, States(unloaded, loaded, gap)


@lru_cache(maxsize=4)
def settled(setting: Setting) -> tuple[Models, Equilibrium]:
    """The models of a setting and their unloaded equilibrium."""
    case, progress = setting.case, setting.progress
    progress("building the models")
    models = build(case)
    start = models.finger.start(models.posture)
    return models, equilibrium(
        models.finger,
        models.hood,
        start,
        models.hood.start(models.finger.motion(start)),
        np.full(len(models.hood.tendons), models.resting),
        np.full(len(models.finger.tendons), models.resting),
        _options(case),
        lambda text: progress(f"unloaded: {text}"),
    )


def _options(case: Case) -> CouplingOptions:
    return CouplingOptions(case.solve.tolerance, case.solve.max_iterations)
