"""What is told apart in a plot looks different, however many there are."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas
import pytest
import xarray
from matplotlib.colors import to_hex

from cosim.analyses import moment_arms as arms
from cosim.analyses.estimate.plot import draw_motion
from cosim.analyses.ladder import Rung, draw_ladder
from cosim.port import AXES
from cosim.report import page as page_module
from cosim.report.drawings import arrows_of
from cosim.results.conventions import by_axis
from cosim.results.history_plot import draw_history
from cosim.results.ledger_plot import draw_ledger
from cosim.results.looks import look
from cosim.results.parts import LedgerRow
from cosim.results.read import read_run
from tests.helpers.report_runs import run_into

MANY = 40
TIMES = (0.0, 0.1, 0.2, 0.3)


@pytest.fixture(scope="module")
def hood(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    return run_into(folder, "isometric_edc", "hood.mesh.quads=120", "output.picture=false")


def line_looks(axes) -> dict[str, Any]:
    """Colour and dashes of each labelled line."""
    lines = [line for line in axes.get_lines() if not line.get_label().startswith("_")]
    return {line.get_label(): (to_hex(line.get_color()), str(line._dash_pattern)) for line in lines}


def check_distinct(looks: dict[str, Any], count: int) -> None:
    assert len(looks) == count
    assert len(set(looks.values())) == count


def rows(count: int, states: tuple[str, ...]) -> list[LedgerRow]:
    return [
        LedgerRow(state, body, f"source {i}", np.array([1.0 + i, 0, 0]), np.zeros(3))
        for state in states
        for body in ("middle", "distal")
        for i in range(count)
    ]


@pytest.mark.parametrize("count", [1, 2, 7, 10, 11, 20, 21, MANY])
def test_sources_of_a_ledger_differ_and_are_the_same_in_every_panel(count):
    moving = draw_ledger(rows(count, tuple(f"{t:g} s" for t in TIMES)), "moving")
    first, second = map(line_looks, moving.axes)
    check_distinct(first, count)
    assert first == second


def test_a_ledger_keeps_a_source_s_look_where_another_body_has_others():
    states = tuple(f"{t:g} s" for t in TIMES)
    every = [row for row in rows(12, states) if row.body == "middle" or row.source > "source 3"]
    first, second = map(line_looks, draw_ledger(every, "moving").axes)
    assert first == second


def test_the_sources_of_a_real_index_finger_differ(hood):
    ledger = {(row.body, row.source): row for row in read_run(hood).rows}.values()
    moving = [
        replace(row, state=f"{t:g} s", force=row.force / np.linalg.norm(row.force))
        for row in ledger
        for t in TIMES
        if np.linalg.norm(row.force)
    ]
    sources = {row.source for row in moving}
    assert len(sources) > 10
    check_distinct(line_looks(draw_ledger(moving, "moving").axes[0]), len(sources))


@pytest.mark.parametrize("count", range(1, MANY + 1))
def test_looks_differ_as_lines_and_as_bars(count):
    looks = [look(i) for i in range(count)]
    assert len({(one.colour, one.dashes) for one in looks}) == count
    assert len({(one.colour, one.hatch) for one in looks}) == count


def test_tendons_of_moment_arms_differ():
    names = [f"tendon {i}" for i in range(MANY)]
    table = pandas.DataFrame(
        [("PIP", n, a, 1.0 + i) for i, n in enumerate(names) for a in (0.0, 1.0)],
        columns=["joint", "tendon", "angle_deg", "arm_mm"],
    )
    figure = arms.draw(table, "arms", arms.published_arms("hinge"), {})
    (legend,) = figure.legends
    handles = legend.legend_handles
    assert len({(to_hex(h.get_color()), str(h._dash_pattern)) for h in handles}) == MANY
    drawn = [x for x in figure.axes[0].get_lines() if len(x.get_xdata()) == 2][:MANY]
    assert len({(to_hex(x.get_color()), str(x._dash_pattern)) for x in drawn}) == MANY


def test_rungs_of_a_ladder_differ():
    force = {"fingertip_force_N": by_axis((1.0, 0.0, 2.0)), "fingertip_magnitude_N": 2.2}
    summary = {**force, "unloaded": force}
    rungs = [Rung(f"rung {i}", False, "converged", "", 1.0, summary) for i in range(MANY)]
    looks = line_looks(draw_ladder(rungs, "ladder").axes[0])
    check_distinct(looks, MANY)


def test_tendons_of_an_estimate_differ():
    names, times = tuple(f"tendon {i}" for i in range(MANY)), np.array(TIMES)
    some = np.ones((len(times), MANY))
    found: Any = SimpleNamespace(
        motion=SimpleNamespace(time=times, angle=some), required_torque=some, tension=some
    )
    figure = draw_motion(names, names, found, "estimate")
    for axes in figure.axes:
        check_distinct(line_looks(axes), MANY)


def test_joints_and_cylinders_of_a_history_differ():
    names = [f"name {i}" for i in range(MANY)]
    one = np.ones((len(TIMES), MANY))
    data = xarray.Dataset(
        {
            "angle": (("time", "joint"), one),
            "tip_force": (("time", "axis"), np.ones((len(TIMES), 3))),
            "command": (("time", "cylinder"), one),
            "pressure": (("time", "cylinder"), one),
            "tension": (("time", "tendon"), one),
        },
        {
            "time": list(TIMES),
            "axis": list(AXES),
            **dict.fromkeys(("joint", "cylinder", "tendon"), names),
        },
    )
    angles, force, *air = draw_history(data, "history").axes
    check_distinct(line_looks(force), 4)
    for axes in (angles, *air):
        check_distinct(line_looks(axes), MANY)


def test_runs_of_a_report_differ(hood):
    run = read_run(hood)
    arrows = arrows_of([replace(run, name=f"run {i}") for i in range(MANY)])
    assert len({(arrow.ink, arrow.dashes) for arrow in arrows}) == 2 * MANY  # loaded and at rest


@pytest.mark.parametrize("count", [3, MANY])
def test_curves_of_a_page_differ(count: int) -> None:
    histories = [{"charts": [{"curves": [{}] * n} for n in (1, count, 2)]}]
    looks = page_module._line_looks(histories)
    assert len({json.dumps(one) for one in looks}) == len(looks) == count
