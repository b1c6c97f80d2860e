"""Springs and contact: their forces are their energy's, and what they carry is what presses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import ConvergenceError, InputError
from cosim.hoods.fe_supports import pose_surfaces
from cosim.port import Array, rotation_matrix
from fe_solver.forces.contact import (
    REACH,
    Contact,
    Grip,
    Status,
    contact_fields,
    contact_forces,
    contact_state,
    coulomb_defects,
    friction_of,
    inverse_ramp,
    join_point_forces,
    partition,
    ramp,
)
from fe_solver.forces.friction import Friction
from fe_solver.forces.springs import PointForces, Springs, spring_forces
from fe_solver.solver import augmented_contact
from fe_solver.solver.augmented_contact import AugmentOptions, next_increment, solve_augmented
from fe_solver.solver.body_coupling import wrenches
from fe_solver.solver.fields import contact_pressure
from fe_solver.solver.model import Configuration, ShellModel
from fe_solver.solver.newton import NewtonOptions, Solution, solve
from fe_solver.solver.residual import residual_norm
from fe_solver.supports import SpringLaw, SpringSet, springs_of
from fe_solver.surfaces.shapes import HalfSpace, Sphere, Surface
from fe_solver.surfaces.spline_distance import SplineDistance
from tests.helpers.poses import POSITION, ROTATION
from tests.proofs.fe import contact_rows, sheets
from tests.proofs.fe.sheets import NO_TENSION, at_rest, clamp, guide, plate, sheet

TIGHT = NewtonOptions(tolerance=1e-11)
DEPTHS = st.floats(-3e-4, 3e-4)
SMOOTHINGS = st.floats(1e-5, 2e-4)


@given(DEPTHS, SMOOTHINGS)
def test_ramps_integral_value_and_slope(depth, smoothing):
    h = 1e-3 * smoothing
    depth = np.array([depth])
    low, high = ramp(depth - h, smoothing), ramp(depth + h, smoothing)
    _, value, slope = ramp(depth, smoothing)
    assert (high[0] - low[0]) / (2 * h) == pytest.approx(value, rel=1e-5, abs=1e-6 * smoothing)
    assert (high[1] - low[1]) / (2 * h) == pytest.approx(slope, abs=1e-3)


@given(DEPTHS, SMOOTHINGS)
def test_ramp_is_that_of_a_gap_beyond_the_smoothing(depth, smoothing):
    integral, value, slope = ramp(np.array([depth]), smoothing)
    assert 0 <= value[0] - max(depth, 0.0) <= smoothing / 4 + 1e-18
    assert integral[0] >= 0
    if abs(depth) > smoothing:
        assert value[0] == max(depth, 0.0)
        assert slope[0] == (depth > 0)


def random_springs(rng: np.random.Generator) -> tuple[Springs, Array]:
    """Nine springs of all kinds between six nodes and two bodies, and the nodes' places (m)."""
    x = 4e-3 * rng.normal(size=(6, 3))
    springs = Springs(
        rng.integers(0, 6, 9),
        rng.integers(0, 2, 9),
        4e-3 * rng.normal(size=(9, 3)),
        rng.uniform(100, 300, 9),
        rng.uniform(1e-3, 12e-3, 9),
        np.arange(9) % 2 == 0,
        np.zeros(9, dtype=np.intp),
    )
    return springs, x


