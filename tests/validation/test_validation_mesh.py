"""What other meshes change in the numbers of the validations: order, limit and uncertainty."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.results.compare import Comparison, Target
from cosim.validation.mesh import (
    FORMAL,
    RATIO,
    VERDICTS,
    MeshSeries,
    distinct,
    mesh_factors,
    mesh_series,
    mesh_versions,
    observe_order,
    tally,
)
from cosim.validation.run import Board, choose_groups
from cosim.validation.versions import Key

EDGES = np.array([RATIO, 1.0, 1 / RATIO])
"""Of the quads, from the coarsest mesh to the finest; the case's own in the middle."""


def row(model: float | None, quantity: str, unit: str, name: str = "") -> Comparison:
    target = Target(
        name or quantity, quantity, unit, 1.0, None, None, None, "a paper", "experiment", "run"
    )
    return Comparison(target, model)


def series_of(*meshes: list[Comparison]) -> dict[Key, MeshSeries]:
    """The series of rows on the own mesh, on a finer one, and on one before them."""
    own, *others = (Board("force", tuple(rows), {}) for rows in meshes)
    names = ["2.25", "0.444444"][: len(others)]
    return mesh_series([own], {name: [b] for name, b in zip(names, others, strict=True)})


def three(values: np.ndarray) -> MeshSeries:
    return MeshSeries(factors=mesh_factors(3), values=tuple(map(float, values)), bound=0.1)


@given(
    st.floats(0.6, FORMAL),
    st.floats(-5, 5),
    st.sampled_from([-1.0, 0.3, 2.0]),
)
def test_the_order_and_the_limit_of_a_power_of_the_edges_are_found(order, limit, slope):
    found = observe_order(list(limit + slope * EDGES**order), RATIO)
    assert found.why == ""
    assert found.order == pytest.approx(order, rel=1e-6)
    assert found.limit == pytest.approx(limit, abs=1e-6)


def test_an_order_beyond_that_of_the_elements_is_told_and_not_used():
    values = 1 + 0.1 * EDGES**4
    found = observe_order(list(values), RATIO)
    assert found.order == pytest.approx(4)
    assert found.limit == pytest.approx(values[2] - (values[1] - values[2]) / (RATIO**FORMAL - 1))


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ([1.1, 0.9, 1.05], "up and down"),
        ([1.0, 1.1, 1.3], "the more, the finer"),
        (1 + 0.1 * EDGES**0.3, "too slowly"),
        ([1.0, 1.0, 1.0], "hardly changes"),
        ([1.0, 1.0 + 1e-6, 1.0 - 1e-6], "hardly changes"),
    ],
)
def test_where_no_order_is_observed_it_is_said_why_and_the_range_counts_threefold(values, why):
    series = three(np.array(values))
    assert why in series.convergence.why
    assert series.error == pytest.approx(np.ptp(values))
    assert series.uncertainty == pytest.approx(1.5 * np.ptp(values))


def test_an_observed_order_gives_a_quarter_of_safety_on_the_own_mesh():
    series = three(2.0 + 0.09 * EDGES**2)
    assert series.own == pytest.approx(2.09)
    assert series.error == pytest.approx(0.09)
    assert series.index == pytest.approx(1.25 * 0.09)
    assert series.uncertainty == pytest.approx(0.625 * 0.09)


def test_a_mesh_without_a_result_leaves_no_order_and_is_named():
    series = MeshSeries(factors=mesh_factors(3), values=(1.1, 1.0, None), bound=0.2)
    assert series.convergence.order is None
    assert "2.2 times the quads" in series.convergence.why
    assert series.verdict == "no value"
    assert series.uncertainty == pytest.approx(1.5 * 0.1)


def test_three_meshes_stand_about_the_own_and_further_ones_are_finer():
    assert mesh_factors(2) == pytest.approx((1, 2.25))
    assert mesh_factors(3) == pytest.approx((1 / 2.25, 1, 2.25))
    assert mesh_factors(4) == pytest.approx((1 / 2.25, 1, 2.25, 2.25**2))


