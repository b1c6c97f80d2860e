"""Cases that move: devices, rest, energy, files, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray
from typer.testing import CliRunner

from cosim.case.file import load_case
from cosim.cli import app
from cosim.errors import InputError
from cosim.pipeline import run_case
from cosim.results.conventions import vector_of
from cosim.solve.motion import RestCheck
from tests.helpers.motions import work_done, work_kept

FORWARD = "forward={step='2 ms'}"
SHORT = 'forward={duration="0.6 s"}'
PLAIN = "output.picture=false"


def summary(name: str, *settings: str) -> dict[str, Any]:
    return run_case(load_case(name, [PLAIN, *settings])).summary


HINGE = (
    '{kind="hinge",lengths=["40 mm","25 mm","18 mm"],'
    'posture={MCP="30 deg",PIP="45 deg",DIP="15 deg"}}'
)


@pytest.mark.parametrize("muscle", ["edc", "fdp", "fpi"])
def test_at_a_point_a_motion_ends_in_the_equilibrium(muscle: str) -> None:
    moved, still = summary(f"split_{muscle}", FORWARD), summary(f"split_{muscle}")
    assert moved["came_to_rest"] is True
    assert moved["audit_missed"] == []
    assert moved["fingertip_force_N"] == pytest.approx(still["fingertip_force_N"], abs=1e-4)
    for joint, angle in still["posture_deg"].items():
        assert moved["posture_deg"][joint] == pytest.approx(angle, abs=1e-3)


@pytest.mark.parametrize(
    ("rate", "change", "rests"),
    [(0.9e-3, 0.9e-3, True), (1.1e-3, 0.0, False), (0.0, 1.1e-3, False)],
)
def test_a_finger_is_at_rest_below_a_thousandth_of_a_radian_and_newton(
    rate: float, change: float, rests: bool
) -> None:
    assert RestCheck(rate, change).is_reached is rests


def test_the_thesis_s_devices_agree_within_its_figure() -> None:
    """Section 3.1: less than 0.02 N between the cage and the hollow sphere."""
    cage, shell = (
        summary("forward_edc", f"finger.tip={{kind='{k}'}}", FORWARD) for k in ("cage", "shell")
    )
    assert abs(cage["fingertip_magnitude_N"] - shell["fingertip_magnitude_N"]) < 0.02
    assert cage["fingertip_device"] == "cage"
    assert (
        np.abs(vector_of(cage["fingertip_moment_Nmm"])).max() < 1e-6
    )  # no friction turns it any more


def test_a_motion_leaves_its_history(tmp_path: Path) -> None:
    words = ["run", "forward_edc", "--set", SHORT, "--out", str(tmp_path)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    folder = tmp_path / "forward_edc"
    names = {p.name for p in folder.iterdir()}
    assert names == {
        *("summary.json", "results.nc", "ledger.csv", "case.toml"),
        *("picture.png", "history.png", "ledger.png"),
    }
    data = xarray.load_dataset(folder / "results.nc", engine="h5netcdf")
    assert data.sizes["time"] == 601
    told = json.loads((folder / "summary.json").read_text())
    assert data.tip_force.values[-1, 0] == pytest.approx(told["fingertip_force_N"]["distal"])
    shown = CliRunner().invoke(app, ["show", str(folder), "-o", str(folder / "run.sto")])
    assert shown.exit_code == 0
    assert "came to rest" in done.stdout


def test_energy_is_accounted_for() -> None:
    """What the tendons put in is stored, dissipated or taken by the method; of the latter less at
    smaller steps."""
    damped = 'finger.passive.PIP.damping="0.002 N*m*s/rad"'
    shares = []
    for step in ("1 ms", "0.25 ms"):
        forward = f'forward={{duration="0.3 s",step="{step}",must_rest=false}}'
        energy = summary("split_edc", forward, damped)["energy_mJ"]
        assert work_done(energy) == pytest.approx(work_kept(energy), rel=1e-9)
        shares.append(abs(energy["artificial"]) / energy["own_tendons"])
    assert shares[1] < 0.6 * shares[0]


def test_fibres_pull_as_in_the_equilibrium_once_at_rest() -> None:
    muscles = [
        'tendons.FDP.muscle={kind="millard",optimal_fibre_length="75 mm",'
        'tendon_slack_length="268.12 mm",pennation="7 deg"}'
    ]
    moved, still = summary("split_fdp", FORWARD, *muscles), summary("split_fdp", *muscles)
    # The one begins at its fibre length in the posture, the other in the unloaded finger.
    assert moved["tension_N"]["FDP"] == pytest.approx(still["tension_N"]["FDP"], rel=2e-3)
    key = "normalised_fibre_length"
    assert moved["muscle"]["FDP"][key] == pytest.approx(still["muscle"]["FDP"][key], abs=2e-3)


def test_a_finger_that_still_moves_misses_its_audit() -> None:
    free = ["finger.tip={kind='free'}", 'finger.limit.half_range="60 deg"']
    moving = 'forward={duration="0.1 s"}'
    told = summary("split_fdp", *free, moving)
    assert told["audit_missed"] == ["at_rest"]
    assert told["came_to_rest"] is False
    told = summary("split_fdp", *free, 'forward={duration="0.1 s",must_rest=false}')
    assert told["came_to_rest"] is False
    assert "at_rest" not in told["audit_missed"]


def test_tensions_and_excitations_follow_their_courses() -> None:
    ramp = 'tendons.EDC.signal={kind="points",at=[["0 s",0.0],["0.2 s",1.0]]}'
    fibre = (
        'tendons.FDP={activation=0.1,muscle={kind="millard",optimal_fibre_length="75 mm",'
        'tendon_slack_length="268.12 mm"},signal={kind="points",at=[["0.3 s",1.0],["0.31 s",0.0]]}}'
    )
    forward = 'forward={duration="0.6 s",must_rest=false}'
    data = run_case(load_case("split_edc", [PLAIN, ramp, fibre, forward])).data
    edc = data.own_tension.sel(muscle="EDC")
    assert edc.sel(time=[0.0, 0.1, 0.2, 0.5], method="nearest").values == pytest.approx(
        3.469 * np.array([0.0, 0.5, 1.0, 1.0])
    )
    fdp = data.own_tension.sel(muscle="FDP")
    before, after = (float(fdp.sel(time=t, method="nearest")) for t in (0.3, 0.6))
    assert before == pytest.approx(7.9, rel=0.03)
    assert after < 0.3 * before  # deactivated, but for the smallest activation
    just = float(fdp.sel(time=0.33, method="nearest"))
    assert after < just < before  # with a time constant


@pytest.mark.parametrize(
    ("name", "settings", "words"),
    [
        ("split_edc", ["finger.tip={kind='cage'}"], r"add a table \[forward\]"),
        ("pulley_edc", [FORWARD, "finger=" + HINGE], "forward takes a finger with mass"),
        (
            "split_edc",
            ['tendons.EDC.signal={kind="points",at=[["0 s",1.0]]}'],
            r"tendons\.EDC\.signal: .* belongs to a motion",
        ),
        ("split_edc", ['forward={step="3 ms"}'], "must be a multiple of the step"),
        ("split_edc", ["finger.tip={kind='cage',width='7 mm'}", FORWARD], "must exceed the sphere"),
        ("split_edc", ["finger.tip={kind='cage',stiffness='20 N/mm**3'}"], "finger.tip"),
    ],
)
def test_what_has_no_motion_says_so(name: str, settings: list[str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        summary(name, *settings)
