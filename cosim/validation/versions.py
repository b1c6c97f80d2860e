"""The trials of validations in other versions: on other meshes, with other inputs or hoods.

A version makes a case of a trial.  Its runs leave no folder, and stand beside the same references.
Experiments of several runs, and hoods whose mesh is a file of its own, have no versions.

The other hoods are the rungs of `cosim ladder`, and the case's own that rubs on the bones.  Their
spread is reported beside the uncertainty and chooses nothing.

The spread of each input is that of the study `cases/studies/input_uncertainty.toml`.  All trials
are run at the same samples, so that numbers of several trials are those of one hand; what a case
lacks has no effect there.  The standard uncertainty is the root of the mean square of a number less
that of the case as it is, on the same mesh: a case whose inputs lie at the end of their range is
off too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from cosim.analyses.ladder import RUNGS, case_on_rung
from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.errors import ConvergenceError, Progress, quiet
from cosim.outcome import Outcome
from cosim.pipeline import plain_summary, run_each
from cosim.results.audit import describe_misses
from cosim.results.compare import Comparison
from cosim.results.result import Result
from cosim.study.plan import Point, StudyPlan, applicable_settings, read_plan
from cosim.validation.records import Record
from cosim.validation.run import Board, board_of, with_trials
from cosim.validation.trial import Trial, TrialGroup

Version = Callable[[Trial], Case]
"""The case of a trial in a version.  Raises InputError where the trial has none."""
Key = tuple[str, str, str, str]
"""What a compared number is known by: its group, case, name and quantity."""


def key_of(group: str, row: Comparison) -> Key:
    """The key of a row in its group."""
    t = row.target
    return group, t.case, t.name, t.quantity


def values_of_boards(boards: Iterable[Board]) -> dict[Key, float | None]:
    """The model's number of every row."""
    return {key_of(b.group, row): row.model for b in boards for row in b.rows}


def run_versions(
    groups: Sequence[TrialGroup],
    versions: Mapping[str, Version],
    workers: int = 2,
    progress: Progress = quiet,
) -> dict[str, list[Board]]:
    """The boards of the groups in each version, by its name.  A run that misses its audit has no
    numbers here.  Raises InputError where a process is ended from outside."""
    trials = {t.name: t for g in groups for t in g.trials if not (t.study or t.published)}
    places = [(version, name) for version in versions for name in trials]

    def ended(done: int, i: int, outcome: Outcome[Any]) -> None:
        version, name = places[i]
        words = f"{name}, {version}: {outcome.reason or 'done'}"
        progress(f"{done} of {len(places)}: {words}")

    makers = [partial(versions[version], trials[name]) for version, name in places]
    outcomes: dict[str, dict[str, Outcome[Any]]] = {name: {} for name in versions}
    for (version, name), outcome in zip(
        places, run_each(makers, audited_summary, workers, ended), strict=True
    ):
        outcomes[version][name] = outcome
    chosen = [with_trials(g, [t for t in g.trials if t.name in trials]) for g in groups]
    kept = [g for g in chosen if g.trials]
    return {name: [board_of(g, of_version) for g in kept] for name, of_version in outcomes.items()}


def audited_summary(result: Result) -> Mapping[str, Any]:
    """The summary of a run.  Raises ConvergenceError where it misses its audit."""
    if misses := list(describe_misses(result.summary)):
        raise ConvergenceError(f"misses its audit: {'; '.join(misses)}")
    return plain_summary(result)


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


STUDY = "input_uncertainty"
AS_IT_IS = "as it is"
LEAST_SAMPLES = 5
"""Samples with a number, of which there is no spread with less."""


class InputSpread(Record):
    """A number at samples of the inputs, in its unit."""

    nominal: float
    """With the inputs as they are, on the samples' mesh."""
    mean: float
    sd: float
    samples: int
    """Those with a result."""
    failed: int

    @property
    def uncertainty(self) -> float:
        """The standard uncertainty u_input."""
        return float(np.hypot(self.sd, self.mean - self.nominal))


def read_inputs(samples: int | None = None) -> StudyPlan:
    """The plan of the inputs, with so many samples.  Raises InputError."""
    plan = read_plan(STUDY)
    if samples is None or plan.sampling is None:
        return plan
    return replace(plan, sampling=plan.sampling.model_copy(update={"n": samples}))


def input_versions(plan: StudyPlan, settings: Sequence[str] = ()) -> dict[str, Version]:
    """The trials with `settings` and those of the plan, as they are and at each sample."""
    points = {f"sample {i}": point for i, point in enumerate(plan.points, 1)}
    return {name: _at(plan, point, settings) for name, point in [(AS_IT_IS, None), *points.items()]}


def _at(plan: StudyPlan, point: Point | None, settings: Sequence[str]) -> Version:
    def version(trial: Trial) -> Case:
        stated = (*trial.settings, *settings)
        case = load_case(trial.case, stated)
        if case.hood.generated_quads is not None:
            stated = (*stated, *plan.settings)
        if point is None:
            return load_case(trial.case, stated)
        base = case.model_dump(mode="json", exclude={"name", "source"}, exclude_none=True)
        sampled = applicable_settings(plan.parameters, point, base)
        return load_case(trial.case, (*stated, *sampled))

    return version


def input_spreads(versions: Mapping[str, Sequence[Board]]) -> dict[Key, InputSpread]:
    """The spread of every number that has enough samples."""
    nominal = values_of_boards(versions[AS_IT_IS])
    sampled = [values_of_boards(b) for name, b in versions.items() if name != AS_IT_IS]
    spreads: dict[Key, InputSpread] = {}
    for key, own in nominal.items():
        values = [v for of_sample in sampled if (v := of_sample.get(key)) is not None]
        if own is not None and len(values) >= LEAST_SAMPLES:
            spreads[key] = InputSpread(
                nominal=own,
                mean=float(np.mean(values)),
                sd=float(np.std(values, ddof=1)),
                samples=len(values),
                failed=len(sampled) - len(values),
            )
    return spreads
