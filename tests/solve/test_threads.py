"""Threads that share a session or a solver get what each would get alone."""

from __future__ import annotations

import asyncio
import gc
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import cosim
from cosim.case.schema import Case
from cosim.errors import ConvergenceError
from cosim.processes import one_blas_thread
from fe_solver.solver import linear_algebra
from fe_solver.solver.linear_algebra import FeralAnalysis, analyse, available
from tests.helpers.matrices import chain, slots_of


def pulls(name: str, count: int) -> list[Case]:
    case = cosim.load(name)
    return [case.replace({"tendons.EDC.tension": f"{i + 1} N"}) for i in range(count)]


def bits(result: cosim.Result) -> dict[str, bytes]:
    return {name: array.values.tobytes() for name, array in result.data.data_vars.items()}


@pytest.mark.parametrize(
    "name", ["pulley_edc", pytest.param("network_edc", marks=pytest.mark.slow)]
)
def test_threads_that_share_a_session_get_the_bits_of_each_alone(name):
    cases = pulls(name, 4)
    alone = [bits(cosim.run(case)) for case in cases]
    session = cosim.Session()
    with ThreadPoolExecutor(4) as threads:
        together = list(threads.map(lambda case: bits(cosim.run(case, session)), cases * 2))
    assert together == alone * 2


def test_a_shell_s_session_goes_from_thread_to_thread():
    """As a window, a notebook's executor or a web service hands it on."""
    case = cosim.load("base/one_sheet.toml").replace({"hood.mesh.quads": 120})
    cases = [case.replace({"tendons.EDC.tension": f"{n} N"}) for n in (1, 2)]
    session, results = cosim.Session(), []

    async def run_each_in_a_thread() -> None:
        for one in cases:
            results.append(bits(await asyncio.to_thread(cosim.run, one, session)))

    asyncio.run(run_each_in_a_thread())
    with ThreadPoolExecutor(1) as other:
        again = other.submit(lambda: bits(cosim.run(cases[1], session))).result()
    assert results == [bits(cosim.run(one)) for one in cases]
    assert again == results[1]


@pytest.mark.parametrize("backend", available())
def test_a_factor_serves_any_thread_and_may_end_in_any(backend):
    matrix = chain(1 + np.arange(60.0))
    factor = analyse(slots_of(matrix), backend).factor(matrix.data)
    right = np.sin(np.arange(60.0))
    expected = factor.solve(right)
    kept = [factor]
    del factor

    def solve_and_drop(_: int) -> np.ndarray:
        return np.asarray(kept[0].solve(right))

    with ThreadPoolExecutor(4) as threads:
        for found in threads.map(solve_and_drop, range(12)):
            assert found.tobytes() == expected.tobytes()
        threads.submit(lambda: (kept.clear(), gc.collect())).result()


def test_a_thread_s_solvers_go_with_their_analyses():
    matrix = chain(np.ones(60))
    linear_algebra._SOLVERS.drop()  # of analyses that ended in another thread
    before = len(linear_algebra._SOLVERS.kept)
    analysis = FeralAnalysis(slots_of(matrix))
    factor = analysis.factor(matrix.data)
    assert len(linear_algebra._SOLVERS.kept) == before + 1
    del analysis, factor
    gc.collect()
    assert len(linear_algebra._SOLVERS.kept) == before


def test_a_panic_of_the_linear_solver_is_an_error_of_ours(monkeypatch):
    panic = type("PanicException", (BaseException,), {"__module__": "pyo3_runtime"})
    matrix = chain(np.ones(60))
    analysis = FeralAnalysis(slots_of(matrix))
    solver = linear_algebra._SOLVERS.of(analysis)

    class Broken:
        def factor(self, *_: object) -> object:
            raise panic("index out of bounds")

    monkeypatch.setattr(solver, "feral", Broken())
    with pytest.raises(ConvergenceError, match=r"index out of bounds.*FE_SOLVER_LINEAR=superlu"):
        analysis.factor(matrix.data)


def test_blas_stays_limited_until_the_last_thread_has_ended():
    def threads_of_blas() -> list[int]:
        return [i["num_threads"] for i in threadpool_info() if i["user_api"] == "blas"]

    first, second = one_blas_thread(), one_blas_thread()
    with threadpool_limits(2, user_api="blas"):
        before = threads_of_blas()
        assert max(before) == 2
        first.__enter__()
        second.__enter__()
        first.__exit__(None, None, None)
        assert set(threads_of_blas()) == {1}
        second.__exit__(None, None, None)
        assert threads_of_blas() == before
