"""Tensions that move a finger forward along a wanted motion: computed muscle control.

At equal intervals the finger's own angles and rates are compared with the wanted ones, and a plan
is made for the end of the next interval: the error e of then dies as a critically damped one does,

    e(h) = (e + (e' + w e) h) exp(-w h),

from what it is now.  Inverse dynamics of the plan give the joint torques there, a programme with
the hood's tangent the tensions that make them, and the tensions go to those in a straight line.
(Thelen and Anderson 2006, J Biomech 39:1107, plan the acceleration of now.  A finger's joints are
damped so much, and weigh so little, that its rates follow the torques within the interval.)
Finger and hood move by the case's own scheme in time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import ceil
from typing import Any, NamedTuple, cast

import numpy as np

from cosim.analyses.estimate.capacity import Weights
from cosim.analyses.estimate.demand import torque_demand
from cosim.analyses.estimate.held_finger import HeldFinger
from cosim.analyses.estimate.joint_motion import JointMotion
from cosim.analyses.estimate.of_case import Setup, cheapest, with_costs
from cosim.analyses.estimate.tensions import least_beyond, linearise, nearest
from cosim.case.schema import Case
from cosim.coupling.motion import CoupledMotion, MotionState, motion_states
from cosim.errors import ConvergenceError, InputError, Progress, quiet
from cosim.fingers.common import ChainFingerConfig
from cosim.fingers.kinds import joint_ranges, with_mass
from cosim.models.build import Models, build
from cosim.models.motion import moving_models
from cosim.port import Array, OpenFinger, State
from cosim.tendons.signals import LiveSignal
from rigid.mujoco.finger import MujocoFinger, needed_torque
from rigid.muscle.least_cost import Power

INTERVAL = 0.01
"""s, from one plan to the next."""
RATE = 20.0
"""1/s, with which an error dies."""
SMOOTH = 0.05
"""s, in which tensions go to the cheapest ones, as activations would: where two tendons do nearly
the same on a hood, the cheapest pair jumps from the one to the other."""
BEGIN = 0.02
"""Part of the greatest tensions."""
MOST_ROUNDS, MOST_BEGIN = 6, 30
"""Rounds of a plan, and of the first one."""
AGREED = 1e-2
"""Relative difference of the hood's torques and those of a plan, at which its rounds end: what is
left, the next plan takes out."""
FOLLOWED, ASTRAY = 2.0, 0.5
"""deg, RMS of a joint that follows a motion; most that a joint strays where no plan corrects it."""
NUDGE = 1e-6
"""Part by which tensions are larger where it is asked whether the finger keeps its way."""
STEP_ROUNDING = 1e-6
"""The part of a step by which a motion may be too short for the last one."""


class Plan(NamedTuple):
    """Where the finger is to be at one time, (nq,) rad, rad/s, rad/s2."""

    angle: Array
    rate: Array
    acceleration: Array


@dataclass(frozen=True)
class Tracking:
    """How a finger followed a motion, and under what tensions."""

    motion: JointMotion
    time: Array
    """(n,) s since the motion's start, at which the tensions change their slope."""
    tension: Array
    """(n, nt) N."""
    lacking: float
    """N m, the most that the torques of a tension miss those of its plan by."""
    step_time: Array
    """(m,) s, the start and the ends of the steps."""
    angle: Array
    """(m, nq) rad, there."""
    wanted: Array
    """(m, nq) rad."""
    astray: float
    """rad, by how much a joint strays at most where the tensions alone pull, larger by NUDGE:
    infinite where that way does not end."""
    rounds: int
    """Hood solves for the plans."""
    stopped: ConvergenceError | None = None
    """Why the finger was not moved to the motion's end."""

    def faults(self) -> list[str]:
        """What is to be doubted, a sentence each."""
        out = []
        worst = float(np.degrees(self.error.max()))
        if worst > FOLLOWED:
            out.append(
                f"the finger does not follow: a joint is {worst:.2g} deg off (RMS), and "
                f"{FOLLOWED:g} are allowed. Try a slower motion, one within reach of the muscles, "
                "or --cutoff"
            )
        if np.degrees(self.astray) > ASTRAY:
            out.append(
                "under these tensions alone the finger does not keep its way: larger by a "
                f"millionth they lead a joint {np.degrees(self.astray):.2g} deg astray, so that a "
                "run of the case may end elsewhere. Try stiffer or more damped joints "
                "(finger.passive), or a controller (cosim.Loop)"
            )
        return out

    @property
    def error(self) -> Array:
        """Root of the mean square by which each joint misses the motion, (nq,) rad."""
        out: Array = np.sqrt(np.mean((self.angle - self.wanted) ** 2, axis=0))
        return out


