"""Ways over surfaces against closed forms, MuJoCo's tendons and each other."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from cosim.port import Array
from rigid.opensim.stand_ins import (
    StandIn,
    cylinder_lengths,
    hole_lengths,
    sphere_lengths,
    stand_in_ellipsoid,
    stand_in_torus,
)
from rigid.opensim.wrapping import (
    Arc,
    Laid,
    over_cylinder,
    over_ellipsoid,
    over_sphere,
    over_torus,
    tight_length,
)

RADIUS = 0.01
RNG = np.random.default_rng(3)
Over = Callable[[Array, Array], Arc | None]


def ends(count: int = 40) -> tuple[Array, Array]:
    """Pairs of points (m) on both sides of a surface at the origin, most of which it parts."""
    start = RNG.normal(size=(count, 3))
    start /= np.linalg.norm(start, axis=1)[:, None]
    end = -start + 0.6 * RNG.normal(size=(count, 3))
    end /= np.linalg.norm(end, axis=1)[:, None]
    return start * RNG.uniform(0.015, 0.04, (count, 1)), end * RNG.uniform(0.015, 0.04, (count, 1))


def tendon_length(a: Array, b: Array, geom: str, side: Array | None) -> float:
    """MuJoCo's length of a tendon from a to b over a geom at the origin."""
    at = "" if side is None else '<site name="side" pos="{} {} {}"/>'.format(*side)
    use = "" if side is None else ' sidesite="side"'
    text = f"""<mujoco><worldbody><geom name="g" {geom}/>{at}
      <site name="a" pos="{a[0]} {a[1]} {a[2]}"/><site name="b" pos="{b[0]} {b[1]} {b[2]}"/>
      </worldbody><tendon><spatial><site site="a"/><geom geom="g"{use}/><site site="b"/>
      </spatial></tendon></mujoco>"""
    built = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(built)
    mujoco.mj_forward(built, data)
    return float(data.ten_length[0])


@pytest.mark.parametrize("side", [None, np.array([0.0, 1.0, 0.0])])
@pytest.mark.parametrize("kind", ["sphere", "cylinder"])
def test_a_stand_in_is_as_long_as_mujocos_tendon(kind: str, side: Array | None) -> None:
    lengths = sphere_lengths if kind == "sphere" else cylinder_lengths
    size = f'type="{kind}" size="{RADIUS} 0.01"'
    a, b = ends()
    if kind == "cylinder":
        a, b = (np.where(np.hypot(p[:, 0], p[:, 1])[:, None] > RADIUS, p, p * 3) for p in (a, b))
    expected = [
        tendon_length(start, end, size, None if side is None else 3 * RADIUS * side)
        for start, end in zip(a, b, strict=True)
    ]
    found = lengths(a, b, RADIUS, side)
    off = np.abs(found - expected)
    assert np.median(off) < 1e-9
    # MuJoCo picks the side by the middle of both tangents, here by the nearest place of the line
    assert (off < 1e-9).mean() > (0.99 if side is None else 0.8)
    bends = found > np.linalg.norm(b - a, axis=1) + 1e-9
    assert bends.mean() > 0.3


def test_a_hole_is_as_long_as_mujocos_tendon_through_it() -> None:
    a, b = ends()
    a, b = (p + np.array([0.0, 0.012, 0.0]) for p in (a, b))
    size = f'type="sphere" size="{RADIUS / 5}"'
    expected = [tendon_length(*pair, size, np.zeros(3)) for pair in zip(a, b, strict=True)]
    assert_allclose(hole_lengths(a, b, RADIUS / 5), expected, atol=1e-8)


def test_an_end_within_a_surface_makes_the_way_straight() -> None:
    a, b = np.array([[0.0, 0.005, 0.0]]), np.array([[0.02, -0.02, 0.0]])
    for lengths in (sphere_lengths, cylinder_lengths):
        assert_allclose(lengths(a, b, RADIUS, None), np.linalg.norm(b - a, axis=1))


@pytest.mark.parametrize("swapped", [1, -1])
def test_a_way_round_the_back_crosses_itself_not(swapped: int) -> None:
    """Of two ends before a cylinder, the way on whose far side is prescribed: the shorter one of
    both that go round there, as OpenSim 4.6 has it."""
    a, b = np.array([[-0.9, -1.5, 0.0], [0.9, -1.5, 0.0]])[::swapped]
    arc = over_cylinder(a, b, 1.0, np.inf, np.array([0.0, 1.0, 0.0]))
    far, off = np.hypot(0.9, 1.5), np.arctan2(0.9, 1.5)
    length = 2 * (np.pi - off - np.arccos(1 / far))
    assert arc is not None
    assert arc.length == pytest.approx(length)
    assert arc.extra == pytest.approx(2 * np.sqrt(far**2 - 1) + length - 1.8)


