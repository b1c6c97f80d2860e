"""Values of a unit that counts in other units than SI."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.fmu.instance import Instance, LibraryFacts
from cosim.fmu.mapping import VariablePlace
from cosim.fmu.quantity import Quantity
from cosim.fmu.unit import Unit

MILLIMETRES = VariablePlace((1, 2), (2,), False, np.array([1e-3, 1e-3]), np.array([0.0, 0.5]))
KILONEWTONS = VariablePlace((3,), (1,), False, np.array([1e3]))


class Recorded:
    """A library that remembers what it is given, and answers three times the seeds."""

    def __init__(self) -> None:
        self.values: dict[int, float] = {}

    def setReal(self, references: Any, values: Any) -> None:
        self.values |= dict(zip(references, values, strict=True))

    def getReal(self, references: Any) -> list[float]:
        return [self.values[r] for r in references]

    def getDirectionalDerivative(self, unknown: Any, known: Any, seed: Any) -> list[float]:
        return [3.0 * sum(seed)] * len(unknown)


@pytest.fixture
def unit() -> Unit:
    made = object.__new__(Unit)
    made._instance = Instance(LibraryFacts("u", "", "", "u", is_fmi2=False))
    made._instance._fmu = Recorded()
    made._current, made._forgotten = None, []
    made.is_fmi2 = True
    made.opened = type("Opened", (), {"rolls_back": False, "path": Path("u.fmu")})()
    return made


def test_a_value_goes_in_and_comes_out_in_si(unit: Unit) -> None:
    unit.set(MILLIMETRES, np.array([0.02, 0.51]))
    assert unit._instance._fmu.values == pytest.approx({1: 20.0, 2: 10.0})
    assert unit.get(MILLIMETRES) == pytest.approx([0.02, 0.51])


def test_a_derivative_is_of_si_by_si(unit: Unit) -> None:
    """The unit says d(mm) / d(kN) = 3, which is 3e-6 m/N."""
    got = unit.derivative([MILLIMETRES], [KILONEWTONS], np.array([1.0]))
    assert got == pytest.approx([3e-6, 3e-6])


def test_entries_may_be_numbered() -> None:
    axes = (("body", ("one", "two")), ("axis", ("x", "y")))
    q = Quantity("force", "output", "N", "", axes)
    assert q.entries("r[{body_index},{axis_index}]") == ["r[1,1]", "r[1,2]", "r[2,1]", "r[2,2]"]
    assert q.entries("{body}.{axis_index}")[:2] == ["one.1", "one.2"]


def test_an_entry_of_another_body_or_source_is_found() -> None:
    axes = (("body", ("one", "two")), ("source", ("spring",)), ("axis", ("x", "y")))
    q = Quantity("force", "output", "N", "", axes)
    own = q.entries(q.template)
    others = ["force.one.contact.x", "force.three.spring.y"]
    unlike = ["force.one.spring.z", "moment.one.contact.x", "xforce.one.contact.x"]
    assert q.others(q.template, [*own, *others, *unlike]) == others
    assert q.others("F[{body_index},{source_index},{axis}]", ["F[1,1,x]", "F[3,1,y]"]) == [
        "F[3,1,y]"
    ]
