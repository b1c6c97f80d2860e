"""Coupling in time against closed forms: partitioned = monolithic, orders, the stiff pair."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np

from cosim.coupling.accelerators import Aitken, QuasiNewton
from cosim.coupling.schemes import Explicit, Implicit, Linear, Newton, Scheme, begin, step
from cosim.coupling.state import CoupledState, Pulls
from cosim.errors import ConvergenceError
from cosim.port import Array, Hood, MovingFinger
from tests.helpers.rows import Row
from tests.proofs.coupling.pairs import (
    FULL,
    INERTIA,
    LASTS,
    RADIUS,
    REST,
    STIFFNESS,
    pulls_on_cables,
    pulls_on_drum,
    soft_by_backward_euler,
    soft_pair,
    soft_truth,
    stability_limit,
    stiff_by_backward_euler,
    stiff_pair,
    stiff_truth,
)

TIGHT = 1e-11
"""rad, to which iterations agree where they are compared with a monolithic step."""
SCHEMES: dict[str, Scheme] = {
    "explicit, Gauss-Seidel": Explicit(),
    "explicit, Jacobi": Explicit(parallel=True),
    "implicit, Aitken": Implicit(Aitken(), TIGHT),
    "implicit, IQN-ILS": Implicit(QuasiNewton(), TIGHT),
    "newton": Newton(TIGHT),
    "linear": Linear(),
}
TOGETHER = tuple(name for name, scheme in SCHEMES.items() if not isinstance(scheme, Explicit))
"""Those that are implicit in the hood's load."""
PAIR = "one joint, drum and spring"
CABLES = "three joints, two cables"
MONOLITHIC = "the same backward Euler of finger and hood in one system"
EXACT = "closed-form equations, scipy DOP853 to 1e-11"
LIMIT = "h^2 K = 4 I + 2 h c: 2 sqrt(I/K), a little more by the damper"
STEPS = (5e-4, 1e-3, 2e-3, 5e-3)
"""s."""
LAG = 0.1
"""mrad of a motion of 25: the largest error that a step of up to 5 ms may have."""
FINE = 5e-5
"""s, the step of the reference of three stiff joints."""
THREE = "three stiff joints"
ITERATION_BOUNDS: dict[str, tuple[Scheme, float, str]] = {
    "implicit, Aitken": (Implicit(Aitken()), 30, "the most that it is allowed"),
    "implicit, IQN-ILS": (
        Implicit(QuasiNewton()),
        5,
        "a linear hood: a secant for each joint, a step with them and its check",
    ),
    "newton": (Newton(), 2, "a linear hood: one correction and its check"),
    "linear": (Linear(), 1, "one by construction"),
}


def drive(
    scheme: Scheme,
    finger: MovingFinger,
    hood: Hood,
    posture: Array,
    pulls: Pulls,
    dt: float,
    steps: int,
) -> list[CoupledState]:
    """The states at `steps` + 1 times from rest at `posture` (nq,) rad."""
    start = finger.begin(dict(zip(finger.joints, posture, strict=True)))
    states = [begin(scheme, finger, hood, start, pulls)]
    for _ in range(steps):
        states.append(step(scheme, finger, hood, states[-1], pulls, dt))
    return states


def angles_of(states: list[CoupledState]) -> Array:
    """The joint angles (n, nq) rad of states."""
    return np.array([s.finger.angles for s in states])


def times(dt: float, steps: int) -> Array:
    """The times (steps + 1,) s of equal steps."""
    return dt * np.arange(steps + 1, dtype=float)


def monolithic_rows() -> Iterator[Row]:
    """Partitioned against monolithic steps of one method; explicit schemes against the truth."""
    dt, steps = 1e-3, 60
    reference = stiff_by_backward_euler(dt, steps)
    finger, drum = stiff_pair()
    for name in TOGETHER:
        states = drive(SCHEMES[name], finger, drum, np.zeros(1), pulls_on_drum, dt, steps)
        gap = float(np.abs(angles_of(states) - reference).max())
        yield Row(f"{PAIR}, {name}", "angle apart rad", 0.0, gap, 1e-8, MONOLITHIC, "absolute")
    dt, steps = 1e-3, 40
    reference = soft_by_backward_euler(dt, steps)
    for name in TOGETHER[:-1]:
        gap = float(np.abs(soft_angles(SCHEMES[name], dt, steps) - reference).max())
        yield Row(f"{CABLES}, {name}", "angle apart rad", 0.0, gap, 1e-8, MONOLITHIC, "absolute")
    gaps = [
        np.abs(soft_angles(Linear(), h, n) - soft_by_backward_euler(h, n)).max()
        for h, n in ((dt, steps), (dt / 2, 2 * steps))
    ]
    order = float(np.log2(gaps[0] / gaps[1]))
    name, source = f"{CABLES}, linear", "quadratic in what the predicted pose q + h v misses, h^2 a"
    yield Row(name, "order of angle apart", 4.0, order, 0.3, source, "absolute", order)


