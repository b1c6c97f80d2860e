"""Muscles and passive joints of a case, from the file to the answer."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.pipeline import run_case
from cosim.tendons.muscles import live_muscles

FAST = "output.picture=false"
FIBRE = (
    'tendons.FDP.muscle={kind="millard",optimal_fibre_length="75 mm",'
    'tendon_slack_length="268.12 mm",pennation="7 deg"}'
)


def summary(name: str, *settings: str) -> dict:
    return run_case(load_case(name, [FAST, *settings])).summary


def test_at_its_optimal_length_a_muscle_pulls_activation_times_force_along_the_tendon() -> None:
    muscles = live_muscles(load_case("split_fdp", [FIBRE]).tendons)
    pull = muscles.pull(np.zeros(1))
    # f_PE(1) = 0; the fibre stands at 7 deg to the tendon
    assert pull.tension == pytest.approx(0.1 * 79.12 * np.cos(np.radians(7.0)), rel=1e-9)
    assert pull.normalised_length == pytest.approx([1.0])


def test_the_tension_is_that_of_the_fibre_at_the_finger_s_own_path() -> None:
    """FDP flexes the finger within its limits and so shortens; the state and its muscle agree."""
    plain, muscle = summary("split_fdp"), summary("split_fdp", FIBRE)
    fibre = muscle["muscle"]["FDP"]
    assert 0.95 < fibre["normalised_fibre_length"] < 1.0
    assert fibre["assumed_normalised_fibre_length_unloaded"] == 1.0
    case = load_case("split_fdp", [FIBRE])
    lengths = np.linspace(0.0, 3e-3, 3001)
    pulls = [live_muscles(case.tendons).pull(np.array([x])) for x in lengths[::100]]
    tensions = [float(p.tension[0]) for p in pulls]
    found = float(
        np.interp(
            fibre["normalised_fibre_length"],
            [float(p.normalised_length[0]) for p in pulls][::-1],
            tensions[::-1],
        )
    )
    assert muscle["tension_N"]["FDP"] == pytest.approx(found, rel=1e-5)
    assert muscle["tension_N"]["FDP"] < plain["tension_N"]["FDP"]
    assert muscle["audit_missed"] == []


def test_the_assumed_fibre_length_moves_the_force() -> None:
    by_length = {
        length: summary("split_fdp", FIBRE, f"tendons.FDP.muscle.fibre_length={length}")
        for length in (0.7, 1.0, 1.3)
    }
    tension = [s["tension_N"]["FDP"] for s in by_length.values()]
    assert tension[0] < 0.85 * tension[1]
    assert tension[2] > 1.5 * tension[1]


def test_elastic_and_rigid_tendons_in_one_case() -> None:
    rigid = FIBRE.replace("FDP", "FDS").replace('deg"}', 'deg",tendon="rigid"}')
    case = load_case("split_fdp", [FIBRE, rigid, "tendons.FDS.activation=0.2"])
    muscles = live_muscles(case.tendons)
    pull = muscles.pull(np.zeros(2))
    force = dict(zip(muscles.names, pull.tension, strict=True))
    cosine = np.cos(np.radians(7.0))
    assert force["FDP"] == pytest.approx(7.912 * cosine)
    assert force["FDS"] == pytest.approx(0.2 * 58.9 * cosine)


def test_a_fibre_that_cannot_be_so_short_is_refused() -> None:
    with pytest.raises(InputError, match=r"FDP, normalised fibre length.*raise fibre_length"):
        live_muscles(load_case("split_fdp", [FIBRE, "tendons.FDP.muscle.fibre_length=0.4"]).tendons)


def test_a_passive_curve_acts_like_the_spring_that_it_draws() -> None:
    points = '[["-60 deg", "80 N*mm"], ["120 deg", "-40 N*mm"]]'
    slope = 0.120 / np.pi  # N m/rad, zero at 60 deg
    spring = (
        f'finger.passive.PIP={{stiffness="{slope!r} N*m/rad",rest="60 deg"}}',
        f"finger.passive.PIP={{curve={points}}}",
    )
    linear, curved = (summary("split_edc", s) for s in spring)
    for key in ("posture_deg", "joint_torque_Nmm"):
        for name, value in linear[key].items():
            assert curved[key][name] == pytest.approx(value, rel=1e-6, abs=1e-9), name


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        (
            'finger.passive={PIP={curve=[["0 deg","1 N*mm"],["9 deg","0 N*mm"]],rest="0 deg"}}',
            "gives one of stiffness and rest",
        ),
        (
            'finger.passive.PIP={curve=[["10 deg", "1 N*mm"], ["5 deg", "0 N*mm"]]}',
            "its angles must rise",
        ),
        ('finger.passive.PIP={curve=[["10 deg", "1 N*mm"]]}', "finger.passive.PIP.curve"),
        ('tendons.FDP.muscle={kind="hill"}', "tendons.FDP.muscle.kind"),
        ('finger.limit.damping="1 N"', "finger.limit.damping"),
        ("hood.central=1.5", "hood.central"),
    ],
)
def test_faults_are_told_with_their_place(setting: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        load_case("split_fdp", [setting])


def test_a_hood_goes_on_the_finger_that_it_fits() -> None:
    with pytest.raises(InputError, match=r'"cable" does not go with finger\.kind = "hinge"'):
        run_case(load_case("cable_edc", ["finger=" + HINGE]))


HINGE = (
    '{kind="hinge",lengths=["40 mm","25 mm","18 mm"],'
    'posture={MCP="30 deg",PIP="45 deg",DIP="15 deg"}}'
)
