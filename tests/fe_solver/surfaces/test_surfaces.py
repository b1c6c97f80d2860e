import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from cosim.errors import InputError
from cosim.port import rotation_matrix
from fe_solver.surfaces.shapes import Capsule, Cone, Cylinder, HalfSpace, RoundCone, Sphere
from fe_solver.surfaces.spline_distance import SplineDistance
from tests.proofs.fe.ellipsoid import Ellipsoid

RADIUS = 5e-3
SPHERE = Sphere(np.array([1e-3, -2e-3, 0.5e-3]), RADIUS)
CAPSULE = Capsule(np.array([-4e-3, 0, 1e-3]), np.array([6e-3, 2e-3, 0]), 3e-3)
HALF_SPACE = HalfSpace(np.array([0, 0, 1e-3]), np.array([0.0, 1.0, 2.0]))
ROUND_CONE = RoundCone(np.array([-4e-3, 0, 1e-3]), np.array([6e-3, 2e-3, 0]), 4e-3, 1.5e-3)
TURN = rotation_matrix(np.array([0.4, -1.0, 0.7]))
SHAPES = [
    SPHERE,
    CAPSULE,
    HALF_SPACE,
    ROUND_CONE,
    Cone(np.array([-4e-3, 0, 1e-3]), np.array([6e-3, 2e-3, 0]), 4e-3, 1.5e-3),
    Cylinder(np.array([1e-3, 0, 0]), np.array([1.0, 2.0, -1.0]), 3e-3),
    Ellipsoid(np.array([1e-3, -2e-3, 0]), np.array([6e-3, 5e-3, 3e-3]), TURN),
]


