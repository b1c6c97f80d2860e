"""What a case says of parts that give way: what is refused, and what statics answer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import cosim
from cosim.case.file import load_case
from cosim.coupling.events import Bearing
from cosim.coupling.state_arrays import flatten, rebuild
from cosim.errors import InputError
from cosim.fmu_export.motion_parts import moving_part
from cosim.models.build import build, build_hood, case_finger, site_of
from cosim.models.fit import check_fit
from cosim.pipeline import run_case
from cosim.results.answer import answer
from cosim.solve.session import Session
from cosim.solve.strength import first_to_give_way, scaled
from tests.coupling.test_motion import cut_off
from tests.helpers.motions import FREE, PLAIN, identical

COARSE = ("hood.mesh.quads=104", "output.picture=false", 'lesion.cut=["central_slip"]')
SUTURED = (*COARSE, 'lesion.suture.central_slip={stiffness="50 N/mm"}')
BREAKS = 'gives_way.suture_central_slip={force="3 N"}'
MOVES = 'forward={duration="0.02 s",step="2 ms",must_rest=false}'


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["gives_way={}"], "is empty; name a part"),
        (["gives_way.terminal_slip={}"], "says nothing of when"),
        (['gives_way.terminal_slip={begins="1 s",over_time="1 s"}', MOVES], "never gives way"),
        (
            ['gives_way.terminal_slip={force="1 N",over_time="1 s",over_stretch="1 mm"}'],
            "leave one of them out",
        ),
        (['gives_way.terminal_slip={time="1 s",begins="2 s"}', MOVES], "after begins"),
        (['gives_way.terminal_slip={time="1 s"}'], "are of a motion"),
        (['gives_way.terminal_slip={force="1 N"}', "hood.contact.friction=0.1"], "augmented"),
        (
            ['gives_way.terminal_slip={force="1 N"}', 'coupling.scheme="one_way"'],
            "of a coupled hood",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(settings, words):
    with pytest.raises(InputError, match=words):
        load_case("isometric_edc", settings)


def test_a_hood_without_springs_has_nothing_that_gives_way():
    with pytest.raises(InputError, match=r"no springs that could; \"shell\" and \"cable\" have"):
        load_case("pulley_edc", ['gives_way.terminal_slip={force="1 N"}'])


@pytest.fixture(scope="module")
def loaded() -> cosim.Result:
    return cosim.run(
        load_case("isometric_edc", [*SUTURED, BREAKS, 'gives_way.terminal_slip={force="2 N"}'])
    )


def test_statics_name_the_part_that_would_give_way_first_and_its_load(loaded):
    share = {part: bears["share"] for part, bears in loaded.summary["strength"].items()}
    assert share["suture_central_slip"] == pytest.approx(
        loaded.summary["repair_force_N"]["suture_central_slip"] / 3
    )
    assert share["terminal_slip"] == pytest.approx(loaded.slips["terminal"] / 2)
    first = loaded.summary["first_to_give_way"]
    assert first["part"] == "terminal_slip"
    at_it = cosim.run(scaled(load_case("isometric_edc", SUTURED), first["at_times_the_loads"]))
    assert at_it.slips["terminal"] == pytest.approx(2, rel=1e-4)
    said = next(line for line in answer(loaded.summary) if "first" in line)
    assert said.startswith("The terminal slip would give way first: it bears 8")


LAWS = {
    "in proportion": lambda load: load,
    "prestressed": lambda load: 0.3 + load,
    "stiffening": lambda load: load + 0.2 * load**2,
    "slack up to 2.9 times": lambda load: max(load - 2.9, 0.0),
}
"""N that a part bears, by times the loads."""


@pytest.mark.parametrize("law", LAWS)
def test_the_load_is_a_curve_of_what_a_part_can_bear(law):
    """Through the strength that it just bears, too, and of one that is slack under the loads."""
    case, bears = load_case("pulley_edc", ["tendons.EDC.tension=5 N"]), LAWS[law]
    pull = case.tendons["EDC"].tension

    def load_at(strength: float) -> float:
        def bearing(load: float) -> Bearing:
            zero = np.zeros(1)
            return Bearing(zero, zero, zero, np.array([bears(load) / strength]), zero)

        def solve(at: cosim.Case, _: float) -> float:
            return at.tendons["EDC"].tension / pull

        found = first_to_give_way(case, (), 1.0, bearing, solve)
        assert found.load is not None, found.reason
        return found.load

    strengths = np.linspace(0.99, 1.01, 21) * (bears(1.0) or 0.4)
    loads = np.array([load_at(s) for s in strengths])
    assert [bears(load) for load in loads] == pytest.approx(strengths, rel=1e-5)
    assert np.diff(loads).min() > 0


@pytest.mark.parametrize(
    ("part", "words"),
    [
        ("suture_centralslip={force='1 N'}", "did you mean suture_central_slip"),
        ("central_slip={force='1 N'}", "no part 'central_slip'"),  # cut, which the mesh says
        ("terminal_slip={stretch='1 mm'}", r"terminal_slip\.stretch: it has no springs"),
    ],
)
def test_a_part_that_cannot_give_way_is_refused_before_anything_is_solved(part, words, monkeypatch):
    monkeypatch.setattr("cosim.solve.session.solve_equilibrium", pytest.fail)
    with pytest.raises(InputError, match=words):
        cosim.run(load_case("isometric_edc", [*SUTURED, f"gives_way.{part}"]))


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("isometric_edc", COARSE[:2]),
        (
            "isometric_edc",
            [
                *SUTURED,
                'lesion.graft.strand={start="central_band",end="terminal_slip",stiffness="9 N/mm"}',
                'lesion.adhere=["lateral_band_radial"]',
            ],
        ),
        ("cable_edc", ['lesion.adhere=["central_band"]']),
    ],
)
def test_a_check_knows_all_parts_that_the_built_hood_has_and_refuses_others(name, settings):
    built = build(load_case(name, settings)).built
    parts = [*(s.name for s in built.hood.springs), *built.others()]
    stated = [f'gives_way.{part}.force="1 N"' for part in parts]
    check_fit(load_case(name, [*settings, *stated]))
    with pytest.raises(InputError, match="the hood has no part 'foo'"):
        check_fit(load_case(name, [*settings, *stated, 'gives_way.foo.force="1 N"']))


def test_the_intact_finger_has_no_suture_that_could_give_way():
    case = load_case("isometric_edc", [*SUTURED, BREAKS, 'gives_way.terminal_slip={force="2 N"}'])
    assert [*case.without_lesion().gives_way] == ["terminal_slip"]
    build(case.without_lesion())


def test_no_hood_gives_way_in_an_fmu_of_the_finger():
    case = load_case("isometric_edc", [*SUTURED, BREAKS, MOVES])
    with pytest.raises(InputError, match="gives_way: is of the hood, which is no part"):
        moving_part(case, case.forward, "finger", False)


@pytest.mark.slow
def test_a_suture_gives_way_in_an_fmu_as_in_the_motion():
    """Within a step of the master, and from a saved state on."""
    steady = 'tendons.EDC.signal={kind="points",at=[["0 s",1.0]]}'
    breaks = 'gives_way.suture_central_slip={time="0.0045 s"}'
    short = MOVES.replace("0.02", "0.008")
    case = load_case("isometric_edc", [PLAIN, *FREE, *SUTURED, short, steady, breaks])
    result = cosim.run(case)
    part = moving_part(case, case.forward, "coupled", False)
    given = {"tension": np.array([*result.summary["tension_N"].values()])}
    state, out = part.initial(given)
    assert out["left"] == [1]
    state, out = part.step(state, given, 4e-3)
    assert out["left"] == [1]
    arrays = flatten(state, part.special())
    state = rebuild(part.template(), arrays, part.special())
    state, out = part.step(state, given, 4e-3)
    assert out["left"] == [0]
    angles = [*result.summary["posture_deg"].values()]
    np.testing.assert_allclose(np.rad2deg(out["angle"]), angles, rtol=1e-9)


@pytest.mark.slow
def test_a_suture_gives_way_in_a_motion_that_goes_on_from_a_checkpoint(tmp_path: Path):
    move = 'forward={duration="0.06 s",step="2 ms",must_rest=false,checkpoint=6}'
    pull = 'tendons.EDC.signal={kind="points",at=[["0 s",0.1],["0.05 s",1.0]]}'
    case = load_case(
        "isometric_edc",
        [PLAIN, *FREE, *SUTURED, move, pull, 'gives_way.suture_central_slip={force="1 N"}'],
    )
    whole = cosim.run(case)
    cut_off(case, tmp_path, 1)
    assert identical(whole, run_case(case, Session(checkpoints=tmp_path)))
    gone = whole.summary["gave_way"]["suture_central_slip"]
    assert gone["force_N"] == pytest.approx(1, rel=1e-6)
    assert whole.summary["energy_mJ"]["gave_way"] == pytest.approx(gone["lost_mJ"])
    assert "gave way" not in whole.frames[0].label
    assert "the suture of the central slip gave way at" in whole.frames[-1].label


@pytest.mark.parametrize("part", ["central_band", "terminal_slip"])
def test_a_part_that_was_let_go_is_one_that_was_cut(part):
    """The hood that a motion goes on with bears what that of the cut does, at one posture."""
    whole = load_case("isometric_edc", COARSE[:2])
    cut = load_case("isometric_edc", [*COARSE[:2], f'lesion.cut=["{part}"]'])
    slips = []
    for case in (whole, cut):
        finger = case_finger(case)
        motion = finger.motion(finger.start(case.native_finger().posture.angles()))
        built = build_hood(case, site_of(case, finger.rest()))
        hood = built.without([part]) if case is whole else built.hood
        pull = np.array([case.tension(name) for name in hood.tendons])
        state = hood.advance(hood.start(motion), motion, pull, np.inf).state
        slips.append(built.around(hood).slips(state))
    assert slips[0] == pytest.approx(slips[1], rel=0.01, abs=1e-9)
