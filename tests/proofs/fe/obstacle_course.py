"""The linear obstacle course: published shells under small deflections, by both elements."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from cosim.port import Array
from tests.proofs.fe.benchmark import Benchmark, Meshes
from tests.proofs.fe.paths import watching
from tests.proofs.fe.sheets import (
    clamp,
    elements,
    line_weights,
    linear_response,
    mirror_plane,
    sheet,
    surface_weights,
)

RANDOM = 0.25
"""Most that a random mesh moves a corner, of an element's sides."""


def roof(n: int, nodes: int, shift: float = 0.0) -> list[float]:
    """Deflection of the middle of the free edge of a quarter of the Scordelis-Lo roof."""
    uv, quads = elements(n, n, nodes, shift)
    angle = np.deg2rad(40) * uv[:, 1]
    D = np.column_stack([0 * angle, np.sin(angle), np.cos(angle)])
    X = 25 * D + np.outer(uv[:, 0], [25.0, 0, 0])
    model = sheet(X, quads, 4.32e8, 0.0, 0.25, directors=D)
    middle, crown, diaphragm = uv[:, 0] == 0, uv[:, 1] == 0, uv[:, 0] == 1
    none = np.zeros_like(middle)
    mirror = np.column_stack([middle, crown, none])
    held = np.column_stack([none, diaphragm, diaphragm])
    load = np.outer(surface_weights(model), [0.0, 0, -90])
    u = linear_response(mirror_plane(model, mirror, held), load)[0]
    return [float(-u[middle & (uv[:, 1] == 1), 2][0])]


ROOF = Benchmark(
    "Scordelis-Lo roof",
    "a quarter of R = 25, L = 50, 40 degrees, t = 0.25, E = 4.32e8, nu = 0, 90 per area, ends held "
    "by diaphragms",
    {"edge deflection": 0.3024},
    "0.3024: MacNeal, Harder 1985, as quoted in the Kratos wiki, shell obstacle course",
    roof,
    {4: Meshes((8, 16, 32)), 9: Meshes((4, 8, 16))},
)


def pinched_cylinder(n: int, nodes: int) -> list[float]:
    """Deflection under the load of an eighth of the pinched cylinder, over P / (E t)."""
    uv, quads = elements(n, n, nodes)
    turn = np.pi / 2 * uv[:, 1]
    D = np.column_stack([0 * turn, np.sin(turn), np.cos(turn)])
    D[np.abs(D) < 1e-15] = 0.0
    X = 300 * D + np.outer(uv[:, 0], [300.0, 0, 0])
    model = sheet(X, quads, 3e6, 0.3, 3.0, directors=D)
    mirror = np.column_stack([uv[:, 0] == 0, uv[:, 1] == 0, uv[:, 1] == 1])
    held = np.outer(uv[:, 0] == 1, [False, True, True])
    top = np.flatnonzero((uv[:, 0] == 0) & (uv[:, 1] == 0))[0]
    load = watching(top, np.array([0, 0, -0.25]), len(X))
    u = linear_response(mirror_plane(model, mirror, held), load)[0]
    return [float(-u[top, 2] * 3e6 * 3)]


PINCHED_CYLINDER = Benchmark(
    "pinched cylinder, linear",
    "an eighth of R = 300, L = 600, t = 3, E = 3e6, nu = 0.3, end diaphragms, opposite forces P, "
    "under which a shell that shears gives way without bound as its mesh is refined",
    {"deflection E t / P": 164.24},
    "164.24: Lindberg, Olson, Cowper 1969, as quoted in the OpenSees gallery, shell-0002",
    pinched_cylinder,
    {4: Meshes((16, 32, 64)), 9: Meshes((4, 8, 16))},
)


