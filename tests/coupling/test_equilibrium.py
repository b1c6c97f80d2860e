"""The coupled equilibrium of a hinge finger and cables, against closed forms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import brentq, minimize

from cosim.coupling.equilibrium import (
    WHOLE_ROUNDS,
    CouplingOptions,
    Equilibrium,
    equilibrium,
    moment_arms,
    reciprocity,
)
from cosim.coupling.finger_equilibrium import affine, balance_finger
from cosim.errors import ConvergenceError, InputError
from cosim.port import (
    STATIC,
    Array,
    Hood,
    HoodJacobian,
    Motion,
    Pair,
    PairState,
    Response,
    State,
    Tensions,
)
from rigid.chain import hinge
from rigid.chain.hinge import HingeFinger
from rigid.chain.joint_torques import joint_law
from rigid.chain.support import FREE, IN_PLANE
from rigid.hoods.pulley import Cable, PulleyHood
from tests.helpers.fingers import LENGTHS, cables_over_all_joints

H, A = 0.006, 0.008  # m, eyelets above and beside each joint
STIFFNESS = np.array([0.20, 0.12, 0.08])  # N m/rad
REST = np.array([0.7, 0.9, 0.4])  # rad
TENSION = np.array([6.0])
PULL, WIDTH = 4.2, 0.01  # N; rad
OPTIONS = CouplingOptions(tolerance=1e-10, max_iterations=40)


def finger(held: bool) -> HingeFinger:
    law = joint_law(
        hinge.JOINTS,
        dict(zip(hinge.JOINTS, STIFFNESS, strict=True)),
        dict(zip(hinge.JOINTS, REST, strict=True)),
    )
    return HingeFinger(LENGTHS, law=law, support=IN_PLANE if held else FREE)


def dorsal_and_palmar() -> PulleyHood:
    """The dorsal cable and a palmar one that ends on the middle phalanx."""
    palmar = [("metacarpal", (-A, 0.0, -0.010)), ("proximal", (0.005, 0.0, -0.008))]
    palmar += [("proximal", (0.036, 0.0, -0.007)), ("middle", (0.009, 0.0, -0.006))]
    points = cables_over_all_joints(H, A)._cables["EDC"].points
    straight = finger(False)
    rest = straight.motion(straight.start({}))
    return PulleyHood({"EDC": Cable(points), "FDS": Cable(tuple(palmar))}, rest)


def couple(
    f: HingeFinger,
    hood: Hood,
    tension: Array,
    start: Sequence[float] = tuple(REST),
    options: CouplingOptions = OPTIONS,
) -> Equilibrium:
    state = f.start(dict(zip(hinge.JOINTS, start, strict=True)))
    there = PairState(state, hood.start(f.motion(state)))
    return equilibrium(Pair(f, hood), there, Tensions(tension, np.zeros(0)), options)


def span(q: Array) -> Array:
    """Length of the cable between the two eyelets of each joint: a chord of the circle on which
    both lie, seen from the joint's centre at 2 atan(A / H) + q."""
    return 2 * np.hypot(A, H) * np.sin(np.arctan(A / H) + q / 2)


def arm(q: Array) -> Array:
    """Derivative of `span`."""
    return np.hypot(A, H) * np.cos(np.arctan(A / H) + q / 2)


def energy(q: Array, tension: float = TENSION[0]) -> float:
    return float(STIFFNESS @ (q - REST) ** 2 / 2 + tension * span(q).sum())


def tip(q: Array) -> Array:
    flexion = np.cumsum(q)
    return np.array([LENGTHS @ np.cos(flexion), -(LENGTHS @ np.sin(flexion))])


def test_a_free_finger_settles_where_springs_and_cable_balance():
    found = couple(finger(False), cables_over_all_joints(H, A), TENSION)
    closed = [
        brentq(lambda q, i=i: STIFFNESS[i] * (q - REST[i]) + TENSION[0] * arm(q), -1.0, 1.5)
        for i in range(3)
    ]
    assert np.abs(np.array(closed) - REST).min() > 0.1, "the cable moves every joint"
    np.testing.assert_allclose(found.finger_state.angles, closed, rtol=0, atol=1e-9)
    assert np.array_equal(found.balance.tip_force, np.zeros(3))
    excursion = 3 * span(np.zeros(3))[0] - span(np.array(closed)).sum()
    np.testing.assert_allclose(found.excursion, [excursion], rtol=0, atol=1e-11)


