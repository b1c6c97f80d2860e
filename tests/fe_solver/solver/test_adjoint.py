"""Adjoint sensitivities against solving again."""

from __future__ import annotations

import numpy as np
import pytest

from fe_solver.solver.adjoint import (
    ExcursionOf,
    PositionOf,
    StrainOf,
    WrenchOf,
    modulus,
    sensitivities,
    slack,
    stiffness,
    thickness,
)
from fe_solver.solver.newton import Solution, solve
from tests.helpers import shells
from tests.helpers.straps import TENSION, TIGHT, strap


@pytest.fixture(scope="module")
def solved() -> Solution:
    model = strap()
    return solve(model, shells.at_rest(model), TENSION, TIGHT)


def scalars(solution: Solution) -> dict:
    rng, m = np.random.default_rng(2), solution.model
    return {
        "wrench": WrenchOf(rng.normal(size=(len(m.bodies), 6))),
        "excursion": ExcursionOf(np.array([1.0, -0.5])),
        "position": PositionOf(rng.normal(size=m.reference.shape)),
        "strain": StrainOf(rng.normal(size=(len(m.quads), 4, 8))),
    }


def changes(solution: Solution) -> dict:
    m = solution.model
    distal = m.reference[m.quads].mean(axis=1)[:, 0] > 0
    return {
        "modulus": modulus(m, distal),
        "thickness": thickness(m, distal),
        "stiffness": stiffness(m, 0),
        "slack": slack(m, 1),
    }


@pytest.mark.parametrize("name", ["wrench", "excursion", "position", "strain"])
def test_gradients_are_those_of_solving_again(solved, name):
    scalar = scalars(solved)[name]
    found = sensitivities(solved, scalar, changes(solved))
    for parameter, (change, _) in changes(solved).items():
        step = 1e-7 if parameter == "slack" else 1e-4
        values = []
        for part in (-1, 1):
            model = change(part * step)
            there = solve(model, solved.configuration, TENSION, TIGHT, near=True)
            values.append(scalar.value(model, there.configuration, there.evaluation, TENSION))
        again = (values[1] - values[0]) / (2 * step)
        assert found[parameter] == pytest.approx(again, rel=2e-5), parameter


def test_the_whole_sheets_modulus_is_its_parts(solved):
    m, scalar = solved.model, scalars(solved)["wrench"]
    every = np.ones(len(m.quads), dtype=bool)
    half = every & (np.arange(len(m.quads)) < 10)
    parts = {"one": modulus(m, half), "other": modulus(m, ~half), "all": modulus(m, every)}
    found = sensitivities(solved, scalar, parts)
    assert found["one"] + found["other"] == pytest.approx(found["all"], rel=1e-7)