def soft_angles(scheme: Scheme, dt: float, steps: int, order: Literal[1, 2] = 1) -> Array:
    """The joint angles (steps + 1, 3) rad of the soft pair by a scheme."""
    finger, hood = soft_pair(order)
    return angles_of(drive(scheme, finger, hood, REST, pulls_on_cables, dt, steps))


def order_rows() -> Iterator[Row]:
    """Orders of the schemes, the finger's method of order 1 or 2."""
    for name, scheme in SCHEMES.items():
        yield order_row(name, scheme, 1, 5e-4)
    yield order_row("newton, finger of order 2", Newton(TIGHT), 2, 2.5e-4)
    yield order_row("linear, finger of order 2", Linear(), 2, 2.5e-4)


def order_row(name: str, scheme: Scheme, order: Literal[1, 2], dt: float) -> Row:
    """The order of the largest error over 0.04 s, from steps of `dt` and of half."""
    errors = []
    for h in (dt, dt / 2):
        steps = round(0.04 / h)
        angles = soft_angles(scheme, h, steps, order)
        errors.append(np.abs(angles - soft_truth(times(h, steps))).max())
    measured = float(np.log2(errors[0] / errors[1]))
    what = f"order (error {errors[0]:.1e}, {errors[1]:.1e} rad)"
    return Row(f"{CABLES}, {name}", what, order, measured, 0.15, EXACT, "absolute", measured)


def stiff_rows() -> Iterator[Row]:
    """The stiff pair: linear from 0.5 to 5 ms, explicit only below its limit."""
    finger, drum = stiff_pair()
    for dt in STEPS:
        n = round(LASTS / dt)
        states = drive(Linear(), finger, drum, np.zeros(1), pulls_on_drum, dt, n)
        q, name = angles_of(states), f"stiff pair, linear, {1e3 * dt:g} ms"
        error = 1e3 * float(np.abs(q - stiff_truth(times(dt, n))).max())
        solves = (states[-1].solves - 1) / n
        yield Row(
            name, "final angle rad", FULL * RADIUS / STIFFNESS, float(q[-1, 0]), 1e-4, "r T / K"
        )
        yield Row(name, "largest error mrad", 0.0, error, LAG, EXACT, "absolute")
        yield Row(name, "hood solves a step", 1.0, solves, 0.0, "one by construction")
    for factor in (0.9, 1.1, 2.0, 3.5):
        yield limit_row(factor)
    yield Row("stiff pair, explicit", "limit s", stability_limit(), find_limit(), 0.005, LIMIT)


def limit_row(factor: float) -> Row:
    """Whether an explicit run at a multiple of 2 sqrt(I/K) is marked as failed."""
    dt = factor * 2 * np.sqrt(INERTIA / STIFFNESS)
    stopped = stop_time(dt)
    says = "no" if stopped is None else f"at {stopped:.3g} s"
    name = f"stiff pair, explicit, {1e3 * dt:.3g} ms = {factor:g} x 2 sqrt(I/K)"
    failed = float(stopped is not None)
    return Row(name, f"fails: {says}", float(factor > 1), failed, 0.0, LIMIT, "absolute")


def stop_time(dt: float, least_time: float = 1.0) -> float | None:
    """When (s) an explicit run of the stiff pair stops as unstable; None: not in `least_time` s."""
    finger, drum = stiff_pair()
    state = begin(Explicit(), finger, drum, finger.begin({}), pulls_on_drum)
    for _ in range(round(least_time / dt)):
        try:
            state = step(Explicit(), finger, drum, state, pulls_on_drum, dt)
        except ConvergenceError:
            return state.time + dt
    return None


def find_limit() -> float:
    """Find the step (s) between the stable and the unstable ones of the explicit pair, by
    bisection."""
    low, high = 1e-3, 2e-3
    while high - low > 5e-6:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if stop_time(middle) else (middle, high)
    return 0.5 * (low + high)


def solves_rows() -> Iterator[Row]:
    """Hood solves a step of three stiff joints, to the schemes' own tolerance; with the error,
    which is the step's and not the scheme's."""
    finger, drum = stiff_pair(3)
    fine = drive(Linear(), finger, drum, np.zeros(3), pulls_on_drum, FINE, round(LASTS / FINE))
    for name, (scheme, most, source) in ITERATION_BOUNDS.items():
        for dt in STEPS:
            n = round(LASTS / dt)
            states = drive(scheme, finger, drum, np.zeros(3), pulls_on_drum, dt, n)
            error = np.abs(angles_of(states) - angles_of(fine)[:: round(dt / FINE)]).max()
            what = f"hood solves a step (error {1e3 * error:.2f} mrad)"
            solves = (states[-1].solves - 1) / n
            yield Row(f"{THREE}, {name}, {1e3 * dt:g} ms", what, most, solves, 0.0, source, "bound")
