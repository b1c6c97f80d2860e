"""The equilibria of a case: with every tendon at its resting tension, then loaded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from cosim.case.schema import Case
from cosim.coupling.equilibrium import Equilibrium, reciprocity
from cosim.coupling.events import Bearing
from cosim.coupling.excursion import (
    ExcursionState,
    PrescribedExcursions,
    initial_excursions,
    solve_excursions,
)
from cosim.coupling.one_way import OneWayPass
from cosim.errors import ConvergenceError, Progress, named_progress, quiet
from cosim.models.build import Models, case_finger, relaxing, tensions
from cosim.port import Array, OpenFinger, PairState, Tensions
from cosim.solve.held import Held, Loaded, hold
from cosim.solve.session import Session, is_solved_both_ways, solve_equilibrium
from cosim.solve.strength import Strength, first_to_give_way
from cosim.stopwatch import timed
from cosim.tendons.muscles import MusclePull, live_muscles
from cosim.tendons.table import Sliding, stretch_of


@dataclass(frozen=True)
class SecondStart:
    """The loaded equilibrium that was found from another start."""

    scheme: str
    """By which scheme of the coupling."""
    found: Equilibrium | None
    """None where it did not converge."""
    failure: str = ""
    """Why it did not; empty where it did."""


@dataclass(frozen=True)
class OneWaySlide:
    """The loaded equilibrium with all tendons that have friction sliding one way."""

    finger: OpenFinger
    found: Equilibrium | None
    """None where it did not converge."""
    failure: str = ""
    """Why it did not; empty where it did."""


@dataclass(frozen=True)
class States:
    """The two equilibria of an isometric case, and the audit of the loaded one."""

    unloaded: Equilibrium
    loaded: Equilibrium
    reciprocity: float | None
    """None where the hood has no tendons to pull, or rubs on the bones."""
    pull: MusclePull
    """The pull of the muscles that have a fibre, in the loaded state."""
    one_way: OneWayPass | None = None
    """What a one-way pass handed over; None of a coupled equilibrium."""
    second: SecondStart | None = None
    """Where the case asks for it."""
    ways: Mapping[str, OneWaySlide] = field(default_factory=dict)
    """By way of sliding, loading and unloading, of a case whose tendons have friction: what lies
    between them friction can hold."""
    strength: Strength | None = None
    """What gives way first, where the case lets parts of the hood do so."""
    held: Held | None = None
    """How the loaded equilibrium came about from that at once, where parts relax."""

    def models_at(self, loaded: Models) -> dict[str, Models]:
        """The models in which the two equilibria are, by their names."""
        return {"unloaded": loaded if self.held is None else self.held.models, "loaded": loaded}


AUDIT_STEP = 2e-5
"""rad, joint step of the reciprocity audit: small against the contact's smoothing."""
MOST_PULLS = 30
INTERVAL: tuple[Sliding, Sliding] = ("loading", "unloading")
"""The ways between which friction holds; a tendon that states none slides the first."""
PULL_TOLERANCE = 1e-7  # relative to the largest tension (at least 1 N)


def solve_static(case: Case, session: Session, progress: Progress = quiet) -> tuple[Models, States]:
    """The equilibrium with every tendon at its resting tension, then the loaded one.

    Raises InputError and ConvergenceError."""
    models = session.models(case, progress)
    units = _units(case, models)
    unloaded = session.unloaded_equilibrium(case, progress)
    near, second = session.start_near(case, models, loaded=True), None
    if near is not None and is_solved_both_ways(case):
        second = _from_nearby(case, models, unloaded, near, progress)
        near = None
    first = _loaded_from(case, models, unloaded, near, progress)
    session.remember(case, models, unloaded, first.equilibrium)
    held, whole = None, models.hood
    if case.relaxation is not None:
        solve = partial(_loaded_equilibrium, unloaded=unloaded)
        models, first, held = hold(case, models, unloaded, first, solve, progress)
    loaded, pull = first.equilibrium, first.pull
    if case.solve.second_start:
        second = _second_start(case, models, unloaded, progress, first.draw)
    ways = _both_ways(case, models, unloaded, first, progress)
    at_once = None if held is None else whole
    strength = _strength(case, models, units, unloaded, first, progress, at_once)
    if not models.hood.tendons or loaded.balance is None or case.hood.has_friction:
        return models, States(unloaded, loaded, None, pull, None, second, ways, strength, held)
    progress("auditing reciprocity")
    strongest = int(np.argmax(loaded.hood_tension))
    with timed("audit of reciprocity"):
        gap = reciprocity(models.finger, models.hood, loaded, strongest, AUDIT_STEP)
    return models, States(unloaded, loaded, gap, pull, None, second, ways, strength, held)


