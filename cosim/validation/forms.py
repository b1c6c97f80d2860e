"""How far the compared numbers go with the model's form: the trials with other hoods.

The forms are the rungs of `cosim ladder`, and the case's own hood that rubs on the bones.  Their
spread is reported beside the uncertainty and chooses nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cosim.analyses.ladder import RUNGS, case_on_rung
from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.validation.run import Board
from cosim.validation.trial import Trial
from cosim.validation.versions import Key, Version, values_of_boards

FRICTION = 0.1
RUBBING = f"friction {FRICTION:g}"


def form_versions(settings: Sequence[str] = ()) -> dict[str, Version]:
    """The trials with each form; those without a sheet stay as they are."""

    def on_rung(name: str) -> Version:
        def version(trial: Trial) -> Case:
            case = load_case(trial.case, (*trial.settings, *settings))
            return case if case.hood.generated_quads is None else case_on_rung(case, name)

        return version

    def rubbing(trial: Trial) -> Case:
        stated = (*trial.settings, *settings)
        case = load_case(trial.case, stated)
        if case.hood.generated_quads is None:
            return case
        return load_case(trial.case, (*stated, f"hood.contact.friction={FRICTION}"))

    return {**{name: on_rung(name) for name in RUNGS}, RUBBING: rubbing}


def form_values(versions: Mapping[str, Sequence[Board]]) -> dict[Key, dict[str, float | None]]:
    """Every number by form; None where a form has none."""
    values: dict[Key, dict[str, float | None]] = {}
    for name, boards in versions.items():
        for key, value in values_of_boards(boards).items():
            values.setdefault(key, {})[name] = value
    return values
