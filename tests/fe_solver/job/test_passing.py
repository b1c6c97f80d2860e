"""A sheet is not passed through: whatever the steps are and whatever is kept, and if a pair never
touches, that is told."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from cosim.errors import InputError
from fe_solver.febio.read import read_feb
from fe_solver.febio.write import write_feb
from fe_solver.job.curves import Drive
from fe_solver.job.job import Step
from fe_solver.job.solve import solve_job, spread_times, way_marks
from fe_solver.q4ans.model import obstacles
from fe_solver.q4ans.solve import solve_solid
from fe_solver.solver.continuation import free_share
from fe_solver.supports import Body, ContactPair, Tied
from fe_solver.surfaces.shapes import Sphere
from tests.helpers.jobs import (
    LENGTH,
    PLAIN,
    RAMP,
    THICK,
    WIDTH,
    change_job,
    nodes_at,
    run,
    strip,
)

FACES = {"below": -1, "above": 1}
"""Where the body is, and the face of the strip that it comes to."""


def raised(surface: Body, way: float, where: str = "below", friction: float = 0.0, **more):
    """A cantilever, its nodes on the face away from a body that moves by `way` (m) towards it."""
    job = strip(10, 2)
    side = FACES[where]
    ends = Drive(-side * way, RAMP)
    moved = replace(surface, displacement=(Drive(), Drive(), ends))
    quads = np.arange(len(job.sheet.quads))
    pair = ContactPair(
        "pair", quads, np.full(len(quads), side), 0, moved.triangles, friction=friction
    )
    height = np.full_like(job.sheet.height, -side * THICK / 2)
    # the nodes' face is that which touches: the sheet lies behind it
    return change_job(
        job,
        height=height,
        bodies=(moved,),
        ties=(Tied(nodes_at(job, 0.0), 0 if way == 0 else -1),),
        contacts=(pair,),
        **more,
    )


def ball(radius: float = 1.8e-3, gap: float = 0.3e-3) -> Body:
    return Body("ball", surface=Sphere(np.array([LENGTH / 2, WIDTH / 2, -radius - gap]), radius))


def block(where: str = "below", gap: float = 0.3e-3, front_only: bool = False) -> Body:
    """A block of 6 x 7 x 2 mm beside the strip, closed or its front alone."""
    low, high = (-gap - 2e-3, -gap) if where == "below" else (gap, gap + 2e-3)
    box = trimesh.creation.box(bounds=[[7e-3, -1e-3, low], [13e-3, 6e-3, high]])
    faces = np.array(box.faces)
    if front_only:
        faces = faces[box.face_normals[:, 2] * -FACES[where] > 0.5]
    return Body("block", np.zeros(3), np.array(box.vertices), faces)


def lifted(job, state) -> float:
    """How far (m) the strip has moved along z at the first nodes over the block; facets touch it
    half a millimetre before."""
    return float((state.configuration.x - job.sheet.points)[nodes_at(job, 8e-3), 2].mean())


def test_a_ball_thinner_than_the_sheet_lifts_it():
    """Its middle is never deeper in it than a step may go: at its far side what it pushes out has
    passed through."""
    job = raised(ball(0.45e-3), 3e-3)
    (state,) = solve_job(job, options=PLAIN).states
    assert state.configuration.x[:, 2].max() > 2e-3
    assert state.contact[0, 2] < 0


@pytest.mark.parametrize("way", [1e-3, 5e-3])
def test_a_ball_that_rises_lifts_the_strip_in_one_step(way):
    """5 mm is more than its diameter: the nearest node lies on it, to the chord of an element."""
    job = raised(ball(), way)
    (state,) = solve_job(job, options=PLAIN).states
    assert state.configuration.x[:, 2].max() > way - 0.3e-3
    assert state.contact[0, 2] < 0
    assert state.penetration < 2e-6
    top = np.linalg.norm(
        state.configuration.x - [LENGTH / 2, WIDTH / 2, way - 2.1e-3], axis=1
    ).min()
    assert top == pytest.approx(1.8e-3, abs=0.05e-3)


@pytest.mark.parametrize("where", FACES)
@pytest.mark.parametrize("solve", [solve_job, solve_solid])
def test_a_block_is_not_passed_through_by_either_way(where, solve):
    """2.5 mm is more than it is thick, and than FEBio's contact looks for: the strip goes along."""
    job = raised(block(where), 2.8e-3, where)
    result = solve(job, options=replace(PLAIN, penetration=None))
    (state,) = result.states
    assert abs(lifted(job, state)) == pytest.approx(2.5e-3, rel=0.1)
    assert np.sign(state.contact[0, 2]) == FACES[where]
    assert [t.touched for t in result.touches] == [True]


@pytest.mark.parametrize("solve", [solve_job, solve_solid])
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_what_is_kept_decides_no_answer(solve, friction):
    """To the last digit: what is kept lies beside the way."""
    if friction and solve is solve_solid:
        return  # it has none
    job = raised(block(), 1.3e-3, friction=friction)
    options = replace(PLAIN, penetration=2e-6 if friction else None)
    kept = [solve(job, options=options, times=t).states for t in ([1.0], [0.15, 0.4, 0.9, 1.0])]
    assert np.array_equal(*(states[-1].configuration.x for states in kept))
    assert [s.time for s in kept[1]] == [0.15, 0.4, 0.9, 1.0]
    assert lifted(job, kept[1][2]) == pytest.approx(0.9 * 1.3e-3 - 0.3e-3, rel=0.1)