def _units(case: Case, models: Models) -> Sequence[Any]:
    """What gives way of the case's hood.  Raises InputError."""
    if case.gives_way is None:
        return ()
    from cosim.hoods.giving import units_of

    hood: Any = models.hood  # of finite elements, by the schema
    return units_of(hood, case.gives_way, models.built.others())


def _strength(
    case: Case,
    models: Models,
    units: Sequence[Any],
    unloaded: Equilibrium,
    loaded: Loaded,
    progress: Progress,
    at_once: Any = None,
) -> Strength | None:
    """What gives way first of the `units` of a case that lets parts of its hood do so; `at_once`:
    the hood before it relaxed."""
    if not units:
        return None
    from cosim.hoods.giving import bearing_of

    hood: Any = models.hood
    others = models.built.others()

    def bearing(e: Equilibrium) -> Bearing:
        return bearing_of(hood, units, e.response.state, others, at_once)

    def solve(other: Case, near: Equilibrium) -> Equilibrium:
        start = PairState(near.finger_state, near.response.state)
        own = replace(models, muscles=live_muscles(other.tendons))
        return _loaded_equilibrium(other, own, unloaded, start, say, loaded.draw).equilibrium

    say = partial(_say, progress, "strength")
    return first_to_give_way(case, units, loaded.equilibrium, bearing, solve)


def _both_ways(
    case: Case, models: Models, unloaded: Equilibrium, own: Loaded, progress: Progress
) -> dict[str, OneWaySlide]:
    """The loaded equilibrium with every tendon that has friction sliding towards its muscle, and
    with every one sliding away, each from the case's own."""
    rubbing, out, loaded = case.rubbing_tendons(), dict[str, OneWaySlide](), own.equilibrium
    for sliding in INTERVAL if rubbing else ():
        if all((tendon.sliding or INTERVAL[0]) == sliding for tendon in rubbing.values()):
            out[sliding] = OneWaySlide(models.finger, loaded)
            continue
        finger = case_finger(case, sliding)
        start = PairState(loaded.finger_state, loaded.response.state)
        say = partial(_say, progress, f"friction, {sliding}")
        try:
            with timed("friction both ways"):
                found = _loaded_equilibrium(
                    case, replace(models, finger=finger), unloaded, start, say, own.draw
                )
        except ConvergenceError as error:
            out[sliding] = OneWaySlide(finger, None, str(error))
        else:
            out[sliding] = OneWaySlide(finger, found.equilibrium)
    return out


@timed("second start")
def _second_start(
    case: Case,
    models: Models,
    unloaded: Equilibrium,
    progress: Progress,
    draw: ExcursionState | None,
) -> SecondStart:
    """The loaded equilibrium once more, from the finger in its posture and the hood as it is laid
    and by the other scheme; by the case's own where that one finds none."""
    own = case.coupling.scheme
    failure = ""
    for scheme in ("newton" if own == "implicit" else "implicit", own):
        coupling = case.coupling.model_copy(update={"scheme": scheme})
        again = case.model_copy(update={"coupling": coupling})
        say = partial(_say, progress, f"second start, {scheme}")
        try:
            found = _loaded_equilibrium(again, models, unloaded, models.start(), say, draw)
        except ConvergenceError as error:
            failure = str(error)
        else:
            return SecondStart(scheme, found.equilibrium)
    return SecondStart(own, None, failure)


def _say(progress: Progress, what: str, text: str) -> None:
    progress(f"{what}: {text}")


@timed("equilibrium from near by")
def _from_nearby(
    case: Case, models: Models, unloaded: Equilibrium, near: PairState, progress: Progress
) -> SecondStart:
    """The loaded equilibrium from a state near by, of a case that is solved both ways."""
    say, scheme = partial(_say, progress, "from near by"), case.coupling.scheme
    try:
        found = _loaded_equilibrium(case, models, unloaded, near, say)
        return SecondStart(scheme, found.equilibrium)
    except ConvergenceError as error:
        return SecondStart(scheme, None, str(error))


