"""Friction along tendons in cases: the interval at rest, motions, other programs, refusals."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from cosim.analyses.moment_arms import native_arms
from cosim.case.file import load_case
from cosim.coupling.state_arrays import flatten, rebuild
from cosim.errors import InputError
from cosim.fmu_export.motion_parts import moving_part
from cosim.models.build import build, mjcf_of
from cosim.models.motion import moving_models
from cosim.pipeline import run_case
from cosim.results.answer import answer
from cosim.results.quantities import is_known, misfit
from cosim.results.result import Result
from cosim.solve.session import Session

PLAIN = "output.picture=false"
RUBS = "tendons.FDP.friction=0.1"


def run(name: str, *settings: str, session: Session | None = None) -> Result:
    return run_case(load_case(name, [PLAIN, *settings]), session)


def forces(block: Any) -> np.ndarray:
    return np.array(list(block["fingertip_force_N"].values()))


def test_the_interval_is_what_either_course_gives_alone() -> None:
    found = run("split_fdp", RUBS).summary
    back = run("split_fdp", RUBS, "tendons.FDP.sliding='unloading'").summary
    free = run("split_fdp").summary
    both = found["friction"]["sliding"]
    assert both["loading"]["fingertip_force_N"] == found["fingertip_force_N"]
    assert forces(both["unloading"]) == pytest.approx(forces(back), abs=1e-9)
    assert back["friction"]["sliding"]["loading"]["fingertip_magnitude_N"] == pytest.approx(
        found["fingertip_magnitude_N"], abs=1e-9
    )
    sizes = [s["fingertip_magnitude_N"] for s in (found, free, back)]
    assert sizes == sorted(sizes)
    assert found["friction"]["half_interval_N"] == pytest.approx(
        np.linalg.norm(forces(found) - forces(back)) / 2, abs=1e-9
    )
    tendon = found["friction"]["tendon"]["FDP"]
    left = found["tension_N"]["FDP"] * np.exp(-0.1 * np.radians(tendon["turn_deg"]))
    assert tendon["tension_at_insertion_N"] == pytest.approx(left)
    assert "friction" not in free
    assert found["audit_missed"] == []
    assert any("loading" in sentence for sentence in answer(found))
    assert misfit(found) == ""
    assert is_known("friction.half_interval_N")
    assert is_known("friction.sliding.unloading.joint_torque_Nmm.FDP.PIP")


def test_the_reach_is_that_of_tendons_without_friction() -> None:
    """The force of a finger on one tendon grows with the tension at the end; the reach does not."""
    over, pushed, told = {}, {}, {}
    for mu in (0.0, 0.2, 0.5):
        settings = (f"tendons.FDP.friction={mu}", "tendons.FDP.sliding='unloading'")
        found = run("split_fdp", *settings).summary
        over[mu] = found["audit"]["tip_force_over_reach"]
        pushed[mu] = found["fingertip_magnitude_N"]
        told[mu] = [line for line in found["warnings"] if "friction of" in line]
        if mu == 0.5:
            assert found["audit_missed"] == ["tip_force_over_reach"]
            tendon = found["friction"]["tendon"]["FDP"]
            factor = tendon["tension_at_insertion_N"] / found["tension_N"]["FDP"]
    for mu in (0.2, 0.5):
        assert over[mu] / over[0.0] == pytest.approx(pushed[mu] / pushed[0.0], rel=1e-9)
    assert factor > 2.0
    assert told[0.0] == []
    assert f"1/{factor:.3g} of its muscle's" in told[0.5][0]


def test_friction_of_zero_changes_nothing() -> None:
    none, zero = run("split_fdp").summary, run("split_fdp", "tendons.FDP.friction=0").summary
    assert forces(zero) == pytest.approx(forces(none), abs=1e-12)
    assert zero["friction"]["half_interval_N"] == pytest.approx(0.0, abs=1e-12)


def test_each_strand_of_an_extensor_has_its_own_friction() -> None:
    """The band to the DIP turns further than the slip."""
    plain, rubs = (
        run("split_edc", *s).summary["joint_torque_Nmm"]["EDC"]
        for s in ((), ("tendons.EDC.friction=0.1",))
    )
    kept = {joint: rubs[joint] / plain[joint] for joint in ("PIP", "DIP")}
    assert kept["DIP"] < kept["PIP"] < 1.0


def test_cases_that_differ_in_friction_share_a_hood_and_no_finger() -> None:
    case = load_case("pulley_edc")
    rubs = load_case("pulley_edc", [RUBS])
    assert case.hood_key() == rubs.hood_key()
    assert case.setting_key() != rubs.setting_key()
    session = Session()
    strong = ("tendons.FDP.tension='5 N'", "tendons.EDC.activation=0")
    first = run("pulley_edc", *strong, session=session).summary
    second = run("pulley_edc", RUBS, *strong, session=session).summary
    assert second["fingertip_magnitude_N"] < first["fingertip_magnitude_N"]
    assert second == {**run("pulley_edc", RUBS, *strong).summary, "wall_s": second["wall_s"]}


def test_a_motion_that_only_loads_comes_to_rest_as_the_equilibrium_does() -> None:
    tip = "finger.tip.kind='point'"
    ramp = 'tendons.FDP.signal={kind="points",at=[["0 s",0.01],["0.1 s",1.0]]}'
    still = run("split_fdp", RUBS).summary
    moved = run(
        "split_fdp", RUBS, tip, ramp, "forward={duration='0.2 s',step='2 ms',must_rest=false}"
    )
    settled = forces(moved.summary)
    interval = [forces(still["friction"]["sliding"][c]) for c in ("loading", "unloading")]
    assert np.linalg.norm(settled - interval[0]) < 0.5 * np.linalg.norm(interval[1] - interval[0])
    rows = [row for row in moved.rows if row.state == moved.rows[-1].state]
    for body in ("proximal", "middle", "distal"):
        total = np.sum([row.force for row in rows if row.body == body], axis=0)
        assert np.abs(total).max() < 1e-9


def test_a_clamped_finger_spends_on_friction_what_the_stretch_of_its_tendon_brings() -> None:
    """No joint turns, so a tendon's guides slide by its stretch c_k dT alone, and each takes
    c_k (T_before - T_beyond) dT, which nothing but the muscle can bring."""
    ramp = 'tendons.FDP.signal={kind="points",at=[["0 s",0.1],["0.1 s",1.0]]}'
    case = load_case(
        "split_fdp",
        [
            *(PLAIN, RUBS, ramp, "finger.tip.kind='clamped'"),
            "tendons.FDP.elastic.stiffness='50 N/mm'",
            "forward={duration='0.1 s',step='2 ms',must_rest=false}",
        ],
    )
    found = run_case(case)
    finger = build(case).finger
    readings = finger.guides.read(finger.at_angles(finger.start(build(case).posture).angles))
    before, beyond = readings.factors(np.ones(len(readings.give)))
    tension = found.data.own_tension.sel(muscle="FDP").values
    lost = readings.give @ (before - beyond) * (tension[1:] @ np.diff(tension))
    energy = found.summary["energy_mJ"]
    assert 1e3 * lost > 0.05
    assert energy["guides_dissipated"] == pytest.approx(1e3 * lost, rel=1e-9)
    assert energy["own_tendons"] == pytest.approx(1e3 * lost, rel=1e-9)
    assert energy["artificial"] == pytest.approx(0.0, abs=1e-12)


def test_what_knows_no_friction_keeps_its_arms_or_says_so() -> None:
    rubs, plain = (load_case("split_fdp", s) for s in ([RUBS], []))
    posture = build(plain).posture
    ours, theirs = (native_arms(build(c), posture) for c in (rubs, plain))
    assert all(np.array_equal(ours[t], theirs[t]) for t in theirs)
    assert "FDP: its friction of 0.1 at guides is left out" in mjcf_of(rubs).split("<compiler")[0]
    assert "friction" not in mjcf_of(plain)
    stretches = load_case("split_fdp", [RUBS, 'tendons.FDP.elastic.stiffness="50 N/mm"'])
    assert "FDP: its stretch is left out" in mjcf_of(stretches)


def test_a_step_of_a_rubbing_finger_can_be_repeated() -> None:
    case = load_case("forward_fdp", [RUBS, PLAIN])
    assert case.forward is not None
    models = moving_models(case, case.forward)
    at = models.moves.begin(models.initial_state)
    once, again = models.moves.advance(at), models.moves.advance(at)
    grips = [models.finger.grip(s.coupled.finger) for s in (once, again)]
    assert grips[0].tobytes() == grips[1].tobytes()
    assert once.friction.tobytes() == again.friction.tobytes()


def test_an_fmu_of_a_rubbing_finger_writes_its_grip_with_its_state() -> None:
    case = load_case("forward_fdp", [RUBS])
    assert case.forward is not None
    part = moving_part(case, case.forward, "finger", tangent=True)
    moving = moving_models(case, case.forward)
    at = moving.moves.advance(moving.moves.begin(moving.initial_state)).coupled.finger
    back = rebuild(part.start(), flatten(at))
    assert moving.finger.grip(back).tobytes() == moving.finger.grip(at).tobytes()
    assert moving.finger.grip(at).any()


@pytest.mark.parametrize(
    ("name", "setting", "words"),
    [
        ("pulley_edc", "tendons.EDC.friction=0.1", "EDC runs in the hood"),
        ("network_contact_planar", RUBS, "the finger has none"),
        ("split_fdp", "tendons.FDP.sliding='loading'", "sliding without friction"),
        ("split_fdp", "tendons.FDP.friction=-0.1", "friction"),
        ("split_fdp", "tendons.XYZ.friction=0.1", "XYZ"),
    ],
)
def test_friction_where_none_can_act_is_refused(name: str, setting: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        run(name, setting)


def test_a_tendon_that_stretches_holds_a_free_finger_as_a_spring_in_plain_mujoco_does() -> None:
    """MuJoCo's tendons are springs beyond a length, which the drawn end shortens."""
    stiffness, drawn, slack, resting = 20e3, 3e-3, 0.5e-3, 0.05
    settings = [
        "finger.tip.kind='free'",
        "finger.limit.half_range='60 deg'",
        *(
            f"finger.passive.{joint}={{stiffness='0.1 N*m/rad',rest='posture'}}"
            for joint in ("MCP", "MCP_abduction", "PIP", "DIP")
        ),
        f"tendons.FDP={{excursion='{1e3 * drawn} mm'}}",
        f"tendons.FDP.elastic={{stiffness='20 N/mm',slack='{1e3 * slack} mm'}}",
    ]
    found = run("base/split.toml", *settings)
    case = load_case("base/split.toml", settings)
    finger = build(case).finger
    states = {n: found.data.sel(state=n) for n in ("unloaded", "loaded")}
    k = finger.tendons.index("FDP")
    start = finger.start(build(case).posture)
    lengths = {
        n: finger.path_lengths(finger.with_angles(start, s.angle.values))[k]
        for n, s in states.items()
    }
    spec = mujoco.MjSpec.from_string(mjcf_of(case))
    tendon = next(t for t in spec.tendons if t.name == "FDP")
    bears = lengths["unloaded"] - drawn + slack - resting / stiffness
    tendon.stiffness = np.array([stiffness, 0.0, 0.0])
    tendon.springlength = np.array([0.0, bears])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("posture").id)
    data.ctrl[model.actuator("FDP").id] = 0.0
    while data.time < 1.0:
        mujoco.mj_step(model, data)
    ours = states["loaded"].angle.values
    assert np.abs(ours - states["unloaded"].angle.values).max() > np.radians(3.0)
    assert np.degrees(data.qpos - ours) == pytest.approx(np.zeros(4), abs=0.01)
    pull = stiffness * (lengths["loaded"] - bears)
    assert found.summary["tension_N"]["FDP"] == pytest.approx(pull, rel=1e-6)


def test_a_hinge_finger_is_not_advised_of_points_which_it_has_not() -> None:
    with pytest.raises(InputError, match=r"on which it does not slide; leave it out$"):
        run("own_pulleys_fdp", RUBS)
