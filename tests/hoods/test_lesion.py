"""Injury and repair of a hood: what a case may say, what is cut, and what a clinician would see."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.analyses.lesion import both_sides, freed_text
from cosim.case.file import load_case, resolved_toml
from cosim.errors import InputError
from cosim.hoods.kinds import AnyHood, unfit_lesion
from cosim.hoods.lesion import LesionConfig
from cosim.hoods.lumped.build import apply_lesion_to_network
from cosim.pipeline import run_case

PARTLY = "lesion.cut_partly.central_band=0.5"
COARSE, FINER = "hood.mesh.quads=104", "hood.mesh.quads=400"
SPACED = 'hood.mesh.spacing="3 mm"'
EXTENDING = ('tendons.EDC.tension="5 N"', 'tendons.FDP.tension="1 N"')
FREE = ("finger.tip.kind=free", 'finger.limit.half_range="40 deg"', *EXTENDING)
CENTRAL, TERMINAL = 'lesion.cut=["central_slip"]', 'lesion.cut=["terminal_slip"]'
HOODS = {
    "shell": ("lesion_mallet", COARSE),
    "cable": ("cable_edc", SPACED, *FREE),
    "network": ("network_edc", *FREE),
    "two_band": ("two_band_edc", *FREE),
}
SELDOM_FINE = [
    pytest.param(h, marks=pytest.mark.slow) if h in ("shell", "cable") else h for h in HOODS
]


@cache
def posture(hood: str, *lesion: str) -> dict[str, float]:
    """deg, of the free finger under EDC and FDP, intact where no lesion is given."""
    name, *settings = HOODS[hood]
    case = load_case(name, [*settings, *lesion])
    if not lesion:
        case = case.model_copy(update={"lesion": None})
    return run_case(case).summary["posture_deg"]


def change(hood: str, joint: str, *lesion: str) -> float:
    return posture(hood, *lesion)[joint] - posture(hood)[joint]


# What a clinician sees


@pytest.mark.parametrize("hood", SELDOM_FINE)
def test_without_its_central_slip_the_pip_lags_and_the_dip_extends(hood):
    assert change(hood, "PIP", CENTRAL) > 0.3
    assert change(hood, "DIP", CENTRAL) < -0.3


@pytest.mark.parametrize("hood", SELDOM_FINE)
def test_without_its_terminal_slip_the_dip_drops_and_the_pip_extends(hood):
    """The shell's PIP stands on its palmar plate."""
    assert change(hood, "DIP", TERMINAL) > 2.0
    assert change(hood, "PIP", TERMINAL) < (0.0 if hood == "shell" else -0.3)


@pytest.mark.slow
def test_a_central_slip_that_pulls_harder_makes_it_a_swan_neck():
    neck, mallet = (
        sides_of(f"lesion_{name}")[1]["posture_deg"] for name in ("swan_neck", "mallet")
    )
    assert neck["PIP"] < mallet["PIP"] - 5.0


ALONE = tuple(
    f'tendons.{name}.tension="0.05 N"' for name in ("EI", "LUM", "FPI", "FDS", "FDIm", "FDIl")
)
"""No tone but of EDC and FDP."""
EVEN = ('tendons.EDC.tension="3 N"', 'tendons.FDP.tension="3 N"', *ALONE)
FLEXED = {"MCP": 46, "PIP": 60, "DIP": 25}
"""deg, where a free finger comes to rest under EVEN."""


@cache
def pull(edc: str, *lesion: str) -> float:
    """N mm, the hood's torque at the PIP on bones held FLEXED."""
    held = [f'finger.posture.{joint}="{angle} deg"' for joint, angle in FLEXED.items()]
    tension = f'tendons.EDC.tension="{edc}"'
    settings = [FINER, *held, *lesion, "finger.tip.kind=posture", *ALONE, tension]
    case = load_case("lesion_mallet", settings)
    if not lesion:
        case = case.model_copy(update={"lesion": None})
    return run_case(case).summary["joint_torque_Nmm"]["hood"]["PIP"]


