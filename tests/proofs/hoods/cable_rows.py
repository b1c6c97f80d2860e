"""Cables: a loaded string, a string over a cylinder, and a net over two capsules whose joint is
flexed, against closed forms and differences."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.optimize import brentq

from cosim.port import Array, Ints, rotation_matrix
from fe_solver.forces.cables import Cables, cable_forces, cable_state
from fe_solver.forces.contact import Contact, partition
from fe_solver.hood.build import Net
from fe_solver.solver.model import ShellModel
from fe_solver.solver.newton import NewtonOptions, Solution, solve
from fe_solver.surfaces.shapes import Capsule, Cylinder
from tests.helpers.rows import Row
from tests.proofs.fe import hood_rows
from tests.proofs.fe.sheets import NO_TENSION, at_rest, clamp, guide

NEWTON = NewtonOptions(tolerance=1e-11, max_step=0.1)
MODULUS, SECTION, TOE, RESIDUAL = 1e8, 1e-6, 0.02, 0.02
"""The cables' modulus (Pa), section (m2), toe strain and residual force (N)."""
SPAN, CELLS, WEIGHT = 0.1, 40, 0.5
"""The string's span (m), number of cells and whole weight (N)."""
RADIUS, TENSION = 5e-3, 2.0
"""The cylinder's radius (m), and the tension (N) at either end of the string over it."""
STRING, OVER, NET = "loaded string", "string over a cylinder", "net over two capsules at 60 deg"


def cables(nodes: Ints, length: Array, residual: float = RESIDUAL) -> Cables:
    """Cells of the material above."""
    ones = np.ones(len(nodes))
    return Cables(nodes, length, MODULUS * ones, SECTION * ones, TOE * ones, residual * ones)


def net(points: Array, cells: Ints, bodies: tuple[str, ...] = ("ground",)) -> ShellModel:
    """Cables alone through points (n, 3), free of stress there; nothing holds them yet."""
    length = np.linalg.norm(points[cells[:, 1]] - points[cells[:, 0]], axis=1)
    return Net(points, cables(cells, length)).model(bodies=bodies)


def chain(count: int) -> Ints:
    """The cells (count, 2) of a line of nodes."""
    return np.arange(count)[:, None] + np.arange(2)


def string(slack: float) -> ShellModel:
    """A string along x, a part `slack` longer than its span, its ends held and its inner nodes
    pulled down evenly."""
    X = np.zeros((CELLS + 1, 3))
    X[:, 0] = np.linspace(0, SPAN, CELLS + 1)
    model = clamp(net(X, chain(CELLS)), np.array([0, CELLS]))
    dead = np.zeros_like(X)
    dead[1:-1, 2] = -WEIGHT / (CELLS - 1)
    longer = replace(model.cables, length=(1 + slack) * model.cables.length)
    return replace(model, dead=dead, cables=longer)


def solve_string(slack: float) -> Solution:
    """From a sagging start."""
    model = string(slack)
    c = at_rest(model)
    x = c.x.copy()
    x[:, 2] -= 0.4 * SPAN * np.sqrt(max(slack, 0.01)) * np.sin(np.pi * x[:, 0] / SPAN)
    return solve(model, replace(c, x=x), NO_TENSION, NEWTON)


def funicular(slack: float) -> tuple[Array, Array]:
    """Closed form of the string: tensions of the cells (k,) N and positions (k + 1, 2) m.  All
    cells have one horizontal force H and vertical forces that the loads step down by; each is as
    long as its tension makes it, and H is the root at which they span the supports."""
    rest = (1 + slack) * SPAN / CELLS
    vertical = WEIGHT / (CELLS - 1) * (np.arange(CELLS) - (CELLS - 1) / 2)

    def cells(H: float) -> tuple[Array, Array]:
        N = np.hypot(H, vertical)
        run = rest * (1 + _strain(N)) / N
        return N, np.stack([run * H, run * vertical], axis=1)

    H = brentq(lambda H: cells(H)[1][:, 0].sum() - SPAN, 1e-9, 100.0, xtol=1e-15, rtol=1e-14)
    N, step = cells(H)
    return N, np.vstack([np.zeros(2), np.cumsum(step, axis=0)])


