"""Limit and buckling loads by both elements: hinged roofs, and a strip that buckles sideways."""

from __future__ import annotations

from functools import partial

import numpy as np

from cosim.errors import ConvergenceError
from cosim.port import Array
from fe_solver.solver.model import ShellModel
from fe_solver.solver.newton import solve
from tests.proofs.fe.beams import rectangle_torsion
from tests.proofs.fe.benchmark import Benchmark, Meshes
from tests.proofs.fe.paths import WHOLE, drive_node, largest
from tests.proofs.fe.sheets import (
    NO_TENSION,
    at_rest,
    clamp,
    elements,
    line_weights,
    mirror_plane,
    sheet,
)

DEEPEST = 16
"""mm, of the roofs' middle; both limit loads are before it."""


def hinged_roof(thickness: float, n: int, nodes: int) -> list[float]:
    """First maximum of the force on the middle of a hinged roof, whose deflection is prescribed; a
    quarter."""
    uv, quads = elements(n, n, nodes)
    turn = 0.1 * uv[:, 1]
    D = np.column_stack([0 * turn, np.sin(turn), np.cos(turn)])
    X = 2540 * D + np.outer(uv[:, 0], [254.0, 0, 0])
    model = sheet(X, quads, 3102.75, 0.3, thickness, directors=D)
    middle, crown, hinge = uv[:, 0] == 0, uv[:, 1] == 0, uv[:, 1] == 1
    mirror = np.column_stack([middle, crown, np.zeros_like(middle)])
    top = int(np.flatnonzero(middle & crown)[0])
    held = np.outer(hinge, [True, True, True])
    held[top, 2] = True
    model = mirror_plane(model, mirror, held)
    forces, _ = drive_node(model, top, np.array([0, 0, -1.0]), np.arange(1.0, DEEPEST + 1))
    return [4 * largest(forces)]


def hinged_roof_benchmark(thickness: float, target: float) -> Benchmark:
    """The benchmark of the hinged roof."""
    return Benchmark(
        f"hinged roof, h = {thickness}",
        "a quarter of R = 2540, axial length 508, half angle 0.1 rad, E = 3102.75, nu = 0.3, "
        "straight edges hinged, force on the middle by prescribed deflection",
        {"limit load": target},
        "Sze, Liu, Lo 2004, Finite Elem Anal Des 40:1551, tables 9a-f (the largest of Abaqus "
        "S4R's steps), as quoted in the repository saullocastro/panels, sze2004_hinged_roofs",
        partial(hinged_roof, thickness),
        {4: Meshes((4, 8, 16)), 9: Meshes((2, 4, 8))},
    )


HINGED_ROOFS = (hinged_roof_benchmark(12.7, 2226.3), hinged_roof_benchmark(6.35, 585.9))


def buckling_load(model: ShellModel, load: Array, least: float, most: float) -> float:
    """Factor of the nodal forces `load` (n, 3), between two within which the tangent's least
    eigenvalue changes its sign, at which it is zero.

    The tangent is that of the loaded state: to first order in the load alone, a thin shell's
    stiffness against transverse shear, whose axes turn with it, makes it too soft.  Raises
    ConvergenceError."""
    from scipy.optimize import brentq
    from scipy.sparse.linalg import eigsh

    c = at_rest(model)

    def least_eigenvalue(factor: float) -> float:
        solution = solve(model.with_changes(dead=factor * load), c, NO_TENSION, WHOLE, near=True)
        data = solution.evaluation.data
        assert data is not None
        K = model.pattern.full(data)[model.free][:, model.free].tocsc()
        return float(eigsh(K, k=1, sigma=0.0, which="LM", return_eigenvectors=False)[0])

    try:
        return float(brentq(least_eigenvalue, least, most, rtol=1e-5))
    except ValueError as error:
        words = (
            f"the tangent's least eigenvalue keeps its sign from {least:g} to {most:g} of the load"
        )
        raise ConvergenceError(words) from error


STRIP, DEPTH, THICKNESS, MODULUS, POISSON = 50.0, 1.0, 0.01, 1e7, 0.3


def strip_buckling(n: int, nodes: int) -> list[float]:
    """Load at the end of an upright strip, clamped at the other, at which it turns sideways, over
    sqrt(E I G J) / L^2; 10 n x n elements."""
    uv, quads = elements(10 * n, n, nodes)
    X = np.column_stack([STRIP * uv[:, 0], DEPTH * (uv[:, 1] - 0.5), 0 * uv[:, 0]])
    model = sheet(X, quads, MODULUS, POISSON, THICKNESS)
    model = clamp(model, np.flatnonzero(uv[:, 0] == 0))
    tip = np.flatnonzero(uv[:, 0] == 1)
    load = np.zeros_like(X)
    load[tip, 1] = -line_weights(X[tip, 1], nodes) / DEPTH
    bending = MODULUS * DEPTH * THICKNESS**3 / 12
    torsion = MODULUS / (2 * (1 + POISSON)) * rectangle_torsion(DEPTH, THICKNESS)
    unit = float(np.sqrt(bending * torsion)) / STRIP**2
    return [buckling_load(model, load, 3 * unit, 5 * unit) / unit]


def strip_buckling_factor() -> float:
    """Twice the first zero of the Bessel function of order -1/4: a narrow strip twists by b with
    EI GJ b'' + P^2 x^2 b = 0, x from the loaded end, b' = 0 there and b = 0 at the clamped one."""
    from scipy.optimize import brentq
    from scipy.special import jv

    return 2 * float(brentq(lambda x: jv(-0.25, x), 1.0, 3.0))


STRIP_BUCKLING = Benchmark(
    "strip buckling sideways",
    "upright cantilever of 50 x 1 x 0.01, E = 1e7, nu = 0.3, force across its end in its plane; "
    "the clamp holds its warping too, which adds 1 % at this length",
    {"buckling load L^2 / sqrt(EI GJ)": strip_buckling_factor()},
    "4.0126: Timoshenko, Gere, Theory of Elastic Stability, lateral buckling of a cantilever of "
    "narrow rectangular section, by its Bessel function",
    strip_buckling,
    {4: Meshes((2, 4, 8), 0.03), 9: Meshes((1, 2, 4), 0.03)},
    lambda n: f"{10 * n} x {n}",
)
