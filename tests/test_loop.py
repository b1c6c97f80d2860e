"""A step loop of the user's own: the same motion, named numbers, and a state that stays valid."""

import numpy as np
import pytest

import cosim
from cosim.case.file import layers_of
from cosim.errors import ConvergenceError, InputError
from cosim.fmu_export.write import write_fmu
from cosim.models.build import build
from cosim.schema import units
from cosim.verification.fmu import in_units
from meshes.skeleton import JOINTS
from tests.helpers.fmus import NEEDS_FMU

STEP = 'forward.step="2 ms"'


@pytest.fixture(scope="module")
def loop():
    return cosim.Loop("network_edc")


def test_without_actions_it_is_the_motion_of_the_case_to_the_bit():
    case = cosim.load("pulley_edc", [STEP, 'forward.duration="20 ms"'])
    run, loop = cosim.run(case), cosim.Loop(case)
    loop.reset()
    for _ in range(10):
        seen = loop.step()
    for joint, angle in run.summary["posture_deg"].items():
        assert np.rad2deg(seen[f"angle.{joint}"]) == angle
    assert seen["tip_force.dorsal"] == run.tip_force["dorsal"]


@pytest.mark.parametrize("substeps", [1, 4])
def test_substeps_are_steps_of_the_motion(substeps):
    whole = cosim.Loop("split_edc", step="4 ms", substeps=substeps)
    parts = cosim.Loop("split_edc", step=0.004 / substeps)
    seen = whole.step({"EDC": 3.0})
    for _ in range(substeps):
        again = parts.step({"EDC": 3.0})
    assert seen == pytest.approx(again)
    assert seen["time"] == pytest.approx(0.004)


def test_observations_have_their_names_units_and_order(loop):
    seen = loop.reset()
    assert tuple(seen) == tuple(loop.observations)
    assert all(loop.observations[name].unit for name in seen)
    assert {"angle.MCP_abduction", "rate.PIP", "tip.distal", "slip_force.central"} <= set(seen)
    assert seen["angle.PIP"] == pytest.approx(np.radians(45.0))
    assert seen["excursion.FDP"] > 0.0  # of the flexed finger, from the straight one


def test_an_action_stays_until_another_comes(loop):
    loop.reset()
    assert loop.step({"EDC": 2.0, "FDP": 1.0})["tension.EDC"] == 2.0
    after = loop.step({"EDC": 4.0})
    assert (after["tension.EDC"], after["tension.FDP"]) == (4.0, 1.0)
    assert loop.reset()["tension.EDC"] == pytest.approx(loop.actions["EDC"].start)
    assert loop.step()["tension.FDP"] == pytest.approx(0.05)
    assert loop.reset(action={"EDC": 1.0})["tension.EDC"] == 1.0


def test_from_a_state_that_was_kept_it_goes_the_same_way_again(loop):
    loop.reset()
    loop.step({"EDC": 2.0})
    before = loop.state
    first = [loop.step({"EDC": 3.0}), loop.step({"LUM": 1.0})]
    loop.state = before
    assert [loop.step({"EDC": 3.0}), loop.step({"LUM": 1.0})] == first


def test_a_state_of_another_loop_is_refused(loop):
    other, before = cosim.Loop("network_edc"), loop.observe()
    with pytest.raises(InputError, match="of another loop"):
        loop.state = other.state
    assert loop.observe() == before


def test_actions_and_observations_are_read_only(loop):
    for table in (loop.actions, loop.observations):
        with pytest.raises(TypeError):
            table["EDC"] = None


def test_it_begins_in_another_posture(loop):
    seen = loop.reset(posture={"PIP": "30 deg", "MCP": 0.4})
    assert np.rad2deg(seen["angle.PIP"]) == pytest.approx(30.0)
    assert (seen["angle.MCP"], seen["rate.PIP"]) == (0.4, 0.0)