def _strain(tension: Array) -> Array:
    """Solve the law for the strain, piece by piece."""
    EA = MODULUS * SECTION
    slack = tension / RESIDUAL - 1
    root = np.sqrt(np.maximum(RESIDUAL**2 + 2 * EA / TOE * (tension - RESIDUAL), 0.0))
    toe = (root - RESIDUAL) * TOE / EA
    straight = (tension + EA * TOE / 2 - RESIDUAL) / (EA + RESIDUAL)
    return np.where(slack < 0, slack, np.where(toe < TOE, toe, straight))


def string_rows() -> Iterator[Row]:
    """Sagging, taut and stretched strings."""
    source = "funicular polygon in closed form"
    for slack in (0.2, 0.0, -0.05):
        s = solve_string(slack)
        pull, place = funicular(slack)
        x = s.configuration.x
        for what, value, target in (
            ("greatest tension (N)", cable_state(s.model.cables, x).force.max(), pull.max()),
            ("sag (m)", -x[:, 2].min(), -place[:, 1].min()),
        ):
            name = f"{what}, {100 * slack:+.0f} % of length"
            yield Row(STRING, name, float(target), float(value), 1e-7, source)


def over_cylinder(angle: float, count: int = 240) -> Solution:
    """A string tied at one end, laid over a frictionless cylinder and turned by `angle` (rad) on
    it, and pulled along itself at the other end."""
    tangent, line = RADIUS * angle / 2, 10e-3
    s = np.linspace(-tangent - line, tangent + line, count + 1)
    on = np.clip(s, -tangent, tangent) / RADIUS
    beyond = s - np.clip(s, -tangent, tangent)
    X = np.stack(
        [
            RADIUS * np.sin(on) + beyond * np.cos(on),
            0 * s,
            RADIUS * np.cos(on) - beyond * np.sin(on),
        ],
        axis=1,
    )
    model = clamp(net(X, chain(count)), np.array([0]))
    model = guide(model, [np.array([count])], [(np.cos(angle / 2), 0.0, -np.sin(angle / 2))])
    nodes = np.arange(1, count)
    bone = Cylinder(np.zeros(3), np.array([0.0, 1.0, 0.0]), RADIUS)
    area = np.full(count - 1, 1e-6)
    contact = Contact(0, bone, nodes, np.zeros(count - 1), area, 1e12, 2e-6)
    model = replace(model, contacts=(contact,))
    return solve(model, at_rest(model), np.array([TENSION]), NEWTON)


def cylinder_rows() -> Iterator[Row]:
    """Frictionless: one tension all along, and the contact's resultant 2 T sin(angle / 2).  The
    penalty begins a micron or so above the cylinder, which turns the ends by some 1e-4 rad."""
    for degrees in (30.0, 90.0, 150.0):
        angle = np.deg2rad(degrees)
        s = over_cylinder(angle)
        force = cable_state(s.model.cables, s.configuration.x).force
        pressed = -s.evaluation.points.gradient.sum(axis=0)
        about = f", {degrees:.0f} deg"
        resultant = float(np.linalg.norm(pressed))
        closed = 2 * TENSION * float(np.sin(angle / 2))
        source = "closed form, frictionless"
        yield Row(OVER, f"resultant of the contact (N){about}", closed, resultant, 1e-3, source)
        spread = float(np.ptp(force) / TENSION)
        yield Row(OVER, f"spread of the tension{about}", 2e-4, spread, 0.0, source, "bound")


def two_bones() -> tuple[ShellModel, Array]:
    """Three cables along two capsules whose joint is at the origin, tied across, pulled proximally
    in the middle, tied to the distal bone and sprung to both; and how much of each node the distal
    one carries (n,)."""
    half, high = hood_rows.LENGTH / 2, hood_rows.BONE + hood_rows.HEIGHT
    along = np.linspace(-half, half, 41)
    X = np.array([[x, y, high] for x in along for y in (-2e-3, 0.0, 2e-3)])
    node = np.arange(len(X)).reshape(-1, 3)
    lines = np.concatenate([np.stack([node[:-1, k], node[1:, k]], axis=1) for k in range(3)])
    ties = np.concatenate([np.stack([node[1:, k], node[1:, k + 1]], axis=1) for k in range(2)])
    fan = np.array([[node[0, 1], node[1, k]] for k in (0, 2)])
    kept = lines[~np.isin(lines, node[0, [0, 2]]).any(axis=1)]
    used = np.setdiff1d(np.arange(len(X)), node[0, [0, 2]])
    cells = np.searchsorted(used, np.vstack([kept, ties, fan]))
    X = X[used]
    model = net(X, cells, hood_rows.BODIES)
    first, last = (np.flatnonzero(np.isclose(X[:, 0], s * half)) for s in (-1, 1))
    model = guide(clamp(model, last, body=1), [first], [(-1.0, 0, 0)])
    inner = np.setdiff1d(np.arange(len(X)), np.concatenate([first, last]))
    ends = (np.array([s * 2 * half, 0, 0]) for s in (-1, 1))
    bones = [Capsule(np.zeros(3), end, hood_rows.BONE) for end in ends]
    distances = np.stack([bone.distance(X[inner]).value for bone in bones], axis=1)
    shares, ones = partition(distances, 1e-5), np.ones(len(inner))
    contacts = tuple(
        Contact(
            body, bone, inner, hood_rows.HEIGHT * ones, 1e-6 * ones, 1e10, 2e-5, shares[:, body]
        )
        for body, bone in enumerate(bones)
    )
    carried = np.clip(X[:, 0] / 8e-3 + 0.5, 0, 1)
    return replace(model, contacts=contacts, springs=hood_rows.bands(X)), carried


