"""Cases in steps whose length follows from their error: accuracy, books, the floor, checkpoints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cosim.case.file import load_case, resolved_toml
from cosim.coupling.motion import Pace
from cosim.coupling.paced import DURATION_ROUNDING, _first_try
from cosim.errors import ConvergenceError, InputError, StoppedError
from cosim.pipeline import run_case
from cosim.results.result import Result
from cosim.solve import motion as run_motion
from cosim.solve.session import Session
from meshes.skeleton import BODIES
from tests.helpers.motions import FREE, PLAIN, Stopper, identical, work_done, work_kept

DURATION = 0.06
DAMPED = 'finger.passive.PIP={stiffness="0.0391 N*m/rad",rest="posture",damping="0.001 N*m*s/rad"}'


def forward(tolerance: str, floor: str = "1 us", step: str = "10 ms", **more: object) -> str:
    extra = "".join(f",{key}={value}" for key, value in more.items())
    adaptive = f'adaptive={{tolerance="{tolerance}",floor="{floor}"}}'
    return f'forward={{duration="{DURATION} s",step="{step}",must_rest=false,{adaptive}{extra}}}'


def run_motion_case(*settings: str) -> Result:
    return run_case(load_case("pulley_edc", [PLAIN, *FREE, *settings]))


@pytest.fixture(scope="module")
def fine() -> Result:
    return run_motion_case('forward={duration="0.06 s",step="0.2 ms",must_rest=false}')


@pytest.mark.parametrize("scheme", ["linear", pytest.param("newton", marks=pytest.mark.slow)])
def test_a_tighter_tolerance_takes_more_steps_and_leaves_less_error(fine, scheme):
    runs = [
        run_motion_case(forward(t), f'coupling.scheme="{scheme}"') for t in ("0.1 deg", "0.001 deg")
    ]
    off = [np.abs(r.data.angle[-1] - fine.data.angle[-1]).max() for r in runs]
    told = [r.summary["step_control"] for r in runs]
    assert off[1] < 0.3 * off[0]
    assert told[1]["accepted"] > 2 * told[0]["accepted"]
    for run, said, tolerance in zip(runs, told, (0.1, 0.001), strict=True):
        assert 0.1 * tolerance < said["largest_error_deg"] <= tolerance
        time, step = run.data.time.values, run.data.step.values
        assert time[-1] == pytest.approx(DURATION, rel=1e-12)
        assert len(time) == 2 * said["accepted"] + 1
        assert step[1:] == pytest.approx(np.diff(time))
        assert step[1::2] == pytest.approx(step[2::2])
        assert 2e-3 * step[1:].max() < said["longest_half_ms"] / 1e3 <= 5e-3
        assert said["shortest_half_ms"] == pytest.approx(1e3 * step[1:].min())
        solves = run.summary["iterations"]["hood_solves"]
        if scheme == "linear":
            assert solves == 1 + 3 * (said["accepted"] + said["rejected"])
    assert told[1]["shortest_half_ms"] < 0.5 * told[1]["longest_half_ms"]


def test_a_finger_without_a_hood_paces_itself_too():
    fine, paced = (
        run_case(load_case("split_edc", [PLAIN, *FREE, setting]))
        for setting in (
            'forward={duration="0.06 s",step="0.2 ms",must_rest=false}',
            forward("0.01 deg"),
        )
    )
    assert np.abs(fine.data.angle[-1] - paced.data.angle[-1]).max() < np.radians(0.5)
    assert paced.summary["step_control"]["largest_error_deg"] <= 0.01
    assert paced.summary["iterations"]["hood_solves"] == 1


def test_the_books_close_at_each_half():
    result = run_motion_case(forward("0.01 deg"), DAMPED)
    times = dict.fromkeys(row.state for row in result.rows)
    assert len(times) == 2 * result.summary["step_control"]["accepted"]
    for time in times:
        for body in BODIES:
            here = [row for row in result.rows if (row.state, row.body) == (time, body)]
            largest = max(np.linalg.norm(row.force) for row in here)
            assert np.linalg.norm(sum(row.force for row in here)) < 1e-9 * largest
    e = result.summary["energy_mJ"]
    assert work_done(e) == pytest.approx(work_kept(e), rel=1e-9)
    assert e["joints_dissipated"] > 1e-3
    assert e["joints_dissipated"] == pytest.approx(1e3 * sum(_law_losses(result)), rel=1e-9)


def _law_losses(result: Result) -> np.ndarray:
    """J in each half, by the case's law alone."""
    from cosim.models.motion import moving_models

    case = load_case("pulley_edc", [PLAIN, *FREE, forward("0.01 deg"), DAMPED])
    assert case.forward is not None
    law = moving_models(case, case.forward).finger.finger.law
    data = result.data
    pairs = zip(data.step.values[1:], data.angle.values[1:], data.rate.values[1:], strict=True)
    return np.array([-h * law.viscous(q, v)[0] @ v for h, q, v in pairs])


