"""Bodies that equilibrium moves, of our own shell: Newton's method on their motions alone, where
each of its steps ends at the sheet's equilibrium with the bodies there.

The wrench of the sheet on a body and its derivative by the bodies' twists are those that a hood
gives to a finger (`fe_solver.solver.body_coupling`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cosim.errors import ConvergenceError, InputError
from cosim.port import Array, rotation_matrix, skew
from fe_solver.job.job import RigidLoad
from fe_solver.solver.body_coupling import wrenches
from fe_solver.solver.mixed_steps import Prediction, predict_motion
from fe_solver.solver.model import Configuration
from fe_solver.solver.newton import Solution
from fe_solver.solver.residual import length_scale, residual_norm, rounding, stiffest_entry

NO_TENSION = np.zeros(0)
BALANCED = 1e-6
"""Share of the largest force up to which a body is in balance."""
BODY_ROUNDING = 30
"""Times a node's rounding error, that of the sum over the nodes which a body holds."""
MOST_STEPS = 60
MOST_SPIN = 0.25
"""rad that a body turns at most in one step."""
LOOSE, NONE = 1e-9, 1e-12
"""Shares of the largest resistance, and of that of the sheet beside the body, below which a motion
has none."""
MOTIONS = ("x", "y", "z", "Ru", "Rv", "Rw")

Reach = Callable[[Solution, Configuration, Prediction], Solution]
"""The sheet's equilibrium near a configuration, whose forces are predicted from a solution."""


def load_wrenches(loads: Sequence[RigidLoad], time: float, rotation: Array) -> tuple[Array, Array]:
    """The loads (nb, 6) N and N m on bodies turned by `rotation` (nb, 3, 3) at a time, and the
    forces (nb, 3) N of these that turn with their bodies."""
    out, follower = np.zeros((len(rotation), 6)), np.zeros((len(rotation), 3))
    for load in loads:
        force, moment = load.at(time)
        if load.follows:
            force = rotation[load.body] @ force
            follower[load.body] += force
        out[load.body] += np.concatenate([force, moment])
    return out, follower


def loose_words(name: str, time: float, body: str, motions: Sequence[str], tied: bool) -> str:
    """What is said of a body that can move without resistance."""
    carried = " with what is tied to it" if tied else ""
    return (
        f"{name}: at t = {time:.6g} the rigid body {body!r}{carried} can move freely "
        f"({', '.join(motions)}), and nothing resists it: the answer would be one of many. Fix or "
        "prescribe these motions, tie it to a sheet that is held, or give it springs that are taut "
        "or contact that presses"
    )


@dataclass(frozen=True)
class FreeBodies:
    """The bodies of a job that equilibrium moves, among the nb of its model."""

    motions: NDArray[np.bool_]
    """(nb, 6) which of their motions it finds."""
    loads: Callable[[float, Array], tuple[Array, Array]]
    """By time and rotations (nb, 3, 3), as `load_wrenches` returns."""
    longest: float
    """m that a body moves at most in one step."""

    def place(self, poses: tuple[Array, Array], last: Configuration) -> tuple[Array, Array]:
        """Poses of a time, with the motions that equilibrium finds where they were last."""
        turned = np.asarray(self.motions[:, 3:].any(axis=1))[:, None, None]
        position = np.where(self.motions[:, :3], last.position, poses[0])
        return position, np.where(turned, last.rotation, poses[1])

    def balance(self, solution: Solution, time: float, reach: Reach) -> Solution:
        """The equilibrium of sheet and bodies, from one of the sheet with the bodies near by.
        Raises ConvergenceError."""
        iterations = solves = 0
        for _ in range(MOST_STEPS):
            left, limit = self.unbalanced(solution, time)
            if np.abs(left).max() <= limit:
                iterations, solves = solution.iterations + iterations, solution.solves + solves
                return replace(solution, iterations=iterations, solves=solves)
            twists = self._twists(solution, time, left)
            c, m, e = solution.configuration, solution.model, solution.evaluation
            step = np.zeros(m.pattern.size)
            step[m.free] = solution.sensitivity[:, : twists.size] @ twists.ravel()
            turned = rotation_matrix(twists[:, 3:]) @ c.rotation
            moved = m.move_bodies(m.take_step(c, e.bases, step), c.position + twists[:, :3], turned)
            iterations += solution.iterations
            solves += solution.solves
            solution = reach(solution, *predict_motion(m, c, e, step, twists, moved))
        raise ConvergenceError(
            f"the bodies that are free found no balance in {MOST_STEPS} steps: "
            f"{np.abs(left).max():.2e} N are left, expected {limit:.2e} N"
        )

    def unbalanced(self, solution: Solution, time: float) -> tuple[Array, float]:
        """What does not balance (f,) N of the free motions, moments over an element's length; and
        how much may be left."""
        m, c, e = solution.model, solution.configuration, solution.evaluation
        borne = np.asarray(sum(wrenches(m, c, e, NO_TENSION).values()))
        loads, size = self.loads(time, c.rotation)[0], np.repeat([1.0, 1 / length_scale(m)], 3)
        largest = max(residual_norm(m, e)[1], float(np.abs(loads * size).max()))
        assert e.data is not None
        noise = BODY_ROUNDING * rounding(c, stiffest_entry(m, e.data))
        return ((borne + loads) * size)[self.motions], BALANCED * largest + noise

    def tangent(self, solution: Solution, time: float) -> Array:
        """The derivative (f, f) N/m of what does not balance by the free motions, turns times an
        element's length."""
        own, count = solution.coupling[1], self.motions.size
        by_follow = solution.residual_derivative.T @ solution.sensitivity
        tangent = own - by_follow[:count, :count]
        follower = self.loads(time, solution.configuration.rotation)[1]
        for i, force in enumerate(follower):
            tangent[6 * i : 6 * i + 3, 6 * i + 3 : 6 * i + 6] -= skew(force)
        size = np.tile(np.repeat([1.0, 1 / length_scale(solution.model)], 3), len(self.motions))
        free = self.motions.ravel()
        return np.asarray((size[:, None] * tangent * size)[free][:, free])

    def _twists(self, solution: Solution, time: float, left: Array) -> Array:
        """The step (nb, 6) m and rad of the bodies, no longer than allowed."""
        out = np.zeros(self.motions.shape)
        try:
            out[self.motions] = -np.linalg.solve(self.tangent(solution, time), left)
        except np.linalg.LinAlgError as error:
            raise ConvergenceError("a body that is free meets no resistance") from error
        out[:, 3:] /= length_scale(solution.model)
        turned = float(np.linalg.norm(out[:, 3:], axis=1).max())
        way = float(np.linalg.norm(out[:, :3], axis=1).max())
        return out / max(1.0, turned / MOST_SPIN, way / self.longest)

    def check(self, solution: Solution, time: float, name: str) -> None:
        """Check that every motion meets resistance.  Raises InputError naming the body."""
        _, size, ways = np.linalg.svd(self.tangent(solution, time))
        if size[-1] > max(LOOSE * size[0], NONE * float(np.abs(solution.coupling[1]).max())):
            return
        moved = np.zeros(self.motions.shape)
        moved[self.motions] = np.abs(ways[-1])
        body, m = int(moved.max(axis=1).argmax()), solution.model
        free = [n for n, v in zip(MOTIONS, moved[body], strict=True) if v > 0.1 * moved.max()]
        tied = bool((m.ties.body == body).any() or (m.guides.body == body).any())
        raise InputError(loose_words(name, time, m.bodies[body], free, tied))
