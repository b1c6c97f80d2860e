"""The studies of paper 000: where arms switch, shares of tension, excursions, pictures."""

from __future__ import annotations

import numpy as np
import pytest

from cases.papers.models.networks.arm_switch import predict, switch
from cases.papers.models.networks.excursion_fit import (
    EXTENSOR,
    curve_distance,
    curve_distance_slopes,
    dip_of_pip,
    identify,
)
from cases.papers.models.networks.excursion_fit_check import draw_samples, true_parameters
from cases.papers.models.networks.human_network import human_finger
from cases.papers.models.networks.point_contact import distal_torque, tip_jacobian
from cases.papers.models.networks.robotic_finger import LENGTH, robotic_finger
from cases.papers.models.networks.share_models import (
    ShareFinger,
    best_share,
    forward,
    inverse,
    with_shares,
)
from cases.papers.models.networks.testbed_runs import FRICTION
from cosim.report.gallery import open_paper
from rigid.hoods.network import Arms

SCRIPT = open_paper("networks")
COARSE = ('forward.step="10 ms"', "output.picture=false")
POSTURE = np.array([0.2, 0.6, 0.13])


def known_finger() -> ShareFinger:
    """The robotic finger as a model of shares knows it, exactly."""
    made = robotic_finger()
    arms = made.direct.constant, made.direct.slope
    direct = [a.copy() for a in arms]
    for own, more in zip(direct, (made.connecting.constant, made.connecting.slope), strict=True):
        own[:, :2] += more[:, :2]
    ways = [Arms(made.connecting.constant[:, [k]], made.connecting.slope[:, [k]]) for k in (2, 3)]
    return ShareFinger(LENGTH, Arms(*direct), *ways, np.array([0.0, 0.0, 1.0, 1.0]))


@pytest.mark.parametrize("muscle", range(3))
@pytest.mark.parametrize("dip", [10.0, 45.0, 70.0])
def test_the_switch_is_where_the_tendons_take_over(muscle, dip):
    network, at = human_finger(), np.radians(dip)
    for force in (0.1, 10.0):
        found = switch(network, muscle, at, force)
        assert found == pytest.approx(predict(network, muscle, at, force), abs=1e-12)
        for pip, tendons in ((found.begin - 1e-6, 0.0), (found.end + 1e-6, 1.0)):
            share = network.distribution(np.array([0.0, pip, at]), np.full(6, force))
            slip = share[[1, 3, 5][[2, 0, 1].index(muscle)], muscle]
            assert slip == pytest.approx(tendons, abs=1e-12)


def test_the_switch_narrows_with_the_force_and_with_stiffness():
    network = human_finger()
    widths = [switch(network, 0, 0.785, f).width / f for f in (1e-4, 1e-2, 1.0)]
    assert widths == pytest.approx([widths[0]] * 3, rel=1e-3)
    assert switch(network, 1, 0.785, 10.0).width > 1.5 * switch(network, 0, 0.785, 10.0).width


@pytest.fixture(scope="module")
def planar():
    return SCRIPT.names["contact"]("network_contact_planar", COARSE)


def test_the_planar_case_settles_where_the_finger_without_orchestrator_does(planar):
    table = SCRIPT.names["end_states"](planar, planar=True)
    assert (table.largest_angle_apart_rad < 1e-7).all()
    assert (table.optimum_less_settled_share.abs() < 1e-6).all()
    assert (table.DIP_off_curve_deg.abs() < 1.0).all()


def test_flexors_shift_what_the_extensors_make_at_the_tip(planar):
    ends = [planar.at(t) for t in SCRIPT.names["SETTLED"]]
    for muscle in ("EDC", "LUM", "FPI"):
        assert planar.force[muscle][ends] == pytest.approx(planar.force[muscle][-1])
    alone = planar.extensors[ends]
    assert alone[0, :3] == pytest.approx(planar.tip_force[ends[0]], abs=1e-6)
    assert np.linalg.norm(alone[1] - alone[0]) > 0.3
    assert np.linalg.norm(alone[2] - alone[1]) > 0.8
    assert np.diff(planar.share[ends]).min() > 0.05
    assert alone[1:, 3].min() > 0.01, "a torque that the flexors hold"
    assert abs(alone[0, 3]) < 1e-6


@pytest.mark.slow
def test_the_index_case_settles_at_its_optimum_too():
    run = SCRIPT.names["contact"]("network_contact", COARSE)
    ends = [run.at(t) for t in SCRIPT.names["SETTLED"]]
    assert run.optimum[ends] == pytest.approx(run.share[ends], abs=1e-6)
    off = run.angle[ends, 2] - 1.21 / 3.5 * run.angle[ends, 1] ** 2
    assert np.abs(off).max() < np.radians(1.0)


def test_transfer_is_the_jacobian_of_the_point_contact():
    finger, force = known_finger(), np.array([1.0, 2.0, 5.0, 4.0])
    share = np.array([0.0, 0.0, 0.3, 0.8])
    made = with_shares(finger, POSTURE, force, share)
    way = finger.slip.at(POSTURE) * share + finger.lateral.at(POSTURE) * (1 - share)
    torque = (finger.direct.at(POSTURE) + way * finger.parts) @ force
    assert made.torque == pytest.approx(distal_torque(LENGTH, POSTURE, torque), rel=1e-12)
    back = tip_jacobian(LENGTH, POSTURE).T @ np.append(made.force, made.torque)
    assert back == pytest.approx(torque, rel=1e-12)


