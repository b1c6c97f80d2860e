"""Large deflections: the benchmarks of Sze, Liu and Lo 2004, Finite Elem Anal Des 40:1551.

The published figures are those of Abaqus' S4R on fine meshes.  They are taken from public sources
that quote them, named in each row.  Of the eight problems the pinched cylinder with rigid
diaphragms is left out: no source that states its figures was seen.  The hinged roofs are in
`limit_loads`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.linalg import norm

from cosim.errors import ConvergenceError
from cosim.port import Array, rotation_matrix
from fe_solver.solver.body_coupling import coupling, wrenches
from fe_solver.solver.model import Configuration, ShellModel
from fe_solver.solver.newton_step import factorise
from fe_solver.solver.residual import residual_norm
from tests.helpers.rows import Row
from tests.proofs.fe.benchmark import Benchmark, Meshes
from tests.proofs.fe.paths import Loading, error_order, follow, halving_order, watching
from tests.proofs.fe.sheets import (
    at_rest,
    clamp,
    elements,
    grid,
    line_weights,
    mirror_plane,
    plate,
    sheet,
)

TWENTIETHS = np.arange(1, 21) / 20
SZE = "Sze, Liu, Lo 2004"
ELMER = "as quoted in the tests of elmerfem,"
SHEAR_U = np.array(
    "0.026 0.103 0.224 0.381 0.563 0.763 0.971 1.184 1.396 1.604 "
    "1.807 2.002 2.190 2.370 2.541 2.705 2.861 3.010 3.151 3.286".split(),
    dtype=float,
)
SHEAR_W = np.array(
    "0.663 1.309 1.922 2.493 3.015 3.488 3.912 4.292 4.631 4.933 "
    "5.202 5.444 5.660 5.855 6.031 6.190 6.335 6.467 6.588 6.698".split(),
    dtype=float,
)
SHEAR_SOURCE = f"{SZE}, {ELMER} Shell_Cantilever_High_Order"
ROUNDED = 0.0005
"""Rounding error of a published figure with three decimals."""
COARSER = 4.0
"""Tolerance on a mesh half as fine, over that on the finest: the element converges by order two."""


def cantilever(n: int, nodes: int = 4) -> Loading:
    """A strip of 10 x 1 x 0.1, E = 1.2e6, nu = 0, clamped, under 4 across its end; n elements of
    four or nine `nodes`."""
    uv, quads = elements(n, 1, nodes)
    X = np.column_stack([uv * [10.0, 1.0], 0 * uv[:, 0]])
    model = clamp(sheet(X, quads, 1.2e6, 0.0, 0.1), np.flatnonzero(X[:, 0] == 0))
    tip = np.flatnonzero(X[:, 0] == 10)
    load = np.zeros_like(X)
    load[tip, 2] = 4 * line_weights(X[tip, 1], nodes)
    n = len(X)
    watched = np.stack([watching(tip[0], np.array(v), n) for v in ([-1.0, 0, 0], [0, 0, 1.0])])
    return Loading(model, load, watched)


def shear_rows() -> Iterator[Row]:
    """All twenty lines of the published table."""
    coarse, medium, fine = (follow(cantilever(n), TWENTIETHS) for n in (8, 16, 32))
    source = f"{SHEAR_SOURCE}; "
    digit = "; of a figure this small, half of its last digit"
    for i, (name, target) in enumerate((("U", SHEAR_U), ("W", SHEAR_W))):
        for k, part in enumerate(TWENTIETHS):
            order = halving_order(coarse[k, i], medium[k, i], fine[k, i]) if part == 1 else None
            # Of a figure of two digits the last one alone is more than half a percent.
            within = max(0.005, ROUNDED / target[k])
            said = f"{source}32 x 1{digit if within > 0.005 else ''}"
            yield Row(
                "cantilever, end shear", f"{name} at {part:.2f} P", target[k], float(fine[k, i]),
                within, said, order=order,
            )  # fmt: skip
        yield Row(
            "cantilever, end shear", f"{name} at 1.00 P, 16 x 1", target[-1],
            float(medium[-1, i]), COARSER * 0.005, f"{source}16 x 1",
        )  # fmt: skip


def roll_up(n: int, parts: Array) -> Array:
    """The displacements U and W (len(parts), 2) of the end of a strip of 12 x 1 x 0.1, E = 1.2e6,
    nu = 0, under growing parts of the end moment that closes it to a circle.

    The end is tied to a body that nothing holds, whose pose is solved for together with the strip:
    the moment acts on the body.  Raises ConvergenceError."""
    length, moment = 12.0, 50 * np.pi / 3
    X, quads = plate(length, 1.0, n, 1)
    model = sheet(X, quads, 1.2e6, 0.0, 0.1, bodies=("ground", "end"))
    model = clamp(model, np.flatnonzero(X[:, 0] == 0))
    model = clamp(model, np.flatnonzero(X[:, 0] == length), body=1)
    origin = np.array([[0.0, 0, 0], [length, 0, 0]])
    ties = replace(model.ties, position=model.ties.position - origin[model.ties.body])
    model = replace(model, ties=ties)
    c, out = replace(at_rest(model), position=origin), []
    for part in parts:
        c = solve_with_free_end(model, c, np.array([0, 0, 0, 0, -moment * part, 0]))
        end = c.x[model.ties.node[-1]] - X[model.ties.node[-1]]
        out.append([-end[0], end[2]])
    return np.array(out)


def solve_with_free_end(model: ShellModel, c: Configuration, wrench: Array) -> Configuration:
    """Equilibrium of the strip and of its last body under `wrench` (6,) about the body's origin,
    from c by whole Newton steps in both.  Raises ConvergenceError."""
    free, slack = model.free, np.zeros(len(model.share))
    for _ in range(60):
        e = model.evaluate(c, slack, tangent=True)
        assert e.data is not None
        out = wrenches(model, c, e, slack)["tie"][-1] + wrench
        if max(residual_norm(model, e)[0], float(np.abs(out).max())) <= 1e-8 * norm(wrench):
            return c
        by_twist, stiff, _, _ = coupling(model, c, e, slack)
        by_twist, stiff = by_twist[free, -6:], stiff[-6:, -6:]
        solved = factorise(model, e.data).solve(np.column_stack([e.reduced[free], by_twist]))
        twist = np.linalg.solve(
            stiff + by_twist.T @ solved[:, 1:], -out - by_twist.T @ solved[:, 0]
        )
        step = np.zeros(model.pattern.size)
        step[free] = -solved[:, 0] - solved[:, 1:] @ twist
        c = _turn_end(model, model.take_step(c, e.bases, step), twist)
    raise ConvergenceError(f"the end of the strip found no balance: {np.abs(out).max():.1e} N m")


def _turn_end(model: ShellModel, c: Configuration, twist: Array) -> Configuration:
    position, rotation = c.position.copy(), c.rotation.copy()
    position[-1] += twist[:3]
    rotation[-1] = rotation_matrix(twist[3:]) @ rotation[-1]
    return model.move_bodies(c, position, rotation)


def moment_rows() -> Iterator[Row]:
    """To a full circle, against the exact circle."""
    coarse, fine = (roll_up(n, TWENTIETHS) for n in (32, 64))
    source = "exact: U = L - R sin(L/R), W = R (1 - cos(L/R)), R = EI/M; "
    for k in (4, 9, 14, 19):
        turn = 2 * np.pi * TWENTIETHS[k]
        exact = np.array([12 - 12 / turn * np.sin(turn), 12 / turn * (1 - np.cos(turn))])
        for i, name in enumerate(("U", "W")):
            order = error_order(coarse[k, i] - exact[i], fine[k, i] - exact[i])
            quantity = f"{name} / L at {TWENTIETHS[k]:.2f} M"
            yield Row(
                "cantilever, end moment", quantity, exact[i] / 12, fine[k, i] / 12, 0.005,
                f"{source}64 x 1", "absolute", order,
            )  # fmt: skip
    for i, name in enumerate(("U", "W")):
        yield Row(
            "cantilever, end moment", f"{name} / L at 1.00 M, 32 x 1", 1.0 - i,
            coarse[-1, i] / 12, COARSER * 0.005, f"{source}32 x 1", "absolute",
        )  # fmt: skip


def end_rows(
    name: str,
    what: str,
    target: float,
    curves: Sequence[Array],
    i: int,
    source: str,
    meshes: tuple[str, str],
) -> Iterator[Row]:
    """The last two of three meshes at the end of the steps, displacement i of those watched."""
    coarse, medium, fine = (float(f[-1, i]) for f in curves)
    yield Row(name, f"{what}, {meshes[0]}", target, medium, COARSER * 0.01, source + meshes[0])
    order = halving_order(coarse, medium, fine)
    yield Row(name, what, target, fine, 0.01, source + meshes[1], order=order)


def slit_ring(around: int, across: int, nodes: int = 4) -> Loading:
    """A flat ring with a radial slit, one side clamped, the other lifted by 0.8 per length: radii 6
    and 10, thickness 0.03, E = 21e6, nu = 0; of elements of four or nine `nodes`."""
    uv, quads = elements(around, across, nodes)
    radius, turn = 6 + 4 * uv[:, 1], 2 * np.pi * uv[:, 0]
    X = np.column_stack([radius * np.cos(turn), -radius * np.sin(turn), 0 * radius])
    model = sheet(X, quads, 21e6, 0.0, 0.03, fibre=(1.0, 0.3, 0.0))
    model = clamp(model, np.flatnonzero(uv[:, 0] == 0))
    end = np.flatnonzero(uv[:, 0] == 1)
    load = np.zeros_like(X)
    load[end, 2] = 0.8 * line_weights(radius[end], nodes)
    corners = [end[uv[end, 1] == side][0] for side in (0, 1)]
    watched = np.stack([watching(k, np.array([0, 0, 1.0]), len(X)) for k in corners])
    return Loading(model, load, watched)


RING_PARTS = np.concatenate([[0.025], TWENTIETHS])
RING_SOURCE = f"{SZE}, as quoted in the PENGoLINS documentation and by FEniCS-Shells"


def ring_rows() -> Iterator[Row]:
    """Yield the rows of the slit ring."""
    curves = [follow(slit_ring(n, a), RING_PARTS) for n, a in ((32, 3), (64, 6), (128, 12))]
    source = f"{RING_SOURCE}; "
    table = {"W_A": (10.023, 13.891), "W_B": (13.247, 17.528)}
    name = "slit annular plate"
    for i, (point, (middle, full)) in enumerate(table.items()):
        yield Row(
            name, f"{point} at 0.45 p", middle, float(curves[-1][9, i]), 0.01, f"{source}128 x 12"
        )
        yield from end_rows(name, f"{point} at p", full, curves, i, source, ("64 x 6", "128 x 12"))


def hemisphere(n: int, nodes: int = 4) -> Loading:
    """A quarter of a hemisphere with an 18 degree hole, pulled out along x and pushed in along y by
    400: radius 10, thickness 0.04, E = 6.825e7, nu = 0.3; of elements of four or nine `nodes`."""
    uv, quads = elements(n, n, nodes)
    round_, up = np.pi / 2 * uv[:, 0], np.deg2rad(72) * uv[:, 1]
    D = np.column_stack([np.cos(round_) * np.cos(up), np.sin(round_) * np.cos(up), np.sin(up)])
    D[np.abs(D) < 1e-15] = 0.0
    model = sheet(10 * D, quads, 6.825e7, 0.3, 0.04, directors=D)
    pulled, pushed = D[:, 0] == 1, D[:, 1] == 1
    mirror = np.column_stack([D[:, 0] == 0, D[:, 1] == 0, np.zeros(len(D), dtype=bool)])
    held = np.zeros_like(mirror)
    held[pulled, 2] = True
    load = 200 * (np.outer(pulled, [1.0, 0, 0]) - np.outer(pushed, [0, 1.0, 0]))
    watched = np.stack([np.outer(pulled, [1.0, 0, 0]), np.outer(pushed, [0, -1.0, 0])])
    return Loading(mirror_plane(model, mirror, held), load, watched)


HEMISPHERE_SOURCE = f"{SZE}, {ELMER} Shell_OpenHemisphere_High_Order"


def hemisphere_rows() -> Iterator[Row]:
    """Yield the rows of the pinched hemisphere."""
    curves = [follow(hemisphere(n), TWENTIETHS) for n in (8, 16, 32)]
    source = f"{HEMISPHERE_SOURCE}; "
    table = {"outward": (3.406, 4.067), "inward": (5.902, 8.178)}
    name = "hemisphere, 18 deg hole, P = 400"
    for i, (way, (half, full)) in enumerate(table.items()):
        yield Row(name, f"{way} at 0.50 P", half, float(curves[-1][9, i]), 0.01, f"{source}32 x 32")
        yield from end_rows(name, f"{way} at P", full, curves, i, source, ("16 x 16", "32 x 32"))


def open_cylinder(n: int) -> Loading:
    """An eighth of an open cylinder pulled apart by two opposite forces of 40 000: radius 4.953,
    length 10.35, thickness 0.094, E = 10.5e6, nu = 0.3125; n x 3n/2 elements."""
    uv, quads = grid(n, 3 * n // 2)
    turn = np.pi / 2 * uv[:, 1]
    D = np.column_stack([0 * turn, np.sin(turn), np.cos(turn)])
    D[np.abs(D) < 1e-15] = 0.0
    X = 4.953 * D + np.outer(uv[:, 0], [10.35 / 2, 0, 0])
    model = sheet(X, quads, 10.5e6, 0.3125, 0.094, directors=D)
    mirror = np.column_stack([uv[:, 0] == 0, uv[:, 1] == 0, uv[:, 1] == 1])
    a = np.flatnonzero((uv[:, 0] == 0) & (uv[:, 1] == 0))[0]
    b, c = (np.flatnonzero((uv[:, 0] == at) & (uv[:, 1] == 1))[0] for at in (0, 1))
    up, inward = np.array([0, 0, 1.0]), np.array([0, -1.0, 0])
    n = len(X)
    watched = np.stack([watching(a, up, n), watching(b, inward, n), watching(c, inward, n)])
    return Loading(mirror_plane(model, mirror), watching(a, 10_000 * up, n), watched)


def open_cylinder_rows() -> Iterator[Row]:
    """Coarse meshes only up to 0.1 P: beyond half the load the cylinder snaps, and theirs have two
    shapes there, of which rounding error chooses."""
    start = np.array([0.0125, 0.025, 0.05, 0.075, 0.1])
    curves = [follow(open_cylinder(n), start) for n in (6, 12)]
    parts = np.concatenate([start, np.arange(5, 41) / 40])
    fine = follow(open_cylinder(24), parts)
    source = f"{SZE}, as quoted in public OpenSeesPy and Matlab scripts; "
    name, meshes = "open cylinder, pull-out", ("12 x 18", "24 x 36")
    at = {0.3: (2.257, 3.227, 3.452), 0.7: (2.672, 4.385, 3.378), 1.0: (2.768, 4.551, 3.269)}
    for i, (point, target) in enumerate(zip("ABC", (1.707, 2.217, 2.293), strict=True)):
        what, all_ = f"deflection of {point} at 0.1 P", [*curves, fine[: len(start)]]
        yield from end_rows(name, what, target, all_, i, source, meshes)
    for part, targets in at.items():
        k = int(np.argmin(np.abs(parts - part)))
        for i, (point, target) in enumerate(zip("ABC", targets, strict=True)):
            what = f"deflection of {point} at {part:.1f} P"
            yield Row(name, what, target, float(fine[k, i]), 0.01, source + meshes[1])


def half_cylinder(n: int, nodes: int = 4) -> Loading:
    """Half of a clamped half cylinder under 2000 across its free end's crown: radius 1.016, length
    3.048, thickness 0.03, E = 2.0685e7, nu = 0.3; its straight edges slide on a mirror plane; the
    directors are the normals of the quads, which point inwards; of elements of four or nine
    `nodes`."""
    uv, quads = elements(n, n, nodes)
    turn = np.pi / 2 * uv[:, 1]
    D = np.column_stack([np.sin(turn), 0 * turn, np.cos(turn)])
    D[np.abs(D) < 1e-15] = 0.0
    X = 1.016 * D + np.outer(uv[:, 0], [0, 3.048, 0])
    model = sheet(X, quads, 2.0685e7, 0.3, 0.03, directors=-D, fibre=(0, 1.0, 0))
    wall = uv[:, 0] == 0
    model = clamp(model, np.flatnonzero(wall))
    none = np.zeros(len(X), dtype=bool)
    mirror = np.column_stack([uv[:, 1] == 0, none, uv[:, 1] == 1]) & ~wall[:, None]
    crown = int(np.flatnonzero((uv[:, 0] == 1) & (uv[:, 1] == 0))[0])
    down = watching(crown, np.array([0, 0, -1.0]), len(X))
    return Loading(mirror_plane(model, mirror), 1000 * down, down[None])


FORTIETHS = np.arange(1, 41) / 40
HALF_CYLINDER_SOURCE = f"{SZE}, as quoted in the FEniCS-Shells demo nonlinear-naghdi-cylindrical"


def half_cylinder_rows() -> Iterator[Row]:
    """Yield the rows of the half cylinder."""
    # on 14 x 14 quads or fewer the free end folds up: no solution
    curves = [follow(half_cylinder(n), FORTIETHS) for n in (20, 40)]
    source = f"{HALF_CYLINDER_SOURCE}; "
    name = "pinched half cylinder"
    for part, target in ((0.2, 0.37582), (0.5, 1.32653)):
        seen = float(curves[-1][round(40 * part) - 1, 0])
        yield Row(name, f"W at {part:.1f} P", target, seen, 0.01, f"{source}40 x 40")
    target, what = 1.71505, "W at 1.0 P"
    coarse, fine = (float(f[-1, 0]) for f in curves)
    order = error_order(coarse - target, fine - target)
    yield Row(name, f"{what}, 20 x 20", target, coarse, COARSER * 0.01, f"{source}20 x 20")
    yield Row(name, what, target, fine, 0.01, f"{source}40 x 40", order=order)


END_SHEAR = Benchmark(
    "cantilever, end shear",
    "10 x 1 x 0.1, E = 1.2e6, nu = 0, 4 across the end",
    {"U at P": SHEAR_U[-1], "W at P": SHEAR_W[-1]},
    SHEAR_SOURCE,
    lambda n, nodes: follow(cantilever(n, nodes), TWENTIETHS)[-1],
    {9: Meshes((4, 8, 16), 0.005)},
    lambda n: f"{n} x 1",
)
NINE_NODE_PATHS = (
    Benchmark(
        "slit annular plate",
        "radii 6 and 10, t = 0.03, E = 21e6, nu = 0, 0.8 per length across one side of the slit",
        {"W_A at 0.45 p": 10.023, "W_B at 0.45 p": 13.247, "W_A at p": 13.891, "W_B at p": 17.528},
        RING_SOURCE,
        lambda n, nodes: follow(slit_ring(8 * n, n, nodes), RING_PARTS)[[9, -1]].ravel(),
        {9: Meshes((1, 2, 4))},
        lambda n: f"{8 * n} x {n}",
    ),
    Benchmark(
        "hemisphere, 18 deg hole, P = 400",
        "a quarter of R = 10, t = 0.04, E = 6.825e7, nu = 0.3",
        {
            "outward at 0.50 P": 3.406,
            "inward at 0.50 P": 5.902,
            "outward at P": 4.067,
            "inward at P": 8.178,
        },
        HEMISPHERE_SOURCE,
        lambda n, nodes: follow(hemisphere(n, nodes), TWENTIETHS)[[9, -1]].ravel(),
        {9: Meshes((4, 8, 16))},
    ),
    Benchmark(
        "pinched half cylinder",
        "half of R = 1.016, length 3.048, t = 0.03, E = 2.0685e7, nu = 0.3, P = 2000",
        {"W at 0.2 P": 0.37582, "W at 0.5 P": 1.32653, "W at P": 1.71505},
        HALF_CYLINDER_SOURCE,
        lambda n, nodes: follow(half_cylinder(n, nodes), FORTIETHS)[[7, 19, -1]].ravel(),
        {9: Meshes((8, 16))},
    ),
)
"""Benchmarks of nine-node elements alone: those of four are in the rows above."""
