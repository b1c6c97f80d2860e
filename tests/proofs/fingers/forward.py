"""Forward simulation of a finger: its history, whether it came to rest, where the energy went."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cosim.errors import ConvergenceError, InputError
from cosim.port import Array, State
from rigid.chain.joint_torques import JointLaw, limit_damping
from rigid.mujoco.dynamics import FingerDynamics, Moment

DURATION = 2.0
"""s (thesis, section 2.2.1)."""
STEP = 1e-3
"""s."""


@dataclass(frozen=True)
class RestCriterion:
    """When a finger counts as at rest: over the last `window` s no joint turns faster than `rate`
    rad/s and no component of the fingertip force strays further than `force` N from its end.

    In a frictional cage rest is where creep has ended: Simbody's friction is viscous below its
    transition velocity, so that a finger slides until a face, a corner, a limit or the passive
    joints hold it without friction."""

    window: float = 0.1
    rate: float = 1e-3
    force: float = 1e-3


@dataclass(frozen=True)
class EnergyBudget:
    """The energies of a whole simulation, J.  Kinetic energy gained and what is stored come from
    the work of the tendons and gravity less what is dissipated and `artificial`: what the method's
    damping took (positive) or gave."""

    tendons: float
    gravity: float
    kinetic: float
    joints_stored: float
    device_stored: float
    joints_dissipated: float
    device_dissipated: float

    @property
    def artificial(self) -> float:
        """The energy, J, that the method's damping took (positive) or gave."""
        gained = self.kinetic + self.joints_stored + self.device_stored
        lost = self.joints_dissipated + self.device_dissipated
        return self.tendons + self.gravity - gained - lost


@dataclass(frozen=True)
class Simulation:
    """A finger's history at n + 1 times, the first at rest in the posture."""

    time: Array
    """(n + 1,) s."""
    angles: Array
    """(n + 1, nq) rad."""
    rates: Array
    """(n + 1, nq) rad/s."""
    force: Array
    """(n + 1, 3) N, of the fingertip on the world, world frame."""
    moment: Array
    """(n + 1, 3) N m about the fingertip."""
    tension: Array
    """(n + 1, nt) N."""
    energy: EnergyBudget
    rest: RestCriterion
    last_rate: float
    """The largest joint rate over the window of `rest`, rad/s."""
    last_change: float
    """The largest change of a force component from the end of that window, N."""
    last: Moment
    """The state at the end."""
    muscles: tuple[State, ...]
    """(n + 1) states of what pulls."""

    @property
    def at_rest(self) -> bool:
        """Whether rates and force change over the last window no more than `rest` allows."""
        return self.last_rate <= self.rest.rate and self.last_change <= self.rest.force


def simulate(
    dynamics: FingerDynamics,
    duration: float = DURATION,
    dt: float = STEP,
    rest: RestCriterion | None = None,
) -> Simulation:
    """The motion over `duration` s in steps of `dt` s.

    Raises InputError where the duration is no multiple of the step or shorter than the window of
    rest, ConvergenceError where a step does not converge."""
    rest = RestCriterion() if rest is None else rest
    steps = round(duration / dt) if dt > 0 else 0
    if steps < 1 or abs(steps * dt - duration) > 1e-9 * duration or duration < rest.window:
        raise InputError(
            f"forward simulation: its duration of {duration} s must be a multiple of the step of "
            f"{dt} s and no shorter than the {rest.window} s in which it is to be at rest"
        )
    history = [dynamics.start()]
    for _ in range(steps):
        history.append(dynamics.advance(history[-1], dt))
    return _simulation(dynamics, history, dt, rest)