@timed("loaded equilibrium")
def _loaded_from(
    case: Case, models: Models, unloaded: Equilibrium, near: PairState | None, progress: Progress
) -> Loaded:
    """The loaded equilibrium: from a state `near` where there is a way from it, else from the
    unloaded one."""
    if near is not None:
        with suppress(ConvergenceError):
            return _loaded_equilibrium(case, models, unloaded, near, progress)
    start = PairState(unloaded.finger_state, unloaded.response.state)
    return _loaded_equilibrium(case, models, unloaded, start, progress)


def _loaded_equilibrium(
    case: Case,
    models: Models,
    unloaded: Equilibrium,
    start: PairState,
    progress: Progress,
    draw: ExcursionState | None = None,
    time: float | None = None,
) -> Loaded:
    """The equilibrium, reached from the states `start`, in which every muscle pulls as its fibre
    does at that length, and every tendon whose excursion is stated has it: from what an equilibrium
    before left of the excursions, and `time` s after the load was put on, without it at its
    time."""
    names = (*models.hood.tendons, *models.finger.tendons)
    of_muscles = np.array([names.index(name) for name in models.muscles.names], dtype=int)
    prescribed = _prescribed_excursions(case, names)
    index, tension = prescribed.index, np.concatenate(tensions(case, models))
    split, at = len(models.hood.tendons), start
    pull = models.muscles.pull(np.zeros(len(of_muscles)))

    def solve_with(displaced: Array) -> tuple[Loaded, Array]:
        """The equilibrium from the last one, with tensions (nd,) N of displaced tendons."""
        nonlocal at, pull
        tension[index] = displaced
        for _ in range(MOST_PULLS):
            tension[of_muscles] = pull.tension
            loaded = solve_equilibrium(
                case,
                models,
                at,
                Tensions(tension[:split].copy(), tension[split:].copy()),
                named_progress(progress, "loaded"),
            )
            at = PairState(loaded.finger_state, loaded.response.state)
            if not len(of_muscles) and not len(index):
                return Loaded(loaded, pull, draw), np.zeros(0)
            shortening = _shortening(models, unloaded, loaded)
            pull = models.muscles.pull(shortening[of_muscles])
            miss = np.abs(pull.tension - tension[of_muscles]).max(initial=0.0)
            if miss <= PULL_TOLERANCE * max(1.0, tension.max(initial=0.0)):
                return Loaded(loaded, pull, draw), shortening[index]
            progress(f"tensions: off by {miss:.1e} N")
        raise ConvergenceError(
            f"muscles and finger did not agree in {MOST_PULLS} rounds: a tension still changes by "
            f"{miss:.1e} N. Try a smaller activation, or a fibre_length nearer to 1"
        )

    begun = tension[index]
    if not prescribed.names:
        return solve_with(begun)[0]
    if draw is None:
        draw = initial_excursions(begun, np.zeros(len(begun)), prescribed.relaxation)
    at_time = draw.time if time is None else time
    solved, end = solve_excursions(prescribed, draw, at_time, solve_with)
    if (slack := end.tension <= 0).any():
        i = int(np.argmax(slack))
        raise ConvergenceError(
            f"tendons.{prescribed.names[i]}.excursion: {1e3 * prescribed.excursion(0.0)[i]:.4g} mm "
            "would slacken the tendon; draw it further, or leave it at the resting tension"
        )
    return solved._replace(draw=end)


def _prescribed_excursions(case: Case, names: tuple[str, ...]) -> PrescribedExcursions:
    stated = {n: t.excursion for n, t in case.tendons.items() if t.excursion is not None}
    index = np.array([names.index(name) for name in stated], dtype=int)
    give, slack = stretch_of([case.tendons[name] for name in stated])
    drawn = np.array(list(stated.values()))
    return PrescribedExcursions(
        tuple(stated), index, lambda time: drawn, give, slack, relaxing(case).tendons
    )


def _shortening(models: Models, unloaded: Equilibrium, loaded: Equilibrium) -> Array:
    """The shortening (nt,) m of all tendons' paths, the hood's first."""
    lengths = [models.finger.path_lengths(e.finger_state) for e in (unloaded, loaded)]
    return np.concatenate([loaded.excursion - unloaded.excursion, lengths[0] - lengths[1]])
