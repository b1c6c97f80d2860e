"""A strap with everything that a hood has, for the tests of Newton and of the coupling."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cosim.port import Array
from fe_solver.forces.springs import NodeSprings
from fe_solver.solver.model import Configuration, ShellModel
from fe_solver.solver.newton import NewtonOptions
from fe_solver.supports import SpringLaw, SpringSet, springs_of
from fe_solver.surfaces.spline_distance import Sphere
from tests.proofs.fe import sheets
from tests.proofs.fe.sheets import clamp, guide, sheet

TIGHT = NewtonOptions(tolerance=1e-12)
TENSION = np.array([3.0, 1.5])
LENGTH, WIDTH = 30e-3, 8e-3


def springs(
    nodes: np.ndarray,
    body: int,
    anchors: Array,
    stiffness: float,
    length: Array | float,
    only: bool,
) -> SpringSet:
    return SpringSet.to_body("strings", SpringLaw(stiffness, only), nodes, body, anchors, length)


def strap() -> ShellModel:
    """A strap over a sphere with everything that a hood has: tied to body 1 at one end, pulled by
    two tendons in guides of body 0 at the other, in contact with a sphere of body 2, and with
    two-sided and taut and slack one-sided springs to bodies 1 and 2."""

    def bowed(uv: Array) -> Array:
        x, y = LENGTH * (uv[:, 0] - 0.5), WIDTH * (uv[:, 1] - 0.5)
        return np.column_stack([x, y, 2e-3 - 12.0 * x**2 + 0.05 * y])

    X, quads = sheets.map_grid(8, 4, bowed)
    model = sheet(X, quads, 5e7, 0.3, 0.5e-3, growth=0.02, bodies=("hand", "bone", "ball"))
    model = clamp(model, np.flatnonzero(X[:, 0] > LENGTH / 2 - 1e-6), body=1)
    end = np.flatnonzero(X[:, 0] < -LENGTH / 2 + 1e-6)
    model = guide(model, [end[:3], end[3:]], [(-1.0, 0, -0.4), (-1.0, 0.1, -0.4)])
    middle = np.flatnonzero((np.abs(X[:, 0]) < 12e-3) & (X[:, 0] > -12e-3))
    ball = Sphere(np.array([0.5e-3, 0.3e-3, -9.8e-3]), 11e-3)
    touching = replace(sheets.contact(model, ball, middle, 2e10, 1e-4), body=2)
    a, b, c = middle[[0, 4]], middle[[10, 14]], middle[[20, 24]]
    low = np.array([0.0, 0, -5e-3])
    other = X[[b, c]]
    across = NodeSprings(
        np.column_stack([b, c]),
        np.array([300.0, 200.0]),
        np.linalg.norm(other[0] - other[1], axis=1) * [0.9, 1.0],
        np.array([False, True]),
        np.zeros(2, dtype=np.intp),
    )
    return replace(
        model,
        contacts=(touching,),
        links=across,
        springs=springs_of(
            [
                springs(a, 1, X[a] + low, 200.0, 5.5e-3, only=False),
                springs(b, 2, X[b] + low, 300.0, 3e-3, only=True),
                springs(c, 2, X[c] + low, 300.0, 9e-3, only=True),
            ]
        ),
    )


def perturb(model: ShellModel, c: Configuration, size: float, seed: int = 0) -> Configuration:
    step = np.zeros(model.pattern.size)
    step[model.free] = size * np.random.default_rng(seed).normal(size=len(model.free))
    step.reshape(-1, 5)[:, 3:] *= 1e3  # directors turn a radian where nodes move a millimetre
    return model.take_step(c, model.bases(c), step)
