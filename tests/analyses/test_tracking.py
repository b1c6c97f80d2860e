"""A finger that is moved forward along a motion."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import cosim
from cosim.analyses.estimate import tracking
from cosim.analyses.estimate.joint_motion import JointMotion, read_motion
from cosim.analyses.estimate.of_case import setup
from cosim.analyses.estimate.tracking import Planner, Tracking, WantedMotion, forward_case
from cosim.case.file import resolved_toml
from cosim.cli import app
from cosim.coupling.motion import CoupledMotion
from cosim.errors import ConvergenceError, InputError

FREE = {
    "finger.tip.kind": "free",
    "finger.passive": {
        joint: {"stiffness": "0.03 N*m/rad", "rest": "posture", "damping": "0.002 N*m*s/rad"}
        for joint in ("MCP", "MCP_abduction", "PIP", "DIP")
    },
    "forward": {"step": "2 ms", "duration": "0.1 s", "must_rest": False},
    "finger.limit.half_range": "60 deg",
}


@pytest.fixture
def flexion(tmp_path):
    """MCP, PIP and DIP turn by 10, 20 and 8 deg in 0.2 s, from and to rest."""
    time = np.linspace(0.0, 0.2, 41)
    s = np.clip(time / 0.2, 0, 1)
    part = s**3 * (10 - 15 * s + 6 * s**2)
    path = tmp_path / "flexion.csv"
    turns = {"MCP_deg": 30 + 10 * part, "PIP_deg": 45 + 20 * part, "DIP_deg": 15 + 8 * part}
    pd.DataFrame({"time": 3.0 + time, **turns}).to_csv(path, index=False)
    return path


@cache
def finger_setup(name):
    return setup(cosim.load(name).replace(FREE), "pcsa", 2, {}, {})


@settings(max_examples=30)
@given(
    error=st.lists(st.floats(-0.2, 0.2), min_size=4, max_size=4),
    slope=st.lists(st.floats(-3.0, 3.0), min_size=4, max_size=4),
    first=st.floats(1e-3, 0.05),
    second=st.floats(1e-3, 0.05),
)
def test_a_plan_is_the_way_of_a_critically_damped_error(error, slope, first, second):
    """From any point of the way the rest of it is the same, and rates are slopes of angles."""
    time = np.linspace(0.0, 0.2, 21)
    still = pd.DataFrame({"time": time, "PIP_deg": 45 + 0 * time})
    s = finger_setup("split_edc")
    angle = np.tile(list(s.models.posture.values()), (len(time), 1))
    motion = JointMotion(still.time.to_numpy(), angle, 0 * angle, 0 * angle)
    planner = Planner(s, WantedMotion(motion), 20.0)
    begun = angle[0] + error, np.array(slope)
    whole = planner.plan(*begun, 0.0, first + second)
    half = planner.plan(*begun, 0.0, first)
    rest = planner.plan(half.angle, half.rate, first, second)
    for a, b in zip(whole, rest, strict=True):
        assert a == pytest.approx(b, abs=1e-9)
    h = 1e-6
    after, before = (planner.plan(*begun, 0.0, first + d) for d in (h, -h))
    assert half.rate == pytest.approx((after.angle - before.angle) / (2 * h), abs=1e-6)
    assert half.acceleration == pytest.approx((after.rate - before.rate) / (2 * h), abs=1e-4)


@pytest.mark.parametrize(
    "name", ["split_edc", "pulley_edc", pytest.param("network_edc", marks=pytest.mark.slow)]
)
def test_a_motion_is_followed_with_tensions_in_bounds_and_again_by_the_case_alone(
    name, flexion, tmp_path
):
    """The motion begins at 3 s, and what DIP torque lacks costs a part of a degree."""
    case = cosim.load(name).replace(FREE)
    forward = cosim.track(case, flexion, tmp_path)
    folder = tmp_path / name
    summary = json.loads((folder / "estimate.json").read_text())
    assert max(summary["angle_rms_deg"].values()) < 1.0
    assert summary["audit"]["strays_alone_deg"] < 1e-3
    bounds = summary["bounds_N"]
    for tendon, most in summary["largest_tension_N"].items():
        assert bounds[tendon][0] <= most <= bounds[tendon][1]
    data = cosim.run(forward.replace({"output.picture": False})).data
    kept = pd.read_csv(folder / "estimate.csv")
    angles = np.degrees(data.angle.to_numpy()) if data.angle.attrs["units"] == "rad" else data.angle
    assert np.asarray(angles)[:, 2] == pytest.approx(kept.PIP_deg.to_numpy(), abs=1e-6)
    assert kept.PIP_wanted_deg.iloc[-1] == pytest.approx(65.0)


def test_the_case_begins_where_the_motion_does_and_keeps_its_springs(flexion):
    case = cosim.load("split_edc").replace(
        {**FREE, "finger.posture.PIP": "50 deg", "finger.passive.PIP.rest": "posture"}
    )
    joints = ("MCP", "MCP_abduction", "PIP", "DIP")
    motion = read_motion(flexion, joints, case.finger.posture.angles())
    forward = forward_case(case, motion, joints, ("FDP",))
    assert pytest.approx(np.radians(45)) == forward.finger.posture.PIP
    assert forward.finger.passive["PIP"].rest == pytest.approx(np.radians(50))
    assert (forward.tendons["FDP"].tension, forward.tendons["EDC"].activation) == (1.0, 0.1)
    assert (forward.forward.duration, forward.forward.step) == pytest.approx((0.2, 0.002))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"finger.tip.kind": "point"}, 'is "point".* Write finger.tip.kind = "free"'),
        ({"finger.limit.half_range": "5 deg"}, 'turns PIP by 20 deg; write for example "30 deg"'),
    ],
)
def test_a_finger_that_cannot_follow_is_refused(change, said, flexion, tmp_path):
    with pytest.raises(InputError, match=said):
        cosim.track(cosim.load("split_edc").replace({**FREE, **change}), flexion, tmp_path)
    assert not (tmp_path / "split_edc").exists()


def test_all_that_a_motion_forward_lacks_is_told_at_once(tmp_path):
    path = tmp_path / "far.csv"
    pd.DataFrame({"time": np.linspace(0, 0.1, 5), "PIP_deg": np.linspace(45, 125, 5)}).to_csv(
        path, index=False
    )
    words = ["estimate", "robot_pulleys_extensor", "--motion", str(path), "--forward"]
    told = CliRunner().invoke(app, [*words, "--cost", "cubic", "--out", str(tmp_path)])
    assert told.exit_code == 2
    text = " ".join(told.output.split())
    for said in (
        "the quadratic cost alone",
        "PIP is at 125 deg, outside",
        'Write finger.tip.kind = "free"',
        "finger.limit.half_range: holds every joint within",
        '--area extensor="2 cm**2" --area dip_flexor="2 cm**2"',
    ):
        assert said in text
    with pytest.raises(InputError, match=r"is \"point\".*half_range.*no area is known"):
        cosim.track("robot_pulleys_extensor", path, tmp_path)


def test_only_the_quadratic_cost_follows_a_motion(flexion, tmp_path):
    words = ["estimate", "split_edc", "--set", 'finger.tip.kind="free"', "--motion", str(flexion)]
    words += ["--forward", "--cost", "cubic", "--out", str(tmp_path)]
    told = CliRunner().invoke(app, words)
    assert told.exit_code == 2
    assert "the quadratic cost alone" in told.output


def test_forward_belongs_to_a_motion():
    told = CliRunner().invoke(app, ["estimate", "split_edc", "--forward"])
    assert told.exit_code == 2
    assert "belong to --motion" in told.output


@pytest.mark.parametrize(
    ("rate", "where"), [(400, "0.17 s .* 113 deg"), (-400, "0.12 s .* -3 deg")]
)
def test_angles_out_of_range_are_told_with_their_time(tmp_path, rate, where):
    time = np.linspace(0.0, 0.2, 21)
    path = tmp_path / "far.csv"
    pd.DataFrame({"time": time, "PIP_deg": 45 + rate * time}).to_csv(path, index=False)
    with pytest.raises(InputError, match=f"at {where}, outside"):
        cosim.track(cosim.load("split_edc").replace(FREE), path, tmp_path)


def test_a_finger_without_mass_is_refused(flexion, tmp_path):
    case = cosim.load("own_pulleys_fdp").replace({"finger.tip.kind": "free"})
    areas = dict.fromkeys(("FDP",), "2 cm**2")
    options = [f'--area={name}="{area}"' for name, area in areas.items()]
    (tmp_path / "own.toml").write_text(resolved_toml(case), encoding="utf-8")
    words = ["estimate", str(tmp_path / "own.toml"), "--motion", str(flexion), "--forward"]
    told = CliRunner().invoke(app, [*words, *options, "--out", str(tmp_path / "out")])
    assert told.exit_code == 2
    assert "needs mass" in told.output


def test_a_motion_that_is_not_followed_misses_the_audit(tmp_path):
    """A jump of 40 deg in 5 ms."""
    time = np.linspace(0.0, 0.1, 21)
    path = tmp_path / "jump.csv"
    turns = {"time": time, "PIP_deg": np.where(time < 0.05, 40.0, 80.0)}
    pd.DataFrame(turns).to_csv(path, index=False)
    with pytest.warns(UserWarning, match="the finger does not follow: a joint is"):
        cosim.track(cosim.load("split_edc").replace(FREE), path, tmp_path)
    summary = json.loads((tmp_path / "split_edc" / "estimate.json").read_text(encoding="utf-8"))
    assert summary["audit"]["missed"]
    assert summary["audit"]["largest_torque_lacking_Nmm"] is not None


def test_a_finger_that_strays_under_the_tensions_alone_misses_the_audit(flexion, tmp_path):
    """Springs that push the joints away from where they are, over thrice the time."""
    table = pd.read_csv(flexion)
    slow = tmp_path / "slow.csv"
    table.assign(time=3 * (table.time - 3.0)).to_csv(slow, index=False)
    ends = [["-90 deg", "-0.04 N*m"], ["140 deg", "0.04 N*m"]]
    away = {joint: {"curve": ends, "damping": "0.002 N*m*s/rad"} for joint in ("MCP", "PIP", "DIP")}
    case = cosim.load("split_edc").replace(FREE).replace({"finger.passive": away})
    with pytest.warns(UserWarning, match="larger by a millionth they lead a joint") as told:
        cosim.track(case, slow, tmp_path)
    assert len(told) == 1  # it follows where plans correct it


@pytest.mark.parametrize(
    ("off", "astray", "doubts"),
    [
        (1.99, 0.49, []),
        (2.01, 0.49, ["a joint is 2 deg off"]),
        (1.99, 0.51, ["lead a joint 0.51 deg astray"]),
        (0.0, np.inf, ["lead a joint inf deg astray"]),
        (3.0, 2.0, ["a joint is 3 deg off", "lead a joint 2 deg astray"]),
    ],
)
def test_beyond_two_degrees_it_does_not_follow_and_beyond_half_a_degree_it_strays(
    off, astray, doubts
):
    """One of two joints, in degrees."""
    time, still = np.linspace(0.0, 1.0, 3), np.zeros((3, 2))
    angle = still + np.radians([0.0, off])
    motion, tension = JointMotion(time, still, still, still), np.ones((3, 1))
    seen = Tracking(motion, time, tension, 0.0, time, angle, still, np.radians(astray), 1)
    faults = seen.faults()
    assert len(faults) == len(doubts)
    assert all(doubt in fault for doubt, fault in zip(doubts, faults, strict=True))


@pytest.mark.parametrize("reached", [0.06, 0.0])
def test_a_motion_that_cannot_go_on_keeps_what_it_reached(flexion, tmp_path, monkeypatch, reached):
    """A step that is not made, in the seventh interval and in the first."""
    advance = CoupledMotion.advance

    def fail(self, at, *rest):
        if at.coupled.time > reached + 1e-3:
            raise ConvergenceError("no equilibrium")
        return advance(self, at, *rest)

    monkeypatch.setattr(CoupledMotion, "advance", fail)
    case = tmp_path / "free.toml"
    case.write_text(resolved_toml(cosim.load("split_edc").replace(FREE)), encoding="utf-8")
    words = ["estimate", str(case), "--motion", str(flexion), "--forward", "--out", str(tmp_path)]
    told = CliRunner().invoke(app, words)
    assert told.exit_code == 1
    assert f"at {reached:g} s of the motion, run forward: no equilibrium" in told.output
    folder = tmp_path / "free"
    assert folder.exists() == (reached > 0.0)
    if not reached:
        return
    assert "0.06 of 0.2 s are kept in" in told.output
    summary = json.loads((folder / "estimate.json").read_text(encoding="utf-8"))
    assert "no equilibrium" in summary["audit"]["stopped"]
    pulled = pd.read_csv(folder / "forward_tensions.csv").iloc[:, 0]
    assert pulled.iloc[-1] == pytest.approx(0.06)  # not those of the interval that had no end
    monkeypatch.undo()
    again = cosim.run(cosim.load(folder / "free_forward.toml"))
    angles = pd.read_csv(folder / "estimate.csv")
    assert float(again.data.time[-1]) == pytest.approx(0.06)
    assert angles["PIP_deg"].to_numpy()[-1] == pytest.approx(again.summary["posture_deg"]["PIP"])


@pytest.mark.parametrize("states", [101, 100])
def test_a_way_that_the_tensions_alone_do_not_end_is_infinitely_astray(
    flexion, states, monkeypatch
):
    """The way under the tensions alone is put in place: a straight finger, to the end or nearly."""
    s = finger_setup("split_edc")
    motion = read_motion(flexion, s.models.finger.joints, s.models.posture)
    pulled = []

    def alone(s, times, tension, steps):
        pulled.append(tension)
        return np.zeros((states, len(motion.angle[0])))

    monkeypatch.setattr(tracking, "_alone", alone)
    found = tracking.track(tracking.start_of(s, motion), motion, lambda text: None)
    assert pulled[0] == pytest.approx((1 + 1e-6) * found.tension, rel=1e-12)
    assert len(found.angle) == 101
    assert found.astray == (np.abs(found.angle).max() if states == 101 else np.inf)
