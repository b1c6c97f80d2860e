"""Small deflections: closed forms of plates and beams."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cosim.port import Array
from fe_solver.elements.mesh_geometry import node_areas
from tests.helpers.rows import Row
from tests.proofs.fe.paths import error_order
from tests.proofs.fe.sheets import clamp, grid, linear_response, mirror_plane, plate, sheet

SHEAR = 5 / 6
"""Shear correction of a rectangular section."""


def plate_error(n: int, thickness: float) -> float:
    """Relative error of the middle of a simply supported square plate under p sin sin: Mindlin's
    exact deflection p / (D k^4) + p / (5/6 G h k^2), k^2 = 2 pi^2 / a^2 (Navier's, with shear); a
    quarter of the plate."""
    modulus, poisson = 1e7, 0.3
    X, quads = plate(0.5, 0.5, n, n)
    x, y, _ = X.T
    model = sheet(X, quads, modulus, poisson, thickness)
    on_x, on_y = x == 0, y == 0
    # An edge held hard keeps the director from leaning along it, as a mirror across it does.
    mirror = np.column_stack([(x == 0.5) | on_y, (y == 0.5) | on_x, np.zeros_like(on_x)])
    held = np.outer(on_x | on_y, [False, False, True])
    load = np.zeros_like(X)
    load[:, 2] = np.sin(np.pi * x) * np.sin(np.pi * y) * node_areas(X, quads)
    w = linear_response(mirror_plane(model, mirror, held), load)[0][:, 2].max()
    bending, k2 = modulus * thickness**3 / 12 / (1 - poisson**2), 2 * np.pi**2
    shear = SHEAR * modulus / (2 * (1 + poisson)) * thickness
    return float(w / (1 / (bending * k2**2) + 1 / (shear * k2)) - 1)


def plate_rows() -> Iterator[Row]:
    """Yield the rows of square plates."""
    for thickness in (0.1, 1e-3, 1e-5):
        coarse, fine = plate_error(8, thickness), plate_error(16, thickness)
        yield Row(
            f"square plate, h/L = {thickness:g}", "middle deflection / exact", 1.0, 1 + fine, 0.005,
            "exact: Mindlin plate under p sin sin; 16 x 16 a quarter",
            order=error_order(coarse, fine),
        )  # fmt: skip


def bracket(n: int, fold: float) -> tuple[float, float]:
    """Tip displacement across the second arm of a cantilever folded by `fold` (rad) under 1 that
    way, and beam theory's: arms of 10, 1 wide, 0.1 thick, E = 1.2e6, nu = 0; n elements an arm."""
    modulus, h, arm = 1.2e6, 0.1, 10.0
    uv, quads = grid(2 * n, 1)
    s = 2 * arm * uv[:, 0]
    way = np.array([np.cos(fold), 0, np.sin(fold)])
    X = np.outer(np.minimum(s, arm), [1.0, 0, 0]) + np.outer(np.maximum(s - arm, 0), way)
    X[:, 1] = uv[:, 1]
    between = way + np.array([1.0, 0, 0])
    model = clamp(sheet(X, quads, modulus, 0.0, h, fibre=between), np.flatnonzero(s == 0))
    tip, across = uv[:, 0] == 1, np.array([np.sin(fold), 0, -np.cos(fold)])
    u = linear_response(model, np.outer(tip, across / 2))[0][tip].mean(axis=0) @ across
    EI, EA, GA = modulus * h**3 / 12, modulus * h, SHEAR * modulus / 2 * h
    # Of the first arm: moment 1 (arm + (arm - x) cos), shear cos, tension sin.
    c = np.cos(fold)
    first = arm**3 * (1 + c + c * c / 3) / EI + arm * (c * c / GA + np.sin(fold) ** 2 / EA)
    return float(u), float(first + arm**3 / (3 * EI) + arm / GA)


def bracket_rows() -> Iterator[Row]:
    """The elements beside the fold share a director, which the mitre makes fit both."""
    for degrees in (30, 60, 90):
        tip, exact = bracket(32, np.deg2rad(degrees))
        what = f"cantilever folded by {degrees} deg"
        yield Row(what, "tip deflection", exact, tip, 2e-3, "Timoshenko beams; 32 elements an arm")


def taper(n: int) -> tuple[float, float]:
    """Tip deflection of a cantilever of 10 x 1 under 1 across, its thickness 0.1 (1 - x / 2L), E =
    1.2e6, nu = 0, and beam theory's."""
    modulus, length, h, slope = 1.2e6, 10.0, 0.1, 0.5
    X, quads = plate(length, 1.0, n, 1)
    thickness = h * (1 - slope * X[:, 0] / length)
    model = clamp(sheet(X, quads, modulus, 0.0, thickness), np.flatnonzero(X[:, 0] == 0))
    tip = X[:, 0] == length
    w = linear_response(model, np.outer(tip, [0, 0, 0.5]))[0][tip, 2].mean()
    left = 1 - slope
    bending = (-np.log(left) + 2 * left - left**2 / 2 - 1.5) / slope**3
    exact = bending * length**3 / (modulus * h**3 / 12)
    return float(w), float(exact - np.log(left) / slope * length / (SHEAR * modulus / 2 * h))


def taper_rows() -> Iterator[Row]:
    """Yield the rows of tapered panels."""
    (coarse, exact), (fine, _) = taper(16), taper(32)
    yield Row(
        "tapered cantilever", "tip deflection", exact, fine, 0.002,
        "exact: integral of (L - x)^2 / EI(x), with shear; 32 x 1",
        order=error_order(coarse - exact, fine - exact),
    )  # fmt: skip


def eccentric(elements: int) -> tuple[Array, Array]:
    """Tip displacement along x and z of a strip of 10 x 1 x 0.1 whose nodes lie on its lower face,
    where it is pulled by 1, and the exact ones: E = 1.2e6, nu = 0."""
    modulus, length, h = 1.2e6, 10.0, 0.1
    X, quads = plate(length, 1.0, elements, 1)
    model = sheet(X, quads, modulus, 0.0, h, height=h / 2)
    model = clamp(model, np.flatnonzero(X[:, 0] == 0))
    tip = X[:, 0] == length
    u = linear_response(model, np.outer(tip, [0.5, 0, 0]))[0][tip].mean(axis=0)
    EI, EA, arm = modulus * h**3 / 12, modulus * h, h / 2
    stretch = length / EA + arm**2 * length / EI
    return u[[0, 2]], np.array([stretch, arm * length**2 / (2 * EI)])


def eccentric_rows() -> Iterator[Row]:
    """Yield the rows of sheets off their mid-surface."""
    seen, exact = eccentric(8)
    source = "exact: N / EA + N e^2 / EI, N e L^2 / 2EI; 8 x 1"
    for i, name in enumerate(("x", "z")):
        yield Row("strip pulled at its face", f"tip along {name}", exact[i], seen[i], 1e-8, source)
