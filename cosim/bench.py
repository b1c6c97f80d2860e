"""How fast a coupled run is, against one assembly and one factorisation of its own tangent."""

from __future__ import annotations

from statistics import median
from time import perf_counter

from cosim.case_schema import Case
from cosim.port import InputError
from cosim.run import settled, solve

REPEATS = 5


def bench_case(case: Case) -> dict[str, float]:
    """Medians of `REPEATS`, all measured in this process, s, and their ratio.

    `warm_run_s`: the loaded equilibrium with its audit, once models and the unloaded state are
    there, as they are from the second case of a batch on; `cold_run_s`: models and both equilibria,
    with the bones' distances baked.  Raises InputError for a hood without a tangent."""
    models, states = solve(case)
    if models.linear is None:
        raise InputError(f"{case.name}: bench needs a shell hood")
    warm, linear, cold = [], [], []
    for _ in range(REPEATS):
        warm.append(_seconds(case))
        linear.append(models.linear(states.loaded.response.state))
    for _ in range(2):
        settled.cache_clear()
        cold.append(_seconds(case))
    assembly, factorisation = (median(column) for column in zip(*linear, strict=True))
    return {
        "warm_run_s": median(warm),
        "cold_run_s": min(cold),
        "assembly_s": assembly,
        "factorisation_s": factorisation,
        "ratio": median(warm) / (assembly + factorisation),
        "cold_ratio": min(cold) / (assembly + factorisation),
    }


def _seconds(case: Case) -> float:
    start = perf_counter()
    solve(case)
    return perf_counter() - start
