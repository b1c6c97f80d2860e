"""The scoreboard as a page that needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cosim.analyses.mesh_series import MeshSeries
from cosim.files import write_text
from cosim.report.templates import html_page
from cosim.results.compare import (
    VERDICT_SHAPES,
    Comparison,
    Target,
    marks,
    misses_first,
    number,
    reference_text,
)
from cosim.results.picture import picture_address
from cosim.results.table import MISS, Cell, ReportTable
from cosim.validation.mesh import distinct, tally
from cosim.validation.plots import draw_budgets, draw_kind, draw_rows
from cosim.validation.run import Board, by_kind
from cosim.validation.scoreboard import JudgedBoard, judgements_of_kind
from cosim.validation.uncertainty import sentence
from cosim.validation.versions import Key

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
    kinds = by_kind([b.board for b in boards])
    text = html_page(
        "page.html.j2",
        "cosim.validation",
        boards=[_board(board) for board in boards],
        kinds=[
            {
                "group": b.group,
                "headline": b.headline,
                "nulls": answers_of(b, judgements_of_kind(boards, b)),
                "picture": picture_address(draw_kind(b), DPI),
            }
            for b in kinds
        ],
        changed=_changed(boards),
        meshes=mesh_table(series),
        mesh_tally=tally_text(tally(series)),
    )
    write_text(path, text)


def _board(judged: JudgedBoard) -> dict[str, Any]:
    board = judged.board
    return {
        "board": board,
        "group": board.group,
        "headline": board.headline,
        "nulls": answers_of(board, judged.judgements() if judged.known else {}),
        "budgets": "" if board.variant else picture_address(draw_budgets(judged), DPI),
        "picture": picture_address(draw_rows(board), DPI),
        "rows": rows_of(judged),
    }


def answers_of(board: Board, judgements: Mapping[str, Mapping[str, int]]) -> ReportTable:
    """The tally of the model and of each null model, beside one SD and u_val, and the skill over
    it."""
    skills = {s.null: s for s in board.skills}
    rows = []
    for name, verdicts in board.tallies().items():
        s = skills.get(name)
        skill = ("", "") if s is None else (str(s), s.fault or "beaten")
        rows.append((name, tally_text(verdicts), tally_text(judgements.get(name, {})), *skill))
    columns = ("Answer", "Verdicts", "Beside u_val", "Skill over it", "")
    return ReportTable(f"answers {board.group}", board.group, columns, rows)


def tally_text(counts: Mapping[str, int]) -> str:
    """How many of what.

    >>> tally_text({"inside": 3, "outside": 1})
    '3 inside, 1 outside'
    """
    return ", ".join(f"{count} {word}" for word, count in counts.items())


IN_TERMINAL = ("what", "model", "unit", "reference", "difference", "verdict", "kind")
"""Columns of `rows_of` that a terminal has room for."""


def rows_of(judged: JudgedBoard) -> ReportTable:
    """Every number of a group, misses first."""
    columns = (
        *("what", "model", "unit", "reference", "difference", "verdict", "95 % of u_val"),
        *("beside u_val", "other hoods", "source", "kind", "note"),
    )
    every = [_row(judged, row) for row in misses_first(judged.board.rows)]
    return ReportTable(f"rows {judged.board.group}", judged.board.group, columns, every)


def _row(judged: JudgedBoard, row: Comparison) -> list[Cell]:
    t, of_row, known = row.target, judged.budget(row), judged.known_of(row)
    forms = None if known is None else known.form_range
    lacks = f" ({of_row.lacks})" if of_row.lacks else ""
    return [
        *(name_of(t), row.model, "" if t.unit == "1" else t.unit, reference_text(t)),
        *(row.difference, f"{VERDICT_SHAPES[row.verdict]} {row.verdict}"),
        None if of_row.expanded is None else float(f"{of_row.expanded:.2g}"),
        "" if known is None else f"{of_row.judgement}{lacks}",
        "" if forms is None else " to ".join(number(end, 3) for end in forms),
        *(t.source, t.kind, t.note),
    ]


def name_of(target: Target) -> str:
    """What a row is of, with what a reader must know of it."""
    return " ".join([target.name, *(f"[{mark}]" for mark in marks(target))])


def _changed(boards: Sequence[JudgedBoard]) -> ReportTable:
    rows = [
        (f"{row.target.name} [{b.board.group}]", row.verdict, of.judgement, sentence(row, of))
        for b in boards
        if not b.board.variant
        for row, of in b.changed_verdicts()
    ]
    return ReportTable("changed", "Changed", ("What", "By 1 SD", "By u_val", "Why"), rows)


MESH_SHAPES = {"beyond": MISS, "no value": "✕", "converges": "◆", "within": "●"}


def mesh_table(series: Mapping[Key, MeshSeries]) -> ReportTable:
    """What other quads change of each number that the mesh touches."""
    rows: list[list[Cell]] = []
    for (group, case, name, _), s in distinct(series):
        found = (s.own, ", ".join(map(number, s.values)), s.order_text, s.range, s.bound, s.error)
        verdict = f"{MESH_SHAPES[s.verdict]} {s.verdict}"
        rows.append([f"{name} [{case or group}]", *found, s.index, verdict])
    columns = ("what", "model", "coarsest to finest", "order", "range", "at most", "off by", "GCI")
    title = "mesh: what other quads change"
    return ReportTable("mesh", title, (*columns, "verdict"), rows, 3)
