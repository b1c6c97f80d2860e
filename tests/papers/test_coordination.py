"""The flexion of Buchner, Hines and Hemami in closed loop."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cases.papers.models.buchner1988.coordination import (
    ControlLoop,
    band_torque,
    crossing,
    deviation,
    differences,
    flex,
    line_deviation,
    reference,
    required_torque,
    share_forces,
)
from cases.papers.models.buchner1988.coordination_findings import (
    feasible,
    findings,
    flexion,
    table_sensitivity,
)
from cases.papers.models.buchner1988.flexion import DURATION, FULL
from cases.papers.models.printed import printed_values
from cosim.errors import ConvergenceError
from rigid.hoods.two_band import TABLE_1, Entry, coupled_dip, excursions, two_band


@cache
def findings_of_flexion():
    return flexion(samples=26)


@pytest.mark.parametrize("programme", ["linear", "quadratic"])
def test_muscles_and_bands_make_the_motion_whatever_the_programme(programme):
    """What joints feel is the torque asked for and the bands' spring: the same for both."""
    f = findings_of_flexion()
    forces = f.linear if programme == "linear" else f.quadratic
    network = two_band()
    for k, time in enumerate(f.motion.time):
        angle, rate = f.motion.angle[k], f.motion.rate[k]
        made = network.direct.at(angle) @ forces.muscles[k]
        made = made + network.connecting.at(angle) @ forces.bands[k]
        felt = required_torque(f.loop, time, angle, rate) + band_torque(f.loop, angle)
        assert made == pytest.approx(felt, abs=1e-10)
    assert forces.bands.sum(axis=1) == pytest.approx(forces.muscles[:, 0], abs=1e-9)
    assert min(forces.bands.min(), forces.muscles.min()) > -1e-9


def test_the_torque_asked_for_makes_the_feedback_s_acceleration():
    """Without bands a deviation from the reference dies as a critically damped one."""
    loop, rng = ControlLoop(bandwidth=7.0), np.random.default_rng(3)
    for time in (0.1, 0.6):
        angle, rate = rng.normal(size=(2, 3))
        q, v, a = reference(np.array(time))
        torque = required_torque(loop, time, angle, rate)
        made = loop.chain.acceleration(angle, rate, torque, np.zeros(2))
        assert made == pytest.approx(a + 14.0 * (v - rate) + 49.0 * (q - angle), rel=1e-9)


def test_the_bands_part_as_their_elasticity_says():
    f = findings_of_flexion()
    shift = f.loop.elasticity * differences(f.loop, f.motion)
    for forces in (f.linear, f.quadratic):
        total = forces.muscles[:, 0]
        middle = (1 - forces.share) * total + shift
        assert forces.bands[:, 0] == pytest.approx(middle, abs=1e-9)
    assert f.linear.share == pytest.approx(0.5)
    assert np.abs(shift).max() > 1e-3


def test_the_spring_is_the_slope_of_its_energy():
    loop, angle = ControlLoop(), np.array([0.1, 1.0, 0.2])

    def energy(at):
        motion = replace(findings_of_flexion().motion, angle=at[None])
        return 0.5 * loop.elasticity * float(differences(loop, motion)[0]) ** 2

    step = 1e-6
    slope = [(energy(angle + step * e) - energy(angle - step * e)) / (2 * step) for e in np.eye(3)]
    assert band_torque(loop, angle) == pytest.approx(-np.array(slope), rel=1e-6, abs=1e-12)


def test_the_reference_is_a_line_to_the_papers_end():
    angle, rate, _ = reference(np.linspace(0.0, DURATION, 11))
    assert np.degrees(angle[-1]) == pytest.approx([0.0, 110.0, 73.0], abs=0.02)
    assert angle[:, 2] * FULL == pytest.approx(angle[:, 1] * coupled_dip(np.array(FULL)))
    assert rate[[0, -1]] == pytest.approx(0.0, abs=1e-12)


