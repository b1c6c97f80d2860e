"""One rule of what a number is, in the texts of all programs."""

from __future__ import annotations

import re
from collections.abc import Callable
from math import isfinite
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.abaqus_file import read_inp
from cosim.analyses.reduction.reduce import read_grid
from cosim.commands.options import three_numbers
from cosim.errors import InputError
from cosim.number_text import MOST_NUMBER, read_number, read_numbers, read_whole_number
from cosim.text_tables import read_csv
from fe_solver.febio.xml import read_xml
from rigid.opensim.sto import read_sto, read_trc

DECIMAL = re.compile(r"\s*[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?\s*", re.ASCII)
WRONG = ("1_0", "\u0661\u0662", "nan", "inf", "-Infinity", "1e999", "1e31", "0x10", "1,5e")


@given(st.floats(-1e30, 1e30) | st.integers(-(10**30), 10**30))
def test_a_number_reads_back(value: float) -> None:
    assert read_number(f" {value!r}\t") == float(value)


@given(st.text("0123456789.+-eE_ \u0661nif", max_size=8) | st.text(max_size=8))
def test_nothing_but_plain_decimals_is_a_number(text: str) -> None:
    value = float(text) if DECIMAL.fullmatch(text) and text.isascii() else float("nan")
    expected = value if isfinite(value) and abs(value) <= MOST_NUMBER else None
    assert read_number(text) == expected
    whole = re.fullmatch("[0-9]{1,18}", text)
    assert read_whole_number(text) == (int(text) if whole else None)
    assert read_numbers(f"1 {text}") is None or len(text.split()) == len(read_numbers(text) or ())


def of_csv(path: Path, word: str) -> object:
    path.write_text(f'time,x\n0,"{word}"\n', encoding="utf-8")
    return read_csv(path, "time,x").numbers("x")


def of_inp(path: Path, word: str) -> object:
    path.write_text(f"*NODE\n1, {word}\n*ELEMENT, TYPE=MASS\n1, 1\n", encoding="utf-8")
    return read_inp(path)


def of_sto(path: Path, word: str) -> object:
    path.write_text(f"a\nendheader\ntime\tx\n0\t{word}\n1\t2\n", encoding="utf-8")
    return read_sto(path)


def of_trc(path: Path, word: str) -> object:
    head = "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tUnits\n1\tmm\n"
    head += "Frame#\tTime\tM\t\t\n\tX1\tY1\tZ1\n"
    path.write_text(f"{head}1\t0\t{word}\t2\t3\n", encoding="utf-8")
    return read_trc(path)


def of_feb(path: Path, word: str) -> object:
    path.write_text(f'<a><Nodes><node id="1">{word} 0 0</node></Nodes></a>', encoding="utf-8")
    return read_xml(path, "a")


READERS: tuple[Callable[[Path, str], object], ...] = (
    *(of_csv, of_inp, of_sto, of_trc, of_feb),
    lambda _, word: three_numbers("--up", f"0 {word} 1", "0 0 1"),
    lambda _, word: read_grid([f"PIP=0,{word}"]),
)


@pytest.mark.parametrize("read", READERS)
def test_every_reader_takes_the_same_for_a_number(
    read: Callable[[Path, str], object], tmp_path: Path
) -> None:
    for word in ("1", "-2.5", "3e-1", ".5", "+1."):
        read(tmp_path / "a.inp", word)
    for word in WRONG:
        if (read is of_inp and "," in word) or (read is of_trc and word == "nan"):
            continue  # two numbers; and a marker that was lost
        with pytest.raises(InputError):
            read(tmp_path / "a.inp", word)
