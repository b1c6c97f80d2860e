"""Small deflections: the linear obstacle course, and closed forms of plates and beams."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cosim.verification import Row

from ..mesh_geometry import node_areas
from ..shell import Array
from .paths import error_order, halving_order
from .sheets import clamped, grid, linear_response, mirrored, nine_noded, plate, sheet

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
    w = linear_response(mirrored(model, mirror, held), load)[0][:, 2].max()
    bending, k2 = modulus * thickness**3 / 12 / (1 - poisson**2), 2 * np.pi**2
    shear = SHEAR * modulus / (2 * (1 + poisson)) * thickness
    return float(w / (1 / (bending * k2**2) + 1 / (shear * k2)) - 1)


def plate_rows() -> Iterator[Row]:
    for thickness in (0.1, 1e-3, 1e-5):
        coarse, fine = plate_error(8, thickness), plate_error(16, thickness)
        yield Row(
            f"square plate, h/L = {thickness:g}", "middle deflection / exact", 1.0, 1 + fine, 0.005,
            "exact: Mindlin plate under p sin sin; 16 x 16 a quarter",
            order=error_order(coarse, fine),
        )  # fmt: skip


def roof_deflection(n: int, nine: bool = False) -> float:
    """Deflection of the free edge's middle of the Scordelis-Lo roof: a quarter, R = 25, L = 50, t =
    0.25, 40 degrees, E = 4.32e8, nu = 0, 90 per area; of n x n elements, or a quarter as
    many of nine nodes, as many nodes."""
    side = n // 2 if nine else n
    uv, quads = grid(side, side)
    if nine:
        uv, quads = nine_noded(uv, quads)
    angle = np.deg2rad(40) * uv[:, 1]
    D = np.column_stack([0 * angle, np.sin(angle), np.cos(angle)])
    X = 25 * D + np.outer(uv[:, 0], [25.0, 0, 0])
    model = sheet(X, quads, 4.32e8, 0.0, 0.25, directors=D)
    middle, crown, diaphragm = uv[:, 0] == 0, uv[:, 1] == 0, uv[:, 0] == 1
    none = np.zeros_like(middle)
    mirror = np.column_stack([middle, crown, none])
    held = np.column_stack([none, diaphragm, diaphragm])
    load = np.outer(node_areas(X, quads), [0.0, 0, -90])
    u = linear_response(mirrored(model, mirror, held), load)[0]
    return float(-u[middle & (uv[:, 1] == 1), 2][0])


def roof_rows() -> Iterator[Row]:
    found = np.array([roof_deflection(n) for n in (8, 16, 32)])
    source = "0.3024: MacNeal, Harder 1985, as quoted in the Kratos wiki, shell obstacle course; "
    order = halving_order(*found)
    name, quantity = "Scordelis-Lo roof", "edge deflection"
    yield Row(name, f"{quantity}, 16 x 16", 0.3024, found[1], 0.015, source + "a quarter")
    yield Row(
        name, f"{quantity}, 32 x 32", 0.3024, found[2], 0.01, source + "a quarter", order=order
    )
    found = np.array([roof_deflection(n, nine=True) for n in (8, 16, 32)])
    yield Row(
        name, f"{quantity}, 16 x 16 of nine nodes", 0.3024, found[2], 0.01, source + "a quarter",
        order=halving_order(*found),
    )  # fmt: skip


def pinched_cylinder(n: int) -> float:
    """Deflection under the load of a pinched cylinder with end diaphragms, over P / (E t): an
    eighth, R = 300, L = 600, t = 3, E = 3e6, nu = 0.3."""
    uv, quads = grid(n, n)
    turn = np.pi / 2 * uv[:, 1]
    D = np.column_stack([0 * turn, np.sin(turn), np.cos(turn)])
    D[np.abs(D) < 1e-15] = 0.0
    X = 300 * D + np.outer(uv[:, 0], [300.0, 0, 0])
    model = sheet(X, quads, 3e6, 0.3, 3.0, directors=D)
    mirror = np.column_stack([uv[:, 0] == 0, uv[:, 1] == 0, uv[:, 1] == 1])
    held = np.outer(uv[:, 0] == 1, [False, True, True])
    load = np.zeros_like(X)
    top = np.flatnonzero((uv[:, 0] == 0) & (uv[:, 1] == 0))[0]
    load[top, 2] = -0.25
    u = linear_response(mirrored(model, mirror, held), load)[0]
    return float(-u[top, 2] * 3e6 * 3)


def pinched_cylinder_rows() -> Iterator[Row]:
    found = np.array([pinched_cylinder(n) for n in (16, 32, 64)])
    source = "164.24: Lindberg, Olson, Cowper 1969, as quoted in the OpenSees gallery, shell-0002; "
    order = halving_order(*found)
    for k, (n, within) in enumerate(((32, 0.015), (64, 0.01)), 1):
        yield Row(
            "pinched cylinder, linear", f"deflection E t / P, {n} x {n}", 164.24, found[k], within,
            source + "an eighth", order=order if n == 64 else None,
        )  # fmt: skip


def twisted_beam(thickness: float, along_: int, across_: int) -> Array:
    """Tip deflections along y and z of a beam twisted by 90 degrees under unit tip forces: length
    12, width 1.1, E = 29e6, nu = 0.22."""
    uv, quads = grid(along_, across_)
    turn, across = np.pi / 2 * uv[:, 0], 1.1 * (uv[:, 1] - 0.5)
    radial = np.column_stack([0 * turn, np.cos(turn), np.sin(turn)])
    X = np.outer(uv[:, 0], [12.0, 0, 0]) + across[:, None] * radial
    along = np.array([12.0, 0, 0]) + np.pi / 2 * across[:, None] * np.cross([1.0, 0, 0], radial)
    D = np.cross(along, radial)
    D /= np.linalg.norm(D, axis=1, keepdims=True)
    model = sheet(X, quads, 29e6, 0.22, thickness, directors=D)
    model = clamped(model, np.flatnonzero(uv[:, 0] == 0))
    weight = np.where(np.isin(uv[:, 1], [0, 1]), 0.5, 1.0) * (uv[:, 0] == 1)
    weight /= weight.sum()
    out = [weight @ linear_response(model, np.outer(weight, e))[0] @ e for e in np.eye(3)[1:]]
    return np.array(out)


def twisted_beam_rows() -> Iterator[Row]:
    cases = {
        0.32: ((1.754e-3, 5.424e-3), 1.0, "MacNeal, Harder 1985"),
        0.0032: ((1.294e-3, 5.256e-3), 1e-6, "Simo, Fox, Rifai 1989"),
    }
    for thickness, (target, force, origin) in cases.items():
        found = [force * twisted_beam(thickness, 12 * k, 2 * k) for k in (1, 2, 4)]
        source = f"{origin}, as quoted in FinEtoolsFlexStructures; 48 x 8"
        for i, name in enumerate(("y", "z")):
            yield Row(
                f"twisted beam, t = {thickness}", f"tip along {name}", target[i],
                float(found[-1][i]), 0.01, source, order=halving_order(*(f[i] for f in found)),
            )  # fmt: skip


def upright_cantilever(n: int) -> tuple[float, float]:
    """Tip deflection of a cantilever of 10 x 1 under 1 in its own plane, n quads along it and one
    over its height, 0.1 thick, E = 1.2e6, nu = 0; and Timoshenko's."""
    modulus, length, h = 1.2e6, 10.0, 0.1
    X, quads = plate(length, 1.0, n, 1)
    model = clamped(sheet(X, quads, modulus, 0.0, h), np.flatnonzero(X[:, 0] == 0))
    tip = X[:, 0] == length
    v = linear_response(model, np.outer(tip, [0, 0.5, 0]))[0][tip, 1].mean()
    return float(v), length**3 / (3 * modulus * h / 12) + length / (SHEAR * modulus / 2 * h)


