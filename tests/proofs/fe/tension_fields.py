"""Sheets without compression by both elements: a shear web, an annulus in torsion and a stretched
rectangle in bending."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from scipy.optimize import minimize_scalar

from cosim.port import Array
from fe_solver.elements.kinds import kind_of
from fe_solver.materials.linear import Isotropic
from fe_solver.materials.tension_field import TensionField
from fe_solver.solver.model import ShellModel
from fe_solver.solver.newton import NewtonOptions, Solution, solve
from tests.proofs.fe.benchmark import Benchmark, Meshes
from tests.proofs.fe.sheets import NO_TENSION, at_rest, clamp, elements, mirror_plane, sheet

MODULUS, POISSON, THICKNESS = 1e8, 0.3, 1e-3
PRECISE = NewtonOptions(tolerance=1e-9)


def _sheet(X: Array, quads: np.ndarray) -> ShellModel:
    law = TensionField(Isotropic(MODULUS, POISSON))
    return sheet(X, quads, MODULUS, POISSON, THICKNESS, law=law)


def _equilibrium(model: ShellModel) -> Solution:
    """Equilibrium with all that is held where it has been put."""
    c = at_rest(model)
    return solve(model, model.move_bodies(c, c.position, c.rotation), NO_TENSION, PRECISE)


def _clamp(model: ShellModel, nodes: np.ndarray, by: Array) -> ShellModel:
    """The model clamped at nodes (k,) that are moved by (k, 3)."""
    held = clamp(model, nodes)
    return replace(held, ties=replace(held.ties, position=held.ties.position + by))


def shear_web(n: int, nodes: int) -> list[float]:
    """Shear stress of a web in a rigid frame, over the shear angle and Young's modulus."""
    length, height, angle = 0.3, 0.1, 1e-3
    uv, quads = elements(3 * n, n, nodes)
    X = np.column_stack([uv * [length, height], 0 * uv[:, 0]])
    frame = np.flatnonzero((uv.round(9) % 1 == 0).any(axis=1))
    model = _clamp(_sheet(X, quads), frame, angle * X[frame, 1:2] * [1.0, 0, 0])
    work = 2 * _equilibrium(model).evaluation.energy
    return [work / (angle**2 * MODULUS * length * height * THICKNESS)]


SHEAR_WEB = Benchmark(
    "shear web",
    "3 x 1, in a rigid frame that is sheared by 1e-3; 3 n x n elements",
    {"stress over angle and E": 0.25},
    "exact at small strains: a tension E gamma / 2 at 45 deg, and nothing across it",
    shear_web,
    {4: Meshes((2, 4, 8), 0.002), 9: Meshes((1, 2, 4), 0.002)},
    lambda n: f"{3 * n} x {n}",
)


def annulus_torque(inner: float, outer: float) -> float:
    """Torque on the hub of a wrinkled annulus over 2 pi E t and its turn.

    Rays of tension are straight, at the distance c from the centre, and bear K / sqrt(r^2 - c^2) of
    stress at r; they lengthen by c times the turn, and of all c the one of the greatest energy, so
    torque, is the sheet's:  T = 2 pi E t turn max 2 c^2 / ln((b^2 - c^2) / (a^2 - c^2))."""

    def torque(c: float) -> float:
        return 2 * c**2 / float(np.log((outer**2 - c**2) / (inner**2 - c**2)))

    best = minimize_scalar(
        lambda c: -torque(c), bounds=(0, inner), method="bounded", options={"xatol": 1e-12}
    )
    return -float(best.fun)


INNER, OUTER = 0.05, 0.125


