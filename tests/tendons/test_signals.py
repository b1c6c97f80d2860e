"""Courses over time: points, sines, recorded ones, and what is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.tendons.signals import factor_of
from cosim.tendons.table import FileSignalConfig, PointsSignalConfig, SineSignalConfig
from rigid.opensim.sto import StoTable, write_sto


def test_without_a_course_nothing_changes() -> None:
    assert factor_of(None)(3.0) == 1.0


def test_points_are_joined_and_held() -> None:
    factor = factor_of(PointsSignalConfig(kind="points", at=(("0.1 s", 0.0), ("0.3 s", 1.0))))
    assert [factor(t) for t in (0.0, 0.1, 0.2, 0.3, 9.0)] == pytest.approx([0, 0, 0.5, 1, 1])


def test_a_sine_is_never_negative() -> None:
    signal = SineSignalConfig(
        kind="sine", frequency="2 Hz", mean=0.25, amplitude=0.5, phase="90 deg"
    )
    factor = factor_of(signal)
    assert factor(0.0) == pytest.approx(0.75)
    assert factor(0.125) == pytest.approx(0.25)
    assert factor(0.25) == 0.0


def test_recorded_ones_from_sto_and_csv(tmp_path: Path) -> None:
    time, values = np.array([0.0, 1.0]), np.array([[0.2, 1.0], [0.4, 3.0]])
    write_sto(tmp_path / "a.sto", StoTable("a", ("EDC", "FDP"), time, values))
    (tmp_path / "a.csv").write_text("# source: us\ntime, EDC, FDP\n0, 0.2, 1\n1, 0.4, 3\n")
    for name in ("a.sto", "a.csv"):
        factor = factor_of(FileSignalConfig(kind="file", path=str(tmp_path / name), column="FDP"))
        assert factor(0.25) == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time,EDC\n0,1\n", "has no column 'FDP'; it has time, EDC"),
        ("FDP\n1\n", "has no column 'time'"),
        ("time,FDP\n1,1\n0,1\n", "times that rise"),
        ("time,FDP\n0,-1\n", "not negative"),
        ("time,FDP\n0,abc\n", "line 2: FDP is 'abc'"),
    ],
)
def test_a_table_that_is_none_says_why(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        factor_of(FileSignalConfig(kind="file", path=str(path), column="FDP"))


def test_faults_of_a_case_s_course() -> None:
    falling = 'tendons.EDC.signal={kind="points",at=[["1 s",0.0],["0.5 s",1.0]]}'
    with pytest.raises(InputError, match="its times must rise"):
        load_case("split_edc", [falling])
    with pytest.raises(InputError, match=r"tendons\.EDC\.signal\.frequency"):
        load_case("split_edc", ['tendons.EDC.signal={kind="sine",mean=1.0,amplitude=0.5}'])
