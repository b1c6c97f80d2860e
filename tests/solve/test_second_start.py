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
from cosim.results.static import summary
from cosim.solve.session import Session
from cosim.solve.solvers import solve
from tests.helpers.shells import COARSE_NET

AGAIN = "solve.second_start=true"
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


def test_a_net_with_two_equilibria_is_told():
    """Both to a residual below 1e-6, some 0.1 N apart: the tip's force depends on whether the net
    was first pulled by the resting tension."""
    found = run_case(load_case("cable_edc", [COARSE_NET, AGAIN])).summary
    assert found["audit"]["interface_residual"] < 1e-6
    assert found["audit"]["second_start_force_N"] > 0.05
    assert "second_start_force_N" in found["audit_missed"]
    first, other = (
        np.array(list(block["fingertip_force_N"].values()))
        for block in (found, found["second_start"])
    )
    assert np.linalg.norm(first - other) == pytest.approx(found["audit"]["second_start_force_N"])


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
