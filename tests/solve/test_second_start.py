"""Whether an equilibrium is stable with the bones free, and the only one as far as a second start
tells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.coupling.equilibrium import coupled_stiffness
from cosim.errors import InputError
from cosim.pipeline import run_case
from cosim.results.audit import describe_misses
from cosim.results.compare import numbers_of, value_of
from cosim.results.quantities import meaning_of
from cosim.results.second_start import largest_differences, potential_change
from cosim.results.static import summary
from cosim.solve.session import Session
from cosim.solve.solvers import solve
from tests.helpers.shells import COARSE_NET

AGAIN = "solve.second_start=true"
LOOSE = [f'hood.springs.retinacular_{side}.slack="1 mm"' for side in ("radial", "ulnar")]
"""Ligaments that let a net roll over the head: it has two equilibria then."""
SECOND = ("second_start_force_N", "second_start_angle_deg")


def test_a_second_start_that_finds_the_same_keeps_the_audit():
    session = Session()
    once, again = (
        run_case(load_case("pulley_edc", sets), session).summary for sets in ([], [AGAIN])
    )
    assert again["second_start"]["scheme"] == "implicit"
    assert again["fingertip_force_N"] == once["fingertip_force_N"]
    assert again["audit"]["second_start_force_N"] < 1e-4
    assert again["audit"]["second_start_angle_deg"] < 1e-4
    assert again["audit_missed"] == once["audit_missed"] == []
    assert "second_start" not in once
    assert not set(SECOND) & set(once["audit"])


def test_a_scheme_that_finds_none_leaves_the_start_alone_to_differ():
    found = run_case(load_case("network_edc", [AGAIN])).summary
    assert found["second_start"]["scheme"] == "linear"
    assert found["audit_missed"] == []


def test_a_net_that_cannot_roll_has_one_equilibrium():
    found = run_case(load_case("cable_edc", [COARSE_NET, AGAIN])).summary
    assert found["audit"]["second_start_force_N"] < 1e-6
    assert found["audit_missed"] == []


def test_a_net_with_two_equilibria_is_told():
    """Both to a residual below 1e-6, some 0.1 N apart: the tip's force depends on whether the net
    was first pulled by the resting tension."""
    found = run_case(load_case("cable_edc", [COARSE_NET, AGAIN, *LOOSE])).summary
    assert found["audit"]["interface_residual"] < 1e-6
    assert found["audit"]["second_start_force_N"] > 0.05
    assert "second_start_force_N" in found["audit_missed"]
    first, other = (
        np.array(list(block["fingertip_force_N"].values()))
        for block in (found, found["second_start"])
    )
    assert np.linalg.norm(first - other) == pytest.approx(found["audit"]["second_start_force_N"])
    second = found["second_start"]
    stated = numbers_of(second["difference"])
    assert len({path.split(".")[0] for path in stated}) == len(stated) == 5
    for path, change in stated.items():
        assert value_of(second, path) - value_of(found, path) == pytest.approx(change)
        assert meaning_of(f"second_start.difference.{path}", found)
    assert len(list(describe_misses(found))) == 1 + 5
    assert set(second["hood_energy_mJ"]) == {"first", "second"}
    assert 0 < abs(second["potential_change_mJ"]) < second["hood_energy_mJ"]["first"]


def test_the_numbers_that_differ_most_are_one_of_each_kind_relative_to_the_largest_of_it():
    first = {"a_N": {"x": 1.0, "y": 0.1}, "b_mm": 2.0, "c_deg": 1e-9, "ratio": 1.0, "same_N": 3.0}
    second = {"a_N": {"x": 1.2, "y": 0.0}, "b_mm": 1.0, "c_deg": -1e-9, "ratio": 9.0, "same_N": 3.0}
    found = numbers_of(largest_differences(first, second))
    assert list(found)[:2] == ["b_mm", "a_N.x"]
    assert found["b_mm"] == -1.0
    assert found["a_N.x"] == pytest.approx(0.2)
    assert "ratio" not in found
    assert "same_N" not in found


GRAVITY = "finger.gravity=['0 m/s**2', '0 m/s**2', '-9.80665 m/s**2']"


@pytest.mark.parametrize("settings", [(), (GRAVITY,)])
def test_the_change_of_potential_is_the_work_of_a_tension_less_what_it_would_be(settings):
    """From the equilibrium under T to that under T + dT, the potential at T rises by the integral
    of t dw over the added tension t, which is dT dw / 2 for small changes; the fingertip is free,
    so that the finger moves."""
    free = ("finger.tip.kind='free'", "finger.limit.half_range='90 deg'")
    case = load_case("cable_edc", [COARSE_NET, *free, *settings])
    session, found = Session(), []
    for tension in ("0.5 N", "0.505 N"):
        pulled = case.replace({"tendons.EDC.tension": tension})
        found.append(solve(pulled, session))
    models, a, b = found[0][0], found[0][1].loaded, found[1][1].loaded
    b_at_a = replace(b, hood_tension=a.hood_tension)
    turned = np.abs(models.finger.angles(b.finger_state) - models.finger.angles(a.finger_state))
    assert turned.max() > 5e-4
    change = 0.5 * (b.hood_tension - a.hood_tension) @ (b.excursion - a.excursion)
    assert change > 0
    assert potential_change(models, a, b_at_a) == pytest.approx(change, rel=2e-3)
    assert potential_change(models, a, b) is None


def test_a_hood_that_rubs_may_have_two():
    found = run_case(load_case("cable_edc", [COARSE_NET, AGAIN, "hood.contact.friction=0.1"]))
    assert "path" in found.summary["audit_not_judged"]["second_start"]
    assert not set(SECOND) & set(found.summary["audit_missed"])


@pytest.mark.parametrize("settings", [["coupling.scheme='one_way'"], ["forward.duration='0.1 s'"]])
def test_a_second_start_of_what_has_no_equilibrium_is_refused(settings):
    with pytest.raises(InputError, match=r"solve\.second_start"):
        load_case("pulley_edc", [AGAIN, *settings])


def test_an_equilibrium_that_a_push_on_a_joint_leaves_misses_the_audit():
    """With bones held the hood is stable; a load that grows as the finger turns by more than the
    joints resist leaves one motion of the held fingertip unstable."""
    case = load_case("pulley_edc")
    models, states = solve(case)
    stable = coupled_stiffness(models.finger, states.loaded)
    assert len(stable) == 1, "four joints less the three that the tip's point takes"
    assert stable.min() > 0
    e, turns = states.loaded, models.finger.jacobian(states.loaded.finger_state)
    grows = e.jacobian.load_motion + np.linalg.pinv(turns).T @ np.linalg.pinv(turns)
    bad = replace(e, jacobian=replace(e.jacobian, load_motion=grows))
    assert coupled_stiffness(models.finger, bad).min() < 0
    books = {
        name: models.finger.ledger(s.finger_state, s.load, s.finger_tension)
        for name, s in (("unloaded", states.unloaded), ("loaded", bad))
    }
    said = summary(case, models, replace(states, loaded=bad), {}, books, 0.0)
    assert said["audit"]["unstable_modes_bones_free"] == 1
    assert said["audit_missed"] == ["unstable_modes_bones_free"]
