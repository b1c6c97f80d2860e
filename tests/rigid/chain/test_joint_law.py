"""Passive joints beyond the linear spring: curves and damping."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import InputError
from rigid.chain.joint_torques import TorqueCurve, joint_law, limit_damping

CURVE = TorqueCurve((-0.5, 0.0, 0.5, 1.5), (0.20, 0.02, 0.0, -0.30))
JOINTS = ("MCP", "PIP")


def test_a_curve_goes_through_its_points_and_straight_on() -> None:
    for angle, torque in zip(CURVE.angle, CURVE.torque, strict=True):
        assert CURVE(angle)[0] == pytest.approx(torque, abs=1e-15)
    end, slope = CURVE(1.5)
    assert CURVE(2.5) == pytest.approx((end + slope, slope))
    start, slope = CURVE(-0.5)
    assert CURVE(-1.5) == pytest.approx((start - slope, slope))


@given(st.floats(-2, 3), st.floats(-2, 3))
def test_a_falling_curve_falls_everywhere(a: float, b: float) -> None:
    low, high = sorted((a, b))
    assert CURVE(high)[0] <= CURVE(low)[0] + 1e-12


@given(st.floats(-2, 3))
def test_a_curve_has_its_derivative(q: float) -> None:
    h = 1e-7
    assert CURVE(q)[1] == pytest.approx((CURVE(q + h)[0] - CURVE(q - h)[0]) / (2 * h), abs=1e-5)


def test_a_law_adds_curves_to_springs() -> None:
    law = joint_law(JOINTS, stiffness={"MCP": 0.04}, rest={"MCP": 0.1}, curves={"PIP": CURVE})
    torque, slope = law.passive(np.array([0.3, 0.7]))
    assert torque == pytest.approx([-0.04 * 0.2, CURVE(0.7)[0]])
    assert slope == pytest.approx([-0.04, CURVE(0.7)[1]])


@given(st.floats(-2, 3))
def test_a_law_s_torque_is_the_slope_of_its_energy(q: float) -> None:
    law = joint_law(
        JOINTS,
        stiffness={"MCP": 0.04},
        rest={"MCP": 0.1},
        lower={"MCP": -0.4},
        upper={"MCP": 1.1},
        limit_stiffness=3.0,
        transition=0.2,
        curves={"MCP": CURVE},
    )
    h, at = 1e-6, np.array([q, 0.0])
    step = np.array([h, 0.0])
    slope = (law.energy(at + step) - law.energy(at - step)) / (2 * h)
    torque = law.passive(at)[0] + law.limit(at)[0]
    assert torque[0] == pytest.approx(-slope, rel=1e-6, abs=1e-7)


def test_damping_of_joints_and_limits() -> None:
    law = joint_law(
        JOINTS,
        upper={"PIP": 1.0},
        transition=0.1,
        limit_damping=2.0,
        damping={"MCP": 0.01},
    )
    rate = np.array([3.0, -1.0])
    torque, slope = law.viscous(np.array([0.0, 1.2]), rate)
    assert torque == pytest.approx([-0.03, 2.0])
    assert slope == pytest.approx([-0.01, -2.0])
    half = limit_damping(np.array([0.05]), np.zeros(1), np.zeros(1), 2.0, 0.1)
    assert half == pytest.approx([1.0])


def test_bad_curves_speak_to_people() -> None:
    for angle, torque in (
        ((0.0, 0.0), (1.0, 2.0)),
        ((0.0,), (1.0,)),
        ((0.0, 1.0), (np.nan, 0.0)),
        ((0.0, 1.0), (1.0,)),
    ):
        with pytest.raises(InputError, match="torque curve: expected two or more points"):
            TorqueCurve(angle, torque)
    with pytest.raises(InputError, match="torque curves: unknown joint CMC"):
        joint_law(JOINTS, curves={"CMC": CURVE})
