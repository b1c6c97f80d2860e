"""Muscles' tensions from forces, torques and motions, with several hoods behind them."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from cases.papers.models.buchner1988.flexion import curve_motion, torques
from cases.papers.models.buchner1988.force_sharing import linear
from cosim.analyses.estimate.capacity import capacity
from cosim.analyses.estimate.demand import force_demand, torque_demand
from cosim.analyses.estimate.feasible import force_set
from cosim.analyses.estimate.joint_motion import read_motion
from cosim.analyses.estimate.of_case import for_force, for_motion, for_torques, parse_force, setup
from cosim.analyses.estimate.tensions import Bounds, Cost, estimate, linearise, nearest
from cosim.case.file import load_case
from cosim.cli import app
from cosim.errors import InputError, ReadingWarning
from cosim.port import AXES
from cosim.solve.solvers import solve
from rigid.chain.planar_chain import BUCHNER
from rigid.hoods.two_band import two_band
from rigid.mujoco.finger import needed_torque
from rigid.muscle.least_cost import least

CLAMPED = 'finger.tip.kind="clamped"'
NO_SPRINGS = [f'finger.passive.{j}.stiffness="0 N*m/rad"' for j in ("MCP", "PIP", "DIP")]
HALF = np.array([[0.5, 0, 0, 0, 0]] * 2)


@cache
def estimate_setup(name, *settings, weights="pcsa", power=2, most=()):
    return setup(load_case(name, list(settings)), weights, power, {}, dict(most))


def silent(text):
    return None


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("split_edc", ()),
        ("two_band_edc", ()),
        ("two_band_edc", ('finger.posture.DIP="25 deg"',)),
        ("pulley_edc", ()),
    ],
)
def test_torques_by_tension_are_slopes(name, settings):
    s = estimate_setup(name, *settings)
    held = s.hold_finger(s.models.posture)
    tension = np.linspace(2.0, 6.0, len(held.names))
    at, step = held.at(tension, held.begin()), 1e-4
    for k in range(len(tension)):
        ends = [held.at(tension + d * np.eye(len(tension))[k], at.state) for d in (step, -step)]
        slope = (ends[0].torque - ends[1].torque) / (2 * step)
        assert at.by_tension[:, k] == pytest.approx(slope, abs=1e-9)


@pytest.mark.parametrize("power", [1, 2, 3])
def test_where_no_choice_is_left_the_tensions_of_a_forward_run_come_back(power):
    """A clamped fingertip asks for three torques; three muscles are left to make them."""
    stated = {"FDP": 9.0, "FDIm": 4.0, "EDC": 7.0}
    settings = [f'tendons.{n}={{tension="{t} N"}}' for n, t in stated.items()]
    settings += [CLAMPED, 'solve.resting_tension="0 N"']
    _, states = solve(load_case("split_edc", settings))
    force = states.loaded.balance.tip_force
    others = [(n, 0.0) for n in ("EI", "LUM", "FPI", "FDS", "FDIl")]
    s = estimate_setup("split_edc", CLAMPED, power=power, most=tuple(others))
    answer = for_force(s, tuple(force), silent)
    found = dict(zip(s.capacity.names, answer.estimate.tension, strict=True))
    assert {n: found[n] for n in stated} == pytest.approx(stated, rel=1e-6)
    assert all(found[n] == 0.0 for n, _ in others)


@pytest.mark.parametrize(
    ("name", "settings", "force"),
    [
        ("split_edc", (), (-1.0, 0.0, -2.0)),
        ("split_edc", (CLAMPED,), (-1.0, 0.3, -2.0)),
        ("middle_minorflex_edc", (), (-1.0, 0.0, -1.0)),
        ("network_edc", ('finger.posture.PIP="60 deg"',), (-0.5, None, -0.5)),
        ("two_band_edc", (CLAMPED,), (-0.5, 0.0, -1.0)),
        ("two_band_edc", (CLAMPED, 'finger.posture.DIP="14 deg"'), (-0.5, 0.0, -1.0)),
    ],
)
def test_a_force_is_made_by_the_case_run_forward(name, settings, force):
    s = estimate_setup(name, *settings)
    answer = for_force(s, force, silent)
    wanted = [v for a, v in zip(AXES, force, strict=True) if a in answer.demand.names]
    assert answer.estimate.components == pytest.approx(wanted, abs=1e-6)
    assert answer.audit.components == pytest.approx(wanted, abs=1e-6)
    assert np.abs(answer.audit.joint_change).max() < 1e-6
    assert answer.estimate.optimum.miss < 1e-7
    low, high = s.bounds
    assert (answer.estimate.tension >= low).all()
    assert (answer.estimate.tension <= high).all()


@pytest.mark.slow
def test_a_sheet_is_linearised_until_it_makes_the_force():
    """The hood's own equilibrium at the tensions found, solved anew from its start."""
    s = estimate_setup("isometric_edc", CLAMPED, "hood.mesh.quads=120")
    answer = for_force(s, (-0.5, 0.0, -0.8), silent)
    assert 3 <= answer.estimate.rounds <= 15
    assert answer.audit.components == pytest.approx([-0.5, 0.0, -0.8], abs=1e-6)
    assert answer.estimate.gap < 1e-6


