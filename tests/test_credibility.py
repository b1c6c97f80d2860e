"""What is claimed of the model's credibility: every grade has evidence, and it is there."""

from __future__ import annotations

import re
import shlex

import pytest
from typer.main import get_command

from cases.board_numbers import uncertainty_words, with_numbers
from cosim.cli import app
from cosim.errors import InputError
from cosim.validation.uncertainty import NumberUncertainty, UncertaintyFile
from tests.helpers.folders import ROOT

TEXT = (ROOT / ".docs" / "credibility.md").read_text(encoding="utf-8")
PARAGRAPHS = [" ".join(part.split()) for part in re.split(r"\n\n|\n(?=[*-] )", TEXT)]
FACTOR = re.compile(r"\*\*(.+): (\d) of (\d), goal (\d)\.\*\* (.*)")
RULE = re.compile(r"\* \*\*(.+): (\d)\*\*; (.*)")
FACTORS = [found.groups() for p in PARAGRAPHS if (found := FACTOR.match(p))]
RULES = [found.groups() for p in PARAGRAPHS if (found := RULE.match(p))]
SPANS = sorted({" ".join(span.split()) for span in re.findall(r"`([^`]+)`", TEXT)})
FILES = [span for span in SPANS if "/" in span.split("::")[0] and " " not in span]
COMMANDS = [span for span in SPANS if span.startswith("cosim ")]
COMMANDS += re.findall(r"^    (cosim .*?)  +#", TEXT, re.M)


def test_the_thirteen_factors_and_the_ten_rules_are_graded_with_evidence():
    assert len({name for name, *_ in FACTORS}) == 13
    assert len({name for name, *_ in RULES}) == 10
    assert all(int(grade) <= int(most) >= int(goal) for _, grade, most, goal, _ in FACTORS)
    evidence = [p for p in PARAGRAPHS if p.startswith("- Evidence: ")]
    assert len(evidence) == 13
    assert not any("none" in e for e in evidence)
    assert all("Evidence: none" not in text for _, grade, text in RULES if grade != "0")
    claimed = sum(int(grade) for _, grade, _ in RULES)
    assert f"claims {claimed} of 40 points" in " ".join(TEXT.split())


def test_no_claim_types_a_number_of_the_board():
    texts = [why for *_, why in FACTORS]
    assert [t for t in texts if re.search(r"\d", re.sub(r"V&V \d+", "", t))] == []


@pytest.mark.parametrize("address", FILES)
def test_files_and_tests_that_are_evidence_are_there(address: str):
    place, _, name = address.partition("::")
    assert (ROOT / place).is_file()
    if name:
        assert re.search(rf"^ *def {name}\(", (ROOT / place).read_text("utf-8"), re.M)


@pytest.mark.parametrize("line", COMMANDS)
def test_a_command_that_is_named_is_one_and_knows_its_options(line: str):
    command, words = get_command(app), shlex.split(line)[1:]
    while words and hasattr(command, "get_command"):
        command = command.get_command(None, words.pop(0))
    known = {option for p in command.params for option in p.opts}
    assert {w for w in words if w.startswith("--")} <= known


def test_the_board_s_numbers_are_put_in():
    told = with_numbers(TEXT)
    assert not re.search(r"\{(board|uncertainty)", told)
    assert re.search(r"cadaver forces: hood: \d+ inside 1 SD", " ".join(told.split()))


@pytest.mark.parametrize("place", ["{board no group}", "{uncertainty of taste}"])
def test_a_number_that_there_is_not_is_a_fault(place: str):
    with pytest.raises(InputError, match=r"no such group|known: meshes"):
        with_numbers(f"so many: {place}")


def test_variants_count_for_nothing():
    board = {"judged": {"a": {}, "b": {"variant": True}}, "groups": {}}
    of = {"case": "c", "quantity": "q", "unit": "N", "model": 1.0, "forms": {"split": 2.0}}
    rows = tuple(NumberUncertainty(group=g, name=g, **of) for g in ("a", "b"))
    assert uncertainty_words("forms", UncertaintyFile(rows=rows), board) == (
        "1 numbers with other hoods"
    )
