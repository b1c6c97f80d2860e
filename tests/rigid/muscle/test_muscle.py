"""The isometric muscle: its balance against the exact curves, its derivatives, its limits."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.errors import ConvergenceError, InputError
from rigid.muscle import curves, millard
from rigid.muscle.millard import equilibrium, path_length
from rigid.muscle.parameters import DAMPED, Muscles
from tests.proofs.fingers import muscle_rows
from tests.proofs.fingers.index_muscles import index_muscles

INDEX = index_muscles()
RIGID = index_muscles(rigid_tendon=True)


@st.composite
def muscle(draw: st.DrawFn) -> Muscles:
    """One muscle, with a tendon of a tenth to ten times the fibre."""
    fibre = draw(st.floats(0.01, 0.2))
    return Muscles(
        ("M",),
        np.array([draw(st.floats(0.1, 1000.0))]),
        np.array([fibre]),
        np.array([fibre * draw(st.floats(0.1, 10.0))]),
        np.array([draw(st.floats(0.0, 1.2))]),
    )


def fibre_pull(muscles: Muscles, activation: np.ndarray, length: np.ndarray) -> np.ndarray:
    """N, the resting fibre's pull along the tendon, by the exact curves."""
    x = length / muscles.optimal_fibre_length
    cosine = np.sqrt(1.0 - (muscles.width / length) ** 2)
    force = np.maximum(activation, muscles.min_activation) * DAMPED.active.value(x)
    return muscles.max_force * (force + DAMPED.passive.value(x)) * cosine


def test_muscles_stand_alone() -> None:
    """Neither MuJoCo nor what reads case files comes with them."""
    code = (
        "import sys, rigid.muscle.dynamics, tests.proofs.fingers.index_muscles;"
        "print(sorted({'mujoco', 'scipy', 'pydantic', 'opensim'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_table_covers_slack_and_stretched_muscles() -> None:
    """The comparison with OpenSim would say nothing of forces that are all small."""
    with np.load(muscle_rows.TABLE) as table:
        assert table["force"].shape == (11, 41, 8)
        share = table["force"] / INDEX.max_force
        assert (share.max(axis=(0, 1)) > 0.95).all()
        assert (share.min(axis=(0, 1)) == 0.0).all()
        assert "OpenSim 4" in str(table["provenance"])


@given(muscle(), st.floats(0.0, 1.0), st.floats(0.0, 2.5))
def test_fibre_and_tendon_pull_alike(muscles: Muscles, activation: float, stretch: float) -> None:
    path = muscles.tendon_slack_length + stretch * muscles.optimal_fibre_length
    at = equilibrium(muscles, activation, path)
    s = np.sqrt(at.fibre_length**2 - muscles.width**2)
    tendon = DAMPED.tendon.value((path - s) / muscles.tendon_slack_length)
    assert at.force >= 0.0
    assert at.force == pytest.approx(muscles.max_force * tendon, abs=1e-8 * muscles.max_force[0])
    assert np.sin(at.pennation) * at.fibre_length == pytest.approx(muscles.width, abs=1e-12)
    if at.fibre_length > muscles.shortest_fibre * (1.0 + 1e-9):
        pull = fibre_pull(muscles, np.array([activation]), at.fibre_length)
        assert at.force == pytest.approx(pull, abs=1e-8 * muscles.max_force[0])
    else:
        assert at.fibre_length == pytest.approx(muscles.shortest_fibre, rel=1e-9)


@given(muscle(), st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.3, 2.0))
def test_more_activation_never_pulls_less(
    muscles: Muscles, first: float, second: float, stretch: float
) -> None:
    path = muscles.tendon_slack_length + stretch * muscles.optimal_fibre_length
    less, more = (equilibrium(muscles, a, path) for a in sorted((first, second)))
    assert more.force >= less.force - 1e-9 * muscles.max_force
    assert more.gain >= 0.0


