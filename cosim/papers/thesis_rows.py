"""The thesis row by row: what it prints, what is ours, and whether ours is the same."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import TYPE_CHECKING, Literal, cast, get_args

import numpy as np
import pandas as pd

from cosim.papers.thesis_models import Numbers
from cosim.report.figures import Figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Sheet

Relation = Literal["input", "number", "at_most", "between", "other", "text"]
State = Literal["reproduced", "differs", "input", "set apart", "no number printed"]
STATES: tuple[State, ...] = ("reproduced", "differs", "input", "set apart", "no number printed")
COLOURS = ("#2e7d4f", "#c2410c", "#7a9cc6", "0.6", "0.85")
RESULTS: tuple[State, ...] = ("reproduced", "differs")
"""What is counted."""
MESH_COLUMNS = ("on its mesh", "state on its mesh")
NEAR = 0.1  # relative, within which a number is called reproduced
UNKNOWN = "not looked into"
SAME = 1e-9  # relative, of a number that a case takes from the thesis
TITLES = {
    "Table 1": "Table 1: axes of OpenSim and FEBio",
    "Table 2": "Table 2: muscles",
    "Table 3": "Table 3: forces in a simulation",
    "Table 4": "Table 4: moduli of the hood",
    "Table 5": "Table 5: longitudinal strains over the central region",
    "Table 6": "Table 6: differences of the dynamic model",
    "Table 7": "Table 7: forces that FEBio puts out",
    "Section 2.2": "Section 2.2: the dynamic model",
    "Section 2.3": "Section 2.3: the finite-element model",
    "Section 3.1": "Section 3.1: devices and run times",
    "Section 3.2": "Section 3.2: the dynamic model and experiment",
    "Section 3.3": "Section 3.3: strains",
    "Section 3.4": "Section 3.4: the integrated model",
    "Figures": "Figures 1.1 to 3.7",
}


@dataclass(frozen=True)
class ThesisRow:
    """A row of `cases/data/thesis_rows.csv`, whose head says what its columns hold."""

    place: str
    item: str
    printed: str
    unit: str
    values: tuple[float, ...]
    relation: Relation
    ours: str
    why: str


def rows() -> list[ThesisRow]:
    """All rows, in the order of the thesis."""
    text = (files("cases") / "data" / "thesis_rows.csv").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    return [_row(cells) for cells in csv.DictReader(lines)]


def _row(cells: Mapping[str, str]) -> ThesisRow:
    relation = cells["relation"]
    assert relation in get_args(Relation)
    values = tuple(float(v) for v in cells["values"].split(";") if v)
    place, item, printed, unit = (cells[k] for k in ("place", "item", "printed", "unit"))
    kind = cast(Relation, relation)
    return ThesisRow(place, item, printed, unit, values, kind, cells["ours"], cells["why"])


def printed_numbers() -> dict[str, float]:
    """What the thesis prints of its own models and ours has too, by the name of ours."""
    return {row.ours: row.values[0] for row in rows() if row.relation == "number"}


def state(row: ThesisRow, ours: Sequence[float]) -> State:
    """Whether `ours` reproduces what the row prints.  An input of our cases is no result, and one
    that is not the thesis's differs."""
    if row.relation == "text":
        return "no number printed"
    if row.relation == "other":
        return "set apart"
    theirs, found = np.array(row.values), np.array(ours)
    if row.relation == "at_most":
        same = found <= theirs
    elif row.relation == "between":
        low, high = theirs
        same = (low <= found) & (found <= high)
    else:
        within = NEAR if row.relation == "number" else SAME
        same = np.abs(found - theirs) <= within * np.abs(theirs)
    if not bool(same.all()):
        return "differs"
    return "input" if row.relation == "input" else "reproduced"


def judge_rows(
    numbers: Mapping[str, Sequence[float]], on_mesh: Mapping[str, Sequence[float]] | None = None
) -> pd.DataFrame:
    """Every row with our numbers and its state; with `on_mesh`, numbers of the mesh that the thesis
    started from, those and their state too.  Raises KeyError for a row of a number that there is
    not."""
    return pd.DataFrame(list(_judgements(numbers, on_mesh)))


