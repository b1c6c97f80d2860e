"""Tendons over a builder's own pulleys on MuJoCo beside the closed form."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from cosim.errors import InputError
from rigid.chain.hinge import HingeFinger
from rigid.chain.planar_chain import BUCHNER
from rigid.chain.support import FREE
from rigid.fingers.anatomy import RANGES
from rigid.fingers.pulley_tendons import TendonRoute, routed_tendon
from rigid.mujoco.finger import MujocoFinger
from tests.rigid.chain.test_pulley_cables import ARMS, PULLEYS, TENSION

RANGE = [RANGES[joint] for joint in ("MCP", "PIP", "DIP")]
GRID = [np.array(q) for q in product(*(np.linspace(*r, 4) for r in RANGE))]


@pytest.fixture(scope="module")
def finger():
    bare = BUCHNER.model()
    tendons = [
        routed_tendon(TendonRoute(n, tuple(r.items())), bare.segments) for n, r in PULLEYS.items()
    ]
    return MujocoFinger(replace(bare, tendons=tuple(tendons)), support=FREE)


def test_the_arm_is_the_radius_over_the_whole_range(finger):
    for angles in GRID:
        np.testing.assert_allclose(finger.moment_arms(angles), ARMS, atol=1e-12)


def test_excursions_are_those_of_the_closed_form(finger):
    hinges = HingeFinger(BUCHNER.length, pulleys=PULLEYS, support=FREE)
    for angles in GRID:
        posture = dict(zip(finger.joints, angles, strict=True))
        ours, exact = (
            f.path_lengths(f.start({})) - f.path_lengths(f.start(posture)) for f in (finger, hinges)
        )
        np.testing.assert_allclose(ours, exact, atol=1e-12)


def test_what_draws_the_bones_together_is_the_tension(finger):
    """In the straight finger, but for the slope of the cable, which the closed form knows."""
    wrench = finger.own_wrenches(np.zeros(3), TENSION)["FDS"]
    assert wrench[1:, :3].sum(axis=0) == pytest.approx([-7.0, 0.0, 0.0], abs=1e-9)


def test_a_tendon_runs_straight_between_points_and_through_the_axis_without_them():
    segments = BUCHNER.model().segments
    points = (("metacarpal", ((-0.02, 0.0, -0.01),)), ("proximal", ((0.015, 0.0, -0.008),)))
    route = TendonRoute("FDS", (("PIP", 0.007),), points)
    finger = MujocoFinger(replace(BUCHNER.model(), tendons=(routed_tendon(route, segments),)))
    ends = np.array([[-0.02, -0.01], [0.015, -0.008]])
    along = np.diff(ends, axis=0)[0] / np.linalg.norm(np.diff(ends, axis=0))
    by_hand = abs(ends[0, 0] * along[1] - ends[0, 1] * along[0])
    arms = finger.moment_arms(np.zeros(3))[0]
    assert arms == pytest.approx([by_hand, 0.007, 0.0], abs=1e-12)
    through = routed_tendon(TendonRoute("FDS", (("PIP", 0.007),)), segments)
    finger = MujocoFinger(replace(BUCHNER.model(), tendons=(through,)))
    assert finger.moment_arms(np.array([0.5, 0.3, 0.1]))[0] == pytest.approx([0.0, 0.007, 0.0])


@pytest.mark.parametrize(
    ("route", "words"),
    [
        (TendonRoute("FDP", (("wrist", 0.01),)), "no joint wrist"),
        (TendonRoute("FDP", points=(("carpus", ((0.0, 0.0, 0.0),)),)), "no bone carpus"),
        (TendonRoute("FDP", points=(("middle", ((0.0, 0.0, 0.0),) * 2),)), "crosses no joint"),
    ],
)
def test_what_no_tendon_can_follow_is_refused(route, words):
    with pytest.raises(InputError, match=words):
        routed_tendon(route, BUCHNER.model().segments)
