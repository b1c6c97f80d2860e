"""Every key at its legal ends: a case runs there, or is refused or given up with a reason."""

from __future__ import annotations

from pathlib import Path

import pytest

import cosim
from cosim.errors import ConvergenceError, InputError
from tests.helpers.schema_ends import ends_of

PLAIN = {"output.picture": False}
COARSE = {**PLAIN, "hood.mesh.quads": 120}
TOO_LONG = ("hood.mesh.quads", "hood.mesh.spacing", "forward.duration", "forward.step")
"""Keys with which a run takes hours at an end."""
WHOLE = {
    "isometric_edc": COARSE,
    "isometric_edc_neo_hookean": COARSE,
    "cable_edc": PLAIN,
    "network_edc": PLAIN,
    "two_band_edc": PLAIN,
    "pulley_edc": PLAIN,
    "forward_edc": {**PLAIN, "forward.duration": "0.1 s"},
    "pneumatic_edc_fdp": {**PLAIN, "forward.duration": "0.05 s"},
}


def outcomes(name: str, settings: dict, folder: Path | None = None) -> dict[str, str]:
    """How a case ends with each key at each of its ends; its results are written to `folder`."""
    base = cosim.load(name).replace(settings)
    out = {}
    for key, end in ends_of(base):
        if not key.startswith(TOO_LONG):
            try:
                result = cosim.run(base.replace({key: end}))
                out[f"{key} = {end}"] = str(result.audit)
            except (InputError, ConvergenceError) as error:
                out[f"{key} = {end}"] = str(error)
                continue
            if folder is not None:
                result.save(folder)
    return out


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) for n in WHOLE])
def test_every_key_of_a_case_may_be_at_its_ends(name, tmp_path):
    found = outcomes(name, WHOLE[name], tmp_path)
    assert len(found) > 40
    assert all(found.values())


def test_every_key_of_a_lumped_case_may_be_at_its_ends():
    found = outcomes("split_edc", PLAIN)
    assert len(found) > 40
    assert sum(ended == "audit passed" for ended in found.values()) > 35


@pytest.mark.parametrize(
    "settings",
    [
        {"hood.contact.offset.metacarpal": "10 mm"},
        pytest.param({"hood.contact.offset.metacarpal": "4.6 mm"}, marks=pytest.mark.slow),
        pytest.param({"hood.thickness": "5 mm"}, marks=pytest.mark.slow),
    ],
)
def test_a_sheet_may_lie_as_high_and_be_as_thick_as_the_schema_says(settings):
    """Beyond 5 mm over the bone its contact once had no normal."""
    result = cosim.run(cosim.load("isometric_edc").replace({**COARSE, **settings}))
    assert result.audit.passed
    pressure = result.data.pressure.isel(state=-1).max()
    assert float(pressure) < 1e6  # Pa; it was 16 to 79 MPa
