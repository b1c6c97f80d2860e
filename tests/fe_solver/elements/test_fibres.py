"""Fibre directions at nodes and Gauss points."""

from __future__ import annotations

import numpy as np
import pytest

from fe_solver.elements.fibres import at_nodes, follow_mesh, smooth_fibres
from fe_solver.elements.kinds import kind_of
from fe_solver.elements.mitc4 import GAUSS, shape
from tests.proofs.fe import sheets


def ring(around: int):
    """A quarter ring, fibres along it at the elements' centres."""

    def bent(uv):
        radius, turn = 1 + uv[:, 1], np.pi / 2 * uv[:, 0]
        return np.column_stack([radius * np.cos(turn), radius * np.sin(turn), 0 * turn])

    X, quads = sheets.map_grid(around, 4, bent)
    centre = X[quads].mean(axis=1)
    return X, quads, np.cross([0.0, 0, 1], centre)


def worst_angle(around: int) -> float:
    X, quads, fibre = ring(around)
    signs = np.where(np.arange(len(quads)) % 2, -1.0, 1.0)
    seen = smooth_fibres(quads, fibre * signs[:, None])
    at = np.stack([np.einsum("a,nak->nk", shape(r, s)[0], X[quads]) for r, s in GAUSS], axis=1)
    exact = np.cross([0.0, 0, 1], at)
    exact /= np.linalg.norm(exact, axis=2, keepdims=True)
    return float(np.linalg.norm(np.cross(seen, exact), axis=2).max())


def test_a_uniform_field_stays_whatever_its_signs():
    _, quads, _ = ring(6)
    fibre = np.tile([0.6, 0.8, 0.0], (len(quads), 1))
    fibre[::3] *= -2.0
    expected = np.tile([0.6, 0.8, 0.0], (len(quads), 4, 1))
    assert np.abs(smooth_fibres(quads, fibre)) == pytest.approx(expected, abs=1e-12)


def test_a_turning_field_converges():
    """At the ends of the ring only one column of elements is known: first order."""
    coarse, fine = worst_angle(8), worst_angle(16)
    assert fine < 0.06
    assert np.log2(coarse / fine) == pytest.approx(1, abs=0.1)


def test_fibres_along_the_lines_of_a_quadratic_mesh_follow_them():
    """At the region's edges too: of second order, or exactly where the lines are straight."""
    assert lines_off(8, 0.0) < 0.3 * lines_off(4, 0.0) < 0.003
    assert lines_off(4, np.pi / 2) < 1e-12


def lines_off(around: int, lean: float) -> float:
    """By how much (rad) fibres around a quarter ring (lean 0) or out of it miss at Gauss points."""
    X, quads = sheets.with_nine_nodes(*sheets.plate(1.0, 1.0, around, 3))
    turn, radius = np.pi / 2 * X[:, 0], 1 + X[:, 1]
    X = np.column_stack([radius * np.sin(turn), radius * np.cos(turn), 0 * turn])
    element = kind_of(quads)
    middle, at = X[quads[:, 8]], [element.shape(r, s)[0] for r, s in element.gauss]
    place = np.einsum("ga,nak->ngk", np.array(at), X[quads])
    seen = follow_mesh(X, quads, spiral(middle, lean))
    seen /= np.linalg.norm(seen, axis=2, keepdims=True)
    return float(np.linalg.norm(np.cross(seen, spiral(place, lean)), axis=2).max())


def spiral(X, lean: float):
    """Unit directions at X (..., 3) that lean by `lean` (rad) from around to out."""
    out = X / np.linalg.norm(X, axis=-1, keepdims=True)
    return np.cos(lean) * np.cross(out, [0.0, 0, 1]) + np.sin(lean) * out


def test_regions_keep_their_own():
    _, quads, _ = ring(6)
    region = np.repeat(["a", "b"], len(quads) // 2)
    fibre = np.where((region == "a")[:, None], [1.0, 0, 0], [0, 1.0, 0])
    seen = smooth_fibres(quads, fibre, region)
    assert seen == pytest.approx(np.repeat(fibre[:, None], 4, axis=1), abs=1e-12)
    assert not np.allclose(smooth_fibres(quads, fibre), seen)


def test_a_node_without_elements_has_no_direction():
    nodal = at_nodes(np.array([[0, 1, 2, 3]]), np.array([[0.0, 2, 0]]), 5)
    assert nodal[:4] == pytest.approx(np.tile([0.0, 1, 0], (4, 1)))
    assert not nodal[4:].any()
