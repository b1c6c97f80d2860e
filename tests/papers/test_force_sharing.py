"""Forces from torques, the flexion that asks for them, and the finger on its tip."""

from __future__ import annotations

import numpy as np
import pytest

from cases.papers.models.buchner1988.flexion import (
    DURATION,
    FULL,
    cosine,
    curve_motion,
    quintic,
    torques,
)
from cases.papers.models.buchner1988.force_sharing import linear, quadratic
from cases.papers.models.networks.human_network import MUSCLES, human_finger
from cases.papers.models.networks.point_contact import (
    best_share,
    distal_torque,
    settle,
    tip_jacobian,
)
from cosim.errors import ConvergenceError
from rigid.chain.hinge import HingeFinger
from rigid.chain.planar_chain import BUCHNER
from rigid.hoods.network import Arms, Network
from rigid.hoods.two_band import coupled_dip, two_band
from tests.proofs.hoods import contact_rows, sharing_rows

EQUAL = np.ones(5)
HALF = np.zeros((2, 5))
HALF[:, 0] = 0.5


def test_every_row_on_the_programmes_passes(monkeypatch):
    """The rows on the closed loop are left out, whose numbers `test_coordination` has."""
    monkeypatch.setattr(sharing_rows, "_loop_rows", lambda: iter(()))
    rows = list(sharing_rows.rows())
    assert len(rows) > 15
    assert not [row for row in rows if not row.passed]


def test_every_row_on_the_contact_passes_with_most_muscles(monkeypatch):
    monkeypatch.setattr(contact_rows, "LOADS", contact_rows.LOADS[-1:])
    rows = list(contact_rows.rows())
    assert rows
    assert not [row for row in rows if not row.passed]


def test_the_torques_of_a_motion_make_it():
    """The inverse of `PlanarChain.acceleration`, which MuJoCo confirms elsewhere."""
    rng = np.random.default_rng(2)
    for _ in range(20):
        angle, rate, acceleration = rng.normal(0, [[1], [5], [50]], (3, 3))
        torque = torques(BUCHNER, angle, rate, acceleration)
        found = BUCHNER.acceleration(angle, rate, torque, np.zeros(2))
        assert found == pytest.approx(acceleration, rel=1e-9)


@pytest.mark.parametrize("course", [quintic, cosine])
def test_the_course_begins_and_ends_at_rest_and_its_rates_are_its_own(course):
    t, step = np.linspace(0.02, 0.98, 25), 1e-5
    ahead, at, behind = (curve_motion(t + d, course) for d in (step, 0.0, -step))
    for k in range(2):
        slope = (ahead[k] - behind[k]) / (2 * step)
        assert at[k + 1] == pytest.approx(slope, abs=1e-6)
    ends = curve_motion(np.array([0.0, DURATION]), course)
    assert ends[0][:, 1] == pytest.approx([0.0, FULL])
    assert ends[1] == pytest.approx(np.zeros((2, 3)), abs=1e-14)
    assert at[0][:, 2] == pytest.approx(coupled_dip(at[0][:, 1]))


def static_torques(pip: float) -> tuple[np.ndarray, np.ndarray]:
    angle = np.array([0.0, pip, float(coupled_dip(np.array(pip)))])
    return angle, torques(BUCHNER, angle, np.zeros(3), np.zeros(3))


@pytest.mark.parametrize("moved", [0.3, 15.0])
@pytest.mark.parametrize("pip", [0.0, 0.8, 1.9])
def test_shared_forces_make_the_torque_and_none_pushes(pip, moved):
    """With shares that a difference of the shifts moves, by the more of them up to a slack band."""
    angle, torque = static_torques(pip)
    network = two_band()
    offset = np.array([moved, -moved])
    for found, shift in (
        (linear(network, angle, torque, HALF, offset, EQUAL), offset),
        (quadratic(network, angle, torque, EQUAL), None),
    ):
        made = network.direct.at(angle) @ found.muscles + network.connecting.at(angle) @ found.bands
        assert made == pytest.approx(torque, abs=1e-10)
        assert found.bands.sum() == pytest.approx(found.muscles[0], abs=1e-9)
        assert (np.append(found.muscles, found.bands) >= -1e-12).all()
        if shift is not None:
            assert found.bands == pytest.approx(0.5 * found.muscles[0] + shift, abs=1e-9)