@pytest.mark.parametrize(
    ("action", "words"),
    [
        ({"EDCC": 1.0}, "nothing to command of the name EDCC; did you mean EDC"),
        ({"XXX": 1.0}, r"of the name XXX\. There are EDC"),
        ({"EDC": -1.0}, "from 0 to"),
        ({"EDC": float("nan")}, "from 0 to"),
        ({"EDC": "much"}, "from 0 to"),
        ({"EDC": 1e6}, "N; tension of the tendon"),
        ([1.0], "action"),
    ],
)
def test_an_action_that_there_is_not_leaves_the_loop_where_it_is(loop, action, words):
    loop.reset()
    before = loop.step({"EDC": 2.0})
    with pytest.raises(InputError, match=words):
        loop.step(action)
    assert loop.observe() == before
    with pytest.raises(InputError, match=words):
        loop.reset(action=action)
    assert loop.observe() == before


@pytest.mark.parametrize("posture", [{"wrist": 0.1}, {"PIP": 3.0}, {"PIP": "45 N"}])
def test_a_posture_that_there_is_not_leaves_the_loop_where_it_is(loop, posture):
    loop.reset()
    before = loop.step({"EDC": 2.0})
    with pytest.raises(InputError, match="posture"):
        loop.reset(posture=posture)
    assert loop.observe() == before


def test_a_step_that_does_not_converge_leaves_the_loop_where_it_was(loop, monkeypatch):
    def fail(*args: object) -> None:
        raise ConvergenceError("the hood found no equilibrium.")

    loop.reset()
    before, state = loop.step({"EDC": 2.0}), loop.state
    with monkeypatch.context() as patch:
        patch.setattr(type(loop.models.hood), "advance", fail)
        with pytest.raises(
            ConvergenceError, match=r"no equilibrium\. The loop stands where it stood"
        ):
            loop.step({"EDC": 3.0})
        with pytest.raises(ConvergenceError):
            loop.reset(posture={"PIP": 0.6})
    assert loop.observe() == before
    assert loop.state.motion is state.motion
    assert loop.step({"EDC": 3.0})["tension.EDC"] == 3.0


def test_an_fmu_or_a_static_finger_or_adaptive_steps_are_refused_in_words():
    with pytest.raises(InputError, match="loop takes a finger with mass"):
        cosim.Loop("own_pulleys_fdp")
    with pytest.raises(InputError, match="sets the steps of its motion"):
        cosim.Loop(cosim.load("split_edc", ['forward.adaptive.tolerance="0.01 deg"']))
    with pytest.raises(InputError, match="step"):
        cosim.Loop("split_edc", "2 mm")


@pytest.mark.parametrize(
    ("case", "step", "words"),
    [
        ("hood_rest", "2 ms", "leave the tip free"),
        ("robot_motor_flexor", "2 ms", "^step / substeps: 0.002 s is too long"),
        ("network_edc", "1 h", "^step / substeps: is 3600 s"),
    ],
)
def test_a_case_or_a_step_that_cannot_be_is_refused_in_terms_of_the_loop(case, step, words):
    with pytest.raises(InputError, match=words) as error:
        cosim.Loop(case, step)
    assert "forward" not in str(error.value)


def test_commands_of_a_cylinder_arrive_after_its_dead_time():
    """As the same command as a signal of the case does."""
    jump = {"kind": "points", "at": [["0 s", 0.4], ["10 ms", 0.4], ["10.001 ms", 1.0]]}
    case = cosim.load("pneumatic_edc_fdp", ['forward.duration="60 ms"', 'forward.step="1 ms"'])
    name = next(n for n, tendon in case.tendons.items() if tendon.actuation is not None)
    case = case.replace({f"tendons.{name}.signal": jump})
    run, loop = cosim.run(case), cosim.Loop(case, "1 ms")
    full = loop.actions[name].start / 0.4
    assert loop.actions[name].unit in ("V", "Pa")
    loop.reset()
    for k in range(60):
        seen = loop.step({name: full if k >= 10 else 0.4 * full})
    assert seen[f"tension.{name}"] == pytest.approx(run.summary["tension_N"][name], rel=1e-3)


