"""How far the compared numbers change with the mesh: the same trials on coarser and finer ones.

Each trial runs on meshes of its own hood's family (`cosim.analyses.mesh_series`), whose rows and
columns are whole multiples of the coarsest mesh's: the case's own, one finer and one coarser.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from cosim.analyses.mesh_series import (
    VERDICTS,
    MeshSeries,
    bound,
    mesh_factors,
    mesh_family,
    on_mesh,
    vector_sizes,
)
from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.results.compare import Comparison
from cosim.validation.records import six_digits
from cosim.validation.run import Board
from cosim.validation.trial import Trial, TrialGroup
from cosim.validation.versions import Key, Version, key_of, values_of_boards

USUAL = 2
"""Fineness of the mesh of a row that is of no one trial with a generated hood."""


def mesh_versions(count: int, settings: Sequence[str] = ()) -> dict[str, Version]:
    """The trials with `settings` on each of so many meshes but their own, the coarsest first, by
    the number of the mesh; a hood that is not generated keeps its mesh."""

    def on_other(place: int) -> Version:
        def version(trial: Trial) -> Case:
            case = load_case(trial.case, (*trial.settings, *settings))
            own = case.hood.mesh_fineness
            if own is None:
                return case
            others = [fineness for fineness in mesh_family(count, own) if fineness != own]
            return on_mesh(case, others[place])

        return version

    return {str(place + 1): on_other(place) for place in range(count - 1)}


def finenesses(groups: Sequence[TrialGroup], settings: Sequence[str] = ()) -> dict[str, int]:
    """The fineness of each trial's own mesh, by its name, of those that have one."""
    trials = [t for g in groups for t in g.trials if not (t.study or t.published)]
    own = {t.name: load_case(t.case, (*t.settings, *settings)).hood.mesh_fineness for t in trials}
    return {name: fineness for name, fineness in own.items() if fineness is not None}


def mesh_series(
    boards: Sequence[Board],
    versions: Mapping[str, Sequence[Board]],
    own: Mapping[str, int] | None = None,
) -> dict[Key, MeshSeries]:
    """The series of every number, by the boards on the other meshes and the fineness of each
    trial's own; of a number that the mesh does not touch it is a constant."""
    others = [values_of_boards(versions[name]) for name in sorted(versions)]
    series: dict[Key, MeshSeries] = {}
    for board in boards:
        sizes = vector_sizes({_path(r): r.model for r in board.rows if r.model is not None})
        for row in board.rows:
            key = key_of(board.group, row)
            elsewhere = [values[key] for values in others if key in values]
            if row.model is None or len(elsewhere) < len(others):
                continue
            factors = mesh_factors(1 + len(others), (own or {}).get(row.target.case, USUAL))
            place = factors.index(1.0)
            on_each = (*elsewhere[:place], row.model, *elsewhere[place:])
            most = bound(_path(row), row.model, row.target.unit, sizes)
            series[key] = MeshSeries(factors=factors, values=on_each, bound=most)
    return series


def _path(row: Comparison) -> str:
    """The path of a row's quantity behind its case."""
    return f"{row.target.case}.{row.target.quantity}"


def distinct(series: Mapping[Key, MeshSeries]) -> Iterator[tuple[Key, MeshSeries]]:
    """Each number that the mesh touches once, whatever the references beside it; those that
    neither stay within their bound nor converge first."""
    once: dict[tuple[str, str, str, float | None], tuple[Key, MeshSeries]] = {}
    for key, s in series.items():
        if len(set(map(six_digits, s.values))) > 1:
            once.setdefault((key[0], key[1], key[3], s.own), (key, s))
    yield from sorted(once.values(), key=lambda item: VERDICTS.index(item[1].verdict))


def tally(series: Mapping[Key, MeshSeries]) -> dict[str, int]:
    """How many numbers of each verdict."""
    verdicts = [s.verdict for _, s in distinct(series)]
    return {v: verdicts.count(v) for v in VERDICTS}