def twisted_beam(thickness: float, force: float, n: int, nodes: int) -> list[float]:
    """Tip deflections along y and z of the twisted beam under tip forces along them."""
    uv, quads = elements(6 * n, n, nodes)
    turn, across = np.pi / 2 * uv[:, 0], 1.1 * (uv[:, 1] - 0.5)
    radial = np.column_stack([0 * turn, np.cos(turn), np.sin(turn)])
    X = np.outer(uv[:, 0], [12.0, 0, 0]) + across[:, None] * radial
    along = np.array([12.0, 0, 0]) + np.pi / 2 * across[:, None] * np.cross([1.0, 0, 0], radial)
    D = np.cross(along, radial)
    D /= np.linalg.norm(D, axis=1, keepdims=True)
    model = sheet(X, quads, 29e6, 0.22, thickness, directors=D)
    model = clamp(model, np.flatnonzero(uv[:, 0] == 0))
    tip = np.flatnonzero(uv[:, 0] == 1)
    weight = np.zeros(len(X))
    weight[tip] = line_weights(across[tip], nodes) / 1.1
    deflections = [linear_response(model, np.outer(weight, e))[0] @ e for e in np.eye(3)[1:]]
    return [float(force * weight @ u) for u in deflections]


def twisted_beam_benchmark(
    thickness: float, force: float, y: float, z: float, source: str
) -> Benchmark:
    """The benchmark of the twisted beam."""
    return Benchmark(
        f"twisted beam, t = {thickness}",
        "cantilever twisted by 90 degrees, length 12, width 1.1, E = 29e6, nu = 0.22, tip forces "
        f"of {force:g}",
        {"tip along y": y, "tip along z": z},
        f"{source}, as quoted in FinEtoolsFlexStructures",
        partial(twisted_beam, thickness, force),
        {4: Meshes((2, 4, 8)), 9: Meshes((1, 2, 4))},
        lambda n: f"{6 * n} x {n}",
    )


TWISTED_BEAMS = (
    twisted_beam_benchmark(0.32, 1.0, 1.754e-3, 5.424e-3, "MacNeal, Harder 1985"),
    twisted_beam_benchmark(0.0032, 1e-6, 1.294e-3, 5.256e-3, "Simo, Fox, Rifai 1989"),
)


def cook(n: int, nodes: int, shift: float = 0.0) -> list[float]:
    """Deflection of the middle of the loaded edge of Cook's membrane."""
    uv, quads = elements(n, n, nodes, shift)
    x = 48 * uv[:, 0]
    y = 44 * uv[:, 0] + uv[:, 1] * (44 - 28 * uv[:, 0])
    X = np.column_stack([x, y, 0 * x])
    model = clamp(sheet(X, quads, 1.0, 1 / 3, 1.0), np.flatnonzero(uv[:, 0] == 0))
    edge = np.flatnonzero(uv[:, 0] == 1)
    load = np.zeros_like(X)
    load[edge, 1] = line_weights(uv[edge, 1], nodes)
    u = linear_response(model, load)[0]
    return [float(u[edge[uv[edge, 1] == 0.5], 1][0])]


COOK = Benchmark(
    "Cook's membrane",
    "tapered panel of 48, edges of 44 and 16, E = 1, nu = 1/3, t = 1, clamped, edge sheared by 1",
    {"deflection of the edge's middle": 23.96},
    "23.96: Cook 1989, as quoted in the gallery of solver-docs.pages.dev",
    cook,
    {4: Meshes((8, 16, 32), also={8: 0.05}), 9: Meshes((2, 4, 8))},
)


def hemisphere(distortion: float, n: int, nodes: int, thickness: float = 0.04) -> list[float]:
    """Deflection under the loads of a quarter of the hemisphere with a hole; the mesh lines bent
    within the edges by `distortion`."""
    uv, quads = elements(n, n, nodes)
    bow = distortion * uv * (1 - uv) * (2 * uv[:, ::-1] - 1)
    round_, up = np.pi / 2 * (uv + bow)[:, 0], np.deg2rad(72) * (uv + bow)[:, 1]
    D = np.column_stack([np.cos(round_) * np.cos(up), np.sin(round_) * np.cos(up), np.sin(up)])
    D[np.abs(D) < 1e-15] = 0.0
    model = sheet(10 * D, quads, 6.825e7, 0.3, thickness, directors=D)
    pulled, pushed = D[:, 0] == 1, D[:, 1] == 1
    mirror = np.column_stack([D[:, 0] == 0, D[:, 1] == 0, np.zeros(len(D), dtype=bool)])
    held = np.outer(pulled, [False, False, True])
    load = np.outer(pulled, [1.0, 0, 0]) - np.outer(pushed, [0, 1.0, 0])
    u = linear_response(mirror_plane(model, mirror, held), load)[0]
    return [float(u[pulled, 0][0])]


