"""Repairs of an injury beside each other: the intact finger, the injured one, and each repair."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import Field, ValidationError, model_validator

from cosim.analyses.lesion import TIPS, Tip, both_sides, one_side
from cosim.case.faults import describe, listing
from cosim.case.schema import Case
from cosim.errors import InputError, first_twice
from cosim.pipeline import Outcome, plain_summary, run_each
from cosim.port import Array
from cosim.results.compare import value_of
from cosim.results.result import Result
from cosim.results.table import Cell, ReportTable
from cosim.schema.fields import check_texts
from cosim.schema.types import Table
from cosim.text_tables import find_file, read_toml

INTACT, INJURED = "intact", "injured"
MOST_WAYS = 60
"""The most conditions that repairs are compared in."""
NAME = r"^[a-z][a-z0-9_]{0,40}$"


class Measure(NamedTuple):
    """A number by which repairs are compared."""

    words: str
    unit: str
    tip: Tip
    """The fingertip of the run that has it."""
    path: str
    """In the summary."""


MEASURES: Mapping[str, Measure] = {
    "pip_lag": Measure("PIP, fingertip free", "deg", "free", "posture_deg.PIP"),
    "dip_droop": Measure("DIP, fingertip free", "deg", "free", "posture_deg.DIP"),
    "mcp_angle": Measure("MCP, fingertip free", "deg", "free", "posture_deg.MCP"),
    "tip_force": Measure("fingertip force, held", "N", "held", "fingertip_magnitude_N"),
    "tendon_shift": Measure("shift of the extensor tendon, held", "mm", "held", "tendon_shift_mm"),
    "strength": Measure("load of a repair over its strength, held", "%", "held", "strength"),
    "central_slip": Measure("central slip, held", "N", "held", "slip_force_N.central"),
    "terminal_slip": Measure("terminal slip, held", "N", "held", "slip_force_N.terminal"),
}
"""What a file of repairs may rank by: how far a number is from the intact finger's."""
JOINED, TIED = "repair_force_N", "tie_force_N"
"""What bears in the hood, with the fingertip held, and between bones, which a held joint spares."""


class RepairConfig(Table):
    """A repair."""

    name: Annotated[str, Field(pattern=NAME)]
    """What its runs are called."""
    title: str = ""
    """In words."""
    change: dict[str, Any]
    """What it changes of the injured case, as a case file states it: lesion, hood, finger,
    tendons."""


class InjuryConfig(Table):
    """What makes the case the injured finger where that is no lesion of its hood: muscles that are
    lost, a joint that is stiff or lax.  The case as it stands is the intact one then."""

    title: str = ""
    """In words."""
    change: dict[str, Any]
    """What it changes of the case, as a case file states it."""


class ConditionConfig(Table):
    """What differs between patients and days, and no surgeon chooses."""

    key: str
    """A key of the case, as tendons.EDC.tension."""
    values: Annotated[tuple[str | float, ...], Field(min_length=2)]
    """The values that it takes, each with each of the other conditions."""


class RepairsFile(Table):
    """Repairs to compare."""

    title: str = ""
    """The question in words."""
    rank: str = "pip_lag"
    """By which number they are ranked: the nearest to the intact finger's is the first."""
    injury: InjuryConfig | None = None
    """The injury, of a case whose lesion is not all of it."""
    repair: Annotated[tuple[RepairConfig, ...], Field(min_length=1)]
    """The repairs."""
    condition: tuple[ConditionConfig, ...] = ()
    """The ranges over which they are compared."""

    @model_validator(mode="before")
    @classmethod
    def _can_be_written(cls, values: Any) -> Any:
        check_texts(values)
        return values


