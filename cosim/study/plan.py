"""The plan of a study: what every run sets in the case, in an order that the file alone decides."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

from cosim.case.file import Settings, find_case, load_case
from cosim.case.schema import check_name
from cosim.errors import InputError
from cosim.port import Array
from cosim.results.compare import Target, read_targets
from cosim.schema.fields import is_number
from cosim.study.distributions import Word, is_axis, middle
from cosim.study.file import (
    FORM,
    Parameter,
    SamplingConfig,
    count_runs,
    over_parameter,
    read_file,
    size_faults,
)
from cosim.study.sampling import check_sampling, points, unit_points
from cosim.text_tables import find_file, read_text

Point = tuple[Word | None, ...]
"""A value for each parameter; None: as the case has it."""


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
    bands: bool = False
    """Whether the case is solved as it is too, to lie beside the percentiles of its numbers."""
    lacking: tuple[str, ...] = ()
    """Labels of the file's parameters that the case has nothing of, where there are bands."""

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
        """How many runs it has, without those of `as_it_is`."""
        return count_runs(self.sampling, self.parameters)

    @cached_property
    def as_it_is(self) -> list[Point]:
        """The points, None for what is sampled, of the case as it is, at every value of the axes;
        none without bands."""
        if not self.bands:
            return []
        steps: list[Point] = [
            p.law.values if is_axis(p.law) and p in self.axes else (None,) for p in self.parameters
        ]
        return [tuple(values) for values in product(*steps)]

    @property
    def axes(self) -> list[Parameter]:
        """Those that samples are taken over; none where nothing is sampled: each value of all is a
        sample then."""
        return [p for p in self.parameters if is_axis(p.law) and self.sampling is not None]

    @cached_property
    def points(self) -> list[Point]:
        """The points of all runs, in order."""
        return [*points(tuple(p.law for p in self.parameters), self.samples)]

    def settings_at(self, point: Point) -> Settings:
        """KEY=VALUE of a run.  Raises InputError for a key to scale that has no number."""
        return (*self.settings, *_settings(self.parameters, point, self.base))


def read_plan(
    path_or_name: str | Path,
    other: str | Path | None = None,
    own: Settings = (),
    samples: int | None = None,
    over: str | None = None,
) -> StudyPlan:
    """The study of a file or of a packaged name, of its case or of the `other`, a path from here or
    a packaged name, with settings of one's `own` on top of the file's, as many `samples` in place
    of the file's, and all of them at each value of a key of the case (`over_parameter`); checked
    with its case, at its settings and in the middle of every parameter.

    Raises InputError."""
    source = find_file(path_or_name, "studies", "study")
    check_name(source.stem)  # the folder of what it leaves
    read, parameters = read_file(source)
    sampling = read.sampling
    if samples is not None:
        if sampling is None:
            raise InputError(f"{source}: samples: no parameter has a distribution to sample")
        sampling = sampling.model_copy(update={"n": samples})
    if over is not None:
        parameters = (over_parameter(over), *parameters)  # first, since others shift its values
    if faults := list(size_faults(read, sampling, parameters)):
        raise InputError(f"{source}: {faults[0]}")
    try:
        case = find_case(other) if other else find_case(read.case, source.parent)
        settings = (*read.settings, *own)
        base = load_case(case, settings)
    except InputError as error:
        raise InputError(f"{source}: case: {error}") from None
    values = base.model_dump(mode="json", exclude={"name", "source"}, exclude_none=True)
    targets = _targets(source, read.data)
    lacking: tuple[str, ...] = ()
    if read.bands:
        there = [p if is_axis(p.law) else _there(p, values) for p in parameters]
        lacking = tuple(p.label for p in there if not _keys(p))
        parameters = tuple(p for p in there if _keys(p))
        if sampling is not None and not any(not is_axis(p.law) for p in parameters):
            raise InputError(f"{source}: {case.stem} has none of the inputs that it varies")
    plan = StudyPlan(
        source.stem,
        read.title or source.stem,
        read.notes,
        read_text(source),
        case,
        settings,
        parameters,
        sampling,
        read.outputs,
        read.limits.time,
        read.limits.failures,
        _arrays(read.arrays, read.bands and base.forward is not None),
        targets,
        values,
        read.bands,
        lacking,
    )
    _check_middle(source, plan)
    return plan


