"""The collection of measurements: one schema, no number typed twice, faults told in one message."""

from __future__ import annotations

import csv
import html
import re
import shutil
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from cosim.analyses.length_experiments import experiments
from cosim.analyses.moment_arms import published_arms
from cosim.cli import app
from cosim.errors import InputError
from cosim.measured import (
    COLUMNS,
    FOLDER,
    QUANTITIES,
    Measured,
    Source,
    all_measured,
    measured_at,
    measured_of_kind,
    not_measured,
    read_measured,
    read_source,
    sources,
    values_of,
)
from cosim.report.measured_page import source_rows
from cosim.results.compare import read_targets
from cosim.schema.units import is_unit
from cosim.text_tables import read_csv, read_toml
from cosim.validation.plan import data, groups
from cosim.validation.ratios import FLEXORS, INTRINSICS
from tests.helpers.folders import CASE_DATA

FAULTY = Source(
    source="smith2030", cited="Smith 2030", doi="", url="", licence="", seen="text", what="arms"
)
ROW = {
    **dict.fromkeys(COLUMNS, ""),
    **{"quantity": "arm.EDC.PIP", "unit": "mm", "value": "-4.1", "sd": "0.6", "n": "5"},
    **{"finger": "index", "posture": "30/45/15", "frame": "flexion positive"},
    **{"read": "printed: table 2", "evidence": "experiment"},
}


@pytest.mark.parametrize("source", sources())
def test_a_table_of_measurements_says_all_that_a_reader_must_know(source):
    text = (FOLDER / f"{source}.csv").read_text(encoding="utf-8")
    assert text.startswith("# "), "begins with words for people"
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    assert next(csv.reader(lines)) == list(COLUMNS)
    rows = read_measured(source)
    assert len(rows) == len(lines) - 1
    for m in rows:
        assert m.kind in QUANTITIES, m.quantity
        assert m.unit in ("1", "%") or is_unit(m.unit)
        assert m.address.count(":") <= 3


def test_an_address_names_one_number_unless_loads_or_fingers_tell_more_apart():
    every = all_measured()
    counts = Counter((m.cited.source, m.quantity, m.posture, m.hand) for m in every)
    apart = {
        m.cited.source for m in every if counts[m.cited.source, m.quantity, m.posture, m.hand] > 1
    }
    assert apart == {"synek2019", "ketchum1978", "dogadov2025", "chan2019", "munyebvu2024"}
    with pytest.raises(InputError, match="names 3 measured numbers"):
        measured_at("synek2019:metacarpal_load.FDP+FDS.proximal")


def test_kinds_are_named_with_units_that_a_case_knows():
    for name, kind in QUANTITIES.items():
        assert kind.unit in ("1", "%") or is_unit(kind.unit), name
        assert (kind.words and name == name.lower()) or name == "angle_to_EDC"


def test_the_hands_make_the_means_that_stand_beside_them():
    """To the thousandth of a newton in which both are written."""
    postures = {m.posture for m in measured_of_kind("fingertip_force")}
    for posture in postures:
        means = {k: v for k, v in values_of("synek2019", posture).items() if "tip_f" in k}
        assert len(means) == 24
        hands = [values_of("synek2019", posture, hand) for hand in ("H01", "H02", "H03")]
        for quantity, mean in means.items():
            each = [hand[quantity] for hand in hands if quantity in hand]
            if not each:  # a size, which is written as a mean alone
                axes = [quantity.replace("size", a) for a in ("distal", "radial", "palmar")]
                each = [float(np.linalg.norm([hand[a] for a in axes])) for hand in hands]
            assert np.mean(each) == pytest.approx(mean, abs=1e-3)
            sd = measured_at(f"synek2019:{quantity}:{posture}").sd
            assert np.std(each, ddof=1) == pytest.approx(sd, abs=1e-3)