def annulus(n: int, nodes: int) -> list[float]:
    """Torque of the hub over the closed form's, the rim fixed."""
    turn = 1e-4
    uv, quads = elements(n, 4 * n, nodes)
    radius, angle = INNER * (OUTER / INNER) ** uv[:, 0], 2 * np.pi * uv[:, 1]
    X = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle])
    kept, same = np.unique(X.round(9), axis=0, return_inverse=True)
    quads = same.ravel()[quads]
    radius = np.hypot(kept[:, 0], kept[:, 1])
    hub, rim = np.isclose(radius, INNER), np.isclose(radius, OUTER)
    ends = np.flatnonzero(hub | rim)
    spin = turn * np.column_stack([-kept[:, 1], kept[:, 0], 0 * radius])
    model = _clamp(_sheet(kept, quads), ends, np.where(hub[ends, None], spin[ends], 0.0))
    force = _equilibrium(model).evaluation.gradient_x
    torque = (kept[hub, 0] * force[hub, 1] - kept[hub, 1] * force[hub, 0]).sum()
    exact = 2 * np.pi * THICKNESS * MODULUS * turn * annulus_torque(INNER, OUTER)
    return [float(torque / exact)]


ANNULUS = Benchmark(
    "annulus under torsion",
    "radii 50 and 125 mm, the hub turned by 1e-4 in a fixed rim; n x 4 n elements",
    {"torque, over the closed form's": 1.0},
    "closed form: straight rays of tension, those of the greatest energy",
    annulus,
    {4: Meshes((4, 8, 16), 0.02), 9: Meshes((2, 4, 8), 0.02)},
    lambda n: f"{n} x {4 * n}",
)
HEIGHT, LENGTH, PULL = 0.1, 0.2, 0.5


def bent_rectangle(moment: float, n: int, nodes: int) -> list[float]:
    """Pull (over PULL), moment over pull and height, and wrinkled height over height, at the
    elongation and curvature that Stein and Hedgepeth give for `moment`."""
    wrinkled = HEIGHT * (3 * moment - 0.5)
    curvature = 2 * PULL / (THICKNESS * MODULUS * (HEIGHT - wrinkled) ** 2)
    uv, quads = elements(n, n, nodes)
    X = np.column_stack([uv * [LENGTH, HEIGHT], 0 * uv[:, 0]])
    left, right = uv[:, 0] == 0, uv[:, 0] == 1
    held = np.zeros(X.shape, dtype=bool)
    held[left | right, 0] = held[:, 2] = True
    held[np.flatnonzero(left)[0], 1] = True
    model = mirror_plane(_sheet(X, quads), np.zeros_like(held), held)
    g = model.guides
    on = right[g.node]
    origin = g.origin.copy()
    origin[on, 0] += LENGTH * curvature * (X[g.node[on], 1] - wrinkled)
    solution = _equilibrium(replace(model, guides=replace(g, origin=origin)))
    force = solution.evaluation.gradient_x[right, 0]
    pull, turned = force.sum(), force @ (X[right, 1] - HEIGHT / 2)
    return [pull / PULL, turned / (pull * HEIGHT), _where_it_ends(solution) / HEIGHT]


def _where_it_ends(solution: Solution) -> float:
    """The height y (m) at which the line of the tension along x ends."""
    model, c = solution.model, solution.configuration
    element, y = kind_of(model.quads), model.reference[model.quads][:, :, 1]
    at = np.stack([element.shape(r, s)[0] for r, s in element.gauss]) @ y.T
    strain = model.tables.strain(np.concatenate([c.x[model.quads], c.d[model.quads]], axis=1))
    stress = model.section.stress(strain)[:, :, 0].T
    pulled = stress > 0.2 * stress.max()
    slope, level = np.polyfit(at[pulled], stress[pulled], 1)
    return float(-level / slope)


BENT_RECTANGLES = tuple(
    Benchmark(
        "stretched rectangle in bending",
        f"2 x 1, bent by M = {moment} P h, nu = {POISSON}, strains of 5e-5; n x n elements",
        {
            f"pull over P, M = {moment} P h": 1.0,
            f"M / (P h) at its curvature, M = {moment} P h": moment,
            f"wrinkled height over h, M = {moment} P h": 3 * moment - 0.5,
        },
        "Stein and Hedgepeth 1961, NASA Technical Note D-813",
        partial(bent_rectangle, moment),
        {4: Meshes((4, 8, 16), 0.02), 9: Meshes((2, 4, 8), 0.02)},
    )
    for moment in (0.25, 0.35)
)
