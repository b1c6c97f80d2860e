"""What a case with held bones would say with parameters a little different, to first order.

Where the bones are held, parameters reach the result through the hood's shape alone.  Of a solved
shell x(p) with tangent K the shape for parameters p' near by is x - K^-1 R(x, p'), R the residual:
an assembly and a back-substitution in place of a solve.  What is observed of that shape is the
result, so that its differences over small steps of p are the derivatives by the tangent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from cosim.build import Models, build, tensions
from cosim.build_shell import UnderHood
from cosim.case import load_case
from cosim.case_schema import Case, ShellHood
from cosim.couple import Equilibrium
from cosim.observe import result
from cosim.port import Array, CosimError, InputError
from cosim.run import States, solve
from cosim.trials import Outcome, Settings, one_line, outcome
from fe_solver.shell_hood import ShellHood as FeHood


def tangent_serves(case: Case) -> bool:
    """Whether the bones are held and nothing but a shell in smooth contact answers the tendons."""
    if not (isinstance(case.hood, ShellHood) and isinstance(case.finger, UnderHood)):
        return False
    contact, pulls = case.hood.contact, case.tendons.values()
    smooth = contact.penetration is None and contact.friction == 0
    plain = all(t.muscle is None and t.excursion is None for t in pulls)
    return case.forward is None and case.finger.tip.kind == "posture" and smooth and plain


def near_outcome(source: Path, around: Settings, settings: Settings) -> Outcome:
    """The case at `source` with `settings`, by the tangent at `around`; solved, where a setting
    moves the bones or lays another mesh."""
    try:
        case = load_case(source, settings)
    except InputError as error:
        return Outcome("refused", {}, one_line(error))
    try:
        summary = foretold(case, *_solved(source, around))
    except CosimError as error:
        return Outcome("failed", {}, one_line(error))
    return outcome(source, settings) if summary is None else Outcome("converged", summary)


@lru_cache(maxsize=1)
def _solved(source: Path, settings: Settings) -> tuple[Models, States]:
    return solve(load_case(source, settings))


def foretold(case: Case, models: Models, states: States) -> Mapping[str, Any] | None:
    """The summary of `case`, to first order, from a solved case that differs little from it; None
    where its bones stand elsewhere or its hood has another mesh."""
    fresh = build(case)
    held = fresh.finger.motion(fresh.finger.start(fresh.posture))
    if np.abs(held.twist_to(states.loaded.motion)).max() > 0 or not _alike(fresh, models):
        return None
    hood, finger = tensions(case, fresh)
    rest = [np.full(len(pull), fresh.resting) for pull in (hood, finger)]
    unloaded = _near(fresh, states.unloaded, *rest)
    loaded = _near(fresh, states.loaded, hood, finger)
    near = replace(states, unloaded=unloaded, loaded=loaded)
    return result(case, fresh, near, 0.0).summary


def _alike(models: Models, others: Models) -> bool:
    return np.array_equal(_shell(models).model.quads, _shell(others).model.quads)


def _shell(models: Models) -> FeHood:
    assert isinstance(models.hood, FeHood)
    return models.hood


def _near(models: Models, e: Equilibrium, hood: Array, finger: Array) -> Equilibrium:
    held = models.finger.start(models.posture)
    shell = _shell(models)
    state = shell.near(e.response.state, hood)
    response = shell.answer(state)
    return replace(
        e,
        finger_state=held,
        response=response,
        balance=models.finger.balance(held, response.load, finger),
        jacobian=shell.jacobian(state),
        hood_tension=hood,
        finger_tension=finger,
    )