def test_each_programme_is_cheaper_by_its_own_measure():
    angle, torque = static_torques(1.5)
    one = linear(two_band(), angle, torque, HALF, np.zeros(2), EQUAL).muscles
    other = quadratic(two_band(), angle, torque, EQUAL).muscles
    assert other @ other < one @ one
    step = 0.999 * other + 0.001 * one  # also feasible, so no better
    assert step @ step > other @ other


def test_weights_steer_the_sharing():
    """A flexed, loaded MCP that FDS and FDP can both hold: the larger muscle takes more."""
    angle, torque = np.array([0.3, 0.5, 0.1]), np.array([0.2, 0.1, 0.005])
    first = quadratic(two_band(), angle, torque, EQUAL).muscles
    strong = quadratic(two_band(), angle, torque, np.array([1.0, 1.0, 5.0, 1.0, 1.0])).muscles
    assert strong[2] > first[2] + 0.1
    costly, cheap = (
        linear(two_band(), angle, torque, HALF, np.zeros(2), np.array([1.0, 1.0, 1.0, 1.0, w]))
        for w in (1.0, 20.0)
    )
    assert costly.muscles[4] == 0.0
    assert cheap.muscles[4] > 1.0


@pytest.mark.parametrize("pip", [0.0, 1.9])
def test_in_the_papers_flexion_the_linear_weights_do_not_matter(pip):
    """Which is as well: the paper's are not printed.  The quadratic ones do."""
    angle, torque = static_torques(pip)
    rng = np.random.default_rng(4)
    one = linear(two_band(), angle, torque, HALF, np.zeros(2), EQUAL).muscles
    for weight in np.exp(rng.uniform(-1.2, 1.2, (10, 5))):
        other = linear(two_band(), angle, torque, HALF, np.zeros(2), weight).muscles
        assert other == pytest.approx(one, abs=1e-9)


def test_torques_that_no_tendon_makes_are_refused():
    """ED alone, and joints that should flex."""
    whole = two_band()
    direct = Arms(whole.direct.constant[:, :1], whole.direct.slope[:, :1])
    parts = (whole.connecting, whole.stiffness, whole.connection[:, :1], whole.rest)
    alone = Network(whole.joints, ("ED",), direct, *parts)
    angle, torque = np.zeros(3), np.array([0.1, 0.1, 0.1])
    with pytest.raises(ConvergenceError, match=r"no muscle forces make .*\[100"):
        linear(alone, angle, torque, HALF[:, :1], np.zeros(2), EQUAL[:1])
    with pytest.raises(ConvergenceError, match="no muscle forces make"):
        quadratic(alone, angle, torque, EQUAL[:1])


def test_the_jacobian_of_the_tip_is_the_hinge_fingers():
    finger = HingeFinger(BUCHNER.length)
    angle = np.array([0.4, 0.8, 0.3])
    state = finger.start(dict(zip(finger.joints, angle, strict=True)))
    step = 1e-6
    for j in range(3):
        moves = [
            finger.tip(finger.displace(state, s * step * np.eye(len(finger.unknowns(state)))[j]))
            for s in (1, -1)
        ]
        slope = (moves[0] - moves[1])[[0, 2]] / (2 * step)
        assert tip_jacobian(BUCHNER.length, angle)[:2, j] == pytest.approx(slope, abs=1e-9)


def test_a_settled_finger_keeps_its_tip_and_leaves_the_distal_phalanx_alone():
    network, start = human_finger(), np.array([0.4, 0.8, 0.3])
    force = np.where(np.array(MUSCLES) == "EDC", 10.0, 0.0)
    angle = settle(BUCHNER.length, network, force, start, 50.0)
    tips = [
        (BUCHNER.length * np.stack([np.cos(f), np.sin(f)])).sum(axis=1)
        for f in (np.cumsum(start), np.cumsum(angle))
    ]
    assert tips[1] == pytest.approx(tips[0], abs=1e-8)
    assert np.abs(angle - start).max() > 0.02
    assert distal_torque(BUCHNER.length, angle, network.torque(angle, force)) == pytest.approx(
        0, abs=1e-9
    )
    with pytest.raises(ConvergenceError, match="did not settle within 1e-06 s"):
        settle(BUCHNER.length, network, force, start, 1e-6)


def test_the_best_share():
    assert best_share(1.0, -3.0) == 0.25
    assert best_share(1.0, 2.0) == 0.0
    assert best_share(2.0, 1.0) == 1.0
    assert best_share(0.5, 0.5) == 0.0
