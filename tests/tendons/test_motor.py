"""Motors behind elastic tendons: closed forms, limits, a motion with its checkpoint, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.errors import InputError, StoppedError
from cosim.pipeline import run_case
from cosim.solve.session import Session
from cosim.tendons.motor import Motors, motors
from cosim.tendons.table import TendonConfig
from tests.helpers.motions import Stopper, identical, work_done, work_kept

STIFFNESS = 20e3
WOUND = (
    'finger.tip.kind="free"',
    "output.picture=false",
    "tendons.FDP.friction=0.05",
    'tendons.FDP.elastic={stiffness="20 N/mm"}',
    'tendons.FDP.actuation={kind="motor",position="2 mm",spool="6 mm",gear=30,'
    'greatest_torque="3 N*mm",greatest_speed="800 rad/s",inertia="0.05 kg*mm**2"}',
    'tendons.FDP.signal={kind="points",at=[["0 s",0.0],["0.06 s",1.0]]}',
    *(
        f'finger.passive.{joint}={{stiffness="0.08 N*m/rad",rest="posture",'
        'damping="2e-3 N*m*s/rad"}'
        for joint in ("MCP", "MCP_abduction", "PIP", "DIP")
    ),
)


def motor(elastic: dict[str, Any] | None = None, **stated: Any) -> Motors:
    table = {"kind": "motor", "spool": "5 mm", "greatest_torque": "4 N*mm", **stated}
    springs = {"stiffness": "20 N/mm", **(elastic or {})}
    tendon = TendonConfig.model_validate({"actuation": table, "elastic": springs})
    out = motors({"FDP": tendon}, ("EDC", "FDP"))
    assert out is not None
    return out


def run(m: Motors, duration: float, dt: float = 1e-4) -> list[Any]:
    """The steps of a motor from where nothing is wound, its tendon's path of one length."""
    state, out = m.initial(np.zeros(1))._replace(position=np.zeros(1)), []
    for k in range(round(duration / dt)):
        out.append(m.step(state, (k + 1) * dt, np.zeros(1), dt))
        state = out[-1].state
    return out


def test_a_stalled_motor_pulls_with_its_torque_through_gear_and_spool() -> None:
    m = motor(torque="3 N*mm", gear=20.0)
    at_rest = m.step(m.initial(np.zeros(1)), 0.0, np.zeros(1), 0.0)
    assert at_rest.tension[0] == pytest.approx(3e-3 * 20 / 5e-3)
    assert at_rest.stiffness[0] == pytest.approx(STIFFNESS)
    beyond = motor(torque="9 N*mm", gear=20.0)
    held = beyond.step(beyond.initial(np.zeros(1)), 0.0, np.zeros(1), 0.0)
    assert held.tension[0] == pytest.approx(4e-3 * 20 / 5e-3)


def test_a_slack_tendon_lets_the_motor_run_up_to_its_greatest_speed() -> None:
    """m dv/dt = F (1 - v / v0): an exponential."""
    m = motor(
        {"slack": "50 mm"}, torque="4 N*mm", gear=2.0, greatest_speed="400 rad/s",
        inertia="1.0 kg*mm**2",
    )  # fmt: skip
    turns = 2.0 / 5e-3
    mass, force, fastest = 1e-6 * turns**2, 4e-3 * turns, 400.0 / turns
    steps = run(m, 0.04)
    exact = fastest * (1 - np.exp(-0.04 * force / (mass * fastest)))
    assert steps[-1].state.speed[0] == pytest.approx(exact, rel=3e-3)
    assert steps[-1].tension[0] == 0.0


def test_a_motor_on_a_fixed_tendon_swings_at_the_rate_of_its_reflected_inertia() -> None:
    m = motor(torque="4 N*mm", gear=10.0, inertia="0.25 kg*mm**2")
    mass, force = 0.25e-6 * (10 / 5e-3) ** 2, 4e-3 * 10 / 5e-3
    rate = np.sqrt(STIFFNESS / mass)
    quarter = 0.5 * np.pi / rate
    state = m.initial(np.zeros(1))._replace(position=np.array([1e-4]))
    dt, moved = quarter / 1000, state
    for k in range(1000):
        moved = m.step(moved, k * dt, np.zeros(1), dt).state
    rest = force / STIFFNESS
    assert moved.position[0] == pytest.approx(rest, abs=2e-3 * rest)
    assert moved.speed[0] == pytest.approx(rate * (rest - 1e-4), rel=2e-3)


