"""What half a degree changes by the tangent is what it changes in solved neighbours."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.pipeline import run_case
from cosim.results.compare import numbers_of
from cosim.results.quantities import meaning_of
from tests.helpers.shells import COARSE_NET

EXACT = ("solve.hood_tolerance=1e-12", "solve.tolerance=1e-9")
SHELL = ("isometric_edc", "hood.mesh.quads=120")
STEP = 0.002
"""deg"""


def shown(summary: dict[str, Any]) -> dict[str, float]:
    hood = {"hood": summary["joint_torque_Nmm"]["hood"]}
    kinds = {k: summary[k] for k in ("fingertip_force_N", "slip_force_N") if k in summary}
    return numbers_of({**kinds, "joint_torque_Nmm": hood})


@pytest.mark.parametrize(
    ("name", "joint", "settings"),
    [
        ("pulley_edc", "DIP", ()),
        ("network_edc", "PIP", ()),
        pytest.param("cable_edc", "PIP", (COARSE_NET,), marks=pytest.mark.slow),
        ("isometric_edc", "PIP", SHELL[1:]),
    ],
)
def test_it_is_the_difference_of_solved_neighbours(name, joint, settings):
    case = load_case(name, [*settings, *EXACT])
    at = np.rad2deg(case.native_finger().posture.angles()[joint])
    low, high = (
        shown(run_case(case.replace({f"finger.posture.{joint}": f"{at + d} deg"})).summary)
        for d in (-STEP, STEP)
    )
    summary = run_case(case).summary
    found = numbers_of(summary["half_degree"][joint])
    assert found.keys() == low.keys()
    for path, value in found.items():
        assert value == pytest.approx((high[path] - low[path]) / (4 * STEP), rel=1e-3, abs=2e-6), (
            path
        )
        assert meaning_of(f"half_degree.{joint}.{path}", summary), path


@pytest.mark.parametrize(("end", "inside"), [(70.0, 69.9), (0.0, 0.1)])
def test_at_an_end_of_a_joints_range_it_is_that_of_one_side(end, inside):
    """Beside the end it is looked at to either side, as far."""
    found = [
        run_case(load_case("pulley_edc", [f"finger.posture.DIP={a} deg"])).summary["half_degree"]
        for a in (end, inside)
    ]
    force, near = (np.array([*by["DIP"]["fingertip_force_N"].values()]) for by in found)
    assert force == pytest.approx(near, rel=0.05, abs=1e-6)


def test_of_held_bones_the_torques_change_by_a_symmetric_matrix():
    """They are the gradient of the hood's potential by the joint angles."""
    case = load_case(SHELL[0], [*SHELL[1:], *EXACT, "finger.tip.kind='posture'"])
    summary = run_case(case).summary
    joints = list(summary["posture_deg"])
    by = summary["half_degree"]
    change = np.array([[by[j]["joint_torque_Nmm"]["hood"][i] for j in joints] for i in joints])
    assert np.abs(change).max() > 0.01
    np.testing.assert_allclose(change, change.T, atol=1e-6 * np.abs(change).max())
    assert {by[j]["fingertip_force_N"]["dorsal"] for j in joints} == {0.0}


@pytest.mark.parametrize("setting", ["finger.tip.kind='free'", "coupling.scheme='one_way'"])
def test_what_has_no_posture_of_its_own_has_none(setting):
    assert "half_degree" not in run_case(load_case("pulley_edc", [setting])).summary
