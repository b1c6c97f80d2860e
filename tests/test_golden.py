"""The guard of results (tests/golden.py): what it calls the same, and what it reports."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests import golden
from tests.golden import CONFIG, Outcome, compare_outcomes
from tests.golden_arrays import Config, Leaf, Leaves, compare, flatten, read_config, read_run
from tests.helpers.folders import ROOT

PLAIN = Config()
SUMMARY: dict[str, Any] = {
    "case": "one",
    "wall_s": 1.5,
    "force_N": [1.0, -2.0, 0.0],
    "tension_N": {"EDC": 4.0, "EI": 1e-9},
    "unloaded": {"force_N": [0.1, 0.0, 0.0], "slip": None},
    "warnings": [],
}


def leaf(values: Any) -> Leaves:
    return {"x": Leaf(np.array(values), "x")}


def change_summary(**values: Any) -> Leaves:
    return flatten({**SUMMARY, **values}, "summary.json")


def test_equal_results_are_identical() -> None:
    assert compare(change_summary(), change_summary(), 0.0, PLAIN).verdict == "identical"


def test_nan_equals_nan_but_no_number() -> None:
    a, b = leaf([np.nan, 1.0]), leaf([-np.nan, 1.0])  # another bit pattern
    assert compare(a, a, 0.0, PLAIN).verdict == "identical"
    assert compare(a, b, 0.0, PLAIN).verdict == "within"
    assert compare(a, leaf([0.0, 1.0]), 1e3, PLAIN).verdict == "different"
    assert compare(leaf([np.inf]), leaf([-np.inf]), 1e3, PLAIN).verdict == "different"


def test_a_tiny_change_is_within_and_relative_to_the_largest() -> None:
    found = compare(change_summary(), change_summary(force_N=[1.0, -2.0, 2e-10]), 1e-9, PLAIN)
    assert found.verdict == "within"
    assert found.lines == ["summary.json/force_N: 1.0e-10 (0 is now 2e-10)"]
    assert compare(
        change_summary(), change_summary(force_N=[1.0, -2.0, 2e-8]), 1e-9, PLAIN
    ).verdict == ("different")


def test_numbers_of_a_table_share_a_scale() -> None:
    near = change_summary(tension_N={"EDC": 4.0, "EI": 3e-9})
    assert compare(change_summary(), near, 1e-9, PLAIN).verdict == "within"
    alone = compare(leaf(1e-9), leaf(3e-9), 1e-9, PLAIN)
    assert alone.verdict == "different"


def test_a_difference_below_the_floor_counts_as_none() -> None:
    floors = Config(floors={"*/noise": 1.0, "*": 1e-12})
    assert compare(leaf(0.0), leaf(1e-13), 0.0, floors).verdict == "within"
    assert compare(leaf(0.0), leaf(1e-11), 0.0, floors).verdict == "different"


def test_the_worst_comes_first() -> None:
    worse = change_summary(force_N=[1.1, -2.0, 0.0], tension_N={"EDC": 8.0, "EI": 1e-9})
    lines = compare(change_summary(), worse, 1e-9, PLAIN).lines
    assert [line.split(":")[0] for line in lines] == [
        "summary.json/tension_N/EDC",
        "summary.json/force_N",
    ]


@pytest.mark.parametrize(
    ("values", "line"),
    [
        ({"force_N": [1.0, -2.0]}, "summary.json/force_N: shape (3,) is now (2,)"),
        ({"case": "two"}, "summary.json/case: 'one' is now 'two'"),
        ({"wall_s": "1.5"}, "summary.json/wall_s: type float64 is now <U3"),
        ({"wall_s": True}, "summary.json/wall_s: type float64 is now bool"),
        ({"new": 1.0}, "extra: summary.json/new"),
    ],
)
def test_other_changes_are_differences(values: dict[str, Any], line: str) -> None:
    found = compare(change_summary(), change_summary(**values), 1.0, PLAIN)
    assert (found.verdict, found.lines) == ("different", [line])


def test_a_missing_key_is_a_difference() -> None:
    less = change_summary()
    del less["summary.json/unloaded/slip"]
    found = compare(change_summary(), less, 1.0, PLAIN)
    assert (found.verdict, found.lines) == ("different", ["missing: summary.json/unloaded/slip"])


def test_a_number_of_another_type_is_not_identical() -> None:
    assert compare(leaf([1, 2]), leaf([1.0, 2.0]), 0.0, PLAIN).verdict == "within"
    assert compare(leaf(0.0), leaf(-0.0), 0.0, PLAIN).verdict == "within"


def test_what_may_differ_is_left_out() -> None:
    found = compare(change_summary(), change_summary(wall_s=3.0), 0.0, Config(ignored=["*/wall_s"]))
    assert found.verdict == "identical"


def test_renamed_keys_and_labels_are_compared() -> None:
    new = {
        path.replace("force_N", "tip_N"): item for path, item in change_summary(case="1").items()
    }
    table = Config(renamed={"keys": {"*/force_N": "*/tip_N"}, "values": {"one": "1"}})
    assert compare(change_summary(), new, 0.0, table).verdict == "identical"
    assert compare(change_summary(), new, 0.0, PLAIN).verdict == "different"


def test_renamed_dimensions_are_compared() -> None:
    old = {"results.nc/a@dims": Leaf(np.array(["muscle", "axis"]), "")}
    new = {"results.nc/a@dims": Leaf(np.array(["tendon", "axis"]), "")}
    table = Config(renamed={"keys": {"results.nc/muscle": "results.nc/tendon"}})
    assert compare(old, new, 0.0, table).verdict == "identical"


def test_two_keys_of_one_new_name_are_refused() -> None:
    table = Config(renamed={"keys": {"*/case": "*/force_N"}})
    with pytest.raises(ValueError, match="two arrays"):
        compare(change_summary(), change_summary(), 0.0, table)


def test_each_star_stands_for_the_same_text() -> None:
    table = Config(renamed={"keys": {"a/*/b/*": "c/*/*"}})
    assert table.new_name("keys", "a/1/b/2") == "c/1/2"
    assert table.new_name("keys", "a/1/d/2") == "a/1/d/2"


def test_the_same_failure_is_the_same() -> None:
    failed, ran = Outcome(None, "no convergence"), Outcome(change_summary())
    assert compare_outcomes(failed, failed, 0.0, PLAIN).verdict == "fails in both"
    assert compare_outcomes(failed, Outcome(None, "other"), 0.0, PLAIN).verdict == "different"
    assert compare_outcomes(failed, ran, 0.0, PLAIN).verdict == "different"


def test_a_run_is_read_as_labelled_arrays(tmp_path: Path) -> None:
    import xarray

    (tmp_path / "summary.json").write_text(json.dumps(SUMMARY), encoding="utf-8")
    ledger = "state,body,source,Fx,Fy,Fz,Mx,My,Mz\n" + "loaded,distal,EDC,1,2,3,4,5,6\n" * 2
    (tmp_path / "ledger.csv").write_text(ledger, encoding="utf-8")
    angle = ("joint", [0.5, np.nan], {"units": "rad"})
    data = xarray.Dataset({"angle": angle}, {"joint": ["MCP", "PIP"]}, {"frame": "world"})
    data.to_netcdf(tmp_path / "results.nc", engine="h5netcdf")
    found = {path: item.values.tolist() for path, item in read_run(tmp_path).items()}
    assert found["summary.json/unloaded/force_N"] == [0.1, 0.0, 0.0]
    assert found["ledger.csv/loaded/distal/EDC/moment"] == [[4.0, 5.0, 6.0]] * 2
    assert found["results.nc/joint"] == ["MCP", "PIP"]
    assert found["results.nc/angle@dims"] == ["joint"]
    assert found["results.nc/angle@units"] == "rad"
    assert found["results.nc@frame"] == "world"


def test_every_case_has_its_settings() -> None:
    names, config = golden.shipped_cases(ROOT), read_config(CONFIG)
    assert {"isometric_edc", "split_edc"} <= set(names)
    assert not {"index_finger", "hood_fit", "shell_moduli"} & set(names)
    assert config.settings_of("isometric_edc")[-1] == "hood.mesh.quads=150"
    assert config.settings_of("free_split_edc") == list(config.common)
    for pattern in config.settings:
        assert any(Config(settings={pattern: ["x"]}).settings_of(name) for name in names), pattern


def test_the_settings_fit_the_cases() -> None:
    """Every shipped case loads with its settings."""
    from cosim.case.file import load_case

    config = read_config(CONFIG)
    for name in golden.shipped_cases(ROOT):
        load_case(name, config.settings_of(name))


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[tuple[str, str], Outcome]:
    """What runs give, by tree ("old" or "new") and case; nothing is computed."""
    given = {
        (tree, case): Outcome(change_summary(), summary=SUMMARY)
        for tree in ("old", "new")
        for case in ("a", "b")
    }

    @contextmanager
    def worktree(revision: str) -> Iterator[Path]:
        yield tmp_path / "old"

    def shipped_cases(tree: Path) -> list[str]:
        return [case for name, case in given if name == tree.name]

    monkeypatch.setattr(golden, "TREE", tmp_path / "new")
    monkeypatch.setattr(golden, "GOLDEN", tmp_path / "golden.json")
    monkeypatch.setattr(golden, "worktree", worktree)
    monkeypatch.setattr(golden, "shipped_cases", shipped_cases)
    monkeypatch.setattr(golden, "run_case", lambda tree, case, *rest: given[tree.name, case])
    return given


def test_a_difference_is_reported(
    runs: dict[tuple[str, str], Outcome], capsys: pytest.CaptureFixture[str]
) -> None:
    assert golden.main(["--against", "REV"]) == 0
    assert "2 cases: 2 identical" in capsys.readouterr().out
    runs["new", "b"] = Outcome(change_summary(force_N=[2.0, 0.0, 0.0]))
    assert golden.main(["--against", "REV"]) == 1
    assert (
        "b: DIFFERENT\n    summary.json/force_N: 1.0e+00 (-2 is now 0)" in capsys.readouterr().out
    )
    assert golden.main(["--against", "REV", "--only", "a"]) == 0
    assert golden.main(["--against", "REV", "--tolerance", "2"]) == 0


def test_a_comparison_without_a_run_is_no_success(runs: dict[tuple[str, str], Outcome]) -> None:
    runs["old", "a"] = runs["new", "a"] = Outcome(None, "no convergence")
    assert golden.main(["--against", "REV"]) == 0
    assert golden.main(["--against", "REV", "--only", "a"]) == 1
    assert golden.main(["--against", "REV", "--only", "none"]) == 1


def test_cases_of_one_tree_alone_are_listed(
    runs: dict[tuple[str, str], Outcome], capsys: pytest.CaptureFixture[str]
) -> None:
    runs["new", "c"] = runs["new", "a"]
    assert golden.main(["--against", "REV"]) == 0
    assert "c: here alone" in capsys.readouterr().out
    del runs["new", "b"]
    assert golden.main(["--against", "REV"]) == 1
    assert "b: in REV alone" in capsys.readouterr().out


def test_the_numbers_kept_are_compared(
    runs: dict[tuple[str, str], Outcome], capsys: pytest.CaptureFixture[str]
) -> None:
    assert golden.main(["--check"]) == 2
    runs["new", "b"] = Outcome(None, "no convergence")
    assert golden.main(["--write"]) == 0
    kept = json.loads(golden.GOLDEN.read_text(encoding="utf-8"))
    assert kept["a"]["summary"]["force_N"] == [1.0, -2.0, 0.0]
    assert "wall_s" not in kept["a"]["summary"]
    assert golden.main(["--check"]) == 0
    runs["new", "a"] = Outcome(
        change_summary(), summary={**SUMMARY, "force_N": [1.0, -2.000001, 0.0]}
    )
    assert golden.main(["--check"]) == 1
    assert golden.main(["--check", "--tolerance", "1e-5"]) == 0
    assert golden.main(["--write", "--only", "a"]) == 0
    assert golden.main(["--check"]) == 0
    runs["new", "b"] = runs["new", "a"]
    assert golden.main(["--check"]) == 1
    assert "before: failed: no convergence" in capsys.readouterr().out


def is_checkout() -> bool:
    asked = ["git", "-C", str(ROOT), "rev-parse", "--verify", "HEAD"]
    if shutil.which("git") is None:
        return False
    return subprocess.run(asked, capture_output=True).returncode == 0


@pytest.mark.slow
@pytest.mark.skipif(not is_checkout(), reason="needs git and a checkout")
def test_two_trees_are_run_and_compared(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """HEAD against HEAD with one case changed; both worktrees go at the end."""
    with golden.worktree("HEAD") as tree:
        case = tree / "cases" / "lumped" / "split_edc.toml"
        text = case.read_text(encoding="utf-8")
        case.write_text(text.replace("activation = 0.1 ", "activation = 0.11 "), encoding="utf-8")
        assert case.read_text(encoding="utf-8") != text
        monkeypatch.setattr(golden, "TREE", tree)
        code = golden.main(["--against", "HEAD", "--only", "split_e[di]*", "--workers", "1"])
        monkeypatch.undo()
    said = capsys.readouterr().out
    assert code == 1, said
    assert "split_ei: identical" in said
    assert "split_edc: DIFFERENT\n    summary.json/" in said
    listed = subprocess.run(
        ["git", "-C", str(ROOT), "worktree", "list"], capture_output=True, text=True, check=True
    )
    assert str(tree.parent) not in listed.stdout


def test_an_unknown_revision_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    if not is_checkout():
        pytest.skip("needs git and a checkout")
    assert golden.main(["--against", "no-such-revision"]) == 2
    assert "no-such-revision" in capsys.readouterr().err