def test_rows_of_a_kind_say_muscle_joint_axis_and_angles():
    arms = measured_of_kind("arm", finger="index")
    assert {m.cited.source for m in arms} == {"an1983", "ketchum1978"}
    assert {(m.muscle, m.joint, m.axis) for m in arms} >= {("FDP", "DIP", "")}
    force = measured_at("synek2019:fingertip_force.EDC.distal:40/55/35")
    assert (force.muscle, force.axis, force.angles) == ("EDC", "distal", (40, 55, 35))
    assert force.tension == 3.277
    everything = measured_of_kind("arm", measured=False)
    assert {m.evidence for m in everything} == {"experiment at second hand", "inferred"}


def written(folder: Path, row: dict[str, str], columns=COLUMNS) -> Path:
    """A file of a source with one row."""
    path = folder / "smith2030.csv"
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, columns, extrasaction="ignore")
        table.writeheader()
        table.writerow(row)
    return path


def test_a_file_of_ones_own_is_read(tmp_path):
    (m,) = read_source(written(tmp_path, ROW), FAULTY)
    assert (m.number(), m.sd, m.n, m.muscle, m.joint) == (-4.1, 0.6, 5, "EDC", "PIP")
    (other,) = read_source(written(tmp_path, ROW | {"quantity": "grip.x", "unit": "N"}), FAULTY)
    assert other.kind == "grip"
    assert other.of == {"part 1": "x"}


FAULTS = {
    "value": ["nan", "inf", "four", ""],
    "sd": ["0", "-1", "nan"],
    "low": ["nan", "x"],
    "n": ["0", "2.5", "many", ""],
    "unit": ["furlong", "", "N", "mm3"],
    "posture": ["30/45", "a/b/c", "30-45-15", "30/45/15/0"],
    "read": ["heard", ""],
    "evidence": ["rumour", "requirement", ""],
    "finger": ["thumbs"],
    "quantity": ["", "arm.EDC", "arm.EDC.knee", "arm..PIP", "arm.EDC.PIP.x", "4.arm"],
}


@given(st.sampled_from([(c, text) for c, texts in FAULTS.items() for text in texts]))
def test_a_fault_is_one_message_with_file_and_line(tmp_path_factory, fault):
    column, text = fault
    path = written(tmp_path_factory.mktemp("fault"), ROW | {column: text})
    with pytest.raises(InputError) as told:
        read_source(path, FAULTY)
    message = str(told.value)
    assert re.search(r"smith2030\.csv, line 2: ", message), message
    assert column in message
    assert "\n" not in message
    assert "validation error" not in message


@given(st.sampled_from(COLUMNS))
def test_a_column_that_is_missing_is_named(tmp_path_factory, column):
    columns = [c for c in COLUMNS if c != column]
    path = written(tmp_path_factory.mktemp("columns"), ROW, columns)
    with pytest.raises(InputError, match=f"line 1: has no column '{column}'"):
        read_source(path, FAULTY)


def test_an_address_that_names_nothing_says_what_is_near():
    with pytest.raises(InputError, match="did you mean 'slip_ratio'"):
        measured_at("lee2008:slip_rate")
    with pytest.raises(InputError, match="no source of the collection; did you mean 'lee2008'"):
        measured_at("lee2009:slip_ratio")


SUMMARY = {
    "joint_torque_Nmm": {
        what: {"MCP": 1.0, "PIP": 2.0, "DIP": 3.0} for what in ("passive", "holder")
    },
    "tension_N": {"EDC": 2.0},
    "unloaded": {
        "tension_N": {"EDC": 1.0},
        "moment_arm_mm": {m: {"MCP": 1.0} for m in (*INTRINSICS, *FLEXORS)},
    },
    "difference": {
        "fingertip_force_N": {"distal": 1.0, "radial": 2.0, "dorsal": 3.0},
        "slip_force_N": {"central": 2.0, "terminal": 3.0},
    },
}
"""What a run may say, for rows that are worked out of its numbers and measured ones."""


