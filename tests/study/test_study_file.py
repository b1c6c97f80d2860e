"""The study file: what it makes of a case, and every fault told with its place."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.study.file import read_file
from cosim.study.plan import applicable_settings, read_plan
from tests.helpers.fixed_posture import HELD
from tests.helpers.folders import ROOT

OUTPUTS = '[outputs]\ntorque = "joint_torque_Nmm.passive.PIP"\n'
PIP = 'settings = ["finger.posture.PIP={value}"]\n'


@pytest.fixture
def made(tmp_path):
    """A study of the held finger with these lines."""
    (tmp_path / "held.toml").write_text(HELD, encoding="utf-8")

    def make(text: str, outputs: str = OUTPUTS) -> Path:
        file = tmp_path / "study.toml"
        file.write_text(f'case = "held.toml"\n{text}\n{outputs}', encoding="utf-8")
        return file

    return make


def test_the_file_in_the_guide_is_a_study(tmp_path):
    guide = (ROOT / "cosim" / "study" / "README.md").read_text(encoding="utf-8")
    (file := tmp_path / "s.toml").write_text(guide.split("```toml\n")[1].split("```")[0])
    assert read_plan(file).count > 1


def test_a_grid_walks_every_combination(made):
    plan = read_plan(
        made(
            f'[parameters.PIP]\nfrom = "20 deg"\nto = "40 deg"\ncount = 3\n{PIP}'
            '[parameters."tendons.EDC.tension"]\nvalues = ["1 N", "2 N"]'
        )
    )
    assert len(plan.points) == 6
    assert plan.points[3] == (30.0, 2.0)
    assert plan.settings_at(plan.points[3]) == (
        "finger.posture.PIP=30.0 deg",
        "tendons.EDC.tension=2.0 N",
    )


def test_what_a_point_sets_is_what_the_case_has(made):
    plan = read_plan(
        made(
            'sampling = { kind = "sobol", n = 4, seed = 1 }\n'
            '[parameters.k]\ndistribution = "normal"\nmean = "0.04 N*m/rad"\nsd = "0.001 N*m/rad"\n'
            'settings = ["finger.passive.PIP.stiffness={value}"]\n'
        )
    )
    for point in plan.points:
        case = load_case(plan.case, plan.settings_at(point))
        assert case.finger.passive["PIP"].stiffness == point[0]


def test_scale_multiplies_what_the_case_says(made):
    plan = read_plan(
        made(
            "[parameters.stiff]\nvalues = [0.5, 2.0]\n"
            'scale = ["finger.passive.*.stiffness", "tendons.*.max_force"]'
        )
    )
    base = load_case(plan.case)
    case = load_case(plan.case, plan.settings_at((2.0,)))
    for name, joint in base.finger.passive.items():
        assert case.finger.passive[name].stiffness == pytest.approx(2 * joint.stiffness)
    assert case.tendons["EDC"].max_force == pytest.approx(2 * base.tendons["EDC"].max_force)


def test_shift_adds_to_what_the_case_says_in_its_unit_and_not_below_the_least(made):
    plan = read_plan(
        made(
            '[parameters.turn]\nvalues = ["-50 deg", "2 deg"]\nleast = "0 deg"\n'
            'shift = ["finger.posture.PIP"]'
        )
    )
    base = load_case(plan.case).finger.posture.angles()["PIP"]
    angles = [
        load_case(plan.case, plan.settings_at(point)).finger.posture.angles()["PIP"]
        for point in plan.points
    ]
    assert angles == pytest.approx([0.0, base + np.radians(2.0)])


def test_two_parameters_of_one_number_act_one_after_the_other(made):
    key = "tendons.EDC.max_force"
    plan = read_plan(
        made(
            f'[parameters.twice]\nvalues = [2.0]\nscale = ["{key}"]\n'
            f'[parameters.more]\nvalues = ["3 N"]\nshift = ["{key}"]\n'
            f'[parameters.half]\nvalues = [0.5]\nscale = ["tendons.*.max_force"]'
        )
    )
    base = load_case(plan.case).tendons
    case = load_case(plan.case, plan.settings_at(plan.points[0])).tendons
    assert case["EDC"].max_force == pytest.approx((2 * base["EDC"].max_force + 3) / 2)
    assert case["EI"].max_force == pytest.approx(base["EI"].max_force / 2)


def test_of_a_case_that_lacks_some_the_other_parameters_count(made):
    plan = read_plan(
        made(
            '[parameters.turn]\nvalues = ["2 deg"]\nshift = ["finger.posture.PIP"]\n'
            '[parameters.stiff]\nvalues = [2.0]\nscale = ["tendons.*.max_force"]'
        )
    )
    (point,) = plan.points
    lone = {"finger": {"posture": {"PIP": "45 deg"}}}
    assert applicable_settings(plan.parameters, point, lone) == ('finger.posture.PIP="47.0 deg"',)
    with pytest.raises(InputError, match="no number at tendons"):
        replace(plan, base=lone).settings_at(point)


def test_words_go_as_they_are(made):
    plan = read_plan(made('[parameters."finger.tip.kind"]\nvalues = ["posture", "point"]'))
    assert plan.settings_at(plan.points[1]) == ("finger.tip.kind=point",)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("samplign = 1\n[parameters.a]\nvalues = [1]", "did you mean sampling"),
        ("[parameters.a]\nvalues = [1]\nsetings = []", "did you mean settings"),
        ("[parameters.a]\ndistribution = 'gamma'", "lognormal"),
        ("[parameters.a]\nfoo = 1", 'write distribution = "normal"'),
        ("[parameters.a]\nvalues = []", "needs at least 1"),
        ("[parameters.a]\nfrom = 1\nto = 2", "count: is missing"),
        ("[parameters.a]\nvalues = ['1 mm', '2 m']", "several units"),
        ("[parameters.a]\nvalues = [1]\nsettings = ['x=3']", "lacks ={value}"),
        ("[parameters.a]\nvalues = [1]\nscale = ['x']\nsettings = ['x={value}']", "both settings"),
        ("[parameters.a]\nvalues = ['1 mm']\nscale = ['x']", "plain number"),
        ("[parameters.a]\nvalues = ['x']\nshift = ['x']", "a number with its unit"),
        ("[parameters.a]\nvalues = [1]\nshift = ['x']\nscale = ['x']", "both scale and shift"),
        ("[parameters.a]\nvalues = [1]\nleast = 0\nscale = ['x']", "of shifted numbers"),
        ("[parameters.a]\ndistribution='uniform'\nlow=0\nhigh=1", "sampling: is missing"),
        ("[parameters.a]\ndistribution='uniform'\nlow=1\nhigh=0", "must be below high"),
        ("[parameters.a]\ndistribution='normal'\nmean=1\nsd='x'", "is no number"),
        ("[parameters.torque]\nvalues = [1]", "names a column twice"),
        ("[parameters.status]\nvalues = [1]", "names a column twice"),
        ("limits = { time = 3 }\n[parameters.a]\nvalues = [1]", "is a bare number"),
        (
            "sampling = { kind = 'sobol', n = 4, seed = 1 }\n[parameters.a]\nvalues = [1]",
            "leave it out",
        ),
    ],
)
def test_a_fault_says_what_to_write(made, text, words):
    with pytest.raises(InputError, match="fault") as error:
        read_file(made(text))
    assert words in str(error.value)


def test_every_fault_is_told_at_once(made):
    with pytest.raises(InputError) as error:
        read_file(made("notes = 3\n[parameters.a]\nvalues = []\n[parameters.b]\nfoo = 1", ""))
    text = str(error.value)
    assert all(part in text for part in ("notes = 3", "parameters.a.values", "parameters.b"))
    assert "outputs: is missing" in text
    assert "4 faults" in text


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[parameters.'finger.posture.PPI']\nvalues = ['1 deg']", "did you mean PIP"),
        ("[parameters.'finger.posture.PIP']\nvalues = ['1 mm']", "no unit of angle"),
        ("settings = ['finger.tip.kind=nose']\n[parameters.a]\nvalues = [1]", "case: "),
        ("[parameters.a]\nvalues = [1.5]\nscale = ['hood.nothing']", "no number at hood.nothing"),
        (
            "sampling = { kind = 'sobol', n = 5, seed = 1 }\n[parameters.a]\n"
            "distribution = 'uniform'\nlow = '1 deg'\nhigh = '2 deg'\n" + PIP,
            "power of 2",
        ),
        ("data = 'nothing.csv'\n[parameters.a]\nvalues = ['1 deg']\n" + PIP, "cannot be read"),
    ],
)
def test_a_study_that_the_case_does_not_take_fails_before_any_run(made, text, words):
    with pytest.raises(InputError) as error:
        read_plan(made(text))
    assert words in str(error.value)


PACKAGED = sorted(p.stem for p in (ROOT / "cases" / "studies").glob("*.toml"))


@pytest.mark.parametrize("name", PACKAGED)
def test_a_packaged_study_is_in_order(name):
    plan = read_plan(name)
    assert len(plan.points) in (6, 16, 42, 64, 500, 640)
    paths = set(plan.outputs.values())
    assert not plan.targets or paths & {t.quantity for t in plan.targets}


KEYS = st.sampled_from(
    "case settings parameters sampling outputs limits arrays values distribution mean from kind n "
    "seed time a b".split()
)
WORDS = st.sampled_from(
    ["normal", "uniform", "sobol", "1 mm", "held.toml", "x={value}", "", "1e999"]
)
VALUES = st.recursive(
    st.one_of(st.integers(), st.floats(), st.booleans(), WORDS),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(KEYS, inner, max_size=4)),
    max_leaves=8,
)


def toml(value: object) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k} = {toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else repr(value)


@settings(max_examples=150, deadline=None)
@given(st.dictionaries(KEYS, VALUES, max_size=6))
def test_no_file_ends_in_a_traceback(tmp_path_factory, values):
    file = tmp_path_factory.getbasetemp() / "any.toml"
    file.write_text("\n".join(f"{k} = {toml(v)}" for k, v in values.items()), encoding="utf-8")
    try:
        read_file(file)
    except InputError as error:
        assert "any.toml" in str(error)


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=80))
def test_no_bytes_end_in_a_traceback(tmp_path_factory, content):
    file = tmp_path_factory.getbasetemp() / "bytes.toml"
    file.write_bytes(content)
    with pytest.raises(InputError):
        read_file(file)


def test_settings_of_ones_own_come_on_top_of_the_file(made):
    file = made('[parameters."solve.max_iterations"]\nvalues = [20, 30]')
    plan = read_plan(file, own=('tendons.EDC.tension="7 N"',))
    assert plan.base["tendons"]["EDC"]["tension"] == "7 N"
    assert plan.settings_at(plan.points[0])[-2:] == (
        'tendons.EDC.tension="7 N"',
        "solve.max_iterations=20",
    )
    with pytest.raises(InputError, match="unknown key"):
        read_plan(file, own=("hood.zzz=1",))
