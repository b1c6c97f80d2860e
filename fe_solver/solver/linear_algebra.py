"""The sparse direct solvers, behind one small protocol: analyse a pattern once, factor often.

feral is installed with the program where it has a wheel, and SciPy's SuperLU is always there.
PARDISO (pypardiso) is taken where it is installed.  The first of `BACKENDS` that is there is used;
the environment variable FE_SOLVER_LINEAR names another choice.
"""

from __future__ import annotations

import os
import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from typing import Any, ClassVar, Protocol

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from cosim.errors import ConvergenceError, InputError
from cosim.extras import install_command
from cosim.port import Array, Ints
from cosim.stopwatch import count_factorisation

BACKENDS = {"pardiso": "pypardiso", "feral": "feral", "superlu": "scipy"}
"""Name and module, in the order in which they are taken.  Times of one factorisation over that of
SuperLU: PARDISO 0.3, feral 0.55."""
FASTER = {"pardiso": f"PARDISO (factorises in a third of the time): {install_command('pypardiso')}"}
VARIABLE = "FE_SOLVER_LINEAR"
MOST_PRODUCTS = 10
"""Iterations of conjugate gradients with a nearby factor; more cost what a factorisation does."""
REDUCED = 1e-3
"""Share of the right-hand side that such a solution may leave."""
RANK = 1e-13
"""Share of the largest pivot: a smaller pivot is none."""


class NotPositiveDefiniteError(ArithmeticError):
    """A symmetric matrix that conjugate gradients refuse."""


class Factor(Protocol):
    def solve(self, right: Array) -> Array:
        """Solution for right-hand sides (n,) or (n, m)."""
        ...

    @property
    def negative(self) -> int:
        """Negative pivots of a symmetric matrix: as many as it has negative eigenvalues."""
        ...


class Analysis(Protocol):
    """A pattern whose order and symbolic factor are known."""

    dear: ClassVar[bool]
    """Whether a factorisation takes longer than MOST_PRODUCTS solutions and products."""

    def factor(self, data: Array) -> Factor:
        """Numeric factor of the symmetric matrix whose entries are taken from `data`, definite or
        not.  Raises ConvergenceError for a singular one."""
        ...


def available() -> list[str]:
    """Names of the solvers that are installed, the fastest first."""
    return [name for name, module in BACKENDS.items() if find_spec(module)]


def backend_name() -> str:
    """The solver in use.  Raises InputError for a wish that cannot be met."""
    wish = os.environ.get(VARIABLE)
    if wish is None:
        return available()[0]
    if wish not in available():
        raise InputError(
            f"{VARIABLE}={wish}: no such solver here; installed are {', '.join(available())}"
        )
    return wish


def analyse(slots: sp.csc_array, backend: str | None = None) -> Analysis:
    """Return the symbolic analysis of a symmetric pattern, which makes factors.

    The entries of `slots`, a sparse matrix with the whole pattern, are 1 + their positions in the
    data that `Analysis.factor` takes; `backend` is the solver's name (that of `backend_name` where
    None).  Raises InputError for a solver that is not installed.

    >>> import numpy as np
    >>> import scipy.sparse as sp
    >>> from fe_solver.solver.linear_algebra import analyse
    >>> slots = sp.csc_array(np.array([[1, 2], [2, 3]]))  # data: a11, a12, a22
    >>> factor = analyse(slots, "superlu").factor(np.array([4.0, 1.0, 3.0]))
    >>> factor.solve(np.array([9.0, 5.0])).round(12)
    array([2., 1.])
    """
    backend = backend or backend_name()
    kinds: dict[str, Callable[[sp.csc_array], Analysis]] = {
        "feral": FeralAnalysis,
        "pardiso": PardisoAnalysis,
        "superlu": SuperLUAnalysis,
    }
    return kinds[backend](slots)


@dataclass(frozen=True)
class Nearby:
    """A symmetric matrix and the factor of one near it, which stands for its own: conjugate
    gradients preconditioned by it."""

    matrix: sp.csc_array
    factor: Factor

    @property
    def negative(self) -> int:
        """That of the factor; `solve` refuses a matrix that it finds to have more."""
        return self.factor.negative

    def solve(self, right: Array) -> Array:
        """Solution for one right-hand side (n,), to REDUCED of it.

        Raises NotPositiveDefiniteError where the matrix is not, and where it is too far from the
        factor's."""
        out, left, limit = np.zeros_like(right), right, REDUCED * np.linalg.norm(right)
        way, last_fall = out, 1.0
        for _ in range(MOST_PRODUCTS):
            rest = self.factor.solve(left)
            fall = float(left @ rest)
            way = rest + fall / last_fall * way
            bent = self.matrix @ way
            curvature = float(way @ bent)
            if not curvature > 0:
                raise NotPositiveDefiniteError("a direction of no stiffness, or of less")
            out = out + fall / curvature * way
            left = left - fall / curvature * bent
            if np.linalg.norm(left) <= limit:
                return out
            last_fall = fall
        raise NotPositiveDefiniteError(f"left {np.linalg.norm(left):.1e} after {MOST_PRODUCTS}")


