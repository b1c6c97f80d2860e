"""No output names a path of the machine where a relative one or a name serves."""

from __future__ import annotations

import os
from pathlib import Path

import h5py
import pytest
from typer.testing import CliRunner

from cosim.case.file import base_name, find_case, load_case
from cosim.cli import app

MOVING = """extends = "base/split.toml"
title = "a recorded tension"

[tendons.EDC]
tension = "2 N"
signal = { kind = "file", path = "data/signal.csv", column = "edc" }

[forward]
duration = "0.02 s"
must_rest = false
"""
STUDY = """case = "moving.toml"

[parameters.tension]
values = ["1 N", "2 N"]
settings = ["tendons.EDC.tension={value}"]

[outputs]
fingertip = "fingertip_magnitude_N"
"""


def texts(folder: Path) -> dict[str, str]:
    """The text of every file, and of a netCDF file its attributes."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.suffix == ".nc":
            with h5py.File(path) as file:
                found[str(path)] = str(dict(file.attrs))
        elif path.is_file():
            found[str(path)] = path.read_bytes().decode("utf-8", errors="replace")
    return found


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Path:
    """A folder with a case, its data and its runs, as a user has."""
    folder = tmp_path_factory.mktemp("project")
    (folder / "data").mkdir()
    (folder / "data" / "signal.csv").write_text("time,edc\n0,0\n0.01,1\n", encoding="utf-8")
    (folder / "moving.toml").write_text(MOVING, encoding="utf-8")
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    call = CliRunner().invoke
    runs, page = str(folder / "runs"), str(folder / "page.html")
    for words in (
        ("run", str(folder / "moving.toml"), "pulley_edc", "--no-pictures", "--out", runs),
        ("show", f"{runs}/moving", f"{runs}/pulley_edc", "-o", page),
        ("show", f"{runs}/moving", "-o", f"{runs}/moving/run.sto"),
        ("study", str(folder / "study.toml"), "--out", str(folder / "studies")),
    ):
        done = call(app, [*words])
        assert done.exit_code == 0, (words, done.output)
    return folder


def test_no_output_names_a_path_of_the_machine(project):
    found = {k: text for part in ("runs", "studies") for k, text in texts(project / part).items()}
    found["page"] = (project / "page.html").read_text(encoding="utf-8")
    assert len(found) > 8
    for word in (str(project), str(project.parent), str(Path.home()), os.path.expanduser("~/")):
        if len(word.strip("/")) > 4:  # a home like /root is in other words
            assert [name for name, text in found.items() if word in text] == []


def test_the_case_of_a_run_reads_its_files_from_where_it_lies(project):
    text = (project / "runs" / "moving" / "case.toml").read_text(encoding="utf-8")
    assert 'path = "../../data/signal.csv"' in text
    signal = load_case(project / "runs" / "moving" / "case.toml").tendons["EDC"].signal
    assert signal is not None
    assert signal.kind == "file"
    assert signal.path.samefile(project / "data" / "signal.csv")


def test_a_case_that_extends_a_packaged_one_names_it(tmp_path):
    assert base_name(find_case("isometric_edc"), tmp_path) == "isometric_edc"
    assert base_name(find_case("base/split"), tmp_path) == "base/split.toml"
    (tmp_path / "own.toml").write_text('extends = "base/split"', encoding="utf-8")
    assert base_name(find_case(tmp_path / "own.toml"), tmp_path / "found") == "../own.toml"
