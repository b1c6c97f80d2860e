"""Splints and pins of joints: closed forms, at rest, in a motion, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

import cosim
from cosim.case.file import load_case
from cosim.coupling.state_arrays import flatten, rebuild
from cosim.errors import InputError
from cosim.fmu_export.motion_parts import moving_part
from cosim.pipeline import run_case
from cosim.results.answer import answer
from cosim.results.conventions import COMPONENTS
from cosim.solve.session import Session
from rigid.chain.joint_torques import SPLINT_TRANSITION, joint_law
from tests.coupling.test_motion import cut_off
from tests.helpers.motions import PLAIN, identical

JOINTS = ("MCP", "MCP_abduction", "PIP", "DIP")
FREE = (
    PLAIN,
    'finger.tip.kind="free"',
    'finger.limit.half_range="60 deg"',
    'tendons={EDC={tension="0.1 N"},FDP={tension="0.6 N"}}',
    *(
        f'finger.passive.{j}={{stiffness="0.1 N*m/rad",rest="posture",damping="0.002 N*m*s/rad"}}'
        for j in JOINTS
    ),
)
MOVES = 'forward={duration="0.2 s",step="1 ms",must_rest=false}'
WORN = 'finger.splint.PIP={begins="0.05 s",ends="0.15 s"}'


def run(*settings: str) -> cosim.Result:
    return cosim.run(load_case("pulley_edc", [*FREE, *settings]))


def test_a_splint_is_stiff_beyond_its_range_and_stands_in_the_place_of_the_limit():
    law = joint_law(("a", "b"), lower={"a": -0.5, "b": -0.5}, upper={"a": 0.5, "b": 0.5})
    worn = law.splinted(*np.array([[np.nan, 0.1], [np.nan, 0.2], [np.nan, 20.0]]))
    q = np.array([0.7, 0.25])
    assert worn.limit(q)[0][0] == law.limit(q)[0][0]
    assert worn.limit(q)[0][1] == pytest.approx(-20 * 0.05, rel=1e-12)
    assert worn.limit(np.array([0.0, 0.15]))[0][1] == 0
    assert law.limit(q)[0][1] == 0

    def bears(angle: float) -> float:
        return float(worn.limit(np.array([0.0, angle]))[0][1])

    bend = 0.2 + SPLINT_TRANSITION
    work = quad(bears, 0.2, 0.25, points=[bend], epsabs=0, epsrel=1e-12)[0]
    stored = worn.energy(np.array([0.0, 0.25])) - law.energy(np.array([0.0, 0.25]))
    assert stored == pytest.approx(-work, rel=1e-10)


def test_a_splinted_joint_bears_what_the_tendons_leave():
    bare, held = run(), run('finger.splint.PIP={stiffness="20 N*m/rad"}')
    assert bare.summary["posture_deg"]["PIP"] - 45 > 2
    turned = held.summary["posture_deg"]["PIP"] - 45
    assert 0 < turned < 0.5
    at = held.summary["joints_at_limit"]["PIP"]
    assert at["limit_deg"] == pytest.approx(45)
    bears = [
        values["PIP"]
        for source, values in held.summary["joint_torque_Nmm"].items()
        if source != "limit"
    ]
    assert at["limit_torque_Nmm"] == pytest.approx(-sum(bears), rel=1e-6)
    assert held.audit.passed
    sums = held.ledger.groupby(["state", "body"])[[*COMPONENTS]].sum()
    assert np.abs(sums.to_numpy()).max() < 1e-6


def test_within_its_range_a_joint_turns_as_without_a_splint():
    bare, worn = run(), run('finger.splint.PIP={range=["30 deg","80 deg"]}')
    assert worn.summary["posture_deg"] == bare.summary["posture_deg"]


@pytest.fixture(scope="module")
def worn() -> cosim.Result:
    return run(MOVES, WORN)


def test_a_splint_is_put_on_where_the_joint_stands_and_taken_off(worn):
    angle, time = np.rad2deg(worn.data.angle.sel(joint="PIP").values), worn.data.time.values
    free = np.rad2deg(run(MOVES).data.angle.sel(joint="PIP").values)
    on = (time > 0.05 - 1e-9) & (time < 0.15 + 1e-9)
    assert np.abs(angle[on] - free[np.argmin(abs(time - 0.05))]).max() < 0.5
    np.testing.assert_array_equal(angle[time < 0.05 + 1e-9], free[time < 0.05 + 1e-9])
    assert np.ptp(free[on]) > 3 * np.ptp(angle[on])
    assert worn.summary["began"]["splint_PIP"]["time_s"] == pytest.approx(0.05)
    assert worn.summary["taken_off"]["splint_PIP"]["time_s"] == pytest.approx(0.15)
    said = " ".join(answer(worn.summary))
    assert "The splint of the PIP was put on at 0.05 s." in said
    assert "The splint of the PIP was taken off at 0.15 s" in said
    assert "the splint of the PIP was taken off at" in worn.frames[-1].label
    assert list(worn.data.event.values) == [
        "the splint of the PIP was put on",
        "the splint of the PIP was taken off",
    ]


def test_its_books_close(worn):
    assert worn.audit.passed
    energy = worn.summary["energy_mJ"]
    assert energy["splints"] == pytest.approx(worn.summary["taken_off"]["splint_PIP"]["lost_mJ"])
    spent = energy["joints_stored"] + energy["joints_dissipated"] + energy["kinetic"]
    given = energy["tendons"] + energy["own_tendons"] - energy["hood_stored"]
    assert spent + energy["splints"] + energy["artificial"] == pytest.approx(given, rel=1e-9)
    finer = run(MOVES.replace("1 ms", "0.5 ms"), WORN).summary["energy_mJ"]
    assert finer["artificial"] == pytest.approx(energy["artificial"] / 2, rel=0.1)
    sums = worn.ledger.groupby(["state", "body"])[[*COMPONENTS]].sum()
    assert np.abs(sums.to_numpy()).max() < 1e-9
    torque = worn.ledger.query("source == 'limit'")[[*COMPONENTS]].to_numpy()
    assert np.abs(torque).max() > 1e-3


def test_a_motion_in_its_splint_comes_to_rest_where_the_equilibrium_is():
    splint = 'finger.splint.PIP={range=["40 deg","46 deg"],stiffness="5 N*m/rad"}'
    ramp = 'tendons.{}.signal={{kind="points",at=[["0 s",0.0],["0.05 s",1.0]]}}'
    aim = run(splint, 'solve.resting_tension="0 N"')
    signals = [ramp.format(name) for name in ("EDC", "FDP")]
    end = run(splint, MOVES.replace("0.2", "0.5"), *signals, 'solve.resting_tension="0 N"')
    for joint, angle in aim.summary["posture_deg"].items():
        assert end.summary["posture_deg"][joint] == pytest.approx(angle, abs=0.02)


def test_steps_by_their_error_end_where_a_splint_is_put_on():
    adaptive = MOVES.replace("0.2", "0.16") + ';forward.adaptive.tolerance="0.05 deg"'
    odd = 'finger.splint.PIP={begins="0.05037 s",ends="0.15011 s"}'
    summary = run(*adaptive.split(";"), odd).summary
    assert summary["began"]["splint_PIP"]["time_s"] == pytest.approx(0.05037, abs=1e-12)
    assert summary["taken_off"]["splint_PIP"]["time_s"] == pytest.approx(0.15011, abs=1e-12)


def test_a_motion_with_a_splint_goes_on_from_a_checkpoint(worn, tmp_path: Path):
    case = load_case("pulley_edc", [*FREE, MOVES, WORN, "forward.checkpoint=40"])
    cut_off(case, tmp_path, 2)
    assert identical(worn, run_case(case, Session(checkpoints=tmp_path)))


def test_fmus_wear_the_splint_as_the_motion_does(worn):
    case = load_case("pulley_edc", [*FREE, MOVES, WORN])
    unit = moving_part(case, case.forward, "coupled", False)
    given = {"tension": np.array([*worn.summary["tension_N"].values()])}
    state, _ = unit.initial(given)
    for k in range(1, 201):
        state, out = unit.step(state, given, 1e-3)
        if k == 100:
            arrays = flatten(state, unit.special())
            state = rebuild(unit.template(), arrays, unit.special())
    np.testing.assert_allclose(out["angle"], worn.data.angle.values[200], rtol=1e-9)


def test_an_fmu_of_the_finger_alone_wears_it():
    splint = 'finger.splint.PIP={range=["44 deg","45.2 deg"],ends="0.1 s"}'
    case = load_case("pulley_edc", [*FREE, MOVES, splint])
    unit = moving_part(case, case.forward, "finger", False)
    given = {q.name: np.zeros(q.shape) for q in unit.quantities if q.causality != "output"}
    given["tension"] = np.array([1.8 * (name == "FDP") for name in unit.finger.tendons])
    state, _ = unit.initial(given)
    angle = []
    for _ in range(200):
        state, out = unit.step(state, given, 1e-3)
        angle.append(float(np.rad2deg(out["angle"][2])))
    assert max(angle[:100]) < 45.8
    assert angle[-1] > 46.2


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (['finger.splint.PIP={range=["40 deg","30 deg"]}'], "second angle must not be below"),
        ([MOVES, 'finger.splint.PIP={begins="0.2 s",ends="0.1 s"}'], "after begins"),
        (['finger.splint.PIP={begins="0.2 s"}'], "are of a motion"),
        (['finger.splint.PIP={range=["-40 deg","-30 deg"]}'], "must lie within"),
        (["finger.splint.thumb={}"], "thumb"),
        (['finger.splint.PIP={stiffness="0 N*m/rad"}'], "stiffness"),
    ],
)
def test_what_makes_no_sense_is_refused(settings, words):
    with pytest.raises(InputError, match=words):
        load_case("pulley_edc", [*FREE, *settings])
