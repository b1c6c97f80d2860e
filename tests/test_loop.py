"""A step loop of the user's own: the same motion, named numbers, and a state that stays valid."""

import copy
import pickle
import subprocess
import sys
import threading
from decimal import Decimal

import numpy as np
import pytest

import cosim
from cosim.case.file import layers_of
from cosim.errors import ConvergenceError, InputError
from cosim.fmu_export.write import write_fmu
from cosim.models.build import build
from cosim.port import AXES
from cosim.schema import units
from meshes.skeleton import JOINTS
from tests.helpers.fmus import NEEDS_FMU
from tests.helpers.folders import ROOT
from tests.proofs.coupling.fmu_rows import in_units

COPIES = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda of: pickle.loads(pickle.dumps(of)),
}
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


@pytest.mark.parametrize("other", ["split_edc", {"tendons.FDP.max_force": "80 N"}])
def test_a_state_of_another_case_is_refused(loop, other):
    case = cosim.load("network_edc")
    other, before = cosim.Loop(other if other == "split_edc" else case.replace(other)), loop.state
    with pytest.raises(InputError, match="of another case"):
        loop.state = other.state
    assert loop.state == before


@pytest.mark.parametrize("way", COPIES)
def test_a_copy_is_a_loop_of_its_own_in_the_same_state(loop, way):
    loop.reset(posture={"PIP": 0.7})
    loop.step({"EDC": 2.0, "LUM": 0.5})
    loop.remark = "mine"
    other = COPIES[way](loop)
    assert (other.state, other.dt, other.remark) == (loop.state, loop.dt, "mine")
    before = loop.observe()
    seen = [other.step({"EDC": 6.0}), other.step()]
    assert loop.observe() == before
    assert [seen[1]["tension.EDC"], seen[1]["tension.LUM"]] == [6.0, 0.5]
    assert [loop.step({"EDC": 6.0}), loop.step()] == seen
    assert other.reset() == loop.reset()


@pytest.mark.parametrize("way", COPIES)
@pytest.mark.parametrize("name", ["network_edc", "pneumatic_edc_fdp"])
def test_states_compare_by_content_and_go_on_in_another_loop_of_the_case(name, way):
    first, second = (cosim.Loop(name, step) for step in ("2 ms", "4 ms"))
    first.step()
    at = COPIES[way](first.state)
    assert at == first.state
    assert hash(at) == hash(first.state)
    assert at != second.state
    again = first.step(), first.step()
    assert at != first.state
    third = cosim.Loop(cosim.load(name).model_copy(update={"name": "mine"}))
    third.state = at
    assert (third.step(), third.step()) == again
    assert third.state == first.state
    second.state = at
    assert second.step()["time"] == pytest.approx(again[1]["time"])


def test_states_differ_by_a_command_that_is_not_felt_yet():
    states = []
    for pressure in (2e3, 2e3, 3e3):
        loop = cosim.Loop("pneumatic_edc_fdp")
        seen = loop.step({"EDC": pressure})
        states.append((seen, loop.state))
    assert states[0] == states[1]
    assert states[0][0] == states[2][0]
    assert states[0][1] != states[2][1]


def test_states_of_a_sheet_compare_by_content():
    """Also of what its contacts made, which hold their stiffness as a call to come."""
    loop = cosim.Loop("cable_edc")
    loop.step({"EDC": 2.0})
    other = pickle.loads(pickle.dumps(loop.state))
    assert other == loop.state
    assert type(other._content[0]) is str
    after = loop.step()
    loop.state = other
    assert loop.step() == after