def touching(rng: np.random.Generator) -> tuple[Contact, Array]:
    """Nodes around a sphere's contact level, in it, in its smoothing and out of it."""
    direction = rng.normal(size=(12, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    away = 5e-3 + 0.5e-3 + np.linspace(-3e-4, 2e-4, 12)
    centre = np.array([1e-3, 0.0, 2e-3])
    x = POSITION[1] + (centre + away[:, None] * direction) @ ROTATION[1].T
    area = rng.uniform(0.5e-6, 2e-6, 12)
    sphere = Sphere(centre, 5e-3)
    return Contact(1, sphere, np.arange(12), np.full(12, 0.5e-3), area, 1e10, 1e-4), x


def by_node(forces: PointForces, n: int) -> Array:
    out = np.zeros((n, 3))
    np.add.at(out, forces.node, forces.gradient)
    return out


@pytest.mark.parametrize("kind", ["springs", "contact"])
@pytest.mark.parametrize("seed", range(3))
def test_forces_are_their_energys(kind, seed):
    """Gradient and Hessian by the nodes, and force and moment on the bodies, by differences."""
    rng = np.random.default_rng(seed)
    thing, x = random_springs(rng) if kind == "springs" else touching(rng)
    act = spring_forces if kind == "springs" else contact_forces
    here = act(thing, x, POSITION, ROTATION, True)
    n, h = len(x), 1e-7
    assert (np.linalg.norm(here.gradient, axis=1) > 0).sum() > 4
    for v in rng.normal(size=(3, n, 3)):
        low, high = (act(thing, x + s * h * v, POSITION, ROTATION, True) for s in (-1, 1))
        slope = (high.energy - low.energy) / (2 * h)
        assert np.vdot(by_node(here, n), v) == pytest.approx(slope, rel=1e-6)
        change = (by_node(high, n) - by_node(low, n)) / (2 * h)
        product = np.zeros((n, 3))
        np.add.at(product, here.node, np.einsum("kij,kj->ki", here.hessian, v[here.node]))
        assert product == pytest.approx(change, abs=1e-5 * np.abs(change).max())
    for twist in rng.normal(size=(3, 2, 6)):
        twist[:, :3] *= 1e-2
        energy = [
            act(
                thing,
                x,
                POSITION + s * h * twist[:, :3],
                rotation_matrix(s * h * twist[:, 3:]) @ ROTATION,
                True,
            ).energy
            for s in (-100, 100)
        ]
        wrench = np.zeros((2, 6))
        moments = np.cross(here.arm, here.gradient)
        np.add.at(wrench, here.body, np.hstack([here.gradient, moments]))
        slope = (energy[1] - energy[0]) / (200 * h)
        assert -np.vdot(wrench, twist) == pytest.approx(slope, rel=1e-5)


def test_nodes_out_of_reach_are_left_out():
    contact, x = touching(np.random.default_rng(0))
    far = x + 2 * REACH * (x - x.mean(axis=0)) / np.linalg.norm(x - x.mean(axis=0), axis=1)[:, None]
    assert len(contact_forces(contact, x + 1.0, POSITION, ROTATION, True).node) == 0
    both = [contact_forces(contact, p, POSITION, ROTATION, True) for p in (x, far)]
    assert len(both[1].node) < len(both[0].node) == 12
    assert join_point_forces(both).energy == pytest.approx(both[0].energy + both[1].energy)


@pytest.mark.parametrize("surface", ["half-space", "sphere"])
def test_a_pressed_sheet_hands_on_the_load(surface):
    """A sheet pressed down by its guided corners: the bone feels the tendon's force, and no node
    sinks in deeper than the smoothing."""
    X, quads = plate(12e-3, 12e-3, 12, 12)
    X = X - [6e-3, 6e-3, 0]
    model = sheet(X, quads, 1e8, 0.3, 0.6e-3)
    corners = np.flatnonzero((np.abs(X[:, :2]) > 5.9e-3).all(axis=1))
    model = guide(model, [corners], [(0.0, 0, -1)])
    bone = {
        "half-space": HalfSpace(np.zeros(3), np.array([0.0, 0, 1])),
        "sphere": Sphere(np.array([0.0, 0, -12e-3]), 12e-3),
    }[surface]
    free = np.setdiff1d(np.arange(len(X)), corners)
    smoothing = 5e-5
    touching = sheets.contact(model, bone, free, 2e11, smoothing)
    model = replace(model, contacts=(touching,))
    force = np.array([4.0])
    solution = solve(model, at_rest(model), force, TIGHT)
    c = solution.configuration
    wrench = wrenches(model, c, solution.evaluation, force)["contact"][0]
    assert wrench == pytest.approx([0, 0, -4.0, 0, 0, 0], abs=1e-8)
    gap = touching.gap(c.x, *sheets.GROUND)
    assert abs(gap.min()) < smoothing
    pressure = np.zeros(len(X))
    pressure[free] = contact_pressure(model, c)[free]
    normal = -bone.distance(c.x)[1] * (pressure[:, None] * node_area(touching, len(X)))
    assert normal.sum(axis=0) == pytest.approx(wrench[:3], abs=1e-8)


def node_area(contact: Contact, n: int) -> Array:
    out = np.zeros((n, 1))
    out[contact.nodes, 0] = contact.area
    return out


def test_without_contact_force_there_is_no_load():
    X, quads = plate(10e-3, 10e-3, 4, 4)
    model = clamp(sheet(X, quads, 1e8, 0.3, 0.6e-3), np.arange(5))
    floor = HalfSpace(np.array([0.0, 0, -1e-3]), np.array([0.0, 0, 1]))
    model = replace(model, contacts=(sheets.contact(model, floor, np.arange(5, 25), 1e11, 5e-5),))
    solution = solve(model, at_rest(model), NO_TENSION, TIGHT)
    wrench = wrenches(model, at_rest(model), solution.evaluation, NO_TENSION)
    assert solution.iterations == 0
    assert (wrench["contact"] == 0).all()
    assert np.abs(wrench["tie"]).max() < 1e-12


@given(st.floats(0, 1e-3), SMOOTHINGS)
def test_the_depth_of_a_ramps_value(value, smoothing):
    depth = inverse_ramp(np.array([value]), smoothing)
    assert ramp(depth, smoothing)[1] == pytest.approx(value, abs=1e-12)
    assert depth >= -smoothing


def press_sheet(friction: float = 0.0, **changes) -> ShellModel:
    """A small stiff sheet on the ground, pressed by 1 N and held by springs along x to a second
    body."""
    X, quads = plate(4e-3, 4e-3, 2, 2)
    model = sheet(X, quads, 1e9, 0.3, 1e-3, bodies=("ground", "hand"))
    dead = np.zeros_like(X)
    dead[:, 2] = -1.0 / len(X)
    everywhere, ends = np.arange(len(X)), X + np.array([50e-3, 0, 0])
    strings = SpringSet.to_body("strings", SpringLaw(1e3), everywhere, 1, ends, 50e-3)
    floor = HalfSpace(np.zeros(3), np.array([0.0, 0, 1]))
    contact = sheets.contact(model, floor, everywhere, 1e9, 1e-6)
    contact = replace(contact, friction=friction, **changes)
    return replace(model, dead=dead, springs=springs_of([strings]), contacts=(contact,))


def drag_sheet(model: ShellModel, c: Configuration, by: float) -> Solution:
    position = c.position.copy()
    position[1, 0] = by
    return solve_augmented(model, model.move_bodies(c, position, c.rotation), NO_TENSION, TIGHT)


@pytest.mark.parametrize("share", [None, np.full(9, 0.5)])
def test_a_block_sticks_slides_and_gives_heat(share):
    """Coulomb's block drawn by springs of 9 N/mm: sticks below mu N, then slides; on the way back
    it sticks at once.  The heat is the limit times the slip."""
    model = press_sheet(0.4, shear=1e13, share=share)
    c, drags, heats = at_rest(model), [], []
    for by in (0.02e-3, 0.1e-3, 0.2e-3, 0.19e-3):
        solution = drag_sheet(model, c, by)
        c, model = solution.configuration, next_increment(solution)
        state = contact_state(solution.model.contacts[0], c.x, c.position, c.rotation)
        drags.append(state.drag[:, 0].sum())
        heats.append(sum(k.grip.dissipated.sum() for k in model.contacts if k.grip))
        slides = by in (0.1e-3, 0.2e-3)
        assert (state.status == (Status.SLIDING if slides else Status.STICKING)).all()
    assert drags == pytest.approx([-0.18, -0.4, -0.4, -0.31], rel=1e-3)
    slid = 0.2e-3 - 0.4 / 9e3
    assert heats[0] == 0
    assert heats[2] == pytest.approx(0.4 * slid, rel=1e-2)
    assert heats[3] == heats[2]


def test_friction_by_hand():
    """Elastic to the limit of 2 N at 2 um, then constant, with no jump of force or energy; what
    goes along the normal is no slip."""
    n, none = 5, np.zeros(5)
    slip = np.array([0, 1e-6, 2e-6 - 1e-12, 2e-6 + 1e-12, 3e-6])
    local = np.outer(slip, [0.6, 0.8, 0]) + np.outer(np.arange(n), [0, 0, 1e-3])
    grip = Grip(np.zeros((n, 3)), np.tile([0.0, 0, 1], (n, 1)), np.full(n, 2.0), none)
    floor = HalfSpace(np.zeros(3), np.array([0.0, 0, 1]))
    area = np.full(n, 1e-6)
    contact = Contact(0, floor, np.arange(n), none, area, 1e9, 1e-6, friction=0.4, shear=1e12)
    friction = friction_of(contact, grip, local)
    energy, gradient = friction.energy(), friction.linear(friction.sliding())[0]
    assert energy == pytest.approx([0, 0.5e-6, 2e-6, 2e-6, 4e-6], rel=1e-5)
    assert gradient == pytest.approx(np.outer([0, 1, 2, 2, 2], [0.6, 0.8, 0]), rel=1e-5)


def test_friction_beyond_the_cone_and_friction_that_drives_are_found():
    """On 1 N of normal force: the limit that is held, 3 N and 0.3 N, against 0.4 times it; and a
    force along the slip in place of against it."""
    n, up = 1, np.array([[0.0, 0, 1]])
    floor = HalfSpace(np.zeros(3), up[0])
    slip, pose = np.array([[5e-6, 0, -1e-6]]), (np.zeros((1, 3)), np.eye(3)[None])
    grip = Grip(np.zeros((n, 3)), up, np.full(n, 0.4), np.zeros(n))
    contact = Contact(
        0, floor, np.arange(n), np.zeros(n), np.full(n, 1e-3), 1e9, 1e-12, friction=0.4, grip=grip
    )
    kept = coulomb_defects(contact, slip, *pose)
    assert kept.excess == pytest.approx(0.0, abs=1e-9)
    assert kept.limit == pytest.approx(0.4)
    assert (kept.made, kept.work) == (0.0, pytest.approx(0.4 * 5e-6))
    beyond = replace(contact, grip=replace(grip, limit=np.full(n, 3.0)))
    assert coulomb_defects(beyond, slip, *pose).excess == pytest.approx(2.6)
    driven = replace(contact, grip=replace(grip, limit=np.full(n, -0.4)))
    assert coulomb_defects(driven, slip, *pose).made > 0.9 * 0.4 * 5e-6


def test_shares_divide_the_load_and_none_lets_through():
    whole = press_sheet()
    quarter = np.full(9, 0.25)
    halves = tuple(
        replace(whole.contacts[0], body=b, share=s) for b, s in enumerate((quarter, 1 - quarter))
    )
    model = replace(whole, contacts=halves)
    one, two = (solve(m, at_rest(m), NO_TENSION, TIGHT).configuration for m in (whole, model))
    held = [0, 2]  # nothing resists a slide along y, across the springs
    assert two.x[:, held] == pytest.approx(one.x[:, held], abs=1e-12)
    found = contact_fields(halves, two.x, two.position, two.rotation)
    assert found.pressure[:, 1] == pytest.approx(3 * found.pressure[:, 0])
    assert (found.status == Status.SLIDING).all()
    single = contact_fields(whole.contacts, one.x, one.position, one.rotation)
    assert found.pressure.sum(axis=1) == pytest.approx(single.pressure[:, 0], rel=1e-6)
    assert np.isinf(single.gap[:, 1]).all()
    nothing = replace(whole.contacts[0], share=np.zeros(9))
    deep = contact_forces(nothing, one.x - [0, 0, 1e-3], one.position, one.rotation, True)
    assert not deep.gradient.any()


def test_augmented_pressure_does_not_know_penalty_or_smoothing():
    """The whole load is carried at a gap below what is asked for."""
    for stiffness, smoothing in ((1e8, 1e-6), (1e9, 1e-4), (1e10, 1e-6)):
        model = press_sheet(stiffness=stiffness, smoothing=smoothing)
        options = AugmentOptions(penetration=1e-9)
        solution = solve_augmented(model, at_rest(model), NO_TENSION, TIGHT, options)
        c = solution.configuration
        state = contact_state(solution.model.contacts[0], c.x, c.position, c.rotation)
        assert np.abs(state.gap[state.pressure > 0]).max() <= 1e-9
        assert state.pressure @ model.contacts[0].area == pytest.approx(1.0)
        penalty = solve(model, at_rest(model), NO_TENSION, TIGHT).configuration
        gap = model.contacts[0].gap(penalty.x, *sheets.GROUND)
        assert np.abs(gap).max() > 1e-6


def test_pressed_nodes_stand_for_constraints_in_the_derivatives():
    """Springs as stiff as the sheet press its nodes on the ground, and follow the
    hand that they hang on: the nodes do not."""
    model = press_sheet()
    n, height = len(model.reference), np.array([0.0, 0, 50e-3])
    up = replace(model.springs, anchor=model.reference + height, stiffness=np.full(n, 1e6))
    model = replace(model, springs=up)
    solution = solve_augmented(model, at_rest(model), NO_TENSION, TIGHT)
    heights = np.flatnonzero(model.free % 5 == 2)
    by_hand = solution.sensitivity[heights, 6 + 2]
    assert len(by_hand) == n
    assert np.abs(by_hand).max() < 2e-3


@pytest.mark.parametrize("tolerance", [1e-6, 1e-8, 1e-10])
def test_the_last_round_is_solved_to_the_tolerance(tolerance):
    """However loosely those before it were, and what is asked of the gaps."""
    model, options = press_sheet(stiffness=1e8), NewtonOptions(tolerance)
    for penetration in (1e-4, 1e-6):
        augment = AugmentOptions(penetration=penetration)
        found = solve_augmented(model, at_rest(model), NO_TENSION, options, augment)
        residual, force = residual_norm(found.model, found.evaluation)
        assert residual <= tolerance * force


def test_a_stiffer_contact_sticks_as_before():
    model = press_sheet(0.4, stiffness=1e7)
    solution = drag_sheet(model, at_rest(model), 0.1e-3)
    began, ended = model.contacts[0], solution.model.contacts[0]
    assert ended.stiffness > began.stiffness
    assert ended.stick == pytest.approx(began.stick)


def test_multipliers_and_limits_follow_the_whole_steps(monkeypatch):
    """Held until the sheet is at rest, they then change by more, and the contact is stiffened."""
    after = contact_rows.wrap_strap(0.3, (0.3e-3,), 48)
    monkeypatch.setattr(augmented_contact, "_settle", lambda augment, model, c: model)
    held = contact_rows.wrap_strap(0.3, (0.3e-3,), 48)
    assert after.solves < 0.9 * held.solves
    assert after.model.contacts[0].stiffness < held.model.contacts[0].stiffness
    tensions = [contact_rows.far_tension(s) for s in (after, held)]
    assert tensions[0] == pytest.approx(tensions[1], rel=1e-3)


def test_whole_steps_circle_near_a_block_that_turns_back(monkeypatch):
    """From where it slid, the limits of friction as they were but for rounding."""
    solves = []
    for near in (augmented_contact.NEAR_BALANCE, 0.0):
        monkeypatch.setattr(augmented_contact, "NEAR_BALANCE", near)
        model = press_sheet(0.1, shear=1e13)
        c = at_rest(model)
        for by in (0.02e-3, 0.1e-3, 0.2e-3, 0.19e-3):
            solution = drag_sheet(model, c, by)
            c, model = solution.configuration, next_increment(solution)
        solves.append(solution.solves)
    assert solves[0] < 0.75 * solves[1]


@pytest.mark.parametrize("by", [0.02e-3, -0.02e-3])
def test_a_block_that_turns_back_is_predicted_to_stick(monkeypatch, by):
    """Near its anchor, drawn by 9 N/mm there: with nothing predicted its steps slide it to and
    fro."""
    model = press_sheet(0.4, shear=1e13)
    slid = drag_sheet(model, at_rest(model), 0.1e-3)
    contacts = tuple(replace(k, pin=None) for k in slid.model.contacts)
    model, c = slid.model.with_changes(contacts=contacts), slid.configuration
    position = c.position.copy()
    position[1, 0] = by
    c, solves = model.move_bodies(c, position, c.rotation), []
    for _ in range(2):
        found = solve(model, c, NO_TENSION, TIGHT, near=True)
        at = found.configuration
        state = contact_state(model.contacts[0], at.x, at.position, at.rotation)
        assert state.drag[:, 0].sum() == pytest.approx(-9e3 * by, rel=1e-3)
        assert (state.status == Status.STICKING).all()
        solves.append(found.solves)
        monkeypatch.setattr(Friction, "after", lambda self, before, travel: before)
    assert solves[0] < solves[1] / 2


def test_points_that_turn_back_stick_before_they_slide():
    """By hand, with a limit of 2 N and 1 N/m: of two that slid 5 m, one turns back to 1 m from its
    anchor and one beyond; one that stuck goes on by 3 m along y."""
    slip = np.array([[5.0, 0, 0], [5.0, 0, 0], [1.0, 0, 0]])
    up = np.tile([0.0, 0, 1], (3, 1))
    friction = Friction.of(slip, up, np.ones(3), np.full(3, 2.0))
    travel = np.array([[-4.0, 0, 7], [-9.0, 0, 0], [-1.0, 3, 0]])
    then = friction.after(friction.sliding(), travel)
    assert then.slides.tolist() == [False, False, True]
    assert then.along == pytest.approx(np.array([[0.0, 0, 0], [0, 0, 0], [0, 1, 0]]))
    gradient, hessian = friction.linear(then)
    assert gradient[:2] == pytest.approx(slip[:2])
    end = gradient[2] + hessian[2] @ travel[2]
    assert end == pytest.approx(np.array([0.0, 2, 0]))


def test_a_loop_that_cannot_end_says_where():
    model = press_sheet(stiffness=1e8)
    with pytest.raises(ConvergenceError, match=r"2 rounds: node \d+ at .* on the body ground"):
        solve_augmented(
            model,
            at_rest(model),
            NO_TENSION,
            TIGHT,
            AugmentOptions(penetration=1e-12, max_rounds=2),
        )


@given(st.lists(st.floats(-2e-3, 2e-3), min_size=3, max_size=3), st.floats(1e-4, 1e-3))
def test_a_partition_adds_up_and_changes_smoothly(distances, blend):
    at, h = np.array([distances]), 1e-6 * blend
    share = partition(at, blend)
    assert share.sum() == pytest.approx(1)
    assert ((share >= 0) & (share <= 1)).all()
    nearest = np.argmin(at)
    if (np.delete(at - at[0, nearest], nearest) > blend).all():
        assert share[0, nearest] == 1
    for way in np.eye(3):
        low, high = (partition(at + s * h * way, blend) for s in (-1, 1))
        forward, back = (high - share) / h, (share - low) / h
        assert forward == pytest.approx(back, abs=1e-4 / blend)  # C1: no kink
    assert partition(np.array([[1e-3, 1e-3]]), blend) == pytest.approx(np.array([[0.5, 0.5]]))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"stiffness": 0.0}, "stiffness .* must be positive"),
        ({"smoothing": -1e-6}, "smoothing .* must be positive"),
        ({"shear": np.nan}, "shear"),
        ({"friction": -0.1}, "friction coefficient"),
        ({"share": np.full(9, 1.1)}, "between 0 and 1"),
    ],
)
def test_impossible_contacts_are_refused(changes, words):
    with pytest.raises(InputError, match=words):
        press_sheet(**changes)
    with pytest.raises(InputError, match="blending length"):
        partition(np.zeros((1, 2)), 0.0)
    with pytest.raises(InputError, match="positive tolerances"):
        AugmentOptions(penetration=0.0)