@pytest.mark.slow
def test_in_a_flexed_finger_a_mallet_injury_turns_the_pull_to_extend():
    """Torque of the hood at the PIP, N mm (flexion positive), 46/60/25 deg held, before -> after:
    by EDC's 3 N, over rest, -17.2 -> -17.9, all of it to the central slip, which lies further
    dorsal of the axis than the lateral bands; at rest -2.6 -> -2.5, for a hood at rest holds
    nothing that the cut could let go.  The first is what makes a swan neck."""
    rest, full = pull("0.05 N"), pull("3 N")
    rest_cut, full_cut = pull("0.05 N", TERMINAL), pull("3 N", TERMINAL)
    assert (full_cut - rest_cut) - (full - rest) < -0.5
    assert abs(rest_cut - rest) < 0.5


@pytest.mark.slow
def test_a_mallet_finger_against_a_strong_flexor_drops_its_dip_and_its_pip_stays():
    """EDC 3 N and FDP 3 N, free: the PIP rests at 60 deg.  A swan neck is made by an extensor that
    outweighs the flexor, and is not to be expected there.  Torques at the PIP, N mm, before ->
    after: FDP 29.3 -> 29.2, whose arm does not grow with the DIP's drop of 14 deg; hood -19.4 ->
    -18.9, as above; passive -10.3 -> -10.7, by which the PIP gives way 0.7 deg."""
    after = load_case("lesion_mallet", [COARSE, *EVEN])
    one, two = (run_case(c).summary for c in (after.model_copy(update={"lesion": None}), after))
    moved = {j: two["posture_deg"][j] - one["posture_deg"][j] for j in ("PIP", "DIP")}
    by = {
        s: two["joint_torque_Nmm"][s]["PIP"] - t["PIP"] for s, t in one["joint_torque_Nmm"].items()
    }
    assert moved["DIP"] > 5.0
    assert abs(moved["PIP"]) < 1.5
    assert abs(by["FDP"]) < 0.3 * abs(by["hood"])
    assert sum(by.values()) == pytest.approx(0.0, abs=0.01)


@cache
def sides_of(name: str, *settings: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """The summaries before and after, fingertip free."""
    sides = both_sides(load_case(name, [COARSE, *settings]))
    one, two = (run_case(sides["free", side]).summary for side in ("before", "after"))
    return one, two


def test_the_intact_finger_is_straight_and_a_mallet_finger_droops_as_a_clinician_sees_it():
    before, after = sides_of("lesion_mallet")
    intact = before["posture_deg"]
    assert max(abs(intact[joint]) for joint in ("MCP", "PIP", "DIP")) < 5.0
    assert before["spring_force_N"]["loose_tissue"] == 0.0
    assert 30.0 < after["posture_deg"]["DIP"] - intact["DIP"] < 50.0


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["lesion_boutonniere", "lesion_swan_neck", "lesion_extensor_tendon"]
)
def test_every_intact_finger_that_extends_is_straight_and_no_limit_bears_it(name):
    before, after = sides_of(name)
    assert max(abs(before["posture_deg"][joint]) for joint in ("MCP", "PIP", "DIP")) < 5.0
    for s in (before, after):
        assert all(not at["limit_torque_Nmm"] for at in s.get("joints_at_limit", {}).values())


@pytest.mark.slow
def test_a_shorter_terminal_slip_extends_the_dip_the_more_the_shorter_it_is():
    """A given tension pulls, so that the slip takes over what the central slip bears."""
    dip, bears = [], []
    for less in (0.25, 0.5, 1.0):
        setting = f'lesion.shorten.terminal_slip="{less} mm"'
        before, after = sides_of("lesion_terminal_shortened", setting)
        dip.append(before["posture_deg"]["DIP"] - after["posture_deg"]["DIP"])
        bears.append(after["slip_force_N"]["terminal"] - before["slip_force_N"]["terminal"])
    assert 0.1 < dip[0] < dip[1] < dip[2] < np.rad2deg(1e-3 / 2e-3)
    assert 0.1 < bears[0] < bears[1] < bears[2]


CUTS = ("boutonniere", "boutonniere_fibres", "boutonniere_triangular")


