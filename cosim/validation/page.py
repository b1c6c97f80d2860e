"""The scoreboard as a page that needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim.analyses.mesh_series import MeshSeries
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
from cosim.results.picture import picture_address
from cosim.validation.mesh import distinct, tally
from cosim.validation.plots import draw_budgets, draw_kind, draw_rows
from cosim.validation.run import Board, by_kind
from cosim.validation.scoreboard import JudgedBoard, judgements_of_kind
from cosim.validation.uncertainty import Budget, NumberUncertainty, sentence
from cosim.validation.versions import Key

if TYPE_CHECKING:
    pass

DPI = 110


def write_page(path: Path, boards: Sequence[JudgedBoard]) -> None:
    """The page of the boards, with what is known of their numbers' uncertainty.  Raises InputError
    where the file cannot be written."""
    series = {
        key: known.meshes
        for board in boards
        for key, known in board.known.items()
        if known.meshes is not None
    }
    text = template("cosim.validation").render(
        boards=[_board(board) for board in boards],
        kinds=[
            {
                "group": b.group,
                "headline": b.headline,
                "nulls": _nulls(b, judgements_of_kind(boards, b)),
                "picture": picture_address(draw_kind(b), DPI),
            }
            for b in by_kind([b.board for b in boards])
        ],
        changed=[
            _changed(row, of_row, board.board.group)
            for board in boards
            if not board.board.variant
            for row, of_row in board.changed_verdicts()
        ],
        changes=[_mesh_row(key, s) for key, s in distinct(series)],
        mesh_tally=tally(series),
    )
    with output_file(path) as part:
        part.write_text(text, encoding="utf-8")


def _board(judged: JudgedBoard) -> dict[str, Any]:
    board = judged.board
    return {
        "group": board.group,
        "kind": board.kind,
        "variant": board.variant,
        "headline": board.headline,
        "nulls": _nulls(board, judged.judgements() if judged.known else {}),
        "budgets": "" if board.variant else picture_address(draw_budgets(judged), DPI),
        "by_hand": board.hand_lines,
        "failures": board.failures,
        "picture": picture_address(draw_rows(board), DPI),
        "rows": [
            _cells(row, judged.budget(row), judged.known_of(row))
            for row in misses_first(board.rows)
        ],
    }


def _nulls(board: Board, judgements: Mapping[str, Mapping[str, int]]) -> list[dict[str, str]]:
    """The tally of the model and of each null model, beside one SD and u_val, and the skill over
    it."""
    skills = {s.null: s for s in board.skills}
    rows = []
    for name, verdicts in board.tallies().items():
        s = skills.get(name)
        beaten = "" if s is None else s.fault or "beaten"
        row = {"name": name, "tally": _sentence(verdicts), "skill": "" if s is None else str(s)}
        u_val = _sentence(judgements.get(name, {}))
        rows.append(row | {"beaten": beaten, "u_val": u_val})
    return rows


def _sentence(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {word}" for word, count in counts.items())


def _changed(row: Comparison, of_row: Budget, group: str) -> dict[str, str]:
    return {
        "name": row.target.name,
        "group": group,
        "verdict": row.verdict,
        "judgement": of_row.judgement,
        "why": sentence(row, of_row),
    }


def _cells(row: Comparison, of_row: Budget, known: NumberUncertainty | None) -> dict[str, Any]:
    t = row.target
    forms = None if known is None else known.form_range
    return {
        "u_val": number(of_row.expanded, 2),
        "judgement": of_row.judgement if known is not None else "",
        "lacks": of_row.lacks if known is not None else "",
        "forms": "" if forms is None else " to ".join(number(end, 3) for end in forms),
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


def _mesh_row(key: Key, series: MeshSeries) -> dict[str, str]:
    group, case, name, _ = key
    return {
        "name": name,
        "where": case or group,
        "model": number(series.own),
        "values": ", ".join(map(number, series.values)),
        "order": series.order_text,
        "range": number(series.range, 3),
        "off": number(series.error, 3),
        "index": number(series.index, 3),
        "bound": number(series.bound, 3),
        "verdict": series.verdict,
        "shape": {"beyond": "▲", "no value": "✕", "converges": "◆", "within": "●"}[series.verdict],
    }
