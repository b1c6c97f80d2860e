"""Closed surfaces of triangles: exact distances, what is refused, and the cache of baked ones."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from cosim.array_cache import ArrayCache
from cosim.errors import InputError
from fe_solver.elements import kernels
from fe_solver.surfaces.spline_distance import SplineDistance
from fe_solver.surfaces.triangle_distance import (
    check_surface,
    distance_squared,
    distances_on_grid,
)

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * 4e-3
CUBE_FACES = ConvexHull(CUBE).simplices


def test_distances_to_a_cube_are_exact():
    origin, spacing = np.full(3, -2.05e-3), 0.5e-3
    found = distances_on_grid(CUBE, CUBE_FACES, origin, spacing, (17, 17, 17))
    axes = np.stack(np.meshgrid(*[origin[0] + spacing * np.arange(17)] * 3, indexing="ij"), -1)
    beyond = np.abs(axes - 2e-3) - 2e-3
    exact = np.linalg.norm(np.maximum(beyond, 0), axis=-1) + np.minimum(beyond.max(axis=-1), 0)
    assert np.array_equal(found < 0, exact < 0)
    assert found == pytest.approx(exact, abs=1e-12)


def waisted_tube(rows, around):
    """A tube along x, thinner in the middle, closed by fans: slivers beside even triangles, rows
    1 mm apart in 13, and a middle line from which many faces are nearly as far."""
    x = np.linspace(-6e-3, 6e-3, rows)
    radius, turn = 3e-3 + 1.5e-3 * (x / 6e-3) ** 2, 2 * np.pi * np.arange(around) / around
    ring = np.stack(
        [
            np.broadcast_to(x[:, None], (rows, around)),
            np.outer(radius, np.cos(turn)),
            np.outer(radius, np.sin(turn)),
        ],
        axis=-1,
    )
    i = np.arange(rows * around).reshape(rows, around)
    j = np.roll(i, -1, axis=1)
    first, last = np.full(around, i.size), np.full(around, i.size + 1)
    faces = [(i[:-1], i[1:], j[:-1]), (j[:-1], i[1:], j[1:]), (i[0], j[0], first)]
    faces.append((j[-1], i[-1], last))
    points = np.vstack([ring.reshape(-1, 3), [[x[0], 0, 0], [x[-1], 0, 0]]])
    return points, np.concatenate([np.stack(f, axis=-1).reshape(-1, 3) for f in faces])


WAISTED = (np.array([-10e-3, -7.5e-3, -7.5e-3]), 0.5e-3, (41, 31, 31))
"""Origin, spacing and shape of a grid about it."""


@pytest.mark.parametrize(("rows", "around"), [(13, 12), (25, 48)])
def test_within_reach_the_nearest_of_all_faces_is_found(rows, around):
    points, faces = check_surface(*waisted_tube(rows, around))
    found = np.abs(distances_on_grid(points, faces, *WAISTED)).ravel()
    origin, spacing, shape = WAISTED
    some = np.flatnonzero(found < 4.5e-3)[::41]
    nodes = origin + spacing * np.stack(np.unravel_index(some, shape), axis=1)
    every = (np.broadcast_to(face, (len(some), 3, 3)) for face in points[faces])
    exact = np.sqrt(np.min([distance_squared(face, nodes) for face in every], axis=0))
    assert found[some] == pytest.approx(exact, rel=1e-12, abs=1e-15)


def test_rounding_of_the_vertices_moves_a_distance_no_farther_than_them():
    points, faces = check_surface(*waisted_tube(13, 12))
    random = np.random.default_rng(1)
    there = distances_on_grid(points, faces, *WAISTED)
    for rounding in (1e-12, 1e-9, 6e-8):
        off = rounding * points * random.uniform(-1, 1, points.shape)
        moved = np.abs(distances_on_grid(points + off, faces, *WAISTED) - there)
        assert (
            moved[np.abs(there) < 4.5e-3].max() < 1.01 * np.linalg.norm(off, axis=1).max() + 1e-15
        )


def test_a_large_face_beside_many_small_ones_is_found():
    """A block whose top alone is finely divided: faces of two sizes, 40 to 1."""
    n = 40
    line = np.linspace(0, 8e-3, n + 1)
    top = np.array([[x, y, 2e-3] for x in line for y in line])
    k = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]
    faces = [np.stack(f, axis=-1).reshape(-1, 3) for f in ((a, b, c), (a, c, d))]
    rim = np.concatenate([k[:-1, 0], k[-1, :-1], k[:0:-1, -1], k[0, :0:-1]])
    low = len(top)  # a fan from the rim to one point below closes it
    faces.append(np.stack([np.roll(rim, -1), rim, np.full(len(rim), low)], axis=1))
    points = np.vstack([top, [[4e-3, 4e-3, -4e-3]]])
    origin, spacing, shape = np.array([-1.1e-3, -1.1e-3, -5.1e-3]), 1e-3, (11, 11, 9)
    found = np.abs(distances_on_grid(points, np.concatenate(faces), origin, spacing, shape)).ravel()
    nodes = origin + spacing * np.stack(np.unravel_index(np.arange(found.size), shape), axis=1)
    every = points[np.concatenate(faces)]
    exact = [np.sqrt(distance_squared(every, np.tile(x, (len(every), 1))).min()) for x in nodes]
    assert found == pytest.approx(exact, rel=1e-12)


def test_sign_where_rays_run_through_vertices_and_edges():
    found = distances_on_grid(CUBE, CUBE_FACES, np.full(3, -2e-3), 1e-3, (9, 9, 9))
    strict = np.zeros((9, 9, 9), dtype=bool)
    strict[3:6, 3:6, 3:6] = True
    assert np.array_equal(found < 0, strict)


@settings(max_examples=50)
@given(st.lists(st.floats(-1, 1, width=32), min_size=12, max_size=12))
def test_distance_to_a_triangle_is_the_least_over_it(numbers):
    corners, point = np.array(numbers[:9]).reshape(1, 3, 3), np.array(numbers[9:])
    u, v = np.meshgrid(np.linspace(0, 1, 81), np.linspace(0, 1, 81))
    u, v = u[u + v <= 1], v[u + v <= 1]
    over = np.stack([1 - u - v, u, v], axis=1) @ corners[0]
    least = np.linalg.norm(over - point, axis=1).min()
    found = np.sqrt(distance_squared(corners, point[None])[0])
    assert found <= least + 1e-9
    assert found >= least - 0.05  # the sampling of a triangle with sides up to 3.5


@pytest.mark.parametrize(
    ("vertices", "faces", "words"),
    [
        (CUBE, CUBE_FACES[1:], "not watertight: 3 of 18 edges"),
        (np.where(np.arange(24).reshape(8, 3) == 5, np.nan, CUBE), CUBE_FACES, "number 1;"),
        (np.empty((0, 3)), np.empty((0, 3), dtype=int), "empty"),
        (CUBE, CUBE_FACES + 1, "names vertex 8, expected 0 to 7"),
        (CUBE, np.zeros((4, 4), dtype=int), "split faces"),
        (CUBE * 1e3, CUBE_FACES, "in metres"),
    ],
)
def test_unusable_surfaces_are_refused(vertices, faces, words):
    with pytest.raises(InputError, match=words):
        SplineDistance.bake(vertices, faces)


def test_loose_triangles_are_welded():
    corners = CUBE[CUBE_FACES].reshape(-1, 3)
    vertices, faces = check_surface(corners, np.arange(len(corners)).reshape(-1, 3))
    assert vertices.shape == (8, 3)
    assert faces.shape == (12, 3)


def bake_cube(folder, **options):
    return SplineDistance.bake(CUBE, CUBE_FACES, margin=1e-3, cache=ArrayCache(folder), **options)


def baked(folder: Path) -> list[Path]:
    """The files of baked distances in a cache."""
    return list((folder / "distances").iterdir())


def test_cache_gives_the_same_bits_and_keeps_cases_apart(tmp_path):
    first = bake_cube(tmp_path / "new")
    (file,) = baked(tmp_path / "new")
    number = file.stat().st_ino
    second = bake_cube(tmp_path / "new")
    assert np.array_equal(first.coefficients, second.coefficients)
    assert np.array_equal(first.origin, second.origin)
    assert file.stat().st_ino == number  # it was not written anew
    bake_cube(tmp_path / "new", spacing=0.4e-3)
    assert len(baked(tmp_path / "new")) == 2


def test_a_whole_cache_is_read_and_nothing_is_baked(tmp_path, monkeypatch):
    first = bake_cube(tmp_path)
    monkeypatch.setattr(SplineDistance, "from_grid", None)
    assert np.array_equal(bake_cube(tmp_path).coefficients, first.coefficients)


@pytest.mark.parametrize("keeps_digest", [True, False])
@pytest.mark.parametrize(
    "change",
    [
        lambda c: 1.2 * c,
        lambda c: np.where(c == c.max(), np.nextafter(c, 1.0), c),
        lambda c: np.roll(c, 1),
        lambda c: c.astype(">f8"),
    ],
    ids=["scaled", "last bit", "moved", "byte order"],
)
def test_a_cached_grid_that_is_not_what_was_written_is_baked_again(tmp_path, change, keeps_digest):
    first = bake_cube(tmp_path)
    (file,) = baked(tmp_path)
    with np.load(file) as stored:
        content = dict(stored)
    content["coefficients"] = change(content["coefficients"])
    if not keeps_digest:
        del content["digest"]
    np.savez(file, **content)
    assert np.array_equal(bake_cube(tmp_path).coefficients, first.coefficients)
    with np.load(file) as stored:
        assert np.array_equal(stored["coefficients"], first.coefficients)


@pytest.mark.parametrize(
    "change",
    [
        lambda c: 0 * c,
        lambda c: c * np.nan,
        lambda c: -c,
        lambda c: 1.001 * c,
        lambda c: np.roll(c, 1, axis=0),
        lambda c: c[:-1],
        lambda c: np.array("words"),
    ],
)
def test_a_cached_grid_with_a_digest_made_anew_is_no_distance_and_baked_again(tmp_path, change):
    first = bake_cube(tmp_path)
    (file,) = baked(tmp_path)
    whole = file.read_bytes()
    ArrayCache(tmp_path).write("distances", file.stem, {"coefficients": change(first.coefficients)})
    assert np.array_equal(bake_cube(tmp_path).coefficients, first.coefficients)
    assert file.read_bytes() == whole
    ArrayCache(tmp_path).write("distances", file.stem, {"others": first.coefficients})
    assert np.array_equal(bake_cube(tmp_path).coefficients, first.coefficients)


def test_a_cached_grid_under_the_name_of_another_is_baked_again(tmp_path):
    first = bake_cube(tmp_path / "one")
    SplineDistance.bake(0.99 * CUBE, CUBE_FACES, margin=1e-3, cache=ArrayCache(tmp_path / "two"))
    (own,), (other,) = (baked(tmp_path / name) for name in ("one", "two"))
    own.write_bytes(other.read_bytes())
    assert np.array_equal(bake_cube(tmp_path / "one").coefficients, first.coefficients)
    assert own.read_bytes() != other.read_bytes()


@pytest.mark.parametrize("content", [b"", b"not a zip", None])
def test_corrupt_cache_is_baked_again(tmp_path, content):
    first = bake_cube(tmp_path)
    (file,) = baked(tmp_path)
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2] if content is None else content)
    assert np.array_equal(bake_cube(tmp_path).coefficients, first.coefficients)
    assert file.read_bytes()[:2] == b"PK"
    assert file.stat().st_size == len(whole)


def test_cache_folder_that_cannot_be_made_is_no_failure(tmp_path):
    blocker = tmp_path / "file"
    blocker.write_text("in the way")
    assert bake_cube(blocker / "below").distance(np.full((1, 3), 2e-3)).value[0] < 0


@pytest.mark.skipif(not kernels.COMPILED, reason="numba is not in use")
def test_the_compiled_distances_are_those_of_numpy(monkeypatch):
    points, faces = check_surface(*waisted_tube(13, 12))
    found = distances_on_grid(points, faces, *WAISTED)
    monkeypatch.setattr(kernels, "COMPILED", False)
    assert np.abs(found - distances_on_grid(points, faces, *WAISTED)).max() < 1e-16
    monkeypatch.undo()
    monkeypatch.setattr(
        "fe_solver.surfaces.triangle_distance.SLACK", 0.0
    )  # where a guess is too low
    assert np.abs(found - distances_on_grid(points, faces, *WAISTED)).max() < 1e-16