HISTORIES = ("angle", "tip_force", "hood_force")
"""The arrays of a motion of which bands over its time are made."""


def _arrays(asked: bool | tuple[str, ...], over_time: bool) -> bool | tuple[str, ...]:
    """The arrays that every run keeps."""
    if asked is True or not over_time:
        return asked
    return tuple(dict.fromkeys((*(asked or ()), *HISTORIES)))


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
    parameters: Sequence[Parameter], point: Point, base: Mapping[str, Any]
) -> Iterator[str]:
    """KEY=VALUE of a point; what scales or shifts a number takes it as the parameters before left
    it.  Raises InputError."""
    texts: dict[str, str] = {}
    changed: dict[str, Any] = {}
    for p, value in zip(parameters, point, strict=True):
        if value is None:  # as it is
            continue
        written = _number(value, p.unit) if type(value) is float else _word(value)
        for text in p.settings:
            key, _, stated = (part.strip() for part in text.partition("="))
            texts[key] = changed[key] = stated.replace("{value}", written)
        change, word = _change_of(p, value)
        for key in (*p.scale, *p.shift):
            for path, number in numbers_at(base, key, word):
                changed[path] = _changed(changed.get(path, number), change, f"{word}: {key}")
                texts[path] = _toml(changed[path])
    return (f"{key}={text}" for key, text in texts.items())


def applicable_settings(
    parameters: Sequence[Parameter], point: Point, base: Mapping[str, Any]
) -> Settings:
    """KEY=VALUE of a point in a case that lacks some of what the parameters change: these have no
    effect there.  Raises InputError for what is no number."""

    return tuple(_settings([_there(p, base) for p in parameters], point, base))


def _there(p: Parameter, base: Mapping[str, Any]) -> Parameter:
    """The parameter with the keys alone that the case has."""

    def has(key: str) -> bool:
        return key == "extends" or any(
            True for _ in _find_values(base, key.partition("=")[0].strip().split("."), ())
        )

    def kept(keys: Iterable[str]) -> tuple[str, ...]:
        return tuple(filter(has, keys))

    return p._replace(settings=kept(p.settings), scale=kept(p.scale), shift=kept(p.shift))


def _keys(p: Parameter) -> tuple[str, ...]:
    return (*p.settings, *p.scale, *p.shift)


def _number(value: float, unit: str) -> str:
    """A number as a case states it; a whole one without a unit may be a count."""
    if unit:
        return f"{value!r} {unit}"
    return str(int(value)) if value.is_integer() else repr(value)


def _word(value: Word) -> str:
    return str(value) if isinstance(value, str) else json.dumps(value)


def numbers_at(base: Mapping[str, Any], key: str, word: str) -> list[tuple[str, Any]]:
    """What `base` has at a key, with where; `word`: what it is asked for.  Raises InputError where
    nothing is there."""
    found = [(".".join(path), value) for path, value in _find_values(base, key.split("."), ())]
    if not found:
        raise InputError(f"{word}: the case has no number at {key}")
    return found


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


def _change_of(p: Parameter, value: Word) -> tuple[Callable[[float, str], float], str]:
    """What a parameter does to a number and its unit, and the word of the study file for it."""
    if p.scale:
        return lambda number, _: number * float(value), "scale"

    def moved(number: float, unit: str) -> float:
        if unit != p.unit:
            raise InputError(
                f"shift: {p.name} is in {p.unit or 'no unit'}, the case's number in "
                f"{unit or 'none'}; write the step in the case's"
            )
        return max(number + float(value), p.least)

    return moved, "shift"


def _changed(value: Any, change: Callable[[float, str], float], what: str) -> Any:
    """The changed number, text with a unit, or list of such.  Raises InputError."""
    if isinstance(value, list | tuple):
        return [_changed(item, change, what) for item in value]
    if is_number(value):
        return change(value, "")
    if isinstance(value, str) and (parts := FORM.fullmatch(value)):
        unit = parts[2] or ""
        return f"{change(float(parts[1]), unit)!r} {unit}".rstrip()
    raise InputError(f"{what} is {value!r}, which is no number")


def _toml(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    return json.dumps(value) if isinstance(value, str) else repr(value)