@given(muscle(), st.floats(0.02, 1.0), st.floats(0.7, 1.6))
def test_path_length_puts_the_fibre_where_it_says(
    muscles: Muscles, activation: float, normalised: float
) -> None:
    shortest = float(muscles.shortest_fibre[0] / muscles.optimal_fibre_length[0])
    for each in (muscles, replace(muscles, rigid_tendon=True)):
        wanted = max(normalised, shortest + 0.01)
        at = equilibrium(each, activation, path_length(each, wanted, activation))
        pull = fibre_pull(each, np.array([activation]), wanted * each.optimal_fibre_length)
        assert at.force == pytest.approx(pull, abs=1e-8 * each.max_force[0])
        if at.stiffness > 0.0:  # on the falling limb more than one length can balance
            assert at.normalised_length == pytest.approx(wanted, abs=1e-4)


def test_full_activation_at_optimal_length_pulls_with_max_force_along_the_tendon() -> None:
    at = equilibrium(INDEX, 1.0, path_length(INDEX, 1.0, 1.0))
    assert at.force == pytest.approx(INDEX.max_force * np.cos(INDEX.pennation), rel=1e-9)
    assert at.pennation == pytest.approx(INDEX.pennation, abs=1e-9)


@pytest.mark.parametrize("muscles", [INDEX, RIGID], ids=["elastic", "rigid"])
def test_derivatives_are_those_of_differences(muscles: Muscles) -> None:
    activation, h = np.linspace(0.05, 0.95, 7)[:, None, None], 1e-5
    path = path_length(muscles, np.linspace(0.55, 1.55, 9)[:, None], activation)
    at = equilibrium(muscles, activation, path)
    step = h * muscles.optimal_fibre_length
    scale = muscles.max_force
    up, down = (equilibrium(muscles, activation, path + d).force for d in (step, -step))
    difference = (up - down) / (2 * step)
    stiffness = scale / muscles.optimal_fibre_length
    assert at.stiffness / stiffness == pytest.approx(difference / stiffness, abs=1e-6)
    up, down = (equilibrium(muscles, activation + d, path).force for d in (h, -h))
    assert at.gain / scale == pytest.approx((up - down) / (2 * h) / scale, abs=1e-6)


def test_a_tendon_hardly_elastic_is_as_a_rigid_one() -> None:
    stiff = replace(DAMPED, tendon=curves.tendon_force_length(1e-6))
    x = np.linspace(0.5, 1.5, 11)[:, None]
    path = INDEX.tendon_slack_length + x * INDEX.optimal_fibre_length
    elastic = equilibrium(replace(INDEX, curves=stiff), 0.6, path)
    rigid = equilibrium(RIGID, 0.6, path)
    assert elastic.force / INDEX.max_force == pytest.approx(rigid.force / INDEX.max_force, abs=1e-4)
    assert elastic.stiffness == pytest.approx(rigid.stiffness, rel=1e-2, abs=1.0)
    assert rigid.force == pytest.approx(fibre_pull(INDEX, np.array(0.6), rigid.fibre_length))


@pytest.mark.parametrize("muscles", [INDEX, RIGID], ids=["elastic", "rigid"])
def test_a_muscle_on_too_short_a_path_is_slack(muscles: Muscles) -> None:
    path = muscles.tendon_slack_length + 0.9 * muscles.shortest_along
    at = equilibrium(muscles, 1.0, path)
    assert at.fibre_length == pytest.approx(muscles.shortest_fibre, rel=1e-12)
    for part in (at.force, at.stiffness, at.gain):
        assert (part == 0.0).all()


def test_smallest_activation_is_kept() -> None:
    path = path_length(INDEX, 1.0, 0.01)
    assert equilibrium(INDEX, 0.0, path).force == pytest.approx(
        equilibrium(INDEX, 0.01, path).force
    )
    free = replace(INDEX, min_activation=0.0)
    assert equilibrium(free, 0.0, free.tendon_slack_length).force == pytest.approx(0.0, abs=1e-12)


def test_shapes_follow_broadcasting() -> None:
    path = path_length(INDEX, 1.0, 0.1)
    grid = equilibrium(INDEX, np.linspace(0, 1, 11)[:, None, None], path + np.zeros((41, 1)))
    assert grid.force.shape == grid.gain.shape == grid.pennation.shape == (11, 41, 8)
    assert grid.force[3, 7] == pytest.approx(equilibrium(INDEX, 0.3, path).force)
    one = equilibrium(INDEX, 0.3, 0.3)
    assert one.force.shape == (8,)


