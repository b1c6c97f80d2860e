"""Beams of shell elements: MacNeal and Harder's straight and curved cantilevers, Raasch's hook."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from cosim.port import Array
from fe_solver.solver.model import ShellModel
from tests.proofs.fe.benchmark import Benchmark, Meshes
from tests.proofs.fe.sheets import clamp, elements, line_weights, linear_response, sheet

MACNEAL = "MacNeal, Harder 1985, Finite Elem Anal Des 1:3"
LENGTH, DEPTH, THICKNESS, MODULUS, POISSON = 6.0, 0.2, 0.1, 1e7, 0.3
COLUMNS = 6
SHAPES: dict[str, Callable[[Array], Array]] = {
    "rectangles": np.zeros_like,
    "parallelograms": np.ones_like,
    "trapezoids": lambda line: 1.0 - 2.0 * (line % 2),
}
"""Slope of the lines between the elements, by their number."""


def rectangle_torsion(width: float, thickness: float) -> float:
    """Saint-Venant's torsion constant of a rectangle, by its series (Timoshenko and Goodier,
    Theory of Elasticity, article 109)."""
    n = np.arange(1, 101, 2)
    series = (np.tanh(n * np.pi * width / (2 * thickness)) / n**5).sum()
    return float(width * thickness**3 / 3 * (1 - 192 * thickness / (np.pi**5 * width) * series))


def straight_beam(shape: str, refinement: int, nodes: int) -> tuple[ShellModel, Array]:
    """The cantilever, of 6 x 1 elements of one of the SHAPES, each cut in `refinement` squared; and
    the parameters (n, 2) of its nodes along it and over its depth."""
    uv, quads = elements(COLUMNS * refinement, refinement, nodes)
    lines = np.arange(COLUMNS + 1.0)
    slope = SHAPES[shape](lines)
    slope[[0, -1]] = 0.0
    column = COLUMNS * uv[:, 0]
    height = DEPTH * (uv[:, 1] - 0.5)
    x = LENGTH * uv[:, 0] + np.interp(column, lines, slope) * height
    X = np.column_stack([x, height, 0 * x])
    model = sheet(X, quads, MODULUS, POISSON, THICKNESS, fibre=(1.0, 0.2, 0.0))
    return clamp(model, np.flatnonzero(uv[:, 0] == 0)), uv


def straight_deflections(
    shape: str, loads: Sequence[str], refinement: int, nodes: int
) -> list[float]:
    """Tip displacements under unit forces along the beam, in its plane or out of it, or the tip's
    turn under a unit twist; each the mean that the load does work on."""
    model, uv = straight_beam(shape, refinement, nodes)
    tip = np.flatnonzero(uv[:, 0] == 1)
    y = model.reference[tip, 1]
    even = line_weights(y, nodes) / DEPTH
    couple = line_weights(y, nodes, lambda s: 12 * s / DEPTH**3)
    x_axis, y_axis, z_axis = np.eye(3)
    forces = {
        "extension": np.outer(even, x_axis),
        "in plane": np.outer(even, y_axis),
        "out of plane": np.outer(even, z_axis),
        "twist": np.outer(couple, z_axis),
    }
    return [work_of(model, tip, forces[load]) for load in loads]


def work_of(model: ShellModel, nodes: np.ndarray, force: Array) -> float:
    """Work of forces (k, 3) on some nodes through the small displacements that they cause."""
    load = np.zeros_like(model.reference)
    load[nodes] = force
    return float(np.vdot(load, linear_response(model, load)[0]))


def straight_benchmark(shape: str, loads: Sequence[str], meshes: Meshes) -> Benchmark:
    """The cantilever of one shape of elements under some of the loads; `meshes` are those of the
    four-node element."""
    return Benchmark(
        f"straight beam, {shape}",
        "cantilever of 6 x 0.2 x 0.1, E = 1e7, nu = 0.3, unit load at its end; trapezoids and "
        "parallelograms of 45 degrees",
        {load: STRAIGHT[load] for load in loads},
        f"{MACNEAL}, as quoted in Altair's verification problem OS-V 0720; but twist by "
        "Saint-Venant's series (theirs, 0.03208, is 6 % less)",
        partial(straight_deflections, shape, loads),
        {4: meshes, 9: Meshes((1, 2, 4))},
        lambda n: f"{COLUMNS * n} x {n}",
    )


STRAIGHT = {
    "extension": 3e-5,
    "in plane": 0.1081,
    "out of plane": 0.4321,
    "twist": LENGTH * 2 * (1 + POISSON) / (MODULUS * rectangle_torsion(DEPTH, THICKNESS)),
}
"""Loads on the straight beam, and what moves at its end (m, rad)."""


def curved_beam(refinement: int, nodes: int) -> list[float]:
    """Tip displacements of a quarter of a ring, clamped at one end, under unit forces at the other:
    along its radius there, and out of its plane."""
    uv, quads = elements(COLUMNS * refinement, refinement, nodes)
    turn, radius = np.pi / 2 * uv[:, 0], INNER + (OUTER - INNER) * uv[:, 1]
    X = np.column_stack([-radius * np.cos(turn), radius * np.sin(turn), 0 * turn])
    model = sheet(X, quads, MODULUS, 0.25, THICKNESS, fibre=(1.0, 0.2, 0.0))
    model = clamp(model, np.flatnonzero(uv[:, 0] == 0))
    tip = np.flatnonzero(uv[:, 0] == 1)
    even = line_weights(radius[tip], nodes) / (OUTER - INNER)
    return [work_of(model, tip, np.outer(even, np.eye(3)[i])) for i in (1, 2)]


def curved_bar_deflection() -> float:
    """Radial displacement of the end of a quarter of a ring under a unit force along its radius, in
    plane stress (Timoshenko and Goodier, Theory of Elasticity, article 33)."""
    a, b = INNER, OUTER
    bending = (a**2 + b**2) * np.log(b / a) - (b**2 - a**2)
    return float(np.pi * (a**2 + b**2) / (MODULUS * THICKNESS * bending))


INNER, OUTER = 4.12, 4.32
FINE = (1, 4, 8, 16)
CURVED = Benchmark(
    "curved beam",
    "quarter of a ring, radii 4.12 and 4.32, 0.1 thick, E = 1e7, nu = 0.25, clamped, unit force at "
    "its end",
    {"in plane": curved_bar_deflection(), "out of plane": 0.5022},
    f"{MACNEAL}, as quoted in Altair's verification problem OS-V 0710; but in plane by Timoshenko "
    "and Goodier's curved bar (theirs, 0.08734, is 1.4 % less)",
    curved_beam,
    {4: Meshes(FINE), 9: Meshes((1, 2, 4))},
    lambda n: f"{COLUMNS * n} x {n}",
)


def hook(n: int, nodes: int) -> list[float]:
    """Tip displacement of Raasch's hook along its width, under a unit force spread over its end; 7
    n x n elements, a line of which lies where the arcs meet."""
    small, large, width = 14.0, 46.0, 20.0
    uv, quads = elements(7 * n, n, nodes)
    angle = np.deg2rad(210) * uv[:, 0]
    turn = np.deg2rad(60)
    first = angle <= turn + 1e-12
    # The first arc turns to the left, the second to the right; they share a tangent.
    heading = np.where(first, angle, 2 * turn - angle)
    joint = small * np.array([np.sin(turn), 1 - np.cos(turn)])
    centre = joint + large * np.array([np.sin(turn), -np.cos(turn)])
    x = np.where(first, small * np.sin(heading), centre[0] - large * np.sin(heading))
    y = np.where(first, small * (1 - np.cos(heading)), centre[1] + large * np.cos(heading))
    X = np.column_stack([x, y, width * uv[:, 1]])
    D = np.column_stack([-np.sin(heading), np.cos(heading), 0 * x])
    model = sheet(X, quads, 3300.0, 0.35, 2.0, directors=D, fibre=(0.3, 0.2, 1.0))
    model = clamp(model, np.flatnonzero(uv[:, 0] == 0))
    tip = np.flatnonzero(uv[:, 0] == 1)
    even = line_weights(X[tip, 2], nodes) / width
    return [work_of(model, tip, np.outer(even, [0, 0, 1.0]))]


HOOK = Benchmark(
    "Raasch's hook",
    "arcs of 60 degrees of radius 14 and 150 of radius 46, 20 wide, 2 thick, E = 3300, nu = 0.35, "
    "clamped, unit force along the width spread over the end",
    {"tip along the width": 5.02},
    "Knight 1997, AIAA J 35:375, as quoted in FinEtoolsFlexStructures, raasch_examples",
    hook,
    {4: Meshes((2, 4, 8, 16)), 9: Meshes((1, 2, 4, 8))},
    lambda n: f"{7 * n} x {n}",
)
OTHER_LOADS = ("extension", "out of plane", "twist")
STRAIGHT_BEAMS = (
    *(straight_benchmark(s, ("in plane",), Meshes(FINE, also={4: 0.05})) for s in SHAPES),
    *(straight_benchmark(s, OTHER_LOADS, Meshes(FINE)) for s in SHAPES),
)
