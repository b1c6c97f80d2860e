"""A load that is held while parts relax, beside closed forms; what is refused; what is said."""

from __future__ import annotations

import numpy as np
import pytest

import cosim
from cosim.case.file import load_case
from cosim.coupling.excursion import solve_excursions
from cosim.coupling.state_arrays import flatten, rebuild
from cosim.errors import ConvergenceError, InputError
from cosim.fmu_export.motion_parts import moving_part
from cosim.models.build import build
from cosim.pipeline import run_case
from cosim.results.answer import answer
from cosim.results.conventions import COMPONENTS
from cosim.results.quantities import meaning_of
from cosim.solve.held import held_times
from cosim.solve.session import Session
from fe_solver.materials.prony import Prony
from tests.coupling.test_motion import cut_off
from tests.helpers.motions import FREE, PLAIN, identical

COARSE = ("hood.mesh.quads=104", "output.picture=false")
SOLE = 'relaxation={hood={tissue="aponeurosis_of_the_sole"},held="240 s"}'
HALF = 'weights=[0.5],times=["10 s"]'
MOVES = 'forward={duration="0.02 s",step="2 ms",must_rest=false}'


def test_a_tendon_whose_end_is_held_loses_what_its_function_says():
    """All joints are held, so that its path does not move."""
    case = load_case(
        "pulley_edc",
        [
            'finger.tip.kind="posture"',
            'tendons.FDP={excursion="2 mm",elastic={stiffness="20 N/mm"}}',
            f'relaxation={{tendons={{{HALF}}},held="40 s"}}',
        ],
    )
    result = cosim.run(case)
    at_once = result.summary["held"]["at_once"]["tension_N"]["FDP"]
    assert at_once == pytest.approx(0.05 + 40)
    left = float(Prony(np.array([0.5]), np.array([10.0])).modulus(40.0))
    assert result.summary["tension_N"]["FDP"] == pytest.approx(0.05 + 40 * left, rel=1e-6)
    times = result.data.held_time.values
    assert (times[0], times[-1]) == (0, pytest.approx(40))
    assert result.audit.passed


def test_another_start_and_another_slide_find_the_tendon_as_long_as_it_has_become():
    case = load_case(
        "pulley_edc",
        [
            'tendons.FDP={excursion="1 mm",elastic={stiffness="20 N/mm"},friction=0.1}',
            f'relaxation={{tendons={{{HALF}}},held="40 s"}}',
            "solve.second_start=true",
        ],
    )
    summary = cosim.run(case).summary
    assert summary["fingertip_magnitude_N"] > 1
    assert summary["audit"]["second_start_force_N"] < 1e-6 * summary["fingertip_magnitude_N"]
    loading = summary["friction"]["sliding"]["loading"]["fingertip_magnitude_N"]
    assert loading == pytest.approx(summary["fingertip_magnitude_N"])


def test_passive_joints_end_with_what_is_left_of_their_stiffness():
    """As joints of half the stiffness do whose torque in the unloaded posture is the same."""
    stated = 'finger.passive.PIP={{stiffness="{} N*m/rad",rest="{} deg"}}'
    common = [
        'finger.tip.kind="free"',
        'tendons.FDP.tension="0.4 N"',
        *(
            f'finger.passive.{j}={{stiffness="0.1 N*m/rad",rest="posture"}}'
            for j in ("MCP", "MCP_abduction", "DIP")
        ),
    ]
    rest = 60.0
    long = f'relaxation={{joints={{{HALF}}},held="1e6 s"}}'
    relaxed = cosim.run(load_case("pulley_edc", [*common, stated.format(0.1, rest), long]))
    assert relaxed.audit.passed
    at_rest = relaxed.summary["unloaded"]["posture_deg"]
    softer = [
        f'finger.passive.{j}={{stiffness="0.05 N*m/rad",rest="{2 * r - at_rest[j]:.14g} deg"}}'
        for j, r in (("MCP", 30), ("MCP_abduction", 0), ("DIP", 15), ("PIP", rest))
    ]
    known = cosim.run(load_case("pulley_edc", [*common[:2], *softer]))
    for joint, angle in known.summary["posture_deg"].items():
        assert relaxed.summary["posture_deg"][joint] == pytest.approx(angle, abs=2e-3)
    at_once = np.rad2deg(relaxed.data.held_angle.values[0])
    assert np.abs(at_once - np.rad2deg(relaxed.data.held_angle.values[-1])).max() > 0.5


