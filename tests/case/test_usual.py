"""A value that is far from what a finger has is told, for its unit is mostly another than meant."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from cosim import list_cases
from cosim.case.file import load_case
from cosim.case.usual import unusual_values
from cosim.cli import app


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ('hood.regions.central_slip.modulus="100 mPa"', "= 1e-07 MPa is unusual for a pressure"),
        ('hood.contact.stiffness="200 N/m**3"', "hood.contact.stiffness = 2e-07 N/mm**3"),
        ('hood.thickness="0.4 um"', "hood.thickness = 0.0004 mm"),
        ('tendons.EDC.tension="3 uN"', "tendons.EDC.tension = 3e-06 N"),
        ('hood.springs.central_slip.stiffness="1e7 N/mm"', "(0.001 N/mm to 1e6 N/mm)"),
    ],
)
def test_a_value_in_another_unit_than_was_meant_is_told(setting, said):
    name = "isometric_edc_neo_hookean" if "modulus" in setting else "isometric_edc"
    (found,) = unusual_values(load_case(name, [setting]))
    assert said in found
    done = CliRunner().invoke(app, ["check", name, f"--set={setting}"])
    assert done.exit_code == 0
    assert said in " ".join(done.stderr.split())


def test_no_value_of_a_shipped_case_is_unusual():
    assert [text for name in list_cases() for text in unusual_values(load_case(name))] == []
