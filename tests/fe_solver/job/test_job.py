"""Stand-alone jobs: what holds, loads and touches the sheet, and steps in time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cosim.errors import ConvergenceError, InputError
from fe_solver.febio.read import read_feb
from fe_solver.febio.write import write_feb
from fe_solver.job.curves import Drive, LoadCurve
from fe_solver.job.job import (
    HeldDirector,
    Job,
    NodalForce,
    PrescribedDisplacement,
    Pressure,
    Step,
)
from fe_solver.job.model import JobOptions, job_model
from fe_solver.job.solve import solve_job, spread_times
from fe_solver.materials.linear import Isotropic
from fe_solver.q4ans.solve import solve_solid
from fe_solver.sheet import plate
from fe_solver.solver.newton import NewtonOptions, solve
from fe_solver.supports import WALL, Body, SpringLaw, SpringSet, Tied
from fe_solver.surfaces.shapes import HalfSpace
from tests.helpers.jobs import (
    LENGTH,
    PLAIN,
    RAMP,
    THICK,
    WIDTH,
    E,
    bending_job,
    body,
    change_job,
    contact_job,
    fix_components,
    nodes_at,
    spring_job,
    strip,
    total,
)


def test_a_job_of_three_lines_bends_as_a_beam():
    sheet = plate(LENGTH, WIDTH, 10, 3, Isotropic(E, 0.0), THICK)
    load = NodalForce(sheet.edge("x1"), (0, 0, 1e-4))
    job = Job(sheet, ties=[Tied(sheet.edge("x0"), WALL)], forces=[load])
    state = solve_job(job).states[-1]
    force, inertia = 1e-4 * len(load.nodes), WIDTH * THICK**3 / 12
    deflection = state.configuration.x[load.nodes, 2].mean()
    assert deflection == pytest.approx(force * LENGTH**3 / (3 * E * inertia), rel=0.01)
    assert state.bodies == ("wall",)
    assert total(state, "tie", "wall") == pytest.approx([0, 0, force], abs=1e-9)


def test_a_second_tie_to_the_wall_is_to_the_same_wall():
    sheet = plate(LENGTH, WIDTH, 4, 1, Isotropic(E, 0.0), THICK)
    job = Job(sheet, ties=[Tied(sheet.edge("x0"), WALL)])
    both = replace(job, ties=(*job.ties, Tied(sheet.edge("x1"), WALL)))
    assert [b.name for b in both.bodies] == ["wall"]
    assert [t.body for t in both.ties] == [0, 0]
    with pytest.raises(InputError, match="edges x0, x1, y0, y1, not 'z0'"):
        sheet.edge("z0")


def test_a_prescribed_displacement_stretches_as_the_law_says():
    job, end = strip(), nodes_at(strip(), LENGTH)
    held = (
        PrescribedDisplacement(nodes_at(job, 0.0), 0),
        PrescribedDisplacement(end, 0, Drive(1e-3, RAMP)),
        *fix_components(job, 1, 2),
    )
    job = replace(job, held=held)
    (state,) = solve_job(job, options=PLAIN).states
    stretch = 1.05
    force = stretch * E * (stretch**2 - 1) / 2 * WIDTH * THICK
    assert state.configuration.x[end, 0] == pytest.approx(LENGTH + 1e-3, abs=1e-12)
    assert total(state, "guide", "displacement 2")[0] == pytest.approx(-force, rel=1e-9)
    assert total(state, "guide", "ground")[0] == pytest.approx(force, rel=1e-9)


def test_one_component_given_twice_and_not_alike_is_refused():
    job, end = strip(), nodes_at(strip(), LENGTH)
    job = replace(
        job, held=(*fix_components(job, 0), PrescribedDisplacement(end, 0, Drive(1e-3, RAMP)))
    )
    with pytest.raises(InputError, match=f"of {job.sheet.node(end[0])} is given twice"):
        solve_job(job, options=PLAIN)


def test_many_steps_end_where_one_does():
    whole = solve_job(bending_job(), options=PLAIN)
    parts = solve_job(bending_job(), options=PLAIN, times=[0.2, 0.5, 0.8, 1.0])
    far = whole.states[-1].configuration.x
    assert np.ptp(far[:, 2]) > 2e-3
    assert [s.time for s in parts.states] == [0.2, 0.5, 0.8, 1.0]
    assert np.abs(parts.states[-1].configuration.x - far).max() < 1e-9
    heights = [s.configuration.x[:, 2].max() for s in parts.states]
    assert heights == sorted(heights)
    assert parts.states[0].applied[2] == pytest.approx(0.2 * 0.02 * 4)


@pytest.mark.parametrize(
    ("shortest", "failures", "relaxations"), [(1e-3, range(2, 100), 0), (0.9, range(1, 2), 1)]
)
def test_short_steps_or_a_damped_motion_end_where_one_step_does(shortest, failures, relaxations):
    """Newton may not take the iterations that the whole load takes."""
    (whole,) = solve_job(bending_job(), options=PLAIN).states
    hasty = replace(PLAIN, shortest=shortest, newton=NewtonOptions(1e-8, max_iterations=8))
    result = solve_job(bending_job(), options=hasty)
    assert result.effort.failures in failures
    assert result.effort.relaxations == relaxations
    x = result.states[-1].configuration.x
    assert np.abs(x - whole.configuration.x).max() < 1e-9


def test_a_director_turned_through_its_element_is_no_solution():
    """Such a state is an equilibrium of the discrete sheet, of less energy even."""
    (state,) = solve_job(bending_job(), options=PLAIN).states
    c = state.configuration
    turned = c.d.copy()
    turned[nodes_at(bending_job(), LENGTH)[0]] *= -1
    with pytest.raises(ConvergenceError, match="turned through an element's plane, at node"):
        solve(state.model, replace(c, d=turned), np.zeros(0), PLAIN.newton, near=True)


def test_loads_and_bodies_balance_and_the_tie_carries_the_load():
    state = solve_job(bending_job(), options=PLAIN).states[-1]
    assert max(state.imbalance) < 1e-7
    assert total(state, "tie", "bone") == pytest.approx([0, 0, 0.08], abs=1e-7)
    arm = state.configuration.x[nodes_at(strip(), LENGTH), 0].mean()
    assert state.wrench["tie"][0, 4] == pytest.approx(-0.08 * arm, rel=1e-4)


def test_a_prediction_saves_iterations():
    near = replace(bending_job(), steps=(Step("far", 0.5, 1), Step("near", 0.502, 1)))
    first = solve_job(near, options=PLAIN)
    assert first.states[1].effort.iterations <= 3


def test_a_sheet_follows_the_body_that_turns_without_force():
    turn = (Drive(), Drive(0.7, RAMP), Drive())
    moved = (Drive(), Drive(), Drive(2e-3, RAMP))
    job = strip(nu=0.3)
    bone = Body("bone", np.array([3e-3, 0, 0]), displacement=moved, rotation=turn)
    job = replace(job, bodies=(bone,), ties=(Tied(nodes_at(job, 0.0), 0),))
    result = solve_job(job, options=PLAIN)
    (state,) = result.states
    p, R = bone.pose(1.0)
    assert np.abs(state.configuration.x - (job.sheet.points - bone.origin) @ R.T - p).max() < 1e-8
    assert np.abs(state.wrench["tie"]).max() < 1e-7
    assert result.effort.steps >= 7


def test_a_hinge_holds_places_and_leaves_directors_free():
    job = bending_job(held=(PrescribedDisplacement(nodes_at(strip(), LENGTH), 2),), forces=())
    job = replace(job, pressures=(Pressure(np.arange(30), np.ones(30, int), Drive(-1e3, RAMP)),))
    stiff = solve_job(job, options=PLAIN).states[0]
    loose = replace(job, ties=(replace(job.ties[0], clamped=False),))
    hinged = solve_job(loose, options=PLAIN).states[0]
    moment = hinged.wrench["guide"][0, 4] + 0.0
    assert abs(moment) < 1e-9 < 1e-5 < abs(stiff.wrench["tie"][0, 4])
    assert hinged.configuration.x[:, 2].max() > 1.5 * stiff.configuration.x[:, 2].max()


def test_a_held_director_makes_a_mirror_of_the_edge():
    job = strip(nx=16)
    edge, end = nodes_at(job, 0.0), nodes_at(job, LENGTH)
    held = (
        PrescribedDisplacement(edge, 0),
        *(PrescribedDisplacement(end, c) for c in (0, 2)),
        *fix_components(job, 1),
    )
    load = Pressure(np.arange(48), np.ones(48, int), Drive(-200.0, RAMP))
    job = replace(job, held=held, pressures=(load,))
    state = solve_job(replace(job, held_directors=(HeldDirector(edge, 0),)), options=PLAIN).states[
        0
    ]
    assert np.abs(state.configuration.d[edge, 0]).max() < 1e-12
    assert np.abs(state.configuration.d[end, 0]).min() > 1e-2


@pytest.mark.parametrize("dead", [True, False])
def test_pressure_pushes_against_the_normal(dead):
    job = bending_job(forces=())
    quads = np.arange(len(job.sheet.quads))
    load = Pressure(quads, np.full(len(quads), -1), Drive(500.0, RAMP), dead)
    state = solve_job(replace(job, pressures=(load,)), options=PLAIN).states[0]
    area = 500.0 * LENGTH * WIDTH
    assert max(state.imbalance) < 1e-7
    if dead:
        assert state.applied[:3] == pytest.approx([0, 0, area], abs=1e-12)
    else:
        assert 0.5 * area < state.applied[2] < area
        assert np.linalg.norm(state.applied[:3]) < area


@pytest.mark.parametrize(
    ("law", "stretch"),
    [
        (SpringLaw(2e3), 1e-3),
        (SpringLaw(2e3, tension_only=True), 1e-3),
        (SpringLaw(0.0, table=LoadCurve((-1e-3, 0.0, 0.5e-3, 2e-3), (-1.0, 0.0, 0.5, 5.0))), 1e-3),
    ],
)
def test_a_spring_stretches_until_it_carries_the_load(law, stretch):
    (state,) = solve_job(spring_job(law, 2.0), options=PLAIN).states
    (force,) = state.spring_forces
    assert force == pytest.approx([2.0], rel=1e-7)
    moved = state.configuration.x[0, 0]
    assert 4e-3 + moved - 3.5e-3 == pytest.approx(stretch, rel=1e-6)
    assert total(state, "spring 0", "bone")[0] == pytest.approx(2.0, rel=1e-7)


def test_a_spring_between_two_nodes_pulls_both():
    job = replace(
        strip(),
        held=(*fix_components(strip(), 1, 2), PrescribedDisplacement(nodes_at(strip(), 0.0), 0)),
    )
    a, b = (int(nodes_at(job, x)[0]) for x in (0.0, LENGTH))
    none = np.zeros((1, 3))
    tight = SpringSet(
        "tie",
        SpringLaw(500.0),
        *(np.array(v) for v in ([a], [-1])),
        none,
        np.array([b]),
        np.array([10e-3]),
    )
    (state,) = solve_job(replace(job, springs=(tight,)), options=PLAIN).states
    length = np.linalg.norm(state.configuration.x[b] - state.configuration.x[a])
    assert state.spring_forces[0][0] == pytest.approx(500.0 * (length - 10e-3), rel=1e-9)
    assert length < LENGTH - 1e-6
    assert max(state.imbalance) < 1e-8


@pytest.mark.parametrize("augmented", [False, True])
def test_a_penalty_that_is_stated_gives_as_a_spring_does(augmented):
    """A pressure p presses the sheet p / k into the body; not where multipliers keep it out."""
    job = contact_job(lift=THICK / 2 + 1e-6)
    pair = replace(job.contacts[0], penalty=1e8, automatic=False, augmented=augmented)
    load = Pressure(pair.quads, np.ones_like(pair.quads), Drive(1e4, RAMP))
    job = replace(job, contacts=(pair,), forces=(), pressures=(load,))
    (state,) = solve_job(job, options=PLAIN).states
    assert state.contact[0] == pytest.approx([0, 0, -1e4 * LENGTH * WIDTH], rel=1e-4, abs=1e-5)
    assert state.penetration == pytest.approx(0.0 if augmented else 1e-4, rel=0.01, abs=2.1e-6)


@pytest.mark.parametrize(
    ("gap", "height", "rest"),
    [(0.0, 0.0, THICK / 2), (0.1e-3, 0.0, THICK / 2 + 0.1e-3), (0.0, THICK / 2, 0.0)],
)
def test_contact_holds_the_face_that_is_meant_at_its_gap(gap, height, rest):
    job = contact_job(gap, height, lift=rest + 1e-6)
    (state,) = solve_job(job, options=PLAIN).states
    assert state.contact[0] == pytest.approx([0, 0, -1.0], abs=1e-6)
    assert state.penetration < 2e-6
    assert np.abs(state.configuration.x[:, 2] - rest).max() < 3e-6
    assert max(state.imbalance) < 1e-6


def test_a_sheet_lies_on_a_shape_as_on_triangles(tmp_path):
    """A half-space in place of a block whose flat top is of triangles."""
    job = contact_job(lift=THICK / 2 + 1e-6)
    shape = Body("block", surface=HalfSpace(np.zeros(3), np.array([0, 0, 1.0])))
    pair = replace(job.contacts[0], triangles=np.zeros((0, 3), dtype=int))
    smooth = replace(job, bodies=(shape,), contacts=(pair,))
    by_triangles, by_shape = (solve_job(j, options=PLAIN).states[0] for j in (job, smooth))
    apart = by_shape.configuration.x - by_triangles.configuration.x
    assert np.abs(apart).max() < 1e-8
    assert by_shape.contact[0] == pytest.approx([0, 0, -1.0], abs=1e-6)
    with pytest.raises(InputError, match="the body 'block' has a surface that is not of triangles"):
        write_feb(smooth, tmp_path / "shape.feb")
    with pytest.raises(InputError, match="the body 'block' has a surface that is not of triangles"):
        solve_solid(smooth)


def test_springs_with_a_toe_and_of_several_stiffnesses_pull_as_they_say(tmp_path):
    law = SpringLaw(np.array([1e3, 2e3]), tension_only=True, toe=0.5e-3)
    job, first = strip(), nodes_at(strip(), 0.0)[:2]
    places = job.sheet.points[first] - np.array([4e-3, 0, 0])
    strings = SpringSet.to_body("strings", law, first, 0, places, 4e-3)
    load = NodalForce(nodes_at(job, LENGTH), np.array([0.1, 0, 0]), RAMP)
    job = replace(
        job, bodies=(body(),), held=fix_components(job, 1, 2), springs=(strings,), forces=(load,)
    )
    (state,) = solve_job(job, options=PLAIN).states
    stretch = np.linalg.norm(state.configuration.x[first] - places, axis=1) - 4e-3
    expected = [law.force(u)[i] for i, u in enumerate(stretch)]
    assert state.spring_forces[0] == pytest.approx(expected, rel=1e-6)
    assert state.spring_forces[0].sum() == pytest.approx(0.1 * len(load.nodes), rel=1e-6)
    write_feb(change_job(job, height=THICK / 2 - THICK), tmp_path / "toe.feb")
    back = read_feb(tmp_path / "toe.feb").springs  # a set to each stiffness, the toe a table
    pulled = [s.law.force(u) for s, u in zip(back, stretch, strict=True)]
    assert pulled == pytest.approx(expected, rel=0.01)


def test_penetration_is_what_is_asked_for():
    job = contact_job(lift=THICK / 2)
    job = replace(job, held=(*job.held, PrescribedDisplacement(nodes_at(job, 0.0), 2)))
    load = NodalForce(nodes_at(job, LENGTH), np.array([0, 0, -5.0]), RAMP)
    fine = solve_job(replace(job, forces=(load,)), options=replace(PLAIN, penetration=1e-7))
    soft = solve_job(replace(job, forces=(load,)), options=replace(PLAIN, penetration=None))
    assert fine.states[0].penetration < 1e-7 < 1e-6 < soft.states[0].penetration


def test_nodes_that_a_body_carries_do_not_touch_it():
    job = contact_job(lift=THICK / 4)
    job = replace(job, held=(), ties=(Tied(nodes_at(job, 0.0), 0),))
    model = job_model(job, PLAIN)
    assert not np.isin(nodes_at(job, 0.0), model.base.contacts[0].nodes).any()
    assert len(model.base.contacts[0].nodes) == len(job.sheet.points) - len(nodes_at(job, 0.0))


def test_a_solve_that_fails_says_when_and_where():
    job = replace(spring_job(SpringLaw(1e3), 1.0), springs=())
    options = replace(PLAIN, shortest=0.5, newton=NewtonOptions(max_iterations=5))
    said = r"strip: .* at t = .*went off by 10 times its length.*node \d+0 at .*region skin"
    with pytest.raises(ConvergenceError, match=said):
        solve_job(job, options=options)


def test_times_must_ascend():
    with pytest.raises(InputError, match="expected times that ascend"):
        solve_job(bending_job(), options=PLAIN, times=[0.5, 0.5])
    with pytest.raises(InputError, match="spacing = 0: expected more than zero"):
        JobOptions(spacing=0.0)
    assert spread_times(bending_job(), until=0.6, states=2) == [0.5, 0.6]
    assert spread_times(bending_job(), until=2.0) == [1.0, 2.0]
