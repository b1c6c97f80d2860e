"""Targets, verdicts and their files."""

from __future__ import annotations

import json
from dataclasses import replace

import pint
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import InputError
from cosim.results import quantities
from cosim.results.compare import (
    VERDICTS,
    Comparison,
    Target,
    as_dict,
    compare_with_targets,
    difference,
    force_vectors,
    numbers_of,
    read_json,
    read_targets,
    tally,
    to_json,
    unit_of,
    value_of,
    verdict,
    write_json,
)
from tests.golden import read_golden

FORCE = Target(
    *("EDC force", "difference.fingertip_magnitude_N", "N", 0.46, 0.05, None, None),
    *("Trial A, table 1", "experiment"),
)

SUMMARY = {
    "fingertip_force_N": {"distal": 0.3, "radial": 0.0, "dorsal": 0.2},
    "strain_percent": {"lateral": {"min": -2.5}},
    "difference": {"fingertip_magnitude_N": 0.34},
    "converged": True,
    "case": "edc",
}
HEADER = "name, quantity, unit, reference, sd, low, high, source, kind, fitted, note\n"


def band(low, high, reference=None):
    return replace(FORCE, sd=None, low=low, high=high, reference=reference)


@pytest.mark.parametrize(
    ("target", "model", "expected", "gap"),
    [
        (FORCE, 0.5, "inside 1 SD", 0.04),
        (replace(FORCE, reference=1.0, sd=0.25), 1.25, "inside 1 SD", 0.25),
        (FORCE, 0.52, "outside", 0.06),
        (replace(FORCE, low=0.0, high=1.0), 0.9, "inside the band", 0.44),
        (replace(FORCE, low=0.0, high=1.0), 0.5, "inside 1 SD", 0.04),
        (replace(FORCE, low=0.0, high=1.0), 1.5, "outside", 1.04),
        (band(None, -8.0), -7.0, "outside", 1.0),
        (band(None, -8.0), -8.0, "inside the band", 0.0),
        (band(-5.0, 5.0), -6.5, "outside", -1.5),
        (band(2.0, None), 1e9, "inside the band", 0.0),
        (replace(FORCE, sd=None), 0.5, "nothing to judge by", 0.04),
        (FORCE, None, "no value", None),
    ],
)
def test_verdicts(target, model, expected, gap):
    assert verdict(target, model) == expected
    assert difference(target, model) == (None if gap is None else pytest.approx(gap))


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(0, 1e3), st.floats(0, 1e3))
def test_a_verdict_is_as_its_difference(model, reference, sd, width):
    target = replace(
        FORCE, reference=reference, sd=sd, low=reference - width, high=reference + width
    )
    said, gap = verdict(target, model), abs(model - reference)
    assert (said == "inside 1 SD") == (gap <= sd)
    assert (said == "outside") == (gap > sd and not target.low <= model <= target.high)


def test_values_are_found_by_path():
    assert value_of(SUMMARY, "fingertip_force_N.palmar") == -0.2
    assert value_of(SUMMARY, "fingertip_force_N.dorsal") == 0.2
    assert value_of(SUMMARY, "strain_percent.lateral.min") == -2.5
    for nothing in (
        *("fingertip_force_N.1", "fingertip_force_N.up", "strain_percent.lateral", "converged"),
        *("case", "absent.at_all", "difference.fingertip_magnitude_N.0"),
    ):
        assert value_of(SUMMARY, nothing) is None


@pytest.mark.parametrize(
    ("quantity", "unit"),
    [
        ("fingertip_force_N.distal", "N"),
        ("joint_torque_Nmm.hood.MCP", "N mm"),
        ("strain_percent.lateral.min", "%"),
        ("posture_deg.MCP_abduction", "deg"),
        ("last_rate_rad_per_s", "rad/s"),
        ("wall_s", "s"),
        ("step_control.shortest_half_ms", "ms"),
        ("audit.last_turn_rad", "rad"),
        ("air.EDC.command_V", "V"),
        ("air.EDC.pressure_kPa", "kPa"),
        ("audit.reciprocity", "1"),
    ],
)
def test_units_are_read_from_keys(quantity, unit):
    assert unit_of(quantity) == unit


def test_no_key_of_a_summary_ends_in_a_unit_that_is_not_told():
    """Of every number of golden.json and every path that a target may name."""
    registry = pint.UnitRegistry()
    paths = {q.path for q in quantities.QUANTITIES}
    paths.update(path for e in read_golden().values() for path in numbers_of(e["summary"]))
    for path in paths:
        unit = unit_of(path)
        assert registry.parse_units("" if unit == "1" else unit) is not None
        if unit == "1":
            ends = {key.rpartition("_")[2] for key in path.split(".") if "_" in key} - {"quads"}
            assert not [end for end in ends if end in registry], path


def test_a_case_is_compared_with_its_own_targets_alone():
    rows = compare_with_targets(
        (FORCE, replace(FORCE, case="other"), replace(FORCE, case="edc")), SUMMARY, "edc"
    )
    assert [row.target.case for row in rows] == ["", "edc"]
    assert rows[0].model == 0.34
    assert tally(rows) == {"outside": 2}


def test_requirements_are_counted_apart():
    rows = compare_with_targets((FORCE, replace(FORCE, kind="requirement")), SUMMARY, "edc")
    assert tally(rows) == {"outside": 1, "outside (requirement)": 1}


