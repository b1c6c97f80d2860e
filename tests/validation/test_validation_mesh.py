"""What other meshes change in the numbers of the validations: order, limit and uncertainty."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.analyses.mesh_series import (
    FORMAL,
    VERDICTS,
    MeshSeries,
    mesh_factors,
    mesh_family,
    observe_order,
)
from cosim.results.compare import Comparison, Target
from cosim.validation.mesh import (
    distinct,
    finenesses,
    mesh_series,
    mesh_versions,
    tally,
)
from cosim.validation.run import Board, choose_groups
from cosim.validation.versions import Key

EDGES = np.array([2.0, 1.0, 2 / 3])
"""Of the quads, from the coarsest mesh to the finest; the case's own in the middle."""


def row(model: float | None, quantity: str, unit: str, name: str = "") -> Comparison:
    target = Target(
        name or quantity, quantity, unit, 1.0, None, None, None, "a paper", "experiment", "run"
    )
    return Comparison(target, model)


def series_of(*meshes: list[Comparison]) -> dict[Key, MeshSeries]:
    """The series of rows on the own mesh, and on finer ones."""
    own, *others = (Board("force", tuple(rows), {}) for rows in meshes)
    return mesh_series([own], {str(i): [b] for i, b in enumerate(others)})


def three(values: np.ndarray) -> MeshSeries:
    return MeshSeries(factors=mesh_factors(3, 2), values=tuple(map(float, values)), bound=0.1)


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("edges", [(1, 1 / 2, 1 / 3), (1 / 2, 1 / 3, 1 / 4), (1, 0.9, 0.3)])
def test_an_order_is_found_on_edges_of_unequal_ratios(order, edges):
    found = observe_order([0.23 - 0.01 * h**order for h in edges], edges)
    assert found.order == pytest.approx(order)
    if order <= FORMAL:
        assert found.limit == pytest.approx(0.23)


@given(
    st.floats(0.6, FORMAL),
    st.floats(-5, 5),
    st.sampled_from([-1.0, 0.3, 2.0]),
)
def test_the_order_and_the_limit_of_a_power_of_the_edges_are_found(order, limit, slope):
    found = observe_order(list(limit + slope * EDGES**order), EDGES)
    assert found.why == ""
    assert found.order == pytest.approx(order, rel=1e-6)
    assert found.limit == pytest.approx(limit, abs=1e-6)


def test_an_order_beyond_that_of_the_elements_is_told_and_not_used():
    values = 1 + 0.1 * EDGES**4
    found = observe_order(list(values), EDGES)
    assert found.order == pytest.approx(4)
    assert found.limit == pytest.approx(values[2] - (values[1] - values[2]) / (1.5**FORMAL - 1))


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
    series = MeshSeries(factors=mesh_factors(3, 2), values=(1.1, 1.0, None), bound=0.2)
    assert series.convergence.order is None
    assert "2.2 times the quads" in series.convergence.why
    assert series.verdict == "no value"
    assert series.uncertainty == pytest.approx(1.5 * 0.1)


def test_three_meshes_stand_about_the_own_and_further_ones_are_finer():
    assert mesh_factors(2, 2) == (1, 2.25)
    assert mesh_factors(3, 2) == (0.25, 1, 2.25)
    assert mesh_factors(3, 3) == pytest.approx((4 / 9, 1, 16 / 9))
    assert mesh_factors(4, 2) == (0.25, 1, 2.25, 4)


def test_the_coarsest_mesh_has_only_finer_ones_beside_it():
    assert mesh_family(3, 1) == (1, 2, 3)
    assert mesh_factors(3, 1) == (1, 4, 9)


@pytest.mark.parametrize(
    ("unit", "model", "bound"),
    [("%", 5.0, 0.2), ("%", -0.01, 0.2), ("N", -3.0, 0.03), ("mm", 0.5, 0.005), ("1", 1.7, 0.017)],
)
def test_a_strain_may_change_by_a_fifth_of_a_point_and_a_number_by_a_hundredth(unit, model, bound):
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
    after = [row(v + 0.04, f"force_N.{k}", "N") for k, v in force.items()]
    found = series_of([*before, row(10.0, "a_deg", "deg")], [*after, row(10.5, "a_deg", "deg")])
    assert [s.bound for s in found.values()] == pytest.approx([0.05, 0.05, 0.05, np.degrees(0.01)])
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
    before = [row(1.0, name, "N") for name in "abcd"]
    after = [row(v, n, "N") for n, v in zip("abcd", (1.001, None, 2.0, 1.2), strict=True)]
    finer = [row(v, n, "N") for n, v in zip("abcd", (1.002, 1.0, 2.5, 0.96), strict=True)]
    found = series_of(before, after, finer)
    assert [s.verdict for _, s in distinct(found)] == list(VERDICTS)
    assert tally(found) == dict.fromkeys(VERDICTS, 1)


def test_only_hoods_that_are_generated_are_laid_out_anew():
    coarse, fine = mesh_versions(3, ["hood.mesh.quads=400"]).values()
    groups = choose_groups(None)
    trials = {t.name: t for g in groups for t in g.trials if not t.study}
    meshed = [version(trials["strain soft ti"]) for version in (coarse, fine)]
    assert [case.hood.generated_quads for case in meshed] == [104, 936]
    assert finenesses(choose_groups("strain soft ti"), ["hood.mesh.quads=1000"]) == {
        "strain soft ti": 3
    }
    (version,) = mesh_versions(2).values()
    for name in ("force split EDC", "middle_minorflex_fdp"):
        assert version(trials[name]).hood.generated_quads is None


def test_a_version_of_a_published_hood_or_an_experiment_of_several_runs_is_not_made():
    published = choose_groups("published hood soft", Path("mi29.feb"))
    assert all(t.published for g in published for t in g.trials)