def has_mechanism(data: Array, slots: sp.csc_array) -> bool:
    """Whether the matrix has a direction without stiffness, beside rounding error."""
    try:
        factor = SuperLUAnalysis(slots).lu(data)
    except ConvergenceError:
        return True
    pivots = np.abs(factor.U.diagonal())
    return bool(pivots.min() < RANK * pivots.max())


def positions(matrix: sp.csc_array | sp.csr_array) -> Ints:
    """Positions of a pattern's entries in the data that they are taken from."""
    return matrix.data.astype(np.intp) - 1


FREE = (
    "some part of the shell is free to move. Tie or guide its nodes, or give it springs that are "
    "not slack."
)


def _singular(error: Exception | str) -> ConvergenceError:
    return ConvergenceError(f"the tangent stiffness cannot be factorised ({error}): {FREE}")


@dataclass(frozen=True)
class SuperLUAnalysis:
    """Minimum-degree order found once; symmetric and unsymmetric values alike."""

    dear: ClassVar[bool] = True
    slots: sp.csc_array

    @cached_property
    def _ordering(self) -> tuple[Ints, sp.csc_array, Ints]:
        regular = sp.csc_array(self.slots, copy=True)
        regular.data[:] = 1.0
        regular = sp.csc_array(regular + sp.diags_array(np.full(self.slots.shape[0], 1e3)))
        lu = _splu(regular, "MMD_AT_PLUS_A")
        order = np.argsort(lu.perm_c)
        ordered = sp.csc_array(self.slots[order][:, order])
        ordered.sort_indices()
        return order, ordered, positions(ordered)

    def factor(self, data: Array) -> Factor:
        """The numeric factor of the matrix with entries from `data`."""
        return _OrderedLU(self.lu(data), self._ordering[0])

    def lu(self, data: Array) -> spla.SuperLU:
        """In the order found.  Raises ConvergenceError for an exactly singular matrix."""
        count_factorisation()
        _, pattern, slots = self._ordering
        matrix = sp.csc_array((data[slots], pattern.indices, pattern.indptr), shape=pattern.shape)
        try:
            return _splu(matrix, "NATURAL")
        except RuntimeError as error:
            raise _singular(error) from error


def _splu(matrix: sp.csc_array, order: str) -> spla.SuperLU:
    return spla.splu(
        matrix, permc_spec=order, diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )


@dataclass(frozen=True)
class _OrderedLU:
    lu: spla.SuperLU
    order: Ints

    def solve(self, right: Array) -> Array:
        out = np.empty_like(right)
        out[self.order] = self.lu.solve(np.ascontiguousarray(right[self.order]))
        return out

    @property
    def negative(self) -> int:
        return int((self.lu.U.diagonal() < 0).sum())


class _ThreadSolvers(threading.local):
    """The solvers of a thread by the analysis that they serve: each is made, used and dropped in
    one thread, as feral's must be."""

    def __init__(self) -> None:
        self.kept: dict[int, tuple[weakref.ref[_OneFactorAnalysis], Any]] = {}

    def of(self, analysis: _OneFactorAnalysis) -> Any:
        """This thread's solver of an analysis, made where there is none."""
        ref, solver = self.kept.get(id(analysis), (None, None))
        if ref is None or ref() is not analysis:
            self.drop()  # what ended in another thread told that thread alone
            ref, solver = weakref.ref(analysis, lambda _: self.drop()), analysis.make_solver()
            self.kept[id(analysis)] = ref, solver
        return solver

    def drop(self) -> None:
        """Leave out the solvers of this thread whose analyses are gone."""
        self.kept = {key: pair for key, pair in self.kept.items() if pair[0]() is not None}


_SOLVERS = _ThreadSolvers()


class _OneFactorSolver(Protocol):
    """A solver of one pattern that keeps one numeric factor at a time."""

    held: weakref.ref[_KeptFactor] | None

    def factorise(self, data: Array) -> int:
        """Make the numeric factor that the solver keeps, and return how many negative pivots it
        has.  Raises ConvergenceError for a singular matrix."""
        ...

    def solve(self, right: Array) -> Array:
        """Solution for right-hand sides (n,) or (n, m) by the factor that the solver keeps."""
        ...


@dataclass(eq=False)
class _OneFactorAnalysis:
    """A pattern in a solver that keeps one numeric factor at a time: an earlier one is made again
    when it is used again.  Each thread that uses the analysis has a solver of its own."""

    slots: sp.csc_array

    def factor(self, data: Array) -> Factor:
        """The numeric factor of the matrix with entries from `data`."""
        made = _KeptFactor(self, data)
        made.solver()
        return made

    def make_solver(self) -> _OneFactorSolver:
        """A solver of the pattern."""
        raise NotImplementedError


