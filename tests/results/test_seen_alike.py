"""What one reads side by side is alike: figures of two runs, words of picture and page, the
terminal's table and the user's own points, errors and the file that they are of."""

from __future__ import annotations

import numpy as np
import pytest

import cosim
from cosim.errors import InputError
from cosim.report.tables import _ledger
from cosim.results.ledger_plot import acting_on
from cosim.results.summary_tables import MOST_DOTS, rows_of


@pytest.fixture(scope="module")
def runs():
    case = cosim.load("pulley_edc")
    posture = {"finger.posture.PIP": "20 deg", "tendons.EDC.tension": "12 N"}
    return cosim.run(case), cosim.run(case.replace(posture))


def millimetre(figure) -> float:
    """Inches that a millimetre takes in each of the views, which are alike."""
    width = figure.get_figwidth()
    each = [ax.get_position().width * width / np.ptp(ax.get_xlim()) for ax in figure.axes]
    assert each == pytest.approx([each[0]] * len(each))
    return each[0]


def arrow(figure) -> float:
    """The length of the fingertip's force, mm in the first view."""
    ax = figure.axes[0]
    (found,) = [
        a for a in ax.texts if getattr(a, "arrow_patch", None) is not None and not a.get_text()
    ]
    return float(np.hypot(*np.subtract(found.xy, found.xyann)))


def test_pictures_beside_each_other_have_one_scale(runs):
    one, other = runs
    alone = [run.plot() for run in runs]
    together = one.plot(beside=[other]), other.plot(beside=[one])
    assert millimetre(alone[0]) != pytest.approx(millimetre(alone[1]), rel=1e-3)
    assert millimetre(together[0]) == pytest.approx(millimetre(together[1]))
    for at in (0, 1):
        limits = [f.axes[at].get_xlim() + f.axes[at].get_ylim() for f in together]
        assert limits[0] == pytest.approx(limits[1])
    sizes = [np.hypot(run.tip_force["distal"], run.tip_force["dorsal"]) for run in runs]
    assert arrow(together[0]) / arrow(together[1]) == pytest.approx(sizes[0] / sizes[1])
    assert f"{np.linalg.norm([*one.tip_force.values()]):.2f} N" in legend(together[0])[-1]


def legend(figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_a_figure_has_the_width_the_view_and_the_parts_asked_for(runs):
    figure = runs[0].plot(width_mm=170, view="dorsal")
    assert figure.get_figwidth() == pytest.approx(170 / 25.4)
    (panel,) = figure.axes
    assert panel.get_ylabel() == "radial, mm"
    net = cosim.run("cable_edc")
    hood = net.plot(hood_only=True, width_mm=110)
    assert not {"bones", "tendons at rest"} & {*legend(hood)}
    assert "hood: a net of cables, coloured by the scale" in legend(hood)
    assert {"bones", "tendons at rest"} <= {*legend(runs[0].plot())}


@pytest.mark.parametrize(
    ("kind", "options", "says"),
    [
        ("scene", {"width_mm": 10}, "a width in mm from 130 to 1000"),
        ("scene", {"width_mm": float("nan")}, "a width in mm"),
        ("scene", {"view": "palmar"}, "'radial', 'dorsal' or 'both'"),
        ("scene", {"beside": "runs/one"}, "a list of results"),
        ("scene", {"view": ["dorsal"]}, "'radial', 'dorsal' or 'both'"),
        ("scene", {"hood_only": True}, "has no shape to draw"),
        ("ledger", {"width_mm": 170}, "are of the 'scene'"),
    ],
)
def test_an_option_that_a_figure_has_not_is_refused(runs, kind, options, says):
    with pytest.raises(InputError, match=says):
        runs[0].plot(kind, **options)


def test_page_and_picture_call_each_source_of_the_ledger_alike(runs):
    run = runs[0]
    last = run.rows[-1].state
    rows = [row for row in run.rows if row.state == last]
    drawn = {
        a.words
        for body in {r.body for r in rows}
        for a in acting_on([r for r in rows if r.body == body])
    }
    table = {row[1] for row in _ledger(run, 0).rows}
    assert {words for words in drawn if " more, each under " not in words} <= table
    assert "support of the fingertip" in table


def vector(size: float) -> dict[str, float]:
    return {"distal": 0.6 * size, "radial": 0.0, "dorsal": -0.8 * size}


def test_the_terminal_shows_the_user_s_gauges_and_points():
    state = {
        "point_displacement_mm": {"dot_1": vector(5.0)},
        "point_strain_percent": {"dot_1": {"longitudinal": 2.5, "lateral": -1.0, "shear": 0.1}},
        "gauge_strain_percent": {"middle": 3.25},
    }
    change = {**state, "gauge_strain_percent": {"middle": 3.0}}
    summary = {
        **state,
        "unloaded": {"gauge_strain_percent": {"middle": 0.25}},
        "difference": change,
    }
    ((header, rows),) = [block for block in rows_of(summary) if block[0][0] == "on the hood"]
    assert header == ("on the hood", "loaded", "at rest", "difference")
    assert ("strain along the gauge middle, %", "3.25", "0.25", "3") in rows
    assert ("displacement of dot 1, mm", "5", "", "5") in rows
    assert ("lateral strain at the point dot 1, %", "-1", "", "-1") in rows
    many = {f"camera_{i}": vector(1.0) for i in range(MOST_DOTS + 1)}
    ((_, rows),) = [
        block for block in rows_of({"point_displacement_mm": many}) if block[0][0] == "on the hood"
    ]
    assert rows == [("and 9 gauges and points more, in summary.json",)]


@pytest.mark.parametrize(
    "row", ["slip_force_N.central,mm", "fingertip_force_N.distall,N", "fingertip_force_N.distal,mN"]
)
def test_an_error_of_measured_values_names_file_and_line(runs, tmp_path, row):
    path = tmp_path / "mine.csv"
    path.write_text(
        f"quantity,unit,value\nfingertip_force_N.dorsal,N,1\n{row},2\n", encoding="utf-8"
    )
    with pytest.raises(InputError, match=r"mine\.csv, line 3"):
        cosim.compare(runs[0], data=path)