def test_joints_that_relax_in_a_motion_come_to_rest_where_those_of_an_equilibrium_do():
    """With its books closed on the way, in which what they lost is dissipated."""
    joints = [
        f'finger.passive.{j}={{stiffness="0.1 N*m/rad",rest="posture",damping="0.002 N*m*s/rad"}}'
        for j in ("MCP", "MCP_abduction", "PIP", "DIP")
    ]
    common = [
        *('finger.tip.kind="free"', 'solve.resting_tension="0 N"', PLAIN, *joints),
        *(
            'tendons={EDC={tension="0.1 N"},FDP={tension="0.6 N"}}',
            'finger.limit.half_range="60 deg"',
        ),
    ]
    law = 'joints={weights=[0.5],times=["0.03 s"]}'
    aim = cosim.run(load_case("pulley_edc", [*common, f'relaxation={{{law},held="100 s"}}']))
    ramp = 'tendons.{}.signal={{kind="points",at=[["0 s",0.0],["0.05 s",1.0]]}}'
    move = 'forward={duration="1 s",step="1 ms",must_rest=false}'
    signals = [ramp.format(name) for name in ("EDC", "FDP")]
    moved = cosim.run(load_case("pulley_edc", [*common, *signals, move, f"relaxation={{{law}}}"]))
    assert moved.audit.passed
    for joint, angle in aim.summary["posture_deg"].items():
        assert moved.summary["posture_deg"][joint] == pytest.approx(angle, abs=0.02)
    energy = moved.summary["energy_mJ"]
    assert energy["joints_stored"] > 0
    spent = energy["joints_stored"] + energy["joints_dissipated"] + energy["kinetic"]
    given = energy["tendons"] + energy["own_tendons"] - energy["hood_stored"]
    assert spent == pytest.approx(given, rel=5e-3)
    sums = moved.ledger.groupby(["state", "body"])[[*COMPONENTS]].sum()
    assert np.abs(sums.to_numpy()).max() < 1e-9
    stiff = cosim.run(load_case("pulley_edc", common))
    assert moved.summary["posture_deg"]["PIP"] > stiff.summary["posture_deg"]["PIP"] + 0.5


@pytest.fixture(scope="module")
def held() -> cosim.Result:
    return cosim.run(load_case("isometric_edc", [*COARSE, SOLE, "solve.second_start=true"]))


def test_under_given_tensions_a_hood_that_relaxes_bears_hardly_less(held):
    before, after = held.summary["held"]["at_once"], held.summary
    plain = cosim.run(load_case("isometric_edc", COARSE))
    assert before["fingertip_magnitude_N"] == plain.summary["fingertip_magnitude_N"]
    assert before["slip_force_N"] == plain.summary["slip_force_N"]
    assert after["unloaded"] == plain.summary["unloaded"]
    change = after["fingertip_magnitude_N"] / before["fingertip_magnitude_N"] - 1
    assert 1e-4 < abs(change) < 0.02
    longer = held.strain.loc["longitudinal", "mean"] / plain.strain.loc["longitudinal", "mean"]
    assert 1.3 < longer < 1 / 0.6  # creep is slower than relaxation
    assert held.audit.passed
    assert held.summary["audit"]["second_start_force_N"] < 1e-5
    assert "half_degree" not in after


def test_what_is_said_of_it_has_the_time_and_both_forces(held):
    said = [line for line in answer(held.summary) if line.startswith("In 240 s under load")]
    assert len(said) == 1
    assert "the fingertip force from 0.36" in said[0]
    meaning = meaning_of("held.at_once.slip_force_N.central", held.summary)
    assert meaning == "force in the central slip, at once"


SUTURED = (
    *COARSE,
    'lesion={cut=["central_slip"],suture.central_slip={stiffness="50 N/mm"}}',
    'gives_way.suture_central_slip={force="24 N"}',
)
CYCLES = 'relaxation={{hood={{tissue="aponeurosis_of_the_sole"}},cycles={{count={},period="2 s"}}}}'


@pytest.mark.slow
def test_the_first_load_is_that_at_once():
    plain, once = (
        cosim.run(load_case("isometric_edc", [*SUTURED, *more]))
        for more in ([], [CYCLES.format(1)])
    )
    assert once.summary["slip_force_N"] == plain.summary["slip_force_N"]
    assert once.summary["held"]["time_s"] == 0


