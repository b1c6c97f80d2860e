"""A hood reduced to one potential: against a network that it must recover, and behind the port."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import eval_legendre

from cosim.analyses.reduction.reduce import tip_maps
from cosim.case.file import load_case
from cosim.errors import ConvergenceError, InputError
from cosim.fingers.common import Extensor
from cosim.fingers.index import IndexFingerConfig
from cosim.fingers.kinds import finger_model
from cosim.hoods.lumped.build import build_reduced_hood
from cosim.models.build import build
from cosim.port import STATIC, Motion
from meshes.skeleton import BODIES, index_finger
from rigid.hoods.joint_angles import JointChain, flexion_joints, joints_of
from rigid.hoods.reduced import AT_ONCE, ReducedPotential
from rigid.hoods.reduced_basis import legendre, loadings, monomials, to_powers
from rigid.hoods.reduction import (
    ENOUGH,
    LEAST_FORCE,
    TIP,
    Order,
    angle_powers,
    least_squares,
    reduce_hood,
    richest_order,
    stack,
    tension_terms,
    tip_rows,
)
from tests.helpers import conformance
from tests.helpers.soft_network import (
    JOINTS,
    MUSCLES,
    STRAIGHT,
    reduced_potential,
    samples,
    training_sample,
    unseen_sample,
)


def test_a_network_is_recovered_to_round_off():
    """Torques, excursions, all second derivatives and both slips in postures and under loads that
    were not fitted."""
    held, fit = unseen_sample(), reduced_potential()
    made = fit.derivatives(held.angle, held.tension)
    for name, value in made._asdict().items():
        told = getattr(held, name)
        assert np.abs(value - told).max() < 1e-9 * np.abs(told).max(), name
    slips = fit.slips(held.angle, made.torque)
    assert slips == pytest.approx(held.slip, rel=1e-8)
    assert fit.torques(held.angle, held.tension) == pytest.approx(made.torque, rel=1e-12)


def test_a_network_is_recovered_by_a_fit_with_springs_that_it_has_not():
    """Their toe is nearly told by the other terms: what holds it must not be seen."""
    held = unseen_sample()
    made = reduce_hood(training_sample(), JOINTS, MUSCLES, Order(angle=4))
    for name, value in made.derivatives(held.angle, held.tension)._asdict().items():
        told = getattr(held, name)
        assert np.abs(value - told).max() < 1e-8 * np.abs(told).max(), name


def test_torques_of_many_states_are_those_of_each():
    held, fit = unseen_sample(), reduced_potential()
    each = fit.derivatives(held.angle, held.tension).torque
    rounds = -(-2 * AT_ONCE // len(each))
    many = np.stack([held.angle] * rounds)
    assert many[..., 0].size > AT_ONCE
    assert fit.torques(many, held.tension) == pytest.approx(np.stack([each] * rounds), rel=1e-12)
    assert fit.torques(held.angle[0], held.tension[0]) == pytest.approx(each[0], rel=1e-12)
    assert fit.torques(held.angle[:0], held.tension[:0]).shape == (0, len(JOINTS))


def test_a_fit_is_as_rich_as_its_numbers_bear():
    moves = np.array([True, False, True, True])
    terms = len(tension_terms(4, Order()))
    degrees = [
        richest_order(numbers, moves, 4).angle for numbers in (0, 2_000, 30_000, 60_000, 10**6)
    ]
    assert degrees == sorted(degrees)
    assert degrees[0] == 1
    assert degrees[-1] == Order().angle
    for numbers, degree in zip((30_000, 60_000), degrees[2:4], strict=True):
        columns = [len(angle_powers(moves, Order(angle=degree + k))) * terms for k in (0, 1)]
        assert columns[0] * ENOUGH <= numbers < columns[1] * ENOUGH


def test_second_derivatives_are_those_of_the_first():
    """Of every basis function against central differences."""
    rng, step = np.random.default_rng(1), 1e-5
    powers = rng.integers(0, 5, (30, 4))
    terms = rng.integers(0, 4, (30, 4))

    def toed(at):
        return loadings(terms, at, 0.05)

    def polynomials(at):
        return legendre(powers, at)

    for basis in (lambda at: monomials(powers, at), toed, polynomials):
        at = rng.uniform(0.1, 0.9, 4)
        here = basis(at)
        for j, e in enumerate(step * np.eye(4)):
            up, down = basis(at + e), basis(at - e)
            slope = (up.value - down.value) / (2 * step)
            curve = (up.slope - down.slope) / (2 * step)
            assert here.slope[:, j] == pytest.approx(slope, rel=1e-6, abs=1e-8)
            assert here.curve[:, :, j] == pytest.approx(curve, rel=1e-6, abs=1e-8)


def test_polynomials_are_legendres_and_sums_of_powers():
    rng = np.random.default_rng(4)
    degrees = np.array([(i, k) for i in range(6) for k in range(6 - i)])
    at = rng.uniform(-1, 1, (7, 2))
    made = legendre(degrees, at).value
    one, other = (eval_legendre(degrees[:, j], at[:, [j]]) for j in range(2))
    assert made == pytest.approx(one * other, abs=1e-14)
    assert monomials(degrees, at).value @ to_powers(degrees).T == pytest.approx(made, abs=1e-13)


def test_normal_equations_are_as_good_as_an_orthogonal_factorisation():
    """Rows in parts, with columns of unlike lengths that depend on each other to 1e-4, and one
    that no row tells."""
    rng = np.random.default_rng(5)
    rows = rng.normal(size=(60, 8)) * 10.0 ** np.arange(-4, 4)
    rows[:, 1] = 1e-3 * rows[:, 0] * (1 + 1e-4 * rng.normal(size=60))
    rows[:, 3] = 0.0
    wanted = rng.normal(size=60)
    made = least_squares(lambda: zip(np.split(rows, 4), np.split(wanted, 4), strict=True))
    length = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    best = np.linalg.lstsq(rows / length, wanted, rcond=None)[0] / length
    assert rows @ made == pytest.approx(rows @ best, abs=1e-9)
    assert made[3] == 0.0


def test_tip_forces_count_over_their_own_size():
    data = training_sample()
    maps = np.tile(np.eye(3, 4), (len(data.angle), 1, 1))
    weak = replace(data, torque=data.torque * np.r_[1e-6, np.ones(len(data.angle) - 1)][:, None])
    size = np.linalg.norm(np.einsum("sij,sj->si", tip_rows(weak, maps), weak.torque), axis=1)
    assert size[1:] == pytest.approx(TIP, rel=1e-12)
    assert 0 < size[0] < 1e-5 * TIP / LEAST_FORCE
    assert tip_rows(data, None).shape == (len(data.angle), 0, 4)


def test_a_fit_to_tip_forces_is_better_there():
    """Too few terms for the network."""
    fit, coarse = training_sample(), Order(angle=2, toe=None)
    maps = tip_maps(load_case("network_edc"), fit.angle)

    def miss(made):
        rows = tip_rows(fit, maps)
        off = made.torques(fit.angle, fit.tension) - fit.torque
        return np.sqrt((np.einsum("sij,sj->si", rows, off) ** 2).sum(axis=1).mean())

    plain, aimed = (miss(reduce_hood(fit, JOINTS, MUSCLES, coarse, m)) for m in (None, maps))
    assert aimed < 0.999 * plain


def any_potential() -> ReducedPotential:
    """Four joints and two muscles with all kinds of terms, abduction too."""
    rng = np.random.default_rng(2)
    powers = np.array(
        [(a, b, c, d) for a in (0, 1) for b in (0, 1, 2) for c in (0, 2) for d in (0, 1)]
    )
    terms = np.array([(0, 0), (1, 0), (0, 1), (2, 0), (0, 3), (1, 1)])
    low, high = np.array([-0.5, -0.3, -0.3, -0.3]), np.array([1.0, 0.3, 1.2, 0.6])
    energy = rng.normal(0, 2e-3, (len(powers), len(terms)))
    slip_powers, slip = powers[:1], np.zeros((2, 1, 5))
    slip[1, 0] = 0, 0, 0, 0, -300.0
    joints = ("MCP", "MCP_abduction", "PIP", "DIP")
    parts = (low, high, np.array([4.0, 3.0]), powers, terms, 0.05, energy, slip_powers, slip)
    return ReducedPotential(joints, ("EDC", "LUM"), *parts)


def test_one_state_is_as_in_a_batch():
    """Where the two ways to the derivatives could part: abduction, all springs, every order."""
    made, random = any_potential(), np.random.default_rng(3)
    angle, tension = random.uniform(made.low, made.high, (6, 4)), random.uniform(0, 3, (6, 2))
    batch = made.derivatives(angle, tension)
    for k in range(6):
        for one, many in zip(made.derivatives_at(angle[k], tension[k]), batch, strict=True):
            assert one == pytest.approx(many[k], rel=1e-12, abs=1e-16)


@pytest.mark.parametrize("seed", range(3))
def test_rates_of_all_angles_against_differences(seed):
    """Bodies turned and moved as no hinges allow, abduction's two hinges among them."""
    finger = load_case("network_edc").finger
    assert isinstance(finger, IndexFingerConfig)
    model = finger_model(finger, Extensor())
    chain, step = JointChain(joints_of(model), BODIES), 1e-6
    bent = Motion(BODIES, *index_finger().pose({"MCP": 0.5, "PIP": 1.4, "DIP": 0.6}))
    twist = np.random.default_rng(seed).uniform(-0.3, 0.3, 24)
    motion = bent.displace(twist)
    found = chain.angles(motion)
    flexion = JointChain(flexion_joints(model)[1:], BODIES).angles(motion)
    assert found.value[2:] == pytest.approx(flexion.value, abs=1e-13)
    assert found.rate[2:] == pytest.approx(flexion.rate, abs=1e-13)
    for k in range(24):
        ahead, behind = (
            chain.angles(motion.displace(sign * step * np.eye(24)[k])) for sign in (1, -1)
        )
        rate = (ahead.value - behind.value) / 2 / step
        assert found.rate[:, k] == pytest.approx(rate, abs=1e-8)
        slope = (ahead.rate - behind.rate) / 2 / step
        assert found.moment_rate[:, :, k] == pytest.approx(slope, abs=1e-8)