def _judgements(
    numbers: Mapping[str, Sequence[float]], on_mesh: Mapping[str, Sequence[float]] | None
) -> Iterator[dict[str, str]]:
    for row in rows():
        ours = numbers[row.ours] if row.ours else ()
        found = state(row, ours)
        yield {
            "place": row.place,
            "row": row.item,
            "thesis": row.printed,
            "ours": _digits(row, ours),
            "unit": row.unit,
            "state": found,
            **({} if on_mesh is None else _on_mesh(row, on_mesh)),
            "why, or what is ours": row.why or (UNKNOWN if found == "differs" else ""),
        }


def _digits(row: ThesisRow, numbers: Sequence[float]) -> str:
    digits = {"input": "{:.6g}", "between": "{:.4g}"}.get(row.relation, "{:.3g}")
    return "; ".join(digits.format(x + 0.0) for x in numbers)


def _on_mesh(row: ThesisRow, numbers: Mapping[str, Sequence[float]]) -> dict[str, str]:
    found = numbers.get(row.ours)
    cells = ("", "") if found is None else (_digits(row, found), state(row, found))
    return dict(zip(MESH_COLUMNS, cells, strict=True))


def count_results(table: pd.DataFrame) -> str:
    """How many results are reproduced, of how many; with the strains of the mesh that the thesis
    started from in place of ours, where they are in the table."""
    counted = table[table.state.isin(RESULTS)]
    text = f"{int((counted.state == 'reproduced').sum())} of {len(counted)}"
    if MESH_COLUMNS[1] not in table:
        return text
    mesh = counted[MESH_COLUMNS[1]]
    best = int((mesh.where(mesh != "", counted.state) == "reproduced").sum())
    read = mesh != ""
    return (
        f"{text}; {best} of {len(counted)} with strains of the mesh that the thesis started from "
        f"in place of our sheet's ({int((mesh[read] == 'reproduced').sum())} of these "
        f"{int(read.sum())}, in a region that was chosen after they were seen: study published)"
    )


def row_figures(numbers: Numbers, on_mesh: Numbers | None = None) -> list[Figure]:
    """The states of all rows, and a table for each place of the thesis."""
    table = judge_rows(numbers, on_mesh)
    count = pd.crosstab(table.place, table.state).reindex(
        index=list(TITLES), columns=list(STATES), fill_value=0
    )

    def draw(sheet: Sheet) -> None:
        axes, left = sheet.subplots(), np.zeros(len(count))
        for name, colour in zip(STATES, COLOURS, strict=True):
            axes.barh(count.index, count[name], left=left, color=colour, label=name)
            left += count[name].to_numpy()
        axes.invert_yaxis()
        axes.set_xlabel("rows")
        axes.spines[["top", "right"]].set_visible(False)
        sheet.legend(loc="outside lower center", ncols=5, frameon=False)

    apart = ", ".join(f"{int(count[name].sum())} {name}" for name in STATES[len(RESULTS) :])
    caption = (
        f"Results reproduced: {count_results(table)}. A number is called reproduced within "
        f"{100 * NEAR:.0f} % of the printed one, a bound or an interval where it is met. Not "
        f"counted of the {len(table)} rows: {apart}. An input is a number that our cases take from "
        "the thesis and says nothing of results; set apart are run times of another program, what "
        "the experiment says, which the thesis itself misses in three of four rows, and quantities "
        "that are not ours. Nothing was fitted to the thesis. Its figures were not seen: only what "
        "its text prints stands here, and of the experiment's forces the text prints no mean."
    )
    tables = {"states": count.reset_index(), "rows": table}
    title = "What of the thesis is reproduced"
    head = Figure("states", title, caption, draw, tables, (7.5, 4.6))
    return [head, *_tables(table)]


def _tables(table: pd.DataFrame) -> Iterator[Figure]:
    for place, title in TITLES.items():
        here = table[table.place == place].drop(columns="place")
        if (here.filter(list(MESH_COLUMNS)) == "").all(axis=None):
            here = here.drop(columns=list(MESH_COLUMNS), errors="ignore")
        name = place.lower().replace(" ", "_").replace(".", "_")
        yield Figure(name, title, "", None, {name: here}, (7.0, 1.0))
