"""The one Newton: static equilibrium of the shell by minimising its potential energy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from cosim.port import ConvergenceError

from .assembly import DOFS, factorise
from .model import Configuration, Evaluation, ShellModel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NewtonOptions:
    """`tolerance` is relative to the largest nodal force; steps longer than `max_step` (m) or turning
    a director by more than `max_turn` (rad) are shortened."""

    tolerance: float = 1e-10
    max_iterations: int = 60
    max_step: float = 3e-3
    max_turn: float = 0.6


@dataclass(frozen=True)
class Solution:
    """A converged equilibrium; `factor` is that of the last tangent, at most one Newton step old."""

    configuration: Configuration
    evaluation: Evaluation
    tension: Array
    factor: spla.SuperLU
    iterations: int
    residual: float
    """Largest residual force, N (moments over the element size)."""


def length_scale(model: ShellModel) -> float:
    """Root of the mean element area, m."""
    return float(np.sqrt(model.tables.weight.sum() / len(model.quads)))


def residual_norm(model: ShellModel, e: Evaluation) -> tuple[float, float]:
    """Largest residual and largest nodal force, both N."""
    r = np.zeros(model.pattern.size)
    r[model.free] = e.reduced[model.free]
    nodal = np.abs(r.reshape(-1, DOFS))
    residual = max(nodal[:, :3].max(), nodal[:, 3:].max() / length_scale(model))
    forces = [np.abs(e.gradient_x).max(), np.abs(e.points.gradient).max(initial=0.0)]
    return float(residual), float(max(forces))


def worst_place(model: ShellModel, c: Configuration, e: Evaluation) -> str:
    """Where the largest residual sits, in words."""
    r = np.zeros(model.pattern.size)
    r[model.free] = e.reduced[model.free]
    node = int(np.argmax(np.abs(r.reshape(-1, DOFS)[:, :3]).max(axis=1)))
    near = "" if node not in e.points.node else ", which touches a bone or carries a spring"
    place = ", ".join(f"{v * 1e3:.2f}" for v in c.x[node])
    return f"node {node} at ({place}) mm{near}"


def newton_direction(
    model: ShellModel, e: Evaluation, shift: float
) -> tuple[Array, spla.SuperLU, float]:
    """Step (5n,), the factor and the slope of the energy along it; `shift` is added to the diagonal
    in units of its mean entries."""
    assert e.data is not None
    order = model.pattern.order
    data = e.data
    if shift:
        data = data.copy()
        diagonal = model.pattern.diagonal[:, np.arange(DOFS), np.arange(DOFS)]
        data[diagonal] += shift * np.abs(data[diagonal]).mean(axis=0)
    factor = factorise(model.pattern.free(data))
    free = -factor.solve(e.reduced[order])
    step = np.zeros(model.pattern.size)
    step[order] = free
    return step, factor, float(free @ e.reduced[order])


def _limited(step: Array, options: NewtonOptions) -> tuple[Array, float]:
    u = np.abs(step.reshape(-1, DOFS))
    longest = max(u[:, :3].max() / options.max_step, u[:, 3:].max() / options.max_turn)
    factor = 1.0 if longest <= 1 else 1 / longest
    return step * factor, factor


def solve(
    model: ShellModel, start: Configuration, tension: Array, options: NewtonOptions
) -> Solution:
    """Equilibrium near `start` under `tension` (nt,) N at the poses of `start`.

    Raises ConvergenceError naming the place of the largest residual."""
    c = start
    e = model.evaluate(c, tension, tangent=True)
    shift = 0.0
    for iteration in range(options.max_iterations):
        step, factor, slope = newton_direction(model, e, shift)
        residual, force = residual_norm(model, e)
        if residual <= options.tolerance * force:
            return Solution(c, e, tension, factor, iteration, residual)
        tries = 0
        while slope >= 0 and tries < 12:
            shift = max(1e-6, 10 * shift)
            step, factor, slope = newton_direction(model, e, shift)
            tries += 1
        step, scale = _limited(step, options)
        trial = _line_search(model, c, e, tension, step, slope * scale)
        if trial is None:
            if shift > 1.0:
                break
            shift = max(1e-6, 10 * shift)
            continue
        c, e = trial
        shift = 0.0 if shift < 1e-7 else shift / 10
    residual, force = residual_norm(model, e)
    raise ConvergenceError(
        f"the hood did not reach equilibrium in {options.max_iterations} iterations: the residual is "
        f"{residual:.2e} N against forces of {force:.2e} N, largest at {worst_place(model, c, e)}. "
        "Try smaller steps of posture or tension, a softer contact or a finer mesh."
    )


def _line_search(
    model: ShellModel,
    c: Configuration,
    e: Evaluation,
    tension: Array,
    step: Array,
    slope: float,
) -> tuple[Configuration, Evaluation] | None:
    """The first of the steps 1, 1/3, 1/9 ... that lowers the energy enough, or, where the energy is
    below its rounding error, the residual."""
    before = model.potential(c, e.energy, tension)
    norm = residual_norm(model, e)[0]
    noise = 1e-11 * max(abs(before), e.energy)
    factor = 1.0
    for _ in range(7):
        trial = model.stepped(c, e.bases, factor * step)
        there = model.evaluate(trial, tension, tangent=True)
        after = model.potential(trial, there.energy, tension)
        lower = after <= before + 1e-4 * factor * slope
        quiet = after <= before + noise and residual_norm(model, there)[0] < norm
        if lower or quiet:
            return trial, there
        factor /= 3
    return None


