"""Hoods in lumped form from a case file to the answer."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from cases.papers.models.networks.human_network import human_finger
from cosim.case.file import load_case, resolved_toml
from cosim.errors import InputError
from cosim.models.build import build
from cosim.pipeline import run_case
from cosim.port import STATIC, Hood
from cosim.results.result import Result
from rigid.hoods.network import Network
from rigid.hoods.network_hood import NetworkHood
from rigid.hoods.two_band import coupled_dip, two_band


@cache
def run(name: str, *settings: str) -> Result:
    return run_case(load_case(name, settings))


def network_of(name: str, *settings: str) -> Network:
    """The network that a case states."""
    hood = build(load_case(name, settings)).hood
    assert isinstance(hood, NetworkHood)
    return hood.network


@pytest.mark.parametrize("name", ["network_edc", "two_band_edc"])
def test_the_cases_run_and_their_audits_pass(name):
    summary = run(name).summary
    assert summary["audit_missed"] == []
    assert summary["audit"]["reciprocity"] < 1e-8
    assert summary["audit"]["hood_force_balance"] < 1e-12
    assert summary["audit"]["interface_residual"] < 5e-7


def test_edc_holds_the_finger_on_the_coupling_curve():
    """Both ways of EDC bear: the curve passes within force / stiffness of the posture."""
    loaded = run("network_edc").summary
    posture = {joint: np.radians(angle) for joint, angle in loaded["posture_deg"].items()}
    away = float(posture["DIP"] - coupled_dip(posture["PIP"]))
    assert abs(away) < 3.469 / 80e3 / 3.5e-3
    arm = loaded["moment_arm_mm"]["EDC"]
    assert -3.5 < arm["DIP"] < -0.5, "neither none nor all to the lateral bands"
    assert arm["MCP"] == pytest.approx(-10.0, abs=1e-6)


def test_the_case_states_the_papers_network():
    stated, known = network_of("network_edc"), human_finger()
    names = {"EDC": "EDC", "LUM": "LUM", "FPI": "UI"}
    assert stated.muscles == tuple(names)
    at, force = np.array([0.2, 0.9, 0.285]), np.array([10.0, 4.0, 7.0])
    same = np.zeros(6)
    for muscle, pull in zip(names.values(), force, strict=True):
        same[known.muscles.index(muscle)] = pull
    assert stated.torque(at, force) == pytest.approx(known.torque(at, same), rel=1e-12)
    assert stated.excursion(at, force) == pytest.approx(known.excursion(at, same)[:3], rel=1e-12)


def test_the_case_states_the_papers_bands():
    stated, known = network_of("two_band_edc"), two_band()
    assert stated.muscles == ("EDC", "FDP", "FDS", "UI", "LUM")
    at, force = np.array([0.2, 0.9, 0.285]), np.array([15.0, 5.0, 1.0, 2.0, 0.5])
    assert stated.torque(at, force) == pytest.approx(known.torque(at, force), rel=1e-12)
    assert stated.excursion(at, force) == pytest.approx(known.excursion(at, force), rel=1e-12)


def test_every_number_of_the_tables_arrives():
    slack = network_of("network_edc", "hood.connecting.edc_slip.rest=0.3 mm")
    assert slack.rest.tolist() == [0.0, 3e-4, 0.0, 0.0, 0.0, 0.0, 0.0]
    soft = network_of("two_band_edc", "hood.elasticity=2 N/mm", "hood.lateral_share=0.2")
    assert soft.stiffness == pytest.approx([2000 / 0.2, 2000 / 0.8])
    other = network_of("two_band_edc", "hood.extensor=FDP")
    assert other.connection.tolist() == [[0, 1, 0, 0, 0]] * 2
    case = load_case("network_edc", ["hood.operating_force=10 N"])
    hood, plain = build(case).hood, build(load_case("network_edc")).hood

    def pulls(made: Hood, factor: float) -> np.ndarray:
        finger = build(case).finger
        motion = finger.motion(finger.start({"MCP": 0.2, "PIP": 0.9, "DIP": 0.285}))
        tension = factor * np.array([10.0, 4.0, 7.0])
        return made.advance(made.start(motion), motion, tension, STATIC).load.wrench

    assert pulls(hood, 2.0) == pytest.approx(2 * pulls(hood, 1.0), rel=1e-12)
    assert np.abs(pulls(plain, 2.0) - 2 * pulls(plain, 1.0)).max() > 1e-3


@pytest.mark.parametrize("name", ["network_edc", "two_band_edc"])
def test_a_resolved_case_is_the_same_case(name, tmp_path):
    path = tmp_path / f"{name}.toml"
    path.write_text(resolved_toml(load_case(name)), encoding="utf-8")
    assert load_case(str(path)).hood == load_case(name).hood


def test_the_hinge_finger_takes_one_too():
    settings = (
        'finger.kind="hinge"',
        'finger.lengths=["46 mm", "28 mm", "20 mm"]',
        "finger.posture.MCP=0 deg",
        "finger.posture.PIP=40 deg",
        "finger.posture.DIP=10 deg",
    )
    case = load_case("two_band_edc", settings)
    made = build(case)
    at = made.finger.start({"MCP": 0.2, "PIP": 0.9, "DIP": 0.285})
    motion, tension = made.finger.motion(at), np.array([15.0, 5.0, 1.0, 2.0, 0.5])
    load = made.hood.advance(made.hood.start(motion), motion, tension, STATIC).load
    torque = made.finger.jacobian(at).T @ load.total().ravel()
    known = two_band().torque(np.array([0.2, 0.9, 0.285]), tension)
    assert torque == pytest.approx(known, rel=1e-10)


@pytest.mark.parametrize(
    ("name", "settings", "words"),
    [
        (
            "network_edc",
            ["hood.connecting.edc_slip.muscle=EI"],
            "connecting.edc_slip: its muscle EI is not among the hood's muscles",
        ),
        ("two_band_edc", ["hood.extensor=EI"], "extensor: EI is not among the hood's muscles"),
        ("two_band_edc", ["hood.lateral_share=1.0"], "lateral_share"),
        ("network_edc", ["hood.connecting.edc_slip.stiffness=126"], "bare number"),
        ("network_edc", ["hood.muscles.EDC.MCP.slope=1 mm"], "length per angle"),
        ("network_edc", ['hood.muscles.FDP.MCP.constant="10 mm"'], "counted twice"),
        ("network_edc", ["tendons.EI.tension=2 N"], "no such tendon; they have EDC, LUM, FPI"),
        ("two_band_edc", ["tendons.EI.tension=2 N"], "no such tendon; they have EDC, FDP"),
    ],
)
def test_what_does_not_fit_is_told(name, settings, words):
    with pytest.raises(InputError) as told:
        build(load_case(name, settings))
    assert words in str(told.value)
