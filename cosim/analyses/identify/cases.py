"""The cases of a fit, and the rows of each.

The cases are named, or one case in many postures: a table `[cases.NAME]` for each in the file of
parameters, with `set`, a list of KEY=VALUE as --set takes them, and `from`, the case that it is
made of (a path beside the file, or a packaged case) where that is not the one named.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cosim.analyses.identify.parameters import (
    CASES,
    Free,
    fit_tables,
    free_built_in,
    raise_faults,
    read_free,
)
from cosim.case.file import Settings, find_case, load_case
from cosim.case.schema import Case
from cosim.errors import InputError
from cosim.results.compare import Target, unit_of


@dataclass(frozen=True)
class StatedCase:
    """A case of a fit as it is stated: a file, and settings on top of it."""

    name: str
    """What rows call it: the file's stem, or the table's name."""
    source: Path
    settings: Settings

    def load(self) -> Case:
        """Load the case.  Raises InputError, naming the case where its name is not the file's."""
        try:
            return load_case(self.source, self.settings)
        except InputError as error:
            is_stem = self.name == self.source.stem
            raise InputError(str(error) if is_stem else f"{CASES}.{self.name}: {error}") from None


@dataclass(frozen=True)
class FitCase:
    """A case of a fit with what is free in it, the rows that it is fitted to and those held out, of
    which every one names it."""

    stated: StatedCase
    free: Free
    rows: tuple[Target, ...]
    held_out: tuple[Target, ...] = ()

    @property
    def name(self) -> str:
        """The name under which the case is stated."""
        return self.stated.name


def stated_cases(
    names: Sequence[str | Path], settings: Settings, path: Path | None
) -> tuple[StatedCase, ...]:
    """The cases named, or those of the tables in the file at `path`, each with `settings`.

    Raises InputError with every fault, each with its place."""
    tables = fit_tables(path).get(CASES, {}) if path is not None else {}
    if tables:
        if len(names) > 1:
            raise InputError(
                f"{path}: with tables [{CASES}.NAME] expected one CASE, their base, not "
                f"{', '.join(map(str, names))}; a table states another base with `from`"
            )
        return _cases_of_tables(Path(str(path)), tables, find_case(names[0]), settings)
    cases = tuple(StatedCase(s.stem, s, settings) for s in map(find_case, names))
    twice = sorted({c.name for i, c in enumerate(cases) if c.name in [d.name for d in cases[:i]]})
    if twice:
        raise InputError(
            f"more than one case is called {', '.join(twice)}; rows could not say which"
        )
    return cases


def _cases_of_tables(
    path: Path, tables: dict[str, Any], base: Path, settings: Settings
) -> tuple[StatedCase, ...]:
    cases, faults = [], []
    for name, table in tables.items():
        try:
            cases.append(_read_table(f"{path}: {CASES}.{name}", name, table, path, base, settings))
        except InputError as error:
            faults.append(str(error))
    raise_faults(faults)
    return tuple(cases)


def _read_table(
    place: str, name: str, table: Any, path: Path, base: Path, settings: Settings
) -> StatedCase:
    if not isinstance(table, dict) or set(table) - {"from", "set"}:
        raise InputError(
            f"{place}: expected a table of `set` and, if wanted, `from`, for example "
            "set = ['finger.posture.PIP=45 deg']"
        )
    texts, source = table.get("set", []), base
    if not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
        raise InputError(f"{place}: set = {texts!r}: expected a list of texts KEY=VALUE")
    if "from" in table:
        try:
            source = find_case(str(table["from"]), path.resolve().parent)
        except InputError as error:
            raise InputError(f"{place}: from: {error}") from None
    return StatedCase(name, source, (*settings, *texts))


def fit_cases(
    stated: Sequence[StatedCase],
    path: Path | None,
    targets: Sequence[Target],
    held_out: Sequence[Target] = (),
) -> tuple[FitCase, ...]:
    """Each case with its parameters, those of the file at `path` or the built-in ones, and its
    rows; targets that their file marks as held out are.

    Raises InputError with every fault: of the cases, of parameters that a case does not take, of
    rows."""
    held_out = (*held_out, *(t for t in targets if t.held_out))
    targets = [t for t in targets if not t.held_out]
    faults: list[str] = []
    frees = [free for case in stated for free in _free_parameters(case, path, faults)]
    if len(frees) == len(stated):
        faults += _faults_of_parameters(stated, frees)
    faults += _faults_of_rows([c.name for c in stated], targets, held_out)
    raise_faults(faults)
    return assign_rows(stated, frees, targets, held_out)


def _free_parameters(case: StatedCase, path: Path | None, faults: list[str]) -> Iterator[Free]:
    try:
        loaded = case.load()
        yield free_built_in(loaded) if path is None else read_free(path, loaded)
    except InputError as error:
        faults.append(str(error))


def _faults_of_parameters(stated: Sequence[StatedCase], frees: Sequence[Free]) -> Iterator[str]:
    """Say which names differ from case to case, and which values a case does not take: all at their
    starts, and, in one case of each file, each at its bounds."""
    names = [[p.name for p in free.parameters] for free in frees]
    for case, parameters in zip(stated, names, strict=True):
        if parameters != names[0]:
            yield (
                f"{case.name}: its laws have the parameters {', '.join(parameters)}, those of "
                f"{stated[0].name} {', '.join(names[0])}; name those to fit in a file"
            )
    if any(parameters != names[0] for parameters in names):
        return
    start = {p.name: p.start for p in frees[0].parameters}
    ends = [{**start, p.name: v} for p in frees[0].parameters for v in (p.low, p.high)]
    sources: set[Path] = set()
    for case, free in zip(stated, frees, strict=True):
        for values in (start, *([] if case.source in sources else ends)):
            try:
                replace(case, settings=(*case.settings, *free.settings(values))).load()
            except InputError as error:
                yield str(error)
        sources.add(case.source)


def _faults_of_rows(
    names: Sequence[str], targets: Sequence[Target], held_out: Sequence[Target]
) -> Iterator[str]:
    every = (*targets, *held_out)
    for t in every if len(names) > 1 else ():
        if t.case not in ("", *names):
            yield f"{t.name}: there is no case {t.case}; there are {', '.join(names)}"
    for name in names:
        if not any(t.case in ("", name) for t in targets):
            yield f"no target is for the case {name}"
    for t in every:
        if t.case in ("", *names) and t.unit != (unit := unit_of(t.quantity)):
            yield f"{t.name}: {t.quantity} is in {unit}, the row in {t.unit}"


def assign_rows(
    stated: Sequence[StatedCase],
    frees: Sequence[Free],
    targets: Sequence[Target],
    held_out: Sequence[Target] = (),
) -> tuple[FitCase, ...]:
    """The cases with their rows.  Raises InputError."""
    raise_faults(_faults_of_rows([c.name for c in stated], targets, held_out))

    def rows(case: StatedCase, of: Sequence[Target]) -> tuple[Target, ...]:
        return tuple(replace(t, case=case.name) for t in of if t.case in ("", case.name))

    return tuple(
        FitCase(case, free, rows(case, targets), rows(case, held_out))
        for case, free in zip(stated, frees, strict=True)
    )