def test_a_held_finger_is_the_least_energy_with_its_tip_in_place():
    found = couple(finger(True), cables_over_all_joints(H, A), TENSION)
    there = tip(REST)
    gap = {"type": "eq", "fun": lambda q: 1e3 * (tip(q) - there)}
    slope = lambda q: STIFFNESS * (q - REST) + TENSION[0] * arm(q)  # noqa: E731
    options = {"ftol": 1e-13}
    least = minimize(energy, REST, jac=slope, method="SLSQP", constraints=[gap], options=options)
    assert least.success
    assert np.abs(least.x - REST).max() > 0.02, "the finger moves although its tip is held"
    np.testing.assert_allclose(found.finger_state.angles, least.x, rtol=0, atol=2e-5)

    q = found.finger_state.angles
    np.testing.assert_allclose(tip(q), there, rtol=0, atol=1e-11)
    rows = np.array([tip(q + h) - tip(q - h) for h in 1e-6 * np.eye(3)]) / 2e-6
    reaction, *_ = np.linalg.lstsq(rows, slope(q), rcond=None)  # of the world on the tip
    np.testing.assert_allclose(found.balance.tip_force[[0, 2]], -reaction, rtol=1e-7)


@pytest.mark.parametrize("held", [True, False])
def test_residuals_are_below_the_tolerance_and_the_answer_is_the_final_poses(held):
    f, hood = finger(held), dorsal_and_palmar()
    tension = np.array([6.0, 4.0])
    found = couple(f, hood, tension)
    assert found.finger_residual <= OPTIONS.tolerance
    assert found.interface_residual <= OPTIONS.tolerance
    assert max(found.load.imbalance(found.motion)) < 1e-12
    motion = f.motion(found.finger_state)
    again = hood.advance(hood.start(motion), motion, tension, STATIC)
    np.testing.assert_allclose(again.load.wrench, found.load.wrench, rtol=0, atol=1e-14)
    assert f.balance(found.finger_state, again.load, np.zeros(0)).relative <= OPTIONS.tolerance


def test_a_far_start_ends_in_the_same_equilibrium():
    f, hood = finger(False), dorsal_and_palmar()
    near, far = (couple(f, hood, np.array([6.0, 4.0]), q) for q in (REST, (0.1, 1.7, 1.2)))
    np.testing.assert_allclose(far.finger_state.angles, near.finger_state.angles, atol=1e-10)
    assert far.iterations > near.iterations, "a joint moves only so far in one round"


def test_the_same_run_gives_the_same_bits():
    first, second = (couple(finger(True), dorsal_and_palmar(), np.array([6.0, 4.0])) for _ in "ab")
    assert np.array_equal(first.finger_state.angles, second.finger_state.angles)
    assert np.array_equal(first.finger_state.reaction, second.finger_state.reaction)
    assert np.array_equal(first.load.wrench, second.load.wrench)
    assert np.array_equal(first.excursion, second.excursion)


def test_the_affine_load_is_the_hoods_to_second_order():
    f, hood = finger(False), dorsal_and_palmar()
    found = couple(f, hood, np.array([6.0, 4.0]))

    def error(size: float) -> float:
        moved = f.displace(found.finger_state, size * np.array([1.0, -0.5, 0.8]))
        motion = f.motion(moved)
        foreseen = affine(found.load, found.jacobian.load_motion, found.motion, motion)
        exact = hood.advance(found.response.state, motion, found.hood_tension, STATIC).load
        return float(np.abs(foreseen.total() - exact.total()).max())

    assert error(0.0) < 1e-15
    assert error(0.02) < 0.05 * np.abs(found.load.total()).max()
    assert error(0.01) / error(0.005) == pytest.approx(4.0, rel=0.1)


