"""What a solve costs on ever finer meshes."""

from __future__ import annotations

import pytest

from tests.benches.growth import (
    CPU,
    EACH,
    OTHER,
    PARTS,
    SolveCost,
    fit_growth,
    measure_growth,
    measure_mesh,
    meshes_up_to,
)
from tests.benches.pulls import REST, MeasuredPull, Pull


def cost(unknowns: int, iterations: int, tendon: str = "EDC", failure: str = "") -> SolveCost:
    pull = Pull("isometric_edc", (), tendon, 3.5, 0)
    measured = MeasuredPull(pull, unknowns, iterations, 2 * iterations, unknowns**1.3, failure)
    parts = {"solution": unknowns**1.1, OTHER: 0.0}
    return SolveCost("linear", unknowns // 6, measured, parts, 100.0)


def test_a_mesh_is_as_large_as_its_nodes_are_many():
    sizes = {"linear": (250, 600, 1350), "quadratic": (180, 340)}
    assert meshes_up_to(720, sizes) == [("linear", 250), ("linear", 600), ("quadratic", 180)]


def test_exponents_are_fitted_to_the_solves_that_did_not_fail():
    costs = [cost(1000, 20), cost(1000, 80, ""), cost(4000, 22), cost(9000, 1, failure="stuck")]
    (growth,) = fit_growth(costs)
    assert (growth.state, growth.iterations, growth.solves) == ("EDC", 1.1, 1.1)
    assert growth.exponents == pytest.approx({CPU: 1.3, EACH: 1.3, "solution": 1.1}, abs=0.1)


def test_the_parts_of_a_solve_make_up_its_time():
    owners = {name: getattr(owner, attribute) for name, (owner, attribute) in PARTS.items()}
    costs = measure_mesh("linear", 120)
    assert [c.state for c in costs] == [REST, "EDC"]
    for c in costs:
        m = c.measured
        assert 0 < m.iterations <= m.solves
        assert sum(c.parts.values()) == pytest.approx(m.cpu_s)
        assert all(seconds > 0 for seconds in c.parts.values())
    assert owners == {name: getattr(owner, attribute) for name, (owner, attribute) in PARTS.items()}


@pytest.mark.slow
def test_each_mesh_is_solved_in_a_process_of_its_own():
    costs = list(measure_growth(120, sizes={"linear": (120, 250)}))
    assert [(c.quads, c.state) for c in costs] == [(120, REST), (120, "EDC")]
    assert all(c.peak_mb > 50 for c in costs)