@pytest.mark.slow
def test_a_suture_gives_more_in_a_day_than_in_ten_thousand_loads_and_unloads():
    """Both beside the elastic law at its two ends: at once and with what is left in the end."""
    steady = SOLE.replace("240 s", "86400 s")
    day, cycles = (
        cosim.run(load_case("isometric_edc", [*SUTURED, more]))
        for more in (steady, CYCLES.format(10_000))
    )
    gap = [day.summary["held"]["at_once"]["repair_stretch_mm"]["suture_central_slip"]]
    gap += [r.summary["held"]["repair_stretch_mm"]["suture_central_slip"] for r in (cycles, day)]
    assert gap[0] < 0.8 * gap[1] < 0.8 * gap[2]
    left = Prony.fung(0.118, 0.5, 1500.0).left
    borne = day.summary["repair_force_N"]["suture_central_slip"]
    before = day.summary["held"]["at_once"]["slip_force_N"]["central"]
    assert gap[2] == pytest.approx(gap[0] * borne / before / left, rel=0.05)
    strength = day.summary["strength"]["suture_central_slip"]
    assert strength["share"] == pytest.approx(borne / 24)
    assert strength["stretch_mm"] == pytest.approx(gap[2])
    assert "energy_mJ" not in strength
    grows = day.data.held_repair_stretch.values[:, 0]
    assert (np.diff(grows) > -1e-12).all()
    assert day.audit.passed
    assert cycles.audit.passed


@pytest.mark.slow
def test_loads_in_one_step_are_those_one_after_the_other(monkeypatch):
    case = load_case("isometric_edc", [*SUTURED, CYCLES.format(40)])
    gaps = []
    for steps in (4, 39):
        monkeypatch.setattr(cosim.solve.held, "STEPS", steps)
        gaps.append(cosim.run(case).data.held_repair_stretch.values[-1, 0])
    assert gaps[0] == pytest.approx(gaps[1], rel=3e-3)


@pytest.mark.slow
def test_a_tendon_drawn_by_a_length_loses_a_third_of_its_force():
    case = load_case("isometric_edc", [*COARSE, SOLE, 'tendons.EDC={excursion="3 mm"}'])
    summary = cosim.run(case).summary
    share = summary["tension_N"]["EDC"] / summary["held"]["at_once"]["tension_N"]["EDC"]
    assert share == pytest.approx(0.64, abs=0.02)


@pytest.mark.slow
def test_a_motion_of_a_hood_that_relaxes_goes_on_from_a_checkpoint_and_closes_its_books(tmp_path):
    move = 'forward={duration="0.06 s",step="2 ms",must_rest=false,checkpoint=6}'
    pull = 'tendons.EDC.signal={kind="points",at=[["0 s",0.1],["0.05 s",1.0]]}'
    quick = 'relaxation.hood={weights=[0.5],times=["0.02 s"]}'
    case = load_case("isometric_edc", [PLAIN, *FREE, *COARSE, move, pull, quick])
    whole = cosim.run(case)
    cut_off(case, tmp_path, 1)
    assert identical(whole, run_case(case, Session(checkpoints=tmp_path)))
    energy = whole.summary["energy_mJ"]
    assert energy["hood_relaxed"] > 0.05 * energy["hood_stored"] > 0
    stiff = cosim.run(load_case("isometric_edc", [PLAIN, *FREE, *COARSE, move, pull]))
    assert "hood_relaxed" not in stiff.summary["energy_mJ"]
    assert whole.excursions["EDC"] > stiff.excursions["EDC"]


