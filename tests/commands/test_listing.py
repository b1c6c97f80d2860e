"""`cosim list`, `cosim explain` and names that are nearly right."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

import cosim
from cosim.case.file import json_schema
from cosim.cli import app
from cosim.commands.listing import LISTS, Things, describe_key
from cosim.errors import InputError, nearest_names


def said(*words: str, code: int = 0) -> str:
    done = CliRunner().invoke(app, list(words))
    assert done.exit_code == code, done.output
    return done.output


@pytest.mark.parametrize("what", list(Things))
def test_everything_of_a_kind_is_listed_once(what):
    header, rows = LISTS[what]()
    assert len({row[0] for row in rows}) == len(rows) > 0
    assert {len(row) for row in rows} == {len(header)}
    assert all(row[0] in said("list", what.value) for row in rows[:5])


def test_the_cases_are_listed_with_their_titles():
    _, rows = LISTS[Things.CASES]()
    assert sorted(row[0] for row in rows) == cosim.list_cases()
    assert ("isometric_edc", "isometric") in {row[:2] for row in rows}
    assert all(row[2] for row in rows)


def keys_of(schema: dict, key: str, node: dict) -> Iterator[str]:
    """Every key of a schema, those under free names with NAME."""
    if "$ref" in node:
        node = schema["$defs"][node["$ref"].rpartition("/")[2]]
    yield key
    for choice in [*node.get("anyOf", ()), *node.get("oneOf", ())]:
        if choice is not True:
            yield from keys_of(schema, key, choice)
    named = [node.get("additionalProperties"), *node.get("patternProperties", {}).values()]
    children = [*node.get("properties", {}).items(), *(("NAME", n) for n in named if n)]
    for name, child in children:
        yield from keys_of(schema, f"{key}.{name}".lstrip("."), child)


def test_every_key_of_the_schema_can_be_explained():
    """Down to the leaves, under free names too; a table with its keys."""
    schema = json_schema()
    keys = sorted(set(keys_of(schema, "", schema)))
    assert {"hood.contact.stiffness", "gives_way.NAME.force", "lesion.graft.NAME.end"} <= {*keys}
    holding = {key.rpartition(".")[0] for key in keys}
    for key in keys:
        told = list(describe_key(schema, key))
        assert told, key
        assert any(rows for *_, rows in told) == (key in holding), key
        for _, text, rows in told:
            assert text or rows or not key, key
            assert all(what and what != "object" for _, what, _ in rows), key


def test_what_is_told_of_a_table_by_name_holds():
    assert "NAME" in said("explain", "finger.splint")
    assert "stiffness" in said("explain", "finger.splint.NAME")


def test_a_key_is_explained_with_its_unit_and_range():
    told = said("explain", "hood.regions.central_slip")
    assert 'kind = "transversely_isotropic"' in told
    assert "pressure with its unit: above 0 MPa" in told


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (("explain", "hood.regins"), "did you mean hood.regions?"),
        (("check", "isometrc_edc"), "did you mean isometric_edc"),
        (("validate", "--list", "--only", "strian"), "did you mean"),
    ],
)
def test_a_wrong_name_is_answered_with_the_nearest(words, hint):
    assert hint in said(*words, code=2)


def test_letters_that_are_swapped_are_one_mistake():
    assert nearest_names("FPD", ["EDC", "FPI", "FDP"]) == ["FDP"]
    assert nearest_names("zzz", ["EDC", "FPI"]) == []
    assert nearest_names("edc", ["EI", "EDC"]) == ["EDC"]


@given(st.text("abc", min_size=1, max_size=8), st.lists(st.text("abc", min_size=1), min_size=1))
def test_a_known_name_is_nearest_to_itself(name, others):
    assert nearest_names(name, [*others, name])[0] == name


def test_a_key_that_is_not_there_lists_those_that_are():
    with pytest.raises(InputError, match="There are kind, mesh"):
        list(describe_key(json_schema(), "hood.zzzzzz"))


def test_a_key_that_the_case_names_is_explained() -> None:
    told = CliRunner().invoke(app, ["explain", "hood.grids.camera"])
    assert told.exit_code == 0, told.output
    assert "points over a rectangle" in told.stdout
    assert "Places on the undeformed hood" in CliRunner().invoke(app, ["explain", "hood"]).stdout


def test_a_key_that_kinds_have_in_two_forms_says_of_which_kind_each_is():
    first, second = (heading for heading, *_ in describe_key(json_schema(), "finger.lengths"))
    assert first == 'finger.lengths, of finger.kind = "hinge" or finger.kind = "planar"'
    assert second == 'finger.lengths, of finger.kind = "robot"'
