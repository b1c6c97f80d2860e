"""The element by itself: exactness on patches, rigid motion, and tangents against differences."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cosim.port import Array, rotation_matrix
from fe_solver.materials.linear import Isotropic, Law
from fe_solver.materials.tension_field import TensionField
from fe_solver.solver.model import Configuration, ShellModel
from tests.helpers.rows import Row
from tests.proofs.fe import sheets
from tests.proofs.fe.material_rows import LAWS
from tests.proofs.fe.sheets import at_rest, clamp, disturb, plate, sheet, with_nine_nodes

SIDE, THICK = 10e-3, 1e-3
SOFT = Isotropic(1e6, 0.3)
OWN = "central differences"
SHAPES = (
    *("flat quads", "warped quads", "triangles", "nine-node quads", "folded quads"),
    "quads that taper",
)
FOLD = np.deg2rad(60)
# MacNeal and Harder 1985, Finite Elem Anal Des 1:3: nodes and quads of the patch test.
PATCH = np.array(
    "0 0  0.24 0  0.24 0.12  0 0.12  0.04 0.02  0.18 0.03  0.16 0.08  0.08 0.08".split(),
    dtype=float,
).reshape(8, 2)
PATCH_QUADS = np.array([[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7], [4, 5, 6, 7]])


def halve(quads: np.ndarray) -> np.ndarray:
    """The triangles (2 ne, 4) that the quads' diagonals make, as quads a, b, c, c."""
    return np.concatenate([quads[:, [0, 1, 2, 2]], quads[:, [0, 2, 3, 3]]])


def distort(shape: str, law: Law | TensionField = SOFT, height: float = 0.0) -> ShellModel:
    """A sheet of 3 x 2 distorted elements of about 10 mm: of one of the SHAPES, the folded one
    with a mitre between its last row and the others."""
    X, quads = plate(3 * SIDE, 2 * SIDE, 3, 2)
    shift = np.random.default_rng(3).uniform(-0.2, 0.2, X.shape) * SIDE
    flat = shape in ("flat quads", "folded quads")
    X = X + shift * [1, 1, 0 if flat else 1]
    if shape == "nine-node quads":
        X, quads = with_nine_nodes(X, quads)
        X[6 * 2 :] += np.random.default_rng(4).uniform(-0.05, 0.05, X[6 * 2 :].shape) * SIDE
    thickness: float | Array = THICK
    if shape == "folded quads":
        X = fold(X)
    elif shape == "triangles":
        quads = halve(quads)
    elif shape == "quads that taper":
        thickness = THICK * np.linspace(0.5, 1.5, len(X))
    return sheet(X, quads, 0, 0, thickness, law=law, height=height, fibre=(1.0, 0.4, 0.1))


def fold(X: Array) -> Array:
    """Points (n, 3) of the x-y plane, folded by FOLD about a line along y."""
    line = 2 * SIDE
    beyond = np.maximum(X[:, 0] - line, 0)
    x = np.minimum(X[:, 0], line) + np.cos(FOLD) * beyond
    return np.column_stack([x, X[:, 1], X[:, 2] + np.sin(FOLD) * beyond])


def residual_along(model: ShellModel, c: Configuration, step: Array, tension: Array) -> Array:
    """The gradient (5n,) after a step in the bases of c, brought along with the directors' turn."""
    A, T = model.bases(c)
    moved = model.take_step(c, (A, T), step)
    e = model.evaluate(moved, tension, tangent=False)
    gx = e.gradient_x.copy()
    gx[model.guides.node] -= model.pulls(moved, tension)
    turn = np.cross(c.d, np.einsum("nij,nj->ni", T, step.reshape(-1, 5)[:, 3:]))
    T = np.stack([rotation_matrix(w) @ t for w, t in zip(turn, T, strict=True)])
    parts = np.einsum("nij,ni->nj", A, gx), np.einsum("nij,ni->nj", T, e.gradient_d)
    return np.concatenate(parts, axis=1).ravel()


def tangent_error(model: ShellModel, size: float, tension: Array | None = None) -> float:
    """Largest difference of tangent times direction from central differences of the residual, over
    the largest product, in the free degrees of freedom of a deformed state."""
    tension = np.zeros(len(model.share)) if tension is None else tension
    c, free = disturb(model, size, 5), model.free
    e = model.evaluate(c, tension, tangent=True)
    assert e.data is not None
    K, worst = model.pattern.full(e.data), 0.0
    for seed in range(3):
        u = np.zeros(model.pattern.size)
        u[free] = np.random.default_rng(seed).normal(size=len(free))
        u.reshape(-1, 5)[:, :3] *= SIDE
        h = 1e-7
        at = [residual_along(model, c, k * h * u, tension)[free] for k in (-2, -1, 1, 2)]
        change = (at[0] - 8 * at[1] + 8 * at[2] - at[3]) / (12 * h)
        product = (K @ u)[free]
        worst = max(worst, float(np.abs(product - change).max() / np.abs(change).max()))
    return worst


