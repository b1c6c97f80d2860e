"""The planar chain in closed form: pendulums, energy, momentum, MuJoCo."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.fingers.planar import planar_chain
from cosim.pipeline import run_case
from rigid.chain.planar_chain import BUCHNER, PlanarChain
from rigid.chain.support import HELD
from tests.helpers.fingers import loaded_state, mujoco_finger

NONE = np.zeros(2)


def rod(gravity: float = 9.81) -> PlanarChain:
    """One uniform rod of 0.3 m and 2 kg."""
    return PlanarChain(
        np.array([0.3]), np.array([0.15]), np.array([2.0]), np.array([2 * 0.3**2 / 12]), gravity
    )


def test_a_horizontal_rod_falls_as_in_the_textbook() -> None:
    """3 g / (2 L), downwards, which is flexion."""
    found = rod().acceleration(np.zeros(1), np.zeros(1), np.zeros(1), NONE)
    assert found == pytest.approx([1.5 * 9.81 / 0.3])


def test_a_tip_force_has_the_lever_of_the_rod() -> None:
    found = rod(0.0).acceleration(np.zeros(1), np.zeros(1), np.zeros(1), np.array([5.0, -1.0]))
    assert found == pytest.approx([0.3 / (2 * 0.3**2 / 3)])


states = st.tuples(*[st.floats(-1.5, 1.5)] * 3), st.tuples(*[st.floats(-20, 20)] * 3)


@given(*states)
def test_without_torques_the_energy_stays(angles: tuple, rates: tuple) -> None:
    q, v, h = np.array(angles), np.array(rates), 1e-6
    a = BUCHNER.acceleration(q, v, np.zeros(3), NONE)
    ahead, behind = (BUCHNER.energy(q + s * v + s * s / 2 * a, v + s * a) for s in (h, -h))
    power = (ahead - behind) / (2 * h)
    scale = max(BUCHNER.energy(q, v) - BUCHNER.energy(q, 0 * v), 1e-4) * max(1, np.abs(v).max())
    assert abs(power) < 1e-5 * scale


@given(*states, st.tuples(*[st.floats(-0.1, 0.1)] * 3))
def test_torques_and_tip_force_do_the_work(angles: tuple, rates: tuple, torques: tuple) -> None:
    q, v, tau, h = np.array(angles), np.array(rates), np.array(torques), 1e-8
    force = np.array([1.0, -2.0])
    a = BUCHNER.acceleration(q, v, tau, force)
    ahead, behind = (BUCHNER.energy(q + s * v + s * s / 2 * a, v + s * a) for s in (h, -h))

    def tip(step: float) -> np.ndarray:
        f = np.cumsum(q + step * v)
        return BUCHNER.length @ np.stack([np.cos(f), -np.sin(f)], axis=1)

    work = tau @ v + force @ (tip(h) - tip(-h)) / (2 * h)
    assert (ahead - behind) / (2 * h) == pytest.approx(work, rel=1e-5, abs=1e-5)


def test_table_2_gives_uniform_rods() -> None:
    """The paper's inertias are m L^2 / 12, to its three digits."""
    rods = BUCHNER.mass * BUCHNER.length**2 / 12
    assert BUCHNER.inertia == pytest.approx(rods, rel=0.006)


def test_a_chain_that_does_not_fit_is_refused() -> None:
    with pytest.raises(InputError, match="as many lengths, centres, masses and inertias"):
        PlanarChain(np.ones(3), np.ones(3), np.ones(2), np.ones(3))
    with pytest.raises(InputError, match="positive"):
        PlanarChain(np.ones(1), np.ones(1), np.zeros(1), np.ones(1))


def test_the_packaged_case_is_the_paper_s_finger() -> None:
    case = load_case("planar_edc")
    chain = planar_chain(case.finger)
    for name in ("length", "centre", "mass", "inertia"):
        assert getattr(chain, name) == pytest.approx(getattr(BUCHNER, name), rel=1e-12)
    summary = run_case(case).summary
    weight = -9.80665 * np.array(summary["joint_torque_Nmm"]["gravity"]["MCP"]) / 9.80665
    lever = 1e3 * 9.80665 * BUCHNER.mass  # N mm per m
    q = np.radians(list(summary["posture_deg"].values()))
    f = np.cumsum(q)
    joints = np.concatenate([[0.0], np.cumsum(BUCHNER.length * np.cos(f))])[:3]
    centres = joints + BUCHNER.centre * np.cos(f)
    assert -weight == pytest.approx(lever @ centres, rel=1e-6)


def test_an_actuator_s_control_is_the_tension() -> None:
    finger = mujoco_finger(HELD, central=0.4)
    state, _, tension = loaded_state(finger)
    data = mujoco.MjData(finger.model)
    data.qpos[:], data.ctrl[:] = state.angles, tension
    mujoco.mj_forward(finger.model, data)
    torque = finger.own_torques(state.angles, tension)
    expected = sum(torque[name] for name in finger.tendons)
    assert data.qfrc_actuator == pytest.approx(expected, rel=1e-12)
