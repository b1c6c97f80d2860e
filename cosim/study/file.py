"""The study file: how it is read and checked, with every fault at once."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from math import inf, isfinite, prod
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, get_args

from pydantic import BaseModel, Field, PlainValidator, ValidationError, WithJsonSchema
from pydantic_core import PydanticCustomError

from cosim.case.faults import at, listing, unknown, value_text
from cosim.errors import InputError
from cosim.schema import units
from cosim.schema.fields import check_texts, fault, is_number, quantity
from cosim.schema.json_schema import choose, editor_schema, has
from cosim.schema.types import Count, Switch, Table
from cosim.study.distributions import (
    GridAxis,
    Law,
    Lognormal,
    Normal,
    TruncatedNormal,
    Uniform,
    axis,
    is_axis,
)
from cosim.study.sampling import KINDS, SCHEMES, Kind, count_points
from cosim.text_tables import packaged_files, read_toml

MOST_AXES = 4
"""That a message names."""
MOST_RUNS = 2_000_000
"""Runs of the largest study, whose plan takes some GB of memory."""
OVER = "tendons.EDC.tension=2 N, 4 N, 6 N"
FORM = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*?)?\s*")


class Measure(NamedTuple):
    """A number with the unit that it is stated in, as it goes into the case."""

    number: float
    unit: str


def _measure(value: Any) -> Measure:
    if is_number(value):
        measure = Measure(_float(value), "")
    elif isinstance(value, str) and (parts := FORM.fullmatch(value)):
        measure = Measure(float(parts[1]), parts[2] or "")
    else:
        raise fault('is no number; write one, with its unit where the case has one: "100 MPa"')
    if not isfinite(measure.number):
        raise fault("is not finite")
    return measure


def _float(value: float) -> float:
    try:
        return float(value)
    except OverflowError:
        raise fault("is not finite") from None


def _step(value: Any) -> Measure | str | bool:
    """A value of a list: a number with its unit, or a word of the case."""
    if isinstance(value, bool):
        return value
    if isinstance(value, str) and not FORM.fullmatch(value):
        return value
    return _measure(value)


_NUMBER = {"anyOf": [{"type": "number"}, {"type": "string", "pattern": f"^{FORM.pattern}$"}]}
Stated = Annotated[Any, PlainValidator(_measure), WithJsonSchema(_NUMBER)]
Step = Annotated[
    Any, PlainValidator(_step), WithJsonSchema({"type": ["number", "string", "boolean"]})
]
Texts = tuple[str, ...]


class ParameterConfig(Table):
    """What every parameter may say: the `settings` that it makes (KEY={value}), or the keys whose
    numbers in the case it scales or shifts; without any, its name is the key."""

    settings: Texts = ()
    """What it sets in the case, as KEY={value}; by default its own name is the key."""
    scale: Texts = ()
    """Keys whose numbers in the case it multiplies, in place of `settings`."""
    shift: Texts = ()
    """Keys to whose numbers in the case it is added, in place of `settings`, in their unit."""
    least: Stated | None = None
    """The least that a number becomes which is shifted."""
    label: str = ""
    """Its name in plots; by default its key."""


class NormalConfig(ParameterConfig):
    """Normal or lognormal."""

    distribution: Literal["normal", "lognormal"]
    """The distribution that it follows."""
    mean: Stated
    """Mean, with its unit."""
    sd: Stated
    """Standard deviation, with its unit."""


class TruncatedNormalConfig(ParameterConfig):
    """Normal between two bounds."""

    distribution: Literal["truncated_normal"]
    """The distribution that it follows."""
    mean: Stated
    """Mean before truncation, with its unit."""
    sd: Stated
    """Standard deviation before truncation, with its unit."""
    low: Stated
    """Lower bound, with its unit."""
    high: Stated
    """Upper bound, with its unit."""


class UniformConfig(ParameterConfig):
    """Uniform between two bounds."""

    distribution: Literal["uniform"]
    """The distribution that it follows."""
    low: Stated
    """Lower bound, with its unit."""
    high: Stated
    """Upper bound, with its unit."""


class ListConfig(ParameterConfig):
    """Values one after the other."""

    values: Annotated[tuple[Step, ...], Field(min_length=1)]
    """Values one after the other: numbers with their unit, words or truth values."""


class RangeConfig(ParameterConfig):
    """Values in equal steps or ratios."""

    first: Annotated[Stated, Field(alias="from")]
    """First value, with its unit."""
    last: Annotated[Stated, Field(alias="to")]
    """Last value, with its unit."""
    count: Annotated[Count, Field(ge=2, le=100_000)]
    """Values, both ends included."""
    spacing: Literal["linear", "log"] = "linear"
    """Equal steps, or equal ratios."""


_DISTRIBUTIONS: dict[str, type[ParameterConfig]] = {
    "normal": NormalConfig,
    "truncated_normal": TruncatedNormalConfig,
    "lognormal": NormalConfig,
    "uniform": UniformConfig,
}


class SamplingConfig(Table):
    """How distributions are sampled; `n`: points, of Saltelli's scheme base points, of Morris'
    trajectories."""

    kind: Kind
    """The scheme that places the points."""
    n: Annotated[Count, Field(ge=2, le=2**22)]
    """Points; of Saltelli's scheme base points, of Morris' trajectories."""
    seed: Annotated[Count, Field(ge=0, le=2**32 - 1)]
    """Seed of the random numbers; the same seed gives the same points."""
    second_order: Switch = False
    """Saltelli's scheme with indices of second order."""