POSTURES = (
    {},
    {"MCP": 0.25, "MCP_abduction": 0.05, "PIP": 0.4, "DIP": 0.1},
    {"MCP": 0.5, "MCP_abduction": -0.1, "PIP": 0.8, "DIP": 0.3},
)


def test_the_hood_keeps_the_ports_promises():
    finger = load_case("network_edc").finger
    assert isinstance(finger, IndexFingerConfig)
    hood = build_reduced_hood(any_potential(), finger_model(finger, Extensor()), BODIES)
    motions = [Motion(BODIES, *index_finger().pose(posture)) for posture in POSTURES]
    tension = np.array([2.0, 1.5])
    conformance.check_shapes(hood, motions, tension)
    conformance.check_errors(hood, motions[0], tension)
    conformance.check_repeatable(hood, motions, tension)
    conformance.check_objective(hood, motions, tension, 1e-9)
    conformance.check_balance(hood, motions, tension)
    conformance.check_reciprocity(hood, motions, tension, 1e-6)
    conformance.check_jacobian(hood, motions, tension, 1e-6)


def test_every_joint_is_felt_with_its_own_torque():
    """Behind the port the joint torques, abduction's too, are the potential's derivatives."""
    case = load_case("network_edc")
    assert isinstance(case.finger, IndexFingerConfig)
    made, models = any_potential(), build(case)
    hood = build_reduced_hood(made, finger_model(case.finger, Extensor()), BODIES)
    angle, tension = np.array([0.4, 0.12, 0.7, 0.3]), np.array([2.0, 1.5])
    at = models.finger.start(dict(zip(models.finger.joints, angle, strict=True)))
    answer = hood.advance(
        hood.start(models.finger.motion(at)), models.finger.motion(at), tension, 1.0
    )
    torque = models.finger.jacobian(at).T @ answer.load.total().ravel()
    assert torque == pytest.approx(made.derivatives(angle, tension).torque, rel=1e-9)
    assert answer.excursion == pytest.approx(made.derivatives(angle, tension).excursion, rel=1e-9)
    slips = made.slip_forces(angle, answer.state.derived.torque)
    assert slips["terminal"] == pytest.approx(max(0.0, -300 * torque[3]))


