"""The pictures of a scoreboard show every number that there is."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.analyses.mesh_series import MeshSeries, mesh_factors
from cosim.results.compare import Comparison, Target
from cosim.validation.plots import (
    NO_TENDON,
    SHAPES,
    draw_budgets,
    draw_kind,
    draw_rows,
    tendon_of,
)
from cosim.validation.run import Board
from cosim.validation.scoreboard import JudgedBoard
from cosim.validation.uncertainty import NumberUncertainty
from cosim.validation.versions import InputSpread


def row(name: str, model: float | None, unit: str = "N", **more: float | None) -> Comparison:
    numbers: dict[str, float | None] = {"reference": None, "sd": None, "low": None, "high": None}
    target = Target(name, "q", unit, **{**numbers, **more}, source="s", kind="experiment")
    return Comparison(target, model)


ROWS = (
    row("EDC, distal", 1.0, reference=0.9, sd=0.2),
    row("FDP, distal", 3.0, reference=1.0, sd=0.2),
    row("EDC, strain", 2.0, unit="%", low=1.0),
    row("EDC, arm", 2.0, unit="mm", reference=2.5),
    row("EDC, lost", None, reference=1.0),
)


def test_every_number_has_a_place_in_the_panel_of_its_unit() -> None:
    figure = draw_rows(Board("g", ROWS, {}))
    assert figure is not None
    names = {a.get_xlabel(): [t.get_text() for t in a.get_yticklabels()] for a in figure.axes}
    assert names == {"N": ["EDC, distal", "FDP, distal"], "%": ["EDC, strain"], "mm": ["EDC, arm"]}


def test_a_verdict_has_its_shape() -> None:
    figure = draw_rows(Board("g", ROWS, {}))
    assert figure is not None
    drawn = [(line.get_label(), line.get_marker()) for a in figure.axes for line in a.lines]
    for verdict in {r.verdict for r in ROWS if r.model is not None}:
        assert (f"model, {verdict}", SHAPES[verdict]) in drawn


@pytest.mark.parametrize("model", [0.5, 2.0])
def test_an_open_band_is_drawn_beyond_the_model(model: float) -> None:
    figure = draw_rows(Board("g", (row("EDC", model, low=1.0),), {}))
    assert figure is not None
    (bar,) = figure.axes[0].patches
    ends = sorted((bar.get_x(), bar.get_x() + bar.get_width()))
    assert ends[0] <= 1.0 <= ends[1]
    if model > 1.0:
        assert ends[0] <= model <= ends[1]
    else:
        assert model < ends[0]


def test_rows_without_a_number_have_no_picture() -> None:
    assert draw_rows(Board("g", ROWS[-1:], {})) is None
    assert draw_kind(Board("g", ROWS[-1:], {})) is None


def test_a_chart_holds_all_references_and_answers() -> None:
    split = {ROWS[0].target: 5.0}
    figure = draw_kind(Board("g", ROWS, {}, split=split))
    assert figure is not None
    (axes,) = figure.axes  # one row alone makes no chart
    assert axes.get_xlabel() == "reference, N"
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    for line in axes.lines:
        if line.get_label() == "model":
            x, y = np.asarray(line.get_data(), dtype=float)
            assert left < x.min() <= x.max() < right
            assert low < y.min() <= y.max() < high


@pytest.mark.parametrize(
    ("name", "tendon"),
    [("40/55/35 deg, LUM, distal", "LUM"), ("force ti EDC: distal", "EDC"), ("drop", NO_TENDON)],
)
def test_a_row_goes_to_the_tendon_that_it_names(name: str, tendon: str) -> None:
    assert tendon_of(row(name, 1.0, reference=1.0)) == tendon


def test_a_budget_has_a_bar_for_each_part_and_a_mark_of_the_error() -> None:
    target = Target(*("EDC, distal", "q", "N", 0.9, 0.2, None, None, "s", "experiment", "c"), n=3)
    row_of = Comparison(target, 1.0)
    series = MeshSeries(factors=mesh_factors(3, 2), values=(1.1, 1.0, 0.95), bound=0.02)
    inputs = InputSpread(nominal=1.0, mean=1.0, sd=0.05, samples=16, failed=0)
    known = NumberUncertainty(
        group="g",
        case="c",
        name="EDC, distal",
        quantity="q",
        unit="N",
        model=1.0,
        meshes=series,
        inputs=inputs,
    )
    board = Board("g", (row_of, row("FDP", 2.0, reference=1.0)), {})
    figure = draw_budgets(JudgedBoard(board, {known.key: known}))
    assert figure is not None
    (axes,) = figure.axes
    assert [t.get_text() for t in axes.get_yticklabels()] == ["EDC, distal"]
    of_row = JudgedBoard(board, {known.key: known}).budget(row_of)
    widths = [bar.get_width() for bar in axes.patches]
    assert widths == pytest.approx([of_row.u_num, of_row.u_input, of_row.u_data])
    marks = {line.get_label(): line.get_xdata()[0] for line in axes.lines}
    assert marks["95 % of u_val"] == pytest.approx(of_row.expanded)
    assert marks["|model - measured|, within uncertainty"] == pytest.approx(0.1)
    assert draw_budgets(JudgedBoard(board)) is None
