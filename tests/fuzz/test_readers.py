"""Readers of other programs' files under 2000 mutated files each, with a fixed seed: every one is
read or refused in one message, in bounded time and memory."""

from __future__ import annotations

import resource
import signal
import sys
import tempfile
import warnings
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.abaqus_file import read_inp
from cosim.anatomy.bones import load_surface
from cosim.anatomy.read import read_hood
from cosim.case.file import load_case
from cosim.errors import CosimError
from cosim.fmu.archive import UnpackedFmu, unpack_fmu
from cosim.mesh_file import read_mesh_file
from cosim.models.build import hood_mesh, mjcf_of
from cosim.results.compare import read_targets
from cosim.text_tables import read_csv
from fe_solver.febio.read import read_feb
from meshes.imported.write import write_vtu
from rigid.mjcf.read import read_mjcf
from rigid.opensim.osim import import_osim
from rigid.opensim.sto import read_sto, read_trc
from tests.helpers.feb_files import feb_text
from tests.helpers.feb_strips import quadratic_text
from tests.helpers.folders import ROOT
from tests.helpers.osim_files import OLD_MODEL
from tests.helpers.own_anatomy import user_hood
from tests.proofs.fingers.osim_rows import shipped_models

FILES, SLOW_FILES = 2000, 150
MOST_SECONDS = 10
MOST_GROWTH = 1 << 30
"""Bytes."""
WORDS = (
    b"",
    b"nan",
    b"inf",
    b"-1",
    b"1e400",
    b"99999999999",
    b"0",
    b"\xff",
    b"<",
    b",",
    b"=",
    b"*",
)
"""What a token of a file becomes."""


def mutate(content: bytes, rng: np.random.Generator) -> bytes:
    """A few changes of bytes, tokens and lines."""
    for _ in range(rng.integers(1, 4)):
        match rng.integers(0, 6):
            case 0:
                i = rng.integers(0, max(len(content), 1))
                content = content[:i] + bytes([rng.integers(0, 256)]) + content[i + 1 :]
            case 1:
                content = content[: rng.integers(0, len(content) + 1)]
            case 2:
                lines = content.split(b"\n")
                i = rng.integers(0, len(lines))
                lines[i:i] = [lines[rng.integers(0, len(lines))]] * int(rng.integers(1, 4))
                content = b"\n".join(lines)
            case 3:
                lines = content.split(b"\n")
                del lines[rng.integers(0, len(lines))]
                content = b"\n".join(lines)
            case _:
                parts = content.split(b" ")
                parts[rng.integers(0, len(parts))] = WORDS[rng.integers(0, len(WORDS))]
                content = b" ".join(parts)
    return content


@contextmanager
def bounded(what: str) -> Iterator[None]:
    """Fail where it takes longer than MOST_SECONDS."""

    def stop(*_: Any) -> None:
        raise TimeoutError(what)

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(MOST_SECONDS)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def a_vtu(folder: Path) -> bytes:
    path = folder / "hood.vtu"
    write_vtu(user_hood(hood_mesh(load_case("isometric_edc", ["hood.mesh.quads=120"]))), path)
    return path.read_bytes()


def a_vtk(folder: Path) -> bytes:
    import pyvista

    path = folder / "plane.vtk"
    pyvista.Plane(i_resolution=3, j_resolution=2).save(path, binary=False)
    return path.read_bytes()


def an_stl(folder: Path) -> bytes:
    import trimesh

    return bytes(trimesh.creation.box().export(file_type="stl_ascii").encode())


def an_osim(folder: Path) -> bytes:
    return (ROOT / "cases" / "data" / "finger.osim").read_bytes()


def an_old_osim(folder: Path) -> bytes:
    return OLD_MODEL.encode()


def a_case(folder: Path) -> bytes:
    text = (ROOT / "cases" / "base" / "index_finger.toml").read_bytes()
    return text.replace(b'"bare_finger.toml"', b'"base/bare_finger.toml"')


