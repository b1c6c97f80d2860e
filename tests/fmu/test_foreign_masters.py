"""Exported units in simulators of others: they state step and stop time, and move as our own loop
does."""

from importlib import import_module
from xml.etree import ElementTree
from zipfile import ZipFile

import pytest

import cosim
from cosim.fmu_export.write import write_fmu
from tests.helpers.masters import MASTERS

MOTION = ['forward.step="2 ms"', 'forward.duration="0.2 s"']
STEPS, PULL = 30, 4.0


@pytest.fixture(scope="module")
def unit(tmp_path_factory):
    path = tmp_path_factory.mktemp("unit") / "finger.fmu"
    write_fmu(cosim.load("split_edc", MOTION), "coupled", 2, path)
    return path


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize(
    ("case", "settings", "wanted"),
    [("split_edc", MOTION, ("0.0", "0.2", "0.002")), ("pulley_edc", [], ("0.0", "1.0", "0.02"))],
)
def test_a_unit_states_its_step_and_stop_time(tmp_path, fmi, case, settings, wanted):
    path = tmp_path / "unit.fmu"
    write_fmu(cosim.load(case, settings), "finger", fmi, path)
    root = ElementTree.fromstring(ZipFile(path).read("modelDescription.xml"))
    stated = root.find("DefaultExperiment")
    assert tuple(stated.get(name) for name in ("startTime", "stopTime", "stepSize")) == wanted


@pytest.mark.parametrize("name", MASTERS)
def test_a_unit_moves_in_another_simulator_as_in_our_loop(unit, name):
    module, run = MASTERS[name]
    try:
        import_module(module)
    except (ImportError, OSError) as missing:  # OSError: a library that it needs
        pytest.skip(f"{name} is not installed: {missing}")
    loop = cosim.Loop("split_edc", "2 ms")
    for _ in range(STEPS):
        seen = loop.step({"EDC": PULL})
    theirs = run(
        unit, {"tension.EDC": PULL}, ("tip_force.x", "tip_force.z", "angle.PIP"), 2e-3, STEPS
    )
    ours = [seen["tip_force.distal"], seen["tip_force.dorsal"], seen["angle.PIP"]]
    assert theirs == pytest.approx(ours, abs=1e-10)
