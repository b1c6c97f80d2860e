"""Reducing a hood: states in which it is sampled, errors, the case file, the command."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.analyses.reduction import reduce as reduction
from cosim.analyses.reduction import walks as reduction_walks
from cosim.analyses.reduction.case_text import case_text
from cosim.analyses.reduction.errors import errors
from cosim.analyses.reduction.reduce import clamp_tip, tip_map, tip_maps
from cosim.analyses.reduction.samples import FailedSample, Walk, WalkSamples, on_models
from cosim.case.file import find_case, load_case
from cosim.cli import app
from cosim.errors import ConvergenceError, InputError
from cosim.hoods.lumped.build import potential
from cosim.hoods.lumped.table import NetworkHoodConfig
from cosim.models.build import build
from rigid.hoods.reduced import ReducedPotential
from rigid.hoods.reduction import Order, reduce_hood
from tests.helpers.soft_network import (
    FITTED,
    MUSCLES,
    SOFT,
    reduced_potential,
    samples,
    soft_models,
    unseen_sample,
)


def a_reduction(made: ReducedPotential) -> reduction.Reduction:
    return reduction.Reduction(
        load_case("network_edc", SOFT),
        within(),
        {"EDC": 12.0},
        made,
        samples()[:FITTED],
        samples()[FITTED:],
        ("0/0 deg: why",),
        1.0,
        reduction.Rate(1e-3, 1e-5),
    )


def test_the_case_file_holds_the_potential(tmp_path):
    made = reduced_potential()
    text = case_text(
        a_reduction(made), "it", "network_lum", ("tendons.EDC.tension=8 N", "hood.x=1")
    )
    text = text.replace('extends = "network_lum"', 'extends = "fingertip_isotropic_lum"')
    path = tmp_path / "made.toml"
    path.write_text(text)
    case = load_case(path)
    assert isinstance(case.hood, NetworkHoodConfig)
    assert case.hood.reduced is not None
    assert case.tension("EDC") == 8.0
    again = potential(case.hood.reduced)
    assert again.energy == pytest.approx(made.energy, rel=1e-8)
    assert again.slip == pytest.approx(made.slip, rel=1e-8)
    assert np.array_equal(again.angle_powers, made.angle_powers)
    assert again.low == pytest.approx(made.low, abs=1e-12)
    assert "beyond it 0 % of those states), at " in " ".join(text.replace("#", "").split())
    assert "why" in text
    path.write_text(
        text.replace("[hood.muscles.EDC]\n", "[hood.muscles.EDC]\nMCP.constant = '1 mm'\n")
    )
    with pytest.raises(InputError, match="stands for all arms"):
        load_case(path)
    path.write_text(
        text.replace(
            "[hood.muscles.EDC]\n\n[hood.muscles.LUM]", "[hood.muscles.LUM]\n\n[hood.muscles.EDC]"
        )
    )
    with pytest.raises(InputError, match="expected the hood's muscles, LUM, EDC, FPI"):
        load_case(path)


def test_errors_are_relative_to_the_hood():
    made, held = reduced_potential(), unseen_sample()
    exact = list(errors(a_reduction(made)))
    assert all(e.most < 1e-8 and e.beyond == 0 for e in exact)
    told = {e.quantity: e for e in errors(a_reduction(replace(made, energy=1.1 * made.energy)))}
    assert told["joint torques"].most == pytest.approx(0.1, rel=1e-6)
    assert told["joint torques"].mark is None
    assert told["tip force"].median == pytest.approx(0.1, rel=1e-6)
    assert (told["tip force"].mark, told["tip force"].beyond) == (0.05, 1.0)
    maps = tip_maps(load_case("network_edc"), held.angle)
    force = np.linalg.norm(np.einsum("sij,sj->si", maps, held.torque), axis=1)
    largest = 0.1 * force.max() / np.sqrt((force**2).mean())
    assert told["tip force, of the mean"].most == pytest.approx(largest, rel=1e-6)
    assert told["tip force, of the mean"].mark == 0.05
    worst = int(force.argmax())
    where = reduction.state_in_words(held.angle[worst], held.tension[worst], MUSCLES)
    assert told["tip force, of the mean"].where == where
    off = np.abs(0.1 * held.slip)
    assert 0 < told["slip forces"].most <= off.max() / off.max(axis=1).min()


def test_a_state_is_told_in_words():
    told = reduction.state_in_words(np.radians([30, 0, 12.25]), np.array([0.05, 3.0]), ("A", "B"))
    assert told == "30/0/12.2 deg, A 0.05, B 3 N"


def test_the_tip_map_is_what_the_clamped_finger_bears():
    """tau + J^T r = 0 of a finger held at its tip: the force balances the torques that made it."""
    case = clamp_tip(load_case("network_edc"))
    finger = build(case).finger
    angle = np.array([0.5, 0.0, 0.8, 0.3])
    state = finger.start(dict(zip(finger.joints, angle, strict=True)))
    made = tip_map(finger, angle)
    push = np.array([0.3, 0.1, -0.7])
    step = 1e-6
    tips = []
    for e in np.eye(len(finger.unknowns(state)))[:4]:
        ends = [finger.tip(finger.displace(state, sign * step * e)) for sign in (1, -1)]
        tips.append((ends[0] - ends[1]) / (2 * step))
    torque = np.array(tips) @ push  # joint torques that press the tip with this force
    assert made @ torque == pytest.approx(push, rel=1e-6)


def test_loads_of_tendons_at_rest():
    case = load_case("fingertip_fibres_edc")
    loads = reduction.greatest_loads(case, ("EDC", "EI", "LUM", "FPI"))
    assert loads == pytest.approx({"EDC": 3.469, "EI": 3.547, "LUM": 2.504, "FPI": 3.094})
    with pytest.raises(InputError, match="loads no tendon"):
        reduction.greatest_loads(load_case("fingertip_fibres_fdp"), ("EDC", "EI"))


def test_a_grid_is_read_and_walked_to_and_fro():
    assert reduction.read_grid(["PIP=30,10"]) == {"PIP": (10.0, 30.0)}
    assert reduction.read_grid([]) == reduction_walks.GRID
    with pytest.raises(InputError, match="write JOINT=DEG"):
        reduction.read_grid(["PIP=a"])
    lines = reduction_walks._to_and_fro([(1.0, 2.0, 3.0), (5.0, 6.0)])
    assert len(np.unique(lines, axis=0)) == 6
    steps = np.abs(np.diff(lines, axis=0))
    assert ((steps > 0).sum(axis=1) == 1).all()


def within() -> reduction_walks.SampleRange:
    grid = {"MCP": (0.0, 60.0), "DIP": (5.0, 35.0)}
    home, most = np.array([0.0, 0.02, 0.3, 0.0]), np.array([3.0, 0.6])
    return reduction_walks.SampleRange(
        ("MCP", "MCP_abduction", "PIP", "DIP"), home, grid, most, 0.05, 96
    )


def stops_of(walk):
    return list(walk.stops())


def test_states_between_the_grids_points_fill_its_box():
    """And the loads theirs, each posture with its own."""
    made, stops = (
        within(),
        [s for walk in reduction_walks.spread_walks(within()) for s in stops_of(walk)],
    )
    angle = np.degrees([at for at, _ in stops])
    assert angle.min(axis=0) == pytest.approx([0, 1.146, 17.19, 5], abs=2)
    assert angle.max(axis=0) == pytest.approx([60, 1.146, 17.19, 35], abs=2)
    assert (angle[:, 0] >= 0).all()
    assert (angle[:, 3] <= 35).all()
    parts = np.array([load[0] for _, load in stops]) / made.most
    assert len(np.unique(parts, axis=0)) == len(parts) == 2 * 96 + 128
    for k in range(2):
        alone = parts[np.isclose(parts[:, 1 - k] * made.most[1 - k], made.rest)][:, k]
        assert (len(alone), alone.min(), alone.max()) == pytest.approx((96, 0.25, 1.0), abs=0.03)
    mixed = parts[(parts * made.most != made.rest).all(axis=1)]
    assert (mixed.min(), mixed.max()) == pytest.approx((0.05, 0.65), abs=0.01)


def test_a_quarter_of_the_spread_postures_lies_nearer_to_the_ends():
    """Arcsine: half of them within 15 % of an end, which 30 % of evenly spread ones are."""
    points = np.random.default_rng(1).random((4000, 3))
    evenly, near_ends = reduction_walks._spread(2, points)
    assert (len(evenly), len(near_ends)) == (3000, 1000)
    assert np.array_equal(np.vstack([evenly, near_ends])[:, 2], points[:, 2])
    for part, expected in ((evenly, 0.293), (near_ends, 0.5)):
        outer = np.abs(part[:, :2] - 0.5) > 0.3536
        assert outer.mean(axis=0) == pytest.approx(expected, abs=0.04)
    assert [len(part) for part in reduction_walks._spread(2, points[:1])] == [1]


def test_held_states_are_none_of_those_fitted():
    """But drawn from the same box, from the same loads."""
    walks = [*reduction_walks.grid_walks(within()), *reduction_walks.spread_walks(within())]
    seen = np.array([at for walk in walks for at, _ in stops_of(walk)])
    held = [stop for walk in reduction_walks.held_out_walks(within()) for stop in stops_of(walk)]
    assert len(held) == 30
    for at, load in held:
        assert np.abs(at - seen).max(axis=1).min() > 1e-6
        assert (seen.min(axis=0) <= at + 1e-12).all()
        assert (at <= seen.max(axis=0) + 1e-12).all()
        assert (load <= within().most).all()
    assert len(np.unique([load for _, load in held], axis=0)) == 30


def test_points_are_passed_from_one_to_the_nearest():
    made = reduction_walks._nearest_order(
        np.array([[9.0, 9.0], [0.0, 0.0], [5.0, 5.0], [1.0, 0.0]])
    )
    assert made == [1, 3, 2, 0]


def test_every_posture_may_have_loads_of_its_own():
    angles, loads = np.arange(6.0).reshape(3, 2), np.arange(12.0).reshape(3, 2, 2)
    own, alike = stops_of(Walk(angles, loads)), stops_of(Walk(angles, loads[0]))
    assert [load.tolist() for _, load in own] == loads.tolist()
    assert [load.tolist() for _, load in alike] == [loads[0].tolist()] * 3


def test_a_grid_beyond_the_joints_is_refused():
    source = find_case("cable_edc")
    for grid, words in (
        ({"FOO": (1.0,)}, "unknown joint FOO"),
        ({"PIP": (500.0,)}, "0 to 110 deg"),
    ):
        with pytest.raises(InputError, match=words):
            reduction.reduce_case(source, (), grid, 1)


class Stuck:
    """A hood that finds no equilibrium beyond a PIP angle."""

    def __init__(self, hood, most: float) -> None:
        self.hood, self.most, self.tendons = hood, most, hood.tendons

    def __getattr__(self, name):
        return getattr(self.hood, name)

    def advance(self, state, motion, tension, dt):
        relative = motion.rotation[1].T @ motion.rotation[2]
        if np.arccos((np.trace(relative) - 1) / 2) > self.most:
            raise ConvergenceError("stuck")
        return self.hood.advance(state, motion, tension, dt)


def test_reducing_leaves_out_what_does_not_converge(monkeypatch, tmp_path):
    """The whole command, on a network in place of the shell."""
    models = soft_models()
    stuck = replace(models, built=replace(models.built, hood=Stuck(models.hood, np.radians(50))))

    def in_this_process(source, settings, walks, workers):
        for one in walks:
            yield WalkSamples(list(on_models(stuck, one)), 1.0)

    monkeypatch.setattr(reduction, "build", lambda case: models)
    monkeypatch.setattr(reduction, "sample_walks", in_this_process)
    monkeypatch.setattr(
        reduction, "reduce_hood", lambda *a, maps: reduce_hood(*a, Order(angle=2), maps)
    )
    out = tmp_path / "made.toml"
    done = CliRunner().invoke(
        app, ["export", "fingertip_isotropic_edc", "--spread", "12", "-o", str(out)]
    )
    assert done.exit_code == 0, done.output
    assert "left out: 22/0/55/20 deg, EDC 3.47, LUM 0.05, FPI 0.05 N: stuck" in done.output
    case = load_case(out)
    assert isinstance(case.hood, NetworkHoodConfig)
    assert case.finger.tip.kind == "clamped"


def test_only_hoods_of_finite_elements_are_reduced(tmp_path):
    out = str(tmp_path / "r.toml")
    done = CliRunner().invoke(app, ["export", "network_edc", "-o", out])
    assert done.exit_code == 2
    assert "nothing is gained" in done.output
    done = CliRunner().invoke(app, ["export", "cable_edc", "-o", out, "--grid", "TIP=1,2"])
    assert done.exit_code == 2
    assert "unknown joint TIP" in done.output


def test_a_walk_goes_on_from_the_last_posture_found():
    models = soft_models()
    stuck = replace(models, built=replace(models.built, hood=Stuck(models.hood, 0.5)))
    angle = np.array([[0, 0, 0.3, 0.1], [0, 0, 0.8, 0.1], [0, 0, 0.4, 0.1]])
    states = list(on_models(stuck, Walk(angle, np.full((2, 3), 8.0))))
    assert [isinstance(s, FailedSample) for s in states] == [False, False, True, True, False, False]


def test_a_walk_is_followed_in_small_steps(monkeypatch):
    models, seen = soft_models(), []
    pose = models.finger.motion

    def told(state):
        seen.append(models.finger.angles(state)[2])
        return pose(state)

    monkeypatch.setattr(models.finger, "motion", told)
    list(
        on_models(
            models, Walk(np.array([[0, 0, 0.3, 0.1], [0, 0, 0.9, 0.1]]), np.full((1, 3), 8.0))
        )
    )
    assert np.abs(np.diff(seen)).max() <= np.radians(10.0) + 1e-12
    assert seen[-1] == 0.9