def cook(n: int) -> float:
    """Deflection of the middle of the loaded edge of Cook's membrane: a tapered panel of 48, its
    edges 44 and 16, E = 1, nu = 1/3, thickness 1, sheared by 1."""
    uv, quads = grid(n, n)
    x = 48 * uv[:, 0]
    y = 44 * uv[:, 0] + uv[:, 1] * (44 - 28 * uv[:, 0])
    X = np.column_stack([x, y, 0 * x])
    model = clamped(sheet(X, quads, 1.0, 1 / 3, 1.0), np.flatnonzero(uv[:, 0] == 0))
    edge = uv[:, 0] == 1
    weight = np.where(np.isin(uv[edge, 1], [0, 1]), 0.5, 1.0) / n
    load = np.zeros_like(X)
    load[edge, 1] = weight
    u = linear_response(model, load)[0]
    return float(u[edge & (uv[:, 1] == 0.5), 1][0])


def in_plane_rows() -> Iterator[Row]:
    """Where bilinear quads lock: they deflect 11 and 8 % too little on the coarser meshes here."""
    (coarse, exact), (fine, _) = upright_cantilever(20), upright_cantilever(40)
    order = error_order(coarse - exact, fine - exact)
    source = "exact: Timoshenko beam"
    for n, value, within in ((20, coarse, 0.04), (40, fine, 0.01)):
        yield Row(
            "cantilever bent in its plane", f"tip deflection, {n} x 1", exact, value, within,
            source, order=order if n == 40 else None,
        )  # fmt: skip
    found = [cook(n) for n in (4, 8, 16)]
    source = "23.96: Cook 1989, as quoted in the gallery of solver-docs.pages.dev"
    for n, value, within in zip((8, 16), found[1:], (0.05, 0.015), strict=True):
        yield Row(
            "Cook's membrane", f"deflection, {n} x {n}", 23.96, value, within, source,
            order=halving_order(*found) if n == 16 else None,
        )  # fmt: skip


