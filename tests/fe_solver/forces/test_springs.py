"""Springs: their laws, and that what they carry is their energy's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import InputError
from fe_solver.forces.springs import (
    ForceCurve,
    NodeSprings,
    Springs,
    axial,
    node_spring_state,
    node_springs,
    spring_forces,
    spring_state,
)
from tests.proofs.fe.sheets import GROUND

ONE = Springs(*(np.array([v]) for v in (0, 0, [0.0, 0, 0], 100.0, 2e-3, True, 0)))
BOTH = replace(ONE, tension_only=np.array([False]))
FIRST = np.zeros(1, dtype=int)
STRETCHES, FORCES = np.array([-2e-3, 0, 1e-3, 3e-3]), np.array([-0.2, 0, 0.05, 1.0])
TOE = ForceCurve(FIRST, STRETCHES, FORCES)


def test_a_slack_spring_pulls_not_and_a_two_sided_one_pushes():
    at = np.array([[1e-3, 0.0, 0.0]])
    slack, pushed = (spring_forces(s, at, *GROUND, True) for s in (ONE, BOTH))
    assert slack.energy == 0
    assert (slack.gradient == 0).all()
    assert (slack.hessian == 0).all()
    assert pushed.gradient[0] == pytest.approx([-0.1, 0, 0])
    assert pushed.energy == pytest.approx(0.5e-4)
    for spring in (ONE, BOTH, replace(BOTH, curves=(TOE,))):
        convex = spring_forces(spring, at, *GROUND, False)
        assert np.linalg.eigvalsh(convex.hessian[0]).min() >= 0


def test_a_spring_of_no_length_holds_a_node_in_every_direction():
    spring = replace(BOTH, length=np.zeros(1))
    here = spring_forces(spring, np.zeros((1, 3)), *GROUND, True)
    assert here.hessian[0] == pytest.approx(100 * np.eye(3))
    assert (here.gradient == 0).all()


def test_the_state_of_springs_by_hand():
    two = Springs(
        np.array([0, 1]),
        np.zeros(2, dtype=int),
        np.array([[0, 0, 1e-3], [0, 0, 0.0]]),
        np.array([100.0, 200]),
        np.array([2e-3, 6e-3]),
        np.array([True, True]),
        np.zeros(2, dtype=int),
    )
    state = spring_state(two, np.array([[3e-3, 0, 1e-3], [3e-3, 4e-3, 0]]), *GROUND)
    assert state.stretch == pytest.approx([1e-3, -1e-3])
    assert state.force == pytest.approx([0.1, 0])
    assert state.energy == pytest.approx([5e-5, 0])
    assert state.taut.tolist() == [True, False]


def test_a_curve_passes_its_points_and_goes_on_straight():
    energy, force, slope = TOE(STRETCHES)
    assert force == pytest.approx(FORCES)
    assert energy[1] == 0
    work, far, same = TOE(np.array([4e-3]))
    assert same == pytest.approx(slope[3:])
    assert far == pytest.approx(1.0 + slope[3:] * 1e-3)
    assert work == pytest.approx(energy[3:] + (1.0 + far) / 2 * 1e-3)


@given(st.floats(-5e-3, 6e-3))
def test_energy_force_and_slope_of_a_curve(stretch):
    h = 1e-8
    (e0, f0, _), (e1, f1, _) = (TOE(np.array([stretch + s * h])) for s in (-1, 1))
    _, force, slope = TOE(np.array([stretch]))
    assert (e1 - e0) / (2 * h) == pytest.approx(force, abs=1e-6)
    assert (f1 - f0) / (2 * h) == pytest.approx(slope, abs=1e-2)  # its kink is in the slope


@given(st.lists(st.integers(0, 10**6), min_size=3, max_size=8))
def test_a_curve_is_monotone_where_its_points_are(rises):
    force = 1e-6 * np.cumsum(rises)
    curve = ForceCurve(FIRST, 1e-3 * np.arange(len(force)), force)
    sampled = curve(np.linspace(-1e-3, 1e-3 * len(force), 400))[1]
    assert (np.diff(sampled) >= -1e-12).all()


def test_a_straight_curve_is_a_linear_spring():
    line = ForceCurve(FIRST, np.array([-1e-3, 0, 5e-3]), np.array([-0.1, 0, 0.5]))
    for spring, place in ((ONE, 5e-3), (ONE, 1e-3), (BOTH, 1e-3)):
        both = (axial(s, np.array([place])) for s in (spring, replace(spring, curves=[line])))
        for a, b in zip(*both, strict=True):
            assert a == pytest.approx(b, rel=1e-12, abs=1e-15)


def test_the_stiffness_at_which_a_slack_curve_would_close():
    """Newton foresees a spring that pulls only: by its slope now, or that at its slack length."""
    spring = replace(ONE, curves=(TOE,))
    for place, stretch in ((1e-3, 0.0), (4e-3, 2e-3)):
        forces = spring_forces(spring, np.array([[place, 0, 0]]), *GROUND, True)
        assert forces.stiffness == pytest.approx(TOE(np.array([stretch]))[2])


@pytest.mark.parametrize(
    ("stretch", "force", "words"),
    [
        ([0.0], [0.0], "two or more pairs"),
        ([0, 1e-3], [0, 1.0, 2.0], "2.* stretches and .3"),
        ([0, 2e-3, 2e-3], [0, 1.0, 2.0], r"0.002 m follows 0.002 m \(points 1 and 2\)"),
        ([0, np.nan], [0, 1.0], "not finite"),
        ([0, np.inf], [0, 1.0], "not finite"),
        ([0, 1.0], [0, -np.inf], "not finite"),
    ],
)
def test_tables_that_are_no_law_are_refused(stretch, force, words):
    with pytest.raises(InputError, match=words):
        ForceCurve(FIRST, np.array(stretch), np.array(force))


def test_a_tension_only_spring_must_not_pull_at_once():
    at_once = ForceCurve(FIRST, np.array([0, 1e-3]), np.array([0.1, 0.2]))
    replace(BOTH, curves=(at_once,))
    with pytest.raises(InputError, match="expected 0; shift the curve"):
        replace(ONE, curves=(at_once,))
    with pytest.raises(InputError, match="names spring 3 of 1"):
        replace(ONE, curves=(replace(TOE, springs=np.array([3])),))


def test_a_spring_between_nodes_is_one_to_a_body_that_holds_still():
    """And the second node feels what the first does, reversed; no moment is left."""
    x = np.array([[0, 0, 0], [4e-3, 1e-3, -2e-3]])
    pair = NodeSprings(
        np.array([[0, 1]]),
        *(getattr(ONE, f) for f in ("stiffness", "length", "tension_only", "group")),
    )
    to_body = spring_forces(replace(ONE, node=np.array([1])), x, *GROUND, True)
    forces = node_springs(pair, x, True)
    assert forces.energy == to_body.energy > 0
    assert forces.gradient[0, 1] == pytest.approx(to_body.gradient[0])
    assert forces.gradient[0].sum(axis=0) == pytest.approx(np.zeros(3))
    assert np.cross(x, forces.gradient[0]).sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-15)
    assert forces.hessian[0, 3:, 3:] == pytest.approx(to_body.hessian[0])
    assert forces.hessian[0] == pytest.approx(forces.hessian[0].T)
    assert forces.hessian[0, :, :3] == pytest.approx(-forces.hessian[0, :, 3:])
    assert node_spring_state(pair, x).force == pytest.approx(np.linalg.norm(to_body.gradient))
    empty = node_springs(NodeSprings.none(), x, True)
    assert empty.energy == 0
    assert empty.hessian.shape == (0, 6, 6)
