"""A run needs no library of an extra; what needs one says which, and how to install it."""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import pytest
from typer.testing import CliRunner

import cosim
from cosim.cli import app
from cosim.errors import InputError
from cosim.extras import DISTRIBUTIONS, EXTRAS
from cosim.study import open_study
from tests.helpers.folders import ROOT

MODULES = {library for libraries in EXTRAS.values() for library in libraries}
HIDDEN = sorted(MODULES | {"vtkmodules", "vtk"})
VTU = '<VTKFile type="UnstructuredGrid"/>'
NEEDS = [
    ("pyvista", "view", "show run", "a window in space"),
    ("uvicorn", "ui", "ui pulley_edc", "the page"),
    ("starlette", "ui", "run pulley_edc --watch", "the page"),
    ("imageio_ffmpeg", "film", "show run -o a.mp4", "a film as .mp4 (a .gif needs no more)"),
    (
        "pyvista",
        "view",
        "new mine --hood a.vtu",
        "a.vtu: reading a file of VTK that another program wrote",
    ),
    ("pyarrow", "study", "study network_saltelli", "a study"),
    ("SALib", "study", "study network_saltelli --workers 0", "a study"),
    ("sklearn", "surrogate", "study network_saltelli --surrogate a.csv", "a surrogate"),
    ("SALib", "study", "check network_saltelli", "sampling.kind = 'saltelli'"),
    ("distributed", "study", "study network_saltelli --scheduler tcp://h:1", "--scheduler"),
    ("pythonfmu", "fmu", "export pulley_edc -o a.fmu --fmi 2", "writing an FMU of FMI 2"),
    ("pythonfmu3", "fmu", "export pulley_edc -o a.fmu --fmi 3", "writing an FMU of FMI 3"),
]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty run, a display, and a .vtu of another program, in the current folder."""
    (tmp_path / "run").mkdir()
    for name in ("summary.json", "hood.vtu"):
        (tmp_path / "run" / name).touch()
    (tmp_path / "a.vtu").write_text(VTU)
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(("library", "extra", "command", "purpose"), NEEDS)
def test_what_needs_an_absent_library_says_how_to_install_it(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    library: str,
    extra: str,
    command: str,
    purpose: str,
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    before = sorted(folder.rglob("*"))
    done = CliRunner().invoke(app, command.split())
    sentence = f"{purpose} needs {library}, which is not installed: pip install '.[{extra}]'\n"
    assert done.exit_code == 2
    assert done.stderr.endswith(sentence)
    assert done.stdout == ""
    assert sorted(folder.rglob("*")) == before


def test_the_python_interface_raises_the_same_sentence(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = cosim.run("split_edc")
    for library in ("pyvista", "pyarrow"):
        monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(InputError, match=r"^a window in space needs pyvista"):
        result.view()
    with pytest.raises(InputError, match=r"^a study needs pyarrow"):
        cosim.run_study("network_saltelli")
    monkeypatch.delitem(sys.modules, "cosim.gym", raising=False)
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    with pytest.raises(InputError, match=r"gymnasium, which is not .* pip install '\.\[gym\]'"):
        import_module("cosim.gym")
    (folder / "study.json").write_text(json.dumps({"format": "cosim study 1"}))
    with pytest.raises(InputError, match=r"^reading a study's table needs pyarrow"):
        _ = open_study(folder).table
    assert not (folder / "studies").exists()


@pytest.mark.slow
def test_a_run_and_its_report_need_none(tmp_path: Path) -> None:
    """A shell, whose .vtu is written and read, in a process that finds no extra."""
    code = f"""
import sys
sys.modules.update(dict.fromkeys({HIDDEN}))
from cosim.cli import app
shell = "isometric_edc --set hood.mesh.quads=120"
for words in (f"run {{shell}}", "show runs/isometric_edc -o a.html", "info"):
    app(words.split(), standalone_mode=False)
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "runs" / "isometric_edc" / "hood.vtu").is_file()
    assert (tmp_path / "a.html").is_file()
    for library in MODULES - {"pypardiso", "KratosMultiphysics"}:
        assert re.search(rf"\b{library}\b", done.stdout)


def test_no_module_imports_a_library_of_an_extra_as_it_is_imported() -> None:
    """Those that are run by another process or copied into an FMU, and the one that is an extra's
    own, aside."""
    own = {"cosim/vtu_child.py", "cosim/fmu_export/fmi2.py", "cosim/fmu_export/fmi3.py"}
    own |= {"cosim/gym.py"}
    found = set()
    for package in ("cosim", "fe_solver", "rigid", "meshes"):
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.parse(path.read_text(encoding="utf-8")).body:
                names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
                names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
                if {name.split(".")[0] for name in names} & set(HIDDEN):
                    found.add(path.relative_to(ROOT).as_posix())
    assert found == own


def test_the_extras_are_those_of_the_package_and_the_tests_bring_them() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    assert extras.keys() - {"test"} == EXTRAS.keys()
    for name, libraries in EXTRAS.items():
        brought = {re.match(r"[\w-]+", stated)[0] for stated in extras[name]}
        assert {DISTRIBUTIONS.get(library, library) for library in libraries} <= brought
        assert not brought & {re.match(r"[\w-]+", d)[0] for d in project["dependencies"]}
    assert "cosim-hand[fmu,gym,study,surrogate,ui,view]" in extras["test"]
