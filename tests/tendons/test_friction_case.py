"""Friction along tendons in cases: the interval at rest, motions, other programs, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cosim.analyses.moment_arms import native_arms
from cosim.case.file import load_case
from cosim.errors import InputError
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
    back = run("split_fdp", RUBS, "tendons.FDP.course='unloading'").summary
    free = run("split_fdp").summary
    both = found["friction"]["course"]
    assert both["loading"]["fingertip_force_N"] == found["fingertip_force_N"]
    assert forces(both["unloading"]) == pytest.approx(forces(back), abs=1e-9)
    assert back["friction"]["course"]["loading"]["fingertip_magnitude_N"] == pytest.approx(
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
    assert is_known("friction.course.unloading.joint_torque_Nmm.FDP.PIP")


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
    interval = [forces(still["friction"]["course"][c]) for c in ("loading", "unloading")]
    assert np.linalg.norm(settled - interval[0]) < 0.5 * np.linalg.norm(interval[1] - interval[0])
    rows = [row for row in moved.rows if row.state == moved.rows[-1].state]
    for body in ("proximal", "middle", "distal"):
        total = np.sum([row.force for row in rows if row.body == body], axis=0)
        assert np.abs(total).max() < 1e-9


def test_what_knows_no_friction_keeps_its_arms_or_says_so() -> None:
    rubs, plain = (load_case("split_fdp", s) for s in ([RUBS], []))
    posture = build(plain).posture
    ours, theirs = (native_arms(build(c), posture) for c in (rubs, plain))
    assert all(np.array_equal(ours[t], theirs[t]) for t in theirs)
    assert "FDP: its friction of 0.1 at guides is left out" in mjcf_of(rubs).split("<compiler")[0]
    assert "friction" not in mjcf_of(plain)


def test_a_step_of_a_rubbing_finger_can_be_repeated() -> None:
    case = load_case("forward_fdp", [RUBS, PLAIN])
    assert case.forward is not None
    models = moving_models(case, case.forward)
    at = models.moves.begin(models.initial_state)
    once, again = models.moves.advance(at), models.moves.advance(at)
    grips = [models.finger.grip(s.coupled.finger) for s in (once, again)]
    assert grips[0].tobytes() == grips[1].tobytes()
    assert once.friction.tobytes() == again.friction.tobytes()


@pytest.mark.parametrize(
    ("name", "setting", "words"),
    [
        ("pulley_edc", "tendons.EDC.friction=0.1", "EDC runs in the hood"),
        ("network_contact_planar", RUBS, "the finger has none"),
        ("split_fdp", "tendons.FDP.course='loading'", "course without friction"),
        ("split_fdp", "tendons.FDP.friction=-0.1", "friction"),
        ("split_fdp", "tendons.XYZ.friction=0.1", "XYZ"),
    ],
)
def test_friction_where_none_can_act_is_refused(name: str, setting: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        run(name, setting)
