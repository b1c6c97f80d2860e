"""`cosim run --watch`: the page of a run, and the run itself as without it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cosim.cli import app
from cosim.ui import server
from cosim.ui.desk import Desk

pytest.importorskip("starlette")


@pytest.fixture
def watched(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """The states of the desks at the end of their runs."""
    desks: list[Desk] = []
    begin = Desk.__init__

    def keep(desk: Desk, *args: Any, **more: Any) -> None:
        begin(desk, *args, **more)
        desks.append(desk)

    states: list[dict[str, Any]] = []
    monkeypatch.setattr(Desk, "__init__", keep)
    monkeypatch.setattr(server, "wait_for_end", lambda: states.append(desks[-1].state()))
    return states


def test_a_run_is_shown_as_it_goes_on_and_written_as_ever(watched, tmp_path: Path):
    words = ["run", "network_edc", "--watch", "--no-browser", "--out", str(tmp_path)]
    done = CliRunner().invoke(app, [*words, "--no-pictures"])
    assert done.exit_code == 0, done.output
    assert "http://127.0.0.1:" in done.output
    assert (tmp_path / "network_edc" / "summary.json").is_file()
    (state,) = watched
    assert state["status"] == "done"
    assert state["strip"]
    assert {name for name, _ in state["residuals"]} == {"unloaded", "loaded"}


def test_a_run_that_fails_says_so_on_the_page_and_by_its_exit_code(watched, tmp_path: Path):
    words = ["run", "network_edc", "--watch", "--no-browser", "--out", str(tmp_path)]
    done = CliRunner().invoke(app, [*words, "--set", "solve.max_iterations=1"])
    assert done.exit_code == 1
    (state,) = watched
    assert state["status"] == "failed"
    assert "did not agree" in state["error"]
    assert not state["strip"]


def test_a_motion_is_shown_in_its_frames_so_far(watched, tmp_path: Path, monkeypatch):
    seen: list[tuple[int, float]] = []
    show = Desk.show_motion

    def keep(desk: Desk, case: Any, so_far: Any) -> None:
        show(desk, case, so_far)
        view = desk.drawn()["views"][0]
        seen.append((len(view["frames"]), so_far.history.moment.coupled.time))
        assert desk.state()["isSoFar"]

    monkeypatch.setattr(Desk, "show_motion", keep)
    monkeypatch.setattr("cosim.solve.motion.GLANCE", 0.0)
    words = ["run", "forward_edc", "--watch", "--no-browser", "--out", str(tmp_path)]
    settings = ("forward.duration=20 ms", "forward.must_rest=false")
    more = [part for text in settings for part in ("--set", text)]
    done = CliRunner().invoke(app, [*words, *more, "--no-pictures"])
    assert done.exit_code in (0, 3), done.output
    assert len(seen) >= 10
    assert seen == sorted(seen)
    assert not watched[0]["isSoFar"]


def test_several_cases_are_not_watched(tmp_path: Path):
    words = ["run", "network_edc", "pulley_edc", "--watch", "--out", str(tmp_path)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 2
    assert "one case" in done.output
