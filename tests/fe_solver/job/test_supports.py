"""A sheet that nothing holds is not reported as solved; one that something holds is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.port import rotation_matrix
from fe_solver.forces.contact import Contact
from fe_solver.job.job import HeldDirector, Job, NodalForce, PrescribedDisplacement
from fe_solver.job.model import JobOptions, job_model
from fe_solver.job.rigid_modes import FreeMotions, rigid_freedoms
from fe_solver.job.solve import solve_job
from fe_solver.solver.augmented_contact import AugmentOptions, solve_augmented
from fe_solver.solver.model import Configuration, Evaluation, ShellModel
from fe_solver.solver.newton import NewtonOptions, solve
from fe_solver.supports import SpringLaw, SpringSet, Tied
from fe_solver.surfaces.shapes import Cylinder, HalfSpace, Surface
from tests.helpers.jobs import LENGTH, RAMP, WIDTH, body, change_job, strip

OPTIONS = JobOptions(cached=False)
NO_TENSION = np.zeros(0)


def at(job: Job, x: float) -> NDArray[np.intp]:
    return np.flatnonzero(np.isclose(job.sheet.points[:, 0], x))


def strings(job: Job, nodes: Sequence[int], reach: Sequence[float], **law: bool) -> SpringSet:
    """To points of the first body, at rest."""
    anchor, law = job.sheet.points[nodes] + np.array(reach), SpringLaw(1e3, **law)
    rest = float(np.linalg.norm(reach))
    return SpringSet.to_body("strings", law, np.array(nodes), 0, anchor, rest)


def pins(job: Job, *held: tuple[int, int]) -> tuple[PrescribedDisplacement, ...]:
    return tuple(PrescribedDisplacement(np.array([n]), k) for n, k in held)


def evaluate_job(job: Job) -> tuple[ShellModel, Configuration, Evaluation]:
    model = job_model(job, OPTIONS)
    own, c = model.at(0.0), model.start()
    return own, c, own.evaluate(c, NO_TENSION, tangent=True)


def freedoms(job: Job) -> int:
    return sum(len(f.shift) for f in rigid_freedoms(*evaluate_job(job)))


def weight(job: Job, *force: float) -> tuple[NodalForce, ...]:
    every = np.arange(len(job.sheet.points))
    return (NodalForce(every, np.array(force) / len(every), RAMP),)


def corners(job: Job) -> tuple[int, int, int]:
    left, right = at(job, 0.0), at(job, LENGTH)
    return int(left[0]), int(left[-1]), int(right[0])


def test_three_two_and_one_directions_hold_a_sheet() -> None:
    job = strip(4, 2, 0.3)
    a, b, c = corners(job)
    held = pins(job, (a, 0), (a, 1), (a, 2), (b, 0), (b, 2), (c, 2))
    (state,) = solve_job(replace(job, held=held), options=OPTIONS).states
    np.testing.assert_allclose(state.configuration.x, job.sheet.points, atol=1e-12)
    for i in range(6):
        assert freedoms(replace(job, held=held[:i] + held[i + 1 :])) == 1


def test_nodes_nearly_on_a_line_hold_a_sheet() -> None:
    job = strip(4, 2, 0.3)
    points = job.sheet.points.copy()
    points[1, 0] += 0.1e-3
    held = tuple(PrescribedDisplacement(at(job, 0.0), k) for k in range(3))
    assert freedoms(replace(job, held=held)) == 1
    assert freedoms(change_job(job, held=held, points=points)) == 0


def test_a_hinge_is_told_by_its_axis() -> None:
    job = strip(4, 2, 0.3)
    held = tuple(PrescribedDisplacement(at(job, 0.0), k) for k in range(3))
    words = r"at t = 1 the sheet of node 10 can turn about y through \(0, 2.5, 0\) mm, and nothing"
    with pytest.raises(InputError, match=words):
        solve_job(replace(job, held=held), options=OPTIONS)


def test_an_axis_that_is_none_of_the_frame_is_told_by_its_components() -> None:
    job = strip(4, 2, 0.3)
    turn = rotation_matrix(np.array([0, 0, np.pi / 6]))
    turned = change_job(job, points=job.sheet.points @ turn.T, fibre=job.sheet.fibre @ turn.T)
    held = tuple(PrescribedDisplacement(at(job, 0.0), k) for k in range(3))
    (free,) = rigid_freedoms(*evaluate_job(replace(turned, held=held)))
    direction = free.turn[0] / np.linalg.norm(free.turn[0])
    np.testing.assert_allclose(np.abs(direction @ turn[:, 1]), 1.0, atol=1e-9)
    assert "turn about (" in free.words()


@pytest.mark.parametrize(
    ("components", "words"),
    [
        ((0, 2), "move along y"),
        ((2,), "move freely (2 translations and 1 rotation)"),
        ((0, 1), "move freely (1 translation and 2 rotations)"),
    ],
)
def test_what_is_free_is_told_in_words(components: tuple[int, ...], words: str) -> None:
    job = strip(4, 2, 0.3)
    every = np.arange(len(job.sheet.points))
    held = tuple(PrescribedDisplacement(every, k) for k in components)
    (free,) = rigid_freedoms(*evaluate_job(replace(job, held=held)))
    assert free.words() == words


@pytest.mark.parametrize("tied", [True, False])
def test_one_clamped_node_leaves_the_turn_about_its_director(tied: bool) -> None:
    job = strip(4, 2, 0.3, bodies=(body(),))
    if tied:
        job = replace(job, ties=(Tied(np.array([4]), 0),))
    else:
        still = tuple(HeldDirector(np.array([4]), k) for k in (0, 1))
        job = replace(job, held=pins(job, (4, 0), (4, 1), (4, 2)), held_directors=still)
    (free,) = rigid_freedoms(*evaluate_job(job))
    x, y, _ = 1e3 * job.sheet.points[4]
    assert free.words() == f"turn about z through ({x:.4g}, {y:.4g}, 0) mm"


def test_slides_and_screws_are_told() -> None:
    size = (np.arange(3), 1, np.zeros(3), 2.0)
    plane = FreeMotions(size[0], 1, np.eye(3)[:2], np.zeros((2, 3)), size[2], 2.0)
    assert plane.words() == "move along x and y"
    screw = FreeMotions(size[0], 1, np.array([[0.1, 0, 0]]), np.eye(3)[:1], size[2], 2.0)
    assert screw.words() == "turn about x through (0, 0, 0) mm and along it"
    beside = FreeMotions(size[0], 1, np.array([[0, 0.5, 0]]), np.eye(3)[:1], size[2], 2.0)
    assert beside.words() == "turn about x through (0, 0, 1000) mm"


def test_slack_strings_hold_nothing_and_taut_ones_a_pendulum() -> None:
    """Two strings with a weight: its swings are held by the weight alone."""
    job = strip(4, 2, 0.3, bodies=(body(),))
    hung = replace(
        job, springs=(strings(job, [*corners(job)[:2]], [-5e-3, 0, 0], tension_only=True),)
    )
    with pytest.raises(InputError, match=r"3 translations and 3 rotations.*taut"):
        solve_job(hung, options=OPTIONS)
    for pull in (0.1, 1e-5):
        (state,) = solve_job(replace(hung, forces=weight(job, pull, 0, 0)), options=OPTIONS).states
        assert sum(state.spring_forces[0]) == pytest.approx(pull)
    one = replace(job, springs=(strings(job, [at(job, 0.0)[1]], [-5e-3, 0, 0]),))
    with pytest.raises(InputError, match="can turn about x"):
        solve_job(replace(one, forces=weight(job, 0.1, 0, 0)), options=OPTIONS)


def two_strips(job: Job) -> Job:
    """The strip and its copy 1 mm beyond its end."""
    n = len(job.sheet.points)
    return change_job(
        job,
        points=np.concatenate(
            [job.sheet.points, job.sheet.points + np.array([LENGTH + 1e-3, 0, 0])]
        ),
        node_ids=np.arange(1, 2 * n + 1) * 10,
        quads=np.concatenate([job.sheet.quads, job.sheet.quads + n]),
        element_ids=np.arange(1, 2 * len(job.sheet.quads) + 1),
        **{k: np.concatenate([getattr(job.sheet, k)] * 2) for k in ("part", "thickness", "height")},
        fibre=np.concatenate([job.sheet.fibre] * 2),
        held=tuple(PrescribedDisplacement(np.arange(n), k) for k in range(3)),
        bodies=(body(),),
    )


def test_the_piece_that_is_free_is_named() -> None:
    n = len(strip(4, 2, 0.3).sheet.points)
    job = two_strips(strip(4, 2, 0.3))
    loose = replace(job, springs=(strings(job, [n], [0, 0, 5e-3], tension_only=True),))
    words = rf"node {10 * (n + 1)}, one of 2 pieces, can move freely \(3 translations and 3 rot"
    with pytest.raises(InputError, match=words):
        solve_job(loose, options=OPTIONS)


def test_springs_between_pieces_hold_one_by_the_other() -> None:
    n, job = len(strip(4, 2, 0.3).sheet.points), two_strips(strip(4, 2, 0.3))
    near, far = at(job, LENGTH), at(job, LENGTH + 1e-3)
    flat = strings(job, far.tolist(), [0, 0, 0])
    flat = replace(flat, body=np.full(len(far), -1), other=near, length=np.full(len(far), 1e-3))
    (free,) = rigid_freedoms(*evaluate_job(replace(job, springs=(flat,))))
    assert free.nodes.tolist() == list(range(n, 2 * n))
    assert len(free.shift) == 4  # they hold x and the turn about z
    held = (*job.held, *pins(job, (n, 1), (n, 2), (2 * n - 1, 2), (n + 1, 2)))
    assert freedoms(replace(job, springs=(flat,), held=held)) == 0


def over(surface: Surface, job: Job, friction: float = 0.0) -> tuple[FreeMotions, ...]:
    """What is free of a sheet that is pressed on a surface by a pressure along its normals."""
    slack = replace(strings(job, [0], [0, 0, 5e-3], tension_only=True), length=np.ones(1))
    model = job_model(replace(job, bodies=(body(),), springs=(slack,)), OPTIONS)
    every = np.arange(len(job.sheet.points))
    area = np.full(len(every), LENGTH * WIDTH / len(every))
    touch = Contact(0, surface, every, 0 * area, area, 1e11, 1e-7, friction=friction)
    pressed = model.base.with_changes(
        contacts=(touch,), pressure=np.full(len(job.sheet.quads), 1e3)
    )
    tight = NewtonOptions(tolerance=2e-6)
    if friction:
        found = solve_augmented(pressed, model.start(), NO_TENSION, tight, AugmentOptions())
    else:
        found = solve(pressed, model.start(), NO_TENSION, tight)
    return rigid_freedoms(found.model, found.configuration, found.evaluation)


def test_contact_holds_across_and_with_friction_along() -> None:
    floor = HalfSpace(np.zeros(3), np.array([0, 0, 1.0]))
    (free,) = over(floor, strip(4, 2, 0.3))
    assert free.words() == "move freely (2 translations and 1 rotation)"
    assert over(floor, strip(4, 2, 0.3), friction=0.3) == ()


def test_a_sheet_on_a_cylinder_slides_along_it_and_around_it() -> None:
    job, radius = strip(8, 2, 0.3), 8e-3
    angle = (job.sheet.points[:, 0] - LENGTH / 2) / radius
    around = np.stack(
        [radius * np.sin(angle), job.sheet.points[:, 1], radius * np.cos(angle)], axis=1
    )
    along = np.stack([np.cos(angle), 0 * angle, -np.sin(angle)], axis=1)[job.sheet.quads].mean(
        axis=1
    )
    axis = Cylinder(np.zeros(3), np.array([0, 1.0, 0]), radius)
    (free,) = over(axis, change_job(job, points=around, fibre=along))
    assert free.words() == "move freely (1 translation and 1 rotation)"
    np.testing.assert_allclose(free.turn[:, [0, 2]], 0.0, atol=1e-6)


@settings(max_examples=40)
@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 2)), min_size=1, max_size=8))
def test_the_count_is_six_less_the_rank_of_what_is_held(held: list[tuple[int, int]]) -> None:
    job = strip(2, 1, 0.3)
    rows = []
    for node, k in held:
        rows.append(
            np.concatenate([np.eye(3)[k], np.cross(job.sheet.points[node], np.eye(3)[k]) / 0.02])
        )
    rank = np.linalg.matrix_rank(np.array(rows), tol=1e-9)
    assert freedoms(replace(job, held=pins(job, *held))) == 6 - rank