def test_torques_are_made_and_those_not_named_are_none():
    s = estimate_setup("split_edc")
    answer = for_torques(s, {"MCP_flexion": 0.1, "PIP": 0.05}, silent)
    assert answer.audit.components == pytest.approx([0.1, 0.0, 0.05, 0.0], abs=1e-9)
    with pytest.raises(InputError, match="unknown joint"):
        for_torques(s, {"wrist": 0.1}, silent)


def test_costs_and_weights_steer():
    """The FDI's heads, alike but for their areas, share by them: with p by T ~ w^(p / (p - 1))."""
    settings, areas = load_case("split_edc"), {"FDIm": 3e-4, "FDIl": 1e-4}
    for power, ratio in ((2, 9.0), (3, 3.0**1.5)):
        s = setup(settings, "pcsa", power, areas, {})
        tension = for_force(s, (-1.0, 0.0, -2.0), silent).estimate.tension
        both = dict(zip(s.capacity.names, tension, strict=True))
        assert both["FDIm"] == pytest.approx(ratio * both["FDIl"], rel=1e-4)


def test_a_motion_over_two_bands_takes_what_the_linear_programme_says():
    """With the bands' shares fixed by the hood no choice is left but the paper's; its torques come
    from another dynamics, and its bands from equations."""
    s = estimate_setup("two_band_edc", *NO_SPRINGS, weights="one", power=1)
    time = np.linspace(0.0, 1.0, 401)
    angle, rate, acceleration = curve_motion(time)
    from cosim.analyses.estimate.joint_motion import JointMotion

    few = slice(0, None, 80)
    motion = JointMotion(time[few], angle[few], rate[few], acceleration[few])
    found = for_motion(s, motion, silent)
    for k, q in enumerate(motion.angle):
        torque = torques(BUCHNER, q, motion.rate[k], motion.acceleration[k])
        assert found.required_torque[k] == pytest.approx(torque, abs=1e-9)
        paper = linear(two_band(), q, torque, HALF, np.zeros(2), np.ones(5)).muscles
        assert found.tension[k] == pytest.approx(paper, abs=1e-5)
    assert found.torque == pytest.approx(found.required_torque, abs=1e-7)
    assert found.tension[-1, 0] == pytest.approx(26.4, abs=0.05)


def test_inverse_dynamics_counts_springs_and_damping():
    case = load_case("two_band_edc", ['finger.passive.PIP.damping="0.002 N*m*s/rad"'])
    finger = setup(case, "one", 2, {}, {}).models.finger
    angle, rate, acceleration = np.array([[0.1, 0.9, 0.3], [1.0, -2.0, 3.0], [5.0, 9.0, -7.0]])
    springs = -0.0391 * (angle - np.radians([0.0, 40.0, 10.0]))
    needed = torques(BUCHNER, angle, rate, acceleration) - springs + [0.0, 0.002 * rate[1], 0.0]
    assert needed_torque(finger, angle, rate, acceleration) == pytest.approx(needed, abs=1e-9)