def test_a_muscle_with_a_fibre_takes_its_activation():
    case = cosim.load("split_edc", ["tendons.EDC.activation=0.1"])
    fibre = {
        "kind": "millard",
        "optimal_fibre_length": "70 mm",
        "tendon_slack_length": "264.68 mm",
        "pennation": "3 deg",
    }
    loop = cosim.Loop(case.replace({"tendons.EDC.muscle": fibre}))
    assert (loop.actions["EDC"].unit, loop.actions["EDC"].start) == ("1", 0.1)
    weak = loop.reset()["tension.EDC"]
    for _ in range(100):
        seen = loop.step({"EDC": 0.3})
    assert seen["tension.EDC"] > 2.0 * weak


def test_a_motor_takes_its_torque_or_its_way():
    motor = {"kind": "motor", "spool": "5 mm", "greatest_torque": "500 N*mm", "band": "1 mm"}
    elastic = {"stiffness": "20 N/mm"}
    for command, unit, value in (
        ({"torque": "10 N*mm"}, "N*m", 0.02),
        ({"position": "1 mm"}, "m", 2e-3),
    ):
        inertia = {"inertia": "1 kg*mm**2"}
        table = {"actuation": motor | inertia | command, "elastic": elastic}
        case = cosim.load("split_edc").replace({"forward.step": "1 ms", "tendons.FDP": table})
        loop = cosim.Loop(case, "1 ms")
        assert loop.actions["FDP"].unit == unit
        assert loop.actions["FDP"].start == pytest.approx(value / 2)
        begun = loop.reset()["tension.FDP"]
        for _ in range(100):
            seen = loop.step({"FDP": value})
        assert seen["tension.FDP"] > begun + 0.5


@pytest.mark.parametrize("name", ["network_edc", "split_edc"])
def test_its_gain_is_that_of_the_equilibria_of_a_held_tip(name):
    damped = {f"finger.passive.{j}.damping": "0.01 N*m*s/rad" for j in JOINTS}
    loop = cosim.Loop(cosim.load(name).replace(damped))
    pulls = {t: c.start for t, c in loop.actions.items()}
    force = [
        np.array(
            list(cosim.couple(name, name, {**pulls, "FDP": pulls["FDP"] + d}).tip_force.values())
        )
        for d in (0.0, 1e-3)
    ]
    loop.reset()
    for _ in range(250):
        seen = loop.step()
    gain = loop.gain()
    change = (force[1] - force[0]) / 1e-3
    assert gain.matrix[:, gain.tendons.index("FDP")] == pytest.approx(change, abs=0.02)
    assert abs(seen["rate.PIP"]) < 0.05


def test_a_gain_needs_a_tip_that_is_held():
    with pytest.raises(InputError, match=r'hold it \(finger\.tip\.kind = "point"\)'):
        cosim.Loop(cosim.load("split_edc", ['finger.tip.kind="free"'])).gain()


def test_units_of_observations_and_actions_are_si(loop):
    kinds = {kind.si for kind in vars(units).values() if isinstance(kind, units.Kind)} | {"rad/s"}
    assert {channel.unit for channel in loop.observations.values()} <= kinds


@pytest.mark.parametrize("fmi", [pytest.param(2, marks=NEEDS_FMU)])
def test_units_take_part_and_can_be_taken_back(tmp_path, fmi):
    case = cosim.load("pulley_edc", [STEP, 'forward.duration="20 ms"'])
    paths = {part: tmp_path / f"{part}.fmu" for part in ("finger", "hood")}
    for part, path in paths.items():
        write_fmu(case, part, fmi, path)
    settings = in_units(build(case), paths, "newton")
    native = cosim.Loop(case.with_layers(layers_of(settings[:1])))
    loop = cosim.Loop(case.with_layers(layers_of(settings)))
    for _ in range(5):
        ours, theirs = native.step({"EDC": 3.0}), loop.step({"EDC": 3.0})
    shared = [name for name in ours if not name.startswith("excursion")]
    assert {n: theirs[n] for n in shared} == pytest.approx({n: ours[n] for n in shared}, abs=1e-9)
    before = loop.state
    first = loop.step({"EDC": 1.0})
    loop.state = before
    assert loop.step({"EDC": 1.0}) == first
