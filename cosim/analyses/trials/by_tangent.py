"""A case with held bones at parameters a little different from those it was solved with.

If the bones are held, parameters act on the result through the hood's shape alone.  For a solved
shell x(p) with tangent K, the shape at nearby parameters p' is x - K^-1 R(x, p'), R the residual:
an assembly and a back-substitution in place of a solve (`predict_summary`).  Differences of the
result over small steps of p are then its derivatives by the tangent.  Newton's method from x
reaches the equilibrium at p' itself (`solve_from`).

The nodes of the mesh may be parameters too (offsets, rest posture): tied and guided nodes then
stand where the new mesh has them, and the others follow.  What moves the bones or changes which
nodes a quad joins has to be solved anew.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, cast

import numpy as np

from cosim.case.schema import Case
from cosim.coupling.equilibrium import Equilibrium
from cosim.fingers.kinds import tip_support_kind
from cosim.models.build import Models, build, tensions
from cosim.port import Array
from cosim.results.static import observe_static
from cosim.solve.static import States
from fe_solver.hood.shell_hood import HoodState
from fe_solver.hood.shell_hood import ShellHood as FeHood

Reshape = Callable[[FeHood, FeHood, HoodState, Array], HoodState]
"""The state of a hood from that of another, under tensions (nt,) N."""


def tangent_serves(case: Case) -> bool:
    """Whether the bones are held and nothing but a shell in smooth contact answers the tendons."""
    plain = all(
        (t.muscle, t.excursion, t.friction) == (None, None, None) for t in case.tendons.values()
    )
    coupled = case.coupling.scheme != "one_way" and case.forward is None
    held = tip_support_kind(case.finger) == "posture"
    return case.hood.has_smooth_tangent and coupled and held and plain


def predict_summary(
    case: Case, models: Models, states: States, arms: bool = True
) -> Mapping[str, Any] | None:
    """The summary of `case`, to first order, from a solved case that differs little from it; None
    where its bones stand elsewhere or its mesh has other quads.  Without `arms` the moment arms by
    force, which cost most of it, are those of the solved case."""
    fresh = _matching_models(case, models, states)
    if fresh is None:
        return None
    near = _transfer_states(case, (models, fresh), states, FeHood.near, arms)
    return observe_static(case, (fresh, near), 0.0).summary


def solve_from(
    case: Case, models: Models, states: States, arms: bool = True
) -> tuple[Models, States] | None:
    """The equilibria of `case` by Newton's method from those of a solved case; None and `arms` as
    of `predict_summary`.  Reciprocity is not audited.  Raises ConvergenceError."""
    fresh = _matching_models(case, models, states)
    if fresh is None:
        return None
    reached = _transfer_states(case, (models, fresh), states, FeHood.solve_from, arms)
    return fresh, replace(reached, reciprocity=None)


def _matching_models(case: Case, models: Models, states: States) -> Models | None:
    """Models of `case` where a hood of theirs can follow from the solved one."""
    fresh = build(case)
    held = fresh.finger.motion(fresh.finger.start(fresh.posture))
    moved = np.abs(held.twist_to(states.loaded.motion)).max() > 0
    return None if moved or not _alike(_shell(fresh), _shell(models)) else fresh


def _alike(hood: FeHood, other: FeHood) -> bool:
    a, b = hood.model, other.model
    return np.array_equal(a.quads, b.quads) and np.array_equal(a.free, b.free)


def _shell(models: Models) -> FeHood:
    return cast(FeHood, models.hood)  # of a hood that has a smooth tangent


def _transfer_states(
    case: Case, pair: tuple[Models, Models], states: States, reshape: Reshape, arms: bool
) -> States:
    """The states of the second models from those of the first."""
    first_models, models = pair
    hood, finger = tensions(case, models)
    rest = [np.full(len(pull), models.resting) for pull in (hood, finger)]

    def transfer(e: Equilibrium, hood: Array, finger: Array) -> Equilibrium:
        held, shell = models.finger.start(models.posture), _shell(models)
        state = reshape(shell, _shell(first_models), e.response.state, hood)
        response = shell.response(state)
        balance = models.finger.balance(held, response.load, finger)
        return replace(
            e,
            finger_state=held,
            response=response,
            balance=balance,
            jacobian=shell.jacobian(state) if arms else e.jacobian,
            hood_tension=hood,
            finger_tension=finger,
            finger_residual=balance.relative,
            interface_residual=balance.relative,
        )

    unloaded, loaded = transfer(states.unloaded, *rest), transfer(states.loaded, hood, finger)
    return replace(states, unloaded=unloaded, loaded=loaded)