def read_repairs(path_or_name: Path) -> RepairsFile:
    """Read a file of repairs, or the packaged one of that name.  Raises InputError that lists every
    fault."""
    path = find_file(path_or_name, "repairs", "repairs")
    values = read_toml(path)
    try:
        found = RepairsFile.model_validate(values)
    except ValidationError as error:
        faults, count = describe(error, RepairsFile, values, [(str(path), values)])
        raise InputError(listing(str(path), [*map(str, faults)], count)) from None
    names = [repair.name for repair in found.repair]
    if twice := first_twice([INTACT, INJURED, *names]):
        raise InputError(f"{path}: repair.name: {twice} stands for another one already")
    if found.rank not in MEASURES:
        raise InputError(f'{path}: rank = "{found.rank}": write one of {", ".join(MEASURES)}')
    ways = int(np.prod([len(c.values) for c in found.condition], initial=1))
    if ways > MOST_WAYS:
        raise InputError(f"{path}: {ways} conditions; at most {MOST_WAYS} are compared")
    return found


@dataclass(frozen=True)
class Compared:
    """A finger in all conditions."""

    name: str
    title: str
    values: Mapping[str, Array]
    """By measure (nw,), not a number where there was no answer."""
    load: Array
    """(nw,) N that the suture or graft which bears most bears with the fingertip held."""
    failure: str = ""
    """Why the first of its runs that failed did; empty where none did."""

    def off(self, measure: str, intact: Compared) -> float:
        """How far the number is from the intact finger's, the mean over the conditions."""
        gap = np.abs(self.values[measure] - intact.values[measure])
        return float(gap.mean()) if np.isfinite(gap).all() else np.inf


@dataclass(frozen=True)
class RepairTable:
    """Repairs of a case, ranked."""

    title: str
    rank: str
    intact: Compared
    injured: Compared
    repairs: tuple[Compared, ...]
    """The nearest to the intact finger first."""
    conditions: tuple[str, ...]
    """Each in words; empty where there is one."""

    @property
    def rows(self) -> tuple[Compared, ...]:
        """All, the intact one first."""
        return (self.intact, self.injured, *self.repairs)


def compare_repairs(
    case: Case,
    file: RepairsFile,
    folder: Path,
    workers: int = 1,
    ended: Callable[[int, int], object] = lambda done, of: None,
) -> RepairTable:
    """Solve a case without its injury (the file's, or its own lesion), with it and with each
    repair, fingertip free and held, in every condition; the runs lie in `folder`.

    Raises InputError for a case without an injury and a condition that it does not have, and where
    the intact or the injured finger has none of the numbers that are ranked; ConvergenceError where
    it has none since it was not solved."""
    if file.injury is None:
        both_sides(case)
    ways = _ways(file)
    made: dict[tuple[str, int, Tip], Case | Callable[[], Case]] = {}
    for k, way in enumerate(ways):
        at = case.with_layers([("condition", layer) for layer in way])
        hurt = at if file.injury is None else at.with_layers([("injury", file.injury.change)])
        for tip in TIPS:
            made[INTACT, k, tip] = _named(one_side(at, tip, "before"), case, INTACT, k, tip)
            made[INJURED, k, tip] = _named(one_side(hurt, tip, "after"), case, INJURED, k, tip)
            for repair in file.repair:
                made[repair.name, k, tip] = partial(_repaired, hurt, case, repair, k, tip)
    outcomes = run_each(
        [*made.values()],
        partial(_keep, folder=folder),
        workers,
        lambda done, i, outcome: ended(done, len(made)),
    )
    found = dict(zip(made, outcomes, strict=True))
    words_of_it = file.injury.title if file.injury else ""
    titles = {INTACT: "without the injury", INJURED: words_of_it or case.title}
    titles |= {repair.name: repair.title or repair.name for repair in file.repair}
    rows = {name: _compared(name, title, found, len(ways)) for name, title in titles.items()}
    for name in (INTACT, INJURED):
        if not np.isfinite(rows[name].values[file.rank]).all():
            failed = [o.error for (of, *_), o in found.items() if of == name and o.error]
            error = type(failed[0]) if failed else InputError
            raise error(f"{case.name}: the {name} finger has no answer: {rows[name].failure}")
    intact, injured, *repairs = rows.values()
    repairs.sort(key=lambda row: row.off(file.rank, intact))
    words = (
        tuple(
            ", ".join(f"{c} = {v}" for c, v in zip(_keys(file), w, strict=True))
            for w in _values(file)
        )
        if file.condition
        else ()
    )
    return RepairTable(file.title or case.title, file.rank, intact, injured, tuple(repairs), words)


