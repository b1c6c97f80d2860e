"""One set of passive joints: their curves are the formulas that their file states."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from cosim.case.file import load_case

GROWTH = 2.4
"""1/rad."""
JOINTS = ("MCP", "MCP_abduction", "PIP", "DIP")
SHARING = ("base/free_finger", "base/lesion", "motion_edc_fdp", "motion_flexion", "free_edc")


@cache
def curves(name: str) -> dict[str, np.ndarray]:
    """(k, 2) rad and N m by joint."""
    passive = load_case(name).native_finger().passive
    return {joint: np.array(p.curve) for joint, p in passive.items() if p.curve}


def growing(stiffness: float, growth: float, turned: np.ndarray) -> np.ndarray:
    """N m at angles turned (rad) from rest."""
    return -stiffness / growth * np.sinh(growth * turned)


def with_plate(stiffness: float, rest: float, plate: float, q: np.ndarray) -> np.ndarray:
    turned = q - np.radians(rest)
    flexed = np.where(turned > 0, growing(stiffness, GROWTH, turned), -stiffness * turned)
    return flexed + plate * np.maximum(-q, 0)


FORMULAS = {
    "MCP": lambda q: growing(0.0391, GROWTH, q - np.radians(33.2)),
    "MCP_abduction": lambda q: growing(0.0391, 6.8, q),
    "PIP": lambda q: with_plate(0.029, 45.0, 0.5, q),
    "DIP": lambda q: with_plate(0.01, 15.0, 0.15, q),
}


@pytest.mark.parametrize("joint", JOINTS)
def test_the_points_are_the_formula_s(joint):
    angle, torque = curves("base/free_joints")[joint].T
    assert torque == pytest.approx(FORMULAS[joint](angle), rel=1e-3, abs=1e-8)


@pytest.mark.parametrize(("joint", "at"), [("MCP", 90.0), ("MCP_abduction", 20.0)])
def test_the_second_number_is_the_stiffness_at_the_end(joint, at):
    """0.21 N m/rad, as quoted of the MCP."""
    low, high = FORMULAS[joint](np.radians([at - 0.1, at + 0.1]))
    assert (low - high) / np.radians(0.2) == pytest.approx(0.21, rel=0.02)


@pytest.mark.parametrize("name", SHARING)
def test_free_fingers_lesions_and_motions_have_one_set(name):
    own = curves(name)
    assert own.keys() == set(JOINTS)
    for joint, points in curves("base/free_joints").items():
        assert np.array_equal(own[joint], points)
    assert load_case(name).native_finger().limit.half_range == pytest.approx(np.pi / 2)


def test_the_pneumatic_finger_has_the_same_joints():
    assert all(np.array_equal(p, curves("base/lesion")[j]) for j, p in curves(PNEUMATIC).items())


PNEUMATIC = "pneumatic_edc_fdp"


def test_a_lag_holds_the_mcp_alone():
    passive = load_case("base/lag").native_finger().passive
    assert passive["MCP"].stiffness == 20.0
    assert passive["MCP"].curve is None
    assert np.array_equal(passive["PIP"].curve, curves("base/free_joints")["PIP"])