def test_what_no_step_resolves_is_an_honest_stop():
    words = r"step control: at t = .* s a step of 0\.00\d+ s, the smallest allowed, has an error of"
    with pytest.raises(ConvergenceError, match=words):
        run_motion_case(forward("1e-6 deg", floor="2 ms"))


@pytest.mark.slow
def test_a_motion_that_was_cut_off_goes_on_to_the_same_bytes(tmp_path: Path, monkeypatch):
    fibre = (
        'tendons.EDC.muscle={kind="millard",optimal_fibre_length="70 mm",'
        'tendon_slack_length="264.68 mm"}'
    )
    own = forward("0.1 deg", checkpoint=7)
    case = load_case("pulley_edc", [PLAIN, *FREE, own, fibre])
    whole = run_case(case)
    assert whole.summary["step_control"]["accepted"] > 50
    with pytest.raises(StoppedError, match="Go on with: cosim run --resume"):
        run_case(case, Session(checkpoints=tmp_path), Stopper(1))
    kept: list[Path] = []
    monkeypatch.setattr(run_motion, "write_checkpoint", lambda folder, *_: kept.append(folder))
    gone = run_case(case, Session(checkpoints=tmp_path))
    assert len(kept) == whole.summary["step_control"]["accepted"] // 7 - 50 // 7
    assert identical(whole, gone)
    assert gone.summary["step_control"] == whole.summary["step_control"]


def test_rest_is_looked_for_over_the_same_time(tmp_path: Path):
    run = run_motion_case(forward("0.1 deg").replace("must_rest=false,", ""))
    assert "at_rest" in run.audit.missed


def test_without_it_steps_are_as_long_as_stated(fine):
    assert "step_control" not in fine.summary
    assert fine.data.step.values[1:] == pytest.approx(2e-4)


def test_no_sliver_is_left_at_the_end():
    assert _first_try(1.0, 0.3) == 0.3
    assert _first_try(0.31, 0.3) == 0.155
    assert _first_try(0.3, 0.3) == 0.3
    assert Pace(1.0).accepted == 0
    assert DURATION_ROUNDING < 1e-9


def test_the_case_keeps_it():
    case = load_case("pulley_edc", [*FREE, forward("0.01 deg", floor="2 us")])
    assert case.forward is not None
    assert case.forward.adaptive is not None
    assert case.forward.adaptive.tolerance == pytest.approx(np.deg2rad(0.01))
    assert "[forward.adaptive]" in resolved_toml(case)
    assert 'floor = "2e-06 s"' in resolved_toml(case)


@pytest.mark.parametrize(
    ("name", "setting", "words"),
    [
        ("pulley_edc", forward("0.1 deg", floor="20 ms"), "must not be above the step"),
        ("pulley_edc", forward("0 deg"), "must be above 0 deg"),
        ("pulley_edc", "forward.adaptive={floor='1 us'}", r"forward\.adaptive\.tolerance.*missing"),
    ],
)
def test_what_is_refused(name: str, setting: str, words: str):
    with pytest.raises(InputError, match=words):
        run_case(load_case(name, [PLAIN, setting]))


def test_an_fmu_leaves_its_steps_to_its_master():
    from cosim.fmu_export.run import part_of

    case = load_case("pulley_edc", [*FREE, forward("0.1 deg")])
    with pytest.raises(InputError, match="the master sets the steps of an FMU"):
        part_of(case, "coupled")
