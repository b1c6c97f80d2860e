"""The equilibria of a case: with every tendon at its resting tension, then loaded."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cosim.build.models import Models, tensions
from cosim.case.schema import Case
from cosim.coupling.drawn import Drawn, begun, redrawn
from cosim.coupling.equilibrium import Equilibrium, reciprocity
from cosim.port import Array, ConvergenceError
from cosim.solve.agree import agree
from cosim.solve.session import Session
from cosim.solve.states import States
from cosim.tendons.muscles import Pull

Progress = Callable[[str], None]
AUDIT_STEP = 2e-5
"""rad, joint step of the reciprocity audit: small against the contact's smoothing."""
MOST_PULLS = 30
DRAWN_TOLERANCE = 1e-9
"""m."""
PULL_TOLERANCE = 1e-7
"""Of the largest tension (at least 1 N)."""


def solve_static(
    case: Case, session: Session, progress: Progress = lambda text: None
) -> tuple[Models, States]:
    """The equilibrium with every tendon at its resting tension, then the loaded one.

    Raises InputError and ConvergenceError."""
    models, unloaded = session.models(case, progress), session.unloaded(case, progress)
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
    drawn = _drawn(case, names)
    hood, finger = tensions(case, models)
    tension, split = np.concatenate([hood, finger]), len(hood)
    pull = models.muscles.pull(np.zeros(len(own)))
    start, state = unloaded, unloaded.response.state
    draw = begun(drawn, tension)
    for _ in range(MOST_PULLS):
        tension[own], tension[drawn.index] = pull.tension, draw.tension
        loaded = agree(
            case,
            models,
            start.finger_state,
            state,
            tension[:split].copy(),
            tension[split:].copy(),
            lambda text: progress(f"loaded: {text}"),
        )
        shortening = _shortening(models, unloaded, loaded)
        pull = models.muscles.pull(shortening[own])
        miss = np.abs(pull.tension - tension[own]).max(initial=0.0)
        off = np.abs(shortening[drawn.index] - drawn.excursion).max(initial=0.0)
        if miss <= PULL_TOLERANCE * max(1.0, tension.max(initial=0.0)) and off <= DRAWN_TOLERANCE:
            return loaded, pull
        progress(f"tensions: off by {miss:.1e} N, excursions by {1e3 * off:.1e} mm")
        draw = redrawn(drawn, draw, shortening[drawn.index])
        start, state = loaded, loaded.response.state
    raise ConvergenceError(
        f"tendons and finger did not agree in {MOST_PULLS} rounds: a tension still changes by "
        f"{miss:.1e} N, an excursion is off by {1e3 * off:.1e} mm. Try a smaller activation or "
        "excursion, or a fibre_length nearer to 1"
    )


def _drawn(case: Case, names: tuple[str, ...]) -> Drawn:
    stated = {n: t.excursion for n, t in case.tendons.items() if t.excursion is not None}
    index = np.array([names.index(name) for name in stated], dtype=int)
    return Drawn(tuple(stated), index, np.array(list(stated.values())))


def _shortening(models: Models, before: Equilibrium, now: Equilibrium) -> Array:
    """(nt,) m of all tendons' paths, the hood's first."""
    lengths = [models.finger.path_lengths(e.finger_state) for e in (before, now)]
    return np.concatenate([now.excursion - before.excursion, lengths[0] - lengths[1]])