def require_rest(simulation: Simulation) -> Simulation:
    """Return the same simulation.  Raises ConvergenceError where it did not come to rest."""
    if not simulation.at_rest:
        rest = simulation.rest
        raise ConvergenceError(
            f"the finger did not come to rest in {simulation.time[-1]:g} s: over the last "
            f"{rest.window:g} s a joint turned at up to {simulation.last_rate:.1e} rad/s "
            f"(at rest: {rest.rate:g}) and the fingertip force changed by up to "
            f"{simulation.last_change:.1e} N ({rest.force:g}). Try a longer simulation, damping "
            "or passive stiffness of the joints, or a tip that is held at a point."
        )
    return simulation


def _simulation(
    dynamics: FingerDynamics, history: list[Moment], dt: float, rest: RestCriterion
) -> Simulation:
    rates, tip = _over_time([m.rates for m in history]), _over_time([m.tip for m in history])
    last = -(round(rest.window / dt) + 1)
    return Simulation(
        np.array([m.time for m in history]),
        _over_time([m.angles for m in history]),
        rates,
        tip[:, :3],
        tip[:, 3:],
        _over_time([m.tension for m in history]),
        _energy(dynamics, history, dt),
        rest,
        float(np.abs(rates[last:]).max()),
        float(np.abs(tip[last:, :3] - tip[-1, :3]).max()),
        history[-1],
        tuple(m.muscles for m in history),
    )


def _energy(dynamics: FingerDynamics, history: list[Moment], dt: float) -> EnergyBudget:
    """Energies of tendons, springs and curves by the trapezoidal rule, of limits, device and
    gravity from their potentials, and of damping as the steps have it."""
    law, first, last = dynamics.law, history[0], history[-1]
    angles = _over_time([m.angles for m in history])
    rates = _over_time([m.rates for m in history])
    tension = _over_time([m.tension for m in history])
    length = _over_time([*(m.length for m in history[1:]), dynamics.tendon_lengths(last)])
    elastic = np.array([law.passive(q)[0] for q in angles]) if law.curves else _springs(law, angles)
    damping = limit_damping(angles, law.lower, law.upper, law.limit_damping, law.transition)
    damping = damping if law.damping is None else damping + law.damping
    stored = [dynamics.device.energy(dynamics.place(m)) for m in (first, last)]
    return EnergyBudget(
        tendons=-_work(tension, length),
        gravity=dynamics.energies(first)[1] - dynamics.energies(last)[1],
        kinetic=last.kinetic - first.kinetic,
        joints_stored=-_work(elastic, angles)
        + limit_energy(law, angles[-1])
        - limit_energy(law, angles[0]),
        device_stored=stored[1] - stored[0],
        joints_dissipated=float(dt * (damping[1:] * rates[1:] ** 2).sum()),
        device_dissipated=float(sum(m.slip for m in history)),
    )


def _over_time(vectors: list[Array]) -> Array:
    """An array (n, k) of n vectors; in a tenth of the time of np.array."""
    return np.concatenate(vectors).reshape(len(vectors), -1)


def limit_energy(law: JointLaw, angles: Array) -> float:
    """The energy, J, stored in the coordinate limits: the integral of `limit_torque` over x rad
    beyond one, K t^2 (2 u^5 - 5/2 u^6 + 6/7 u^7) with u = x / t up to the transition t, K (x^2 -
    t^2) / 2 and that at t beyond."""
    x = np.maximum(angles - law.upper, 0.0) + np.maximum(law.lower - angles, 0.0)
    u, t = np.minimum(x / law.transition, 1.0), law.transition
    inside = t**2 * u**5 * (2.0 - u * (2.5 - 6.0 / 7.0 * u))
    beyond = 0.5 * np.maximum(x**2 - t**2, 0.0)
    return float(law.limit_stiffness * (inside + beyond).sum())


def _springs(law: JointLaw, angles: Array) -> Array:
    return -law.stiffness * (angles - law.rest)


def _work(force: Array, along: Array) -> float:
    """Work of force (n, k) along (n, k) by the trapezoidal rule."""
    return float((0.5 * (force[1:] + force[:-1]) * np.diff(along, axis=0)).sum())