def bend_net() -> Solution:
    """The net under 2 N with its joint flexed to 60 degrees, by penalty."""
    model, carried = two_bones()
    c = at_rest(model)
    for angle in (0.0, 20.0, 20.0, 20.0):
        c = hood_rows.flex(model, c, carried, np.deg2rad(angle))
        c = solve(model, c, hood_rows.TENSION, NewtonOptions()).configuration
    return hood_rows.by_penalty(model, c, hood_rows.TENSION)


def net_rows() -> Iterator[Row]:
    """The condensed derivatives of the net, as of a sheet; differences see the bends in the cells'
    stiffness at the ends of the toe too."""
    solution = bend_net()
    for row in hood_rows.tangent_rows(solution):
        bound = 5 * row.target if row.quantity.startswith("condensed") else row.target
        yield replace(row, name=NET, target=bound)
    pull = cable_state(solution.model.cables, solution.configuration.x)
    slack = float((pull.force - solution.model.cables.residual)[pull.strain < 0].max())
    what = "tension of slack cells beyond the residual (N)"
    yield Row(NET, what, 0.0, slack, 0.0, "tension only", "bound")


def tangent_rows() -> Iterator[Row]:
    """The Hessian of cells that are slack, in the toe and taut, against differences of the
    gradient, and that of a turned net."""
    cells, x = some_cells()
    error = hessian_error(cells, x)
    yield Row("cable tangent", "slack, toe, taut", 1e-7, error, 0.0, "differences", "bound")
    R = rotation_matrix(np.array([0.7, -1.1, 0.4]))
    still, turned = cable_forces(cells, x), cable_forces(cells, x @ R.T + 0.3)
    gap = np.abs(turned.gradient - still.gradient @ R.T).max() / np.abs(still.gradient).max()
    what, source = "gradient of the turned net", "objectivity"
    yield Row("cable tangent", what, 1e-12, float(gap), 0.0, source, "bound")


def some_cells() -> tuple[Cables, Array]:
    """Twelve cells at random, of strains from -30 to 6 per cent, and their nodes' places."""
    rng = np.random.default_rng(1)
    x, nodes = (
        1e-2 * rng.normal(size=(8, 3)),
        np.array([[i, (i + k) % 8] for i in range(8) for k in (1, 3)])[:12],
    )
    strain = np.linspace(-0.3, 0.06, 12)
    length = np.linalg.norm(x[nodes[:, 1]] - x[nodes[:, 0]], axis=1) / (1 + strain)
    return cables(nodes, length), x


def hessian_error(cells: Cables, x: Array) -> float:
    """Largest difference of the cells' Hessians from central differences of their gradients, over
    the largest entry."""
    exact, ends = cable_forces(cells, x).hessian, x[cells.nodes]
    differences, h = np.empty_like(exact), 1e-8
    apart = replace(cells, nodes=np.arange(2 * len(ends)).reshape(-1, 2))
    for k in range(6):
        step = np.zeros((len(ends), 2, 3))
        step.reshape(-1, 6)[:, k] = h
        ahead, behind = (
            cable_forces(apart, (ends + s * step).reshape(-1, 3)).gradient for s in (1, -1)
        )
        differences[:, :, k] = (ahead - behind).reshape(-1, 6) / (2 * h)
    return float(np.abs(differences - exact).max() / np.abs(exact).max())


def closed_form_rows() -> Iterator[Row]:
    """Yield the rows of strings with a closed form."""
    yield from string_rows()
    yield from cylinder_rows()
