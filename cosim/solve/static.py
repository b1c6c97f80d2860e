"""The equilibria of a case: with every tendon at its resting tension, then loaded."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from cosim.build.models import Models, build, tensions
from cosim.build.scheme import accelerator_of
from cosim.case.schema import Case
from cosim.coupling.equilibrium import CouplingOptions, Equilibrium, equilibrium, reciprocity
from cosim.coupling.excursion import (
    PrescribedExcursions,
    initial_excursions,
    solve_excursions,
)
from cosim.coupling.fixed_point import fixed_point
from cosim.port import Array, ConvergenceError, Progress, State, quiet
from cosim.solve.states import States
from cosim.tendons.muscles import Pull, live_muscles

AUDIT_STEP = 2e-5
"""rad, joint step of the reciprocity audit: small against the contact's smoothing."""
MOST_PULLS = 30
PULL_TOLERANCE = 1e-7
"""Of the largest tension (at least 1 N)."""


@dataclass(frozen=True)
class Setting:
    """What cases that differ only in their tendons share, and so need solve only once."""

    key: str
    case: Case = field(compare=False)
    progress: Progress = field(compare=False)


def solve(case: Case, progress: Progress = quiet) -> tuple[Models, States]:
    """The equilibrium with every tendon at its resting tension, then the loaded one.

    Models that cases share are not theirs: a case's own muscles come with it."""
    if case.coupling.scheme == "one_way":
        from cosim.solve.one_way import passed_once

        return passed_once(case, progress)
    shared, unloaded = settled(Setting(case.setting_key(), case, progress))
    models = replace(shared, muscles=live_muscles(case.tendons))
    loaded, pull = _loaded(case, models, unloaded, progress)
    if not models.hood.tendons:
        return models, States(unloaded, loaded, None, pull)
    progress("auditing reciprocity")
    strongest = int(np.argmax(loaded.hood_tension))
    gap = reciprocity(models.finger, models.hood, loaded, strongest, AUDIT_STEP)
    return models, States(unloaded, loaded, gap, pull)


def _loaded(
    case: Case, models: Models, unloaded: Equilibrium, progress: Progress
) -> tuple[Equilibrium, Pull]:
    """The equilibrium, pulled from the unloaded one, in which every muscle pulls as its fibre does
    at that length, and every tendon whose excursion is stated has it."""
    names = (*models.hood.tendons, *models.finger.tendons)
    own = np.array([names.index(name) for name in models.muscles.names], dtype=int)
    prescribed = _prescribed(case, names)
    index, tension = prescribed.index, np.concatenate(tensions(case, models))
    split, loaded = len(models.hood.tendons), unloaded
    pull = models.muscles.pull(np.zeros(len(own)))

    def pulled(found: Array) -> tuple[tuple[Equilibrium, Pull], Array]:
        """The equilibrium from the last one, with tensions (nd,) N of displaced tendons."""
        nonlocal loaded, pull
        tension[index] = found
        for _ in range(MOST_PULLS):
            tension[own] = pull.tension
            loaded = agreed(
                case,
                models,
                loaded.finger_state,
                loaded.response.state,
                tension[:split].copy(),
                tension[split:].copy(),
                lambda text: progress(f"loaded: {text}"),
            )
            shortening = _shortening(models, unloaded, loaded)
            pull = models.muscles.pull(shortening[own])
            miss = np.abs(pull.tension - tension[own]).max(initial=0.0)
            if miss <= PULL_TOLERANCE * max(1.0, tension.max(initial=0.0)):
                return (loaded, pull), shortening[index]
            progress(f"tensions: off by {miss:.1e} N")
        raise ConvergenceError(
            f"muscles and finger did not agree in {MOST_PULLS} rounds: a tension still changes by "
            f"{miss:.1e} N. Try a smaller activation, or a fibre_length nearer to 1"
        )

    start = tension[index]
    if not prescribed.names:
        return pulled(start)[0]
    found, end = solve_excursions(
        prescribed, initial_excursions(start, np.zeros(len(start))), 0.0, pulled
    )
    if (slack := end.tension <= 0).any():
        i = int(np.argmax(slack))
        raise ConvergenceError(
            f"tendons.{prescribed.names[i]}.excursion: {1e3 * prescribed.excursion(0.0)[i]:.4g} mm "
            "would slacken the tendon; draw it further, or leave it at the resting tension"
        )
    return found


def _prescribed(case: Case, names: tuple[str, ...]) -> PrescribedExcursions:
    stated = {n: t.excursion for n, t in case.tendons.items() if t.excursion is not None}
    index = np.array([names.index(name) for name in stated], dtype=int)
    return PrescribedExcursions(tuple(stated), index, lambda time: np.array(list(stated.values())))


def _shortening(models: Models, before: Equilibrium, now: Equilibrium) -> Array:
    """(nt,) m of all tendons' paths, the hood's first."""
    lengths = [models.finger.path_lengths(e.finger_state) for e in (before, now)]
    return np.concatenate([now.excursion - before.excursion, lengths[0] - lengths[1]])


@lru_cache(maxsize=4)
def settled(setting: Setting) -> tuple[Models, Equilibrium]:
    """The models of a setting and their unloaded equilibrium."""
    case, progress = setting.case, setting.progress
    progress("building the models")
    models = build(case)
    start = models.finger.start(models.posture)
    return models, agreed(
        case,
        models,
        start,
        models.hood.start(models.finger.motion(start)),
        np.full(len(models.hood.tendons), models.resting),
        np.full(len(models.finger.tendons), models.resting),
        lambda text: progress(f"unloaded: {text}"),
    )


def agreed(
    case: Case,
    models: Models,
    start: State,
    state: State,
    hood_tension: Array,
    finger_tension: Array,
    progress: Progress,
) -> Equilibrium:
    """The coupled equilibrium by the case's scheme, from the finger's `start` and the hood's
    `state`, under tensions in N."""
    finger, hood, coupling = models.finger, models.hood, case.coupling
    options = CouplingOptions(case.solve.tolerance, case.solve.max_iterations)
    if coupling.scheme != "implicit":
        return equilibrium(
            finger, hood, start, state, hood_tension, finger_tension, options, progress
        )
    return fixed_point(
        finger,
        hood,
        start,
        state,
        hood_tension,
        finger_tension,
        options,
        accelerator_of(coupling),
        coupling.tolerance,
        progress,
    )