def test_out_of_reach_names_the_nearest_that_can_be_had():
    s = estimate_setup("split_edc")
    with pytest.raises(InputError, match="no tensions within their bounds make distal -100"):
        for_force(s, (-100.0, 0.0, -2.0), silent)
    held = s.hold_finger(s.models.posture)
    at = held.at(s.capacity.least, held.begin())
    demand, wanted = force_demand(held, at), np.array([-100.0, 0.0, -2.0])
    near = nearest(demand, wanted, s.capacity.least, at, s.bounds)
    way = wanted - near
    for part, feasible in ((-1e-6, True), (1e-4, False)):
        programme = linearise(demand, near + part * way, s.capacity.least, at, s.bounds)
        assert (least(programme, np.ones(8), 2) is not None) == feasible
    forces = force_set(demand, s.capacity.least, at, s.bounds)
    normal = way / np.linalg.norm(way)
    assert (forces.vertices @ normal).max() == pytest.approx(near @ normal, abs=1e-6)


def test_where_shares_vary_the_way_there_is_told():
    """No arms in abduction: a force without a radial component is out of reach at any size."""
    s = estimate_setup("network_edc")
    with pytest.raises(InputError, match=r"In stages .* 0% of the way was reached, 25% was not"):
        for_force(s, (-1.0, 0.0, -2.0), silent)


@pytest.mark.parametrize(
    ("name", "settings"), [("split_edc", ()), ("split_edc", (CLAMPED,)), ("two_band_edc", ())]
)
def test_the_set_holds_what_programmes_can_make_and_no_more(name, settings):
    s = estimate_setup(name, *settings)
    held = s.hold_finger(s.models.posture)
    at = held.at(s.capacity.least, held.begin())
    demand = force_demand(held, at)
    forces = force_set(demand, s.capacity.least, at, s.bounds)
    middle, rng = forces.vertices.mean(axis=0), np.random.default_rng(0)
    for way in rng.normal(size=(6, len(middle))):
        reach = -(forces.halfspaces[:, -1] + forces.halfspaces[:, :-1] @ middle)
        along = forces.halfspaces[:, :-1] @ way
        edge = (reach[along > 0] / along[along > 0]).min()
        for part, feasible in ((0.999, True), (1.001, False)):
            force = middle + part * edge * way
            programme = linearise(demand, force, s.capacity.least, at, s.bounds)
            assert forces.holds(force) == feasible
            assert (least(programme, np.ones(len(held.names)), 2) is not None) == feasible


def test_the_section_of_a_set_bears_no_radial_force():
    s = estimate_setup("split_edc")
    held = s.hold_finger(s.models.posture)
    at = held.at(s.capacity.least, held.begin())
    forces = force_set(force_demand(held, at), s.capacity.least, at, s.bounds)
    section, shadow = forces.section(0, 2), forces.outline(0, 2)
    for x, z in section:
        assert forces.holds(np.array([x, 0.0, z]), 1e-6)
    assert section[:, 0].min() > shadow[:, 0].min() - 1e-9


def test_a_free_component_costs_no_more():
    s = estimate_setup("split_edc")
    tied = for_force(s, (-1.0, 0.0, -2.0), silent)
    free = for_force(s, (-1.0, None, -2.0), silent)
    price = [float(s.cost.factors @ a.estimate.tension**2) for a in (tied, free)]
    assert free.demand.names == ("distal", "dorsal")
    assert price[1] < price[0]


def test_capacities_say_where_they_are_from():
    case = load_case("two_band_edc")
    bear = capacity(case, ("EDC", "UI"), {"UI": 6.33e-4}, {"UI": 50.0})
    assert bear.most == pytest.approx([45e4 * 1.39e-4, 50.0])
    assert bear.area == pytest.approx([1.39e-4, 6.33e-4])
    assert bear.sources[1] == ("given", "given")
    assert capacity(load_case("split_edc"), ("FDP",)).most == [79.12]
    halves = capacity(load_case("hood_minorflex_edc"), ("RI", "RIp"))
    assert halves.area == pytest.approx([1.4e-4, 1.4e-4])
    assert (halves.least == load_case("hood_minorflex_edc").solve.resting_tension).all()
    with pytest.raises(InputError, match="no such tendon; they have EDC, UI"):
        capacity(case, ("EDC", "UI"), {"FDX": 1.0})
    for areas, most in (({"EDC": 0.0}, {}), ({}, {"EDC": -1.0})):
        with pytest.raises(InputError, match=r"EDC: must be (above 0|0 or more)"):
            capacity(case, ("EDC",), areas, most)
    with pytest.raises(InputError, match="no area is known"):
        capacity(case, ("odd",))


