"""Published experiments on lengths and cuts: how they are read, and that each has its case."""

from __future__ import annotations

import pytest

from cosim.analyses.length_experiments import HOODS, case_with, experiments, levers
from cosim.case.file import load_case
from cosim.report.lesion_page import NOT_KNOWN, insertion_forces, strength_of
from cosim.results.quantities import is_known
from meshes.hood_mesh import REGIONS
from tests.proofs.studies.length_rows import row_of, rows

CASES = (
    *("lengths_terminal_1mm", "lengths_terminal_4mm", "lengths_central_gap"),
    *("lengths_dip_resistance", "cuts_sagittal_bands", "cuts_extensor_tendon"),
)


def test_each_experiment_has_a_source_and_one_of_a_mean_and_a_bound():
    assert len(experiments()) == 14
    for e in experiments().values():
        assert "" not in (e.source, e.read)
        assert e.n > 0
        assert (e.mean is None) != (e.at_least is None)


def test_a_miss_is_shown_and_fails_nothing():
    gap, drop, about = (
        experiments()[name] for name in ("central_gap_pip", "terminal_4mm", "terminal_1mm")
    )
    assert [row_of(gap, "", x).verdict for x in (45.0, 47.0)] == ["outside", "within"]
    assert [row_of(drop, "", x).verdict for x in (59.0, 75.0)] == ["outside", "within"]
    assert row_of(about, "", 3.0).verdict == "shown"
    assert all(row_of(e, "", -1e3).passed for e in experiments().values())


@pytest.mark.parametrize("name", CASES)
def test_each_case_has_its_lesion_and_fits_the_hoods_that_it_is_laid_on(name):
    assert load_case(name).lesion is not None
    assert case_with(name, "shell", injured=False).lesion is None
    hoods = ["net of cables"] if "cuts" in name else list(HOODS)
    for hood in hoods if "resistance" not in name else ["shell"]:
        assert case_with(name, hood).unfit_lesion() == ""


def test_the_levers_are_those_of_the_straight_finger():
    at = levers(load_case("cuts_sagittal_bands"))
    assert at["PIP"] == pytest.approx(42.6, abs=0.1)
    assert at["fingertip"] == pytest.approx(85.8, abs=0.2)


@pytest.mark.slow
def test_the_network_s_rows_are_of_every_load():
    found = list(rows("terminal tendon longer", "network"))
    assert len(found) == 4
    assert all(row.passed and row.computed > 0 for row in found)


def test_what_no_source_knows_is_said_to_be_unknown():
    assert strength_of("region_force_N.lateral_slip_radial").says == NOT_KNOWN
    central = strength_of("slip_force_N.central")
    assert central.bears == 89.0
    assert "2.8 N" in central.says
    assert strength_of("region_force_N.central_slip").bears == 89.0


def test_only_a_sheet_has_parts_that_carry():
    sheet = {
        "slip_force_N": {"central": 1.0},
        "region_force_N": dict.fromkeys(REGIONS, 0.5),
        "spring_force_N": {"central_slip": 1.0, "ligament_radial": 0.0},
    }
    found = dict(insertion_forces(sheet))
    assert len(found) == len(REGIONS) + 2
    assert all(is_known(quantity) for quantity in found.values())
    assert not list(insertion_forces({"slip_force_N": {"central": 1.0}}))
