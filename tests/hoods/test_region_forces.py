"""The force that a region passes on: of a strip its pull, and at any station the sum of all."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.hoods.shell.region_forces import (
    Crossing,
    crossing,
    crossing_force,
    element_forces,
    strip_arms,
)
from cosim.models.build import Models, hood_mesh
from cosim.pipeline import run_case
from cosim.solve.solvers import solve

PULL = 7.0
"""N, of the strip."""


def pulled_strip(turn: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, quads and element forces (N) of a strip of 4 x 2 quads that is pulled with PULL along
    its length, turned by `turn` (rad) in its plane; each column of quads shares it evenly."""
    x, y = np.meshgrid(np.linspace(0, 8e-3, 5), np.linspace(0, 2e-3, 3), indexing="ij")
    way = np.array([np.cos(turn), np.sin(turn), 0.0])
    side = np.array([-np.sin(turn), np.cos(turn), 0.0])
    points = x.ravel()[:, None] * way + y.ravel()[:, None] * side
    first = (3 * np.arange(4)[:, None] + np.arange(2)).ravel()
    quads = first[:, None] + [0, 3, 4, 1]
    each = PULL / 4 * way  # two quads, two nodes at either end
    force = np.array([-each, each, each, -each])
    return points, quads, np.tile(force, (len(quads), 1, 1))


@pytest.mark.parametrize("turn", [0.0, 0.7])
@pytest.mark.parametrize("at", [1e-3, 4.5e-3, 7e-3])
def test_a_strip_passes_its_pull_on_across_any_line(turn, at):
    points, quads, force = pulled_strip(turn)
    along = points @ [np.cos(turn), np.sin(turn), 0.0]
    line = crossing(quads, np.arange(len(quads)), along > at)
    assert len(line.elements) == 2
    assert crossing_force(force, points, quads, line) == pytest.approx(PULL, rel=1e-12)


@pytest.mark.parametrize("height", [-2e-3, 0.0, 3e-3])
@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_a_strip_s_arm_is_its_distance_from_the_axis(turn, height):
    """The strip runs along x, level, over an axis along y; turned in its plane it pulls on the axis
    with the same arm times the cosine."""
    points, quads, force = pulled_strip(turn)
    line = crossing(quads, np.arange(len(quads)), points @ [np.cos(turn), np.sin(turn), 0.0] > 3e-3)
    above, axis = points + np.array([0.0, 0.0, height]), np.array([0.0, 1.0, 0.0])
    for pull, arms in ((1.0, {"strip": height * np.cos(turn)}), (1e-3, {})):
        found = strip_arms(pull * force, above, quads, {"strip": line}, axis)
        assert found == pytest.approx(arms, abs=1e-15)


def test_a_line_past_all_elements_crosses_none():
    _, quads, _ = pulled_strip(0.0)
    line = crossing(quads, np.arange(len(quads)), np.zeros(15, dtype=bool))
    assert isinstance(line, Crossing)
    assert not len(line.elements)


@cache
def solve_case() -> tuple[Models, Any, dict[str, Any]]:
    case = load_case("hood_rest", ["hood.mesh.quads=250"])
    models, states = solve(case)
    return models, states.loaded, run_case(case).summary


@pytest.mark.slow
@pytest.mark.parametrize("station", [-15.0, 12.0, 30.0, 42.0])
def test_at_each_station_the_regions_pass_on_what_is_pulled(station):
    """EDC, and EI, LUM and FPI at rest; the curve of the sheet is less than 3 % of the sum of
    magnitudes."""
    models, loaded, summary = solve_case()
    mesh = hood_mesh(load_case("hood_rest", ["hood.mesh.quads=250"]))
    state = loaded.response.state
    force = element_forces(models.hood, state)
    line = crossing(mesh.quads, np.arange(len(mesh.quads)), mesh.station > station)
    points = state.configuration.x
    pulled = summary["tension_N"]
    ends = ("EDC", "EI") if station < -8.0 else models.hood.tendons
    passed = crossing_force(force, points, mesh.quads, line)
    assert passed == pytest.approx(sum(pulled[t] for t in ends), rel=0.03)


@pytest.mark.slow
def test_what_the_slips_bear_at_their_bones_their_regions_pass_on():
    _, _, summary = solve_case()
    forces, slips = summary["region_force_N"], summary["slip_force_N"]
    assert forces["terminal_slip"] == pytest.approx(slips["terminal"], rel=0.02)
    assert forces["central_slip"] == pytest.approx(slips["central"], rel=0.1)
    bands = forces["lateral_band_radial"] + forces["lateral_band_ulnar"]
    # a part leaves the bands on the way: to the taut retinacular ligaments and the sheet beside
    assert bands == pytest.approx(slips["terminal"], rel=0.1)
    assert forces["extensor_tendon_proximal"] == pytest.approx(11.85, rel=0.03)
