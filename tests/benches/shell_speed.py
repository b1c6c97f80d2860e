"""How fast a Newton iteration is, against the floor that no implementation goes below: one
evaluation of residual and tangent, one numeric factorisation, one solution.

Two cases: a sheet that settles on a rod from far, and one that follows a change of its load.  An
iteration in which nodes will touch or part takes up to two linear solves more, to foresee which;
each saves an iteration, and the time for one linear solve is told too."""

from __future__ import annotations

import platform
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import cast

import numpy as np
from rich.table import Table

from cosim.case.file import load_case
from cosim.commands.terminal import console, stages
from cosim.models.build import build
from cosim.port import STATIC, Array
from fe_solver.elements import kernels
from fe_solver.forces.contact import Contact
from fe_solver.hood.shell_hood import ShellHood
from fe_solver.solver.linear_algebra import analyse, available, backend_name
from fe_solver.solver.model import ShellModel
from fe_solver.solver.newton import NewtonOptions, Solution, solve
from fe_solver.solver.newton_step import factorise
from fe_solver.surfaces.shapes import Capsule
from tests.proofs.fe import sheets

QUADS = (500, 2000, 8000)
REPEATS = 5
CHANGE = 1.05
"""Factor on the load that is followed."""
LENGTH, ARC, RADIUS = 60e-3, 15e-3, 8e-3
"""m, of a sheet laid along a rod: a finger's hood in size."""
PULL = np.array([11.8])
"""N, the force of the thesis's strain validation (section 2.3.3)."""


@dataclass(frozen=True)
class Speed:
    """The shortest of several times, s: of all iterations of a case, and of the floor of one."""

    case: str
    quads: int
    iterations: int
    solves: int
    all_s: float
    floor_s: float

    @property
    def ratio(self) -> float:
        """An iteration over the floor."""
        return self.all_s / max(self.iterations, 1) / self.floor_s

    @property
    def solve_ratio(self) -> float:
        """An iteration or a foresight, whatever takes a linear solve, over the floor."""
        return self.all_s / max(self.solves, 1) / self.floor_s


def rod_sheet(quads: int) -> ShellModel:
    """A sheet over a rod of two capsules' length, tied at its distal end, pulled at the other by
    one tendon, its underside in contact: about `quads` elements."""
    across = max(4, round(np.sqrt(quads / 4)))
    along = round(quads / across)

    def shape(uv: Array) -> Array:
        angle = (uv[:, 1] - 0.5) * ARC / RADIUS
        height = RADIUS + 0.3e-3 * (1 - uv[:, 0])
        return np.column_stack([LENGTH * uv[:, 0], height * np.sin(angle), height * np.cos(angle)])

    X, cells = sheets.map_grid(along, across, shape)
    model = sheets.sheet(X, cells, 100e6, 0.4, 0.5e-3)
    model = sheets.clamp(model, np.flatnonzero(X[:, 0] == LENGTH))
    model = sheets.guide(model, [np.flatnonzero(X[:, 0] == 0)], [(-1.0, 0.0, -0.3)])
    free = np.flatnonzero((X[:, 0] > 0) & (X[:, 0] < LENGTH))
    rod = Capsule(np.array([-0.1, 0, 0]), np.array([0.2, 0, 0]), RADIUS)
    touching: Contact = sheets.contact(model, rod, free, 2e11, 5e-5)
    return replace(model, contacts=(touching,))


def speed(quads: int) -> Iterator[Speed]:
    """Measured on `rod_sheet`, its pattern known and its kernels compiled: settling on the rod, and
    following a change of the load."""
    model = rod_sheet(quads)
    start, options = sheets.at_rest(model), NewtonOptions(tolerance=1e-8)
    settled = solve(model, start, PULL, options)
    cases = {
        "settle": lambda: solve(model, start, PULL, options),
        "follow": lambda: solve(model, settled.configuration, CHANGE * PULL, options, near=True),
    }
    for name, case in cases.items():
        solution = case()
        both = [(_time(case), _time(lambda: _floor(model, settled))) for _ in range(REPEATS)]
        all_s, floor_s = np.min(both, axis=0).tolist()
        yield Speed(name, len(model.quads), solution.iterations, solution.solves, all_s, floor_s)


