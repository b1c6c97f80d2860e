"""The plot of a ledger: forces and moments that close, on their lines of action, in words."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.face import load, run
from cosim.results.ledger_plot import TELLING, _place, acting_on, draw_ledger, polygon
from cosim.results.parts import LedgerRow
from cosim.results.result import Result


@pytest.fixture(scope="module")
def result() -> Result:
    return run(load("isometric_edc", ["hood.mesh.quads=120", "output.picture=false"]))


def on(result: Result, body: str) -> list[LedgerRow]:
    return [row for row in result.rows if row.state == "loaded" and row.body == body]


@pytest.mark.parametrize("body", ["metacarpal", "proximal", "middle", "distal"])
def test_the_forces_of_a_bone_close(result, body):
    acting = acting_on(on(result, body))
    corners = polygon(acting)
    largest = np.linalg.norm(np.diff(corners, axis=0), axis=1).max()
    assert np.linalg.norm(corners[-1] - corners[0]) < 1e-6 * largest
    moment = np.sum([a.moment for a in acting], axis=0)
    assert np.linalg.norm(moment) < 1e-6 * max(np.linalg.norm(a.moment) for a in acting)


def test_little_forces_are_summed_up_and_none_is_lost(result):
    rows = on(result, "proximal")
    acting = acting_on(rows)
    assert acting[-1].words.endswith(f"more, each under {100 * TELLING:.0f} %")
    count = int(acting[-1].words.split()[0])
    assert len(acting) - 1 + count == len(rows)
    for part in ("force", "moment"):
        np.testing.assert_allclose(
            np.sum([getattr(a, part) for a in acting], axis=0),
            np.sum([getattr(row, part) for row in rows], axis=0),
            atol=1e-12,
        )


component = st.floats(-3, 3).filter(lambda x: abs(x) > 0.01)


@given(component, component, st.floats(-50, 50))
def test_a_force_stands_on_its_line_of_action(distal, dorsal, moment):
    force = np.array([distal, dorsal])
    bone = np.random.default_rng(1).uniform((-5, -40), (5, 0), (200, 2))
    at = _place(force, moment, bone)
    assert at[1] * distal - at[0] * dorsal == pytest.approx(moment, abs=1e-9)


def test_the_plot_names_sources_in_words_with_their_components(result):
    figure = draw_ledger(result.rows, "x", result.scene)
    texts = [word for text in figure.texts for word in (text.get_text(), *text.get_text().split())]
    assert {"central slip (hood)", "terminal slip (hood)", "joint contact"} <= set(texts)
    assert not [text for text in texts if "_" in text]
    assert [text.get_text() for text in figure.texts].count("sum") == 4
    slip = next(row for row in on(result, "distal") if row.source == "hood terminal_slip")
    for value in slip.force:
        assert f"{value:.3f}".replace("-", "\u2212") in texts
    figure.draw_without_rendering()
    for text in (*figure.texts, *(t for axes in figure.axes for t in axes.texts)):
        shown = text.get_window_extent()
        assert 0 <= shown.x0 <= shown.x1 <= figure.bbox.x1, text.get_text()
    assert draw_ledger(result.rows, "without bones").axes


def test_a_motion_is_drawn_as_lines_over_time():
    def row(state: str, source: str, force: float) -> LedgerRow:
        return LedgerRow(state, "distal", source, np.array([force, 0, 0]), np.zeros(3))

    times = [row(f"{t:g} s", "hood contact", 1.0 + t) for t in (0.0, 0.1, 0.2, 0.3)]
    moving = draw_ledger([*times, row("0 s", "faint", 1e-3)], "moving")
    (line,) = moving.axes[0].lines
    assert line.get_ydata() == pytest.approx([1.0, 1.1, 1.2, 1.3])
    assert line.get_label() == "contact with the hood"
    assert (moving.axes[0].get_xlabel(), moving.axes[0].get_ylabel()) == (
        "time, s",
        "force on the bone, N",
    )
