"""Tendons whose ends are displaced in motion: what they reach and cost, and their slack."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.coupling.excursion import (
    ExcursionState,
    PrescribedExcursions,
    initial_excursions,
    solve_excursions,
)
from cosim.errors import ConvergenceError, InputError, StoppedError
from cosim.models.motion import moving_models
from cosim.pipeline import run_case
from cosim.results.result import Result
from cosim.solve.session import Session
from tests.helpers.motions import FREE, HELD, PLAIN, Stopper, identical

LOOSE = FREE[:2]
SHORT = 'forward={duration="0.06 s",must_rest=false}'
RAMP = 'signal={kind="points",at=[["0 s",0.0],["0.03 s",1.0]]}'
"""The end is drawn within 30 ms, and then stands."""


def draws(tendon: str, far: str = "2 mm", signal: str = RAMP) -> str:
    return f'tendons.{tendon}={{excursion="{far}",{signal}}}'


def run_motion(*settings: str) -> Result:
    return run_case(load_case("pulley_edc", [PLAIN, *LOOSE, SHORT, *settings]))


def own_paths(result: Result, tendon: str) -> np.ndarray:
    case = load_case("pulley_edc", [PLAIN, *LOOSE, SHORT])
    assert case.forward is not None
    finger = moving_models(case, case.forward).finger
    k = finger.tendons.index(tendon)
    return np.array([finger.path_lengths(q)[k] for q in result.data.angle.values])


STATED = 2e-3 * np.minimum(np.arange(61) / 30, 1.0)


@pytest.mark.parametrize("scheme", ["linear", "newton", "implicit"])
def test_a_tendon_of_the_hood_is_drawn_as_stated_or_is_slack(scheme):
    result = run_motion(draws("EDC"), f'coupling.scheme="{scheme}"')
    reached = result.data.excursion.sel(tendon="EDC").values
    tension = result.data.tension.sel(tendon="EDC").values
    miss = reached - reached[0] - STATED
    taut = tension > 0
    assert np.abs(miss[taut]).max() < 1e-9
    assert (miss[~taut] > 0).all()
    assert (tension >= 0).all()
    assert taut[1:31].all()
    assert (~taut[31:]).any()  # the finger swings on
    assert result.summary["prescribed_excursion_mm"]["EDC"] == pytest.approx(
        1e3 * (reached[-1] - reached[0])
    )
    assert result.summary["audit"]["hood_force_balance"] < 1e-9


def test_a_tendon_of_the_finger_is_drawn_as_stated():
    result = run_motion(draws("FDP"))
    path, tension = own_paths(result, "FDP"), result.data.own_tension.sel(muscle="FDP").values
    taut = tension > 0
    assert np.abs(path[0] - path - STATED)[taut].max() < 1e-9
    assert taut[1:31].all()
    solves = result.summary["iterations"]["hood_solves"]
    assert 100 < solves < 300  # two or three trials a step, each counted


def test_a_finger_without_a_hood_is_drawn_too():
    result = run_motion(draws("FDP"), 'hood={kind="split"}')
    path, tension = own_paths(result, "FDP"), result.data.own_tension.sel(muscle="FDP").values
    assert np.abs(path[0] - path - STATED)[tension > 0].max() < 1e-9
    assert result.summary["iterations"]["hood_solves"] == 1


def test_two_tendons_at_once():
    result = run_motion(draws("FDP"), draws("EDC", "1 mm"))
    path, tension = own_paths(result, "FDP"), result.data.own_tension.sel(muscle="FDP").values
    reached = result.data.excursion.sel(tendon="EDC").values
    assert np.abs(path[0] - path - STATED)[tension > 0].max() < 1e-9
    taut = result.data.tension.sel(tendon="EDC").values > 0
    assert np.abs(reached - reached[0] - STATED / 2)[taut].max() < 1e-9
    assert taut.sum() > 30


@pytest.mark.parametrize("tendon", ["EDC", "FDP"])
def test_the_tensions_found_make_the_same_motion(tmp_path: Path, tendon: str):
    result = run_motion(draws(tendon))
    data, own = result.data, tendon == "FDP"
    found = data.own_tension.sel(muscle=tendon) if own else data.tension.sel(tendon=tendon)
    table = tmp_path / "found.csv"
    rows = [
        f"{t!r},{v!r}"
        for t, v in zip(data.time.values.tolist(), found.values.tolist(), strict=True)
    ]
    table.write_text("\n".join(["time,pull", *rows]))
    signal = f'signal={{kind="file",path="{table.as_posix()}",column="pull"}}'
    again = run_motion(f'tendons.{tendon}={{tension="1 N",{signal}}}')
    assert np.abs(again.data.angle - data.angle).max() < 1e-9
    energy = result.summary["energy_mJ"]
    assert again.summary["energy_mJ"] == pytest.approx(energy, abs=1e-6)


def test_once_at_rest_it_takes_the_tension_that_draws_as_far_in_an_equilibrium():
    """FDS, since FDP hardly shortens as a finger that is held at its tip turns."""
    still = run_case(load_case("pulley_edc", [PLAIN, *HELD, 'tendons.FDS={tension="2 N"}']))
    case = load_case("pulley_edc", [PLAIN, *HELD, SHORT])
    assert case.forward is not None
    finger = moving_models(case, case.forward).finger
    k, loaded = finger.tendons.index("FDS"), still.data.angle.sel(state="loaded").values
    posture = finger.angles(finger.begin(case.finger.posture.angles()))
    far = float(finger.path_lengths(posture)[k] - finger.path_lengths(loaded)[k])
    forward = 'forward={duration="1 s",step="5 ms"}'
    settings = [PLAIN, *HELD, draws("FDS", f"{far!r} m"), forward]
    run = run_case(load_case("pulley_edc", settings))
    assert run.summary["tension_N"]["FDS"] == pytest.approx(2.0, rel=1e-4)
    force = still.summary["fingertip_force_N"]
    assert run.summary["fingertip_force_N"] == pytest.approx(force, abs=2e-4)


def test_a_motion_that_was_cut_off_goes_on_to_the_same_bytes(tmp_path: Path):
    forward = 'forward={duration="0.08 s",must_rest=false,checkpoint=20}'
    case = load_case("pulley_edc", [PLAIN, *LOOSE, draws("EDC"), forward])
    whole = run_case(case)
    with pytest.raises(StoppedError, match="Go on with: cosim run --resume"):
        run_case(case, Session(checkpoints=tmp_path), Stopper(1))
    gone = run_case(case, Session(checkpoints=tmp_path))
    assert identical(whole, gone)
    assert gone.summary["prescribed_excursion_mm"] == whole.summary["prescribed_excursion_mm"]


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ([draws("FDP", signal='signal={kind="sine",frequency="1 Hz",mean=1.0,amplitude=0.5}')],
         r"tendons\.FDP\.excursion: a motion begins with .* the signal with 1;"),
        (['tendons.FDP={excursion="1 mm"}'], "the signal with 1; give it one that begins at 0"),
        ([draws("FDP"), 'coupling.scheme="explicit"'], "moves before the hood knows the tension"),
        ([draws("FDP"), 'forward.adaptive={tolerance="0.1 deg"}'], "go with forward.adaptive"),
    ],
)  # fmt: skip
def test_what_is_refused(settings: list[str], words: str):
    with pytest.raises(InputError, match=words):
        run_motion(*settings)


def test_an_fmu_in_motion_takes_tensions():
    from cosim.fmu_export.run import part_of

    case = load_case("pulley_edc", [PLAIN, *LOOSE, SHORT, draws("FDP")])
    with pytest.raises(InputError, match="an FMU in motion takes tensions"):
        part_of(case, "finger")


STRAIGHT = np.array([[1.0, 0.2], [0.1, 2.0]])


def pull_tendons(
    aim: list[float], stiff: float = 0.0, slack: float = 0.0
) -> tuple[np.ndarray, ExcursionState, int]:
    """Two tendons with x = S T + stiff T^3, from 0.5 N each."""
    count = 0

    def trial(tension: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        nonlocal count
        count += 1
        return tension, 1e-3 * (STRAIGHT @ tension + stiff * tension**3)

    start = np.array([0.5, 0.5])
    draw = initial_excursions(start, trial(start)[1])
    count = 0
    driven = PrescribedExcursions(
        ("a", "b"), np.arange(2), lambda time: 1e-3 * np.array(aim) * time, slack=slack
    )
    tension, after = solve_excursions(driven, draw, 1.0, trial)
    return tension, after, count


def test_a_straight_law_is_met_at_once():
    tension, after, count = pull_tendons([1.0, 2.0])
    expected = 0.5 + np.linalg.solve(STRAIGHT, [1.0, 2.0])
    assert tension == pytest.approx(expected)
    assert after.excursion - after.start == pytest.approx([1e-3, 2e-3], abs=1e-10)
    assert after.slope == pytest.approx(1e-3 * STRAIGHT)
    assert count == 4  # where it stands, two for the slope, and the answer


def test_slack_is_drawn_first():
    tension, after, _ = pull_tendons([1.0, 2.0], slack=0.4e-3)
    assert tension == pytest.approx(0.5 + np.linalg.solve(STRAIGHT, [0.6, 1.6]))
    assert after.excursion - after.start == pytest.approx([0.6e-3, 1.6e-3], abs=1e-10)


def test_a_crooked_law_too():
    tension, after, _ = pull_tendons([1.0, 2.0], stiff=2.0)
    assert (tension > 0.5).all()
    assert after.excursion - after.start == pytest.approx([1e-3, 2e-3], abs=1e-10)


def test_a_tendon_that_would_have_to_push_is_slack():
    tension, after, _ = pull_tendons([-5.0, 2.0])
    assert tension[0] == 0.0
    assert after.excursion[0] - after.start[0] > -5e-3
    assert after.excursion[1] - after.start[1] == pytest.approx(2e-3, abs=1e-10)


def test_what_no_tension_draws_is_an_error():
    driven = PrescribedExcursions(("EDC",), np.arange(1), lambda time: np.array([1e-3]))
    deaf = initial_excursions(np.zeros(1), np.zeros(1))
    with pytest.raises(ConvergenceError, match="does not depend on its tendon's tension"):
        solve_excursions(driven, deaf, 1.0, lambda tension: (None, np.zeros(1)))
    with pytest.raises(ConvergenceError, match=r"tendons\.EDC\.excursion: in 40 trials"):
        solve_excursions(driven, deaf, 1.0, lambda tension: (None, 1e-4 * tension / (1 + tension)))