@dataclass(frozen=True)
class WantedMotion:
    """A motion at any time since its start."""

    motion: JointMotion

    @property
    def duration(self) -> float:
        """s."""
        return float(self.motion.time[-1] - self.motion.time[0])

    def at(self, time: float | Array) -> Plan:
        """Angles, rates and accelerations at `time` s (...); those of its end beyond that."""
        return Plan(*(spline(np.minimum(time, self.duration)) for spline in self._splines))

    @cached_property
    def _splines(self) -> tuple[Any, Any, Any]:
        from scipy.interpolate import CubicHermiteSpline

        m = self.motion
        angle = CubicHermiteSpline(m.time - m.time[0], m.angle, m.rate)
        return angle, angle.derivative(), angle.derivative(2)


@dataclass
class Course:
    """Tensions (nt,) N that are straight between times; steps go to the last of them."""

    times: list[float]
    tensions: list[Array]

    def tension(self, tendon: int, time: float) -> float:
        """The tension (N) of a tendon at `time` s, between the last two times."""
        ends = [float(tension[tendon]) for tension in self.tensions[-2:]]
        return float(np.interp(time, self.times[-2:], ends))


def with_signals(case: Case, names: Sequence[str], tension: Callable[[int, float], float]) -> Case:
    """A case of `forward_case` whose tendons `names` have tensions (N) by number and time (s)."""
    tables = dict(case.tendons)
    for k, name in enumerate(names):
        signal = LiveSignal(partial(tension, k))
        tables[name] = tables[name].model_copy(update={"signal": signal})
    return case.model_copy(update={"tendons": tables})


@dataclass
class Planner:
    """Plans for the end of an interval, and the tensions that they take."""

    setup: Setup
    wanted: WantedMotion
    rate: float
    lacking: float = 0.0
    rounds: int = 0

    def plan(self, angle: Array, rate: Array, time: float, ahead: float) -> Plan:
        """Where the finger, now at `time` s at angles and rates (nq,), is to be `ahead` s later."""
        now, then, w = self.wanted.at(time), self.wanted.at(time + ahead), self.rate
        error, slope = angle - now.angle, rate - now.rate
        grown = slope + w * error
        dies = np.exp(-w * ahead)
        error, slope = (error + grown * ahead) * dies, (slope - w * grown * ahead) * dies
        return Plan(
            then.angle + error,
            then.rate + slope,
            then.acceleration - 2 * w * slope - w**2 * error,
        )

    def begin(self, plan: Plan) -> Array:
        """The cheapest tensions (nt,) N of all with which the finger is as planned; where those are
        not found, others near a part BEGIN of the greatest ones."""
        held, needed = self._held(plan)
        try:
            found = cheapest(self.setup, held, torque_demand(held), needed, None, 0.0)
        except (InputError, ConvergenceError):
            bounds = self.setup.bounds
            tension = np.maximum(BEGIN * bounds.most, bounds.least)
            return self._rounds(held, needed, tension, held.begin(), 1.0, MOST_BEGIN)
        self.rounds += found.rounds
        return found.tension

    def go_on(self, plan: Plan, tension: Array, hood: State, ahead: float) -> Array:
        """The tensions (nt,) N of a plan `ahead` s from now, when they are `tension` and the hood
        is in the state `hood`.

        They go to the cheapest with the time SMOOTH, and the hood from that state, so that it stays
        on its way where it has more than one equilibrium.  Raises ConvergenceError."""
        held, needed = self._held(plan)
        share = SMOOTH / (SMOOTH + ahead)
        return self._rounds(held, needed, tension, hood, share, MOST_ROUNDS)

    def _rounds(
        self, held: HeldFinger, needed: Array, tension: Array, hood: State, share: float, most: int
    ) -> Array:
        """The tensions that make the torques (nq,) N m by the hood's tangent, and cost least in
        what they have beyond a share of the last ones: those of at most so many rounds that come
        nearest."""
        demand, bounds, cost = torque_demand(held), self.setup.bounds, self.setup.cost
        at, kept = held.at(tension, hood), share * tension
        best, least_miss = tension, float(np.abs(at.torque - needed).max())
        for _ in range(most):
            self.rounds += 1
            programme = linearise(demand, needed, tension, at, bounds)
            if (found := least_beyond(programme, cost, kept)) is None:
                aim = nearest(demand, needed, tension, at, bounds)
                found = least_beyond(linearise(demand, aim, tension, at, bounds), cost, kept)
            if found is None:
                break
            tension, at = found.x, held.at(found.x, at.state)
            miss = float(np.abs(at.torque - needed).max())
            if miss < least_miss:
                best, least_miss = tension, miss
            if miss <= AGREED * np.abs(needed).max():
                break
            if share == 1.0:
                kept = tension
        self.lacking = max(self.lacking, least_miss)
        return best

    def _held(self, plan: Plan) -> tuple[HeldFinger, Array]:
        """The finger in the planned posture, and the torques (nq,) N m that the plan takes."""
        finger = cast(MujocoFinger, self.setup.models.finger)
        ends = np.array([finger.ranges.get(j, (-np.inf, np.inf)) for j in finger.joints]).T
        angle = np.clip(plan.angle, *ends)
        needed = needed_torque(finger, angle, plan.rate, plan.acceleration)
        return self.setup.hold_finger(dict(zip(finger.joints, angle, strict=True))), needed


