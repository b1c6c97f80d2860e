"""Modelica's Reference FMUs, where somebody has built them: REFERENCE_FMUS names their folder.

    clone https://github.com/modelica/Reference-FMUs, build it as its README says, for FMI 2 and 3
    REFERENCE_FMUS=path/to/dist python -m pytest -m fmu tests/fmu/test_fmu_reference.py

All that get and set their state must go back to the bit; what is not for co-simulation on this
machine must be refused in words.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.fmu.mapping import KINDS, VariablePlace
from cosim.fmu.unit import Unit
from cosim.fmu_export.write import write_fmu
from tests.helpers.fmus import NEEDS_FMU

pytestmark = NEEDS_FMU
FOLDER = os.environ.get("REFERENCE_FMUS", "")
FOUND = sorted(Path(FOLDER).rglob("*.fmu")) if FOLDER else []
STEP, STEPS = 0.01, 5


def numbers(unit: Unit) -> dict[str, VariablePlace]:
    """The unit's real numbers, arrays left out."""
    variables = unit.opened.description.modelVariables
    return {
        v.name: VariablePlace((v.valueReference,), (), False)
        for v in variables
        if v.type in KINDS[False] and not v.dimensions
    }


def walk(unit: Unit) -> list[dict[str, np.ndarray]]:
    """All numbers after each of some steps."""
    out = []
    for _ in range(STEPS):
        unit.step(STEP)
        out.append({name: unit.get(place) for name, place in numbers(unit).items()})
    return out


def goes_back(path: Path) -> bool:
    """Whether a unit gets and sets its state, and then repeats its steps to the bit."""
    unit = Unit(path)
    if not unit.opened.rolls_back:
        return False
    walk(unit)
    saved = unit.save()
    first = walk(unit)
    unit.restore(saved)
    assert walk(unit) == first
    if unit.opened.serialises:
        unit.restore(unit.read(unit.serialise(saved), saved.time))
        assert walk(unit) == first
    return True


@pytest.mark.skipif(not FOUND, reason="REFERENCE_FMUS names no folder with FMUs")
@pytest.mark.parametrize("path", FOUND, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_a_reference_fmu_goes_back_to_the_bit(path: Path) -> None:
    try:
        if not goes_back(path):
            pytest.skip("does not get and set its state")
    except InputError as error:
        assert "refused" in str(error) or "fmiVersion" in str(error), error
        pytest.skip(str(error))


@pytest.mark.parametrize("fmi", [2, 3])
def test_one_of_our_own_passes_the_same(tmp_path: Path, fmi: int) -> None:
    write_fmu(load_case("pulley_edc", ["forward={}"]), "coupled", fmi, tmp_path / "own.fmu")
    assert numbers(Unit(tmp_path / "own.fmu"))
    assert goes_back(tmp_path / "own.fmu")
