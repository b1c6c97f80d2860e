"""What a strap does to the bodies that hold it, and how it follows them."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from cosim.port import Array, rotation_matrix
from fe_solver.forces.guides import Guides, Ropes
from fe_solver.solver.body_coupling import coupling, wrenches
from fe_solver.solver.model import Configuration, ShellModel
from fe_solver.solver.newton import Solution, solve
from tests.helpers.straps import TENSION, TIGHT, perturb, strap
from tests.proofs.fe.sheets import at_rest


@pytest.fixture(scope="module")
def model() -> ShellModel:
    return strap()


@pytest.fixture(scope="module")
def solved(model: ShellModel) -> Solution:
    return solve(model, at_rest(model), TENSION, TIGHT)


def test_the_strap_is_in_balance(model, solved):
    c = solved.configuration
    wrench = sum(wrenches(model, c, solved.evaluation, TENSION).values())
    pulls = model.pulls(c, TENSION)
    total = np.concatenate([pulls.sum(0), np.cross(c.x[model.guides.node], pulls).sum(0)])
    assert np.abs(wrench).max() > 1
    assert wrench.sum(axis=0) == pytest.approx(total, abs=1e-10)


def move_bodies(model: ShellModel, c: Configuration, twist: Array) -> Configuration:
    """Bodies displaced by `twist` (nb, 6); free degrees of freedom stay."""
    turn = rotation_matrix(twist[:, 3:])
    return model.move_bodies(c, c.position + twist[:, :3], turn @ c.rotation)


def mirror_strap() -> ShellModel:
    """The strap, one of its long edges in a mirror plane of the ball's body."""
    model = strap()
    g, X = model.guides, model.reference
    edge = np.flatnonzero(X[:, 1] == X[:, 1].min())
    edge = np.setdiff1d(edge, np.concatenate([g.node, model.ties.node]))
    count = len(edge)
    D = model.directors.copy()
    D[edge, 1] = 0.0
    D[edge] /= np.linalg.norm(D[edge], axis=1, keepdims=True)
    plane = Guides.on_body_axes(
        edge, np.full(count, 2), X[edge], np.tile([False, True, False], (count, 1))
    )
    plane = replace(
        plane,
        level=np.tile([0.0, 1.0, 0.0], (count, 1)),
        still=np.tile([True, False], (count, 1)),
    )
    both = [np.concatenate([getattr(g, f.name), getattr(plane, f.name)]) for f in fields(Guides)]
    share = np.hstack([model.share, np.zeros((len(model.share), count))])
    return replace(model, guides=Guides(*both), share=share, directors=D)


def test_a_mirror_plane_holds_position_and_director(solved):
    model = mirror_strap()
    solution = solve(model, at_rest(model), TENSION, TIGHT)
    c, edge = solution.configuration, model.guides.node[model.guides.steady]
    assert len(edge) > 3
    assert np.abs(c.x[edge, 1] - model.reference[edge, 1]).max() < 1e-15
    assert np.abs((c.d - model.directors)[edge, 1]).max() < 1e-9
    assert np.abs((c.d - model.directors)[edge]).max() > 1e-3
    wrench = sum(wrenches(model, c, solution.evaluation, TENSION).values())
    pulls = model.pulls(c, TENSION)
    assert wrench[:, :3].sum(axis=0) == pytest.approx(pulls.sum(axis=0), abs=1e-9)
    turning = wrench[:, 3:] + np.cross(c.position, wrench[:, :3])
    about = np.cross(c.x[model.guides.node], pulls).sum(axis=0)
    assert turning.sum(axis=0) == pytest.approx(about, abs=1e-11)


def roped_strap() -> ShellModel:
    """The strap, its tendons' ends hung on ropes through eyelets of the hand."""
    model = strap()
    g, X = model.guides, model.reference
    eyelet = X[g.node] + np.array([-6e-3, 1e-3, -2e-3])
    length = np.linalg.norm(X[g.node] - eyelet, axis=1)
    ropes = Ropes(g.node, g.body, eyelet, g.direction, length, model.share)
    return replace(model, guides=Guides.none(), share=np.zeros((len(model.share), 0)), ropes=ropes)


@pytest.mark.parametrize("made", [strap, mirror_strap, roped_strap])
@pytest.mark.parametrize("seed", range(3))
def test_coupling_to_the_bodies(made, seed):
    """Residual and wrenches by the bodies' twists and by the tensions, at turned bodies and away
    from equilibrium."""
    model = made()
    solved = solve(model, at_rest(model), TENSION, TIGHT)
    rng = np.random.default_rng(seed)
    scale = np.array([1e-3, 1e-3, 1e-3, 0.1, 0.1, 0.1])
    c = move_bodies(model, solved.configuration, 0.5 * rng.normal(size=(3, 6)) * scale)
    c = perturb(model, c, 1e-6, seed)
    e = model.evaluate(c, TENSION, tangent=True)
    by_twist, wrench_twist, by_tension, wrench_tension = coupling(model, c, e, TENSION)

    def answer(twist: Array, tension: Array) -> tuple[Array, Array]:
        there = move_bodies(model, c, twist)
        e = model.evaluate(there, tension, tangent=False)
        return e.reduced[model.free], sum(wrenches(model, there, e, tension).values()).ravel()

    def slope(twist: Array, tension: Array, h: float) -> list[Array]:
        a, b = answer(h * twist, TENSION + h * tension), answer(-h * twist, TENSION - h * tension)
        return [(p - q) / (2 * h) for p, q in zip(a, b, strict=True)]

    for body in range(3):
        twist = np.zeros((3, 6))
        twist[body] = rng.normal(size=6) * scale
        residual, wrench = slope(twist, np.zeros(2), 1e-4)
        for value, expected in (
            (by_twist[model.free] @ twist.ravel(), residual),
            (wrench_twist @ twist.ravel(), wrench),
        ):
            assert value == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())
    for t in range(2):
        residual, wrench = slope(np.zeros((3, 6)), np.eye(2)[t], 1e-3)
        assert by_tension[model.free, t] == pytest.approx(residual, abs=1e-9)
        assert wrench_tension[:, t] == pytest.approx(wrench, abs=1e-9)


def test_wrenches_are_conjugate_to_the_bodies_motion(model, solved):
    """At equilibrium the potential falls by the work of the wrenches on the bodies; body 0 carries
    the tendons' guides, whose pulls move with it."""
    c, e = solved.configuration, solved.evaluation
    wrench = sum(wrenches(model, c, e, TENSION).values())
    rng = np.random.default_rng(8)
    for _ in range(3):
        twist = rng.normal(size=(3, 6)) * [1e-3, 1e-3, 1e-3, 0.1, 0.1, 0.1]
        twist[0] = 0

        def potential(h: float, twist: Array = twist) -> float:
            there = move_bodies(model, c, h * twist)
            return model.potential(there, model.evaluate(there, TENSION, False).energy, TENSION)

        h = 1e-4
        assert (potential(h) - potential(-h)) / (2 * h) == pytest.approx(
            -np.vdot(wrench, twist), rel=1e-6
        )