def test_outside_of_the_box_there_is_no_answer():
    made = any_potential()
    assert made.outside(made.high, made.most) == ""
    assert "PIP at 90 deg" in made.outside(np.array([0, 0, np.pi / 2, 0]), made.most)
    assert "LUM at 5 N" in made.outside(made.high, np.array([1.0, 5.0]))
    finger = load_case("network_edc").finger
    assert isinstance(finger, IndexFingerConfig)
    hood = build_reduced_hood(made, finger_model(finger, Extensor()), BODIES)
    bent = Motion(BODIES, *index_finger().pose({"PIP": 1.5}))
    with pytest.raises(ConvergenceError, match=r"PIP at 85\.94 deg"):
        hood.advance(hood.start(bent), bent, np.ones(2), STATIC)
    with pytest.raises(InputError, match="range of its angles or tensions is empty"):
        replace(made, high=made.low)
    with pytest.raises(InputError, match=r"energy \(A, G\)"):
        replace(made, energy=made.energy[1:])


def test_too_few_samples_are_refused():
    with pytest.raises(InputError, match="too few"):
        reduce_hood(stack(samples()[:3]), JOINTS, MUSCLES)


def test_rows_in_parts_are_the_rows_at_once(monkeypatch):
    monkeypatch.setattr("rigid.hoods.reduction.AT_ONCE", 37)
    parted, held = reduce_hood(training_sample(), JOINTS, MUSCLES, STRAIGHT), unseen_sample()
    torque = parted.torques(held.angle, held.tension)
    assert torque == pytest.approx(held.torque, rel=1e-8, abs=1e-10)
