"""The one reader of users' tables, and the one writer of TOML."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import InputError
from cosim.text_tables import (
    notes,
    packaged_rows,
    read_csv,
    read_toml,
    toml_settings,
    toml_text,
    toml_value,
)

KEYS = st.text(min_size=1, max_size=8).filter(lambda key: "\r" not in key)
SCALARS = st.booleans() | st.integers(-(2**53), 2**53) | st.floats(allow_nan=False) | KEYS
VALUES = st.recursive(
    SCALARS | st.lists(st.floats(allow_nan=False), max_size=3),
    lambda inner: st.dictionaries(KEYS, inner, max_size=3),
    max_leaves=8,
)


def csv_file(folder: Path, text: str) -> Path:
    path = folder / "data.csv"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "text",
    [
        "# so\nname, a_mm\none, 1.5\n\ntwo,\n",
        "\ufeffname,a_mm\none,1.5\n# between\ntwo,\n",
        "name;a_mm\none;1,5\ntwo;\n",
        'name,a_mm\n"one",1.5\n"two",\n',
        "name,a_mm,,\r\none,1.5,,\r\ntwo,,,\r\n",
    ],
    ids=["spaces", "mark", "semicolons", "quotes", "spreadsheet"],
)
def test_every_way_to_write_a_table_is_read(tmp_path: Path, text: str) -> None:
    table = read_csv(csv_file(tmp_path, text), "name,a_mm")
    assert table.columns == ("name", "a_mm")
    assert [row.cells["name"] for row in table.rows] == ["one", "two"]
    assert [row.number("a_mm") for row in table.rows] == [1.5, None]
    assert table.rows[0].number("absent") is None
    with pytest.raises(InputError, match=r"line \d: a_mm is empty"):
        table.numbers("a_mm")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty; its first line names the columns, for example time,x"),
        ("# nothing\n", "is empty"),
        ("time,x,x\n", "line 1: two columns are called 'x'"),
        ("time,,x\n0,1,2\n", "line 1: column 2 has no name"),
        ("time,x\n0," + "1" * 200_000, "line 2: cannot be read as cells"),
        ("time,x\n0,1\n\n1,2,3\n", "line 4: has 3 cells, the first line 2"),
        ("time,x\n0\n", "line 2: has 1 cells"),
        ("time,y\n0,1\n", "has no column 'x'; it has time, y"),
        ("# so\ntime,x\n0,abc\n", "line 3: x is 'abc'; expected a finite number"),
        ("time,x\n0,nan\n", "line 2: x is 'nan'"),
        ("time,x\n0,1e999\n", "line 2: x is '1e999'"),
        ("time;x\n0;1,5 s\n", "line 2: x is '1,5 s'"),
        ("time,x\n0,\n", "line 2: x is empty"),
    ],
)
def test_a_faulty_table_is_refused_with_its_line(tmp_path: Path, text: str, words: str) -> None:
    path = csv_file(tmp_path, text)
    with pytest.raises(InputError, match=words):
        read_csv(path, "time,x").numbers("x")


@pytest.mark.parametrize("read", [lambda path: read_csv(path, "x"), read_toml])
def test_what_is_no_text_is_refused(tmp_path: Path, read: Any) -> None:
    (tmp_path / "bytes").write_bytes(b"name\xff")
    for path, words in (("absent", "cannot be read"), ("bytes", "not a text file in UTF-8")):
        with pytest.raises(InputError, match=f"{path}: .*{words}"):
            read(tmp_path / path)
    with pytest.raises(InputError, match="cannot be read"):
        read(tmp_path)


def test_a_column_of_numbers_is_an_array(tmp_path: Path) -> None:
    table = read_csv(csv_file(tmp_path, "time,x\n0,1\n1,2.5\n"), "time,x")
    assert np.array_equal(table.numbers("x"), [1.0, 2.5])


def test_a_packaged_table_is_there() -> None:
    rows = packaged_rows("length_experiments")
    assert {row.cells["name"] for row in rows} >= {"terminal_1mm", "bands_45"}


@given(st.dictionaries(KEYS, VALUES, max_size=5))
def test_what_is_written_reads_back(values: dict[str, Any]) -> None:
    assert tomllib.loads(toml_text(values)) == values


def test_a_list_of_lists_has_a_line_for_each() -> None:
    rows = [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]
    text = toml_text({"table": {"rows": rows}})
    assert [line.strip() for line in text.splitlines() if line.startswith("    ")] == [
        "[1.0, 2.0],",
        "[3.0, 4.0],",
        "[5.0, 6.0],",
    ]
    assert tomllib.loads(text)["table"]["rows"] == rows


@pytest.mark.parametrize(
    ("settings", "values"),
    [
        (
            ["hood.a b=1", "tendons.EDC.tension = 5 N", "hood.a b=[1, 2]"],
            {"hood": {"a b": [1, 2]}, "tendons": {"EDC": {"tension": "5 N"}}},
        ),
        ([], {}),
        (["a.b={c=1}", "a.b.c=2", "a.b.d='x'"], {"a": {"b": {"c": 2, "d": "x"}}}),
        (["a.b=0.3", "a={}", "title=x"], {"a": {"b": 0.3}, "title": "x"}),
        (["a={}", "title=x"], {"a": {}, "title": "x"}),
        (["a={b={c=[{x=1},{x={y=2}}]}}"], {"a": {"b": {"c": [{"x": 1}, {"x": {"y": 2}}]}}}),
        (["a={b=1}", "a=2"], {"a": 2}),
    ],
)
def test_settings_are_lines_of_which_a_later_one_lies_on_top(
    settings: list[str], values: dict[str, Any]
) -> None:
    """As lines without a header, so that others may follow them."""
    text = toml_settings(settings)
    assert tomllib.loads(text) == values
    assert not any(line.startswith("[") for line in text.splitlines())


@pytest.mark.parametrize(
    ("text", "value"),
    [("1", 1), ("[1, 2]", [1, 2]), ("5 N", "5 N"), ('"5 N"', "5 N"), ("a\nb = 2", "a\nb = 2")],
)
def test_a_value_is_toml_or_a_text(text: str, value: Any) -> None:
    assert toml_value(text) == value


def test_notes_are_comments_of_a_file_s_width() -> None:
    text = notes(["word " * 40, "", "end"])
    assert all(line.startswith("#") and len(line) <= 101 for line in text.splitlines())
    assert text.splitlines()[1].startswith("#     word")
    assert text.endswith("#\n# end\n")


@pytest.mark.parametrize(
    ("head", "columns"),
    [
        ("name,distal [mm],strain (%)", ("name", "distal_mm", "strain_percent")),
        ("time;MCP [°]; torque [N mm]", ("time", "MCP_deg", "torque_Nmm")),
        ("sep=;\nname;distal_mm", ("name", "distal_mm")),
        ("SEP=,\nname,distal_mm", ("name", "distal_mm")),
        ("a (b) c,d", ("a (b) c", "d")),
    ],
)
def test_columns_are_named_as_people_name_them(
    tmp_path: Path, head: str, columns: tuple[str, ...]
) -> None:
    mark = ";" if ";" in head else ","
    path = tmp_path / "a.csv"
    path.write_text(f"{head}\n{mark.join(['1'] * len(columns))}\n{mark * 3}\n", encoding="utf-8")
    table = read_csv(path, "a,b")
    assert table.columns == columns
    assert len(table.rows) == 1


def test_a_line_sep_says_how_columns_are_parted(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("sep=;\na;b, c\n1,5;2\n", encoding="utf-8")
    table = read_csv(path, "a,b")
    assert table.columns == ("a", "b, c")
    assert table.numbers("a").tolist() == [1.5]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a = { b = 1, c = 2, }", "leave out the comma before the }"),
        ("a = {\n b = 1\n}", "stands on one line"),
        (r'a = "C:\Users\me"', "single quotes"),
        (r'a = "C:\data"', "single quotes"),
        ("a = “text”", "straight quotes"),
        ("a = ‘text’", "straight quotes"),
    ],
)
def test_toml_as_other_programs_take_it_is_met_with_what_to_write(
    tmp_path: Path, text: str, words: str
) -> None:
    path = tmp_path / "a.toml"
    path.write_text(f"{text}\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"a\.toml, line 1") as raised:
        read_toml(path)
    assert words in str(raised.value)
