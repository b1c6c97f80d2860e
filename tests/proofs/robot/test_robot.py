"""The pneumatic robotic finger: routing, air, estimation, control."""

from __future__ import annotations

import pytest

from tests.proofs.robot import air_rows, robot_rows


def test_moment_arms(judge):
    judge(robot_rows.arm_rows())


def test_fan(judge):
    judge(robot_rows.fan_rows())


@pytest.mark.slow
def test_control_on_a_lag(judge):
    judge(robot_rows.lag_control_rows())


@pytest.mark.slow
def test_control_on_air(judge):
    judge(robot_rows.air_control_rows())


@pytest.mark.slow
def test_excursions(judge):
    judge(robot_rows.excursion_rows())


def test_air_chamber(judge):
    judge(air_rows.chamber_rows())


@pytest.mark.slow
def test_air_model(judge):
    judge(air_rows.model_rows())
