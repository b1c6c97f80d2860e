"""How fast a coupled run is, against one assembly and one factorisation of its own tangent."""

from __future__ import annotations

from statistics import fmean, median
from time import perf_counter

from cosim.case.schema import Case, ForwardConfig
from cosim.coupling.motion import motion_states
from cosim.errors import InputError, Progress, quiet
from cosim.models.build import build
from cosim.models.motion import moving_models
from cosim.solve.session import Session
from cosim.solve.solvers import solve

REPEATS = 5
EVERY = 25
"""Steps of a motion between two measurements of its tangent."""


def bench_case(case: Case, progress: Progress = quiet) -> dict[str, float]:
    """Medians of `REPEATS`, all measured in this process, s, and their ratio.

    `warm_run_s`: the loaded equilibrium with its audit, once models and the unloaded state are
    there, as they are from the second case of a batch on; `cold_run_s`: models and both equilibria,
    with the bones' distances baked.  Of a motion see `bench_motion`.  Raises InputError for a hood
    without a tangent."""
    if case.forward is not None:
        return bench_motion(case, case.forward, progress)
    session = Session()
    progress("solving the case once")
    models, states = solve(case, session)
    if models.built.linear is None:
        raise InputError(f"{case.name}: bench needs a hood of finite elements")
    warm, linear, cold = [], [], []
    for k in range(REPEATS):
        progress(f"warm run {k + 1}/{REPEATS}")
        warm.append(_seconds(case, session))
        linear.append(models.built.linear(states.loaded.response.state))
    for k in range(2):
        progress(f"cold run {k + 1}/2")
        cold.append(_seconds(case, Session()))
    assembly, factorisation = (median(column) for column in zip(*linear, strict=True))
    return {
        "warm_run_s": median(warm),
        "cold_run_s": min(cold),
        "assembly_s": assembly,
        "factorisation_s": factorisation,
        "ratio": median(warm) / (assembly + factorisation),
        "cold_ratio": min(cold) / (assembly + factorisation),
    }


def bench_motion(
    case: Case, forward: ForwardConfig, progress: Progress = quiet
) -> dict[str, float]:
    """Means over the steps of a coupled motion, s, and their ratio; assembly and factorisation of
    the hood's own tangent are measured between its steps."""
    progress("building the models")
    tangent = build(case).built.linear
    if tangent is None:
        raise InputError(f"{case.name}: bench needs a hood of finite elements")
    both = moving_models(case, forward)
    moves = both.moves
    begun = moves.begin(both.initial_state)
    steps, floors = [], []
    start = perf_counter()
    for state in motion_states(moves, begun, round(forward.duration / forward.step), progress):
        steps.append(perf_counter() - start)
        if len(steps) % EVERY == 1:
            floors.append(tangent(state.coupled.hood))  # once, with its caches as a step finds them
        start = perf_counter()
    assembly, factorisation = (fmean(column) for column in zip(*floors, strict=True))
    return {
        "steps": len(steps),
        "step_s": fmean(steps),
        "assembly_s": assembly,
        "factorisation_s": factorisation,
        "ratio": fmean(steps) / (assembly + factorisation),
    }


def _seconds(case: Case, session: Session) -> float:
    start = perf_counter()
    solve(case, session)
    return perf_counter() - start
