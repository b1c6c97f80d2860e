"""The claims of the model's credibility: every one has evidence, and a page shows it."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from cosim.case.file import load_case
from cosim.cli import app
from cosim.errors import InputError
from cosim.validation.credibility import (
    CASES,
    Numbers,
    committed_numbers,
    counted,
    coverage,
    follow,
    hands_of,
    pulled,
    read_credibility,
)
from cosim.validation.uncertainty import NumberUncertainty, UncertaintyFile

CLAIMS = read_credibility()
CLAIMED = [*CLAIMS.factors, *CLAIMS.rules.list]
ADDRESSES = sorted({a for c in (*CLAIMED, *CLAIMS.fda.kinds) for a in c.evidence})


def test_the_thirteen_factors_and_the_ten_rules_are_all_graded():
    assert len({f.name for f in CLAIMS.factors}) == 13
    assert len({r.name for r in CLAIMS.rules.list}) == 10
    assert all(r.grade < len(CLAIMS.rules.scale) for r in CLAIMS.rules.list)
    assert all(c.evidence for c in CLAIMED if c.grade)
    assert all(k.evidence for k in CLAIMS.fda.kinds if k.have != "no")


@pytest.mark.parametrize("address", ADDRESSES)
def test_evidence_is_there(address: str):
    """What no validation has found yet is lacking on purpose, and its grade counts as 0."""
    (found,) = follow([address], committed_numbers())
    assert not found.fault or found.kind == "uncertainty"


def commands() -> list[str]:
    of_steps = [part.strip() for s in CLAIMS.repeat for part in s.command.split("&&")]
    of_evidence = [a.partition(" ")[2] for a in ADDRESSES if a.startswith("command ")]
    return [c for c in (*of_evidence, *of_steps) if c.startswith("cosim ")]


@pytest.mark.parametrize("line", commands())
def test_a_command_that_is_named_is_one_and_knows_its_options(line: str):
    command, words = get_command(app), shlex.split(line)[1:]
    while words and hasattr(command, "get_command"):
        command = command.get_command(None, words.pop(0))
    known = {option for p in command.params for option in p.opts}
    assert {w for w in words if w.startswith("--")} <= known


@pytest.mark.parametrize(
    "address",
    [
        *("file cosim/nothing.py", "test tests/test_layers.py::test_nothing", "test nowhere.py::x"),
        *("board no group", "uncertainty meshes", "command rm -rf", "hearsay of a friend"),
    ],
)
def test_a_grade_whose_evidence_is_lacking_counts_as_none(address: str):
    numbers = Numbers(committed_numbers().board, UncertaintyFile())
    there = "file README.md"
    assert counted(2, follow([there], numbers)) == 2
    assert counted(2, follow([there, address], numbers)) == 0
    assert counted(2, []) == 0


def test_a_part_of_the_uncertainty_that_few_numbers_have_is_no_evidence():
    board = {"judged": {"a": {}, "b": {"variant": True}}, "groups": {}}
    of = {"case": "c", "quantity": "q", "unit": "N", "model": 1.0}
    rows = [
        NumberUncertainty(group=g, name=str(i), forms={"split": 2.0} if i < 2 else {}, **of)
        for g, i in (("a", 0), ("a", 1), ("a", 2), ("a", 3), ("b", 4), ("b", 5))
    ]
    numbers = Numbers(board, UncertaintyFile(rows=tuple(rows)))
    (found,) = follow(["uncertainty forms"], numbers)
    assert (found.found, found.fault) == ("2 of 4 numbers with other hoods", "")
    fewer = Numbers(board, UncertaintyFile(rows=tuple(rows[1:])))
    (found,) = follow(["uncertainty forms"], fewer)
    assert found.fault == "fewer than half of the numbers have it"


def test_no_claim_types_a_number_of_the_board():
    texts = [CLAIMS.question, CLAIMS.context, *CLAIMS.outside, *(c.why for c in CLAIMED)]
    assert [t for t in texts if re.search(r"\d", re.sub(r"V&V \d+", "", t))] == []


def test_coverage_follows_from_trials_and_collection():
    cells = {(c.finger, c.posture, c.tip, c.muscle): c for c in coverage(committed_numbers())}
    edc = cells["middle", (40.0, 55.0, 35.0), "clamped", "EDC"]
    assert edc.hands == (3,)
    assert sum(edc.verdicts.values()) == 3
    assert edc.tensions == (3.28,)
    other = [c for c in cells.values() if not c.verdicts]
    assert {c.shape for c in other} == {"◇"}
    assert ("index", (10.0, 10.0, 10.0), "clamped", "EDC") in cells
    halves = pulled(load_case("hood_minorflex_ri"))
    assert list(halves) == ["RI"]
    assert hands_of("nobody 1900, nowhere") is None


def test_the_page_and_the_list_show_every_grade(tmp_path: Path):
    page = tmp_path / "credibility.html"
    shown = CliRunner().invoke(app, ["list", "credibility", "--html", str(page)])
    assert shown.exit_code == 0, shown.output
    text = page.read_text(encoding="utf-8")
    for claimed in CLAIMED:
        assert claimed.name.replace("&", "&amp;") in text
    links = re.findall(r'href="((?!#|http|data:)[^"]+)"', text)
    assert len(links) > 20
    assert all((tmp_path / link).is_file() for link in links)
    listed = CliRunner().invoke(app, ["list", "credibility"])
    assert listed.output.count(" of 3 ") == 13
    assert listed.output.count(" of 4 ") == 10


def test_the_summary_in_the_catalogue_says_the_same():
    text = " ".join((CASES / "README.md").read_text(encoding="utf-8").split())
    for f in CLAIMS.factors:
        assert f"| {f.activity} | {f.name} | {f.grade} of {len(f.grades) - 1} | {f.goal} |" in text
    assert f"claims {sum(r.grade for r in CLAIMS.rules.list)} of 40 points" in " ".join(
        text.split()
    )


def test_faulty_claims_are_one_message(tmp_path: Path):
    text = (CASES / "data" / "credibility.toml").read_text(encoding="utf-8")
    path = tmp_path / "credibility.toml"
    for old, new in (("grade = 2", "grade = 9"), ("goal = 2", 'goal = "high"'), ("[risk]", "[x]")):
        path.write_text(text.replace(old, new, 1), encoding="utf-8")
        with pytest.raises(InputError, match=r"credibility\.toml"):
            read_credibility(path)