@pytest.mark.slow
def test_grau_s_cuts_make_a_boutonniere_in_his_order():
    """The slip alone, a loss of extension; the deformity, with the bands palmar of the axis, by the
    fibres.  The triangular ligament changes it by some degrees, where it should make it."""
    found = [sides_of(f"lesion_{name}")[1] for name in CUTS]
    lag = [
        s["posture_deg"]["PIP"] - sides_of("lesion_boutonniere")[0]["posture_deg"]["PIP"]
        for s in found
    ]
    height = [max(s["lateral_band_height_mm"].values()) for s in found]
    assert 1.0 < lag[0] < 30.0 < min(lag[1:])
    assert height[0] > 0 > max(height[1:])


@pytest.mark.slow
def test_elson_s_test_stiffens_the_dip():
    intact, cut = sides_of("lesion_elson_test")
    assert intact["posture_deg"]["PIP"] == pytest.approx(90.0, abs=0.5)
    assert cut["slip_force_N"]["terminal"] > 3 * intact["slip_force_N"]["terminal"]
    assert cut["posture_deg"]["DIP"] < intact["posture_deg"]["DIP"] - 5.0


@pytest.mark.slow
def test_the_tendon_slips_off_the_mcp_by_the_radial_cut_alone():
    intact, radial = sides_of("lesion_sagittal_band_radial")
    _, ulnar = sides_of("lesion_sagittal_band_radial", 'lesion.cut=["sagittal_band_ulnar"]')
    assert abs(ulnar["tendon_shift_mm"] - intact["tendon_shift_mm"]) < 0.1
    assert radial["tendon_shift_mm"] < intact["tendon_shift_mm"] - 3.0


@pytest.mark.slow
@pytest.mark.parametrize("mcp", [0, 45])
def test_the_loose_tissue_holds_the_stump_of_a_cut_tendon(mcp):
    """All of its 9.81 N but what the sheet beside it takes."""
    case = load_case("cuts_extensor_tendon", [COARSE, f'finger.posture.MCP="{mcp} deg"'])
    cut = run_case(case).summary
    assert cut["spring_force_N"]["loose_tissue"] > 7.5
    assert cut["slip_force_N"]["central"] < 0.3


@pytest.mark.slow
def test_the_pip_lags_the_more_the_more_of_the_tendon_is_cut():
    """deg of the PIP by the share of the width: 75 % is hardly seen, all of it is a lag."""
    key, partly = "lesion.cut_partly.extensor_tendon_distal", "lesion_extensor_tendon_partly"
    runs = [(partly, f"{key}={share}") for share in (0.5, 0.75, 0.97)]
    lag = [sides_of(*run)[1]["posture_deg"]["PIP"] for run in (*runs, ("lesion_extensor_tendon",))]
    assert lag == sorted(lag)
    assert lag[1] - lag[0] < 5.0
    assert lag[-1] - lag[-2] > 10.0


@pytest.mark.parametrize("kind", ["cable", "two_band"])
def test_only_a_shell_can_be_cut_in_part(kind):
    with pytest.raises(InputError, match=r"lesion\.cut_partly: .*\"shell\" can be cut in part"):
        load_case(HOODS[kind][0], [PARTLY])


def test_a_part_is_cut_whole_or_in_part():
    with pytest.raises(InputError, match="central_band is both cut and cut_partly"):
        load_case("lesion_mallet", ['lesion.cut=["central_band"]', PARTLY])
    with pytest.raises(InputError, match=r"central_band = 1\.5"):
        load_case("lesion_mallet", ["lesion.cut_partly.central_band=1.5"])


@pytest.mark.slow
def test_a_central_band_that_sticks_to_the_proximal_phalanx_keeps_the_pip_from_flexing():
    before, after = (s["posture_deg"] for s in sides_of("lesion_adhesion"))
    assert after["PIP"] < before["PIP"] - 5.0
    assert after["DIP"] < before["DIP"] - 2.0


@pytest.mark.slow
def test_a_severed_lateral_band_drops_the_dip_half_way():
    """Less than without the whole slip."""
    one = change("shell", "DIP", 'lesion.cut=["lateral_band_ulnar"]')
    assert 0.2 < one < 0.7 * change("shell", "DIP", TERMINAL)


# Hoods in lumped form


def slips(*settings: str) -> dict[str, float]:
    return run_case(load_case("network_edc", [*settings])).summary["slip_force_N"]