@pytest.mark.parametrize(
    ("unit", "model", "bound"),
    [("%", 5.0, 0.1), ("%", -0.01, 0.1), ("N", -3.0, 0.06), ("mm", 0.5, 0.01), ("1", 1.7, 0.034)],
)
def test_a_strain_may_be_off_by_a_tenth_of_a_point_and_a_number_by_a_fiftieth(unit, model, bound):
    for share, verdict in ((0.99, "within"), (-0.99, "within"), (1.01, "beyond")):
        (found,) = series_of(
            [row(model, "q", unit)], [row(model + share * bound, "q", unit)]
        ).values()
        assert found.bound == pytest.approx(bound)
        assert found.verdict == verdict
        assert found.error == pytest.approx(abs(share) * bound)


def test_a_component_is_held_to_its_force_and_an_angle_to_the_turn_of_such_a_change():
    force = {"distal": 0.0, "palmar": 3.0, "radial": -4.0}
    before = [row(v, f"force_N.{k}", "N") for k, v in force.items()]
    after = [row(v + 0.05, f"force_N.{k}", "N") for k, v in force.items()]
    found = series_of([*before, row(10.0, "a_deg", "deg")], [*after, row(11.0, "a_deg", "deg")])
    assert [s.bound for s in found.values()] == pytest.approx([0.1, 0.1, 0.1, np.degrees(0.02)])
    assert {s.verdict for s in found.values()} == {"within"}


def test_a_number_beside_two_references_counts_once_and_one_that_no_mesh_touches_not_at_all():
    twice = [row(1.0, "q", "N", "An"), row(1.0, "q", "N", "MyoHand")]
    other = [row(1.5, "q", "N", "An"), row(1.5, "q", "N", "MyoHand")]
    found = series_of([*twice, row(2.0, "r", "N")], [*other, row(2.0, "r", "N")])
    assert len(found) == 3
    assert [key[2:] for key, _ in distinct(found)] == [("An", "q")]
    assert found["force", "run", "r", "r"].uncertainty == 0
    assert series_of([row(None, "q", "N")], [row(1.0, "q", "N")]) == {}


def test_numbers_of_one_quantity_that_differ_are_all_told():
    """The one-way pass compares a tip force and what it has beyond another."""
    before = [row(1.5, "q", "N", "excess"), row(2.5, "q", "N", "force")]
    after = [row(1.6, "q", "N", "excess"), row(2.51, "q", "N", "force")]
    found = {key[2]: s.verdict for key, s in distinct(series_of(before, after))}
    assert found == {"excess": "beyond", "force": "within"}


def test_a_trial_that_failed_on_the_finer_mesh_has_no_value_and_the_misses_come_first():
    before = [row(1.0, name, "N") for name in ("a", "b", "c")]
    after = [row(1.001, "a", "N"), row(None, "b", "N"), row(2.0, "c", "N")]
    found = series_of(before, after)
    assert [s.verdict for _, s in distinct(found)] == list(VERDICTS)
    assert tally(found) == {"beyond": 1, "no value": 1, "within": 1}


def test_only_hoods_that_are_generated_are_laid_out_anew():
    (version,) = mesh_versions((1.0, 2.25), ["hood.mesh.quads=400"]).values()
    trials = {t.name: t for g in choose_groups(None) for t in g.trials if not t.study}
    meshed = version(trials["strain soft ti"])
    assert meshed.hood.generated_quads == 900
    (version,) = mesh_versions((1.0, 2.25)).values()
    for name in ("force split EDC", "middle_minorflex_fdp"):
        assert version(trials[name]).hood.generated_quads is None


def test_a_version_of_a_published_hood_or_an_experiment_of_several_runs_is_not_made():
    published = choose_groups("published hood soft", Path("mi29.feb"))
    assert all(t.is_published for g in published for t in g.trials)