def test_the_forward_share_leaves_the_least_torque():
    finger, rng = known_finger(), np.random.default_rng(3)
    force = rng.uniform(0.2, 6.0, (50, 4))
    best = forward(finger, POSTURE, force)
    for share in np.linspace(0, 1, 21):
        other = with_shares(finger, POSTURE, force, np.full(4, share))
        assert (np.abs(best.torque) <= np.abs(other.torque) + 1e-12).all()
    inside = (best.share[:, 2] > 0) & (best.share[:, 2] < 1)
    assert inside.sum() > 20
    assert np.abs(best.torque[inside]).max() < 1e-12


def test_one_share_is_found_again():
    finger = known_finger()
    force = np.array([[0.2, 0.2, 5.0, 0.2], [0.2, 0.2, 4.0, 0.2]])
    seen = with_shares(finger, POSTURE, force, np.array([0, 0, 0.37, 0.37])).force
    at = np.broadcast_to(POSTURE, (2, 3))
    assert best_share(finger, at, force, seen) == pytest.approx(0.37)


def test_inverse_forces_make_the_force_asked_for():
    finger, turn = known_finger(), np.linspace(0, 2 * np.pi, 9)
    wanted = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    at, none = np.broadcast_to(POSTURE, (9, 3)), np.zeros((9, 4))
    found = inverse(finger, at, wanted, none, least=0.3)
    made = with_shares(finger, at, found.muscles, found.share)
    assert made.force == pytest.approx(wanted, abs=1e-4)
    assert np.abs(made.torque).max() < 1e-6
    assert found.muscles.min() >= 0.3
    assert 0.0 <= found.share.min() <= found.share.max() <= 1.0
    fixed = inverse(finger, at, wanted, none, share=np.full(4, 0.5))
    freed = inverse(finger, at, wanted, none)
    cost = [(f.muscles**2).sum(axis=1) for f in (freed, fixed)]
    met = fixed.miss < 1e-4
    assert 0 < met.sum() < 9, "some directions need another share"
    assert (cost[0][met] <= cost[1][met] + 1e-5).all()
    assert freed.miss.max() < 1e-4


def test_excursions_without_noise_are_fitted_exactly():
    poses, _ = draw_samples(0)
    network = robotic_finger()
    clean = network.excursion(poses.angle, np.full((len(poses.angle), 4), 1e-9))
    exact = type(poses)(poses.angle, clean, 1e-6)
    truth = true_parameters(network)
    found = identify(exact)
    assert found.value == pytest.approx([truth[n] for n in found.names], abs=1e-8)
    shared = np.array([truth[n] for n in EXTENSOR])
    pip = np.linspace(0.1, 1.7, 5)
    assert dip_of_pip(shared, pip) == pytest.approx(1.21 / 3.5 * pip**2, rel=1e-12)
    both = identify(*draw_samples(1)), identify(draw_samples(1)[0])
    assert (both[0].deviation <= both[1].deviation * (1 + 1e-9)).all()


def test_distance_from_the_curve_and_its_derivatives():
    _, curve = draw_samples(0)
    at = np.array([-5e-3, -4.6e-3, 2.1e-3, -3.3e-3, 0.4e-3])
    on = np.stack([np.zeros(9), np.linspace(0.2, 1.6, 9), np.zeros(9)], axis=1)
    on[:, 2] = dip_of_pip(at, on[:, 1])
    slip = at[0] * on[:, 1]
    lateral = at[1] * on[:, 1] + 0.5 * at[2] * on[:, 1] ** 2 + at[3] * on[:, 2] + at[4]
    assert lateral == pytest.approx(slip, abs=1e-15)
    step = 1e-8
    moved = [
        curve_distance(at + d, curve) - curve_distance(at - d, curve) for d in step * np.eye(5)
    ]
    slopes = np.array(moved).T / (2 * step)
    assert curve_distance_slopes(at, curve) == pytest.approx(slopes, rel=1e-5, abs=1e-2)


@pytest.mark.slow
def test_every_picture_draws_and_holds_its_numbers():
    few = {"DRAWS": 3, "SEEDS": 2, "FEWER": 2, "OTHER_FRICTIONS": (FRICTION,)}
    script = open_paper("networks", few)
    figures = [f for name in ("arms", "identification", "runs", "errors") for f in script.run(name)]
    for figure in figures:
        figure.picture.canvas.draw()
        assert figure.tables
        for table in figure.tables.values():
            assert len(table)
            assert not table.isna().any().any()
    names = [figure.name for figure in figures]
    assert len(set(names)) == len(names)
    virtual = [
        f for f in figures if f.name.startswith(("figure_7", "figure_8", "figure_9", "test"))
    ]
    assert len(virtual) == 6
    for figure in virtual:
        assert "VIRTUAL TESTBED" in figure.caption
    assert "VIRTUAL TESTBED, no measurement" in script.page("networks").notes[0]