def test_a_state_on_disk_goes_on_in_another_process(tmp_path):
    loop = cosim.Loop("two_band_edc")
    loop.step({"EDC": 4.0})
    path = tmp_path / "state"
    path.write_bytes(pickle.dumps(loop.state))
    code = f"""
import cosim, pickle
loop = cosim.Loop("two_band_edc")
loop.state = pickle.loads(open({str(path)!r}, "rb").read())
print(loop.step({{"FDP": 1.0}}))
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == str(loop.step({"FDP": 1.0}))


def test_a_state_holds_the_length_from_which_a_fibre_shortens():
    """Gone back to after a beginning in another posture, where the muscle was longer."""
    loop = cosim.Loop(cosim.load("split_edc", ["tendons.EDC.activation=0.1"]).replace(FIBRE))
    loop.reset()
    before, first = loop.state, loop.step({"EDC": 0.3})
    loop.reset(posture={"MCP": 0.9})
    loop.state = before
    assert loop.step({"EDC": 0.3}) == first


def test_threads_take_turns(loop):
    loop.reset()
    at_work, seen = threading.Barrier(4), []

    def work(tension: float) -> None:
        at_work.wait()
        for _ in range(10):
            seen.append(loop.step({"EDC": tension})["time"])

    threads = [threading.Thread(target=work, args=(t,)) for t in (1.0, 2.0, 3.0, 4.0)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(seen) == pytest.approx(loop.dt * np.arange(1, 41))


def test_an_array_is_an_action_in_the_named_order(loop):
    loop.reset()
    tensions = np.linspace(0.1, 0.7, len(loop.actions))
    for action in (tensions, tensions.tolist(), tuple(tensions.astype(object))):
        seen = loop.step(action)
        assert [seen[f"tension.{t}"] for t in loop.actions] == pytest.approx(tensions)
    numbers = [2, np.float32(2), np.int8(2), np.array(2.0), np.array(2), np.longdouble(2)]
    assert [loop.step({"EDC": number})["tension.EDC"] for number in numbers] == [2.0] * 6


def test_a_seed_draws_the_beginning(loop):
    angles = [f"angle.{joint}" for joint in JOINTS]
    case = loop.reset()
    first, again, other = (loop.reset(seed=seed) for seed in (3, np.int64(3), 4))
    assert first == again
    assert all(first[a] != other[a] for a in angles)
    each = [loop.reset(seed=seed) for seed in range(20)]
    off = np.degrees([[seen[a] - case[a] for a in angles] for seen in each])
    assert -5.0 <= off.min() < -4.0
    assert 4.0 < off.max() <= 5.0
    bent = loop.reset({"PIP": 1.0}, seed=3, spread="1 deg")
    assert 0 < abs(bent["angle.PIP"] - 1.0) <= np.radians(1.0)
    low, high = loop.models.ranges["PIP"]
    ends = [loop.reset({"PIP": high}, seed=seed, spread=1.0)["angle.PIP"] for seed in range(6)]
    assert low < min(ends) < max(ends) == high
    assert loop.reset() == case


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
        ([1.0], "values by name, for example .*, or 7 numbers: EDC, "),
        (np.ones(6), "or 7 numbers: "),
        (np.array(1.0), "or 7 numbers: "),
        (1.0, "or 7 numbers: "),
        ("", "or 7 numbers: "),
        ({1: 1.0}, "or 7 numbers: "),
        (np.ones((7, 1)), "action EDC: expected a number from 0 to"),
        ([1.0] * 6 + [[1.0]], r"expected a number from 0 to .*not \[1\.0\]"),
        (np.full(7, np.nan), "from 0 to"),
        (np.ma.masked_all(7), "from 0 to"),
        (np.ones(7, dtype=complex), "from 0 to"),
        ({"EDC": 10**400}, "from 0 to"),
        ({"EDC": np.complex128(2)}, "from 0 to"),
        ({"EDC": True}, "from 0 to"),
        ({"EDC": np.bool_(True)}, "from 0 to"),
        ({"EDC": np.timedelta64(2, "s")}, "from 0 to"),
        ({"EDC": Decimal(2)}, "from 0 to"),
        ({"EDC": np.ones(1)}, "from 0 to"),
        ({"EDC": None}, "from 0 to"),
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


@pytest.mark.parametrize(
    "posture", [{"wrist": 0.1}, {"PIP": 3.0}, {"PIP": "45 N"}, {"PIP": 1j}, np.ones(4), 0, ""]
)
def test_a_posture_that_there_is_not_leaves_the_loop_where_it_is(loop, posture):
    loop.reset()
    before = loop.step({"EDC": 2.0})
    with pytest.raises(InputError, match="posture"):
        loop.reset(posture=posture)
    assert loop.observe() == before


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (ConvergenceError("no equilibrium."), r"no equilibrium\. The loop stands where it stood"),
        (ZeroDivisionError("of a user's hood"), "of a user's hood"),
    ],
)
def test_a_step_that_fails_leaves_the_loop_and_its_commands_as_they_were(
    loop, monkeypatch, error, words
):
    def fail(*args: object) -> None:
        raise error

    loop.reset()
    before, state = loop.step({"EDC": 2.0}), loop.state
    with monkeypatch.context() as patch:
        patch.setattr(type(loop.models.hood), "advance", fail)
        with pytest.raises(type(error), match=words):
            loop.step({"EDC": 3.0})
        with pytest.raises(type(error)):
            loop.reset(posture={"PIP": 0.6}, action={"EDC": 4.0})
    assert loop.observe() == before
    assert loop.state == state
    assert loop.step()["tension.EDC"] == 2.0  # the command of the last step that was made


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


@pytest.mark.parametrize("delay", [0.0, 0.03, 0.9])
def test_a_command_is_felt_after_its_dead_time_and_not_before(delay):
    """Of two that are sent before the first is felt; up to then all is as without them."""
    case = cosim.load("pneumatic_edc_fdp")
    name = next(n for n, tendon in case.tendons.items() if tendon.actuation is not None)
    step, late = delay / 10 or 3e-3, 10 if delay else 0
    case = case.replace({f"tendons.{name}.actuation.delay": f"{delay} s"})
    loop = cosim.Loop(case, step, substeps=round(step / 3e-3))
    start = loop.actions[name].start

    def tensions(*factors: float) -> np.ndarray:
        loop.reset()
        each = [*factors] + [factors[-1]] * (late + 6 - len(factors))
        return np.array([loop.step({name: f * start})[f"tension.{name}"] for f in each])

    still, one, both = tensions(1.0), tensions(1.0, 1.0, 1.2), tensions(1.0, 1.0, 1.2, 1.2, 0.9)
    for felt, before, first in ((one, still, 2 + late), (both, one, 4 + late)):
        assert felt[:first].tolist() == before[:first].tolist()
        assert abs(felt[first] - before[first]) > 1e-3
    assert both[-1] < one[-1]


def test_a_command_is_remembered_for_its_dead_time_whatever_the_step():
    """A second is no multiple of the long step, nor of the dead time."""
    case = cosim.load("pneumatic_edc_fdp", ['tendons.EDC.actuation.delay="0.98 s"'])
    long, short = cosim.Loop(case, 0.08, substeps=20), cosim.Loop(case, 0.004)
    for k in range(15):
        action = {"EDC": 5e3 * (k % 3)}
        seen = long.step(action)
        for _ in range(20):
            again = short.step(action)
        assert seen == pytest.approx(again, rel=1e-9, abs=1e-12)


FIBRE = {
    "tendons.EDC.muscle": {
        "kind": "millard",
        "optimal_fibre_length": "70 mm",
        "tendon_slack_length": "264.68 mm",
        "pennation": "3 deg",
    }
}


def test_a_muscle_with_a_fibre_takes_its_activation():
    loop = cosim.Loop(cosim.load("split_edc", ["tendons.EDC.activation=0.1"]).replace(FIBRE))
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
    """Of a flexor that pulls hard, so that the reaction's part in the stiffness is seen."""
    case, step = cosim.load(name, ['finger.limit.half_range="60 deg"']), 1e-2
    loop = cosim.Loop(case)
    pulls = {t: c.start for t, c in loop.actions.items()} | {"FDP": 20.0}
    below, at, above = (
        cosim.couple(case, case, {**pulls, "FDP": 20.0 + d}) for d in (-step, 0.0, step)
    )
    loop.reset({joint: f"{angle!r} deg" for joint, angle in at.posture.items()}, pulls)
    seen = loop.step()
    assert {a: seen[f"tip_force.{a}"] for a in AXES} == pytest.approx(at.tip_force, abs=1e-3)
    gain = loop.gain()
    change = [(above.tip_force[a] - below.tip_force[a]) / (2 * step) for a in AXES]
    assert gain.matrix[:, gain.tendons.index("FDP")] == pytest.approx(change, abs=3e-6)


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
    for way in COPIES.values():
        with pytest.raises(InputError, match=r"has an FMU.* another loop: cosim\.Loop"):
            way(loop)
        with pytest.raises(InputError, match="FMU keeps a part of it"):
            way(before)
    with pytest.raises(InputError, match="of another loop with an FMU"):
        cosim.Loop(loop.case).state = before