def shell(sphere, low=0.8, high=1.5, n=400):
    """Random points around a sphere, not at its centre."""
    rng = np.random.default_rng(1)
    way = rng.normal(size=(n, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    return sphere.centre + way * sphere.radius * rng.uniform(low, high, (n, 1))


def ball(n=6000):
    """A convex polyhedron with n vertices on SPHERE (Fibonacci lattice)."""
    i = np.arange(n) + 0.5
    polar, around = np.arccos(1 - 2 * i / n), np.pi * (1 + 5**0.5) * i
    way = [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)]
    way = np.stack(way, axis=1)
    return SPHERE.centre + RADIUS * way, ConvexHull(way).simplices


@pytest.fixture(scope="module")
def grid():
    """The spline through exact distances of SPHERE."""
    origin = SPHERE.centre - 9.1e-3
    axes = [o + 0.5e-3 * np.arange(38) for o in origin]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    values = SPHERE.distance(nodes).value.reshape(38, 38, 38)
    return SplineDistance.from_grid(origin, 0.5e-3, values, 4e-3)


@pytest.fixture(scope="module")
def baked():
    return SplineDistance.bake(*ball())


def differences(surface, points, step):
    """Central differences of value and gradient."""
    pairs = [
        (surface.distance(points + step * e), surface.distance(points - step * e))
        for e in np.eye(3)
    ]
    gradient = np.stack([(a.value - b.value) / (2 * step) for a, b in pairs], axis=1)
    hessian = np.stack([(a.gradient - b.gradient) / (2 * step) for a, b in pairs], axis=1)
    return gradient, hessian


def test_sphere_by_hand():
    value, gradient, hessian = Sphere(np.zeros(3), 1.0).distance(
        np.array([[2.0, 0, 0], [0, 0.5, 0]])
    )
    assert value == pytest.approx([1.0, -0.5])
    assert gradient == pytest.approx(np.array([[1.0, 0, 0], [0, 1.0, 0]]))
    assert hessian[0] == pytest.approx(np.diag([0, 0.5, 0.5]))
    assert hessian[1] == pytest.approx(np.diag([2.0, 0, 2.0]))


def test_capsule_is_a_cylinder_between_its_ends_and_a_sphere_beyond():
    capsule = Capsule(np.zeros(3), np.array([2.0, 0, 0]), 0.5)
    value, gradient, hessian = capsule.distance(np.array([[1.0, 0, 2.0], [5.0, 4.0, 0]]))
    assert value == pytest.approx([1.5, 4.5])
    assert gradient == pytest.approx(np.array([[0, 0, 1.0], [0.6, 0.8, 0]]))
    assert hessian[0] == pytest.approx(np.diag([0, 0.5, 0]))
    assert hessian[1] == pytest.approx(
        Sphere(capsule.end, 1.0).distance([[5.0, 4.0, 0]]).hessian[0]
    )


def test_half_space_scales_its_normal():
    value, gradient, hessian = HALF_SPACE.distance(np.array([[7.0, 1.0, 2.0 + 1e-3]]))
    assert value == pytest.approx([5**0.5])
    assert gradient == pytest.approx(np.array([[0, 1, 2]]) / 5**0.5)
    assert not hessian.any()


@pytest.mark.parametrize("surface", SHAPES, ids=lambda s: type(s).__name__)
def test_derivatives_agree_with_differences(surface):
    points = shell(SPHERE)
    gradient, hessian = differences(surface, points, 1e-8)
    found = surface.distance(points)
    away = np.linalg.norm(found.hessian - hessian, axis=(1, 2))
    size = 1 / RADIUS + np.linalg.norm(found.hessian, axis=(1, 2))
    assert (away < 1e-6 * size).mean() > 0.99  # but where a side meets its ends
    assert found.gradient == pytest.approx(gradient, abs=1e-6)
    assert np.linalg.norm(found.gradient, axis=1) == pytest.approx(np.ones(len(points)))
    along = np.einsum("nij,nj->ni", found.hessian, found.gradient)
    assert np.abs(along).max() < 1e-9 / RADIUS
    assert found.hessian == pytest.approx(np.swapaxes(found.hessian, 1, 2), abs=1e-9 / RADIUS)


@pytest.mark.parametrize("surface", SHAPES, ids=lambda s: type(s).__name__)
def test_the_foot_of_a_point_is_on_the_surface_and_no_nearer(surface):
    """Going the distance against the gradient leads to the surface, and the gradient stays."""
    points = shell(SPHERE, 0.95, 1.5)
    value, gradient, _ = surface.distance(points)
    near = np.abs(value) < RADIUS
    foot = (points - value[:, None] * gradient)[near]
    there = surface.distance(foot)
    assert there.value == pytest.approx(np.zeros(len(foot)), abs=1e-12)
    assert there.gradient == pytest.approx(gradient[near], abs=1e-6)


def test_a_round_cone_is_the_hull_of_its_balls():
    balls = [
        Sphere(ROUND_CONE.start + t * (ROUND_CONE.end - ROUND_CONE.start), 4e-3 - 2.5e-3 * t)
        for t in np.linspace(0, 1, 2001)
    ]
    points = shell(SPHERE, 0.5, 2.0)
    least = np.min([ball.distance(points).value for ball in balls], axis=0)
    assert ROUND_CONE.distance(points).value == pytest.approx(least, abs=5e-8)  # sampled


def test_a_cone_through_its_circles():
    """By hand: apex at x = 2, half-angle 45 degrees; behind the apex the distance is to it."""
    cone = Cone(np.zeros(3), np.array([1.0, 0, 0]), 2.0, 1.0)
    points = np.array([[0.0, 2, 0], [1.0, 0, 1], [0, 4.0, 0], [5, 0, 0.0], [-2, 3, 0], [0, 1, 0.0]])
    half = 0.5**0.5
    value, gradient, hessian = cone.distance(points)
    assert value == pytest.approx([0, 0, 2 * half, 3, -half, -half], abs=1e-15)
    assert gradient[2] == pytest.approx([half, half, 0])
    assert gradient[3] == pytest.approx([1.0, 0, 0])
    assert hessian[2] == pytest.approx(np.diag([0, 0, half / 4]))
    mirrored = Cone(np.array([1.0, 0, 0]), np.zeros(3), 1.0, 2.0).distance(points)
    assert mirrored.value == pytest.approx(value, abs=1e-15)
    tube = Cone(np.zeros(3), np.array([1.0, 0, 0]), 2.0, 2.0).distance(points)
    assert tube.value == pytest.approx(Cylinder([0, 0, 0], [3.0, 0, 0], 2.0).distance(points).value)


def test_curvatures_of_an_ellipsoid_at_its_poles():
    """At the end of the axis a they are a / b^2 and a / c^2 (do Carmo 1976, 3-3)."""
    semi = np.array([8e-3, 5e-3, 3e-3])
    for i in range(3):
        hessian = Ellipsoid(np.zeros(3), semi).distance((semi * np.eye(3)[i])[None]).hessian[0]
        expected = semi[i] / semi**2
        expected[i] = 0
        assert hessian == pytest.approx(np.diag(expected), abs=1e-9)


def test_an_ellipsoid_of_equal_axes_is_a_sphere():
    found = Ellipsoid(SPHERE.centre, np.full(3, RADIUS)).distance(shell(SPHERE))
    for a, b in zip(found, SPHERE.distance(shell(SPHERE)), strict=True):
        assert a == pytest.approx(b, abs=1e-9 / RADIUS)


def test_an_ellipsoid_by_its_middle():
    """On the medial plane, out to the focal points and at the centre: the distance is the exact
    one and nothing is NaN."""
    a, c = 8e-3, 3e-3
    ellipsoid = Ellipsoid(np.zeros(3), np.array([a, 5e-3, c]), TURN)
    x = np.array([0.0, 1e-3, (a**2 - c**2) / a, 7.5e-3, 9e-3])
    found = ellipsoid.distance(x[:, None] * TURN[:, 0])
    edge = np.sqrt(np.maximum(c**2 * (1 - x**2 / (a**2 - c**2)), 0))
    exact = np.where(x < (a**2 - c**2) / a, -edge, x - a)
    assert found.value == pytest.approx(exact, abs=1e-14)
    assert all(np.isfinite(part).all() for part in found)
    assert np.linalg.norm(found.gradient, axis=1) == pytest.approx(np.ones(5))
    assert np.isnan(ellipsoid.distance(np.array([[np.nan, 0, 0]])).value).all()


@settings(max_examples=60)
@given(
    st.tuples(*[st.floats(0.05, 20)] * 3),
    st.tuples(*[st.floats(-30, 30)] * 3),
    st.tuples(*[st.floats(-3, 3)] * 3),
)
def test_nearest_points_of_ellipsoids(semi, point, turn):
    """The foot is on the ellipsoid, and of points over it none is nearer; turning both turns the
    answer."""
    semi, point, axes = np.array(semi), np.array([point]), rotation_matrix(np.array(turn))
    value, gradient, _ = Ellipsoid(np.zeros(3), semi).distance(point)
    foot = point - value[:, None] * gradient
    assert np.sum((foot / semi) ** 2) == pytest.approx(1, rel=1e-6)
    assert (value[0] > 0) == (np.sum((point / semi) ** 2) > 1) or abs(value[0]) < 1e-9
    way = shell(Sphere(np.zeros(3), 1.0), 1, 1)
    nearest = np.linalg.norm(way * semi - point, axis=1).min()
    assert abs(value[0]) <= nearest + 1e-9
    turned = Ellipsoid(np.ones(3), semi, axes).distance(1 + point @ axes.T)
    assert turned.value == pytest.approx(value, abs=1e-9)
    if value[0] > 0:  # within, a point of the medial plane has two normals
        assert turned.gradient == pytest.approx(gradient @ axes.T, abs=1e-6)


def test_no_direction_on_the_axis_gives_zero_derivatives():
    cylinder = Cylinder(np.ones(3), np.ones(3), 2.0)
    on_axis = ((SPHERE, SPHERE.centre), (CAPSULE, CAPSULE.start), (cylinder, cylinder.point))
    for surface, point in on_axis:
        value, gradient, hessian = surface.distance(point[None])
        assert value == pytest.approx(-surface.radius)
        assert not gradient.any()
        assert not hessian.any()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Sphere(np.zeros(2), 1.0), "sphere centre"),
        (lambda: Sphere(np.zeros(3), -1.0), "sphere radius"),
        (lambda: Capsule(np.zeros(3), np.zeros(3), 1.0), "capsule length"),
        (lambda: HalfSpace(np.zeros(3), np.zeros(3)), "normal"),
        (lambda: HalfSpace(np.array([0, np.nan, 0]), np.ones(3)), "half-space point"),
        (lambda: Cylinder(np.zeros(3), np.zeros(3), 1.0), "cylinder direction"),
        (lambda: RoundCone(np.zeros(3), np.ones(3), 3.0, 1.0), "one holds the other"),
        (lambda: RoundCone(np.zeros(3), np.ones(3), 1.0, -1.0), "round cone end radius"),
        (lambda: Cone(np.ones(3), np.ones(3), 1.0, 2.0), "cone length"),
        (lambda: Ellipsoid(np.zeros(3), np.array([1.0, 0, 1])), "least semi-axis"),
        (lambda: Ellipsoid(np.zeros(3), np.ones(3), 2 * np.eye(3)), "orthonormal"),
    ],
)
def test_impossible_shapes_are_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_spline_through_exact_distances_meets_the_sphere(grid):
    points = shell(SPHERE)
    value, gradient, hessian = grid.distance(points)
    exact = SPHERE.distance(points)
    assert value == pytest.approx(exact.value, abs=1e-6)
    assert gradient == pytest.approx(exact.gradient, abs=2e-3)
    assert hessian == pytest.approx(exact.hessian, abs=0.05 / RADIUS)