def law_rows() -> Iterator[Row]:
    """Every element with every material, its nodes off the mid-surface and in it."""
    for shape in SHAPES:
        for name, law in LAWS.items():
            error = tangent_error(distort(shape, law, height=THICK / 2), 1e-4)
            yield Row(f"element tangent, {shape}", name, 1e-6, error, 0.0, OWN, "bound")
        error = max(tangent_error(distort(shape, law), 1e-4) for law in LAWS.values())
        what = "worst of all, nodes in the middle"
        yield Row(f"element tangent, {shape}", what, 1e-6, error, 0.0, OWN, "bound")


def rigid_rows() -> Iterator[Row]:
    """Twenty rigid motions each, of up to half a turn and many times the size of the sheet."""
    rng = np.random.default_rng(8)
    for shape in SHAPES:
        model = distort(shape, height=THICK / 2)
        y = np.concatenate([model.reference[model.quads], model.directors[model.quads]], axis=1)
        worst = 0.0
        for _ in range(20):
            moved = y @ rotation_matrix(rng.uniform(-3, 3, 3)).T
            moved[:, : model.quads.shape[1]] += rng.uniform(-10, 10, 3) * SIDE
            strain = model.tables.strain(moved)
            strain[..., 3:6] *= THICK / 2
            worst = max(worst, float(np.abs(strain).max()))
        yield Row("rigid motion", f"strain, {shape}", 1e-12, worst, 0.0, "exact: none", "bound")


def zero_modes(shape: str) -> int:
    """Modes of a free element whose stiffness is below 1e-12 of the stiffest."""
    whole = distort(shape)
    nodes, quad = np.unique(whole.quads[0], return_inverse=True)
    model = sheet(whole.reference[nodes], quad.reshape(1, -1), 1e6, 0.3, THICK)
    e = model.evaluate(at_rest(model), np.zeros(0), tangent=True)
    assert e.data is not None
    K = model.pattern.full(e.data).toarray()
    scale = np.tile([1, 1, 1, 1 / SIDE, 1 / SIDE], len(nodes))
    values = np.linalg.eigvalsh(K * np.outer(scale, scale))
    return int((values < 1e-12 * values[-1]).sum())


def zero_mode_rows() -> Iterator[Row]:
    """Yield the zero modes of one element; folded ones are flat each for itself."""
    for shape in SHAPES[:4]:
        count, what = zero_modes(shape), f"zero-energy modes, {shape}"
        yield Row("free element", what, 6, count, 0.0, "rigid motions", "absolute")


def patch_rows() -> Iterator[Row]:
    """Fields of MacNeal and Harder, imposed at the outer nodes."""
    ring = np.column_stack([PATCH, np.zeros(8)])
    kinds = {
        "quads": (ring, PATCH_QUADS),
        "triangles": (ring, halve(PATCH_QUADS)),
        "nine-node quads": with_nine_nodes(*_distorted_grid()),
    }
    for kind, (X, quads) in kinds.items():
        yield from _patch(kind, X, quads)


def _distorted_grid() -> tuple[Array, np.ndarray]:
    """3 x 3 quads on the patch's rectangle, their inner nodes moved."""
    X, quads = plate(0.24, 0.12, 3, 3)
    inside = (X[:, 0] % 0.24 > 1e-9) & (X[:, 1] % 0.12 > 1e-9)
    X[inside, :2] += np.random.default_rng(9).uniform(-0.01, 0.01, (inside.sum(), 2))
    return X, quads


def _patch(kind: str, X: Array, quads: np.ndarray) -> Iterator[Row]:
    x, y, o = X.T
    size, outer = np.ptp(X, axis=0)[:2], np.zeros(len(X), dtype=bool)
    for k in range(2):
        outer |= np.isclose(X[:, k], 0) | np.isclose(X[:, k], size[k])
    fields = {
        "membrane": (1e-3 * np.column_stack([x + y / 2, y + x / 2, o]), np.zeros_like(X)),
        "bending": (
            1e-3 * np.column_stack([o, o, (x**2 + x * y + y**2) / 2]),
            -1e-3 * np.column_stack([x + y / 2, y + x / 2, o]),
        ),
    }
    model = clamp(sheet(X, quads, 1e6, 0.25, 1e-3), np.flatnonzero(outer))
    for name, (u, turn) in fields.items():
        values = sheets.in_basis(model, u, turn)
        seen, turned = sheets.linear_response(model, np.zeros_like(X), values)
        error = max(_relative(seen, u), _relative(turned, turn))
        source = "MacNeal, Harder 1985; relative error at the inner nodes"
        yield Row("patch test", f"{name}, {kind}", 1e-10, error, 0.0, source, "bound")


def _relative(seen: Array, exact: Array) -> float:
    return float(np.abs(seen - exact).max() / (np.abs(exact).max() or 1.0))


def rows() -> Iterator[Row]:
    """Yield the rows of this table."""
    yield from patch_rows()
    yield from rigid_rows()
    yield from zero_mode_rows()
    yield from law_rows()
