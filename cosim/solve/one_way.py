"""The one-way pass of a case.  One of the files that know the solvers by name."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from cosim.case.schema import Case
from cosim.coupling.equilibrium import CouplingOptions, Equilibrium, equilibrium
from cosim.coupling.one_way import FrozenHood, OneWayPass, torques
from cosim.errors import Progress, quiet
from cosim.models.build import Models, case_finger, tensions
from cosim.port import (
    STATIC,
    Array,
    Hood,
    Motion,
    OpenFinger,
    Pair,
    PairState,
    Response,
    State,
    Tensions,
)
from cosim.solve.session import Session
from cosim.solve.static import States
from cosim.static_response import static_response
from cosim.tendons.muscles import MusclePull

if TYPE_CHECKING:
    from rigid.mujoco.finger import MujocoFinger


@dataclass(frozen=True)
class HoodPass:
    """The first pass: the hood solved in the posture, at the resting tension and under load."""

    models: Models
    start: State
    """The finger's, in the posture."""
    at: Motion
    answers: tuple[PassAnswer, PassAnswer]
    pull: MusclePull


class PassAnswer(NamedTuple):
    """What the hood said, and under which tensions (N) of its own tendons and the finger's."""

    response: Response
    by_tension: Array
    hood: Array
    own: Array


def solve_one_way(
    case: Case, session: Session, progress: Progress = quiet
) -> tuple[Models, States]:
    """The models, with what was handed over in the hood's place, and both states.

    Muscles with a fibre pull as they do in the posture.  Raises InputError, ConvergenceError."""
    return finger_pass(case, hood_pass(case, session, progress), progress)


def hood_pass(case: Case, session: Session, progress: Progress) -> HoodPass:
    """The hood's part of `solve_one_way`, which does not depend on what is handed over."""
    models = session.models(case, progress)
    start = models.finger.start(models.posture)
    at = models.finger.motion(start)
    hood, native, pull = _tensions(case, models)
    resting = np.full(len(hood), models.resting), np.full(len(native), models.resting)
    state, answers = models.hood.start(at), []
    for tensions_ in (resting, (hood, native)):
        progress(f"one way: hood solved in the posture, {tensions_[0].max(initial=0.0):.3g} N")
        response = static_response(models.hood, state, at, tensions_[0])
        by_tension = models.hood.jacobian(response.state).load_tension
        answers.append(PassAnswer(response, by_tension, *tensions_))
        state = response.state
    return HoodPass(models, start, at, (answers[0], answers[1]), pull)


def finger_pass(case: Case, given: HoodPass, progress: Progress) -> tuple[Models, States]:
    """The finger's part: what the case hands over of the hood's answers, and what comes of it."""
    models = replace(given.models, finger=_second(case, given.models.finger))
    centre = _centres(given.models.finger, given.start) if _lumps(case) else None
    balanced = []
    for answer in given.answers:
        handed = FrozenHood(
            models.hood.tendons,
            answer.response,
            given.at,
            answer.by_tension,
            centre,
            case.coupling.one_way.joint_contact,
        )
        balanced.append(_balance(case, models.finger, handed, given.start, answer))
        progress(f"one way: finger balanced to {balanced[-1].finger_residual:.1e}")
    unloaded, loaded = balanced
    passed = OneWayPass(handed, *_interface_residual(models.hood, models.finger, loaded))
    models = replace(models, built=replace(models.built, hood=handed))
    return models, States(unloaded, loaded, None, given.pull, passed)


def _balance(
    case: Case, finger: OpenFinger, handed: FrozenHood, start: State, answer: PassAnswer
) -> Equilibrium:
    """The finger's equilibrium under what was handed over."""
    native = answer.own if case.coupling.one_way.muscles else np.zeros(len(answer.own))
    options = CouplingOptions(case.solve.tolerance, case.solve.max_iterations)
    state = answer.response.state
    tensions = Tensions(answer.hood, native)
    return equilibrium(Pair(finger, handed), PairState(start, state), tensions, options)


def _second(case: Case, first: OpenFinger) -> OpenFinger:
    """The finger of the second pass."""
    if case.coupling.one_way.passive:
        return first
    limp = case.native_finger().model_copy(update={"passive": {}, "tie": {}})
    return case_finger(case.model_copy(update={"finger": limp}))


def _lumps(case: Case) -> bool:
    return case.coupling.one_way.lumping == "centre_of_mass"


def _centres(finger: OpenFinger, at: State) -> Array:
    """The bodies' centres of mass (nb, 3) m in their frames."""
    motion = finger.motion(at)
    heavy = cast("MujocoFinger", finger)  # what check_fit lets be lumped
    away = heavy.mass_centres(finger.angles(at)) - motion.position
    return np.einsum("bji,bj->bi", motion.rotation, away)


def _tensions(case: Case, models: Models) -> tuple[Array, Array, MusclePull]:
    """Tensions (N) of the hood's and of the finger's own tendons, in the posture."""
    hood, native = tensions(case, models)
    pull = models.muscles.pull(np.zeros(len(models.muscles.names)))
    for name, force in zip(models.muscles.names, pull.tension, strict=True):
        names, values = (models.hood.tendons, hood)
        if name not in names:
            names, values = (models.finger.tendons, native)
        values[names.index(name)] = force
    return hood, native, pull


def _interface_residual(
    hood: Hood, finger: OpenFinger, e: Equilibrium
) -> tuple[float, dict[str, Array]]:
    """The interface residual, relative, with the hood's answer at the new pose, and the torques
    (N m) of the load that was handed over."""
    answer = hood.advance(e.response.state, e.motion, e.hood_tension, STATIC)
    missed = finger.balance(e.finger_state, answer.load, e.finger_tension).relative
    return missed, torques(finger.jacobian(e.finger_state), e.load)