def machine() -> str:
    """In words: processor, threads, kernels and linear solver of the measurement."""
    kind = "numba" if kernels.COMPILED else "numpy"
    return (
        f"{platform.machine()}, {kernels.thread_count()} threads, {kind} kernels, "
        f"{backend_name()}, Python {platform.python_version()}"
    )


def _time(work: Callable[[], object]) -> float:
    """The time (s) that the work takes."""
    begin = perf_counter()
    work()
    return perf_counter() - begin


def _floor(model: ShellModel, solution: Solution) -> None:
    """One evaluation with its tangent, one factorisation, one solution."""
    e = model.evaluate(solution.configuration, PULL, tangent=True)
    assert e.data is not None
    factorise(model, e.data).solve(e.reduced[model.free])


def bench_fe(quads: Sequence[int] = QUADS) -> dict[str, float]:
    """Print how long a Newton iteration takes, beside its floor; the ratios by name."""
    table = Table("quads", "case", "iterations", "linear solves", "floor ms")
    table.add_column("iteration / floor", justify="right")
    table.add_column("linear solve / floor", justify="right")
    with stages("bench", len(quads)) as progress:
        speeds = []
        for count in quads:
            progress.begin(f"{count} quads")
            speeds += list(speed(count))
    for s in speeds:
        row = [s.quads, s.case, s.iterations, s.solves, f"{1e3 * s.floor_s:.3g}"]
        table.add_row(*map(str, row), f"{s.ratio:.2f}", f"{s.solve_ratio:.2f}")
    screen = console()
    screen.print(table)
    screen.print("floor: one evaluation with tangent, one factorisation, one solution")
    screen.print(
        "settle: from far onto a rod, with foresight of which nodes will touch; follow: 5 % more "
        "load"
    )
    screen.print(machine())
    ratios: dict[str, float] = {}
    for s in speeds:
        name = f"{s.case}, {s.quads} quads"
        ratios |= {f"{name}: iterations": s.iterations, f"{name}: linear solves": s.solves}
        ratios |= {f"{name}: iteration / floor": s.ratio}
    return ratios


def bench_solvers(case: str = "isometric_edc") -> dict[str, float]:
    """Print how long each linear solver that is installed takes for the tangent of a case's hood at
    rest; the times over those of SuperLU by name."""
    models = build(load_case(case))
    hood = cast(ShellHood, models.hood)
    motion = models.finger.motion(models.finger.start(models.posture))
    resting = np.full(len(hood.tendons), models.resting)
    state = hood.advance(hood.start(motion), motion, resting, STATIC).state
    data, slots, times = state.solution.evaluation.data, hood.model.pattern.slots, {}
    right = np.ones(slots.shape[0])
    for name in available():
        analysis, both = analyse(slots, name), []
        for _ in range(REPEATS):
            clock = [perf_counter()]
            factor = analysis.factor(data)
            clock.append(perf_counter())
            factor.solve(right)
            both.append(np.diff([*clock, perf_counter()]))
        times[name] = dict(zip(("factorisation", "solution"), np.min(both, axis=0), strict=True))
    table = Table("linear solver", *(f"{what} ms" for what in times["superlu"]))
    for name, each in times.items():
        table.add_row(name, *(f"{1e3 * seconds:.3g}" for seconds in each.values()))
    console().print(table)
    console().print(f"{len(right)} unknowns, {slots.nnz} entries: the tangent of {case} at rest")
    return {
        f"{name}: {what} / SuperLU's": seconds / times["superlu"][what]
        for name, each in times.items()
        for what, seconds in each.items()
        if name != "superlu"
    }
