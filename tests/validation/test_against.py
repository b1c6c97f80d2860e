"""`cosim validate --against`: what differs from an earlier board."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from cosim.cli import app
from cosim.errors import InputError
from cosim.validation.scoreboard import Rows, differences, read_rows

ROW = {
    "case": "run",
    "name": "distal",
    "quantity": "fingertip_force_N.distal",
    "unit": "N",
    "model": 1.0,
    "verdict": "inside",
    "u_num": 0.1,
    "u_input": None,
}


def board(**changes: object) -> Rows:
    return Rows.model_validate({"groups": {"force": [ROW | changes], "lengths": [ROW]}})


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"model": 1.0009}, None),
        ({"model": 1.002}, "force: distal, N: 1 before, 1.002 now"),
        ({"model": None}, "force: distal, N: 1 before, – now"),
        ({"verdict": "outside"}, "force: distal, N: inside before, outside now"),
        ({"u_num": 0.104, "u_input": 0.2}, None),
        ({"u_num": 0.106}, "force: distal, N: u_num 0.1 before, 0.106 now"),
    ],
)
def test_a_difference_is_told_and_no_other(changes, said):
    assert differences(board(), board(**changes)) == ([] if said is None else [said])


def test_what_one_board_has_alone_is_told_of_both():
    fewer = Rows.model_validate({"groups": {"force": [ROW]}})
    alone = "lengths: distal: there is such a number {} alone"
    assert differences(board(), fewer) == [alone.format("before")]
    assert differences(fewer, board()) == [alone.format("now")]
    assert differences(board(), fewer, part=True) == []


@pytest.mark.parametrize("text", ["{", "[]", '{"groups": {"a": [{"case": 1}]}}', '{"groups": 1}'])
def test_what_is_no_board_is_refused_before_a_trial_is_run(tmp_path, text):
    (tmp_path / "board.json").write_text(text)
    with pytest.raises(InputError, match=r"board\.json"):
        read_rows(tmp_path / "board.json")


@pytest.mark.slow
def test_the_exit_code_is_one_where_a_number_differs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["validate", "--only", "middle_minorflex_fdp", "--workers", "1"]
    first = CliRunner().invoke(app, [*words, "--out", "first"])
    assert first.exit_code in (0, 3)
    earlier = tmp_path / "first" / "scoreboard.json"
    held = json.loads(earlier.read_text())
    rows = next(iter(held["groups"].values()))
    rows[0]["model"] += 1.0
    earlier.write_text(json.dumps(held))
    done = CliRunner().invoke(app, [*words, "--out", "again", "--against", str(earlier)])
    assert done.exit_code == 1
    assert "1 differences" in done.stdout