class StudyLimitsConfig(Table):
    """Seconds for a run, failed runs after which no other is begun, and runs in all."""

    time: Annotated[float, quantity(units.TIME, above="0 s", most="1e6 s")] | None = None
    """Longest time of a run; without it a run has no limit."""
    failures: Annotated[Count, Field(ge=1)] | None = None
    """Failed runs after which no other is begun; without it none stops the study."""
    runs: Annotated[Count, Field(ge=1, le=MOST_RUNS)] = 100_000
    """Runs that the study may have; one of more is refused before any is planned."""


class StudyFile(Table):
    """A study as its file states it; `parameters` are read one by one."""

    title: str = ""
    """The study in one line."""
    notes: str = ""
    """What else a reader needs to know; it changes no number."""
    case: str
    """Name of a packaged case, or the path of a case file relative to this one."""
    settings: Texts = ()
    """Values of every run, as KEY=VALUE."""
    parameters: Annotated[dict[str, dict[str, Any]], Field(min_length=1)]
    """What differs from run to run, by a name of your own or the key of the case."""
    sampling: SamplingConfig | None = None
    """How distributions are sampled; without one there are none."""
    outputs: Annotated[dict[str, str], Field(min_length=1)]
    """Numbers of the table: a name of your own, and the key of summary.json."""
    limits: StudyLimitsConfig = StudyLimitsConfig()
    """When a run or the study is ended."""
    arrays: Switch | Texts = False
    """Keep the arrays of every run: all, or those named."""
    data: str = ""
    """A CSV file of measured values to show beside, or another study's bands.csv, relative to this
    file."""
    bands: Switch = False
    """Percentiles of the first numbers of any case beside the case as it is, over the samples or,
    where nothing is sampled, over the values of lists: what a case lacks of the parameters and
    outputs is left out."""


def study_schema() -> dict[str, Any]:
    """JSON Schema of a study file, for editors."""
    schema = editor_schema(StudyFile)
    by_word = Annotated[
        NormalConfig | TruncatedNormalConfig | UniformConfig, Field(discriminator="distribution")
    ]
    defs = schema.setdefault("$defs", {})
    for form in (ListConfig, RangeConfig, by_word):
        form_schema = editor_schema(form)
        del form_schema["$schema"]
        defs |= form_schema.pop("$defs", {})
        defs[form_schema.get("title", "DistributionConfig")] = form_schema
    names = ("DistributionConfig", "ListConfig", "RangeConfig")
    distribution, values, bounds = [{"$ref": f"#/$defs/{name}"} for name in names]
    tests = [(has("distribution"), distribution), (has("values"), values)]
    neither = {"not": {"anyOf": [test for test, _ in tests]}}
    schema["properties"]["parameters"]["additionalProperties"] = choose(
        [*tests, (neither, bounds)], [distribution, values, bounds]
    )
    return schema


def over_parameter(text: str) -> Parameter:
    """The values of a case's key to pass over, from KEY=VALUE, VALUE, ...  Raises InputError."""
    key, _, stated = (part.strip() for part in text.partition("="))
    values = [value.strip() for value in stated.split(",") if value.strip()]
    if not key or len(values) < 2:
        raise InputError(f'--over {text!r}: write KEY=VALUE, VALUE, ..., as "{OVER}"')
    try:
        found = _parameter(key, {"values": values})
    except (ValidationError, InputError) as error:
        raise InputError(f"--over {text!r}: {error}") from None
    if not (is_axis(found.law) and found.law.is_numeric):
        raise InputError(f'--over {text!r}: a curve is over numbers, as "{OVER}"')
    return found


class Parameter(NamedTuple):
    """A number or word that differs from run to run; `unit` as the case takes it; `settings`,
    `scale`, `shift` and `least` as in the file."""

    name: str
    label: str
    unit: str
    law: Law
    settings: Texts
    scale: Texts
    shift: Texts = ()
    least: float = -inf


