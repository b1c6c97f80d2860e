"""How uncertain the compared numbers are by the model's inputs: the trials at samples of these.

The study `cases/studies/input_uncertainty.toml` says the spread of each input.  All trials are run
at the same samples, so that numbers of several trials are those of one hand; what a case lacks has
no effect there.  The standard uncertainty is the root of the mean square of a number less that of
the case as it is, on the same mesh: a case whose inputs lie at the end of their range is off too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.study.plan import Point, StudyPlan, applicable_settings, read_plan
from cosim.validation.records import Record
from cosim.validation.run import Board
from cosim.validation.trial import Trial
from cosim.validation.versions import Key, Version, values_of_boards

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
