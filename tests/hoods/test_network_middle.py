"""The middle finger under a tendon network: its own joints, arms as the case states them."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.fingers.kinds import finger_model, live_finger
from cosim.hoods.lumped.build import build_lumped_hood, slip_forces
from cosim.hoods.lumped.table import NetworkHoodConfig
from cosim.models.fit import check_fit
from cosim.port import STATIC, Finger, Hood
from cosim.results.conventions import vector_of
from cosim.results.static import observe_static
from cosim.solve.solvers import solve
from tests.helpers import conformance

TENSION = np.array([10.0, 4.0, 7.0])
POSTURES = (
    {"MCP": 0.1, "PIP": 0.2, "DIP": 0.05},
    {"MCP": 0.7, "MCP_abduction": 0.1, "PIP": 0.96, "DIP": 0.61},
)


def parts() -> tuple[Finger, Hood, NetworkHoodConfig]:
    stated, hood = load_case("middle_minorflex_edc").native_finger(), load_case("network_edc").hood
    assert isinstance(hood, NetworkHoodConfig)
    left = hood.left_to_finger
    finger, model = live_finger(stated, left), finger_model(stated, left)
    return finger, build_lumped_hood(hood, model, finger.motion(finger.start({}))), hood


def test_the_hood_keeps_the_ports_promises():
    finger, hood, _ = parts()
    motions = [finger.motion(finger.start(posture)) for posture in POSTURES]
    conformance.check_shapes(hood, motions, TENSION)
    conformance.check_objective(hood, motions, TENSION, 1e-9)
    conformance.check_balance(hood, motions, TENSION)
    conformance.check_reciprocity(hood, motions, TENSION, 1e-8, step=1e-5)
    conformance.check_jacobian(hood, motions, TENSION, 1e-6)


def test_arms_are_the_cases_about_the_fingers_own_joints():
    """EDC at the MCP, which it crosses itself; at PIP and DIP the slips' forces on their arms.
    Abduction is free of the network."""
    finger, hood, stated = parts()
    at = finger.start(POSTURES[1])
    motion = finger.motion(at)
    answer = hood.advance(hood.start(motion), motion, TENSION, STATIC)
    found = finger.jacobian(at).T @ answer.load.total().ravel()
    torque = dict(zip(finger.joints, found, strict=True))
    mcp = [stated.muscles[name]["MCP"].constant for name in hood.tendons]
    slips = slip_forces(stated, answer.state)
    assert torque["MCP"] == pytest.approx(mcp @ TENSION, rel=1e-9)
    assert torque["MCP_abduction"] == pytest.approx(0.0, abs=1e-12)
    assert torque["DIP"] == pytest.approx(-3.5e-3 * slips["terminal"], rel=1e-9)
    lateral = -5e-3 + 2.42e-3 * POSTURES[1]["PIP"]
    pip = -5e-3 * slips["central"] + lateral * slips["terminal"]
    assert torque["PIP"] == pytest.approx(pip, rel=1e-9)
    assert sum(slips.values()) == pytest.approx(TENSION.sum(), rel=1e-12)


def test_a_case_of_the_middle_finger_takes_a_network():
    """Solved at rest, clamped as in its cadaver cases: the tip bears what the torques make."""
    hood = load_case("network_edc").hood
    case = load_case("middle_minorflex_edc").model_copy(update={"hood": hood})
    check_fit(case)
    models, states = solve(case)
    summary = observe_static(case, (models, states), 0.0).summary
    assert np.linalg.norm(vector_of(summary["difference"]["fingertip_force_N"])) > 0.1
    assert summary["moment_arm_mm"]["EDC"]["MCP"] == pytest.approx(-10.0, rel=1e-3)