def is_study(path_or_name: str) -> bool:
    """Whether a name is that of a packaged study, or a file states parameters of one."""
    if path_or_name in {path.stem for path in packaged_files("studies")}:
        return True
    try:
        table = read_toml(Path(path_or_name))
    except (InputError, ValueError):  # what is wrong with it is said of a case
        return False
    return "parameters" in table


def read_file(source: Path) -> tuple[StudyFile, tuple[Parameter, ...]]:
    """Read and check a study file.  Raises InputError that lists every fault."""
    values = read_toml(source)
    lines: list[str] = []
    checked = None
    try:
        check_texts(values)
        checked = StudyFile.model_validate(values)
    except PydanticCustomError as error:
        lines.append(error.message().removeprefix(": "))
    except ValidationError as error:
        lines += faults_of(error, values, (), StudyFile)
    except RecursionError:
        raise InputError(f"{source}: tables are nested too deeply") from None
    parameters: list[Parameter] = []
    tables = values.get("parameters")
    for name, table in tables.items() if isinstance(tables, dict) else ():
        if isinstance(table, dict):
            try:
                parameters.append(_parameter(name, table))
                if count_runs(None, parameters) > MOST_RUNS:
                    break  # no room for more
            except ValidationError as error:
                lines += faults_of(error, table, ("parameters", name), _model(table))
            except InputError as error:
                lines.append(f"{place_text(('parameters', name))}: {error}")
    if checked is not None:
        lines += _sampling_faults(checked, parameters)
        lines += size_faults(checked, checked.sampling, parameters)
    if lines or checked is None:
        raise InputError(listing(str(source), sorted(lines), len(lines)))
    return checked, tuple(parameters)


def _model(table: Mapping[str, Any]) -> type[ParameterConfig]:
    """The distribution that the keys state.  Raises InputError where they state none."""
    if "distribution" in table:
        word = table["distribution"]
        if not isinstance(word, str) or word not in _DISTRIBUTIONS:
            raise InputError(f"distribution = {word!r}: write {' or '.join(_DISTRIBUTIONS)}")
        return _DISTRIBUTIONS[word]
    if "values" in table:
        return ListConfig
    if {"from", "to", "count"} & set(table):
        return RangeConfig
    raise InputError(
        'write distribution = "normal" (or another), values = [...], or from, to and count'
    )


def _parameter(name: str, table: dict[str, Any]) -> Parameter:
    """Read a parameter from its table.  Raises ValidationError and InputError."""
    read = _model(table).model_validate(table)
    given = [word for word in ("settings", "scale", "shift") if getattr(read, word)]
    if len(given) > 1:
        raise InputError(f"gives both {given[0]} and {given[1]}; write one of them")
    if lacking := [text for text in read.settings if "={value}" not in text.replace(" ", "")]:
        raise InputError(f"settings: {lacking[0]!r} lacks ={{value}}; write KEY={{value}}")
    law, unit = _law(read)
    if read.scale and (unit or (is_axis(law) and not law.is_numeric)):
        raise InputError("scale: a factor is a plain number; leave out the unit")
    if read.shift and is_axis(law) and not law.is_numeric:
        raise InputError("shift: what is added is a number with its unit")
    if read.least is not None and not read.shift:
        raise InputError("least: is of shifted numbers; write shift = [...] or leave it out")
    settings = read.settings or (() if given else (f"{name}={{value}}",))
    least = -inf if read.least is None else read.least.number
    label = read.label or name
    return Parameter(name, label, unit, law, settings, read.scale, read.shift, least)


def _law(read: ParameterConfig) -> tuple[Law, str]:
    stated = [value for _, value in read if isinstance(value, Measure)]
    if isinstance(read, ListConfig):
        stated = [value for value in read.values if isinstance(value, Measure)]
    units_found = list(dict.fromkeys(m.unit for m in stated))
    if len(units_found) > 1:
        named = ", ".join(unit or "none" for unit in units_found)
        raise InputError(f"is stated in several units ({named}); write all in one")
    return _law_of(read), units_found[0] if units_found else ""


def _law_of(read: ParameterConfig) -> Law:
    match read:
        case NormalConfig(distribution="lognormal"):
            return Lognormal(read.mean.number, read.sd.number)
        case NormalConfig():
            return Normal(read.mean.number, read.sd.number)
        case TruncatedNormalConfig():
            return TruncatedNormal(
                read.mean.number, read.sd.number, read.low.number, read.high.number
            )
        case UniformConfig():
            return Uniform(read.low.number, read.high.number)
        case ListConfig():
            return GridAxis(tuple(v.number if isinstance(v, Measure) else v for v in read.values))
        case RangeConfig():
            return axis(read.first.number, read.last.number, read.count, read.spacing)
    raise AssertionError(read)


