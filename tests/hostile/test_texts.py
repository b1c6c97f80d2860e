"""Small texts that once ended in a traceback: nameless parts, deep files, chains, names."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path

import pytest
import typer

from cosim.case.file import load_case
from cosim.commands.terminal import exit_on_error
from cosim.errors import InputError, NoMemoryError
from cosim.outcome import outcome_of
from cosim.results.compare import read_json, read_targets
from cosim.study.file import is_study
from cosim.study.plan import read_plan
from cosim.text_tables import read_json_file

STUDY = """
case = "split_edc"
[parameters.a]
values = ["1 N", "2 N"]
settings = ["tendons.EDC.tension={value}"]
[outputs]
t = "fingertip_magnitude_N"
"""
OPEN = ("hood.connecting", "hood.muscles", "hood.regions", "tendons", "finger.passive", "hood")
"""Tables whose keys are names."""


@pytest.mark.parametrize("case", ["network_edc", "cable_edc", "isometric_edc", "split_edc"])
@pytest.mark.parametrize("table", OPEN)
def test_a_part_that_is_not_there_is_told(case: str, table: str) -> None:
    for value in ("{}", "{stiffness='3 N/mm'}", "{kind='fung'}", "3", "{muscle='EDC'}", "[]"):
        with pytest.raises(InputError, match=r"faults?\n|expected"):
            load_case(case, [f"{table}.edc_slp={value}"])


def test_a_misspelt_connecting_tendon_is_told() -> None:
    told = r"edc_slp\.muscle: is missing; write one of .* did you mean edc_slip\?"
    with pytest.raises(InputError, match=told):
        load_case("network_edc", ['hood.connecting.edc_slp.stiffness="3 N/mm"'])


def test_deep_files_are_refused(tmp_path: Path) -> None:
    case, file = tmp_path / "deep.toml", tmp_path / "deep.json"
    case.write_text("a=" + 5000 * "[")
    file.write_text(99_999 * "[")
    assert not is_study(str(case))
    for read, path in ((load_case, case), (read_plan, case), (read_json_file, file)):
        with pytest.raises(InputError, match="deep"):
            read(path)
    with pytest.raises(InputError, match="deep"):
        read_json(file)


def test_long_chains_of_cases_are_refused(tmp_path: Path) -> None:
    for i in range(1500):
        (tmp_path / f"c{i}.toml").write_text(f'extends = "c{i + 1}.toml"\n')
    with pytest.raises(InputError, match="more than 50 files; put some"):
        load_case(tmp_path / "c0.toml")


def test_long_cells_and_other_characters_are_read_or_refused(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    for row in ("x" * 200_000 + ",1", "a\0b,1", '"' + "x" * 200_000, "fingertip_magnitude_N"):
        path.write_text(f"quantity,value\n{row}\n")
        with suppress(InputError):
            assert read_targets(path)


@pytest.mark.parametrize("key", ["title", "notes", "data", "case"])
@pytest.mark.parametrize("character", ["\0", "\x1b[31m", "\x07", "\ud800"])
def test_studies_hold_no_control_characters(key: str, character: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    text = json.dumps(f"a{character}b") if character != "\ud800" else '"a\\ud800b"'
    path.write_text(
        f"{key} = {text}\n" + STUDY.replace("case = ", f"{'x' * (key == 'case')}case = ")
    )
    with pytest.raises(InputError, match=r"U\+|not valid|line|Escaped"):
        read_plan(path)


@pytest.mark.parametrize("name", ["...toml", "....toml", " .toml"])
def test_a_study_whose_name_leads_elsewhere_is_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(STUDY)
    with pytest.raises(InputError, match="expected a name that a folder can have"):
        read_plan(tmp_path / name)


def want_too_much() -> None:
    raise MemoryError("Unable to allocate 45 GiB")


def test_too_little_memory_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(typer.Exit) as ended, exit_on_error():
        want_too_much()
    assert ended.value.exit_code == 1
    assert "not enough memory: Unable to allocate 45 GiB; a coarser mesh" in capsys.readouterr().err
    assert isinstance(outcome_of(want_too_much).error, NoMemoryError)