def test_a_unit_that_is_not_the_quantitys_is_refused():
    with pytest.raises(InputError, match="is in N, the row in mN"):
        compare_with_targets((replace(FORCE, unit="mN"),), SUMMARY, "edc")


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"source": " "}, "source is empty"),
        ({"kind": "rumour"}, "kind is 'rumour'"),
        ({"reference": None}, "neither a reference nor a band"),
        ({"sd": -0.1}, "sd must be 0 or more"),
        ({"reference": None, "low": 0.0}, "sd must be 0 or more, and have a reference"),
        ({"low": 2.0, "high": 1.0}, "ends .* below where it begins"),
    ],
)
def test_a_faulty_target_is_refused(change, match):
    with pytest.raises(InputError, match=match):
        replace(FORCE, **change)


def test_targets_are_read(tmp_path):
    file = tmp_path / "data.csv"
    file.write_text(
        "# Trial A; N\n" + HEADER + '"EDC, all", difference.fingertip_magnitude_N, N, 0.46, 0.05, '
        ', , "Trial A, table 1", experiment, yes, "tip clamped, no less"\n\n'
        "strain, strain_percent.lateral.min, %, , , , -8, B, inferred, ,\n",
        encoding="utf-8",
    )
    first, second = read_targets(file)
    assert first == replace(FORCE, name="EDC, all", fitted=True, note="tip clamped, no less")
    assert (second.low, second.high, second.fitted) == (None, -8.0, False)


@pytest.mark.parametrize(
    "text",
    [
        "quantity,value\nslip_force_N.central,1.5\nwall_s,2\n",
        "quantity;value\nslip_force_N.central;1,5\nwall_s;2\n",
        "quantity; reference; sd\nslip_force_N.central; 1.5; \nwall_s; 2.0;\n",
    ],
)
def test_a_quantity_and_a_value_are_enough(tmp_path, text):
    (tmp_path / "mine.csv").write_text(text, encoding="utf-8")
    first, second = read_targets(tmp_path / "mine.csv")
    assert (first.name, first.unit, first.reference) == ("slip_force_N.central", "N", 1.5)
    assert (first.source, first.kind, first.sd) == ("mine.csv", "experiment", None)
    assert (second.unit, second.reference) == ("s", 2.0)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("", "is empty"),
        ("name, unit\n", "expected the columns"),
        (HEADER.replace("note", "notes"), "expected the columns"),
        (HEADER + "a, b, N, one, , , , c, experiment, ,\n", "line 2: reference is 'one'"),
        (HEADER + "# so\na, , N, 1, , , , c, experiment, ,\n", "line 3: a: quantity is empty"),
        ("quantity, value, reference\nwall_s, 1, 1\n", "quantity and value .or reference."),
        (HEADER + "a, b, N, 1, , , , c, experiment, perhaps,\n", "fitted is 'perhaps'"),
    ],
)
def test_faulty_files_are_refused_with_their_place(tmp_path, text, match):
    (tmp_path / "data.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=match):
        read_targets(tmp_path / "data.csv")


def test_files_that_are_none_are_refused(tmp_path):
    for text in ("{", "[]", '{"format": "other", "rows": []}'):
        (tmp_path / "x.json").write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match="is no"):
            read_json(tmp_path / "x.json")


@given(
    st.lists(
        st.tuples(
            st.none() | st.floats(-1e6, 1e6),
            st.floats(-1e6, 1e6),
            st.none() | st.floats(0, 1e6),
            st.text(min_size=1).filter(str.strip),
            st.booleans(),
        ),
        max_size=5,
    )
)
def test_json_comes_back_as_it_was(tmp_path_factory, rows):
    made = tuple(
        Comparison(replace(FORCE, reference=reference, sd=sd, name=name, fitted=fitted), model)
        for model, reference, sd, name, fitted in rows
    )
    path = tmp_path_factory.mktemp("rows") / "comparison.json"
    write_json(path, made)
    assert read_json(path) == made
    assert path.read_text(encoding="utf-8") == to_json(made)


def test_a_verdict_in_a_file_is_not_believed(tmp_path):
    row = Comparison(FORCE, 9.0)
    text = to_json([row]).replace('"outside"', '"inside 1 SD"')
    (tmp_path / "comparison.json").write_text(text, encoding="utf-8")
    assert read_json(tmp_path / "comparison.json")[0].verdict == "outside"


def test_a_row_of_json_that_lacks_a_number_is_refused(tmp_path):
    content = json.loads(to_json([Comparison(FORCE, 0.5)]))
    del content["rows"][0]["sd"]
    (tmp_path / "comparison.json").write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(InputError, match="row 1: lacks one of"):
        read_json(tmp_path / "comparison.json")


def test_every_verdict_is_known():
    assert {as_dict(Comparison(FORCE, m))["verdict"] for m in (None, 0.46, 9.0)} <= set(VERDICTS)


def test_force_vectors_need_both_components():
    def row(axis, source="A", reference=0.2):
        target = replace(
            FORCE, quantity=f"fingertip_force_N.{axis}", source=source, reference=reference
        )
        return Comparison(target, 0.1)

    rows = [row("distal"), row("palmar", reference=0.4), row("distal", "B"), row("radial")]
    (vector,) = force_vectors(rows)
    assert (vector.reference, vector.sd, vector.model) == (
        *((0.2, -0.4), (0.05, 0.05), (0.1, -0.1)),
    )
    assert vector.label == "A"
