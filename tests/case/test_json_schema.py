"""The JSON Schemas of case and study files, as an editor checks files by them."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from typer.testing import CliRunner

from cosim.case.file import json_schema, load_case, packaged_cases, resolved_toml
from cosim.cli import app
from cosim.errors import InputError
from cosim.schema import units
from cosim.schema.json_schema import CASE_SCHEMA, STUDY_SCHEMA
from cosim.study.file import read_file, study_schema
from cosim.text_tables import packaged_files
from tests.helpers.folders import ROOT

SCHEMAS = {"case": json_schema(), "study": study_schema()}
CHECK = {name: Draft202012Validator(schema) for name, schema in SCHEMAS.items()}
KINDS = [kind for kind in vars(units).values() if isinstance(kind, units.Kind)]
PREFIXES = ("", "giga", "mega", "kilo", "centi", "milli", "micro", *"GMkcmµμu")
WORDS = (
    *("m", "meter", "meters", "metre", "metres", "g", "gram", "grams", "s", "second", "seconds"),
    *("Hz", "hertz", "rad", "radian", "radians", "deg", "degree", "degrees", "N", "newton"),
    *("newtons", "Nm", "Nmm", "Pa", "pascal", "W", "watt", "V", "volt", "K", "kelvin"),
)
NAMES = [*(prefix + word for prefix in PREFIXES for word in WORDS), "°"]


def properties(node: Any, where: str = "") -> Iterator[tuple[str, Any]]:
    """Every key of every table of a schema."""
    if isinstance(node, dict):
        for key, value in node.items():
            if key == "properties":
                yield from ((f"{where}.{name}", inner) for name, inner in value.items())
            if key not in ("if", "then"):
                yield from properties(value, f"{where}.{key}")
    elif isinstance(node, list):
        for i, item in enumerate(node):
            yield from properties(item, f"{where}[{i}]")


def faults(what: str, text: str) -> list[tuple[str, str]]:
    """The keys and validators of the faults that an editor shows."""
    found = CHECK[what].iter_errors(tomllib.loads(text))
    return sorted((".".join(map(str, e.absolute_path)), str(e.validator)) for e in found)


def takes(text: str, kind: units.Kind) -> bool:
    try:
        units.parse(text, kind)
    except ValueError:
        return False
    return True


@pytest.mark.parametrize("what", SCHEMAS)
def test_every_key_has_a_description(what):
    Draft202012Validator.check_schema(SCHEMAS[what])
    every = dict(properties(SCHEMAS[what]))
    assert len(every) > 20
    assert [key for key, node in every.items() if not node.get("description")] == []


def test_defaults_are_what_a_file_may_say():
    """A default that the schema itself would refuse misleads."""
    schema = SCHEMAS["case"]
    for key, node in properties(schema):
        if "default" in node and "$ref" not in node and node["default"] is not None:
            check = Draft202012Validator({**node, "$defs": schema["$defs"]})
            assert check.is_valid(node["default"]), (key, node["default"])


@pytest.mark.parametrize("name", sorted(packaged_cases()))
def test_the_schema_takes_every_shipped_case(name):
    path = packaged_cases()[name]
    assert faults("case", path.read_text(encoding="utf-8")) == []


def test_the_schema_takes_bases_studies_and_whole_cases():
    for path in (ROOT / "cases" / "base").glob("*.toml"):
        assert faults("case", path.read_text(encoding="utf-8")) == [], path
    for path in packaged_files("studies"):
        assert faults("study", path.read_text(encoding="utf-8")) == [], path
    for name in ("pulley_edc", "network_edc", "isometric_edc", "motion_edc_fdp"):
        text = resolved_toml(load_case(name))
        assert faults("case", text) == [], name


def test_a_fault_is_told_of_the_alternative_that_its_word_chooses():
    region = 'hood.regions.central_slip = { kind = "isotropic", modulus = "5 mm", poisson = 0.9 }'
    at = "hood.regions.central_slip"
    assert faults("case", region) == [(f"{at}.modulus", "pattern"), (f"{at}.poisson", "maximum")]
    tip = 'finger = { kind = "index", tip = { kind = "cage", width = "3 deg", height = 1 } }'
    assert faults("case", tip) == [
        ("finger.tip", "additionalProperties"),
        ("finger.tip.width", "pattern"),
    ]
    assert faults("case", 'hood.kind = "pully"') == [("hood.kind", "enum")]
    assert faults("case", 'hood.thikness = "1 mm"') == [("hood", "additionalProperties")]
    assert faults("case", 'hood.thickness = "1 deg"') == [("hood.thickness", "pattern")]
    study = 'case = "a"\noutputs = { f = "f" }\nparameters.x = '
    assert faults("study", study + '{ distribution = "uniform", low = "1 N", high = 2 }') == []
    assert faults("study", study + '{ distribution = "uniform", low = "N", high = 2 }') == [
        *[("parameters.x.low", "anyOf")],
    ]
    assert faults("study", study + "{ values = [] }") == [("parameters.x.values", "minItems")]
    assert faults("study", study + "{ from = 1, to = 2, count = 1 }") == [
        ("parameters.x.count", "minimum")
    ]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: f"{kind.name} {kind.unit}")
def test_the_pattern_of_a_quantity_takes_a_single_unit_as_the_loader_does(kind):
    pattern = re.compile(units.pattern(kind))
    assert pattern.search(kind.example)
    powers = ("", "**2", "^3", "**-1", "**1", "^-2")
    for text in (f"1.5 {name}{power}" for name in NAMES for power in powers):
        assert bool(pattern.search(text)) == takes(text, kind), text


def test_the_pattern_of_an_angle_refuses_a_length():
    assert not re.search(units.pattern(units.ANGLE), "40 mm")
    assert not re.search(units.pattern(units.ANGLE), "5 N/mm")
    assert re.search(units.pattern(units.ANGLE), "40 deg")


FACTORS = st.builds(str.__add__, st.sampled_from(NAMES), st.sampled_from(["", "**2", "^-1", "**3"]))
NUMBERS = st.sampled_from(["1", "-0.5", "+3.", ".2", "1e3", "2E-4", " 7", "1e", "", "nan", "1,5"])
SIGNS = st.sampled_from([" ", "*", "/", " * ", "·", " / ", "  ", "**", "-"])


@st.composite
def texts(draw) -> str:
    unit = draw(FACTORS)
    for _ in range(draw(st.integers(0, 3))):
        unit += draw(SIGNS) + draw(FACTORS)
    return draw(NUMBERS) + draw(st.sampled_from(["", " ", "  "])) + unit


SPELT = st.sampled_from(KINDS).flatmap(
    lambda kind: st.floats(-1e6, 1e6).map(lambda value: (kind, units.spell(value, kind)))
)


@given(texts() | st.text(max_size=12), st.sampled_from(KINDS))
def test_the_schema_takes_what_the_loader_takes(text, kind):
    if takes(text, kind):
        assert re.search(units.pattern(kind), text)


@given(SPELT)
def test_the_schema_takes_what_the_program_writes(spelt):
    kind, text = spelt
    assert takes(text, kind)
    assert re.search(units.pattern(kind), text)


@given(texts(), st.sampled_from(KINDS))
def test_the_loader_reads_the_number_and_the_units_that_the_schema_takes(text, kind):
    """Of a product of units the schema leaves the dimension to the loader."""
    if re.search(units.pattern(kind), text) and not takes(text, kind):
        with pytest.raises(ValueError, match="no unit of"):
            units.parse(text, kind)
        assert re.search(r"[*/· ].*[A-Za-z°]", text.strip().replace("**", "^"))


def test_kilograms_in_words_do_not_lead_in_circles():
    assert units.parse("2 kilograms", units.MASS) == 2
    assert units.parse("3 mg", units.MASS) == 3e-6
    assert units.parse("2 kN", units.FORCE) == 2000
    with pytest.raises(ValueError, match="not a unit"):
        units.parse("1 kkg", units.MASS)


def test_both_schemas_are_written_and_a_written_case_names_its_own(tmp_path):
    done = CliRunner().invoke(app, ["explain", "--schema", "--out", str(tmp_path / "runs")])
    assert done.exit_code == 0, done.output
    assert {path.name for path in (tmp_path / "runs").iterdir()} == {CASE_SCHEMA, STUDY_SCHEMA}
    first = resolved_toml(load_case("pulley_edc")).splitlines()[0]
    assert first == "#:schema ../case.schema.json"
    line = first.removeprefix("#:schema ")
    assert (tmp_path / "runs" / "pulley_edc" / ".." / ".." / "runs" / line[3:]).resolve().is_file()


def test_a_new_case_has_its_schema_beside_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for words in ("export split_edc -o finger.xml", "new mine --finger finger.xml"):
        done = CliRunner().invoke(app, words.split())
        assert done.exit_code == 0, done.output
    text = (tmp_path / "mine" / "mine.toml").read_text(encoding="utf-8")
    assert text.startswith("#:schema case.schema.json\n")
    schema = json.loads((tmp_path / "mine" / "case.schema.json").read_text(encoding="utf-8"))
    assert schema == SCHEMAS["case"]
    assert faults("case", text) == []


def test_a_study_that_the_loader_refuses_is_refused_by_the_schema(tmp_path):
    text = 'case = "pulley_edc"\n[parameters.x]\nvalues = [1]\n[outputs]\nf = 3\n'
    path = tmp_path / "wrong.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="outputs"):
        read_file(path)
    assert faults("study", text) == [("outputs.f", "type")]
