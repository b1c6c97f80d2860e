"""A solve ends when its patience is over, says how far it came, and a motion goes on from there."""

from __future__ import annotations

from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest

from cosim import errors
from cosim.array_cache import OFF, VARIABLE
from cosim.case.file import load_case
from cosim.case.usual import unusual_values
from cosim.errors import ConvergenceError, PatienceError, pulse, relay_progress, say
from cosim.outcome import outcome_of
from cosim.pipeline import run_case
from cosim.solve.session import Session

MOTION = {"forward.duration": "20 ms", "forward.step": "1 ms", "forward.must_rest": False}


@pytest.fixture
def clock(monkeypatch):
    """A clock that goes on by a second whenever a solver looks at it."""
    seconds = count()
    monkeypatch.setattr(errors, "time", SimpleNamespace(monotonic=lambda: float(next(seconds))))


def in_motion(**more):
    return load_case("pulley_edc").replace({**MOTION, **more})


@pytest.mark.parametrize(
    ("name", "values", "says"),
    [
        ("pulley_edc", {}, "round 1 begins"),
        ("pulley_edc", {"coupling.scheme": "implicit"}, "round 1 begins"),
        ("cable_edc", {}, "the hood's iteration 0, residual"),
        ("pulley_edc", MOTION, "step 1 of 20"),
        ("pulley_edc", {**MOTION, "coupling.scheme": "newton"}, "hood solve 1"),
        ("pulley_edc", {**MOTION, "forward.adaptive": {"tolerance": "0.1 deg"}}, "1 steps"),
    ],
)
def test_a_solve_without_time_says_where_it_was_and_what_to_try(name, values, says, monkeypatch):
    monkeypatch.setenv(VARIABLE, OFF)  # of kept responses, which take no iteration
    case = load_case(name).replace({**values, "solve.patience": "1e-6 ms"})
    outcome = outcome_of(lambda: run_case(case))
    assert outcome.status == "failed"
    assert isinstance(outcome.error, ConvergenceError)
    for words in (says, "solve.patience was over after", "Try a longer solve.patience"):
        assert words in str(outcome.error)


def test_what_a_solve_says_last_is_how_far_it_came(clock):
    case = load_case("pulley_edc").replace({"solve.patience": "11 s"})
    told: list[str] = []
    with pytest.raises(ConvergenceError, match=r"at: loaded: coupling round \d: relative residual"):
        run_case(case, progress=told.append)
    assert told[-1].startswith("loaded: coupling round")


def test_enough_patience_changes_nothing():
    case = load_case("pulley_edc")
    patient = run_case(case.replace({"solve.patience": "1000 s"}))
    assert patient.data.identical(run_case(case).data.assign_attrs(patient.data.attrs))
    assert list(unusual_values(case.replace({"solve.patience": "86400 s"}))) == []


@pytest.mark.slow
def test_a_motion_in_pieces_is_the_motion(clock, tmp_path):
    case, reached = in_motion(**{"solve.patience": "9 s"}), []
    while len(reached) < 9:
        try:
            result = run_case(case, Session(checkpoints=tmp_path))
            break
        except ConvergenceError as error:
            assert "cosim run --resume" in str(error)
            reached.append(float(error.reached.data.time[-1]))
    whole = run_case(in_motion())
    assert 1 < len(reached) < 9
    assert reached == sorted(set(reached))
    for name, array in whole.data.data_vars.items():
        np.testing.assert_array_equal(result.data[name], array, err_msg=str(name))


def test_a_word_alone_ends_nothing(clock):
    """The last word of a solve comes when it is solved."""
    with relay_progress(errors.quiet, 0.5) as tell:
        tell("the last word is no reason to end")
        with pytest.raises(PatienceError):
            pulse("iteration {}", 1)


def test_after_a_silence_the_iteration_is_told(clock):
    told: list[str] = []
    with relay_progress(told.append):
        say("round 1")
        for i in range(30):
            pulse("iteration {}", i)
    assert told == ["round 1", "round 1; iteration 10", "round 1; iteration 21"]


def test_who_begins_no_solve_is_never_interrupted(clock):
    pulse("iteration {}", 1)
    say("nobody hears")


def test_patience_is_in_seconds_minutes_or_hours():
    for text, seconds in (("90 s", 90.0), ("10 min", 600.0), ("2 h", 7200.0)):
        assert load_case("pulley_edc", [f'solve.patience="{text}"']).solve.patience == seconds