def test_a_guess_changes_nothing_but_the_way() -> None:
    path = path_length(INDEX, 1.2, 0.4)
    plain = equilibrium(INDEX, 0.4, path)
    for guess in (0.0, 0.5, 1.19, 3.0):
        at = equilibrium(INDEX, 0.4, path, guess * INDEX.optimal_fibre_length)
        assert at.force / INDEX.max_force == pytest.approx(plain.force / INDEX.max_force, abs=1e-10)


def test_the_safeguarded_iteration_finds_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    activation = np.linspace(0, 1, 5)[:, None, None]
    path = INDEX.tendon_slack_length + np.linspace(0.3, 2.0, 30)[:, None] * (
        INDEX.optimal_fibre_length
    )
    plain = equilibrium(INDEX, activation, path).force / INDEX.max_force
    monkeypatch.setattr(millard, "ROUNDS", 0)
    bracketed = equilibrium(INDEX, activation, path).force / INDEX.max_force
    assert bracketed == pytest.approx(plain, abs=1e-9)


def test_a_muscle_that_does_not_converge_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    path = np.where(np.arange(8) < 2, 0.0, path_length(INDEX, 1.2, 0.4))
    equilibrium(INDEX, 0.4, path)
    monkeypatch.setattr(millard, "ROUNDS", 0)
    monkeypatch.setattr(curves, "LIMIT", 3)
    with pytest.raises(ConvergenceError, match="muscle FDIm: its fibre length"):
        equilibrium(INDEX, 0.4, path)


def with_(**changes: object) -> Callable[[], object]:
    return lambda: replace(INDEX, **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (with_(max_force=-INDEX.max_force), "FDP, max_force: expected a number above 0, got -79"),
        (with_(optimal_fibre_length=np.array([0.1] * 7 + [0.0])), "LUM, optimal_fibre_length"),
        (with_(tendon_slack_length=np.full(8, np.inf)), "FDP, tendon_slack_length.*got inf"),
        (with_(pennation=np.full(8, 7.0)), "FDP, pennation: expected 0 to 1.4706 rad, got 7"),
        (with_(damping=-0.1), "FDP, damping: expected a number of at least 0, got -0.1"),
        (with_(damping=0.0), "FDP, damping: 0 leaves the velocity undetermined"),
        (with_(min_activation=np.nan), "FDP, min_activation: expected 0 to 1, got nan"),
        (with_(activation_time=0), "FDP, activation_time: expected a number above 0"),
        (with_(deactivation_time=0), "FDP, deactivation_time"),
        (with_(max_velocity=np.ones(3)), r"max_velocity: expected.*8 muscles, got shape \(3,\)"),
        (lambda: index_muscles("FDP", "FDB"), "muscle 'FDB': expected one of FDP, FDS"),
        (lambda: equilibrium(INDEX, 1.1, 0.3), "FDP, activation: expected 0 to 1, got 1.1"),
        (lambda: equilibrium(INDEX, np.array([0.1] * 6 + [np.nan, 0]), 0.3), "muscle EI, act"),
        (lambda: equilibrium(INDEX, 0.1, -0.3), "FDP, path length: expected 0 to"),
        (lambda: equilibrium(INDEX, 0.1, np.ones(3)), r"path length.*8 muscles.*shape \(3,\)"),
        (lambda: path_length(INDEX, 0.4, 0.1), "FDP, normalised fibre length.*0.4441"),
    ],
)
def test_bad_input_is_named(wrong: Callable[[], object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        wrong()


def test_a_rigid_tendon_needs_no_damping() -> None:
    assert (replace(RIGID, damping=0.0).damping == 0.0).all()


def test_muscles_are_those_of_table_2() -> None:
    assert INDEX.names == ("FDP", "FDS", "FDIm", "FDIl", "EDC", "FPI", "EI", "LUM")
    two = index_muscles("EDC", "FDP")
    assert two.names == ("EDC", "FDP")
    assert two.max_force.tolist() == [34.69, 79.12]
    assert np.rad2deg(two.pennation) == pytest.approx([3.0, 7.0])
