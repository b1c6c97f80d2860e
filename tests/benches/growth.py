"""How the cost of a solve grows with the mesh: one hood goes to rest, then one tendon is pulled.

Each mesh is solved in a process of its own, so that its peak memory is its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import wraps
from time import process_time
from typing import Any, NamedTuple

import numpy as np

from cosim.errors import InputError, Progress, quiet
from cosim.processes import Memory, ProcessEndedError, process_pool
from fe_solver.solver import model
from fe_solver.solver.assembly import Pattern
from tests.benches.pulls import (
    REST,
    CountingAnalysis,
    CountingFactor,
    MeasuredPull,
    Pull,
    measure_pulls,
    read_pulls,
)
from tests.proofs.fe.json_command import peak_mb

CASE, TENDON = "isometric_edc", "EDC"
QUADS = {
    "linear": (250, 600, 1350, 2400, 5000, 9000, 16000),
    "quadratic": (180, 340, 600, 1250, 2250, 4000),
}
"""About so many quads of the meshes, by their elements."""
NODES = {"linear": 1, "quadratic": 4}
"""Nodes for each quad of a large mesh."""
WARM = 120
"""Quads of the mesh that loads the program and its kernels, before anything is measured."""
PARTS = {
    "response": (model, "element_response"),
    "blocks": (model, "element_blocks"),
    "assembly": (Pattern, "assemble"),
    "factorisation": (CountingAnalysis, "factor"),
    "solution": (CountingFactor, "solve"),
    "contact": (model, "contact_forces"),
}
"""Where the functions are whose time is measured, by the names of the parts of a solve; none calls
another one.  The first factorisation includes the symbolic analysis."""
OTHER = "other"
CPU, EACH = "CPU time", "CPU time of one linear solve"


class SolveCost(NamedTuple):
    """What one solve took on one mesh: going to rest, or the pull from there."""

    elements: str
    quads: int
    """About."""
    measured: MeasuredPull
    parts: Mapping[str, float]
    """CPU time of each of PARTS and of all OTHER work, s."""
    peak_mb: float
    """Peak memory of the process so far, MB."""

    @property
    def state(self) -> str:
        """REST, or the tendon that is pulled."""
        return self.measured.pull.tendon or REST


class Growth(NamedTuple):
    """How the cost of one solve grows from the coarsest mesh to the finest.

    `iterations` and `solves` are those of the finest mesh over those of the coarsest; `exponents`
    are the p of fits t ~ N^p in the number N of unknowns: of the CPU time (CPU), of that for one
    linear solve (EACH), and of each part's for one linear solve."""

    elements: str
    state: str
    iterations: float
    solves: float
    exponents: Mapping[str, float]


def measure_growth(
    most: int, progress: Progress = quiet, sizes: Mapping[str, Sequence[int]] = QUADS
) -> Iterator[SolveCost]:
    """Solve on each mesh with no more nodes than one of `most` linear quads.

    Raises InputError where a mesh needs more memory than there is."""
    for elements, quads in meshes_up_to(most, sizes):
        progress(f"{quads} quads, {elements}")
        try:
            with process_pool(1, apart=True) as pool:
                yield from pool.submit(0, _measure_mesh, elements, quads).result()
        except ProcessEndedError:
            raise InputError(
                f"the process that solved {quads} {elements} quads was ended from outside, "
                f"perhaps for lack of memory; choose a smaller --most"
            ) from None


def meshes_up_to(most: int, sizes: Mapping[str, Sequence[int]] = QUADS) -> list[tuple[str, int]]:
    """Elements and quads of the meshes with no more nodes than one of `most` linear quads."""
    return [
        (elements, n)
        for elements, quads in sizes.items()
        for n in quads
        if n * NODES[elements] <= most
    ]


def _measure_mesh(_: Memory, elements: str, quads: int) -> list[SolveCost]:
    return measure_mesh(elements, quads)


def measure_mesh(elements: str, quads: int) -> list[SolveCost]:
    """The costs of going to rest and of the pull; of the first alone where that fails."""
    list(measure_pulls(_pulls(elements, WARM)))
    costs = []
    with _clocks() as spent:
        for measured in measure_pulls(_pulls(elements, quads)):
            parts = spent | {OTHER: measured.cpu_s - sum(spent.values())}
            costs.append(SolveCost(elements, quads, measured, parts, peak_mb()))
            spent.update(dict.fromkeys(PARTS, 0.0))
    return costs


@contextmanager
def _clocks() -> Iterator[dict[str, float]]:
    """The CPU time (s) that the functions of PARTS take within the block, by their names."""
    spent = dict.fromkeys(PARTS, 0.0)
    with ExitStack() as undo:
        for name, (owner, attribute) in PARTS.items():
            function = getattr(owner, attribute)
            setattr(owner, attribute, _timed(function, name, spent))
            undo.callback(setattr, owner, attribute, function)
        yield spent


def _timed(function: Callable[..., Any], name: str, spent: dict[str, float]) -> Callable[..., Any]:
    @wraps(function)
    def timed(*args: Any, **options: Any) -> Any:
        start = process_time()
        try:
            return function(*args, **options)
        finally:
            spent[name] += process_time() - start

    return timed


def _pulls(elements: str, quads: int) -> list[Pull]:
    settings = f"hood.mesh.elements={elements}", f"hood.mesh.quads={quads}"
    return [
        pull._replace(settings=settings)
        for pull in read_pulls()
        if pull.case == CASE and not pull.settings and pull.tendon in ("", TENDON)
    ]


def fit_growth(costs: Sequence[SolveCost]) -> list[Growth]:
    """The growth of each solve over the meshes on which it did not fail, if there are two."""
    solves: dict[tuple[str, str], list[SolveCost]] = {}
    for cost in costs:
        if not cost.measured.failure:
            solves.setdefault((cost.elements, cost.state), []).append(cost)
    return [_fit(*key, some) for key, some in solves.items() if len(some) > 1]


def _fit(elements: str, state: str, costs: Sequence[SolveCost]) -> Growth:
    first, last = costs[0].measured, costs[-1].measured
    size = np.log([cost.measured.unknowns for cost in costs])
    columns = {CPU: [cost.measured.cpu_s for cost in costs]}
    columns[EACH] = [cost.measured.cpu_s / cost.measured.solves for cost in costs]
    for part in costs[0].parts:
        columns[part] = [cost.parts[part] / cost.measured.solves for cost in costs]
    exponents = {
        name: float(np.polyfit(size, np.log(values), 1)[0])
        for name, values in columns.items()
        if min(values) > 0
    }
    iterations, solves = last.iterations / first.iterations, last.solves / first.solves
    return Growth(elements, state, iterations, solves, exponents)
