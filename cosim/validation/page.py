"""The scoreboard as a page that needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim.files import output_file
from cosim.report.templates import template
from cosim.results.compare import (
    VERDICT_SHAPES,
    Comparison,
    marks,
    misses_first,
    number,
    reference_text,
)
from cosim.results.picture import as_png, data_address
from cosim.validation import mesh as validation_mesh
from cosim.validation.mesh import Change
from cosim.validation.plots import draw_kind, draw_rows
from cosim.validation.run import Board, by_kind

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 110


def write_page(path: Path, boards: Sequence[Board], changes: Sequence[Change] = ()) -> None:
    """The page of the boards, and of what a finer mesh `changes`.  Raises InputError where the file
    cannot be written."""
    shown = [
        {
            "group": board.group,
            "kind": board.kind,
            "variant": board.variant,
            "headline": board.headline,
            "nulls": _nulls(board),
            "by_hand": board.hand_lines,
            "failures": board.failures,
            "picture": _picture(draw_rows(board)),
            "rows": [_cells(row) for row in misses_first(board.rows)],
        }
        for board in boards
    ]
    text = template("cosim.validation").render(
        boards=shown,
        kinds=[
            {
                "group": b.group,
                "headline": b.headline,
                "nulls": _nulls(b),
                "picture": _picture(draw_kind(b)),
            }
            for b in by_kind(boards)
        ],
        changes=[_changes(c) for c in changes],
        mesh_tally=validation_mesh.tally(changes),
    )
    with output_file(path) as part:
        part.write_text(text, encoding="utf-8")


def _picture(figure: Figure | None) -> str:
    return "" if figure is None else data_address(as_png(figure, DPI))


def _nulls(board: Board) -> list[dict[str, str]]:
    """The tally of the model and of each null model, with the skill over it."""
    skills = {s.null: s for s in board.skills}
    rows = []
    for name, verdicts in board.tallies().items():
        s = skills.get(name)
        beaten = "" if s is None else s.fault or "beaten"
        row = {"name": name, "tally": _sentence(verdicts), "skill": "" if s is None else str(s)}
        rows.append(row | {"beaten": beaten})
    return rows


def _sentence(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {word}" for word, count in counts.items())


def _cells(row: Comparison) -> dict[str, Any]:
    t = row.target
    return {
        "name": t.name,
        "marks": marks(t),
        "note": t.note,
        "model": number(row.model),
        "unit": t.unit if t.unit != "1" else "",
        "stated": reference_text(t),
        "difference": number(row.difference),
        "verdict": row.verdict,
        "shape": VERDICT_SHAPES[row.verdict],
        "source": t.source,
        "kind": t.kind,
    }


def _changes(change: Change) -> dict[str, str]:
    numbers = {k: number(getattr(change, k)) for k in ("model", "finer", "change", "bound")}
    shape = {"beyond": "▲", "within": "●", "no value": "✕"}[change.verdict]
    unit = change.unit if change.unit != "1" else ""
    where = change.case or change.group
    return numbers | {
        "name": change.name,
        "where": where,
        "unit": unit,
        "verdict": change.verdict,
        "shape": shape,
    }