def test_a_force_is_read():
    assert parse_force("-1 N 0 N -2e3 mN".replace("mN", "N")) == (-1.0, 0.0, -2000.0)
    assert parse_force("-1 N, free, 0.5 N") == (-1.0, None, 0.5)
    with pytest.raises(InputError, match="every component is left open"):
        parse_force("free free free")


@given(st.text(alphabet="0123456789.-+eNmfr, k*", max_size=30))
def test_any_other_text_is_refused_with_advice(text):
    try:
        assert len(parse_force(text)) == 3
    except InputError as error:
        assert "--force" in str(error)


@pytest.fixture
def table(tmp_path):
    time = np.linspace(0.0, 1.0, 41)
    pip = 40.0 + 20.0 * np.sin(2 * np.pi * time)
    path = tmp_path / "motion.csv"
    pd.DataFrame({"time": time, "PIP_deg": pip, "DIP_rad": 0.2 * time}).to_csv(path, index=False)
    return path


def test_a_motion_is_read_with_its_rates(table):
    joints, posture = ("MCP", "PIP", "DIP"), {"MCP": 0.3, "PIP": 0.0, "DIP": 0.0}
    motion = read_motion(table, joints, posture, samples=11)
    assert motion.angle[:, 0] == pytest.approx(0.3)
    assert motion.angle[:, 2] == pytest.approx(0.2 * motion.time)
    rate = np.radians(20.0) * 2 * np.pi * np.cos(2 * np.pi * motion.time)
    assert motion.rate[1:-1, 1] == pytest.approx(rate[1:-1], abs=2e-3)
    assert motion.rate[:, 2] == pytest.approx(0.2)
    smooth = read_motion(table, joints, posture, cutoff=0.2)
    whole = read_motion(table, joints, posture)
    assert np.ptp(smooth.angle[:, 1]) < 0.5 * np.ptp(whole.angle[:, 1])


def test_angles_under_the_paths_of_their_states_are_taken(tmp_path):
    path = tmp_path / "states.sto"
    rows = "".join(f"{t}\t{10 * t}\t7\n" for t in range(5))
    labels = "time\t/jointset/pip/PIP/value\t/jointset/pip/PIP/speed"
    path.write_text(f"states\nversion=1\ninDegrees=yes\nendheader\n{labels}\n{rows}")
    motion = read_motion(path, ("MCP", "PIP"), {"MCP": 0.3, "PIP": 0.0})
    assert motion.angle[:, 1] == pytest.approx(np.radians(10.0 * motion.time))


def test_columns_that_are_no_joint_are_told(tmp_path):
    path = tmp_path / "more.csv"
    path.write_text("time,PIP_deg,XIP_deg\n0,1,1\n1,2,1\n2,3,1\n3,4,1\n", encoding="utf-8")
    with pytest.warns(ReadingWarning, match="no angle of a joint: XIP_deg; the joints are PIP"):
        read_motion(path, ("PIP",), {"PIP": 0.0})


def test_areas_are_asked_for_where_they_count():
    robot = load_case("robot_friction_cycle")
    names = ("extensor", "dip_flexor")
    with pytest.raises(InputError, match="no area is known"):
        capacity(robot, names)
    limits = {"extensor": 20.0, "dip_flexor": 10.0}
    assert capacity(robot, names, most=limits, weights="one").most == pytest.approx([20, 10])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time,wrist_deg\n0,1\n1,2\n2,3\n3,4\n", "no column of a joint"),
        ("t,PIP_deg\n0,1\n1,2\n2,3\n3,4\n", "no column 'time'"),
        (
            "time,PIP_deg\n0,1\n1,2\n1,3\n3,4\n",
            "times must rise from row to row; 1 s is followed by 1 s",
        ),
        ("time,PIP_deg\n0,1\n1,x\n2,3\n3,4\n", "line 3: PIP_deg is 'x'"),
    ],
)
def test_a_bad_motion_is_refused(tmp_path, text, said):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=said):
        read_motion(path, ("PIP",), {"PIP": 0.0})