def test_stiffer_bands_hold_the_parabola_and_feedback_the_line():
    off = {
        (w, K): deviation(ControlLoop(w, K), flex(ControlLoop(w, K), 51)).curve
        for w, K in ((10.0, 50.0), (10.0, 500.0), (20.0, 500.0))
    }
    assert off[10.0, 500.0] < 0.5
    assert off[10.0, 50.0] == pytest.approx(9.0 * off[10.0, 500.0], rel=0.1)
    assert off[20.0, 500.0] > 2 * off[10.0, 500.0]
    literal = ControlLoop(bands_answer=False)
    assert np.abs(line_deviation(flex(literal, 11))).max() < 1e-9


def test_the_papers_numbers():
    ours, paper = findings(findings_of_flexion()), printed_values("buchner1988")
    assert set(ours) == set(paper)
    for what in ("linear: ED at the end", "linear: middle band at the end"):
        assert ours[what] == pytest.approx(paper[what][0], abs=0.05)
    assert ours["quadratic: middle band's share"] == pytest.approx(72.0, abs=0.5)
    assert ours["quadratic: ED falls by"] == pytest.approx(7.5, abs=0.25)
    assert ours["quadratic: FDS, Int, Lum, most"] < 1e-9
    cross, change = ours["quadratic: bands cross"], ours["linear: FDS gives way to Int"]
    assert cross == pytest.approx(change, abs=5e-3)  # "coincides", says the paper


def test_a_fixed_share_of_one_half_is_feasible_and_one_is_not():
    f = findings_of_flexion()
    assert feasible(f.loop, f.motion) == 1.0
    assert feasible(replace(f.loop, lateral_share=1.0), f.motion) == 0.0


def test_a_band_that_would_push_is_refused():
    """Stiff bands, and a finger kept on the line, far from where they agree."""
    loop = ControlLoop(elasticity=50000.0)
    motion = replace(findings_of_flexion().motion, angle=findings_of_flexion().motion.reference)
    with pytest.raises(ConvergenceError, match="a band would have to push"):
        share_forces(loop, motion, "linear")


def test_excursions_are_the_table_s():
    angle = np.array([0.3, 1.2, 0.4])
    e = excursions(angle)
    fdp = sum(TABLE_1["FDP", j] and (TABLE_1["FDP", j].radius + TABLE_1["FDP", j].slope * q) * q
              for j, q in zip(("MCP", "PIP", "DIP"), angle, strict=True))  # fmt: skip
    middle = -5e-3 * 1.2
    lateral = -(5e-3 - 1.21e-3 * 1.2) * 1.2 - 3.5e-3 * 0.4
    assert e[1] == pytest.approx(fdp)
    assert e[0] == pytest.approx(-10e-3 * 0.3 + min(middle, lateral))
    assert e[3] == pytest.approx(5e-3 * 0.3 - 5e-3 * 1.2)


def test_doubts_change_what_rests_on_the_entry_alone():
    f = replace(findings_of_flexion(), loop=replace(findings_of_flexion().loop, table={
        ("Lum", "MCP"): TABLE_1["Lum", "MCP"],
        ("FDP", "DIP"): TABLE_1["FDP", "DIP"],
        **{k: Entry(e.radius, e.slope) for k, e in TABLE_1.items()
           if k not in (("Lum", "MCP"), ("FDP", "DIP"))},
    }))  # fmt: skip
    changed = table_sensitivity(f)
    base = findings(f)
    assert set(changed) == {("Lum", "MCP"), ("FDP", "DIP")}
    for side in changed["Lum", "MCP"]:
        assert side == pytest.approx(base, abs=1e-6)
    ends = [side["linear: ED at the end"] for side in changed["FDP", "DIP"]]
    assert ends[0] > 2 * base["linear: ED at the end"] > 2 * ends[1]


def test_a_crossing_is_found_between_samples():
    assert crossing(np.array([0.0, 1.0, 2.0]), np.array([1.0, 0.5, -0.5])) == pytest.approx(1.5)
    assert np.isnan(crossing(np.array([0.0, 1.0]), np.array([-1.0, 1.0])))