def hemisphere(n: int, distortion: float, thickness: float = 0.04) -> Array:
    """Deflections under the loads of a quarter of a hemisphere with an 18 degree hole, pulled out
    along x and pushed in along y by unit forces: radius 10, E = 6.825e7, nu = 0.3; the mesh lines
    bent within the edges by `distortion`."""
    uv, quads = grid(n, n)
    bow = distortion * uv * (1 - uv) * (2 * uv[:, ::-1] - 1)
    round_, up = np.pi / 2 * (uv + bow)[:, 0], np.deg2rad(72) * (uv + bow)[:, 1]
    D = np.column_stack([np.cos(round_) * np.cos(up), np.sin(round_) * np.cos(up), np.sin(up)])
    D[np.abs(D) < 1e-15] = 0.0
    model = sheet(10 * D, quads, 6.825e7, 0.3, thickness, directors=D)
    pulled, pushed = D[:, 0] == 1, D[:, 1] == 1
    mirror = np.column_stack([D[:, 0] == 0, D[:, 1] == 0, np.zeros(len(D), dtype=bool)])
    held = np.outer(pulled, [False, False, True])
    load = np.outer(pulled, [1.0, 0, 0]) - np.outer(pushed, [0, 1.0, 0])
    u = linear_response(mirrored(model, mirror, held), load)[0]
    return np.array([u[pulled, 0][0], -u[pushed, 1][0]])


def hemisphere_rows() -> Iterator[Row]:
    source = "0.0930: Ko, Lee, Lee, Bathe 2017, as quoted in FinEtoolsFlexStructures; a quarter"
    name = "hemisphere, 18 deg hole, linear"
    for distortion in (0.0, 0.4, 0.8):
        found = np.array([hemisphere(n, distortion)[0] for n in (8, 16, 32)])
        how = f", lines bent by {distortion}" if distortion else ""
        yield Row(name, f"deflection, 8 x 8{how}", 0.093, found[0], 0.03, source)
        yield Row(name, f"deflection, 32 x 32{how}", 0.093, found[2], 0.01, source)


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
    model = clamped(sheet(X, quads, modulus, 0.0, h, fibre=between), np.flatnonzero(s == 0))
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
        found, exact = bracket(32, np.deg2rad(degrees))
        what = f"cantilever folded by {degrees} deg"
        yield Row(
            what, "tip deflection", exact, found, 2e-3, "Timoshenko beams; 32 elements an arm"
        )


def taper(n: int) -> tuple[float, float]:
    """Tip deflection of a cantilever of 10 x 1 under 1 across, its thickness 0.1 (1 - x / 2L), E =
    1.2e6, nu = 0, and beam theory's."""
    modulus, length, h, slope = 1.2e6, 10.0, 0.1, 0.5
    X, quads = plate(length, 1.0, n, 1)
    thickness = h * (1 - slope * X[:, 0] / length)
    model = clamped(sheet(X, quads, modulus, 0.0, thickness), np.flatnonzero(X[:, 0] == 0))
    tip = X[:, 0] == length
    w = linear_response(model, np.outer(tip, [0, 0, 0.5]))[0][tip, 2].mean()
    left = 1 - slope
    bending = (-np.log(left) + 2 * left - left**2 / 2 - 1.5) / slope**3
    exact = bending * length**3 / (modulus * h**3 / 12)
    return float(w), float(exact - np.log(left) / slope * length / (SHEAR * modulus / 2 * h))


def taper_rows() -> Iterator[Row]:
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
    model = clamped(model, np.flatnonzero(X[:, 0] == 0))
    tip = X[:, 0] == length
    u = linear_response(model, np.outer(tip, [0.5, 0, 0]))[0][tip].mean(axis=0)
    EI, EA, arm = modulus * h**3 / 12, modulus * h, h / 2
    stretch = length / EA + arm**2 * length / EI
    return u[[0, 2]], np.array([stretch, arm * length**2 / (2 * EI)])


def eccentric_rows() -> Iterator[Row]:
    seen, exact = eccentric(8)
    source = "exact: N / EA + N e^2 / EI, N e L^2 / 2EI; 8 x 1"
    for i, name in enumerate(("x", "z")):
        yield Row("strip pulled at its face", f"tip along {name}", exact[i], seen[i], 1e-8, source)
