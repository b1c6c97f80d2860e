"""The controls of a case say what it states, and what they change is what a case file would."""

from __future__ import annotations

import pytest

from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.schema import units
from cosim.ui.controls import (
    LESION,
    MODULI,
    changed_case,
    control_at_fault,
    controls_of,
    settings_of,
)

CASES = (
    *("isometric_edc", "lesion_boutonniere", "lesion_terminal_shortened", "motion_edc_fdp"),
    *("network_edc", "cable_edc", "pulley_edc", "two_band_edc", "split_edc", "planar_edc"),
    *("robot_cable_extensor", "middle_minorflex_edc", "lengths_terminal_4mm", "pneumatic_edc_fdp"),
)


def values(case):
    return case.model_dump(mode="json", exclude={"name", "source", "tendons"})


@pytest.mark.parametrize("name", CASES)
def test_what_the_controls_say_is_the_case(name):
    case = load_case(name)
    controls = controls_of(case)
    assert len({control.key for control in controls}) == len(controls) > 2
    same = changed_case(case, {control.key: control.text for control in controls})
    assert values(same) == values(case)
    tendons = {control.key.split(".")[1] for control in controls if control.group == "Tendons"}
    assert all(same.tension(tendon) == pytest.approx(case.tension(tendon)) for tendon in tendons)


@pytest.mark.parametrize("name", ["isometric_edc", "network_edc", "cable_edc"])
def test_a_slider_goes_where_the_schema_allows_and_its_value_is_on_it(name):
    case = load_case(name)
    for control in controls_of(case):
        if control.form != "slider" or control.low is None or control.group == LESION:
            continue
        assert control.low <= float(control.text.split(" ")[0]) <= control.high, control
        if control.group in ("Posture", "Tendons"):
            for end in (control.low, control.high):
                changed_case(case, {control.key: f"{end} {control.unit}".strip()})


def test_a_slider_says_range_and_unit_as_the_schema_does():
    thickness = next(c for c in controls_of(load_case("isometric_edc")) if c.label == "thickness")
    assert thickness.unit == "mm"
    assert "at most 5 mm" in thickness.meaning
    assert "It acts on oblique_fibres_radial, " in thickness.meaning
    assert thickness.is_log
    assert thickness.low < 0.15 < thickness.high


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"finger.posture.PIP": "50 kg"}, "finger.posture.PIP"),
        ({"hood.regions.central_slip.c5": "-1 MPa"}, "hood.regions.central_slip.c5"),
        ({"tendons.EDC.activation": "2"}, "tendons.EDC.activation"),
        ({"lesion.length.terminal_slip": "-9 mm"}, "lesion.length.terminal_slip"),
        ({"lesion.length.terminal_slip": "long"}, "lesion.length.terminal_slip"),
        ({"hood.mesh.quads": "many"}, "hood.mesh.quads"),
    ],
)
def test_a_fault_is_placed_at_its_control(changes, key):
    case = load_case("isometric_edc")
    with pytest.raises(InputError) as caught:
        changed_case(case, changes)
    places = [control_at_fault(fault.place, controls_of(case)) for fault in caught.value.faults]
    assert places == [key]


def test_a_fault_without_a_control_has_none():
    assert control_at_fault("solve.tolerance", controls_of(load_case("pulley_edc"))) == ""
    assert control_at_fault("", controls_of(load_case("pulley_edc"))) == ""


def test_a_factor_is_on_every_modulus_and_a_modulus_of_its_own_beats_it():
    case = load_case("isometric_edc")
    changed = changed_case(case, {MODULI: "2", "hood.regions.central_slip.c5": "50 MPa"})
    regions, before = changed.hood.regions, case.hood.regions
    assert regions["central_slip"].c5 == 50e6
    assert regions["central_band"].c5 == pytest.approx(2 * before["central_band"].c5)
    with pytest.raises(InputError, match="factor above 0"):
        changed_case(case, {MODULI: "0"})


@pytest.mark.parametrize(
    "changes",
    [
        {"finger.posture.PIP": "50 deg", "tendons.EDC.activation": "0.2"},
        {MODULI: "1.5", "hood.thickness": "0.2 mm"},
        {"lesion.cut.central_slip": "true", "lesion.length.terminal_slip": "-1.5 mm"},
        {"lesion.adhere.central_band": "true", "lesion.length.terminal_slip": "2 mm"},
        {"lesion.cut_partly.central_band": "0.5"},
    ],
)
def test_changes_as_settings_make_the_same_case(changes):
    case = load_case("isometric_edc")
    settings = settings_of(case, changes)
    assert settings is not None
    assert values(load_case("isometric_edc", settings)) == values(changed_case(case, changes))


def test_a_lesion_of_the_case_can_be_healed_but_not_by_settings():
    case = load_case("lesion_boutonniere")
    healed = {f"lesion.cut.{name}": "false" for name in case.lesion.cut}
    healed |= {
        f"lesion.length.{name}": "0 mm" for name in (*case.lesion.lengthen, *case.lesion.shorten)
    }
    assert changed_case(case, healed).lesion is None
    assert settings_of(case, healed) is None
    assert units.parse("0 mm", units.LENGTH) == 0.0
