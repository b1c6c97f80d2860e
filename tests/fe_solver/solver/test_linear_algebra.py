"""Factors: one that stands for that of a matrix near its own, and what is left of one."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
import pytest
import scipy.sparse as sp

from cosim.errors import ConvergenceError
from cosim.stopwatch import stopwatch, timed
from fe_solver.solver.linear_algebra import (
    REDUCED,
    Analysis,
    Factor,
    Nearby,
    NotPositiveDefiniteError,
    analyse,
    available,
    has_mechanism,
)
from tests.helpers.matrices import chain, slots_of

SIZE = 60
RIGHT = np.sin(np.arange(1.0, SIZE + 1))


def factor_of(matrix: sp.csc_array, backend: str = "superlu") -> Factor:
    analysis: Analysis = analyse(slots_of(matrix), backend)
    return analysis.factor(matrix.data)


@pytest.fixture(scope="module")
def factor() -> Factor:
    return factor_of(chain(np.ones(SIZE)))


def test_its_own_matrix_is_solved_at_once(factor):
    matrix = chain(np.ones(SIZE))
    assert matrix @ factor.solve(RIGHT) == pytest.approx(RIGHT, abs=1e-10)
    assert matrix @ Nearby(matrix, factor).solve(RIGHT) == pytest.approx(RIGHT, abs=1e-10)


def test_a_matrix_nearby_is_solved_to_the_tolerance(factor):
    matrix = chain(1 + 0.4 * np.sin(np.arange(SIZE) ** 2))
    left = RIGHT - matrix @ Nearby(matrix, factor).solve(RIGHT)
    assert np.linalg.norm(left) <= REDUCED * np.linalg.norm(RIGHT)
    unhelped = RIGHT - matrix @ factor.solve(RIGHT)
    assert np.linalg.norm(unhelped) > 30 * REDUCED * np.linalg.norm(RIGHT)


def test_one_that_is_not_positive_definite_is_refused(factor):
    stiffness = np.ones(SIZE)
    stiffness[30] = -0.01
    with pytest.raises(NotPositiveDefiniteError, match="no stiffness"):
        Nearby(chain(stiffness), factor).solve(RIGHT)


def test_one_that_is_too_far_is_refused(factor):
    with pytest.raises(NotPositiveDefiniteError, match="left"):
        Nearby(chain(np.geomspace(1.0, 1e5, SIZE)), factor).solve(RIGHT)


@pytest.fixture(params=available())
def backend(request) -> str:
    return request.param


def arrow(signs: np.ndarray) -> sp.csc_array:
    """(n, n) a chain with so many of its pivots negative, bordered by a full row and column."""
    out = chain(signs).tolil()
    out[-1, :] = out[:, -1] = 0.1
    out[-1, -1] = 7.0
    return sp.csc_array(out.tocsc())


def test_an_indefinite_matrix_is_solved_for_one_side_and_for_many(backend):
    matrix = arrow(np.where(np.arange(SIZE) % 3, 1.0, -2.0))
    many = np.column_stack([RIGHT, np.cos(RIGHT), np.eye(SIZE)[:, :5]])
    factor = factor_of(matrix, backend)
    assert np.abs(matrix @ factor.solve(RIGHT) - RIGHT).max() < 1e-10
    assert np.abs(matrix @ factor.solve(many) - many).max() < 1e-10
    assert factor.solve(many).tobytes() == factor_of(matrix, backend).solve(many).tobytes()


def test_as_many_pivots_are_negative_as_eigenvalues(backend):
    for signs in (np.ones(SIZE), np.where(np.arange(SIZE) % 3, 1.0, -2.0)):
        matrix = arrow(signs)
        negative = int((np.linalg.eigvalsh(matrix.toarray()) < 0).sum())
        assert factor_of(matrix, backend).negative == negative


def test_an_earlier_factor_of_a_pattern_serves_after_a_later_one(backend):
    first, second = arrow(np.ones(SIZE)), arrow(np.linspace(1.0, 2.0, SIZE))
    slots = sp.csc_array(first, copy=True)
    slots.data[:] = np.arange(1.0, first.nnz + 1)
    analysis = analyse(slots, backend)
    factors = [analysis.factor(matrix.data) for matrix in (first, second)]
    for matrix, factor in [*zip((first, second), factors, strict=True), (first, factors[0])]:
        assert np.abs(matrix @ factor.solve(RIGHT) - RIGHT).max() < 1e-10


def test_pivots_are_counted_as_the_factor_is_made(backend):
    """Asked after a later factor of the pattern was made, it is not made again."""
    first, second = arrow(np.where(np.arange(SIZE) % 3, 1.0, -2.0)), arrow(np.ones(SIZE))
    analysis = analyse(slots_of(first), backend)
    with stopwatch() as watch, timed("factors"):
        early, late = (analysis.factor(matrix.data) for matrix in (first, second))
        assert early.negative > late.negative
    assert watch.parts["factors",].factorisations == 2


def test_a_matrix_without_stiffness_somewhere_is_refused(backend):
    stiffness = np.ones(SIZE)
    stiffness[0] = 0.0  # nothing holds the chain
    with pytest.raises(ConvergenceError, match="free to move"):
        factor_of(chain(stiffness), backend)


@pytest.mark.skipif(find_spec("pypardiso") is None, reason="PARDISO is not installed")
def test_pardiso_s_memory_goes_with_its_factor(monkeypatch):
    """MKL keeps what it is not told to free: a batch of runs would fill the memory."""
    from pypardiso.pardiso_wrapper import PyPardisoSolver

    freed, free = [], PyPardisoSolver.free_memory

    def told(solver, everything=False):
        freed.append(everything)
        free(solver, everything)

    monkeypatch.setattr(PyPardisoSolver, "free_memory", told)
    matrix = chain(np.ones(SIZE))
    factor = factor_of(matrix, "pardiso")
    assert matrix @ factor.solve(RIGHT) == pytest.approx(RIGHT, abs=1e-10)
    assert not freed
    del factor
    assert freed == [True]


@pytest.mark.parametrize(("stiffness", "free"), [(1e-12, False), (1e-15, True), (0.0, True)])
def test_a_mechanism_has_no_stiffness_beside_rounding_error(stiffness, free):
    """A part that is soft, and be it by a factor of 1e12, is held."""
    slots = sp.csc_array(np.diag([1.0, 2.0, 3.0]))
    assert has_mechanism(np.array([1.0, 2.0, stiffness]), slots) is free
