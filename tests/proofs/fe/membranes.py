"""Pressurised membranes by both elements: Hencky's circular membrane and a rubber balloon."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from cosim.port import Array
from fe_solver.materials.fibres import TransIsoMooneyRivlin
from fe_solver.solver.newton import solve
from tests.proofs.fe.benchmark import Benchmark, Meshes
from tests.proofs.fe.paths import WHOLE
from tests.proofs.fe.sheets import (
    NO_TENSION,
    at_rest,
    elements,
    mirror_plane,
    sheet,
    surface_weights,
)

CORNERS = np.eye(3)
TERMS = 60


def triangle_elements(n: int, nodes: int) -> tuple[Array, np.ndarray]:
    """Barycentric coordinates (m, 3) of the nodes in a triangle and its 3 n x n elements of four or
    nine `nodes`: a square at each corner, up to the middles of the sides and of the triangle."""
    uv, quads = elements(n, n, nodes)
    u, v = uv.T[:, :, None]
    points, cells = [], []
    for k in range(3):
        corner, after, before = CORNERS[k], CORNERS[(k + 1) % 3], CORNERS[k - 1]
        sides = u * (1 - v) * (corner + after) / 2 + (1 - u) * v * (corner + before) / 2
        points.append((1 - u) * (1 - v) * corner + sides + u * v / 3)
        cells.append(quads + k * len(uv))
    every = np.vstack(points)
    _, first, node = np.unique(every.round(9), axis=0, return_index=True, return_inverse=True)
    out = every[first]
    out[np.abs(out) < 1e-12] = 0.0
    return out, node.ravel()[np.vstack(cells)]


def hencky_tension(middle: float) -> Array:
    """The coefficients (TERMS,), by even powers of r / a, of the radial tension in a circular
    membrane over (E t q^2 a^2)^(1/3), from that in its middle.

    With n the tension and x = r / a, equilibrium and compatibility are
    x^2 n'' + 3 x n' + x^2 / (8 n^2) = 0."""
    n, inverse = np.zeros(TERMS), np.zeros(TERMS)  # of n and of 1 / n^2
    n[0] = middle
    for k in range(TERMS):
        square = np.convolve(n[: k + 1], n[: k + 1])[: k + 1]
        inverse[k] = ((k == 0) - square[1:] @ inverse[:k][::-1]) / square[0]
        if k + 1 < TERMS:
            n[k + 1] = -inverse[k] / (32 * (k + 1) * (k + 2))
    return n


def hencky_deflection(poisson: float) -> float:
    """Deflection of the middle of a circular membrane with a fixed rim over a (q a / (E t))^(1/3):
    that of Hencky's series."""
    powers = 2 * np.arange(TERMS)

    def hoop_strain(middle: float) -> float:
        n = hencky_tension(middle)
        return float((1 - poisson) * n.sum() + powers @ n)

    n = hencky_tension(float(brentq(hoop_strain, 0.35, 0.6)))
    x, weights = np.polynomial.legendre.leggauss(40)
    x = (x + 1) / 2
    tension = (x[:, None] ** powers) @ n
    return float(weights / 2 @ (x / (2 * tension)))


def hencky(n: int, nodes: int) -> list[float]:
    """Deflection of the middle of a quarter of the membrane over a (q a / (E t))^(1/3)."""
    modulus, thickness, load = 1e6, 1e-4, 1e-4  # load: q a / (E t)
    at, quads = triangle_elements(n, nodes)
    across = at[:, 1:]
    radius = across.sum(axis=1)
    length = np.linalg.norm(across, axis=1)
    scale = np.divide(radius, length, out=np.zeros_like(radius), where=length > 0)
    X = np.column_stack([across * scale[:, None], 0 * radius])
    model = sheet(X, quads, modulus, 0.3, thickness)
    mirror = np.column_stack([at[:, 1] == 0, at[:, 2] == 0, np.zeros(len(X), dtype=bool)])
    model = mirror_plane(model, mirror, np.outer(at[:, 0] == 0, [True, True, True]))
    force = load * modulus * thickness * surface_weights(model)
    model = model.with_changes(dead=np.outer(force, [0, 0, 1.0]))
    start = at_rest(model)
    unit = load ** (1 / 3)
    start.x[:, 2] = 0.6 * unit * (1 - radius**2)
    c = solve(model, start, NO_TENSION, WHOLE).configuration
    return [float(c.x[radius == 0, 2][0] / unit)]


HENCKY = Benchmark(
    "circular membrane",
    "a quarter of radius a, a / t = 1e4, nu = 0.3, rim fixed and hinged, load q = 1e-4 E t / a "
    "across; 3 x n x n elements",
    {"middle, over a (q a / E t)^(1/3)": hencky_deflection(0.3)},
    "0.65344: Hencky 1915, Z Math Phys 63:311, by his series",
    hencky,
    {4: Meshes((4, 8, 16)), 9: Meshes((2, 4, 8))},
    lambda n: f"3 x {n} x {n}",
)
STRETCHES = (1.05, 1.15, 1.25)


def balloon_pressure(stretch: float) -> float:
    """Pressure in an incompressible neo-Hookean balloon whose radius is l times R, over mu t / R:
    2 (1 / l - 1 / l^7)."""
    return 2 * (1 / stretch - stretch**-7)


def balloon(n: int, nodes: int) -> list[float]:
    """Stretches of an eighth of the balloon under the pressures of STRETCHES, each the mean of its
    nodes'."""
    mu, thickness = 1e6, 1e-3
    at, quads = triangle_elements(n, nodes)
    X = at / np.linalg.norm(at, axis=1, keepdims=True)
    law = TransIsoMooneyRivlin(mu / 2, 0.0, 0.0, 1.0, 0.0, 2.0)
    model = sheet(X, quads, 0, 0, thickness, directors=X, law=law, fibre=(1.0, 0.3, 0.1))
    model = mirror_plane(model, X == 0)
    c, stretches = at_rest(model), []
    for stretch in STRETCHES:
        # the pressure pushes against the normals, which point outwards
        pressure = -balloon_pressure(stretch) * mu * thickness
        inflated = model.with_changes(pressure=np.full(len(quads), pressure))
        c = solve(inflated, c, NO_TENSION, WHOLE, near=True).configuration
        stretches.append(float(np.linalg.norm(c.x, axis=1).mean()))
    return stretches


BALLOON = Benchmark(
    "balloon",
    "an eighth of a sphere of incompressible neo-Hookean rubber, R / t = 1000, under pressure; "
    "3 x n x n elements",
    {f"radius over R at p R / (mu t) = {balloon_pressure(s):.4f}": s for s in STRETCHES},
    "exact: p = 2 mu t / R (1 / l - 1 / l^7), l the radius over R",
    balloon,
    {4: Meshes((2, 4, 8)), 9: Meshes((1, 2, 4))},
    lambda n: f"3 x {n} x {n}",
)
