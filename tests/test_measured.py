"""The collection of measurements: one schema, no number typed twice, faults told in one message."""

from __future__ import annotations

import csv
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import InputError
from cosim.measured import (
    COLUMNS,
    FOLDER,
    QUANTITIES,
    Source,
    all_measured,
    measured_at,
    measured_of_kind,
    read_measured,
    read_source,
    sources,
    values_of,
)
from cosim.schema.units import is_unit

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
    assert apart == {"synek2019", "ketchum1978", "dogadov2025"}
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
