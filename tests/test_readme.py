"""The READMEs: their Python blocks and commands run, their figures are the board's, their links
lead somewhere."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cosim.cli import app
from tests.helpers.folders import ROOT

READMES = (
    "",
    "cosim",
    "cosim/study",
    "cosim/papers",
    "fe_solver",
    "rigid",
    "meshes",
    "cases",
    "tests",
)
TEXTS = {place: (ROOT / place / "README.md").read_text(encoding="utf-8") for place in READMES}
TOP = TEXTS[""]
BLOCKS = {
    f"{place or 'top'}-{i}": block
    for place, text in TEXTS.items()
    for i, block in enumerate(re.findall(r"```python\n(.*?)```", text, re.DOTALL))
}
FIRST = "cosim run isometric_edc"


def is_long(command: str, note: str) -> bool:
    """Whether it takes more than half a minute: as it says, or the first run once more."""
    return "minute" in note or "--out pulled" in command


TEN = TOP.partition("\n## Ten commands\n")[2].partition("\n## ")[0]
COMMANDS = [
    pytest.param(command.strip(), marks=[pytest.mark.slow] * is_long(command, note))
    for command, _, note in (
        line.strip().partition(" #") for line in TEN.splitlines() if line.startswith("    cosim ")
    )
]
TRUST = {
    "cadaver forces: hood": "fingertip force through the hood, three cadaver hands (Synek 2019)",
    "cadaver forces: flexors": "the same of the flexors, which no hood touches",
    "Lee 2008: slip forces": "forces of the slips (Lee 2008)",
    "Lee 2008: strains": "strains of the hood (Lee 2008)",
    "free finger: hood": "postures of a free finger (Nimbarte 2008)",
    "lengths and cuts": "lengths and cuts (Schweitzer and Rayan 2004, others)",
    "two models: hood": "two published models, clamped fingertip, hood",
    "two models: flexors": "the same, flexors",
}
"""A group of the board, and what the README calls it."""


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] * (n == "top-0")) for n in BLOCKS]
)
def test_a_python_block_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    exec(compile(BLOCKS[name], name, "exec"), {"__name__": "__main__"})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the first run of the README, of a coarser mesh, has left its results."""
    made = tmp_path_factory.mktemp("readme")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(made)
        words = [*shlex.split(FIRST)[1:], "--set", "hood.mesh.quads=120"]
        done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    return made


def test_the_first_run_leaves_the_files_that_are_named(folder: Path):
    table = TOP.partition("\n## The first run\n")[2].partition("\n## ")[0]
    named = {file for row in re.findall(r"^\| (`.*?) \|", table, re.M) for file in row.split(", ")}
    left = {f"`{path.name}`" for path in (folder / "runs" / "isometric_edc").iterdir()}
    assert named == left


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_runs(command: str, folder: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(folder)
    done = CliRunner().invoke(app, shlex.split(command)[1:])
    assert done.exit_code == 0, done.output


def test_there_are_ten_commands():
    assert len(COMMANDS) == 10


def test_the_set_up_is_what_the_continuous_integration_runs():
    command = (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()[-1]
    assert f"    {command}\n" in TOP
    assert f"&& .venv/bin/{FIRST}\n" in TOP


def test_the_figures_of_trust_are_the_boards():
    board = json.loads((ROOT / "cases" / "scoreboard.json").read_text(encoding="utf-8"))
    for group, name in TRUST.items():
        assert trust_row(name, board["judged"][group]) in TOP
    row = trust_row("all experiments known hand by hand", board["kinds"]["experiment"])
    assert row in TOP.replace("**", "")


def trust_row(name: str, group: dict) -> str:
    """A row of the README's table, of a group of the board or one of its kinds."""
    tally = group["tally"]
    judged = sum(n for word, n in tally["model"].items() if word != "nothing to judge by")
    skill = {s["null"]: s for s in group["skill"]}
    cells = [
        name,
        str(skill["no answer"]["rows"]),
        f"{inside(tally['model'])} of {judged}" if judged else "-",
        str(inside(tally["no answer"])) if judged else "-",
        skill_text(skill["no answer"]),
        skill_text(skill["fixed split"]) if "fixed split" in skill else "-",
    ]
    return f"| {' | '.join(cells)} |"


def inside(counts: dict[str, int]) -> int:
    """The numbers within one SD or in a band."""
    return sum(n for word, n in counts.items() if word.startswith("inside"))


def skill_text(skill: dict) -> str:
    """A skill with its interval."""
    if skill["low"] is None:
        return f"{skill['skill']:.2g} (one trial)"
    return f"{skill['skill']:.2g} ({skill['low']:.2g} to {skill['high']:.2g})"


@pytest.mark.parametrize("place", READMES)
def test_links_lead_somewhere(place: str):
    for link in re.findall(r"\]\((?!https?:)([^)]*)\)", TEXTS[place]):
        file, _, heading = link.partition("#")
        target = (ROOT / place / (file or "README.md")).resolve()
        assert target.exists(), link
        if heading:
            said = target.read_text(encoding="utf-8")
            titles = re.findall(r"^#+ (.*)$", said, re.MULTILINE)
            assert heading in [re.sub(r"[^\w -]", "", t.lower()).replace(" ", "-") for t in titles]


def test_the_catalogue_has_every_family_with_its_picture():
    folders = {path.parent.name for path in (ROOT / "cases").glob("*/*.toml")}
    families = folders - {"base", "data", "studies"}
    text = TEXTS["cases"]
    counts = dict(re.findall(r"^\| \[(\w+)\]\(#\w+\) \| .* \| (\d+) \|$", text, re.MULTILINE))
    assert {name: int(count) for name, count in counts.items()} == {
        name: len(list((ROOT / "cases" / name).glob("*.toml"))) for name in families
    }
    for name in families:
        picture = ROOT / "cases" / name / "picture.png"
        assert f"\n## {name}\n" in text
        assert f"]({name}/picture.png)" in text
        assert picture.read_bytes().startswith(b"\x89PNG")
        assert picture.stat().st_size < 60_000
