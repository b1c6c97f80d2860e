"""Published shell problems and closed forms, as functions that measure what they are judged by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..hood_model import node_areas
from ..model import Configuration
from ..newton import solve
from ..shell import Array
from . import sheets
from .sheets import BENCHMARK, NO_TENSION, at_rest, clamped, plate, sheet


def arc(X: Array, D: Array, angle: float, length: float) -> Configuration:
    """A strip along x rolled onto an arc that turns by `angle` (rad), towards +z."""
    radius, turn = length / angle, X[:, 0] / length * angle
    x = np.column_stack([radius * np.sin(turn), X[:, 1], radius * (1 - np.cos(turn))])
    d = np.column_stack([-np.sin(turn), 0 * turn, np.cos(turn)])
    return Configuration(x, d, *sheets.GROUND)


def rolled_moment(elements: int) -> tuple[Array, Array]:
    """Force and moment, over E I / R, on a body that holds the end of a strip rolled into a full
    circle by another body at its start."""
    length = 12.0
    X, quads = plate(length, 1.0, elements, 1)
    model = sheet(X, quads, 1.2e6, 0.0, 0.1, bodies=("start", "end"))
    model = clamped(model, np.flatnonzero(X[:, 0] == 0))
    model = clamped(model, np.flatnonzero(X[:, 0] == length), body=1)
    position = np.array([[0.0, 0, 0], [-length, 0, 0]])
    round_ = arc(X, model.directors, 2 * np.pi, length)
    start = replace(round_, position=position, rotation=np.tile(np.eye(3), (2, 1, 1)))
    start = model.posed(start, start.position, start.rotation)
    solution = solve(model, start, NO_TENSION, BENCHMARK)
    wrench = model.wrenches(solution.configuration, solution.evaluation, NO_TENSION)["tie"][1]
    exact = 1.2e6 * 1e-3 / 12 * 2 * np.pi / length
    return wrench[:3] / exact, (wrench[3:] + np.cross(position[1], wrench[:3])) / exact


def plate_error(n: int, thickness: float) -> float:
    """Relative error of the middle of a simply supported square plate under p sin sin: Mindlin's
    exact deflection p / (D k^4) + p / (5/6 G h k^2), k^2 = 2 pi^2 / a^2 (Navier's, with shear)."""
    modulus, poisson = 1e7, 0.3
    X, quads = plate(1.0, 1.0, n, n)
    x, y, _ = X.T
    model = sheet(X, quads, modulus, poisson, thickness)
    fixed = np.zeros((len(X), 5), dtype=bool)
    on_x, on_y = np.isin(x, [0, 1]), np.isin(y, [0, 1])
    fixed[:, :2], fixed[on_x | on_y, 2] = True, True
    along_y = np.abs(model.bases(at_rest(model))[1][0, 1]) > 0.5
    fixed[:, 3:] = np.where(along_y, on_x[:, None], on_y[:, None])
    load = np.zeros_like(X)
    load[:, 2] = np.sin(np.pi * x) * np.sin(np.pi * y) * node_areas(X, quads)
    w = sheets.linear_response(model, fixed, np.zeros((len(X), 5)), load)[0][:, 2].max()
    bending, k2 = modulus * thickness**3 / 12 / (1 - poisson**2), 2 * np.pi**2
    shear = 5 / 6 * modulus / (2 * (1 + poisson)) * thickness
    return w / (1 / (bending * k2**2) + 1 / (shear * k2)) - 1


def roof_deflection(n: int) -> float:
    """Scordelis-Lo roof over its reference deflection 0.3024 (MacNeal and Harder 1985): a quarter,
    R = 25, L = 50, t = 0.25, 40 degrees, E = 4.32e8, nu = 0, 90 per area."""
    uv, quads = sheets.grid(n, n)
    angle = np.deg2rad(40) * uv[:, 1]
    D = np.column_stack([0 * angle, np.sin(angle), np.cos(angle)])
    X = 25 * D + np.outer(uv[:, 0], [25.0, 0, 0])
    model = sheet(X, quads, 4.32e8, 0.0, 0.25, directors=D)
    turn_x = np.abs(model.bases(at_rest(model))[1][:, 0]) > 0.5  # the tangent along the cylinder
    diaphragm, middle, crown = uv[:, 0] == 1, uv[:, 0] == 0, uv[:, 1] == 0
    fixed = np.zeros((len(X), 5), dtype=bool)
    fixed[diaphragm, 1:3] = True
    fixed[:, 0], fixed[:, 1] = middle, diaphragm | crown
    fixed[:, 3:] = np.where(turn_x, middle[:, None], crown[:, None])
    load = np.outer(node_areas(X, quads), [0.0, 0, -90])
    u = sheets.linear_response(model, fixed, np.zeros((len(X), 5)), load)[0]
    return float(-u[middle & (uv[:, 1] == 1), 2][0] / 0.3024)


def twisted_beam(thickness: float) -> Array:
    """Tip deflections along y and z of a beam twisted by 90 degrees under unit tip forces: length
    12, width 1.1, E = 29e6, nu = 0.22, 24 x 4 elements."""
    uv, quads = sheets.grid(24, 4)
    turn, across = np.pi / 2 * uv[:, 0], 1.1 * (uv[:, 1] - 0.5)
    radial = np.column_stack([0 * turn, np.cos(turn), np.sin(turn)])
    X = np.outer(uv[:, 0], [12.0, 0, 0]) + across[:, None] * radial
    along = np.array([12.0, 0, 0]) + np.pi / 2 * across[:, None] * np.cross([1.0, 0, 0], radial)
    D = np.cross(along, radial)
    D /= np.linalg.norm(D, axis=1, keepdims=True)
    model = sheet(X, quads, 29e6, 0.22, thickness, directors=D)
    fixed = np.repeat(uv[:, 0] == 0, 5).reshape(-1, 5)
    weight = np.where(np.isin(uv[:, 1], [0, 1]), 0.5, 1.0) * (uv[:, 0] == 1)
    weight /= weight.sum()
    out = [
        weight
        @ sheets.linear_response(model, fixed, np.zeros_like(fixed), np.outer(weight, e))[0]
        @ e
        for e in np.eye(3)[1:]
    ]
    return np.array(out)


def hemisphere(n: int, distortion: float) -> Array:
    """Deflections under the loads of a quarter of a hemisphere with an 18 degree hole, pulled out
    along x and pushed in along y by unit forces: radius 10, t = 0.04, E = 6.825e7, nu = 0.3."""
    uv, quads = sheets.grid(n, n)
    bow = distortion * uv * (1 - uv) * (2 * uv[:, ::-1] - 1)  # lines bent within the edges
    round_, up = np.pi / 2 * (uv + bow)[:, 0], np.deg2rad(72) * (uv + bow)[:, 1]
    D = np.column_stack([np.cos(round_) * np.cos(up), np.sin(round_) * np.cos(up), np.sin(up)])
    D[np.abs(D) < 1e-15] = 0.0
    model = sheet(10 * D, quads, 6.825e7, 0.3, 0.04, directors=D)
    T = model.bases(at_rest(model))[1]
    fixed = np.zeros((len(D), 5), dtype=bool)
    for plane, k in ((D[:, 0] == 0, 0), (D[:, 1] == 0, 1)):
        fixed[:, k] = plane
        fixed[:, 3:] |= plane[:, None] & (np.abs(T[:, k]) > 0.5)
    pulled, pushed = D[:, 0] == 1, D[:, 1] == 1
    fixed[pulled, 2] = True
    load = np.outer(pulled, [1.0, 0, 0]) - np.outer(pushed, [0, 1.0, 0])
    u = sheets.linear_response(model, fixed, np.zeros_like(fixed), load)[0]
    return np.array([u[pulled, 0][0], -u[pushed, 1][0]])


def slit_ring(around: int, across: int) -> Array:
    """Deflections of the inner and outer end of a flat ring's slit, one edge clamped, the other
    under 0.8 per length: radii 6 and 10, thickness 0.03, E = 21e6, nu = 0."""

    def ring(uv: Array) -> Array:
        radius, turn = 6 + 4 * uv[:, 1], 2 * np.pi * uv[:, 0]
        return np.column_stack([radius * np.cos(turn), -radius * np.sin(turn), 0 * radius])

    uv, _ = sheets.grid(around, across)
    X, quads = sheets.mapped(around, across, ring)
    end = uv[:, 0] == 1
    model = sheet(X, quads, 21e6, 0.0, 0.03, fibre=(1.0, 0.3, 0.0))
    model = clamped(model, np.flatnonzero(uv[:, 0] == 0))
    weight = np.where(np.isin(uv[:, 1], [0, 1]), 0.5, 1.0) * end * 4 / across
    options, c = replace(BENCHMARK, max_iterations=400), at_rest(model)
    for part in (0.01, 0.03, 0.06, 0.1, 0.15, 0.2, *np.arange(0.3, 1.01, 0.1)):
        loaded = replace(model, dead=np.outer(weight, [0.0, 0, 0.8 * part]))
        c = solve(loaded, c, NO_TENSION, options, near=True).configuration
    return c.x[end][[0, -1], 2]
