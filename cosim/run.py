"""The main path: case -> models -> coupled equilibria -> result.  Read this file first."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cosim.build import Models, build
from cosim.case_schema import Case
from cosim.couple import CouplingOptions, Equilibrium, equilibrium, reciprocity
from cosim.results import Result

Progress = Callable[[str], None]
AUDIT_STEP = 2e-4
"""rad, joint step of the reciprocity audit: small against the contact's smoothing."""


@dataclass(frozen=True)
class States:
    """The two equilibria of an isometric case: every tendon at its resting tension, then loaded."""

    unloaded: Equilibrium
    loaded: Equilibrium
    reciprocity: float


def run_case(case: Case, progress: Progress = lambda text: None) -> Result:
    """Build, solve and summarise a case.  Raises InputError and ConvergenceError."""
    from cosim.observe import result

    started = time.perf_counter()
    progress("building the models")
    models = build(case)
    states = solve(case, models, progress)
    progress("summing up")
    return result(case, models, states, time.perf_counter() - started)


def solve(case: Case, models: Models, progress: Progress = lambda text: None) -> States:
    """The unloaded and the loaded equilibrium, and the audit of reciprocity."""
    finger, hood = models.finger, models.hood
    options = CouplingOptions(case.solve.tolerance, case.solve.max_iterations)
    at_posture = finger.start(models.posture)
    resting_hood = np.full(len(hood.tendons), models.resting)
    resting_finger = np.full(len(finger.tendons), models.resting)
    progress("unloaded: settling the hood")
    start = hood.start(finger.motion(at_posture))
    unloaded = equilibrium(
        finger,
        hood,
        at_posture,
        start,
        resting_hood,
        resting_finger,
        options,
        lambda text: progress(f"unloaded: {text}"),
    )
    progress("loaded: settling the hood")
    pulled = not np.array_equal(models.hood_tension, resting_hood)
    loaded = equilibrium(
        finger,
        hood,
        unloaded.finger_state,
        hood.start(unloaded.motion) if pulled else unloaded.response.state,
        models.hood_tension,
        models.finger_tension,
        options,
        lambda text: progress(f"loaded: {text}"),
    )
    progress("auditing reciprocity")
    strongest = int(np.argmax(models.hood_tension))
    return States(unloaded, loaded, reciprocity(finger, hood, loaded, strongest, AUDIT_STEP))