@pytest.mark.parametrize("level", [4.6e-3, 6e-3, 10e-3])
def test_contact_high_over_a_baked_bone_is_that_of_the_exact_shape(level):
    """Where a bone's distance ends, contact has no normal, and beyond it no pressure."""
    ball = trimesh.creation.icosphere(4, 5e-3)
    [surface] = pose_surfaces({"ball": (ball.vertices, ball.faces)}, {"ball": level}).values()
    rng = np.random.default_rng(1)
    away = rng.normal(size=(40, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    x = (5e-3 + level - rng.uniform(0.05e-3, 0.4e-3, 40))[:, None] * away
    nodes, area = np.arange(40), np.full(40, 1e-6)

    def pressed(on: Surface) -> PointForces:
        contact = Contact(0, on, nodes, np.full(40, level), area, 1e9, 5e-5)
        return contact_forces(contact, x, np.zeros((1, 3)), np.eye(3)[None], True)

    baked, exact = pressed(surface), pressed(Sphere(np.zeros(3), 5e-3))
    assert len(baked.force) == 40
    np.testing.assert_allclose(baked.gradient, exact.gradient, atol=0.01)  # N, of 0.4
    assert baked.energy == pytest.approx(exact.energy, rel=0.06)  # chords of the triangles


@pytest.mark.parametrize("level", [3.5e-3, 5.5e-3, 7.5e-3, 3.5e-3 + 1e-12, 5.5e-3 - 1e-12])
def test_a_level_at_the_end_of_a_baked_distance_is_reached(level):
    ball = trimesh.creation.icosphere(1, 5e-3)
    [surface] = pose_surfaces({"ball": (ball.vertices, ball.faces)}, {"ball": level}).values()
    one = np.ones(1)
    assert Contact(0, surface, np.array([0]), level * one, one, 1e9, 5e-5).surface is surface
    assert surface.outside < level + 2e-3 + 1.5e-3


def test_a_surface_that_does_not_reach_the_contact_is_refused():
    ball = trimesh.creation.icosphere(2, 5e-3)
    surface = SplineDistance.bake(ball.vertices, ball.faces, margin=5e-3)
    one = np.ones(1)
    Contact(0, surface, np.array([0]), 3.5e-3 * one, one, 1e9, 5e-5)
    with pytest.raises(InputError, match=r"touches up to 3\.6 mm .* margin of 5\.1 mm or more"):
        Contact(0, surface, np.array([0]), 3.6e-3 * one, one, 1e9, 5e-5)
    with pytest.raises(InputError, match=r"margin of 6 mm"):  # the pressure sets in further off
        Contact(0, surface, np.array([0]), 2e-3 * one, one, 1e9, 4e-3)


@given(st.floats(1e-4, 6e-3), st.floats(1e-4, 5e-3))
def test_contact_follows_the_ramp_at_any_gap_and_smoothing(gap, smoothing):
    """With a smoothing beyond the watched gap, energy and force once jumped there."""
    plane = HalfSpace(np.zeros(3), np.array([0.0, 0.0, 1.0]))
    contact = Contact(0, plane, np.array([0]), np.zeros(1), np.array([1e-6]), 1e9, smoothing)
    found = contact_forces(
        contact, np.array([[0.0, 0.0, gap]]), np.zeros((1, 3)), np.eye(3)[None], True
    )
    energy, force, _ = ramp(np.array([-gap]), smoothing)
    assert found.energy == pytest.approx(1e3 * energy[0], rel=1e-12, abs=1e-18)
    assert found.force.sum() == pytest.approx(1e3 * force[0], rel=1e-12, abs=1e-15)
