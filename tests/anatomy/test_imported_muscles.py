"""What `cosim import` reads of OpenSim's muscles goes on to `cosim new`, number by number."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from cosim.anatomy.case_folder import new_case
from cosim.anatomy.muscles import imported_muscles
from cosim.anatomy.read import UserAnatomy
from cosim.case.file import load_case
from cosim.errors import InputError
from rigid.opensim.osim import import_osim, write_import
from tests.helpers.folders import ROOT

OSIM = (ROOT / "cases" / "data" / "finger.osim").read_text(encoding="utf-8")
TENDONS = ("FDP", "FDS", "LUM", "FPI", "EI", "EDC")
RANGES = {
    "max_isometric_force": (5.0, 200.0),
    "optimal_fiber_length": (0.02, 0.2),
    "tendon_slack_length": (0.05, 0.4),
    "pennation_angle_at_optimal": (0.0, 0.5),
}


def with_numbers(text: str, name: str, numbers: dict[str, float]) -> str:
    """The model with these numbers of a muscle."""
    start = text.index(f'<Millard2012EquilibriumMuscle name="{name}"')
    end = text.index("</Millard2012EquilibriumMuscle>", start)
    muscle = text[start:end]
    for key, value in numbers.items():
        muscle, count = re.subn(rf"<{key}>[^<]*<", f"<{key}>{value!r}<", muscle)
        assert count == 1
    return text[:start] + muscle + text[end:]


def imported(folder: Path, text: str) -> Path:
    path = folder / "finger.osim"
    path.write_text(text, encoding="utf-8")
    return write_import(import_osim(path), folder / "finger.xml")[0]


def test_the_numbers_of_every_muscle_are_in_the_case(tmp_path: Path) -> None:
    rng, text = np.random.default_rng(77), OSIM
    stated: dict[str, dict[str, float]] = {}
    for name in TENDONS:
        stated[name] = {key: float(rng.uniform(*ends)) for key, ends in RANGES.items()}
        text = with_numbers(text, name, stated[name])
    finger = imported(tmp_path, text)
    case, told = new_case("own", UserAnatomy(finger=finger), tmp_path / "own")
    assert any("greatest forces, fibre lengths" in line for line in told)
    tendons = load_case(case).tendons
    for name, numbers in stated.items():
        force, fibre, slack, pennation = numbers.values()
        assert tendons[name].max_force == pytest.approx(force, rel=1e-8)
        muscle = tendons[name].muscle
        assert muscle is not None
        found = (muscle.optimal_fibre_length, muscle.tendon_slack_length, muscle.pennation)
        assert found == pytest.approx((fibre, slack, pennation), rel=1e-8)
        assert muscle.tendon == ("rigid" if name == "LUM" else "elastic")


def test_a_tendon_of_another_name_has_the_numbers_of_its_muscle(tmp_path: Path) -> None:
    finger = imported(tmp_path, OSIM)
    tables, _ = imported_muscles(finger, {"RI": "FDI"}, ["RI", "EDC"])
    stated = json.loads(finger.with_suffix(".json").read_text())["muscles"]
    force = stated["FDI"]["properties"]["max_isometric_force"]
    assert tables["RI"]["max_force"] == f"{force:.9g} N"
    assert set(tables) == {"RI", "EDC"}


def test_numbers_that_a_case_has_no_place_for_are_told(tmp_path: Path) -> None:
    text = with_numbers(OSIM, "EDC", {"pennation_angle_at_optimal": 1.2})
    tables, told = imported_muscles(imported(tmp_path, text), {}, ["EDC", "EI"])
    assert set(tables) == {"EI"}
    assert any(re.search(r"dropped: muscle EDC.*pennation.*60 deg or less", t) for t in told)


def test_a_file_beside_that_is_not_the_imports(tmp_path: Path) -> None:
    finger = imported(tmp_path, OSIM)
    beside = finger.with_suffix(".json")
    content = json.loads(beside.read_text())
    for muscle, words in ((3, "is no muscle"), ({"properties": {"max_isometric_force": "9"}}, "9")):
        beside.write_text(json.dumps({**content, "muscles": {"EDC": muscle}}))
        with pytest.raises(InputError, match=words):
            imported_muscles(finger, {}, ["EDC"])
    for text in ("[1]", "{}"):
        beside.write_text(text)
        assert imported_muscles(finger, {}, ["EDC"]) == ({}, [])
    beside.write_text("{")
    with pytest.raises(InputError, match=r"finger\.json: is not valid JSON"):
        imported_muscles(finger, {}, ["EDC"])
    beside.unlink()
    assert imported_muscles(finger, {}, ["EDC"]) == ({}, [])
