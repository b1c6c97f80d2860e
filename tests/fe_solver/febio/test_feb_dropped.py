"""FEBio's files: nothing is dropped in silence."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from cosim.errors import InputError
from fe_solver.febio.read import read_feb
from tests.helpers.feb_files import SECTIONS, Sections, change_section, feb_text, read, write

ROWS = ("node", "elem", "n", "e", "quad4", "tri3", "delem", "pt")
OPENINGS = [
    m
    for m in re.finditer(r"<([A-Za-z_]\w*)([^<>/]*)>", feb_text())
    if m[1] not in ROWS and m[1] not in ("var", "plotfile")
]


def notes_or_error(tmp_path: Path, text: str) -> str:
    """The notes of a file, or why it is refused."""
    try:
        return "\n".join(read_feb(write(tmp_path, text)).notes)
    except InputError as error:
        return str(error)


@pytest.mark.parametrize("at", OPENINGS, ids=lambda m: f"{m[1]}-{m.start()}")
def test_a_strange_tag_anywhere_is_noted_or_refused(tmp_path: Path, at: re.Match[str]) -> None:
    text = feb_text()
    message = notes_or_error(tmp_path, text[: at.end()] + "<mystery>1</mystery>" + text[at.end() :])
    assert "mystery" in message or "text among tags" in message or "Output" in message


@pytest.mark.parametrize("at", OPENINGS, ids=lambda m: f"{m[1]}-{m.start()}")
def test_a_strange_attribute_anywhere_is_noted_or_refused(
    tmp_path: Path, at: re.Match[str]
) -> None:
    text = feb_text()
    place = at.end() - 1
    message = notes_or_error(tmp_path, f'{text[:place]} mystery="1"{text[place:]}')
    assert "the attribute 'mystery' is not known" in message or at[1] == "Output"


STRANGE: dict[str, tuple[Sections, str]] = {
    "connector": (
        change_section("Rigid", "<Rigid>", '<Rigid><rigid_connector type="rigid spring"/>'),
        "rigid_connector.*may change",
    ),
    "rigid load": (
        change_section("Rigid", "<Rigid>", '<Rigid><rigid_load type="rigid_spring"/>'),
        "'rigid_spring' is not read",
    ),
    "prestrain": ({"Initial": '<Initial><ic type="prestrain"/></Initial>'}, "'prestrain' is not"),
    "body force": (
        change_section("Loads", "<Loads>", '<Loads><body_load type="moving frame"/>'),
        "'moving frame' is not read",
    ),
    "contact switched off": (
        change_section("Contact", '<contact name="c"', '<contact name="c" active="0"'),
        "the attribute 'active' is not known and may change",
    ),
    "gap offset": (
        change_section("Contact", "<penalty>", "<gap_offset>1</gap_offset><penalty>"),
        "gap_offset.*may change",
    ),
    "pulling contact": (
        change_section("Contact", "<penalty>", "<tension>1</tension><penalty>"),
        "also pulls",
    ),
    "tied": (
        change_section("Contact", "sliding-elastic", "tied-elastic"),
        "'tied-elastic' is not read",
    ),
    "flipped": (
        change_section("Contact", "<penalty>", "<flip_primary>1</flip_primary><penalty>"),
        "flip_primary.*turn",
    ),
    "viscoelastic": (
        change_section("Material", "<E>100", "<viscosity>1</viscosity><E>100"),
        "viscosity.*may change",
    ),
    "curve from a controller": (
        change_section("LoadData", '"loadcurve"', '"PID"'),
        "'PID' is not read",
    ),
    "row with two attributes": (
        change_section("Mesh", '<elem id="2">', '<elem id="2" mat="1">'),
        "at most one attribute",
    ),
    "unknown section": ({"Loads": SECTIONS["Loads"], "Physics": "<Physics/>"}, "no section"),
    "pair twice": (
        change_section("Mesh", "<SurfacePair", '<SurfacePair name="pair"/><SurfacePair'),
        "two surface pairs are called 'pair'",
    ),
}


@pytest.mark.parametrize("name", STRANGE)
def test_what_would_change_the_answer_is_not_passed_over(tmp_path: Path, name: str) -> None:
    replaced, words = STRANGE[name]
    with pytest.raises(InputError, match=words):
        read(tmp_path, replaced)
