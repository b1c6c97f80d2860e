"""What a release says of itself, in each place the same."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest
import yaml

from cosim.measured import sources
from cosim.version import __version__
from tests.helpers.board import EVERYTHING, trust_rows
from tests.helpers.folders import ROOT

WHOLE = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = WHOLE["project"]


def test_the_wheel_holds_every_package_whole():
    """What lies in them, packages and data alike, is found by the build."""
    packages = {path.parent.name for path in ROOT.glob("*/__init__.py")} - {"tests"}
    targets = WHOLE["tool"]["hatch"]["build"]["targets"]
    assert set(targets["wheel"]["packages"]) == packages
    assert {f"/{name}" for name in (*packages, "tests")} <= set(targets["sdist"]["include"])
    assert set(WHOLE["tool"]["mypy"]["packages"]) == {*packages, "cases.papers.models"} - {"cases"}
    assert targets["wheel"]["exclude"] == ["/cases/papers/*.py", "/cases/papers/models"]


def test_the_citation_is_of_this_version_and_licence():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert cited["cff-version"] == "1.2.0"
    assert str(cited["version"]) == __version__
    assert cited["license"] == PROJECT["license"]
    assert cited["authors"] == PROJECT["authors"]
    assert {"title", "message", "abstract"} <= cited.keys()


def test_the_archive_says_what_the_citation_says():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    archived = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
    assert archived["title"] == cited["title"]
    assert archived["description"] == cited["abstract"]
    assert archived["keywords"] == cited["keywords"] == PROJECT["keywords"]
    assert archived["creators"] == cited["authors"]
    for key in ("version", "license"):
        assert archived[key] == str(cited[key])
    assert archived["upload_type"] == cited["type"]


def test_the_forms_of_an_issue_are_those_that_contributors_are_told_of():
    folder = ROOT / ".github" / "ISSUE_TEMPLATE"
    told = (ROOT / ".github" / "CONTRIBUTING.md").read_text(encoding="utf-8")
    forms = [
        yaml.safe_load(path.read_text(encoding="utf-8"))
        for path in folder.glob("*.yml")
        if path.name != "config.yml"
    ]
    assert {form["name"] for form in forms} == set(re.findall(r"the form \*(.*?)\*", told))
    for form in forms:
        fields = [field["id"] for field in form["body"]]
        assert len(set(fields)) == len(fields)
        assert all(field["attributes"]["label"] for field in form["body"])


PAPER = (ROOT / ".paper" / "paper.md").read_text(encoding="utf-8")
BODY = PAPER.split("\n---\n", 1)[1]
REFERENCES = (ROOT / ".paper" / "paper.bib").read_text(encoding="utf-8")


def test_the_paper_has_the_form_of_its_journal():
    """The Journal of Open Source Software asks for these sections and this length."""
    head = yaml.safe_load(PAPER.split("---\n")[1])
    assert head["title"] == yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))["title"]
    assert {"tags", "authors", "affiliations", "date", "bibliography"} <= head.keys()
    assert re.findall(r"^# (.*)$", BODY, re.MULTILINE) == [
        "Summary",
        "Statement of need",
        "State of the field",
        "Software design",
        "Research impact statement",
        "AI usage disclosure",
        "Acknowledgements",
        "References",
    ]
    assert 750 <= len(BODY.split()) <= 1750


def test_the_paper_cites_what_it_lists_and_each_can_be_found():
    entries = dict(re.findall(r"@\w+\{(\w+),(.*?)\n\}", REFERENCES, re.DOTALL))
    assert set(re.findall(r"@(\w+\d{4})", BODY)) == set(entries)
    for name, entry in entries.items():
        assert re.search(r"\b(doi = \{10\.\d{4,}/|url = \{https://)", entry), name


def test_the_numbers_of_the_paper_are_the_boards():
    """Its table has rows of the board, and no sentence another number with a point or a share."""
    rows = trust_rows()
    table = [line for line in BODY.splitlines() if line.startswith("|")][2:]
    assert len(table) >= 4
    for line in table:
        assert line == rows[line.split(" | ")[0].removeprefix("| ")]
    *_, over_zero, _, over_split, _ = rows[EVERYTHING].strip("| ").split(" | ")
    text = " ".join(BODY.split())
    assert f"skill over an answer of zero is {over_zero}." in text
    assert f"Over a fixed split of the tendon it is {over_split}, an interval that reaches" in text
    assert over_split.partition("(")[2].startswith("-")
    number = r"-?\d+\.\d+|\d+ of \d+"
    assert set(re.findall(number, text)) <= set(re.findall(number, " ".join(table)))


def test_the_collection_is_as_large_as_the_paper_says():
    assert "collects over thirty sources" in " ".join(BODY.split())
    assert len(sources()) > 30


def test_the_changelog_begins_with_this_version():
    log = (ROOT / ".github" / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.findall(r"^## (\S+)", log, re.MULTILINE)[0] == __version__
    assert "Added" in log


def test_the_workflow_runs_every_version_that_the_package_names():
    text = (ROOT / ".github" / "workflows" / "tests.yml").read_text(encoding="utf-8")
    jobs = yaml.safe_load(text)["jobs"]
    start = "Programming Language :: Python :: 3."
    named = [f"3.{c.removeprefix(start)}" for c in PROJECT["classifiers"] if c.startswith(start)]
    assert jobs["tests"]["strategy"]["matrix"]["python"] == named
    assert PROJECT["requires-python"] == f">={named[0]}"


@pytest.mark.slow
def test_both_archives_pass_their_check_and_the_wheel_runs_alone(tmp_path: Path):
    """In an environment that has nothing but the wheel and what it asks for."""
    for tool in ("build", "twine"):
        pytest.importorskip(tool)
    dist = tmp_path / "dist"
    _run(sys.executable, "-m", "build", "--outdir", dist, ROOT, folder=tmp_path)
    wheel, sdist = next(dist.glob("*.whl")), next(dist.glob("*.tar.gz"))
    _run(sys.executable, "-m", "twine", "check", "--strict", wheel, sdist, folder=tmp_path)
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {".zenodo.json", ".docs/conf.py", ".paper/paper.md", "tests/test_release.py"} <= names
    assert ".github/CONTRIBUTING.md" in names
    with zipfile.ZipFile(wheel) as archive:
        held = set(archive.namelist())
    assert {"cases/data/measured/sources.csv", "cosim/py.typed"} <= held
    assert not [name for name in held if name.startswith((".", "tests/"))]

    venv.create(tmp_path / "alone", with_pip=True)
    programs = tmp_path / "alone" / ("Scripts" if sys.platform == "win32" else "bin")
    _run(programs / "python", "-m", "pip", "install", "-q", wheel, folder=tmp_path)
    for command in ("list cases", "run split_edc", "list measured"):
        assert _run(programs / "cosim", *command.split(), folder=tmp_path)
    assert (tmp_path / "runs" / "split_edc" / "summary.json").is_file()


def _run(*command: str | Path, folder: Path) -> str:
    """What a command prints that ends well."""
    done = subprocess.run(
        list(map(str, command)), cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
