"""The published problems of the shell solver: each on a coarse mesh, and what they are made of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cosim.errors import ConvergenceError
from tests.helpers.rows import Row
from tests.proofs.fe.beams import rectangle_torsion, straight_beam
from tests.proofs.fe.benchmark import Benchmark, Meshes
from tests.proofs.fe.limit_loads import buckling_load
from tests.proofs.fe.membranes import hencky_deflection, triangle_elements
from tests.proofs.fe.paths import drive_node, largest
from tests.proofs.fe.sheets import (
    clamp,
    elements,
    grid,
    line_weights,
    linear_response,
    mirror_plane,
    plate,
    sheet,
    surface_weights,
)
from tests.proofs.fe.test_fe import BENCHMARKS

LOOSE = 0.35
"""Error on the coarsest mesh of what converges slowest."""
CASES = [
    pytest.param(b, nodes, id=f"{b.name}, {nodes} nodes")
    for benchmarks in BENCHMARKS.values()
    for b in benchmarks
    for nodes in b.meshes
]


@pytest.mark.parametrize(("benchmark", "nodes"), CASES)
def test_a_coarse_mesh_is_near(benchmark, nodes):
    """The coarsest; but of beams of one row of four-node elements, which lock, the next."""
    sizes = benchmark.meshes[nodes].sizes
    locks = nodes == 4 and "in plane" in benchmark.targets
    values = np.array(benchmark.solve(sizes[1 if locks else 0], nodes))
    assert values / list(benchmark.targets.values()) == pytest.approx(1, abs=LOOSE)


SQUARES = Benchmark(
    "a square",
    "of side 1",
    {"area": 1.0, "half": 0.5},
    "Euclid",
    lambda n, nodes: [1 + nodes / n**2, 0.5],
    {4: Meshes((2, 4, 8), 0.1, also={4: 0.5}), 9: Meshes((5, 10), 0.05)},
)


def test_a_benchmark_shows_the_coarsest_mesh_and_judges_the_finest():
    rows = list(SQUARES.rows())
    assert [row.quantity for row in rows[:3]] == ["area, 2 x 2", "area, 4 x 4", "area, 8 x 8"]
    assert [row.verdict for row in rows[:3]] == ["shown", "pass", "pass"]
    assert [row.order for row in rows[:3]] == [None, None, pytest.approx(2)]
    assert rows[2].source == "of side 1; Euclid"
    assert [row.verdict for row in rows if "nine" in row.name] == ["shown", "FAIL", "shown", "pass"]
    assert all(row.order is None for row in rows if "nine" in row.name)


def test_finer_meshes_are_one_step_further():
    finer = SQUARES.refine()
    assert finer.meshes[4] == Meshes((4, 8, 16), 0.1)
    assert replace(finer, meshes=SQUARES.meshes) == SQUARES


def test_a_row_that_is_only_shown_needs_a_number():
    row = Row("a", "b", 2.0, 3.0, 0.0, "c", "shown")
    assert (row.passed, row.verdict, row.error) == (True, "shown", 0.5)
    assert replace(row, computed=np.nan).verdict == "FAIL"


@pytest.mark.parametrize("nodes", [4, 9])
def test_consistent_loads(nodes):
    """They do the work of the load through what the elements represent: linear and quadratic."""
    uv, quads = elements(3, 2, nodes, shift=0.2)
    X = np.column_stack([uv * [3.0, 2.0], 0 * uv[:, 0]])
    s = X[uv[:, 0] == 1, 1]
    even, rising = line_weights(s, nodes), line_weights(s, nodes, lambda y: y)
    assert [even.sum(), even @ s, rising.sum()] == pytest.approx([2, 2, 2])
    if nodes == 9:
        assert [even @ s**2, rising @ s**2] == pytest.approx([8 / 3, 4])
    over = surface_weights(sheet(X, quads, 1.0, 0.0, 0.1))
    assert [over.sum(), over @ X[:, 0], over @ X[:, 1]] == pytest.approx([6, 9, 6])


def test_a_random_mesh_keeps_its_edges():
    regular, shifted = grid(4, 4)[0], elements(4, 4, 4, shift=0.25)[0]
    inside = ((regular > 0) & (regular < 1)).all(axis=1)
    assert np.array_equal(regular[~inside], shifted[~inside])
    assert 0.02 < np.abs(regular - shifted)[inside].max() <= 0.25 / 4


def test_the_beams_elements_have_their_shapes():
    x = {
        shape: straight_beam(shape, 1, 4)[0].reference.reshape(7, 2, 3)[1:3, :, 0]
        for shape in ("rectangles", "parallelograms", "trapezoids")
    }
    assert x["rectangles"] == pytest.approx(np.array([[1, 1], [2, 2]]))
    assert x["parallelograms"] == pytest.approx(np.array([[0.9, 1.1], [1.9, 2.1]]))
    assert x["trapezoids"] == pytest.approx(np.array([[1.1, 0.9], [1.9, 2.1]]))


def test_closed_forms():
    """Against figures of their sources: a square's torsion constant, Hencky's deflection."""
    assert rectangle_torsion(1.0, 1.0) == pytest.approx(0.1406, abs=5e-5)
    assert hencky_deflection(0.3) == pytest.approx(0.65344, abs=5e-6)


@pytest.mark.parametrize("nodes", [4, 9])
def test_a_triangle_of_quads_is_whole(nodes):
    at, quads = triangle_elements(2, nodes)
    assert at.sum(axis=1) == pytest.approx(1)
    assert len(np.unique(at.round(9), axis=0)) == len(at) == (61 if nodes == 9 else 19)
    X = np.column_stack([at[:, 1:], 0 * at[:, 0]])
    assert surface_weights(sheet(X, quads, 1.0, 0.0, 0.1)).sum() == pytest.approx(0.5)


def test_a_driven_node_needs_the_force_that_moves_it():
    """A strip whose tip is moved a little, against its deflection under a unit force."""
    X, quads = plate(10.0, 1.0, 8, 1)
    model = clamp(sheet(X, quads, 1.2e6, 0.0, 0.1), np.flatnonzero(X[:, 0] == 0))
    tip, up = int(np.flatnonzero(X[:, 0] == 10)[0]), np.array([0, 0, 1.0])
    load = np.zeros_like(X)
    load[tip, 2] = 1.0
    stiffness = 1 / linear_response(model, load)[0][tip, 2]
    held = np.zeros(X.shape, dtype=bool)
    held[tip, 2] = True
    forces, c = drive_node(mirror_plane(model, np.zeros_like(held), held), tip, up, [1e-3, 2e-3])
    assert forces == pytest.approx(stiffness * np.array([1e-3, 2e-3]), rel=1e-4)
    assert c.x[tip, 2] == pytest.approx(2e-3)


def test_a_load_that_does_not_buckle_says_so():
    """A strip that is pulled, and not bent."""
    X, quads = plate(10.0, 1.0, 4, 1)
    model = clamp(sheet(X, quads, 1.2e6, 0.0, 0.1), np.flatnonzero(X[:, 0] == 0))
    pull = np.outer(X[:, 0] == 10, [1.0, 0, 0])
    with pytest.raises(ConvergenceError, match="keeps its sign from 1 to 2"):
        buckling_load(model, pull, 1.0, 2.0)


def test_the_largest_load_of_a_path():
    x = np.arange(6.0)
    assert largest(3 - (x - 2.3) ** 2) == pytest.approx(3)
    with pytest.raises(ConvergenceError, match="no maximum"):
        largest(x)