def read_description(path: Path) -> UnpackedFmu:
    """What an FMU with this description is."""
    import fmpy

    binary = f"binaries/{fmpy.platform}/m{fmpy.sharedLibraryExtension}"
    with tempfile.TemporaryDirectory() as room:
        fmu = Path(room) / "m.fmu"
        with zipfile.ZipFile(fmu, "w") as archive:
            archive.writestr("modelDescription.xml", path.read_bytes())
            archive.writestr(binary, b"")
        return unpack_fmu(fmu, Path(room) / "unpacked")


FMU = b"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="m" guid="{1}">
<CoSimulation modelIdentifier="m" canGetAndSetFMUstate="true"/>
<UnitDefinitions> <Unit name="mm"> <BaseUnit m="1" factor="0.001"/> </Unit> </UnitDefinitions>
<ModelVariables> <ScalarVariable name="x" valueReference="0" causality="output" initial="exact">
<Real start="0" unit="mm"/> </ScalarVariable> </ModelVariables>
<ModelStructure> <Outputs> <Unknown index="1"/> </Outputs> </ModelStructure>
</fmiModelDescription>
"""
STO = (
    b"forces\nversion=1\nnRows=2\nnColumns=3\ninDegrees=no\nendheader\n"
    b"time\tEDC\tFDP\n0\t1\t2\n1\t2\t3\n"
)
CSV = b"name,quantity,value,sd,low,high,source\na,slip_ratio,1,0.1,,,s\nb,wall_s,1,,0,2,s\n"
TRC = (
    b"PathFileType\t4\t(X/Y/Z)\tt.trc\nDataRate Units NumMarkers\n10 mm 2\n"
    b"Frame#\tTime\ta\t\t\tb\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\n"
    b"1\t0.0\t1.5\t2\t3\t4\t5\t6\n2\t0.1\t1\t2\t3\t\t\t\n"
)
Seed = Callable[[Path], bytes]
FORMATS: dict[str, tuple[str, Seed, Callable[[Path], Any], int]] = {
    "Abaqus": (".inp", lambda _: (ROOT / "cases/own/hood.inp").read_bytes(), read_inp, FILES),
    "VTK, XML": (".vtu", a_vtu, read_hood, SLOW_FILES),
    "VTK, legacy": (".vtk", a_vtk, read_mesh_file, SLOW_FILES),
    "STL": (".stl", an_stl, lambda p: load_surface(p, "bone"), FILES),
    "OpenSim": (".osim", an_osim, import_osim, FILES),
    "OpenSim 3": (".osim", an_old_osim, import_osim, FILES),
    "tables of OpenSim": (".sto", lambda _: STO, lambda p: read_sto(p, ("EDC",)), FILES),
    "markers": (".trc", lambda _: TRC, read_trc, FILES),
    "MJCF": (".xml", lambda _: mjcf_of(load_case("split_edc")).encode(), read_mjcf, FILES),
    "FEBio": (".feb", lambda _: feb_text().encode(), read_feb, FILES),
    "FEBio, quadratic": (".feb", lambda _: quadratic_text().encode(), read_feb, FILES),
    "FMU": (".xml", lambda _: FMU, read_description, FILES),
    "case files": (".toml", a_case, load_case, FILES),
    "CSV": (".csv", lambda _: CSV, lambda p: read_csv(p, "a,b"), FILES),
    "measured values": (".csv", lambda _: CSV, read_targets, FILES),
}


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="needs an alarm of the system")
@pytest.mark.parametrize("name", FORMATS)
def test_a_mutated_file_is_read_or_refused(name: str, tmp_path: Path) -> None:
    ending, seed, reader, count = FORMATS[name]
    content, rng = seed(tmp_path), np.random.default_rng(1)
    path, refused = tmp_path / f"mutant{ending}", 0
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for i in range(count):
            path.write_bytes(mutate(content, rng))
            try:
                with bounded(f"{name}, file {i}"):
                    reader(path)
            except CosimError as error:
                refused += 1
                assert str(error).strip()
                assert len(str(error)) < 20_000
    assert 0 < refused < count
    assert 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory) < MOST_GROWTH


def test_the_seeds_are_read(tmp_path: Path) -> None:
    for ending, seed, reader, _ in FORMATS.values():
        path = tmp_path / f"seed{ending}"
        path.write_bytes(seed(tmp_path))
        assert reader(path) is not None
    assert shipped_models()
