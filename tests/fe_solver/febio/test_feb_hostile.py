"""FEBio's files that are none: damaged, hostile, in other letters."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cosim.errors import InputError
from fe_solver.febio.read import read_feb
from tests.helpers.feb_files import change_section, feb_text, write

BOMB = (
    '<?xml version="1.0"?><!DOCTYPE b [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
    '<febio_spec version="4.0">&b;</febio_spec>'
)
EXTERNAL = (
    '<?xml version="1.0"?><!DOCTYPE b [<!ENTITY a SYSTEM "file:///etc/passwd">]>'
    '<febio_spec version="4.0">&a;</febio_spec>'
)
OPEN = '<febio_spec version="4.0">'
HOSTILE: dict[str, tuple[str | bytes, str]] = {
    "entity bomb": (BOMB, "document type"),
    "external entity": (EXTERNAL, "document type"),
    "remote dtd": ('<!DOCTYPE a SYSTEM "http://x.invalid/a.dtd"><febio_spec/>', "document type"),
    "many elements": (OPEN + "<Globals>" + "<a/>" * 250_000, "more than 200000 tags"),
    "many attributes": (
        OPEN + "<Globals " + " ".join(f'a{i}=""' for i in range(120_000)),
        "longer than 1 MB",
    ),
    "deep": (OPEN + "<a>" * 100_000, "nested"),
    "long text": (OPEN + "<a>" + "1," * 2_200_000 + "</a></febio_spec>", "longer than 4 MB"),
    "long comment": (OPEN + "<!--" + "x" * 5_000_000 + "--></febio_spec>", "longer than 1 MB"),
    "truncated": (feb_text()[:-300], "not well-formed"),
    "empty": ("", "not well-formed"),
    "binary": (bytes(range(256)) * 50, "not well-formed"),
    "wrong root": ("<html><body/></html>", "the root is <html>"),
    "old version": (feb_text(version="2.5"), "version '2.5'"),
    "no version": ("<febio_spec/>", "version ''"),
    "undefined entity": (OPEN + "&lol;</febio_spec>", "not well-formed"),
    "unknown encoding": ('<?xml version="1.0" encoding="klingon"?><febio_spec/>', "encoding"),
    "bad latin": (OPEN.encode() + b"\xff\xfe</febio_spec>", "not well-formed"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_give_one_clear_message(tmp_path: Path, name: str) -> None:
    text, words = HOSTILE[name]
    with pytest.raises(InputError, match=words) as caught:
        read_feb(write(tmp_path, text, "bad.feb"))
    assert "bad.feb" in str(caught.value)
    assert len(str(caught.value)) < 400


def test_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_feb(tmp_path / "absent.feb")
    with pytest.raises(InputError, match="cannot be read"):
        read_feb(tmp_path)
    closed = write(tmp_path, feb_text(), "closed.feb")
    closed.chmod(0)
    if not os.access(closed, os.R_OK):
        with pytest.raises(InputError, match="cannot be read"):
            read_feb(closed)


def test_utf_8_and_latin_1_names(tmp_path: Path) -> None:
    text = feb_text(change_section("MeshDomains", 'name="strip"', 'name="Häutchen"'))
    text = text.replace('name="strip">', 'name="Häutchen">').replace('"strip"', '"Häutchen"')
    latin = read_feb(write(tmp_path, text))
    utf = read_feb(write(tmp_path, text.replace("ISO-8859-1", "UTF-8").encode()))
    assert latin.sheet.parts[0].name == utf.sheet.parts[0].name == "Häutchen"


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_a_damaged_file_is_read_or_refused(tmp_path: Path, data: st.DataObject) -> None:
    """Whatever is cut out or put in: a job or an InputError, never anything else."""
    text = feb_text()
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, min(len(text), start + 40)))
    new = data.draw(
        st.sampled_from(["", "0", "-1", "1e400", "<", "</a>", "9,9,9", '"', "\x00", "é"])
    )
    try:
        read_feb(write(tmp_path, text[:start] + new + text[end:]))
    except InputError as error:
        assert "model.feb" in str(error)