def test_spline_error_falls_with_the_fourth_power_of_the_spacing():
    errors = []
    points = shell(SPHERE, 0.9, 1.2)
    for n in (17, 33):
        origin, spacing = SPHERE.centre - 8e-3, 16e-3 / (n - 1)
        axes = [o + spacing * np.arange(n) for o in origin]
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        values = SPHERE.distance(nodes).value.reshape(n, n, n)
        spline = SplineDistance.from_grid(origin, spacing, values, 3e-3)
        errors.append(np.abs(spline.distance(points).value - SPHERE.distance(points).value).max())
    assert np.log2(errors[0] / errors[1]) > 3.5


def test_baked_ball_meets_the_sphere(baked):
    points = shell(SPHERE, 0.8, 1.5)
    value, gradient, hessian = baked.distance(points)
    exact = SPHERE.distance(points)
    assert value == pytest.approx(exact.value, abs=6e-6)  # a facet's sagitta is 3 um
    assert gradient == pytest.approx(exact.gradient, abs=2e-2)
    assert np.abs(hessian - exact.hessian).mean() < 0.02 / RADIUS


def test_spline_derivatives_agree_with_differences(baked):
    points = shell(SPHERE)
    gradient, hessian = differences(baked, points, 1e-7)
    found = baked.distance(points)
    assert found.gradient == pytest.approx(gradient, abs=1e-5)
    assert found.hessian == pytest.approx(hessian, abs=2e-2)
    assert np.array_equal(found.hessian, found.hessian.transpose(0, 2, 1))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_two_continuous_derivatives_across_cell_borders(baked, axis):
    points = shell(SPHERE, n=50)
    cell = np.round((points[:, axis] - baked.origin[axis]) / baked.spacing)
    points[:, axis] = baked.origin[axis] + cell * baked.spacing
    step = 1e-12 * np.eye(3)[axis]
    left, right = baked.distance(points - step), baked.distance(points + step)
    assert left.value == pytest.approx(right.value, abs=1e-11)
    assert left.gradient == pytest.approx(right.gradient, abs=1e-8)
    assert left.hessian == pytest.approx(right.hessian, abs=1e-3)


def test_outside_the_grid_is_far_and_flat_and_nan_stays(baked):
    points = np.array([[1.0, 0, 0], SPHERE.centre, [np.nan, 0, 0]])
    points[1, 0] += RADIUS
    value, gradient, hessian = baked.distance(points)
    assert value[0] == 4e-3
    assert not gradient[0].any()
    assert not hessian[0].any()
    assert value[1] == pytest.approx(0, abs=5e-6)
    assert np.isnan(value[2])
    assert baked.distance(np.empty((0, 3))).hessian.shape == (0, 3, 3)
