"""The state that the tabs share: the newest change is solved, what failed is no result."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from threading import Event
from typing import Any

import pytest

from cosim.case.file import load_case
from cosim.errors import ConvergenceError, InputError, ResidualText, StoppedError
from cosim.processes import ProcessEndedError
from cosim.results.read import read_run
from cosim.ui import solving
from cosim.ui.desk import MOST_TEXT, Desk
from tests.helpers.hang import HANG

FLEXION = "finger.posture.PIP"


class HeldProcess:
    """In place of a process: it does its work in the thread that asks, once it is let; `solved`:
    the cases that it did to the end."""

    def __init__(self) -> None:
        self.solved: list[Any] = []
        self.starts: list[str] = []
        self.goes_on, self.begun, self.stops = Event(), Event(), Event()
        self.goes_on.set()
        self.change: Callable[[Any], Any] = lambda answer: answer
        self.memory: dict[str, Any] = {}

    def call(self, do: Any, task: Any, case: Any, start: str, hear: Any) -> Any:
        self.stops.clear()
        self.starts.append(start)
        self.begun.set()
        hear("building the models")
        while not self.goes_on.wait(0.005):
            if self.stops.is_set():
                raise StoppedError("the call was interrupted")
        self.solved.append(case)
        return self.change(task(self.memory, case, start))

    def interrupt(self) -> None:
        self.stops.set()

    def end_call(self) -> None:
        self.stops.set()

    def kill(self) -> None:
        self.stops.set()

    def end(self) -> None:
        pass


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> HeldProcess:
    process = HeldProcess()
    monkeypatch.setattr(solving, "WorkerProcess", lambda: process)
    monkeypatch.setattr(solving, "CALM", 0.01)
    return process


@pytest.fixture
def desk(held: HeldProcess, tmp_path: Path) -> Iterator[Desk]:
    made = Desk(load_case("network_edc"), tmp_path / "runs")
    yield made
    made.close()


def settled(desk: Desk, checked: bool = True) -> dict[str, Any]:
    """The state once nothing is solved any more."""
    end = time.monotonic() + HANG
    while time.monotonic() < end:
        state = desk.state()
        answer = state["answer"]
        is_sure = answer and (answer["isChecked"] or answer["note"] or not answer["isCurrent"])
        if state["status"] != "solving" and (not checked or state["status"] != "done" or is_sure):
            return state
        time.sleep(0.005)
    raise AssertionError(desk.state())


def strip(state: dict[str, Any], path: str = "fingertip_magnitude_N") -> dict[str, Any]:
    return next(row for row in state["strip"] if row["path"] == path)


def test_of_many_changes_the_newest_alone_is_solved(desk, held):
    settled(desk)
    held.goes_on.clear()
    held.begun.clear()
    desk.change(FLEXION, "40 deg")
    assert held.begun.wait(10)
    before = len(held.solved)
    for angle in range(41, 91):
        desk.change(FLEXION, f"{angle} deg")
    assert desk.state()["status"] == "solving"
    held.goes_on.set()
    state = settled(desk)
    assert state["status"] == "done"
    assert state["changes"] == {FLEXION: "90 deg"}
    asked = held.solved[before:]
    assert len(asked) <= 4  # one that was begun, the newest, and its check
    assert pytest.approx(1.5708, abs=1e-3) == asked[-1].finger.posture.PIP
    assert state["answer"]["label"] == "network_edc: PIP flexion 90 deg"


def test_an_answer_is_checked_from_rest_and_another_equilibrium_is_said(desk, held):
    state = settled(desk)
    assert state["answer"]["isChecked"]
    assert not state["answer"]["note"]
    assert held.starts == ["nearby", "from rest"]

    def other(answer: Any) -> Any:
        if held.starts[-1] == "nearby":
            return answer
        summary = dict(answer.result.summary)
        force = {k: 2 * v + 0.1 for k, v in answer.result.tip_force.items()}
        data = answer.result.data.copy()
        data["tip_force"] = 2 * data.tip_force + 0.1
        result = replace(answer.result, summary={**summary, "fingertip_force_N": force})
        result.__dict__["data"] = data
        return replace(answer, result=result)

    held.change = other
    desk.change(FLEXION, "50 deg")
    assert "more than one equilibrium" in settled(desk)["answer"]["note"]


def test_a_fault_is_said_at_its_slider_and_nothing_is_solved(desk, held):
    before = settled(desk)
    solved = len(held.solved)
    desk.change(FLEXION, "50 kg")
    state = settled(desk)
    assert state["status"] == "at fault"
    assert len(held.solved) == solved
    assert "`kg` is no unit of angle" in state["faults"][FLEXION][0]
    assert not state["answer"]["isCurrent"]
    assert state["strip"] == before["strip"]
    with pytest.raises(InputError, match="no result of what the controls say"):
        desk.save()
    desk.change(FLEXION, "50 deg")
    assert settled(desk)["status"] == "done"
    assert not desk.state()["faults"]


def test_a_straight_finger_held_at_its_tip_is_a_fault_of_its_posture(desk):
    settled(desk)
    for key in (FLEXION, "finger.posture.DIP"):
        desk.change(key, "0 deg")
    state = settled(desk)
    assert state["status"] == "at fault"
    said = [*state["otherFaults"], *(text for texts in state["faults"].values() for text in texts)]
    assert any("straight finger" in text for text in said)


def test_a_solve_without_end_is_no_result_and_says_what_to_try(desk, held):
    before = settled(desk)

    def fail(answer: Any) -> Any:
        raise ConvergenceError("hood and finger did not agree in 50 rounds.")

    held.change = fail
    desk.change(FLEXION, "60 deg")
    state = settled(desk)
    assert state["status"] == "failed"
    assert "smaller steps" in state["error"]
    assert state["strip"] == before["strip"]
    assert not state["answer"]["isCurrent"]


def test_a_process_that_dies_is_said_and_the_page_goes_on(desk, held):
    settled(desk)

    def die(answer: Any) -> Any:
        raise ProcessEndedError.of(-9)

    held.change = die
    desk.change(FLEXION, "60 deg")
    assert "signal 9" in settled(desk)["error"]
    held.change = lambda answer: answer
    desk.change(FLEXION, "61 deg")
    assert settled(desk)["status"] == "done"


def test_a_pinned_run_stands_beside_those_that_follow(desk):
    first = strip(settled(desk))["now"]
    desk.pin()
    desk.change("tendons.EDC.activation", "0.2")
    state = settled(desk)
    row = strip(state)
    assert row["pinned"] == first
    assert row["now"] > first
    assert state["pin"] == "network_edc: as it is"
    assert len(desk.drawn()["views"]) == 2
    desk.unpin()
    assert len(desk.drawn()["views"]) == 1
    assert strip(desk.state())["pinned"] is None


def test_a_run_is_saved_under_a_name_that_is_free(desk, tmp_path):
    (tmp_path / "runs" / "network_edc_changed").mkdir(parents=True)
    desk.change(FLEXION, "50 deg")
    settled(desk)
    assert "network_edc_changed_2" in desk.save()
    run = read_run(tmp_path / "runs" / "network_edc_changed_2")
    assert run.summary["posture_deg"]["PIP"] == pytest.approx(50, abs=3)
    assert run.case == "network_edc_changed_2"


def test_the_saved_case_is_the_one_that_is_shown(desk, tmp_path):
    changes = {FLEXION: "50 deg", "lesion.cut.central_slip": "true"}
    for key, text in changes.items():
        desk.change(key, text)
    name, text = desk.case_text()
    assert name == "network_edc_changed"
    assert 'extends = "network_edc"' in text
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    case = load_case(tmp_path / "mine.toml")
    assert pytest.approx(0.87266, abs=1e-4) == case.finger.posture.PIP
    assert case.lesion.cut == ("central_slip",)


def test_a_case_with_settings_on_top_is_saved_whole(held, tmp_path):
    desk = Desk(load_case("network_edc", ["finger.posture.DIP=20 deg"]), tmp_path)
    desk.change(FLEXION, "50 deg")
    text = desk.case_text()[1]
    desk.close()
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    posture = load_case(tmp_path / "mine.toml").finger.posture
    assert pytest.approx((0.872665, 0.349066), abs=1e-5) == (posture.PIP, posture.DIP)


def test_another_hood_keeps_the_changes_that_both_have(desk):
    desk.change(FLEXION, "50 deg")
    desk.choose_hood("split")
    state = settled(desk)
    assert state["rung"] == "split"
    assert state["changes"] == {FLEXION: "50 deg"}
    assert "split" in desk.case_text()[1]
    with pytest.raises(InputError, match="no hood of the ladder"):
        desk.choose_hood("sponge")


def test_while_a_slider_moves_the_reduced_hood_is_shown_and_the_full_one_when_it_rests(
    held, tmp_path
):
    desk = Desk(load_case("network_edc"), tmp_path, reduced=load_case("pulley_edc"))
    try:
        settled(desk)
        desk.change(FLEXION, "50 deg", is_drag=True)
        state = settled(desk, checked=False)
        assert state["answer"]["isReduced"]
        assert held.solved[-1].hood.kind == "pulley"
        with pytest.raises(InputError):
            desk.save()
        desk.change(FLEXION, "50 deg")
        state = settled(desk)
        assert not state["answer"]["isReduced"]
        assert held.solved[-1].hood.kind == "network"
    finally:
        desk.close()


def test_a_motion_is_solved_when_it_is_asked_for(desk, held):
    settled(desk)
    solved = len(held.solved)
    desk.open_packaged("motion_edc_fdp")
    state = settled(desk)
    assert state["status"] == "waiting"
    assert len(held.solved) == solved
    assert state["isMotion"]
    held.goes_on.clear()
    desk.solve()
    assert desk.state()["status"] == "solving"
    desk.stop()
    assert settled(desk)["status"] == "stopped"


def test_a_case_that_is_sent_is_opened_or_its_faults_are_said(desk):
    desk.open_text("mine.toml", 'extends = "pulley_edc"\ntitle = "<b>mine</b>"\n')
    state = settled(desk)
    assert (state["case"], state["title"]) == ("mine", "<b>mine</b>")
    for name, text, words in (
        ("a.toml", "title = ", "not valid TOML"),
        ("a.toml", 'extends = "pulley_edc"\ntytle = "x"', "did you mean title"),
        ("..", "", "expected a name"),
        ("a.toml", 'extends = "pulley_edc"\n#' + MOST_TEXT * "x", "a: is larger than a case file"),
    ):
        with pytest.raises(InputError, match=words):
            desk.open_text(name, text)
    assert desk.state()["case"] == "mine"


def test_no_key_but_that_of_a_control_is_taken(desk):
    for key in ("hood.mesh.path", "finger.path", "solve.tolerance", "title"):
        with pytest.raises(InputError, match="no control"):
            desk.change(key, "/etc/passwd")


def test_a_run_that_is_watched_shows_its_residuals_and_its_end(tmp_path):
    desk = Desk(load_case("network_edc"), tmp_path, is_live=False)
    desk.hear(ResidualText("a line in any words", 1e-3, "unloaded"))
    desk.hear(ResidualText("another", 2.5e-6))
    desk.hear("loaded: relative residual 1.0e-03")  # no residual, whatever it says
    state = desk.state()
    assert state["residuals"] == [("unloaded", 1e-3), ("", 2.5e-6)]
    assert not state["isLive"]
    with pytest.raises(InputError, match="watches a run"):
        desk.change(FLEXION, "50 deg")
    desk.fail(ConvergenceError("no equilibrium"))
    assert desk.state()["status"] == "failed"
    desk.close()
