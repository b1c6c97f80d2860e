"""Experiments on lengths and cuts of the extensor among the validations, with the shell."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from cosim.analyses.length_experiments import EXPERIMENT_MODELS, experiments
from cosim.errors import ConvergenceError
from cosim.measured import SECOND_HAND
from cosim.outcome import Outcome
from cosim.results.compare import UNITS, Target
from cosim.validation.trial import Trial, TrialGroup

SHELL = "shell"
ENDINGS = {unit: key for key, unit in UNITS.items()}
OWN_ZERO = "zero lies within the experiment's own range"


def length_groups() -> tuple[TrialGroup, TrialGroup]:
    """What is judged: the first of the assumptions that each experiment leaves open; and, as a
    variant, the others."""
    trials = tuple(
        Trial(f"lengths: {what}", m.case, study=what) for what, m in EXPERIMENT_MODELS.items()
    )
    first = tuple(t for trial in trials for t in _targets(trial, slice(1)))
    rest = tuple(t for trial in trials for t in _targets(trial, slice(1, None)))
    others = tuple(t for t in trials if t.name in {target.case for target in rest})
    return (
        TrialGroup("lengths and cuts", SECOND_HAND, trials, first),
        TrialGroup(
            "lengths and cuts: other loads and places", SECOND_HAND, others, rest, variant=True
        ),
    )


def _targets(trial: Trial, which: slice) -> Iterator[Target]:
    model = EXPERIMENT_MODELS[trial.study]
    for name, where in itertools.product(model.experiments, model.assumptions[which]):
        e = experiments()[name]
        none = e.mean is not None and e.sd is not None and abs(e.mean) <= e.sd
        note = "; ".join(filter(None, (f"n {e.n}", e.read, OWN_ZERO if none else "")))
        yield Target(
            ", ".join(filter(None, (e.measured, where))),
            f"measured.{_key(name, where)}",
            e.unit,
            e.mean,
            e.sd,
            e.at_least,
            None,
            e.source,
            SECOND_HAND,
            trial.name,
            note=note,
        )


def measure_lengths(study: str, settings: Sequence[str]) -> Outcome[Mapping[str, Any]]:
    """A summary of what the shell, with settings of one's own, does in the experiments of a study;
    as far as it comes where it ends before its last value.

    Raises InputError."""
    measured: dict[str, float] = {}
    try:
        for v in EXPERIMENT_MODELS[study].values(SHELL, settings):
            measured[_key(v.experiment, v.where)] = float(v.value)
    except ConvergenceError as error:
        return Outcome("failed", {"measured": measured}, error)
    return Outcome("converged", {"measured": measured})


def _key(experiment: str, where: str) -> str:
    words = "_".join((experiment, *where.split()))
    return f"{words}_{ENDINGS[experiments()[experiment].unit]}"
