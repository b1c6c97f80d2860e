"""The two bands of Buchner's finger against the paper's own formulas and results."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.errors import InputError
from rigid.hoods.two_band import (
    ELASTICITY,
    JOINTS,
    TABLE_1,
    Entry,
    band_forces,
    band_stiffnesses,
    coupled_dip,
    lateral_band,
    middle_band,
    shift_difference,
    two_band,
)

PARABOLA = TABLE_1["ED", "PIP"].slope / TABLE_1["ED", "DIP"].radius


def postures(count: int) -> np.ndarray:
    """(count, 3) rad, on both sides of the coupling curve, some near it."""
    rng = np.random.default_rng(5)
    at = rng.uniform([-0.5, 0.0, 0.0], [1.6, 1.9, 1.3], (count, 3))
    near = at[: count // 2]
    near[:, 2] = coupled_dip(near[:, 1]) + rng.normal(0, 0.5, len(near))
    return at


@pytest.mark.parametrize("share", [0.5, 0.28, 0.9])
def test_the_network_of_two_springs_is_equation_16_within_its_bounds(share):
    network, at = two_band(ELASTICITY, share), postures(1000)
    force = np.random.default_rng(6).uniform(0.1, 30, (1000, 5))
    _, tension = network.solve(at, force)
    apart = shift_difference(at[:, 1], at[:, 2])
    middle, lateral = band_forces(force[:, 0], apart, ELASTICITY, share)
    assert tension == pytest.approx(np.stack([middle, lateral], axis=1), abs=1e-12)
    slack = (tension == 0).sum(axis=0)
    assert (slack > 5).all() or share != 0.5, "either band is slack in some"
    assert ((middle > 0) & (lateral > 0)).mean() > 0.3


def test_the_difference_of_the_shifts_is_that_of_the_lengths():
    network, at = two_band(), postures(50)
    length = network.lengths(at)
    assert length[:, 1] - length[:, 0] == pytest.approx(shift_difference(at[:, 1], at[:, 2]))
    assert shift_difference(at[:, 1], coupled_dip(at[:, 1])) == pytest.approx(0, abs=1e-17)


def test_without_tension_the_tendon_shifts_by_the_larger_shift():
    """Equations 3a and 5."""
    network, at = two_band(), postures(200)
    e1 = network.excursion(at, np.zeros((200, 5)))[:, 0]
    middle = -5e-3 * at[:, 1]
    lateral = -(5e-3 - 1.21e-3 * at[:, 1]) * at[:, 1] - 3.5e-3 * at[:, 2]
    assert e1 == pytest.approx(-10e-3 * at[:, 0] + np.minimum(middle, lateral), abs=1e-17)


def test_in_flexion_of_the_ip_joints_ed_and_the_interossei_run_alike():
    """Figure 13: identical excursions along the coupling curve."""
    pip = np.linspace(0, np.radians(110), 20)
    at = np.stack([0 * pip, pip, coupled_dip(pip)], axis=1)
    run = two_band().excursion(at, np.zeros((20, 5)))
    assert run[:, 0] == pytest.approx(run[:, 3], abs=1e-16)
    assert np.degrees(at[-1, 2]) == pytest.approx(73.0, abs=0.05)


def test_the_coupling_curve_is_a_parabola():
    """Equation 6; that both networks switch on it is a row of each in `cosim verify hoods`."""
    pip = np.linspace(0.05, 1.9, 12)
    assert coupled_dip(pip) == pytest.approx(PARABOLA * pip**2, rel=1e-12)


def test_off_the_switch_the_arm_is_that_of_one_band():
    network, force = two_band(), np.full(5, 0.5)
    lateral = network.effective_arms(np.array([0.0, 0.3, 1.2]), force)[:, 0]
    middle = network.effective_arms(np.array([0.0, 1.8, 0.0]), force)[:, 0]
    assert lateral == pytest.approx([-10e-3, -5e-3 + 2.42e-3 * 0.3, -3.5e-3], rel=1e-14)
    assert middle == pytest.approx([-10e-3, -5e-3, 0], rel=1e-14)


def test_arms_are_the_derivatives_of_the_papers_excursions():
    """Equations 3 with the entries of table 1, by differences."""
    at, step = np.array([0.4, 0.9, 0.5]), 1e-6

    def lengths(q):
        f = [(11.2 + 2.08 * q[0]), (9.6 + 2.23 * q[1]), (4.55 + 0.26 * q[2])]
        lum = 11.5 * q[0] - f[0] * q[0]
        lum -= (4.34 - 0.45 * q[1] + f[1]) * q[1] + (3.5 + f[2]) * q[2]
        fds = (10 + 2.05 * q[0]) * q[0] + 7 * q[1]
        return 1e-3 * np.array([-10 * q[0], f @ q, fds, 5 * q[0] - 5 * q[1], lum])

    for j in range(3):
        dq = step * np.eye(3)[j]
        slope = (lengths(at + dq) - lengths(at - dq)) / (2 * step)
        assert two_band().direct.at(at)[j] == pytest.approx(slope, abs=1e-11)
    assert two_band().direct.lengths(at) == pytest.approx(lengths(at), rel=1e-13)


def test_another_table_gives_other_arms():
    table = dict(TABLE_1) | {("ED", "PIP"): Entry(4e-3, 1e-3)}
    assert middle_band(table)["PIP"] == (-4e-3, 0.0)
    assert lateral_band(table)["PIP"] == (-4e-3, 2e-3)
    assert coupled_dip(np.array(1.0), table) == pytest.approx(1 / 3.5)
    assert two_band(table=table).connecting.constant[JOINTS.index("PIP")].tolist() == [-4e-3] * 2


@pytest.mark.parametrize(("elasticity", "share"), [(500.0, 0.0), (500.0, 1.0), (0.0, 0.5)])
def test_bands_that_are_no_springs_are_refused(elasticity, share):
    with pytest.raises(InputError, match="share between 0 and 1"):
        band_stiffnesses(elasticity, share)