def test_the_finger_balances_against_the_affine_load():
    f, hood = finger(True), dorsal_and_palmar()
    state = f.start(dict(zip(hinge.JOINTS, REST, strict=True)))
    motion = f.motion(state)
    answer = hood.advance(hood.start(motion), motion, np.array([2.0, 1.0]), STATIC)
    by_motion = hood.jacobian(answer.state).load_motion
    there, balance = balance_finger(f, state, answer.load, np.zeros(0), by_motion, 1e-10)
    seen = affine(answer.load, by_motion, motion, f.motion(there))
    assert f.balance(there, seen, np.zeros(0)).relative == balance.relative < 1e-10
    assert f.balance(state, answer.load, np.zeros(0)).relative > 0.1


def test_moment_arms_are_how_fast_the_cables_shorten():
    f, hood = finger(False), dorsal_and_palmar()
    found = couple(f, hood, np.array([6.0, 4.0]))
    arms = moment_arms(f, found)
    assert arms.shape == (3, 2)
    np.testing.assert_allclose(arms[:, 0], -arm(found.finger_state.angles), rtol=1e-12)
    assert arms[2, 1] == pytest.approx(0.0, abs=1e-15), "the palmar cable ends before the DIP"

    def excursion(step: Array) -> Array:
        motion = f.motion(f.displace(found.finger_state, step))
        return hood.advance(found.response.state, motion, found.hood_tension, STATIC).excursion

    slope = [(excursion(h) - excursion(-h)) / 2e-5 for h in 1e-5 * np.eye(3)]
    np.testing.assert_allclose(arms, slope, rtol=0, atol=1e-11)


@pytest.mark.parametrize("tendon", [0, 1])
def test_exact_hoods_are_reciprocal(tendon):
    f, hood = finger(True), dorsal_and_palmar()
    found = couple(f, hood, np.array([6.0, 4.0]))
    assert reciprocity(f, hood, found, tendon, 2e-5) < 1e-8


def stiff_limits() -> HingeFinger:
    """A held finger whose limits are far stiffer than its springs, as in the packaged cases."""
    law = joint_law(
        hinge.JOINTS,
        dict.fromkeys(hinge.JOINTS, 0.04),
        dict(zip(hinge.JOINTS, REST, strict=True)),
    )
    posture = dict(zip(hinge.JOINTS, REST, strict=True))
    return HingeFinger(LENGTHS, law=law.hold_about(posture))


@pytest.mark.parametrize("tension", [1.0, 10.0, 40.0, 80.0, 160.0, 600.0])
@pytest.mark.parametrize("tendon", [0, 1])
def test_a_strong_pull_ends_in_a_stable_equilibrium_at_the_limits(tendon, tension):
    """Held at its tip the finger is a four-bar linkage, which a strong muscle makes run away from
    the springs' rest until a limit stops it."""
    f, pulls = stiff_limits(), tension * np.eye(2)[tendon]
    found = couple(f, dorsal_and_palmar(), pulls)
    tangent = f.tangent(found.finger_state, found.load, np.zeros(0), found.jacobian.load_motion)
    free = np.linalg.svd(tangent[3:, :3])[2][2]
    assert free @ tangent[:3, :3] @ free < 0
    assert found.finger_residual < OPTIONS.tolerance
    turned = np.abs(found.finger_state.angles - REST).max()
    assert turned < np.deg2rad(12)


def running_away() -> tuple[HingeFinger, PulleyHood, float, float]:
    """A palmar cable that is longest at the spring's rest has no arm there; a pull T above
    2 k / r, r the eyelets' distance from the joint, makes the finger run away to an angle u beyond
    where k u = T r sin(u / 2).  Finger, hood, and both angles (rad)."""
    k, r = 0.02, np.hypot(A, H)
    rest = np.pi - 2 * np.arctan(A / H)
    law = joint_law(hinge.JOINTS, dict.fromkeys(hinge.JOINTS, k), {"MCP": -rest})
    f = HingeFinger(LENGTHS, law=law, support=FREE)
    cable = Cable((("metacarpal", (-A, 0.0, -H)), ("proximal", (A, 0.0, -H))))
    hood = PulleyHood({"FDS": cable}, f.motion(f.start({})))
    return f, hood, rest, brentq(lambda u: k * u - PULL * r * np.sin(u / 2), 0.1, 3.0)