@pytest.mark.parametrize("where", FACES)
@pytest.mark.parametrize("solve", [solve_job, solve_solid])
def test_a_surface_that_is_open_touches_on_its_side(where, solve):
    """The front of the block alone, as it is drawn in FEBio Studio, is as good as the block."""
    options = replace(PLAIN, penetration=None)
    found = []
    for front_only in (False, True):
        job = raised(block(where, front_only=front_only), 1.3e-3, where)
        found.append(lifted(job, solve(job, options=options).states[-1]))
    assert found[1] == pytest.approx(found[0], rel=1e-2)
    assert abs(found[0]) == pytest.approx(1e-3, rel=0.1)


@pytest.mark.parametrize("front_only", [False, True])
def test_a_face_that_looks_away_is_not_covered_by_febios_contact(front_only):
    """It would never touch there; our own shell takes the face that is named to the body."""
    job = raised(block(front_only=front_only), 1.3e-3)
    turned = replace(job.contacts[0], side=-job.contacts[0].side)
    away = replace(job, contacts=(turned,))
    assert obstacles(job) == []
    (said,) = obstacles(away)
    assert "'pair': the sheet's face that is named looks away from the body 'block'" in said
    with pytest.raises(InputError, match="looks away"):
        solve_solid(away)


def test_a_closed_surface_wound_inwards_is_turned_by_both_ways():
    job = raised(block(), 1.3e-3)
    (pair,) = job.contacts
    inwards = replace(job, contacts=(replace(pair, triangles=pair.triangles[:, ::-1]),))
    options = replace(PLAIN, penetration=None)
    for solve in (solve_job, solve_solid):
        found = [solve(j, options=options).states[-1].configuration.x for j in (job, inwards)]
        assert found[1] == pytest.approx(found[0], abs=1e-9)


@pytest.mark.parametrize("words", [(), ("--own-shell",)])
def test_a_pair_that_never_touches_is_told(words, tmp_path):
    """In the output and in the summary, with how near it came."""
    write_feb(raised(block(gap=1e-3), 0.4e-3), tmp_path / "far.feb")
    done = run("solve", tmp_path / "far.feb", "-o", tmp_path / "out", *words)
    assert done.exit_code == 0, done.output
    said = " ".join(done.output.split())
    assert "contact 'pair' with the body 'block' never touched: the gap was never less than" in said
    (pair,) = json.loads((tmp_path / "out" / "summary.json").read_text())["contacts"]
    assert pair["touched"] is False
    assert pair["smallest_gap_mm"] == pytest.approx(0.6, abs=1e-3)


def test_increments_are_taken_where_the_way_is_remembered():
    """By friction, or where they are asked for; else as few steps as it needs."""
    rubbed = raised(block(), 0.4e-3, friction=0.3, steps=(Step("only", 1.0, 4),))
    plain = raised(block(), 0.4e-3, steps=(Step("only", 1.0, 4),))
    assert solve_job(rubbed, options=PLAIN).effort.steps >= 4
    assert solve_job(plain, options=replace(PLAIN, increments=True)).effort.steps >= 4
    assert solve_job(plain, options=PLAIN).effort.steps < 4
    assert len(way_marks(plain, 0.5, increments=True)) == 2


def test_must_points_are_read_written_and_kept(tmp_path):
    steps = (Step("a", 1.0, 4, (0.3, 1.0)), Step("b", 2.0, 2, (1.5,)))
    job = raised(block(), 0.4e-3, steps=steps)
    write_feb(job, tmp_path / "must.feb")
    assert read_feb(tmp_path / "must.feb").steps == steps
    assert spread_times(job) == [0.3, 1.0, 1.5, 2.0]
    assert spread_times(job, until=1.2, states=2) == [0.3, 0.5, 1.0, 1.2]
    assert [s.time for s in solve_solid(job).states] == [0.3, 1.0, 1.5, 2.0]


@pytest.mark.parametrize(
    ("start", "way", "reach", "expected"),
    [
        (0.0, 0.9, 1.0, 1.0),  # shorter than the reach
        (0.0, 10.0, 1.0, 0.1),  # as deep as the reach, and no deeper
        (4.0, 10.0, 1.0, 0.5),  # a gap first
        (20.0, 10.0, 1.0, 1.0),  # nowhere near
        (-0.5, 10.0, 1.0, 0.1),  # as much deeper than it was
    ],
)
def test_a_step_ends_where_it_would_go_too_deep(start, way, reach, expected):
    share = free_share(lambda s: np.array([start - way * s, 99.0]), way, reach)
    assert share == pytest.approx(expected, abs=1e-9)


def test_what_is_thin_is_not_overlooked():
    """A wall as thin as the reach, from 7 to 8 of a way of 100."""
    share = free_share(
        lambda s: np.abs(100 * s - 7.5)[None] - 0.5 - 2.0 * (7 < 100 * s < 8), 100, 1
    )
    assert 0.065 <= share <= 0.075