@pytest.mark.slow
def test_an_fmu_of_a_motion_relaxes_as_the_motion_does():
    quick = 'relaxation.hood={weights=[0.5],times=["0.02 s"]}'
    steady = 'tendons.EDC.signal={kind="points",at=[["0 s",1.0]]}'
    case = load_case("isometric_edc", [PLAIN, *FREE, steady, *COARSE, MOVES, quick])
    result = cosim.run(case)
    part = moving_part(case, case.forward, "coupled", False)
    given = {"tension": np.array([*result.summary["tension_N"].values()])}
    state, _ = part.initial(given)
    for _ in range(5):
        state, _ = part.step(state, given, 2e-3)
    arrays = flatten(state, part.special())
    state = rebuild(part.template(), arrays, part.special())
    for _ in range(5):
        state, out = part.step(state, given, 2e-3)
    angles = [*result.summary["posture_deg"].values()]
    np.testing.assert_allclose(np.rad2deg(out["angle"]), angles, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "settings", "words"),
    [
        ("isometric_edc", ["relaxation={}"], "says nothing of what relaxes"),
        ("isometric_edc", ['relaxation.held="1 s"'], "says nothing of what relaxes"),
        ("isometric_edc", ['relaxation.hood={tissue="ligament"}'], "needs held"),
        ("isometric_edc", [SOLE, MOVES], "a motion has its own time"),
        ("isometric_edc", [SOLE, "hood.contact.friction=0.1"], "augmented"),
        ("isometric_edc", [SOLE, 'gives_way.terminal_slip={stretch="1 mm"}'], "at a force alone"),
        (
            "isometric_edc",
            ['relaxation.hood={tissue="ligament"}', MOVES, 'gives_way.terminal_slip={force="1 N"}'],
            "does not give way in a motion",
        ),
        ("isometric_edc", [SOLE, 'coupling.scheme="one_way"'], "of a coupled hood"),
        ("isometric_edc", [SOLE, 'solve.start="nearby"'], "does not depend on its path"),
        ("pulley_edc", [SOLE], "does not relax"),
        ("pulley_edc", [f'relaxation={{tendons={{{HALF}}},held="1 s"}}'], "is elastic"),
        (
            "little_edc",
            [f'relaxation={{joints={{{HALF}}},held="1 s"}}'],
            "no passive joints",
        ),
        ("isometric_edc", ['relaxation={hood={weights=[0.5]},held="1 s"}'], "needs both"),
        ("isometric_edc", ['relaxation={hood={spectrum=0.1},held="1 s"}'], "needs both"),
        (
            "isometric_edc",
            [f'relaxation={{hood={{tissue="ligament",{HALF}}},held="1 s"}}'],
            "write one of the three",
        ),
        (
            "isometric_edc",
            ['relaxation={hood={weights=[0.6,0.6],times=["1 s","2 s"]},held="1 s"}'],
            "more than 1",
        ),
        (
            "isometric_edc",
            ['relaxation={hood={weights=[0.6],times=["1 s","2 s"]},held="1 s"}'],
            "1 weights and 2 times",
        ),
        (
            "isometric_edc",
            ['relaxation={hood={spectrum=0.1,shortest="2 s",longest="1 s"},held="1 s"}'],
            "above shortest",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(name, settings, words):
    with pytest.raises(InputError, match=words):
        load_case(name, settings)


def test_a_later_law_and_a_later_time_take_the_place_of_earlier_ones():
    later = f'relaxation={{hood={{{HALF}}},cycles={{count=2,period="1 s"}}}}'
    stated = load_case("isometric_edc", [SOLE, later]).relaxation
    assert stated.hood.tissue is None
    assert stated.held is None
    both = load_case(
        "isometric_edc",
        [
            later,
            "relaxation.hood.spectrum=0.1",
            *(
                f'relaxation.hood.{end}="{time} s"'
                for end, time in (("shortest", 1), ("longest", 9))
            ),
        ],
    )
    assert both.relaxation.hood.weights is None


def test_tendons_alone_that_relax_and_find_no_equilibrium_say_when(monkeypatch):
    def fails_later(prescribed, at, time, trial):
        if time > 0:
            raise ConvergenceError("no tension was found.")
        return solve_excursions(prescribed, at, time, trial)

    monkeypatch.setattr("cosim.solve.static.solve_excursions", fails_later)
    drawn = 'tendons.FDP={excursion="1 mm",elastic={stiffness="20 N/mm"}}'
    case = load_case("pulley_edc", [drawn, f'relaxation={{tendons={{{HALF}}},held="40 s"}}'])
    with pytest.raises(ConvergenceError, match=r"after 1 s under load, when 95.2 %"):
        cosim.run(case)


@pytest.mark.slow
def test_a_hood_of_which_nothing_is_left_runs_away_and_says_so():
    nothing = 'relaxation={hood={weights=[1.0],times=["1 s"]},held="1e6 s"}'
    with pytest.raises(ConvergenceError, match=r"under load, when .* % of what is borne at once"):
        cosim.run(load_case("isometric_edc", [*COARSE, nothing]))


def test_a_hood_that_was_replaced_by_one_that_does_not_relax_is_refused():
    case = load_case("isometric_edc", [*COARSE, SOLE])
    other = case.model_copy(update={"hood": load_case("pulley_edc").hood})
    with pytest.raises(InputError, match=r'kind "pulley" does not relax'):
        cosim.run(other)


def test_what_asks_a_model_without_time_says_that_it_does_not_relax():
    case = load_case("isometric_edc", [*COARSE, SOLE])
    with pytest.raises(InputError, match="parts relax in a run"):
        build(case)


def test_the_times_under_load_end_where_they_should_and_grow_evenly():
    times = held_times(240.0, 0.5, 12)
    assert times[-1] == pytest.approx(240.0)
    assert len(times) == 12
    np.testing.assert_allclose(np.diff(np.log(times)), np.log(240 / 0.05) / 11)
