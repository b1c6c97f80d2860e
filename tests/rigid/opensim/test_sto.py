"""OpenSim's tables: both headers, degrees and radians, and files that are none."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal

from cosim.errors import InputError, ReadingWarning
from rigid.opensim import sto
from rigid.opensim.sto import StoTable, is_angle, read_sto, write_sto

OLD = """Coordinates
version=1
nRows=2
nColumns=4
inDegrees=yes

Units are S.I. units (second, meters, Newtons, ...)
endheader
time\tMCP\tpelvis_tx\t/jointset/pip/PIP/value
0\t180\t1\t-90
0.5\t90\t2\t45
"""
NEW = """inDegrees=no
DataType=double
version=3
OpenSimVersion=4.6-2026-03-05-fc4bd99
endheader
time  FDP   FDS
0.0   1.5   2.5
0.01  1e-3  -2
"""
ANGLES = ("MCP", "PIP")


def read(folder: Path, text: str, angles: tuple[str, ...] | None = ANGLES) -> StoTable:
    path = folder / "table.sto"
    path.write_text(text, encoding="utf-8")
    return read_sto(path, angles)


def test_the_old_header_in_degrees(tmp_path: Path) -> None:
    table = read(tmp_path, OLD)
    assert (table.name, table.in_degrees) == ("Coordinates", True)
    assert table.columns == ("MCP", "pelvis_tx", "/jointset/pip/PIP/value")
    assert_array_equal(table.time, [0, 0.5])
    expected = [[np.pi, 1, -np.pi / 2], [np.pi / 2, 2, np.pi / 4]]
    assert_allclose(table.values, expected, rtol=1e-15)


def test_the_new_header_in_radians(tmp_path: Path) -> None:
    table = read(tmp_path, NEW, None)
    assert (table.name, table.in_degrees) == ("", False)
    assert_array_equal(table.values, [[1.5, 2.5], [1e-3, -2]])


def test_radians_stay_as_they_are(tmp_path: Path) -> None:
    table = read(tmp_path, OLD.replace("inDegrees=yes", "inDegrees=no"))
    assert_array_equal(table.values[0], [180, 1, -90])


def test_what_is_an_angle() -> None:
    assert is_angle("PIP", ANGLES)
    assert is_angle("/jointset/pip/PIP/speed", ANGLES)
    assert not is_angle("/forceset/PIP/activation", ANGLES)
    assert not is_angle("PIP_force", ANGLES)


def test_degrees_need_the_names_of_the_angles(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="say which columns are angles"):
        read(tmp_path, OLD, None)


def test_a_written_file_is_in_degrees_only_where_it_is_an_angle(tmp_path: Path) -> None:
    values = np.array([[np.pi, 3.0]])
    table = StoTable("motion", ("MCP", "tx"), np.array([0.25]), values, True, ANGLES)
    write_sto(tmp_path / "m.mot", table, 1)
    assert (tmp_path / "m.mot").read_text() == (
        "motion\nversion=1\nnRows=1\nnColumns=3\ninDegrees=yes\nendheader\n"
        "time\tMCP\ttx\n0.25\t180.0\t3.0\n"
    )


NAMES = st.from_regex(r"[A-Za-z_/][A-Za-z0-9_/.]{0,12}", fullmatch=True)
NUMBERS = st.floats(-1e20, 1e20)


@st.composite
def tables(draw: st.DrawFn) -> StoTable:
    columns = tuple(draw(st.lists(NAMES, min_size=1, max_size=4, unique=True)))
    time = np.unique(draw(arrays(float, st.integers(0, 5), elements=st.floats(-1e6, 1e6))))
    values = draw(arrays(float, (len(time), len(columns)), elements=NUMBERS))
    angles = tuple(draw(st.lists(st.sampled_from(columns), unique=True)))
    name = draw(NAMES)
    return StoTable(name, columns, time, values, draw(st.booleans()), angles)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(table=tables(), version=st.sampled_from([1, 3]))
def test_a_table_comes_back_as_it_was(
    table: StoTable, version: Literal[1, 3], tmp_path: Path
) -> None:
    path = tmp_path / "t.sto"
    write_sto(path, table, version)
    back = read_sto(path, table.angles)
    assert (back.name, back.columns, back.angles) == (table.name, table.columns, table.angles)
    assert back.in_degrees == table.in_degrees
    assert_array_equal(back.time, table.time)
    if table.in_degrees:
        assert_allclose(back.values, table.values, rtol=4e-16, atol=5e-324)
    else:
        assert_array_equal(back.values, table.values)


BAD = {
    "no endheader": (OLD.replace("endheader\n", ""), "endheader is missing"),
    "no header at all": ("1 2 3\n4 5 6\n", "endheader is missing"),
    "ends there": (OLD[: OLD.index("time")], "line 9: expected labels"),
    "no time": (OLD.replace("time", "frame"), "line 9: expected labels, the first of them time"),
    "label lost": (OLD.replace("\tMCP\t", "\t\t"), "line 10: 4 values, expected 3"),
    "label twice": (OLD.replace("pelvis_tx", "MCP"), "'MCP' comes twice"),
    "ragged": (OLD.replace("\t45\n", "\n"), "line 11: 3 values, expected 4"),
    "text": (OLD.replace("\t45\n", "\tx45\n"), "line 11: 'x45' in column 4"),
    "python's numbers": (OLD.replace("\t45\n", "\t4_5\n"), "line 11: expected numbers"),
    "NaN": (OLD.replace("180", "NaN"), "line 10, column 2: NaN"),
    "infinite": (OLD.replace("180", "inf"), "line 10, column 2: inf"),
    "beyond": (OLD.replace("180", "1e200"), "at most 1e+30"),
    "back in time": (OLD.replace("0.5\t", "-1\t"), "0 s is followed by -1 s"),
    "same time within": (OLD + "0.5\t1\t1\t1\n0.6\t1\t1\t1\n", "time must increase"),
    "degrees perhaps": (OLD.replace("=yes", "=maybe"), "'maybe', expected yes or no"),
    "vectors": (NEW.replace("=double", "=Vec3"), "DataType is Vec3"),
    "long header": ("x" * 70_000 + "\n" + OLD, "no endheader in 64 kB"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_table_is_refused_in_one_message(case: str, tmp_path: Path) -> None:
    text, fragment = BAD[case]
    with pytest.raises(InputError) as caught:
        read(tmp_path, text)
    assert "table.sto" in str(caught.value)
    assert fragment in str(caught.value)
    assert len(str(caught.value)) < 300


LAST = OLD.splitlines()[-1]
STALE = {
    "fewer rows": (OLD.replace("nRows=2", "nRows=3"), "nRows=3, the file has 2"),
    "more columns": (OLD.replace("nColumns=4", "nColumns=3"), "nColumns=3, the file has 4"),
    "of version 3": (OLD.replace("version=1", "version=3\nnRows=9"), "nRows=9|nRows=2"),
    "last twice": (OLD.replace("nRows=2", "nRows=3") + LAST + "\n", "last two rows have one time"),
}


@pytest.mark.parametrize("case", STALE)
def test_a_stale_header_and_a_doubled_end_are_read_and_told(case: str, tmp_path: Path) -> None:
    text, told = STALE[case]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        table = read(tmp_path, text)
    assert_array_equal(table.time, [0, 0.5])
    assert len(table.columns) == 3
    said = [str(w.message) for w in caught if w.category is ReadingWarning]
    if case != "of version 3":
        assert any(told in text for text in said)


def test_a_first_row_that_is_there_twice_is_taken_once(tmp_path: Path) -> None:
    lines = OLD.splitlines()
    first = lines.index(next(line for line in lines if line.startswith("0\t")))
    text = "\n".join([*lines[: first + 1], *lines[first:]]).replace("nRows=2", "nRows=3")
    with pytest.warns(ReadingWarning, match="first two rows have one time, 0 s"):
        table = read(tmp_path, text)
    assert_array_equal(table.time, [0, 0.5])


def test_two_tabs_between_labels_are_one(tmp_path: Path) -> None:
    table = read(tmp_path, OLD.replace("time\t", "time\t\t"))
    assert table.columns == ("MCP", "pelvis_tx", "/jointset/pip/PIP/value")


def test_what_is_no_file_or_no_text_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_sto(tmp_path / "none.sto")
    (tmp_path / "b.sto").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="not a text"):
        read_sto(tmp_path / "b.sto")
    monkeypatch.setattr(sto, "MOST_BYTES", 10)
    with pytest.raises(InputError, match="MB are read"):
        read(tmp_path, OLD)


def test_a_table_that_does_not_fit_together_is_refused(tmp_path: Path) -> None:
    one = np.zeros(1)
    with pytest.raises(InputError, match=r"expected values \(1, 1\)"):
        StoTable("t", ("a",), one, np.zeros((1, 2)))
    with pytest.raises(InputError, match="not finite"):
        StoTable("t", ("a",), one, np.full((1, 1), np.nan))
    for label in ("a b", "a\tb", "", "a=b"):
        with pytest.raises(InputError, match="is no label"):
            write_sto(tmp_path / "t.sto", StoTable("t", (label,), one, np.zeros((1, 1))))
    (tmp_path / "no").touch()
    with pytest.raises(InputError, match="cannot be written"):
        write_sto(tmp_path / "no" / "t.sto", StoTable("t", ("a",), one, np.zeros((1, 1))))


@pytest.mark.opensim
@pytest.mark.parametrize("version", [1, 3])
def test_opensim_reads_what_is_written(
    version: Literal[1, 3], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # opensim leaves a log where it is imported
    opensim = pytest.importorskip("opensim")
    path = tmp_path / "t.sto"
    values = np.array([[0.1, 0.2], [1 / 3, -0.4], [0.5, 0.6]])
    columns = ("MCP", "/forceset/FDP/normalized")
    write_sto(
        path, StoTable("motion", columns, np.array([0.0, 0.1, 0.3]), values, True, ANGLES), version
    )
    read_back = opensim.TimeSeriesTable(str(path))
    assert read_back.getColumnLabels() == columns
    assert read_back.getTableMetaDataAsString("inDegrees") == "yes"
    assert_array_equal(read_back.getIndependentColumn(), [0.0, 0.1, 0.3])
    expected = values * [np.degrees(1.0), 1.0]
    assert_allclose(read_back.getMatrix().to_numpy(), expected, rtol=1e-15)


@pytest.mark.opensim
def test_what_opensim_writes_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # opensim leaves a log where it is imported
    opensim = pytest.importorskip("opensim")
    table = opensim.TimeSeriesTable()
    table.setColumnLabels(["MCP", "tx"])
    for time in (0.0, 0.1):
        table.appendRow(time, opensim.RowVector([90.0 * time, 2.0]))
    table.addTableMetaDataString("inDegrees", "yes")
    opensim.STOFileAdapter.write(table, str(tmp_path / "t.sto"))
    back = read_sto(tmp_path / "t.sto", ANGLES)
    assert_allclose(back.values, [[0, 2], [np.radians(9.0), 2]], rtol=1e-15)