def run(*words):
    return CliRunner().invoke(app, ["estimate", *map(str, words)])


def test_the_command_leaves_numbers_tables_and_a_picture(tmp_path, table):
    done = run("split_edc", "--force", "-1 N 0 N -2 N", "-o", tmp_path)
    assert done.exit_code == 0, done.output
    folder = tmp_path / "split_edc"
    told = json.loads((folder / "estimate.json").read_text())
    assert told["audit"]["largest_difference"] < 1e-9
    rows = pd.read_csv(folder / "estimate.csv").set_index("muscle")
    assert rows.tension_N["FDP"] == pytest.approx(told["tension_N"]["FDP"])
    assert len(pd.read_csv(folder / "feasible_force.csv")) == told["feasible_force"]["vertices"]
    assert (folder / "estimate.png").stat().st_size > 10_000
    done = run("split_edc", "--motion", table, "--samples", 5, "-o", tmp_path)
    assert done.exit_code == 0, done.output
    assert len(pd.read_csv(folder / "estimate.csv")) == 5
    done = run("two_band_edc", "-o", tmp_path)
    assert done.exit_code == 0, done.output
    assert json.loads((tmp_path / "two_band_edc/estimate.json").read_text())["feasible_force"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--force", "1 N 0 N 0 N", "--torque", "MCP=1 N*m"), "one of them"),
        (("--force", "1 N 0 N"), "expected the fingertip"),
        (("--force", "1 kg 0 N 0 N"), "no unit of force"),
        (("--torque", "MCP=1"), "no unit"),
        (("--most", "FDX=1 N"), "no such tendon"),
        (("--samples", "3"), "belong to --motion"),
        (("--force", "-100 N 0 N 0 N"), "The nearest that they make"),
        (("--force", "0 N 0 N 0 N", "--set", 'finger.tip.kind="free"'), "nothing holds"),
    ],
)
def test_the_command_says_what_is_wrong(tmp_path, words, said):
    done = run("split_edc", *words, "-o", tmp_path)
    assert done.exit_code == 2
    assert said in done.output
    assert not (tmp_path / "split_edc").exists()


def test_what_is_no_estimate_is_not_replaced(tmp_path):
    (tmp_path / "split_edc").mkdir()
    (tmp_path / "split_edc" / "mine.txt").write_text("keep")
    done = run("split_edc", "-o", tmp_path)
    assert done.exit_code == 2
    assert "was not written by this command" in done.output
    assert (tmp_path / "split_edc" / "mine.txt").exists()


def test_a_reserve_bears_what_tensions_cannot_and_no_more():
    s = estimate_setup("split_edc")
    held = s.hold_finger(s.models.posture)
    bounds, cost = Bounds(np.zeros(8), np.full(8, 1e-9)), Cost(np.ones(8), 2)
    wanted = np.array([1e-3, 0.0, 0.0, 0.0])
    found = estimate(held, torque_demand(held), wanted, bounds, cost, reserve=2e-3)
    assert found.components == pytest.approx(np.zeros(4), abs=1e-9)
    with pytest.raises(InputError, match="The nearest that they make"):
        estimate(held, torque_demand(held), wanted, bounds, cost, reserve=5e-4)


def test_torque_demands_know_every_joint():
    s = estimate_setup("split_edc")
    held = s.hold_finger(s.models.posture)
    wanted = np.array([0.02, 0.0, 0.01, 0.002])
    bounds = Bounds(s.capacity.least, s.capacity.most)
    found = estimate(held, torque_demand(held), wanted, bounds, Cost(np.ones(8), 2))
    assert found.components == pytest.approx(wanted, abs=1e-12)
    assert found.at.by_tension @ found.tension == pytest.approx(wanted, abs=1e-12)
