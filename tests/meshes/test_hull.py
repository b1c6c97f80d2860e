"""The hull over the bones: where rays from the chain leave them for good."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pytest

from meshes.hull import Level, _outermost_crossing
from meshes.skeleton import BODIES

RADIUS = np.linspace(1.0, 10.0, 181)


@dataclass(frozen=True)
class Ball:
    """The distance of a sphere, with its gradient."""

    centre: tuple[float, float, float]
    radius: float

    def distance(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        away = points - self.centre
        size = np.linalg.norm(away, axis=1)
        return size - self.radius, away / size[:, None], np.zeros((len(points), 3, 3))


def level(balls: Mapping[str, Ball]) -> Level:
    """Bodies in one frame, those that are not named far away, each grown by 0.5."""
    far = Ball((0.0, 0.0, 1e3), 1.0)
    turned = np.tile(np.eye(3), (4, 1, 1))
    surfaces = {body: balls.get(body, far) for body in BODIES}
    return Level(surfaces, dict.fromkeys(BODIES, 0.5), np.zeros((4, 3)), turned)


@pytest.mark.parametrize(
    ("balls", "leaves"),
    [
        ({"proximal": Ball((0.0, 0.0, 0.0), 3.2)}, 3.7),
        ({"proximal": Ball((0.0, 0.0, 2.0), 1.0), "distal": Ball((0.0, 0.0, 6.0), 1.04)}, 7.54),
        ({"middle": Ball((0.0, 0.0, 8.0), 5.0)}, 13.5),  # beyond the last radius: on the line there
        ({"middle": Ball((5.0, 0.0, 5.0), 1.0)}, 1.0),  # never in: the inmost radius
    ],
)
def test_a_ray_is_followed_to_where_it_leaves_the_bones_for_good(balls, leaves):
    bones, up = level(balls), np.array([[0.0, 0.0, 1.0]])
    (found,) = _outermost_crossing(bones, np.zeros((1, 3)), up, RADIUS)
    assert found == pytest.approx(leaves, abs=1e-12)


def test_each_of_many_rays_goes_its_own_way():
    bones = level({"proximal": Ball((0.0, 0.0, 1.0), 3.0), "middle": Ball((4.0, 0.0, 0.0), 2.0)})
    angle = np.linspace(0, 2 * np.pi, 73)
    rays = np.column_stack([np.sin(angle), 0 * angle, np.cos(angle)])
    found = _outermost_crossing(bones, np.zeros((73, 3)), rays, RADIUS)
    at = found[:, None] * rays
    assert np.abs(bones.clearance(at)).max() < 2e-3
    outside = [bones.clearance((r + found[:, None]) * rays) for r in (0.1, 1.0, 5.0)]
    assert np.min(outside) > 0


def test_clearance_is_the_value_alone():
    bones = level({"proximal": Ball((0.0, 0.0, 1.0), 3.0), "middle": Ball((4.0, 0.0, 0.0), 2.0)})
    points = np.random.default_rng(1).normal(size=(50, 3)) * 4
    np.testing.assert_array_equal(bones.clearance(points), bones.value(points)[0])
