"""The plan of a study: what every run sets in the case, in an order that the file alone decides."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from cosim.case.file import Settings, find_case, load_case
from cosim.case.schema import check_name
from cosim.errors import InputError
from cosim.port import Array
from cosim.results.compare import Target, read_targets
from cosim.schema.fields import is_number
from cosim.study.distributions import Word, is_axis, middle
from cosim.study.file import FORM, Parameter, SamplingConfig, count_runs, find_study, read_file
from cosim.study.sampling import check_sampling, points, unit_points
from cosim.text_tables import read_text

Point = tuple[Word, ...]
"""A value for each parameter."""


@dataclass(frozen=True)
class StudyPlan:
    """A checked study."""

    name: str
    """The file's stem."""
    title: str
    notes: str
    text: str
    """The file itself."""
    case: Path
    settings: Settings
    parameters: tuple[Parameter, ...]
    sampling: SamplingConfig | None
    outputs: Mapping[str, str]
    """Path in the summary, or A/B, by name."""
    most_seconds: float | None
    most_failures: int | None
    arrays: bool | tuple[str, ...]
    targets: tuple[Target, ...]
    """Measured numbers to show beside the outputs."""
    base: Mapping[str, Any]
    """The case with `settings`, as its file would state it."""

    @cached_property
    def samples(self) -> Array | None:
        """Points of the unit cube; None where every parameter is an axis."""
        s = self.sampling
        count = sum(not is_axis(p.law) for p in self.parameters)
        if s is None:
            return None
        return unit_points(s.kind, count, s.n, s.seed, s.second_order)

    @property
    def count(self) -> int:
        """How many runs it has."""
        return count_runs(self.sampling, self.parameters)

    @cached_property
    def points(self) -> list[Point]:
        """The points of all runs, in order."""
        return points(tuple(p.law for p in self.parameters), self.samples)

    def settings_at(self, point: Point) -> Settings:
        """KEY=VALUE of a run.  Raises InputError for a key to scale that has no number."""
        return (*self.settings, *_settings(self.parameters, point, self.base))


def read_plan(
    path_or_name: str | Path, other: str | Path | None = None, own: Settings = ()
) -> StudyPlan:
    """The study of a file or of a packaged name, of its case or of the `other`, a path from here or
    a packaged name, with settings of one's `own` on top of the file's; checked with its case, at
    its settings and in the middle of every parameter.

    Raises InputError."""
    source = find_study(path_or_name)
    check_name(source.stem)  # the folder of what it leaves
    read, parameters = read_file(source)
    try:
        case = find_case(other) if other else find_case(read.case, source.parent)
        settings = (*read.settings, *own)
        base = load_case(case, settings)
    except InputError as error:
        raise InputError(f"{source}: case: {error}") from None
    values = base.model_dump(mode="json", exclude={"name", "source"}, exclude_none=True)
    targets = _targets(source, read.data)
    plan = StudyPlan(
        source.stem,
        read.title or source.stem,
        read.notes,
        read_text(source),
        case,
        settings,
        parameters,
        read.sampling,
        read.outputs,
        read.limits.time,
        read.limits.failures,
        read.arrays,
        targets,
        values,
    )
    _check_middle(source, plan)
    return plan


def _targets(source: Path, data: str) -> tuple[Target, ...]:
    if not data:
        return ()

    return read_targets(source.parent / data)


def _check_middle(source: Path, plan: StudyPlan) -> None:
    """A key that the case does not have fails here, once, and not in every run."""
    try:
        load_case(plan.case, plan.settings_at(tuple(middle(p.law) for p in plan.parameters)))
        if plan.sampling is not None:
            check_sampling(plan.sampling.kind, plan.sampling.n)
    except InputError as error:
        raise InputError(f"{source}: with every parameter in its middle: {error}") from None


def _settings(
    parameters: tuple[Parameter, ...], point: Point, base: Mapping[str, Any]
) -> Iterator[str]:
    for p, value in zip(parameters, point, strict=True):
        written = _number(value, p.unit) if type(value) is float else _word(value)
        yield from (text.replace("{value}", written) for text in p.settings)
        for key in p.scale:
            yield from scale_setting(base, key, float(value))


def _number(value: float, unit: str) -> str:
    """A number as a case states it; a whole one without a unit may be a count."""
    if unit:
        return f"{value!r} {unit}"
    return str(int(value)) if value.is_integer() else repr(value)


def _word(value: Word) -> str:
    return str(value) if isinstance(value, str) else json.dumps(value)


def scale_setting(base: Mapping[str, Any], key: str, factor: float) -> Iterator[str]:
    """KEY=VALUE with what `base` has at the key (a `*` stands for every name) times the factor.

    Raises InputError where no number is there."""
    numbers = list(_find_values(base, key.split("."), ()))
    if not numbers:
        raise InputError(f"scale: the case has no number at {key}")
    for path, value in numbers:
        yield f"{'.'.join(path)}={_times(value, factor, key)}"


def _find_values(
    values: Any, keys: list[str], path: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], Any]]:
    """What lies at the keys, with where."""
    if not keys:
        yield path, values
        return
    names = list(values) if isinstance(values, dict) and keys[0] == "*" else [keys[0]]
    for name in names:
        if isinstance(values, dict) and name in values:
            yield from _find_values(values[name], keys[1:], (*path, name))


def _times(value: Any, factor: float, key: str) -> str:
    """The value as TOML: a number, a text with a unit, or a list of such."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(_times(item, factor, key) for item in value)}]"
    if is_number(value):
        return repr(value * factor)
    if isinstance(value, str) and (parts := FORM.fullmatch(value)):
        return json.dumps(f"{float(parts[1]) * factor!r} {parts[2] or ''}".rstrip())
    raise InputError(f"scale: {key} is {value!r}, which is no number")
