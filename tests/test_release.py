"""What a release says of itself, in each place the same."""

from __future__ import annotations

import re
import tomllib

import yaml

from cosim.version import __version__
from tests.helpers.folders import ROOT

WHOLE = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = WHOLE["project"]


def test_the_wheel_holds_every_package_whole():
    """What lies in them, packages and data alike, is found by the build."""
    packages = {path.parent.name for path in ROOT.glob("*/__init__.py")} - {"tests"}
    targets = WHOLE["tool"]["hatch"]["build"]["targets"]
    assert set(targets["wheel"]["packages"]) == packages
    assert {f"/{name}" for name in (*packages, "tests")} <= set(targets["sdist"]["include"])
    assert set(WHOLE["tool"]["mypy"]["packages"]) == packages - {"cases"}
    assert targets["wheel"]["exclude"] == ["/cases/bench.csv"]


def test_the_citation_is_of_this_version_and_licence():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert cited["cff-version"] == "1.2.0"
    assert str(cited["version"]) == __version__
    assert cited["license"] == PROJECT["license"]
    assert cited["authors"] == PROJECT["authors"]
    assert {"title", "message", "abstract"} <= cited.keys()


def test_the_changelog_begins_with_this_version():
    log = (ROOT / "README.md").read_text(encoding="utf-8").partition("\n## Changelog\n")[2]
    assert re.findall(r"^### (\S+)", log, re.MULTILINE)[0] == __version__
    assert "Added" in log


def test_the_workflow_runs_every_version_that_the_package_names():
    text = (ROOT / ".github" / "workflows" / "tests.yml").read_text(encoding="utf-8")
    jobs = yaml.safe_load(text)["jobs"]
    start = "Programming Language :: Python :: 3."
    named = [f"3.{c.removeprefix(start)}" for c in PROJECT["classifiers"] if c.startswith(start)]
    assert jobs["tests"]["strategy"]["matrix"]["python"] == named
    assert PROJECT["requires-python"] == f">={named[0]}"