def test_a_finger_does_not_stay_where_it_would_run_away():
    f, hood, rest, away = running_away()
    found = couple(f, hood, np.array([PULL]), (0.01 - rest, 0.0, 0.0))
    assert found.finger_state.angles[0] == pytest.approx(away - rest, abs=1e-8)


@dataclass(frozen=True)
class Doctored:
    """A hood with faults put in: the derivatives of its load by tension and by motion times a
    factor, an answer that a loose solve leaves wrong, no answer beyond a tension (N)."""

    inner: PulleyHood
    by_tension: float = 1.0
    by_motion: float = 1.0
    loose_error: float = 0.0
    is_loose: bool = False
    most_tension: float = np.inf

    bodies = property(lambda self: self.inner.bodies)
    tendons = property(lambda self: self.inner.tendons)
    sources = property(lambda self: self.inner.sources)

    def start(self, motion: Motion) -> State:
        return self.inner.start(motion)

    def advance(self, state: State, motion: Motion, tension: Array, dt: float) -> Response:
        if tension.max() > self.most_tension:
            raise ConvergenceError(f"the hood tears above {self.most_tension} N")
        answer = self.inner.advance(state, motion, tension, dt)
        factor = 1 + self.loose_error * self.is_loose
        return answer._replace(load=replace(answer.load, wrench=factor * answer.load.wrench))

    def jacobian(self, state: State) -> HoodJacobian:
        true = self.inner.jacobian(state)
        return replace(
            true,
            load_tension=self.by_tension * true.load_tension,
            load_motion=self.by_motion * true.load_motion,
        )

    def with_tolerance(self, tolerance: float) -> Doctored:
        return replace(self, is_loose=True)


class FirmWhenLoose(Doctored):
    """A hood whose loose answers hide that it pulls the harder the further the finger turns."""

    def jacobian(self, state: State) -> HoodJacobian:
        true = self.inner.jacobian(state)
        return replace(true, load_motion=(not self.is_loose) * true.load_motion)


@pytest.mark.parametrize("start", [1e-12, 4e-10])
def test_a_balance_from_which_the_finger_would_turn_is_no_equilibrium(start):
    """The finger of the test above so near its unstable balance that the residual there is below
    the tolerance."""
    f, hood, rest, away = running_away()
    options = CouplingOptions()
    found = couple(f, FirmWhenLoose(hood), np.array([PULL]), (start - rest, 0.0, 0.0), options)
    assert found.finger_state.angles[0] == pytest.approx(away - rest, abs=1e-8)


@dataclass(frozen=True)
class Kinked:
    """A hood that turns the MCP back to an angle `at` (rad) by a moment that grows by `steep` N m
    per rad up to WIDTH, and is the same from there on."""

    inner: PulleyHood
    at: float
    steep: float

    bodies = property(lambda self: self.inner.bodies)
    tendons = property(lambda self: self.inner.tendons)
    sources = property(lambda self: self.inner.sources)

    def start(self, motion: Motion) -> State:
        return self.inner.start(motion), False

    def advance(self, state: State, motion: Motion, tension: Array, dt: float) -> Response:
        inner = self.inner.advance(state[0], motion, tension, dt)
        turn = motion.rotation[0].T @ motion.rotation[1]
        beyond = np.arctan2(-turn[2, 0], turn[0, 0]) - self.at
        wrench = inner.load.wrench.copy()
        wrench[1, 0, 4] -= self.steep * np.clip(beyond, -WIDTH, WIDTH)
        steep = abs(beyond) < WIDTH
        return Response((inner.state, steep), replace(inner.load, wrench=wrench), inner.excursion)

    def jacobian(self, state: State) -> HoodJacobian:
        inner = self.inner.jacobian(state[0])
        by_motion = inner.load_motion.copy()
        by_motion[10, 10] -= self.steep * state[1]
        return replace(inner, load_motion=by_motion)

    def with_tolerance(self, tolerance: float) -> Kinked:
        return self