@pytest.mark.parametrize(("half", "found"), [(0.9, False), (1.1, True), (2.9, True), (3.1, True)])
def test_a_cylinder_is_touched_where_either_end_of_the_arc_is_on_it(half, found) -> None:
    """An arc that climbs from 1 to 3 m."""
    a, b, straight = np.array([-2.0, 0.0, 0.0]), np.array([2.0, 0.0, 4.0]), np.sqrt(3.0)
    whole = 2 * straight + np.pi / 3
    a[2], b[2] = 1 - 2 * straight / (np.pi / 3), 3 + 2 * straight / (np.pi / 3)
    assert (b[2] - a[2]) * (np.pi / 3) / whole == pytest.approx(2.0)
    arc = over_cylinder(a, b, 1.0, half, None)
    assert (arc is not None) == found
    if arc is not None:
        assert (arc.start[2], arc.end[2]) == pytest.approx((1.0, 3.0))


def test_a_round_ellipsoid_is_a_sphere() -> None:
    count = 0
    for a, b in zip(*ends(), strict=True):
        sphere = over_sphere(a, b, RADIUS, None)
        ellipsoid = over_ellipsoid(a, b, np.full(3, RADIUS), None)
        assert (sphere is None) == (ellipsoid is None)
        if sphere is not None and ellipsoid is not None:
            count += 1
            assert ellipsoid.extra == pytest.approx(sphere.extra, rel=4e-3)
            assert ellipsoid.extra >= sphere.extra - 1e-12
            total = sphere_lengths(a[None], b[None], RADIUS, None)[0]
            assert np.linalg.norm(b - a) + sphere.extra == pytest.approx(total, rel=1e-9)
    assert count > 10


def test_a_long_ellipsoid_is_a_cylinder_across() -> None:
    radii = np.array([RADIUS, RADIUS, 1e3])
    for a, b in zip(*ends(), strict=True):
        a, b = a * (3, 3, 0), b * (3, 3, 0)
        cylinder = over_cylinder(a, b, RADIUS, np.inf, None)
        ellipsoid = over_ellipsoid(a, b, radii, None)
        assert (cylinder is None) == (ellipsoid is None)
        if cylinder is not None and ellipsoid is not None:
            assert ellipsoid.extra == pytest.approx(cylinder.extra, rel=4e-3)


def relaxed(a: Array, b: Array, radii: Array, first: Arc) -> float:
    """The length (m) of the shortest way by nodes that slide on the surface (a geodesic)."""
    middle = (first.start + first.end) / 2
    t = np.linspace(0, 1, 81)[:, None]
    nodes = (1 - t) ** 2 * a + 2 * t * (1 - t) * 2 * middle + t**2 * b
    for _ in range(6000):
        nodes[1:-1] = (nodes[:-2] + nodes[2:]) / 2
        slope = nodes / radii**2
        within = np.minimum((nodes * slope).sum(axis=1) - 1, 0)
        nodes -= (within / (2 * (slope**2).sum(axis=1)))[:, None] * slope
    return float(np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum())


def test_the_way_over_an_ellipsoid_is_close_to_the_shortest() -> None:
    radii = np.array([0.012, 0.008, 0.016])
    checked = 0
    for a, b in zip(*ends(12), strict=True):
        found = over_ellipsoid(a, b, radii, None)
        if found is None or found.length < 0.004:
            continue
        checked += 1
        length = np.linalg.norm(b - a) + found.extra
        assert length == pytest.approx(relaxed(a, b, radii, found), abs=1e-4)
    assert checked > 2


def test_a_way_turns_with_its_surface() -> None:
    """An ellipsoid whose radii change places with the axes of the points."""
    order = [2, 0, 1]
    radii = np.array([0.012, 0.008, 0.016])
    for a, b in zip(*ends(), strict=True):
        one = over_ellipsoid(a, b, radii, None)
        other = over_ellipsoid(a[order], b[order], radii[order], None)
        back = over_ellipsoid(b, a, radii, None)
        assert (one is None) == (other is None) == (back is None)
        if one is not None and other is not None and back is not None:
            assert other.extra == pytest.approx(one.extra, rel=2e-2)
            assert back.extra == pytest.approx(one.extra, rel=2e-2)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_way_keeps_to_its_side(sign: float) -> None:
    side = np.array([0.0, sign, 0.0])
    a, b = np.array([-0.02, 0.001, 0.0]), np.array([0.02, 0.002, 0.0])
    surfaces: list[Over] = [
        lambda a, b: over_sphere(a, b, RADIUS, side),
        lambda a, b: over_cylinder(a, b, RADIUS, 1.0, side),
        lambda a, b: over_ellipsoid(a, b, np.array([RADIUS, RADIUS, 2 * RADIUS]), side),
    ]
    for over in surfaces:
        arc = over(a, b)
        assert arc is not None
        assert sign * (arc.start + arc.end)[1] > 0