def setup_to_follow(
    case: Case,
    weights: Weights,
    power: Power,
    areas: Mapping[str, float],
    most: Mapping[str, float],
    read: Callable[[Models], JointMotion],
) -> tuple[Setup, JointMotion]:
    """The problem of a motion that is to be followed, of the case as `forward_case` makes it, and
    the motion; `read`: the motion for a finger.  Raises InputError, which says all that is lacking
    at once."""
    models = build(case)
    motion = read(models)
    lacking = list(_lacking(case, models, motion, power))
    try:
        s = with_costs(case, models, weights, power, areas, most)
    except InputError as error:
        lacking.append(str(error))
    if lacking:
        raise InputError("; and ".join(lacking))
    return start_of(s, motion), motion


def start_of(s: Setup, motion: JointMotion) -> Setup:
    """The same problem of the case as `forward_case` makes it.  Raises InputError."""
    joints, tendons = s.models.finger.joints, s.capacity.names
    return replace(s, case=forward_case(s.case, motion, joints, tendons))


def _lacking(case: Case, models: Models, motion: JointMotion, power: int) -> Iterator[str]:
    """What a case and its motion lack for following it, in words."""
    if power != 2:
        yield "--cost: a motion is followed with the quadratic cost alone; leave it out"
    yield from _out_of_range(models.finger, motion)
    finger = case.native_finger()
    if not finger.has_mass:
        yield f"a finger that follows a motion needs mass: {with_mass()}"
    if finger.tip.kind != "free":
        yield (
            f'finger.tip.kind: is "{finger.tip.kind}"; a finger that follows a motion must be free '
            'to move. Write finger.tip.kind = "free"'
        )
    yield from _narrow_limits(finger, motion, models.finger.joints)
    if finger.splint:
        yield "finger.splint: a motion is followed by a finger without splints; leave it out"
    if _steps(case, motion) < 1:
        step = 1e3 * _step(case)
        yield f"the motion is shorter than a step of {step:g} ms (forward.step)"


def _step(case: Case) -> float:
    """s."""
    return 1e-3 if case.forward is None else case.forward.step


def _steps(case: Case, motion: JointMotion) -> int:
    return int((motion.time[-1] - motion.time[0]) / _step(case) + STEP_ROUNDING)


def forward_case(
    case: Case, motion: JointMotion, joints: Sequence[str], tendons: Sequence[str]
) -> Case:
    """The case as a motion that begins where `motion` begins and lasts as long, by the case's steps
    (1 ms where it is an equilibrium), with tensions of 1 N times a signal to come."""
    finger, step, steps = case.native_finger(), _step(case), _steps(case, motion)
    posture = finger.posture.angles()
    rests = {
        f"finger.passive.{joint}.rest": _degrees(posture[joint])
        for joint, passive in finger.passive.items()
        if passive.rest == "posture"
    }
    begin = {
        f"finger.posture.{joint}": _degrees(angle)
        for joint, angle in zip(joints, motion.angle[0], strict=True)
    }
    forward = {"duration": f"{steps * step!r} s", "step": f"{step!r} s", "must_rest": False}
    pulls = {f"tendons.{name}.tension": "1 N" for name in tendons}
    return case.replace({**rests, **begin, **pulls, "forward": forward})


def _degrees(angle: float) -> str:
    """An angle in rad as a case file states it."""
    return f"{float(np.degrees(angle))!r} deg"


def _narrow_limits(
    finger: ChainFingerConfig, motion: JointMotion, joints: Sequence[str]
) -> Iterator[str]:
    if finger.limit is None:
        return
    turned = np.degrees(np.abs(motion.angle - motion.angle[0]).max(axis=0))
    k, most = int(np.argmax(turned)), float(np.degrees(finger.limit.half_range))
    if turned[k] > most:
        wider = f'; write for example "{min(turned[k] + 10, 90):.0f} deg"' if most < 90 else ""
        yield (
            f"finger.limit.half_range: holds every joint within {most:g} deg of where a motion "
            f"begins, and this one turns {joints[k]} by {turned[k]:.3g} deg{wider}"
        )