def test_a_gear_that_loses_power_pulls_less_when_winding_and_holds_more() -> None:
    m = motor(torque="3 N*mm", gear=20.0, efficiency=0.8)
    force = 3e-3 * 20 / 5e-3
    home = m.initial(np.zeros(1))
    slack = home._replace(position=np.zeros(1))
    winding = m.step(slack, 0.0, np.zeros(1), 1.0)
    assert winding.tension[0] == pytest.approx(0.8 * force)
    turned_back = m.step(home, 0.0, np.array([2e-3]), 1.0)  # the path was drawn out by 2 mm
    assert turned_back.tension[0] == pytest.approx(force / 0.8)
    held = m.step(home, 0.0, np.array([1e-5]), 1.0)
    assert held.state.speed[0] == pytest.approx(0.0, abs=1e-12)


def test_a_motor_turns_to_a_commanded_position_and_does_not_ring() -> None:
    m = motor({"slack": "50 mm"}, position="2 mm", gear=20.0, inertia="0.05 kg*mm**2")
    way = [step.state.position[0] for step in run(m, 0.1, 1e-4)]
    assert way[-1] == pytest.approx(2e-3, rel=1e-6)
    assert max(way) < 2e-3 + 1e-6


def test_backlash_and_slack_are_passed_before_the_tendon_pulls() -> None:
    play = np.radians(3.0) * 5e-3
    m = motor({"slack": "0.3 mm"}, position="1 mm", gear=50.0, backlash="3 deg", band="0.001 mm")
    end = run(m, 0.1, 1e-2)[-1]
    assert end.tension[0] == pytest.approx(STIFFNESS * (1e-3 - 0.3e-3 - play), rel=2e-3)


def test_a_wound_finger_keeps_its_energy_books_and_goes_on_from_a_checkpoint(tmp_path) -> None:
    settings = (*WOUND, 'forward={duration="0.1 s",must_rest=false,checkpoint=40}')
    whole = run_case(load_case("pulley_edc", settings))
    energy = whole.summary["energy_mJ"]
    assert work_done(energy) == pytest.approx(work_kept(energy), rel=1e-9)
    assert energy["guides_dissipated"] > 0.1
    assert abs(energy["artificial"]) < 0.05 * energy["own_tendons"]
    loss, data = whole.data.guide_loss.values, whole.data
    assert (np.diff(loss) >= 0).all()
    assert data.motor_position.values[-1, 0] == pytest.approx(2e-3, abs=0.3e-3)
    pulled = data.own_tension.sel(muscle="FDP").values
    left = data.insertion_tension.sel(muscle="FDP").values
    assert (left[20:45] < pulled[20:45]).all()
    session = Session(checkpoints=tmp_path)
    with pytest.raises(StoppedError):
        run_case(load_case("pulley_edc", settings), session, Stopper(2))
    assert identical(run_case(load_case("pulley_edc", settings), session), whole)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ((WOUND[3], WOUND[4]), "a motor takes time to act"),
        ((WOUND[4], "forward={}"), "a motor without elastic"),
        ((WOUND[3],), "which no stretch changes"),
        (('tendons.FDP.elastic={modulus="1 GPa"}', 'tendons.FDP.excursion="1 mm"'), "together"),
        ((*WOUND, "forward={step='5 ms'}"), "forward.step: 0.005 s is too long"),
        (
            (*WOUND[:5], "forward={}", 'tendons.FDP.actuation.torque="1 N*mm"'),
            "takes one command",
        ),
    ],
)
def test_what_makes_no_drive_is_refused(settings: tuple[str, ...], words: str) -> None:
    with pytest.raises(InputError, match=words):
        run_case(load_case("pulley_edc", settings))