def hemisphere_benchmark(distortion: float) -> Benchmark:
    """The benchmark of the hemisphere."""
    bent = f", mesh lines bent by {distortion}" if distortion else ""
    return Benchmark(
        f"hemisphere with a hole{bent}",
        "a quarter of R = 10, t = 0.04, hole of 18 degrees, E = 6.825e7, nu = 0.3, unit forces "
        "outward and inward (2 on the whole)",
        {"deflection": 0.0930},
        "0.0930: Ko, Lee, Lee, Bathe 2017, as quoted in FinEtoolsFlexStructures",
        partial(hemisphere, distortion),
        {4: Meshes((8, 16, 32), also={8: 0.03}), 9: Meshes((4, 8, 16))},
    )


HEMISPHERES = tuple(hemisphere_benchmark(distortion) for distortion in (0.0, 0.4, 0.8))


def hyperbolic_paraboloid(thickness: float, n: int, nodes: int) -> list[float]:
    """Deflection of the middle of the free edge opposite the clamped one, of the half beside the
    mirror plane y = 0; n x n/2 elements."""
    uv, quads = elements(n, n // 2, nodes)
    x, y = uv[:, 0] - 0.5, uv[:, 1] / 2
    X = np.column_stack([x, y, x**2 - y**2])
    D = np.column_stack([-2 * x, 2 * y, np.ones_like(x)])
    D /= np.linalg.norm(D, axis=1, keepdims=True)
    model = sheet(X, quads, 2e11, 0.3, thickness, directors=D)
    wall = uv[:, 0] == 0
    model = clamp(model, np.flatnonzero(wall))
    mirror = np.outer((y == 0) & ~wall, [False, True, False])
    load: Array = np.outer(surface_weights(model), [0, 0, -8000 * thickness])
    u = linear_response(mirror_plane(model, mirror), load)[0]
    return [float(-u[(uv[:, 0] == 1) & (y == 0), 2][0])]


def hyperbolic_paraboloid_benchmark(slenderness: float, target: float) -> Benchmark:
    """The benchmark of the hyperbolic paraboloid."""
    return Benchmark(
        f"hyperbolic paraboloid, t/L = {slenderness:g}",
        "half of z = x^2 - y^2, sides L = 1, E = 2e11, nu = 0.3, clamped at x = -L/2, weight 8000 "
        "per volume",
        {"edge deflection": target},
        "Bathe, Iosilevich, Chapelle 2000, Comput Struct 75:1, table 2, as quoted in "
        "FinEtoolsFlexStructures, clamped_hypar_examples",
        partial(hyperbolic_paraboloid, slenderness),
        {4: Meshes((24, 48, 96)), 9: Meshes((8, 16, 32))},
        lambda n: f"{n} x {n // 2}",
    )


HYPERBOLIC_PARABOLOIDS = tuple(
    hyperbolic_paraboloid_benchmark(*case)
    for case in ((1e-2, 9.3355e-5), (1e-3, 6.3941e-3), (1e-4, 0.52988))
)

RANDOM_MESHES = tuple(
    replace(b, name=f"{b.name}, random mesh", solve=partial(solve, shift=RANDOM), meshes=meshes)
    for b, solve, meshes in (
        (ROOF, roof, {4: Meshes((8, 16, 32)), 9: Meshes((4, 8, 16))}),
        (COOK, cook, {4: Meshes((8, 16, 32)), 9: Meshes((4, 8, 16))}),
    )
)