def _keys(file: RepairsFile) -> list[str]:
    return [condition.key for condition in file.condition]


def _values(file: RepairsFile) -> list[tuple[str | float, ...]]:
    return [*product(*(condition.values for condition in file.condition))]


def _ways(file: RepairsFile) -> list[list[dict[str, Any]]]:
    """The layers of each condition."""
    return [
        [_nested(key, value) for key, value in zip(_keys(file), values, strict=True)]
        for values in _values(file)
    ]


def _nested(key: str, value: Any) -> dict[str, Any]:
    *above, last = key.split(".")
    out = {last: value}
    for part in reversed(above):
        out = {part: out}
    return out


def _named(made: Case, case: Case, variant: str, k: int, tip: Tip) -> Case:
    name = f"{case.name}_{variant}_{tip}" + (f"_{k + 1}" if k else "")
    return made.model_copy(update={"name": name, "title": f"{case.title}: {variant}, {tip}"})


def _repaired(injured: Case, case: Case, repair: RepairConfig, k: int, tip: Tip) -> Case:
    """A repaired case.  Raises InputError where it cannot be made."""
    changed = injured.with_layers([(f"repair {repair.name}", repair.change)])
    return _named(one_side(changed, tip, "after"), case, repair.name, k, tip)


def _keep(result: Result, folder: Path) -> Mapping[str, Any]:
    result.save(folder)
    return plain_summary(result)


def _compared(
    name: str,
    title: str,
    found: Mapping[tuple[str, int, Tip], Outcome[Mapping[str, Any]]],
    ways: int,
) -> Compared:
    failure = next(
        (
            str(o.error).splitlines()[-1].strip()
            for (n, *_), o in found.items()
            if n == name and o.error is not None
        ),
        "",
    )

    def numbers(tip: Tip, read: Callable[[Mapping[str, Any]], float | None]) -> Array:
        each = [found[name, k, tip].value for k in range(ways)]
        values = [None if summary is None else read(summary) for summary in each]
        return np.array([np.nan if value is None else value for value in values], dtype=float)

    values = {
        key: numbers(m.tip, partial(value_of, quantity=m.path)) for key, m in MEASURES.items()
    }
    values["strength"] = numbers("held", _share_of_strength)
    joined = numbers("held", lambda s: max(s.get(JOINED, {}).values(), default=None))
    tied = numbers("free", lambda s: max(s.get(TIED, {}).values(), default=None))
    load = np.fmax(joined, tied)
    return Compared(name, title, values, load, failure)


def _share_of_strength(summary: Mapping[str, Any]) -> float | None:
    """The largest share (%) of its strength that a part bears; 0 where nothing was joined, None
    where what was joined has no strength stated."""
    shares = [100 * part["share"] for part in summary.get("strength", {}).values()]
    return max(shares, default=None if summary.get(JOINED) or summary.get(TIED) else 0.0)


def table_of_repairs(found: RepairTable) -> ReportTable:
    """A row for each finger: its rank, every number with its spread over the conditions, how far
    each is from the intact finger's, and what the repair bears."""
    columns = ["finger", "rank"]
    for m in MEASURES.values():
        columns += [f"{m.words}, {m.unit}", "less intact"]
    columns += ["repair bears, N", "remark"]
    rows: list[Sequence[Cell]] = []
    for i, row in enumerate(found.rows):
        ranked = i > 1 and np.isfinite(row.off(found.rank, found.intact))
        cells: list[Cell] = [row.title, f"{i - 1}" if ranked else ""]
        for key in MEASURES:
            cells.append(_spread(row.values[key]))
            cells.append(_spread(row.values[key] - found.intact.values[key]) if i else "")
        rows.append([*cells, _spread(row.load), row.failure])
    return ReportTable("repairs", found.title, columns, rows)


def _spread(values: Array) -> Cell:
    """The one value, or the least and the largest."""
    if not np.isfinite(values).any():
        return ""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    return low if low == high else f"{low:.3g} to {high:.3g}"
