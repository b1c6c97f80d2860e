"""Curves, the closing of open surfaces, mesh checks and mesh files."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import InputError
from fe_solver.febio.read import read_feb
from fe_solver.job.checks import check_job
from fe_solver.job.curves import Drive, Extension, Interpolation, LoadCurve
from fe_solver.job.job import Job
from fe_solver.supports import SpringLaw
from fe_solver.surfaces.closing import boundary_loops, close_surface, volume
from fe_solver.surfaces.spline_distance import SplineDistance
from tests.helpers.feb_files import feb_text, write
from tests.helpers.jobs import change_job

TIMES = (0.0, 1.0, 3.0, 4.0)
VALUES = (1.0, 2.0, 0.0, 6.0)


@pytest.mark.parametrize(
    ("how", "at_half", "at_two"),
    [
        (Interpolation.LINEAR, 1.5, 1.0),
        (Interpolation.STEP, 2.0, 0.0),
        (Interpolation.SMOOTH_STEP, 1.5, 1.0),
        # through (0, 1), (1, 2), (3, 0): 1 + t - 2/3 t (t - 1); at 2 half that, and half the
        # parabola through (1, 2), (3, 0), (4, 6): 2 - (t - 1) + 7/3 (t - 1) (t - 3)
        (Interpolation.SMOOTH, 5 / 3, (5 / 3 - 4 / 3) / 2),
    ],
)
def test_between_the_points(how: Interpolation, at_half: float, at_two: float) -> None:
    curve = LoadCurve(TIMES, VALUES, how)
    assert curve.at(0.5) == pytest.approx(at_half)
    assert curve.at(2.0) == pytest.approx(at_two)


@pytest.mark.parametrize(
    ("how", "before", "after"),
    [
        (Extension.CONSTANT, 1.0, 6.0),
        (Extension.EXTRAPOLATE, 0.5, 9.0),
        (Extension.REPEAT, 3.0, 1.5),
        (Extension.REPEAT_OFFSET, -2.0, 6.5),
    ],
)
def test_beyond_the_points(how: Extension, before: float, after: float) -> None:
    curve = LoadCurve(TIMES, VALUES, extension=how)
    assert curve.at(-0.5) == pytest.approx(before)
    assert curve.at(4.5) == pytest.approx(after)


@pytest.mark.parametrize("how", [Interpolation.STEP, Interpolation.SMOOTH_STEP])
def test_an_end_that_is_flat_goes_on_flat(how: Interpolation) -> None:
    curve = LoadCurve(TIMES, VALUES, how, Extension.EXTRAPOLATE)
    assert (curve.at(-1e3), curve.at(1e3)) == (1.0, 6.0)


def test_a_smooth_curve_of_few_points() -> None:
    assert LoadCurve((0, 2), (0, 4), Interpolation.SMOOTH).at(0.5) == pytest.approx(1.0)
    assert LoadCurve((0, 1, 2), (0, 1, 4), Interpolation.SMOOTH).at(1.5) == pytest.approx(2.25)


def test_a_jump_takes_its_first_value() -> None:
    curve = LoadCurve((0, 1, 1, 2), (0, 1, 5, 5))
    assert curve.at(1.0) == 1.0
    assert curve.at(1.0 + 1e-9) == pytest.approx(5.0)
    assert Drive(3.0).at(7.0) == 3.0
    assert Drive(3.0, curve).at(2.0) == 15.0


sorted_times = st.lists(st.integers(-50, 50), min_size=1, max_size=6, unique=True).map(sorted)


@given(sorted_times, st.data())
def test_every_curve_passes_through_its_points_and_stays_finite(
    times: list[int], data: st.DataObject
) -> None:
    values = data.draw(st.lists(st.floats(-9, 9), min_size=len(times), max_size=len(times)))
    how = data.draw(st.sampled_from(Interpolation))
    beyond = data.draw(st.sampled_from(Extension))
    curve = LoadCurve(tuple(map(float, times)), tuple(values), how, beyond)
    for t, v in zip(times, values, strict=True):
        assert curve.at(t) == v
    assert np.isfinite(curve.at(data.draw(st.floats(-1e3, 1e3))))


@given(sorted_times, st.floats(-200, 200))
def test_a_line_is_a_line_however_it_is_drawn(times: list[int], time: float) -> None:
    values = tuple(2.0 * t - 1 for t in times)
    if len(times) > 1:
        for how in (Interpolation.LINEAR, Interpolation.SMOOTH):
            curve = LoadCurve(tuple(map(float, times)), values, how, Extension.EXTRAPOLATE)
            assert curve.at(time) == pytest.approx(2 * time - 1, abs=1e-6)


@pytest.mark.parametrize(
    ("times", "values", "how", "words"),
    [
        ((), (), Interpolation.LINEAR, "at least one"),
        ((0, 1), (1,), Interpolation.LINEAR, "as many values"),
        ((0, np.nan), (1, 2), Interpolation.LINEAR, "finite"),
        ((1, 0), (1, 2), Interpolation.LINEAR, "ascend"),
        ((0, 1, 1), (1, 2, 3), Interpolation.SMOOTH, "one time"),
    ],
)
def test_curves_that_are_none(times: Any, values: Any, how: Interpolation, words: str) -> None:
    with pytest.raises(InputError, match=words):
        LoadCurve(times, values, how)


# --- closing ----------------------------------------------------------------------------------


def pipe(angle: float, around: int = 24, along: int = 6) -> tuple[np.ndarray, np.ndarray]:
    """A strip of a pipe of radius 5 and length 30 mm over an angle (2 pi: all round)."""
    whole = np.isclose(angle, 2 * np.pi)
    phi = np.linspace(0, angle, around + 1)[: around + (not whole)]
    x = np.linspace(0, 30e-3, along + 1)
    X, P = np.meshgrid(x, phi, indexing="ij")
    points = np.stack([X, 5e-3 * np.cos(P), 5e-3 * np.sin(P)], axis=-1).reshape(-1, 3)
    n, faces = len(phi), []
    for i in range(along):
        for j in range(around):
            k = (j + 1) % n
            a, b, c, d = i * n + j, i * n + k, (i + 1) * n + k, (i + 1) * n + j
            faces += [(a, b, c), (a, c, d)]
    return points, np.array(faces)


@pytest.mark.parametrize(
    ("angle", "content"),
    [
        (np.pi, 24 / 2 * np.sin(np.pi / 24)),
        (2 * np.pi, 24 / 2 * np.sin(2 * np.pi / 24)),
        (4 * np.pi / 3, None),
    ],
)
@pytest.mark.parametrize("turned", [False, True])
def test_open_pipes_are_closed_with_flat_ends(
    angle: float, content: float | None, turned: bool
) -> None:
    points, faces = pipe(angle)
    v, f = close_surface(points, faces[:, ::-1] if turned else faces)
    assert boundary_loops(f) == []
    assert v[:, 0].min() == pytest.approx(0, abs=1e-12)
    assert v[:, 0].max() == pytest.approx(30e-3)
    if content is not None:
        assert volume(v, f) == pytest.approx(content * 25e-6 * 30e-3, rel=1e-9)
    else:
        assert volume(v, f) > 0


def test_a_closed_pipe_can_be_baked_and_knows_its_inside() -> None:
    v, f = close_surface(*pipe(4 * np.pi / 3, 48, 12))
    phi = np.linspace(0.5, 3.5, 9)
    out = np.stack([np.full(9, 15e-3), np.cos(phi), np.sin(phi)], axis=1)
    at = [out * [1, r, r] for r in (4.5e-3, 5e-3, 6e-3)]
    distance = SplineDistance.bake(v, f, 1e-3)
    for x, expected in zip(at, (-0.5e-3, 0.0, 1e-3), strict=True):
        np.testing.assert_allclose(distance.distance(x).value, expected, atol=5e-5)


def test_a_closed_surface_stays_as_it_is() -> None:
    v = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    f = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    for faces in (f, f[:, ::-1]):
        w, g = close_surface(v, faces)
        assert len(w) == 4
        assert volume(w, g) == pytest.approx(1 / 6)


def test_triangles_wound_against_each_other_are_refused() -> None:
    points, faces = pipe(np.pi)
    faces[0] = faces[0, ::-1]
    with pytest.raises(InputError, match="wound alike"):
        close_surface(points, faces)


BLOCK = np.array([[x, y, z] for x in (0, 1.0) for y in (0, 1.0) for z in (0, 1.0)])
SIDES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


def block(*sides: int) -> np.ndarray:
    return np.array([t for i in sides for a, b, c, d in [SIDES[i]] for t in ([a, b, c], [a, c, d])])


@pytest.mark.parametrize("size", [(1, 1, 1), (1, 1.5, 7), (3, 2, 0.1), (0.2, 9, 1)])
@pytest.mark.parametrize("open_side", range(6))
def test_a_block_with_an_open_side_gets_it_back(size: tuple[float, ...], open_side: int) -> None:
    """Its rim has corners alone, none along its sides."""
    v, f = close_surface(BLOCK * size, block(*{*range(6)} - {open_side}))
    assert boundary_loops(f) == []
    assert volume(v, f) == pytest.approx(np.prod(size))


@pytest.mark.parametrize("side", range(6))
def test_a_flat_surface_is_the_front_of_a_block_behind_it(side: int) -> None:
    """As deep as it is wide, on the side that its normals point away from."""
    v, f = close_surface(BLOCK, block(side))
    assert boundary_loops(f) == []
    assert volume(v, f) == pytest.approx(1.0)
    a, b, c = BLOCK[block(side)[0]]
    assert (v @ np.cross(b - a, c - a) <= a @ np.cross(b - a, c - a) + 1e-12).all()


def test_a_closed_surface_without_an_inside_is_refused() -> None:
    with pytest.raises(InputError, match="encloses no volume"):
        close_surface(BLOCK * [1, 1, 0], block(*range(6))[4:])


def test_a_closed_surface_with_a_facet_turned_over_is_refused() -> None:
    faces = block(*range(6))
    faces[0] = faces[0, ::-1]
    with pytest.raises(InputError, match="not wound alike"):
        close_surface(BLOCK, faces)


# --- checks -----------------------------------------------------------------------------------


@pytest.fixture
def job(tmp_path: Path) -> Job:
    return read_feb(write(tmp_path, feb_text()))


def move_node(job: Job, node: int, place: tuple[float, float, float]) -> Job:
    points = job.sheet.points.copy()
    points[node] = place
    return change_job(job, points=points)


def with_row(job: Job, name: str, row: int, values: Any) -> Job:
    array = getattr(job.sheet, name).copy()
    array[row] = values
    return change_job(job, **{name: array})


FAULTS = {
    "nan": (lambda j: move_node(j, 2, (np.nan, 0, 0)), "node 3 .*not finite"),
    "twice": (lambda j: with_row(j, "quads", 0, [0, 1, 1, 3]), "element 1 .* names node 2 twice"),
    "same nodes": (lambda j: with_row(j, "quads", 1, [1, 4, 3, 0]), "have the same nodes"),
    "thin for its size": (lambda j: with_row(j, "thickness", 1, 1e-14), "element 2 .*units"),
    "thick for its size": (lambda j: with_row(j, "thickness", 1, 1.0), "element 2 .*units"),
    "no area": (
        lambda j: move_node(j, 6, (2e-3, 0.5e-3, 0)),
        r"element 3 \(part 'tip'\) has no area",
    ),
    "reflex": (
        lambda j: move_node(j, 0, (0.9e-3, 0.9e-3, 0)),
        r"element 1 \(part 'strip'\) is inv",
    ),
    "crossed": (lambda j: with_row(j, "quads", 0, [0, 4, 1, 3]), "element 1"),
    "turned over": (lambda j: with_row(j, "quads", 2, [2, 5, 6, 6]), "opposite senses"),
    "out of range": (lambda j: with_row(j, "quads", 0, [0, 1, 4, 99]), "0, 1, 4, 99"),
    "thin": (lambda j: with_row(j, "thickness", 1, 0.0), "element 2 .*thickness 0 m"),
    "negative": (lambda j: with_row(j, "thickness", 2, -1e-3), "element 3 .*thickness -0.001"),
    "nan thickness": (lambda j: with_row(j, "thickness", 2, np.nan), "element 3"),
    "fibre across": (lambda j: with_row(j, "fibre", 1, [0.01, 0, 1]), "element 2 .*normal to"),
    "no fibre": (lambda j: with_row(j, "fibre", 0, 0.0), "element 1 .*fibre"),
    "shape": (lambda j: change_job(j, fibre=j.sheet.fibre[1:]), "fibre has shape"),
    "no elements": (
        lambda j: change_job(
            j,
            **{
                n: getattr(j.sheet, n)[:0]
                for n in ("quads", "thickness", "height", "fibre", "part")
            },
        ),
        "no elements",
    ),
    "loose": (lambda j: dataclasses.replace(j, held=(), springs=()), "nothing holds the shell"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_faulty_job_is_told_by_node_or_element(job: Job, name: str) -> None:
    change, words = FAULTS[name]
    with pytest.raises(InputError, match=words) as caught:
        check_job(change(job))
    assert "\n" not in str(caught.value)


def separate_triangle(job: Job) -> Job:
    """The tip's triangle off the strip, with nodes of its own where the strip's were."""
    points = np.concatenate([job.sheet.points, job.sheet.points[[2, 5]]])
    quads = job.sheet.quads.copy()
    quads[2] = [7, 6, 8, 8]
    ids = np.concatenate([job.sheet.node_ids, [98, 99]])
    return change_job(job, points=points, quads=quads, node_ids=ids)


def test_duplicate_nodes_are_named(job: Job) -> None:
    with pytest.raises(InputError, match=r"node 3 lies where .*node 98"):
        check_job(separate_triangle(job))


def test_a_piece_that_nothing_holds_is_named_and_a_spring_would_hold_it(job: Job) -> None:
    torn = separate_triangle(job)
    torn = move_node(move_node(torn, 7, (2.1e-3, 0, 0)), 8, (2.1e-3, 1e-3, 0))
    with pytest.raises(
        InputError, match=r"node 7: nothing holds its piece of the shell \(2 pieces"
    ):
        check_job(torn)
    spring = dataclasses.replace(
        job.springs[0],
        law=SpringLaw(1.0),
        nodes=np.array([2, 5]),
        other=np.array([7, 8]),
        body=np.array([-1, -1]),
    )
    check_job(dataclasses.replace(torn, springs=(spring,)))