def test_a_torus_holds_the_way_within() -> None:
    """Past the middle of the ring it is straight; else it lies on the tube where that is nearest,
    as on a cylinder."""
    assert over_torus(np.array([0, 0, -0.02]), np.array([0, 0, 0.02]), 0.01, 0.004) is None
    assert over_torus(np.array([0, 0, 0.01]), np.array([0, 0.02, 0.02]), 0.01, 0.004) is None
    a, b = np.array([0.015, 0.0, -0.02]), np.array([0.015, 0.0, 0.02])
    arc = over_torus(a, b, 0.01, 0.004)
    assert arc is not None
    flat = np.array([[-0.005, 0.02, 0.0]]), np.array([[-0.005, -0.02, 0.0]])
    expected = cylinder_lengths(*flat, 0.004, np.array([1.0, 0.0, 0.0]))[0]
    assert np.linalg.norm(b - a) + arc.extra == pytest.approx(expected, rel=1e-9)


def test_a_path_over_two_surfaces_is_tight_over_both() -> None:
    """Two equal cylinders side by side: tangents, arcs, and a straight way between the tops."""

    def over(a: Array, b: Array) -> Arc | None:
        return over_cylinder(a, b, RADIUS, np.inf, None)

    points = np.array([[-0.04, 0.001, 0.0], [0.06, 0.001, 0.0]])
    laid = [Laid(over, np.eye(3), np.array([x, 0.0, 0.0]), 0, 1) for x in (0.0, 0.02)]
    length, touched = tight_length(points, laid)
    assert {touch.surface for touch in touched} == {0, 1}
    far = np.hypot(0.04, 0.001)
    arc = np.pi / 2 - np.arctan2(0.001, 0.04) - np.arccos(RADIUS / far)
    expected = 2 * (np.sqrt(far**2 - RADIUS**2) + RADIUS * arc) + 0.02
    assert length == pytest.approx(expected, abs=1e-6)
    turn = Rotation.from_rotvec([0.3, -1.0, 0.4]).as_matrix()
    turned = [each._replace(rotation=turn, place=turn @ each.place) for each in laid]
    assert tight_length(points @ turn.T, turned)[0] == pytest.approx(length, abs=1e-9)


def test_a_surface_bends_the_segment_that_gets_longer_by_least() -> None:
    def over(a: Array, b: Array) -> Arc | None:
        return over_sphere(a, b, RADIUS, None)

    points = np.array([[-0.03, 0, 0], [0.03, 0.001, 0], [0.03, 0.009, 0], [-0.03, 0.009, 0.0]])
    laid = Laid(over, np.eye(3), np.zeros(3), 0, 3)
    (touch,) = tight_length(points, [laid])[1]
    assert touch.segment == 2
    (touch,) = tight_length(points, [laid._replace(last=1)])[1]
    assert touch.segment == 0


def lengths_over(a: Array, b: Array, over: Over) -> tuple[Array, Array]:
    arcs = [over(*pair) for pair in zip(a, b, strict=True)]
    lengths = np.linalg.norm(b - a, axis=1) + [arc.extra if arc else 0.0 for arc in arcs]
    return lengths, np.array([(arc.start + arc.end) / 2 for arc in arcs if arc])


def made_lengths(made: StandIn, a: Array, b: Array) -> Array:
    a, b = ((p - made.place) @ made.rotation for p in (a, b))
    if made.shape == "hole":
        return hole_lengths(a, b, made.radius)
    lengths = sphere_lengths if made.shape == "sphere" else cylinder_lengths
    return lengths(a, b, made.radius, made.side)


def bundle(count: int = 60) -> tuple[Array, Array]:
    """Ends of a segment as a joint bends: near to each other, below a surface at the origin."""
    near = RNG.uniform(-1, 1, (count, 3)) * (0.004, 0.004, 0.001)
    return near + np.array([-0.025, -0.004, 0]), near[::-1] + np.array([0.025, 0.01, 0])


def test_a_stand_in_of_an_ellipsoid_has_its_lengths() -> None:
    a, b = bundle()
    radii = np.array([0.012, 0.008, 0.02])
    lengths, touched = lengths_over(a, b, lambda a, b: over_ellipsoid(a, b, radii, None))
    made = stand_in_ellipsoid(a, b, lengths, radii, touched)
    error = np.abs(made_lengths(made, a, b) - lengths).max()
    assert error < 0.05 * (lengths - np.linalg.norm(b - a, axis=1)).max()
    inside = [np.linalg.norm((p - made.place) @ made.rotation, axis=1) for p in (a, b)]
    assert np.min(inside) > made.radius


def test_a_stand_in_of_a_torus_has_its_lengths() -> None:
    count = 60
    a = RNG.uniform(-1, 1, (count, 3)) * (0.004, 0.004, 0.002) + (0.008, 0, -0.02)
    b = RNG.uniform(-1, 1, (count, 3)) * (0.004, 0.004, 0.002) + (0.008, 0, 0.02)
    lengths, _ = lengths_over(a, b, lambda a, b: over_torus(a, b, 0.006, 0.003))
    made = stand_in_torus(a, b, lengths, (0.006, 0.003))
    error = np.abs(made_lengths(made, a, b) - lengths).max()
    assert error < 0.1 * (lengths - np.linalg.norm(b - a, axis=1)).max()