@dataclass(eq=False)
class _KeptFactor:
    analysis: _OneFactorAnalysis
    data: Array
    negative: int = 0
    """Negative pivots, which are as many as negative eigenvalues; counted as the factor is made."""

    def solver(self) -> _OneFactorSolver:
        """This thread's solver, with this as the factor that it keeps."""
        solver: _OneFactorSolver = _SOLVERS.of(self.analysis)
        if solver.held is None or solver.held() is not self:
            solver.held = None
            count_factorisation()
            self.negative = solver.factorise(self.data)
            solver.held = weakref.ref(self)
        return solver

    def solve(self, right: Array) -> Array:
        """Solution for right-hand sides (n,) or (n, m)."""
        return self.solver().solve(right)


class FeralAnalysis(_OneFactorAnalysis):
    """Symmetric indefinite L D L' of feral, which is written in Rust and has one thread here."""

    dear: ClassVar[bool] = True

    def make_solver(self) -> _FeralSolver:
        """As the base class says."""
        return _FeralSolver(self.slots)


class _FeralSolver:
    def __init__(self, slots: sp.csc_array) -> None:
        import feral

        lower = sp.csc_array(sp.tril(slots, format="csc"))
        lower.sort_indices()
        n = slots.shape[0]
        rows = lower.indices.astype(np.int64)
        columns = np.repeat(np.arange(n), np.diff(lower.indptr))
        self.slots = positions(lower)
        self.matrix = feral.CscMatrix.from_triplet(n, rows, columns, np.ones(lower.nnz))
        self.feral = feral.Solver(parallel=False, scaling="auto")
        self.held: weakref.ref[_KeptFactor] | None = None

    def factorise(self, data: Array) -> int:
        """As the protocol says."""
        import feral

        try:
            with _no_panic():
                status, inertia = self.feral.factor(self.matrix.set_values(data[self.slots]))
        except feral.FeralError as error:
            raise _singular(error) from error
        if status != feral.FactorStatus.SUCCESS or inertia.n_zero:
            raise _singular(f"{inertia.n_zero} of its pivots are zero")
        return int(inertia.n_neg)

    def solve(self, right: Array) -> Array:
        """As the protocol says."""
        with _no_panic():
            found = np.asarray(self.feral.solve(np.ascontiguousarray(right)))
            return found.reshape(right.shape)  # of no unknowns, it gives no columns either


@contextmanager
def _no_panic() -> Iterator[None]:
    """A panic of Rust, which no `except Exception` catches, as an error of ours."""
    try:
        yield
    except BaseException as error:
        if type(error).__module__ != "pyo3_runtime":
            raise
        raise ConvergenceError(
            f"the linear solver feral broke down ({error}); set {VARIABLE}=superlu to take another"
        ) from error


class PardisoAnalysis(_OneFactorAnalysis):
    """Symmetric indefinite L D L' of MKL (matrix type -2)."""

    dear: ClassVar[bool] = False

    def make_solver(self) -> _PardisoSolver:
        """As the base class says."""
        return _PardisoSolver(self.slots)


class _PardisoSolver:
    def __init__(self, slots: sp.csc_array) -> None:
        os.environ.setdefault("MKL_CBWR", "AUTO")  # the same bits for any number of threads
        from pypardiso.pardiso_wrapper import PyPardisoSolver

        self.upper = sp.csr_matrix(sp.triu(slots, format="csr"))
        self.upper.sort_indices()
        self.slots = positions(self.upper)
        self.pardiso = PyPardisoSolver(mtype=-2)
        # or each searches the disk
        os.environ.setdefault("PYPARDISO_MKL_RT", self.pardiso.libmkl._name)
        self.upper.data = np.ones(len(self.slots))
        _phase(self.pardiso, 11, self.upper, np.zeros(self.upper.shape[0]))
        weakref.finalize(self, self.pardiso.free_memory, everything=True).atexit = False
        self.held: weakref.ref[_KeptFactor] | None = None

    def factorise(self, data: Array) -> int:
        """As the protocol says."""
        self.upper.data = data[self.slots]
        _phase(self.pardiso, 22, self.upper, np.zeros(self.upper.shape[0]))
        return int(self.pardiso.get_iparm(23))

    def solve(self, right: Array) -> Array:
        """As the protocol says."""
        return _phase(self.pardiso, 33, self.upper, np.asfortranarray(right))


def _phase(solver: Any, phase: int, matrix: sp.csr_matrix, right: Array) -> Array:
    """One phase of PARDISO (11 analysis, 22 factorisation, 33 solution)."""
    from pypardiso.pardiso_wrapper import PyPardisoError

    solver.set_phase(phase)
    try:
        return np.asarray(solver._call_pardiso(matrix, right))
    except PyPardisoError as error:
        raise _singular(str(error)) from error
