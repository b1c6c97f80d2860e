"""FEBio's formulas: of the time, in load controllers and in values; never run as code."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import InputError
from fe_solver.febio.read import read_feb
from fe_solver.febio.write import write_feb
from fe_solver.job.curves import FormulaCurve, Outside, ProductCurve
from fe_solver.job.expressions import Expression, split_formulas
from fe_solver.job.model import dead_loads
from tests.helpers.feb_files import Sections, change_section, read, same
from tests.helpers.febio_schema import faults

TIMES = (0.0, 0.3, 1.0, 2.5)


def controller(inner: str, kind: str = "math") -> Sections:
    """The file whose first load controller is a formula."""
    return change_section(
        "LoadData",
        '<load_controller id="1" type="loadcurve"><points><pt>0,0</pt><pt>1,1</pt></points>',
        f'<load_controller id="1" type="{kind}">{inner}',
    )


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("-t^2", lambda t: -(t**2)),
        ("2^-t + 3*(t - 1)/4", lambda t: 2**-t + 3 * (t - 1) / 4),
        ("0.5*sin(pi*t)", lambda t: 0.5 * math.sin(math.pi * t)),
        ("log(100) + ln(e^t)", lambda t: 2 + t),
        ("max(t, 1, min(2, t))*H(t-0.3)", lambda t: max(t, 1.0) * (0.5 if t == 0.3 else t > 0.3)),
        ("pow(abs(-t), 2) + step(t-1) + sgn(t)", lambda t: t**2 + (t >= 1) + (t > 0)),
        ("sqrt(t)*exp(-t)*tan(t)*cos(t)", lambda t: math.sqrt(t) * math.exp(-t) * math.sin(t)),
    ],
)
def test_formulas_are_arithmetic_as_febio_writes_it(text: str, value: object) -> None:
    for t in TIMES:
        assert FormulaCurve(text).at(t) == pytest.approx(value(t), abs=1e-12)  # type: ignore[operator]


@pytest.mark.parametrize(
    "text",
    [
        *(
            "__import__('os').getcwd()",
            "t.real",
            "(1).__class__",
            "lambda: 1",
            "[t]",
            "t if t else 1",
        ),
        *(
            "'a'*9",
            "True",
            "x",
            "open(t)",
            "sin(t, 1)",
            "max()",
            "sin()",
            "0x10",
            "1_0",
            "2j",
            "1e999",
        ),
        *(
            "t, 2",
            "",
            "(" * 400 + ")" * 400,
            "9" * 900,
            "t" * 1001,
            "\0",
            "t := 2",
            "f'{t}'",
            "t == 1",
        ),
    ],
)
def test_what_is_no_arithmetic_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="formula"):
        FormulaCurve(text)


@given(st.text("t0123456789.+-*/^(), einscoxap_'[]", max_size=40))
def test_any_text_has_a_finite_value_or_a_reason(text: str) -> None:
    try:
        assert math.isfinite(FormulaCurve(text).at(0.7))
    except InputError as error:
        assert "formula" in str(error)


def test_a_formula_without_a_value_says_when() -> None:
    with pytest.raises(InputError, match="no finite value at t = 0"):
        FormulaCurve("1/t").at(0.0)
    with pytest.raises(InputError, match="no finite value"):
        FormulaCurve("9^9^9^9").at(0.0)


def test_formulas_take_arrays() -> None:
    x = np.linspace(0, 1, 5)
    np.testing.assert_allclose(Expression("1 + X^2", ("X",)).value({"X": x}), 1 + x**2)
    assert split_formulas("0, max(t, 1) ,-t") == ["0", "max(t, 1)", "-t"]


def test_a_math_controller_is_a_curve(tmp_path: Path) -> None:
    job = read(tmp_path, controller("<math>t^2</math>"))
    (force,) = job.forces
    assert force.curve == FormulaCurve("t^2")
    for t in TIMES:
        assert job.pressures[0].pressure.at(t) == pytest.approx(0.02e6 * t**2)
        np.testing.assert_allclose(dead_loads(job, t)[-1], [0, 0, -3 * t**2])


def test_an_interval_of_a_math_controller(tmp_path: Path) -> None:
    inner = (
        "<interval>1,2</interval><left_extend>zero</left_extend><right_extend>repeat</right_extend>"
        "<math>t^2</math>"
    )
    curve = read(tmp_path, controller(inner, "math-interval")).forces[0].curve
    assert curve == FormulaCurve("t^2", (1.0, 2.0), Outside.ZERO, Outside.REPEAT)
    assert [curve.at(t) for t in (0.5, 1.5, 2.0, 2.5)] == [0.0, 2.25, 4.0, 2.25]
    assert FormulaCurve("t", (1.0, 2.0)).at(5.0) == 2.0
    with pytest.raises(InputError, match="interval must ascend"):
        FormulaCurve("t", (2.0, 1.0))


@pytest.mark.parametrize("kind", [' type="math"', ""])
def test_a_value_may_be_formulas_of_the_time(tmp_path: Path, kind: str) -> None:
    """Without a type, what is no number is a formula, as in FEBio; a load curve scales it."""
    old = '<value lc="1">0,0,-3</value>'
    plain = read(tmp_path, change_section("Loads", old, f"<value{kind}>1,2*3,-3*t</value>"))
    scaled = read(tmp_path, change_section("Loads", old, f'<value{kind} lc="1">1,0,-3*t</value>'))
    for t in (0.3, 1.0):
        np.testing.assert_allclose(dead_loads(plain, t)[-1], [1, 6, -3 * t])
        np.testing.assert_allclose(dead_loads(scaled, t)[-1], [t, 0, -3 * t * t])


def test_a_formula_of_numbers_is_a_constant(tmp_path: Path) -> None:
    job = read(tmp_path, change_section("Material", "<E>100</E>", '<E type="math">10^2</E>'))
    assert pytest.approx(100e6) == job.sheet.parts[0].law.E  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (change_section("Loads", "0,0,-3", "0,0,-3*u"), "'u' is not known; known here: t, pi"),
        (change_section("Loads", "0,0,-3", "0,-3*t"), "expected 3 numbers or formulas"),
        (
            change_section("Loads", '<value lc="1"', '<value type="map"'),
            "of type 'map' is not read",
        ),
        (controller("<math>a.b</math>"), "<LoadData/load_controller/math>"),
        (controller(""), "<math> is missing"),
        (
            change_section("Control", "<time_steps>4", "<time_steps>2*t"),
            "'t' is not known",
        ),
    ],
)
def test_formulas_are_refused_by_their_place(tmp_path: Path, change: Sections, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read(tmp_path, change)


def test_formulas_are_written_and_read_back(tmp_path: Path) -> None:
    job = read(tmp_path, controller("<interval>0,2</interval><math>t^2</math>", "math-interval"))
    write_feb(job, tmp_path / "again.feb")
    assert faults(tmp_path / "again.feb") == []
    same(read_feb(tmp_path / "again.feb").forces, job.forces)
    (force,) = job.forces
    assert force.curve is not None
    product = replace(force, curve=ProductCurve((force.curve, force.curve)))
    with pytest.raises(InputError, match="no load curve that is a product"):
        write_feb(replace(job, forces=(product,)), tmp_path / "again.feb")