def references() -> dict[str, tuple[float | None, float | None, float | None]]:
    """Reference and band of every row of the boards that is said to be of an experiment."""
    found = {}
    for group in groups():
        targets = list(group.targets)
        for hand in group.hands.values():
            targets += hand
        if group.derived is not None:
            summaries = {t.name: SUMMARY for t in group.trials}
            targets += [row.target for row in group.derived(summaries)]
        for t in targets:
            if t.kind not in ("published model", "requirement"):
                found[f"{group.name}: {t.name}"] = (t.reference, t.low, t.high)
    return found


CACHES = (read_measured, all_measured, experiments, data)


@pytest.fixture
def before():
    """The references as they are."""
    return references()


@pytest.fixture
def doubled(before, monkeypatch):
    """The collection with every number two or three times as large."""

    def grown(m: Measured) -> Measured:
        factor = 3 if m.kind == "length" else 2  # forces by lengths and arms change too
        named = {c: getattr(m, c) for c in ("value", "sd", "low", "high")}
        return m.model_copy(update={c: factor * v for c, v in named.items() if v is not None})

    def read(path: Path, cited: Source) -> tuple[Measured, ...]:
        return tuple(map(grown, read_source(path, cited)))

    monkeypatch.setattr("cosim.measured.read_source", read)
    for of in CACHES:
        of.cache_clear()
    yield
    monkeypatch.undo()
    for of in CACHES:
        of.cache_clear()


def test_no_measured_number_of_the_boards_is_typed_in_the_program(before, doubled):
    """Each changes with the collection, but zeros and what is an assumption of our own."""
    after = references()
    assert after.keys() == before.keys()
    stay = [name for name, numbers in before.items() if after[name] == numbers and any(numbers)]
    ours = ("force lost as the IP joints flex", "movement of the terminal slip as the")
    assert len(before) > 300
    assert [name for name in stay if not any(words in name for words in ours)] == []


def test_the_files_that_targets_are_read_from_have_no_measured_number():
    """They name rows of the collection; numbers of their own are spreads and requirements."""
    for name in ("lee2008_slips", "lee2008_strain", "nimbarte2008_motion", "synek2019_specimens"):
        table = read_csv(CASE_DATA / f"{name}.csv", "quantity,measured")
        assert not {"reference", "value", "sd", "low", "high"} & set(table.columns)
        assert all(row.cells["measured"] for row in table.rows)
    for row in read_csv(CASE_DATA / "hood_fit_rows.csv", "quantity").rows:
        assert row.cells["measured"] or row.cells["kind"] == "requirement"


def test_a_target_takes_what_it_does_not_say_from_the_collection(tmp_path):
    path = tmp_path / "mine.csv"
    path.write_text("quantity,measured\nslip_ratio,lee2008:slip_ratio\n", encoding="utf-8")
    (target,) = read_targets(path)
    assert (target.reference, target.kind) == (1.7, "experiment at second hand")
    assert target.source == "Lee et al. 2008, J Biomech Eng 130:051014"
    for text, words in {
        "slip_ratio,lee2008:slip_rate": "line 2: measured: 'lee2008:slip_rate' names no measured",
        "slip_force_N.central,lee2008:slip_ratio": "slip_ratio is in 1, the row in N",
    }.items():
        path.write_text(f"quantity,measured\n{text}\n", encoding="utf-8")
        with pytest.raises(InputError, match=re.escape(words)):
            read_targets(path)


def test_what_nobody_measured_says_what_would_measure_it():
    gaps = not_measured()
    assert len({(gap.what, gap.of) for gap in gaps}) == len(gaps) > 30
    assert all(gap.needed and gap.stands_in and gap.known for gap in gaps)


