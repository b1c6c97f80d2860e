"""How fast a Newton iteration is, against the floor that no implementation goes below: one
evaluation of residual and tangent, one numeric factorisation, one solution.

An iteration is one linear solve: a step that foresees which nodes will touch takes up to three."""

from __future__ import annotations

import platform
from dataclasses import dataclass, replace
from statistics import median
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from . import kernels
from .contact import Contact
from .linear_algebra import chosen
from .model import Configuration, ShellModel
from .newton import NewtonOptions, Solution, factorised, solve
from .shapes import Capsule
from .verification import sheets

Array = NDArray[np.float64]

REPEATS = 5
LENGTH, ARC, RADIUS = 60e-3, 15e-3, 8e-3
"""m, of a sheet laid along a rod: a finger's hood in size."""
PULL = np.array([11.8])
"""N, the force of the thesis's strain validation (section 2.3.3)."""


@dataclass(frozen=True)
class Speed:
    """Medians, s; `ratio` is an iteration (one of `solves`) over the floor."""

    quads: int
    steps: int
    solves: int
    iteration_s: float
    evaluation_s: float
    factorisation_s: float
    solution_s: float

    @property
    def floor_s(self) -> float:
        return self.evaluation_s + self.factorisation_s + self.solution_s

    @property
    def ratio(self) -> float:
        return self.iteration_s / self.floor_s


def rod_sheet(quads: int) -> ShellModel:
    """A sheet over a rod of two capsules' length, tied at its distal end, pulled at the other by
    one tendon, its underside in contact: about `quads` elements."""
    across = max(4, round(np.sqrt(quads / 4)))
    along = round(quads / across)

    def shape(uv: Array) -> Array:
        angle = (uv[:, 1] - 0.5) * ARC / RADIUS
        height = RADIUS + 0.3e-3 * (1 - uv[:, 0])
        return np.column_stack([LENGTH * uv[:, 0], height * np.sin(angle), height * np.cos(angle)])

    X, cells = sheets.mapped(along, across, shape)
    model = sheets.sheet(X, cells, 100e6, 0.4, 0.5e-3)
    model = sheets.clamped(model, np.flatnonzero(X[:, 0] == LENGTH))
    model = sheets.guided(model, [np.flatnonzero(X[:, 0] == 0)], [(-1.0, 0.0, -0.3)])
    free = np.flatnonzero((X[:, 0] > 0) & (X[:, 0] < LENGTH))
    rod = Capsule(np.array([-0.1, 0, 0]), np.array([0.2, 0, 0]), RADIUS)
    touching: Contact = sheets.contact(model, rod, free, 2e11, 5e-5)
    return replace(model, contacts=(touching,))


def speed(quads: int) -> Speed:
    """Measured on `rod_sheet`, its pattern known and its kernels compiled."""
    model = rod_sheet(quads)
    start = sheets.at_rest(model)
    options = NewtonOptions(tolerance=1e-8)
    solution = solve(model, start, PULL, options)
    times = [_timed(model, start, options) for _ in range(REPEATS)]
    floor = np.array([_floor(model, solution) for _ in range(REPEATS)])
    evaluation, factorisation, back = np.median(floor, axis=0)
    per_iteration = median(times) / max(solution.solves, 1)
    return Speed(
        len(model.quads),
        solution.iterations,
        solution.solves,
        per_iteration,
        float(evaluation),
        float(factorisation),
        float(back),
    )


def machine() -> str:
    """In words: processor, threads, kernels and linear solver of the measurement."""
    kind = "numba" if kernels.COMPILED else "numpy"
    return (
        f"{platform.machine()}, {kernels.thread_count()} threads, {kind} kernels, "
        f"{chosen()}, Python {platform.python_version()}"
    )


def _timed(model: ShellModel, start: Configuration, options: NewtonOptions) -> float:
    begin = perf_counter()
    solve(model, start, PULL, options)
    return perf_counter() - begin


def _floor(model: ShellModel, solution: Solution) -> tuple[float, float, float]:
    """Seconds of one evaluation with its tangent, one factorisation, one solution."""
    t0 = perf_counter()
    e = model.evaluate(solution.configuration, PULL, tangent=True)
    t1 = perf_counter()
    assert e.data is not None
    factor = factorised(model, e.data)
    t2 = perf_counter()
    factor.solve(e.reduced[model.free])
    return t1 - t0, t2 - t1, perf_counter() - t2