@pytest.mark.parametrize("steep", [3.0, 30.0])
@pytest.mark.parametrize("at", [0.45, 0.55])
def test_whole_steps_that_go_to_and_fro_between_kinks_are_halved(at, steep):
    """From either side the whole step leads over both kinks to the other one."""
    stiffness, rest = 0.1, 0.5
    law = joint_law(hinge.JOINTS, dict.fromkeys(hinge.JOINTS, stiffness), {"MCP": rest})
    f, hood = HingeFinger(LENGTHS, law=law, support=FREE), Kinked(dorsal_and_palmar(), at, steep)
    found = couple(f, hood, np.zeros(2), (0.2, 0.0, 0.0), CouplingOptions(1e-9, 40))
    closed = (stiffness * rest + steep * at) / (stiffness + steep)
    assert found.finger_state.angles[0] == pytest.approx(closed, abs=1e-9)
    assert found.iterations > WHOLE_ROUNDS


def test_a_wrong_derivative_by_tension_is_found_by_reciprocity():
    f, hood = finger(True), Doctored(dorsal_and_palmar(), by_tension=1.1)
    found = couple(f, hood, np.array([6.0, 4.0]))
    assert reciprocity(f, hood, found, 0, 2e-5) == pytest.approx(0.1 / 1.1, rel=1e-5)


def test_a_slightly_wrong_derivative_by_motion_costs_rounds_but_not_accuracy():
    f, tension = finger(False), np.array([6.0, 4.0])
    exact = couple(f, dorsal_and_palmar(), tension)
    slow = couple(f, Doctored(dorsal_and_palmar(), by_motion=1.2), tension)
    np.testing.assert_allclose(slow.finger_state.angles, exact.finger_state.angles, atol=1e-9)
    assert slow.iterations > exact.iterations


def test_loose_rounds_leave_no_trace_in_the_answer():
    f, tension = finger(False), np.array([6.0, 4.0])
    exact = couple(f, dorsal_and_palmar(), tension)
    found = couple(f, Doctored(dorsal_and_palmar(), loose_error=1e-3), tension)
    np.testing.assert_allclose(found.finger_state.angles, exact.finger_state.angles, atol=1e-10)
    np.testing.assert_allclose(found.load.wrench, exact.load.wrench, atol=1e-9)


def test_hood_and_finger_that_cannot_agree_are_an_error_and_no_result():
    hood = Doctored(dorsal_and_palmar(), by_motion=-20.0)
    with pytest.raises(ConvergenceError, match=r"did not agree in 12 rounds.*max_iterations"):
        couple(finger(False), hood, np.array([6.0, 4.0]), options=CouplingOptions(1e-10, 12))


def test_too_few_rounds_are_an_error():
    with pytest.raises(ConvergenceError, match="did not agree in 1 round"):
        couple(
            finger(False), dorsal_and_palmar(), TENSION.repeat(2), options=CouplingOptions(1e-10, 1)
        )


def test_a_hood_that_fails_says_so_itself():
    hood = Doctored(dorsal_and_palmar(), most_tension=5.0)
    with pytest.raises(ConvergenceError, match="tears above 5"):
        couple(finger(True), hood, np.array([6.0, 4.0]))


def test_a_wrong_number_of_tensions_is_the_users_fault():
    with pytest.raises(InputError, match="2 finite tensions"):
        couple(finger(True), dorsal_and_palmar(), np.array([6.0]))


def test_progress_tells_of_every_round():
    told: list[str] = []
    f, hood = finger(True), dorsal_and_palmar()
    state = f.start(dict(zip(hinge.JOINTS, REST, strict=True)))
    start = PairState(state, hood.start(f.motion(state)))
    tensions = Tensions(np.array([6.0, 4.0]), np.zeros(0))
    found = equilibrium(Pair(f, hood), start, tensions, OPTIONS, told.append)
    assert len(told) == found.iterations
    assert all("relative residual" in text for text in told)