def test_a_shorter_tendon_of_a_network_takes_its_part_of_the_force():
    """Two sets of springs on one junction, k1 and k2: the shorter one takes k1 k2 / (k1 + k2) d."""
    held = ("finger.tip.kind=posture", 'solve.resting_tension="0 N"', 'tendons.EDC.tension="20 N"')
    less = slips(*held)
    more = slips(*held, 'lesion.shorten={central_slip="0.05 mm"}')
    assert less["terminal"] > 4.1  # so that no spring goes slack
    expected = 126e3 * 80e3 / 206e3 * 0.05e-3
    assert more["central"] - less["central"] == pytest.approx(expected, rel=1e-9)
    assert sum(more.values()) == pytest.approx(20.0, rel=1e-9)


def test_a_longer_tendon_of_a_network_has_a_longer_rest_length():
    case = load_case("network_edc", ['lesion={lengthen={terminal_slip="4 mm"}}'])
    rests = {n: t.rest for n, t in case.hood.connecting.items()}
    injured = apply_lesion_to_network(case.hood, case.lesion).connecting
    longer = {name: injured[name].rest - rests[name] for name in rests}
    ends = {n for n, t in case.hood.connecting.items() if "DIP" in t.arms}
    assert {n for n, more in longer.items() if more} == ends
    assert [longer[name] for name in ends] == pytest.approx([4e-3] * len(ends), rel=1e-12)


def test_longer_is_the_reverse_of_shorter():
    held = ("finger.tip.kind=posture", 'solve.resting_tension="0 N"', 'tendons.EDC.tension="20 N"')
    longer = slips(*held, 'lesion={lengthen={terminal_slip="0.05 mm"}}')
    shorter = slips(*held, 'lesion={shorten={central_slip="0.05 mm"}}')
    assert longer == pytest.approx(shorter, rel=1e-9)


@pytest.mark.parametrize(
    ("part", "other"), [("central_slip", "terminal"), ("terminal_slip", "central")]
)
def test_what_one_band_loses_the_other_bears(part, other):
    case = load_case("two_band_edc", [f'lesion={{cut=["{part}"]}}'])
    summary = run_case(case).summary
    assert summary["slip_force_N"][other] == pytest.approx(summary["tension_N"]["EDC"], rel=1e-12)


def test_two_bands_as_a_network_are_the_same_hood():
    """A lesion too small to see changes nothing."""
    plain = run_case(load_case("two_band_edc", [])).summary
    touched = run_case(load_case("two_band_edc", ['lesion={shorten={central_slip="1e-9 mm"}}']))
    assert touched.summary["fingertip_force_N"] == pytest.approx(
        plain["fingertip_force_N"], rel=1e-6, abs=1e-9
    )


def test_a_muscle_of_a_network_that_would_pull_on_nothing_is_refused():
    case = load_case("network_edc", ['lesion.cut=["central_slip", "terminal_slip"]'])
    with pytest.raises(InputError, match="leaves no connecting tendon for EDC"):
        apply_lesion_to_network(case.hood, case.lesion)
    one = load_case("network_edc", ['lesion.cut=["edc_slip"]'])
    assert "edc_slip" not in apply_lesion_to_network(one.hood, one.lesion).connecting


# What a case may say


