"""The air behind the robotic finger's tendons, its pressure loop, and the finger held on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cases.papers.models.xu2012 import checks
from cases.papers.models.xu2012.actuators import PERIOD
from cases.papers.models.xu2012.air import Air, Driven, PressureLoop, identify_air
from cases.papers.models.xu2012.control import AIR_GAINS
from cases.papers.models.xu2012.plant import STEP
from cases.papers.models.xu2012.tracking import poses
from cosim.port import Array
from rigid.air.plant import ATMOSPHERE, GAMMA

LONGEST, LENGTH = np.full(4, 0.12), np.full(4, 0.10)
WANTED = np.array([1.0, 3.0, 6.0, 12.0])
LOW = np.full(4, 0.5)


@pytest.fixture(scope="module")
def air() -> Air:
    return Air(LONGEST)


def step_forces(air: Air, wanted: Array, samples: int) -> Array:
    """(samples, 4) N at the end of each, from rest at 0.5 N, the pistons fixed."""
    state, out = air.begin(LOW, LENGTH), []
    for _ in range(samples):
        state = air.command(state, wanted)
        for _ in range(round(PERIOD / STEP)):
            state = air.advance(state, LENGTH, STEP)
        out.append(air.force(state))
    return np.array(out)


def test_rests_where_it_was_begun(air: Air) -> None:
    np.testing.assert_allclose(step_forces(air, LOW, 20)[-1], LOW, rtol=0.02)


def test_force_reaches_what_is_wanted_without_offset(air: Air) -> None:
    force = step_forces(air, WANTED, 60)
    np.testing.assert_allclose(force[50:].mean(axis=0), WANTED, rtol=0.01)
    assert (force.max(axis=0) < 1.12 * WANTED).all()


def test_nothing_comes_within_the_dead_time_and_most_within_seventy_milliseconds(air: Air) -> None:
    force = step_forces(air, WANTED, 7)
    np.testing.assert_allclose(force[1], LOW, rtol=1e-2)
    assert ((force[-1] - LOW) > 0.63 * (WANTED - LOW)).all()


def test_the_loop_swings_where_it_forgets_what_is_on_its_way(air: Air) -> None:
    def swing(a: Air) -> Array:
        return np.asarray(np.ptp(step_forces(a, WANTED, 60)[40:], axis=0))

    hasty = replace(air, loop=PressureLoop(replace(identify_air(), lag=0)))
    assert (swing(hasty) > 5 * swing(air)).all()


def test_a_pulled_piston_is_a_spring_of_air(air: Air) -> None:
    """gamma p A^2 / V: fast enough, nothing flows."""
    state = air.begin(WANTED, LENGTH)
    out = 1e-5
    after = air.advance(state, LENGTH + out, STEP)
    area = float(np.asarray(air.plant.cylinder.area))
    volume = np.asarray(air.plant.cylinder.volume(LONGEST - LENGTH))
    pressure = ATMOSPHERE + WANTED / area
    spring = GAMMA * pressure * area**2 / volume
    gained = area * (after.chamber.pressure - state.chamber.pressure)
    np.testing.assert_allclose(gained / out, spring, rtol=0.03)
    assert (after.inward < 0).all()
    assert (air.force(after) > gained + WANTED).all()  # the seals resist


def test_commands_wait_for_the_dead_time(air: Air) -> None:
    state: Driven = air.command(air.begin(LOW, LENGTH), WANTED)
    sent = state.loop.sent[-1]
    late = round(float(np.asarray(air.plant.valve.delay)) / STEP)
    for _ in range(late):
        state = air.advance(state, LENGTH, STEP)
    assert (state.chamber.spool < sent - 1e-3).all()
    for _ in range(10):
        state = air.advance(state, LENGTH, STEP)
    np.testing.assert_allclose(state.chamber.spool, sent, rtol=1e-3)


def test_one_gain_set_holds_the_hardest_step_on_air() -> None:
    """From pose 48 to 49 of the study: MCP by 50, abduction by 38 deg."""
    hardest = list(poses(checks.POSES)[48:])
    step = checks.bench(True, air=True).in_joint_space(hardest, AIR_GAINS)[1]
    assert not step.unstable
    assert np.isfinite(step.settling).all()
    assert step.force.max() < 20.0
