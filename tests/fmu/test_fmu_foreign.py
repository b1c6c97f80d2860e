"""An FMU that is none of ours, compiled from C: other names, no switch, its own derivatives."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from cosim.errors import ConvergenceError, InputError
from cosim.fmu.hood import FmuHood
from cosim.fmu.quantity import UNITS, load_of, motion_of, tensions_of
from cosim.fmu.unit import Unit
from cosim.port import STATIC, Motion, rotation_matrix
from tests.helpers.fmus import NEEDS_FMU, change_archive
from tests.helpers.folders import TEST_DATA

BODIES, TENDONS, SOURCES = ("metacarpal", "distal"), ("EDC",), ("spring",)
NAMES = {
    "position": "p_{body}_{axis}",
    "rotation": "R_{body}_{axis}{column}",
    "tension": "T_{tendon}",
    "force": "F_{body}_{axis}",
    "moment": "M_{body}_{axis}",
    "pull_force": "P_{axis}",
    "pull_moment": "Q_{axis}",
    "excursion": "x",
}
CREEP, STIFFNESS, COMPLIANCE = 1e-2, 100.0, 1e-3
pytestmark = [
    *NEEDS_FMU,
    pytest.mark.skipif(
        sys.platform != "linux" or shutil.which("cc") is None, reason="compiles for Linux"
    ),
]


def description() -> str:
    quantities = [
        *motion_of(BODIES, "input"),
        *tensions_of(TENDONS),
        *load_of(BODIES, SOURCES, TENDONS),
    ]
    variables, outputs = [], []
    for q in quantities:
        for name in q.entries(NAMES[q.name]):
            unit = f' unit="{q.unit}"' if q.unit else ""
            start = ' start="0"' if q.causality == "input" else ""
            variables.append(
                f'<ScalarVariable name="{name}" valueReference="{len(variables)}" '
                f'causality="{q.causality}"><Real{start}{unit}/></ScalarVariable>'
            )
            outputs += [len(variables)] if q.causality == "output" else []
    units = "".join(
        f'<Unit name="{name}"><BaseUnit {" ".join(f"{b}={p!r}" for b, p in base.items())}/></Unit>'
        for name, base in ((n, {b: str(p) for b, p in UNITS[n].items()}) for n in ("m", "N", "N.m"))
    )
    unknowns = "".join(f'<Unknown index="{i}"/>' for i in outputs)
    return (
        '<?xml version="1.0"?><fmiModelDescription fmiVersion="2.0" modelName="spring" guid="g">'
        '<CoSimulation modelIdentifier="spring" canHandleVariableCommunicationStepSize="true" '
        'canGetAndSetFMUstate="true" providesDirectionalDerivative="true"/>'
        f"<UnitDefinitions>{units}</UnitDefinitions>"
        f"<ModelVariables>{''.join(variables)}</ModelVariables><ModelStructure>"
        f"<Outputs>{unknowns}</Outputs><InitialUnknowns>{unknowns}</InitialUnknowns>"
        "</ModelStructure></fmiModelDescription>"
    )


def write_spring(folder: Path, source: Path) -> Path:
    """The FMU of a C source with these variables, in a file of the source's name."""
    library, path = folder / "spring.so", folder / f"{source.stem}.fmu"
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-w", "-o", library, source], check=True)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", description())
        archive.write(library, "binaries/linux64/spring.so")
    return path


@pytest.fixture(scope="module")
def spring(tmp_path_factory) -> Path:
    return write_spring(tmp_path_factory.mktemp("foreign"), TEST_DATA / "spring_hood.c")


@pytest.fixture
def hood(spring) -> FmuHood:
    return FmuHood(spring, BODIES, TENDONS, SOURCES, NAMES, rest_step=0.1)


def pose() -> Motion:
    turn = rotation_matrix(np.array([[0.0, 0.0, 0.0], [0.1, 0.4, -0.2]]))
    return Motion(BODIES, np.array([[0.0, 0.0, 0.0], [0.03, 0.01, -0.02]]), turn)


def test_it_answers_as_it_should(hood):
    response = hood.advance(hood.start(pose()), pose(), np.array([2.0]), 0.01)
    force = -STIFFNESS * pose().position[1] + 2.0 * pose().rotation[1, :, 0]
    assert response.load.wrench[1, 0, :3] == pytest.approx(force, abs=1e-14)
    assert response.load.wrench[0, 0, :3] == pytest.approx(-force, abs=1e-14)
    assert response.excursion == pytest.approx([2.0 * COMPLIANCE + 0.01 * CREEP])


def test_its_directional_derivatives_are_the_tangent(hood):
    assert hood.tangent_by == "directional derivatives"
    response = hood.advance(hood.start(pose()), pose(), np.array([2.0]), 0.01)
    derived = hood.jacobian(response.state)
    hood.tangent_by = "differences"
    differenced = hood.jacobian(response.state)
    for ours, other in zip(vars(derived).values(), vars(differenced).values(), strict=True):
        assert ours == pytest.approx(other, rel=1e-6, abs=1e-6)
    assert derived.load_motion[6:9, 6:9] == pytest.approx(-STIFFNESS * np.eye(3))
    assert derived.load_tension[6:9, 0] == pytest.approx(pose().rotation[1, :, 0])
    assert derived.excursion_tension == pytest.approx(np.array([[COMPLIANCE]]))


def test_its_memory_is_taken_back(hood):
    pull = np.array([1.0])
    one = hood.advance(hood.start(pose()), pose(), pull, 0.01)
    two = hood.advance(one.state, pose(), pull, 0.02)
    other = hood.advance(one.state, pose(), pull, 0.05)
    grown = [float(r.excursion[0]) - COMPLIANCE for r in (one, two, other)]
    assert grown == pytest.approx([0.01 * CREEP, 0.03 * CREEP, 0.06 * CREEP])


def test_rest_is_a_step_of_the_time_stated(hood):
    response = hood.advance(hood.start(pose()), pose(), np.array([0.0]), STATIC)
    assert response.excursion == pytest.approx([0.1 * CREEP])


def test_an_error_of_the_unit_is_told_and_survived(hood):
    start = hood.start(pose())
    with pytest.raises(ConvergenceError, match=r"could not step from 0 s by 0\.01 s: .*error"):
        hood.advance(start, pose(), np.array([51.0]), 0.01)
    assert hood.advance(start, pose(), np.array([49.0]), 0.01).load.wrench.any()


@pytest.mark.parametrize("content", [b"", b"not a library"])
def test_a_binary_that_is_none(spring, tmp_path, content):
    """One that is a library may do as it pleases: to load an FMU is to run a program."""
    binary = "binaries/linux64/spring.so"
    path = change_archive(spring, tmp_path / "spoilt.fmu", {binary: lambda _: content})
    here = Path.cwd()
    with pytest.raises(InputError, match="cannot be loaded"):
        Unit(path)
    assert Path.cwd() == here
