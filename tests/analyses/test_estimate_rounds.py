"""The rounds of an estimate on hoods of one line, whose answers are known: whole steps that swing
for ever, a demand beyond the greatest torque, a motion that stops on its way."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from cosim.analyses.estimate import of_case
from cosim.analyses.estimate.demand import Demand
from cosim.analyses.estimate.held_finger import Torques
from cosim.analyses.estimate.joint_motion import JointMotion
from cosim.analyses.estimate.of_case import for_motion, setup
from cosim.analyses.estimate.tensions import Bounds, Cost, estimate
from cosim.case.file import load_case
from cosim.cli import app
from cosim.errors import ConvergenceError, InputError

BOUNDS, COST = Bounds(np.full(2, 0.05), np.full(2, 10.0)), Cost(np.ones(2), 2)
ONE = Demand(("PIP",), "N m", np.eye(1), np.eye(1), np.zeros(1))


@dataclass
class OneJoint:
    """A joint whose torque is a function of the first tension, and a millionth of the second."""

    torque: object
    slope: object
    solves: list[float] = field(default_factory=list)
    names = ("A", "B")

    def begin(self):
        return None

    def at(self, tension, state):
        self.solves.append(float(tension[0]))
        value = np.array([self.torque(tension[0]) + 1e-6 * tension[1]])
        by_tension = np.array([[self.slope(tension[0]), 1e-6]])
        return Torques(value, by_tension, state, None, np.zeros((0, 0)))


SWINGS = OneJoint(lambda t: np.arctan(4 * (t - 3)), lambda t: 4 / (1 + 16 * (t - 3) ** 2))
PEAK = OneJoint(lambda t: t * np.exp(-t / 4), lambda t: (1 - t / 4) * np.exp(-t / 4))


@pytest.mark.parametrize("wanted", [0.0, 0.3, -0.7])
@pytest.mark.parametrize("begin", [0.05, 9.0])
def test_where_whole_steps_swing_the_root_is_found(wanted, begin):
    """Newton's steps on an arc tangent lead ever further off."""
    SWINGS.solves.clear()
    start = np.array([begin, 0.05]), None
    found = estimate(SWINGS, ONE, np.array([wanted]), BOUNDS, COST, start)
    assert found.tension[0] == pytest.approx(3 + np.tan(wanted) / 4, rel=1e-5)
    assert len(SWINGS.solves) < 30


def test_beyond_the_greatest_torque_the_nearest_is_told_and_taken_with_a_reserve():
    """t exp(-t / 4) has its maximum 4 / e at t = 4, where no slope leads to more."""
    PEAK.solves.clear()
    with pytest.raises(InputError, match=r"The nearest that they make is PIP 147[12]"):
        estimate(PEAK, ONE, np.array([2.0]), BOUNDS, COST)
    assert len(PEAK.solves) < 30
    found = estimate(PEAK, ONE, np.array([2.0]), BOUNDS, COST, reserve=0.6)
    assert found.components == pytest.approx([4 / np.e], rel=1e-3)
    assert found.tension[0] == pytest.approx(4.0, abs=0.3)


def a_motion(times: int) -> JointMotion:
    nothing = np.zeros((times, 4))
    angle = np.radians([[30.0, 0.0, 40.0 + k, 15.0] for k in range(times)])
    return JointMotion(np.linspace(0, 1, times), angle, nothing, nothing)


def stop_at(monkeypatch, time: int, error: BaseException) -> None:
    """Let the estimate fail at the time of that number."""
    calls, cheapest = [0], of_case.cheapest

    def failing(*words):
        calls[0] += 1
        if calls[0] > time:
            raise error
        return cheapest(*words)

    monkeypatch.setattr(of_case, "cheapest", failing)


@pytest.mark.parametrize("kind", [InputError, ConvergenceError, KeyboardInterrupt])
def test_a_motion_keeps_what_it_reached_and_says_where_it_stopped(monkeypatch, kind):
    s = setup(load_case("split_edc"), "pcsa", 2, {}, {})
    said: list[str] = []
    whole = for_motion(s, a_motion(5), said.append)
    stop_at(monkeypatch, 3, kind("out of reach"))
    part = for_motion(s, a_motion(5), said.append)
    assert len(part.tension) == len(part.motion.time) == 3
    assert part.tension.tolist() == whole.tension[:3].tolist()
    assert isinstance(part.stopped, kind)
    if kind is not KeyboardInterrupt:
        assert "at 0.75 s of the motion: out of reach" in str(part.stopped)
    stop_at(monkeypatch, 0, kind("out of reach"))
    with pytest.raises(kind):
        for_motion(s, a_motion(5), said.append)


def test_the_most_hood_solves_of_a_time_and_its_patience_are_said_first():
    said: list[str] = []
    case = load_case("split_edc", ['solve.patience="5 min"'])
    for_motion(setup(case, "pcsa", 2, {}, {}), a_motion(4), said.append)
    assert said[0] == "4 times, at most 40 hood solves each, and 5 min (solve.patience)"


def test_a_time_without_an_answer_ends_when_its_patience_is_over(monkeypatch):
    """Patience counts from each time anew."""
    from cosim import errors

    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(errors.time, "monotonic", lambda: clock.now)
    s = setup(load_case("split_edc", ['solve.patience="5 s"']), "pcsa", 2, {}, {})
    calls, cheapest = [0], of_case.cheapest

    def slow(*words):
        calls[0] += 1
        for _ in range(9 if calls[0] == 3 else 4):
            clock.now += 1.0
            errors.pulse("round")
        return cheapest(*words)

    monkeypatch.setattr(of_case, "cheapest", slow)
    part = for_motion(s, a_motion(5), lambda _: None)
    assert len(part.tension) == 2
    assert "solve.patience was over" in str(part.stopped)


def test_the_command_keeps_the_times_before_the_one_that_fails(tmp_path, monkeypatch):
    pd.DataFrame({"time": np.linspace(0, 1, 5), "PIP_deg": 40.0 + np.arange(5)}).to_csv(
        tmp_path / "motion.csv", index=False
    )
    stop_at(monkeypatch, 3, ConvergenceError("no equilibrium"))
    words = ["estimate", "split_edc", "--motion", tmp_path / "motion.csv", "-o", tmp_path]
    done = CliRunner().invoke(app, [*map(str, words)])
    assert done.exit_code == 1
    assert "at 0.75 s of the motion: no equilibrium" in done.output
    assert "3 of 5 times are kept in" in done.output
    assert len(pd.read_csv(tmp_path / "split_edc" / "estimate.csv")) == 3
    audit = json.loads((tmp_path / "split_edc" / "estimate.json").read_text())["audit"]
    assert "at 0.75 s of the motion" in audit["stopped"]


def test_at_a_kink_that_makes_the_torque_the_cheapest_tensions_are_found():
    """The first tendon's arm falls from 4 to 0.4 at 1.8 N: by the first the cheapest tensions of
    the torque are at 1.93 N, by the second at 0.59 N, each beyond the kink, and so it is there."""

    class Kink(OneJoint):
        def at(self, tension, state):
            self.solves.append(float(tension[0]))
            slope = 4.0 if tension[0] < 1.8 else 0.4
            value = slope * (tension[0] - 1.8) + tension[1]
            return Torques(
                np.array([value]), np.array([[slope, 1.0]]), state, None, np.zeros((0, 0))
            )

    found = estimate(hood := Kink(None, None), ONE, np.array([1.0]), BOUNDS, COST)
    assert found.components == pytest.approx([1.0], abs=1e-6)
    assert found.tension == pytest.approx([1.8, 1.0], abs=2e-3)
    assert len(hood.solves) < 35
