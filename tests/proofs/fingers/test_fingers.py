"""Fingers, muscles, devices and files against closed forms, OpenSim and hands."""

from __future__ import annotations

import pytest

from tests.proofs.fingers import (
    dynamics_rows,
    finger_rows,
    friction_rows,
    muscle_rows,
    osim_rows,
)


def test_muscles(judge):
    judge(muscle_rows.rows())


def test_an_imported_opensim_file(judge):
    judge(osim_rows.rows())


def test_planar_finger(judge):
    judge(finger_rows.planar_rows())


@pytest.mark.slow
def test_devices_twin_and_rest(judge):
    judge(dynamics_rows.rows())


def test_middle_finger(judge):
    judge(finger_rows.single_tendon_rows())


def test_free_finger(judge):
    judge(finger_rows.free_motion_rows())


def test_friction_of_tendons(judge):
    judge(friction_rows.rows())