@pytest.mark.parametrize(
    ("name", "setting", "message"),
    [
        ("lesion_mallet", 'lesion.cut=["central_slp"]', "did you mean central_slip"),
        (
            "lesion_mallet",
            'lesion.cut=["central_slip", "central_slip"]',
            "names central_slip twice",
        ),
        ("lesion_mallet", 'lesion.adhere=["retinacular_radial"]', "lesion.adhere: no part"),
        ("lesion_mallet", 'lesion.shorten.terminal_slip="1 mm"', "both cut and shortened"),
        ("lesion_mallet", 'lesion.lengthen.terminal_slip="1 mm"', "both cut and lengthened"),
        ("lesion_swan_neck", 'lesion.lengthen.central_slip="1 mm"', "shortened and lengthened"),
        ("lesion_mallet", 'lesion.lengthen.terminal_slp="1 mm"', "did you mean terminal_slip"),
        ("lesion_mallet", 'lesion.cut=["dorsal_capsule"]', "give hood.springs.dorsal_capsule"),
        ("lesion_mallet", 'lesion.shorten.central_slip="0 mm"', "above 0 mm"),
        ("lesion_mallet", "lesion.cut=[]", "is empty"),
        ("lesion_mallet", 'lesion.cute=["central_slip"]', "did you mean cut"),
        ("split_edc", CENTRAL, 'kind "split" has no parts to injure'),
        ("pulley_edc", CENTRAL, 'kind "pulley" has no parts to injure'),
        ("network_edc", 'lesion.adhere=["central_slip"]', "lies on no bone"),
        ("network_edc", 'lesion.cut=["edc_slipp"]', "did you mean edc_slip"),
        ("two_band_edc", 'lesion.cut=["lateral_band_ulnar"]', "known: central_slip, terminal_slip"),
        ("cable_edc", 'lesion.cut=["medial_slip"]', "did you mean medial_slip_"),
    ],
)
def test_a_faulty_lesion_says_where_and_what_to_write(name, setting, message):
    with pytest.raises(InputError, match="lesion") as caught:
        load_case(name, [setting])
    assert message in str(caught.value)


@given(st.text(min_size=1, max_size=20))
def test_any_name_is_known_or_refused_by_name(name):
    for hood in injurable():
        wrong = unfit_lesion(hood, hood.kind, LesionConfig(cut=(name,)))
        assert (wrong == "") == (name in hood.parts().cut)


@cache
def injurable() -> tuple[AnyHood, ...]:
    return tuple(load_case(name).hood for name in ("isometric_edc", "cable_edc", "two_band_edc"))


@pytest.mark.parametrize(("name", "what"), [("split_edc", "split"), ("network_edc", "network")])
def test_a_lesion_that_another_hood_cannot_have_is_never_ignored(name, what):
    """As where a ladder of hoods puts one in the other's place."""
    other = load_case(name).model_copy(update={"lesion": load_case("lesion_lateral_band").lesion})
    with pytest.raises(InputError, match=f'kind "{what}"'):
        run_case(other)


def test_a_lesion_survives_being_written_and_tells_settings_apart(tmp_path):
    case = load_case("lesion_swan_neck")
    (tmp_path / "again.toml").write_text(resolved_toml(case), encoding="utf-8")
    again = load_case(tmp_path / "again.toml")
    assert again.lesion == case.lesion
    assert again.lesion.shorten == {"central_slip": pytest.approx(1e-3)}
    assert case.setting_key() != case.model_copy(update={"lesion": None}).setting_key()


def test_joints_that_a_case_holds_are_freed_and_that_is_said():
    case = load_case("isometric_edc", [CENTRAL, 'finger.passive.DIP.rest="10 deg"'])
    four, free = both_sides(case), load_case("base/free_joints").finger
    assert four["free", "after"].finger.limit == free.limit
    assert four["free", "after"].finger.passive["PIP"] == free.passive["PIP"]
    assert four["free", "after"].finger.passive["DIP"] == case.finger.passive["DIP"]
    assert four["held", "after"].finger == case.finger
    assert "within 5 deg" in " ".join(freed_text(case))
    assert list(freed_text(load_case("lesion_mallet"))) == []


def test_four_runs_differ_in_lesion_and_tip_alone():
    case = load_case("lesion_mallet")
    four = both_sides(case)
    assert {k: (c.lesion is None, c.finger.tip.kind) for k, c in four.items()} == {
        ("free", "before"): (True, "free"),
        ("free", "after"): (False, "free"),
        ("held", "before"): (True, "point"),
        ("held", "after"): (False, "point"),
    }
    assert all(c.hood == case.hood and c.tendons == case.tendons for c in four.values())
    clamped = both_sides(load_case("lesion_mallet", ["finger.tip.kind=clamped"]))
    assert clamped["held", "after"].finger.tip.kind == "clamped"


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("isometric_edc", [], "has no table"),
        ("motion_edc_fdp", [CENTRAL], "is a motion"),
        ("lesion_mallet", ["finger.tip.kind=cage"], "in a device"),
    ],
)
def test_what_has_no_two_sides_is_refused(name, settings, message):
    with pytest.raises(InputError, match=message):
        both_sides(load_case(name, settings))