def count_runs(sampling: SamplingConfig | None, parameters: Sequence[Parameter]) -> int:
    """The runs of a study: every sample with all combinations of the axes' values."""
    steps = prod(len(p.law.values) for p in parameters if is_axis(p.law))
    if sampling is None:
        return steps
    drawn = sum(not is_axis(p.law) for p in parameters)
    return steps * count_points(sampling.kind, drawn, sampling.n, sampling.second_order)


def size_faults(
    study: StudyFile, sampling: SamplingConfig | None, parameters: Sequence[Parameter]
) -> Iterator[str]:
    """Say where a study of this sampling has more runs than it may."""
    runs, most = count_runs(sampling, parameters), study.limits.runs
    at_least = "at least " if len(parameters) < len(study.parameters) else ""
    if runs <= most:
        return
    axes = [f"{len(p.law.values)} values of {p.name}" for p in parameters if is_axis(p.law)]
    if sampling is not None and len(axes) < len(parameters):
        axes = [f"{sampling.kind} of n = {sampling.n}", *axes]
    more = f" and {len(axes) - MOST_AXES} more" if len(axes) > MOST_AXES else ""
    shown = " x ".join(axes[:MOST_AXES])
    advice = f"or write a larger limits.runs, at most {MOST_RUNS:,}"
    yield (
        f"the study has {at_least}{runs:,} runs ({shown}{more}), and limits.runs allows {most:,}; "
        f"take fewer values or a smaller n{f', {advice}' if runs <= MOST_RUNS else ''}"
    )


def _sampling_faults(study: StudyFile, parameters: list[Parameter]) -> Iterator[str]:
    """What goes together."""
    axes = [p.name for p in parameters if is_axis(p.law)]
    drawn = [p.name for p in parameters if not is_axis(p.law)]
    if drawn and study.sampling is None:
        kinds = ", ".join(KINDS)
        example = '{ kind = "latin_hypercube", n = 64, seed = 1 }'
        yield f"sampling: is missing; write {example} ({kinds})"
    if not drawn and parameters and study.sampling is not None:
        yield "sampling: no parameter has a distribution to sample; leave it out"
    if axes and study.sampling is not None and study.sampling.kind in SCHEMES:
        scheme = f"{study.sampling.kind}'s scheme"
        yield f"parameters: {scheme} samples all of them; {', '.join(axes)} has values"
    reserved = {"run", "status", "reason", "key"}
    both = {p.name for p in parameters} & set(study.outputs)
    for name in sorted(both | reserved & (set(study.outputs) | {p.name for p in parameters})):
        yield f"{name!r}: names a column twice; choose another name for the parameter or output"


def faults_of(
    error: ValidationError, values: Any, above: tuple[str, ...], model: type[BaseModel]
) -> Iterator[str]:
    """A line for each of a model's faults: the place below `above`, what stands there, what to
    write."""
    for item in error.errors(include_url=False, include_input=False):
        place = tuple(item["loc"])
        value = values
        for part in place:
            value = at(value, part)
        shown = value_text(value)
        where = place_text((*above, *place)) + (f" = {shown}" if shown else "")
        yield f"{where}: {_message(item, place, values, model)}"


def place_text(place: tuple[str | int, ...]) -> str:
    """A place as people write it."""
    parts = [
        str(p)[:60] if isinstance(p, int) or re.fullmatch(r"[\w-]+", p) else repr(p[:60])
        for p in place
    ]
    return ".".join(parts) or "the study"


def _message(item: Any, place: tuple[str | int, ...], values: Any, model: type[BaseModel]) -> str:
    kind, context = item["type"], item.get("ctx", {})
    if kind == "extra_forbidden":
        table, inside = _keys(model, place[:-1]), values
        for part in place[:-1]:
            inside = at(inside, part)
        return unknown("key", str(place[-1]), table, inside)
    if kind == "missing":
        return "is missing"
    if kind == "literal_error":
        return f"write {context['expected'].replace(', ', ' or ')}"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        return "must be a table"
    if kind == "too_short":
        return f"needs at least {context['min_length']}"
    return str(item["msg"]).replace("Input should", "must")


def _keys(model: type[BaseModel], place: tuple[str | int, ...]) -> tuple[str, ...]:
    """The keys of the table at a place, as files name them."""
    for part in (p for p in place if isinstance(p, str)):
        stated = model.model_fields[part].annotation
        tables = [t for t in (stated, *get_args(stated)) if isinstance(t, type)]
        model = next(t for t in tables if issubclass(t, BaseModel))
    return tuple(field.alias or name for name, field in model.model_fields.items())