def test_the_page_has_every_number_source_and_gap(tmp_path):
    page = tmp_path / "measured.html"
    done = CliRunner().invoke(app, ["list", "measured", "--html", str(page)])
    assert done.exit_code == 0, done.output
    assert page.stat().st_size < 1_000_000
    text = html.unescape(page.read_text(encoding="utf-8"))
    assert text.count("data-evidence=") == len(all_measured())
    assert all(source.cited in text for source in sources().values())
    assert all(gap.needed in text for gap in not_measured())
    assert not re.search(r">[^<]*\b(?:nan|None|MCP_abduction)\b[^<]*<", text)
    wrong = CliRunner().invoke(app, ["list", "cases", "--html", str(page)])
    assert (wrong.exit_code, "--html" in wrong.output) == (2, True)


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Iterator[Path]:
    """A copy of the collection, read in its place."""
    copy = Path(shutil.copytree(FOLDER, tmp_path / "measured"))
    monkeypatch.setattr("cosim.measured.FOLDER", copy)
    for of in (sources, *CACHES):
        of.cache_clear()
    yield copy
    monkeypatch.undo()
    for of in (sources, *CACHES):
        of.cache_clear()


def test_a_new_source_is_a_file_and_a_line(folder):
    written(folder, ROW)
    with (folder / "sources.csv").open("a", encoding="utf-8") as file:
        file.write("smith2030,Smith 2030,10.1234/x,,CC0,text,arms of a hood\n")
    page = folder.parent / "measured.html"
    for words in (["list", "measured"], ["list", "measured", "--html", str(page)]):
        assert CliRunner().invoke(app, words).exit_code == 0
    assert "Smith 2030" in page.read_text(encoding="utf-8")
    assert any(row[0] == "smith2030" for row in source_rows()[1])
    (m,) = (m for m in measured_of_kind("arm") if m.cited.source == "smith2030")
    assert (m.muscle, m.joint, m.angles, m.cited.text) == (
        *("EDC", "PIP", (30, 45, 15)),
        "Smith 2030, doi 10.1234/x",
    )
    known = published_arms("index")
    assert known[known.source == "Smith 2030"].arm_mm.tolist() == [-4.1]


def test_a_faulty_source_ends_the_list_with_one_message(folder):
    """A file without a line in the index, then one without a column."""
    written(folder, ROW, COLUMNS[1:])
    done = CliRunner().invoke(app, ["list", "measured"])
    assert done.exit_code == 2
    assert "has no line for smith2030.csv" in " ".join(done.output.split())
    with (folder / "sources.csv").open("a", encoding="utf-8") as file:
        file.write("smith2030,Smith 2030,,,,text,arms\n")
    done = CliRunner().invoke(app, ["list", "measured"])
    assert done.exit_code == 2
    assert "line 1: has no column 'quantity'" in " ".join(done.output.split())


BASES = ("bare", "free")


def test_what_models_take_of_the_collection_is_what_stands_there():
    """Moduli of a study, and the passive stiffness of the joints in the cases."""
    study = read_toml(CASE_DATA.parent / "studies" / "population_strain.toml")
    held = set()
    for parameter in study["parameters"].values():
        for setting in parameter.get("settings", ()):
            found = re.fullmatch(r"hood\.regions\.(\w+)\.modulus=\{value\}", setting)
            if found:
                region = re.sub(r"(.+(?:band))_(?:radial|ulnar)", r"\1", found[1])
                m = measured_at(f"qian2014:modulus.{region}")
                assert (parameter["mean"], parameter["sd"]) == (f"{m.value} MPa", f"{m.sd} MPa")
                held.add(region)
    assert len(held) == 7
    mcp = np.mean([m.number() for m in read_measured("mcp_stiffness")])
    bare, free = (read_toml(CASE_DATA.parent / "base" / f"{n}_finger.toml") for n in BASES)
    assert bare["finger"]["passive"]["MCP"]["stiffness"] == f"{mcp:.4f} N*m/rad"
    rest = measured_at("mcp_rest_angle:rest_angle.MCP").number()
    assert free["finger"]["posture"]["MCP"] == f"{rest:g} deg"