def _out_of_range(finger: OpenFinger, motion: JointMotion) -> Iterator[str]:
    """The angles outside of their joints' ranges, with the time of the first of each."""
    ranges = joint_ranges(finger)
    for joint, angle in zip(finger.joints, motion.angle.T, strict=True):
        low, high = ranges.get(joint, (-np.inf, np.inf))
        out = (angle < low) | (angle > high)
        if out.any():
            k = int(np.argmax(out))
            yield (
                f"at {motion.time[k]:.4g} s of the motion {joint} is at {np.degrees(angle[k]):.4g} "
                f"deg, outside its range of {np.degrees(low):.4g} to {np.degrees(high):.4g} deg"
            )


def track(
    s: Setup,
    motion: JointMotion,
    progress: Progress,
    interval: float = INTERVAL,
    rate: float = RATE,
) -> Tracking:
    """Move the finger of a case of `forward_case` along a motion.

    The tensions change their slope every `interval` s, or the steps nearest to that; errors die
    with `rate` 1/s.  Raises InputError, and ConvergenceError where the first interval has no end;
    after it what was reached is answered, with the reason (`stopped`)."""
    forward, wanted = s.case.forward, WantedMotion(motion)
    assert forward is not None
    steps, each = round(forward.duration / forward.step), max(1, round(interval / forward.step))
    planner, first = Planner(s, wanted, rate), wanted.at(0.0)
    course = Course([0.0], [planner.begin(first)])
    pulled = with_signals(s.case, s.capacity.names, course.tension)
    moves = moving_models(pulled, forward).moves
    at = moves.begin(moves.finger.begin(dict(zip(moves.finger.joints, first.angle, strict=True))))
    time, angle, stopped = [at.coupled.time], [_angles_rates(moves, at)[0]], None
    for done in range(0, steps, each):
        count, now = min(each, steps - done), at.coupled.time
        try:
            ahead = count * forward.step
            plan = planner.plan(*_angles_rates(moves, at), now, ahead)
            aim = planner.go_on(plan, course.tensions[-1], at.coupled.hood, ahead)
            course.times.append(now + ahead)
            course.tensions.append(aim)
            new, made = at, list[tuple[float, Array]]()
            for _ in range(count):  # the states themselves are too large to be kept
                new = moves.advance(new)
                made.append((new.coupled.time, _angles_rates(moves, new)[0]))
        except ConvergenceError as error:
            stopped = ConvergenceError(f"at {now:.4g} s of the motion, run forward: {error}")
            stopped.__cause__ = error
            if not done:
                raise stopped from error
            steps = done
            break
        at = new
        time += [when for when, _ in made]
        angle += [there for _, there in made]
        off = _angles_rates(moves, at)[0] - wanted.at(at.coupled.time).angle
        progress(
            f"forward: {at.coupled.time:.4g} s of {forward.duration:g} s, "
            f"{np.degrees(np.abs(off).max()):.2g} deg off"
        )
    ends = slice(None, 1 + ceil(steps / each))
    times, tension = np.array(course.times[ends]), np.array(course.tensions[ends])
    progress("once more without plans, all tensions larger by a millionth")
    alone = _alone(s, times, (1 + NUDGE) * tension, steps)
    return Tracking(
        motion,
        times,
        tension,
        planner.lacking,
        np.array(time),
        np.array(angle),
        wanted.at(np.array(time)).angle,
        float(np.abs(alone - np.array(angle)).max()) if len(alone) == len(angle) else np.inf,
        planner.rounds,
        stopped,
    )


def _alone(s: Setup, times: Array, tension: Array, steps: int) -> Array:
    """The angles (m, nq) rad of the finger under tensions (n, nt) N alone, up to a step that is not
    made where there is one."""
    assert s.case.forward is not None
    names = s.capacity.names
    pulled = with_signals(s.case, names, lambda k, t: float(np.interp(t, times, tension[:, k])))
    models = moving_models(pulled, s.case.forward)
    at = models.moves.begin(models.initial_state)
    angles = [models.finger.angles(at.coupled.finger)]
    with suppress(ConvergenceError):
        for state in motion_states(models.moves, at, steps, quiet):
            angles.append(models.finger.angles(state.coupled.finger))
    return np.array(angles)


def _angles_rates(moves: CoupledMotion, at: MotionState) -> tuple[Array, Array]:
    finger = at.coupled.finger
    return moves.finger.angles(finger), moves.finger.rates(finger)
