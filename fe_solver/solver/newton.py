"""The one Newton: static equilibrium of the shell by minimising its potential energy."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cosim.errors import ConvergenceError, pulse
from cosim.port import Array
from fe_solver.forces.springs import ROPE
from fe_solver.solver.assembly import DOFS
from fe_solver.solver.body_coupling import common_twist, coupling, rigid_motion
from fe_solver.solver.linear_algebra import (
    FREE,
    Factor,
    NotPositiveDefiniteError,
    has_mechanism,
)
from fe_solver.solver.mixed_steps import MixedSteps, Prediction, Settle, take_mixed_steps
from fe_solver.solver.model import Configuration, Evaluation, ShellModel
from fe_solver.solver.newton_step import (
    active_set_step,
    descent_step,
    factorise,
    last_factorised,
    limit_step,
    limit_to_contact,
)
from fe_solver.solver.residual import (
    ITERATION,
    director_cosines,
    is_folded,
    residual_norm,
    rounding,
    stiffest_entry,
)

STUCK = 30
"""A residual up to so many limits that no step lowers is rounding error too."""
CONSISTENT_BELOW = 0.1
"""Step size, against the longest step allowed, below which the tangent is the consistent one."""
CHORDS = 2
"""Iterations with an old factor that cost no more than one with a new tangent."""
SMOOTHER = (1e-2, 1e-3, 1e-4, 1e-5)
"""Strains by which tension fields are smoothed, one after the other, on the way to their own."""
NEARLY = 0.05
"""Residual over the largest force beyond which the load is too far, and no smoothing helps."""
KEPT = 3e-3
"""Residual after over before such an iteration, where no iteration has told it yet."""
SHORTEST = 1e-3
"""m from a tendon's end on the hood to its eyelet, at least."""


@dataclass(frozen=True)
class NewtonOptions:
    """When Newton's method is done, and how far a step goes at most."""

    tolerance: float = 1e-10
    """Residual, relative to the largest nodal force, at which it is done."""
    max_iterations: int = 200
    """Steps after which it gives up."""
    max_step: float = 3e-3
    """m that a node moves at most in a step."""
    max_turn: float = 0.6
    """rad that a director turns at most in a step."""


@dataclass(frozen=True)
class Solution:
    """A converged equilibrium."""

    model: ShellModel
    configuration: Configuration
    evaluation: Evaluation
    tension: Array
    """(nt,) N."""
    iterations: int
    """Newton steps."""
    solves: int
    """Linear solves: one an iteration, and those that predicted contacts."""
    residual: float
    """Largest residual force, N (moments over the element size)."""

    @cached_property
    def factor(self) -> Factor:
        """Factor of the consistent tangent's free part, computed when it is first asked for."""
        assert self.evaluation.data is not None
        return factorise(self.model, self.evaluation.data)

    @cached_property
    def coupling(self) -> tuple[Array, Array, Array, Array]:
        """The derivatives that `body_coupling.coupling` returns."""
        return coupling(self.model, self.configuration, self.evaluation, self.tension)

    @cached_property
    def residual_derivative(self) -> Array:
        """The residual's derivative (free, 6nb + nt) by the bodies' twists and the tensions."""
        by_motion, _, by_tension, _ = self.coupling
        return np.hstack([by_motion, by_tension])[self.model.free]

    @cached_property
    def sensitivity(self) -> Array:
        """The derivative (free, 6nb + nt) of the free degrees of freedom by the bodies' twists and
        the tensions.  What moves with all the bodies as one is known, so that the first body's
        twists follow from those of the others, unless loads or inertia stand fast in the world."""
        m, c = self.model, self.configuration
        if any(loads is not None for loads in (m.dead, m.couples, m.inertia)):
            return -self.factor.solve(self.residual_derivative)
        out, twists = np.empty_like(self.residual_derivative), common_twist(c)[6:]
        out[:, 6:] = -self.factor.solve(self.residual_derivative[:, 6:])
        out[:, :6] = rigid_motion(m, c, self.evaluation.bases)[m.free]
        out[:, :6] -= out[:, 6 : 6 + len(twists)] @ twists
        return out


def is_equilibrium(solution: Solution, tolerance: float) -> bool:
    """Whether a solution that was written elsewhere is one: its directors are of length one, tied
    and guided nodes lie where the bodies have them, and its residual, computed anew, is what it
    says and at most what `solve` leaves at that `tolerance`."""
    model, c, e = solution.model, solution.configuration, solution.evaluation
    assert e.data is not None
    residual, force = residual_norm(model, e)
    noise = rounding(c, stiffest_entry(model, e.data))
    held = model.move_bodies(c, c.position, c.rotation)
    straight = np.abs(np.linalg.norm(c.d, axis=1) - 1.0).max(initial=0.0) <= 1e-9
    is_held = np.abs(held.d - c.d).max() <= 1e-9 and np.abs(held.x - c.x).max() <= 1e-12
    is_stated = abs(residual - solution.residual) <= 1e-3 * solution.residual + noise
    is_balanced = residual <= STUCK * (tolerance * force + noise)
    return bool(straight and is_held and is_stated and is_balanced)


class _StuckError(ConvergenceError):
    """No step lowers the energy, or too many were taken; `share` of the largest force is left."""

    def __init__(self, words: str, share: float = 1.0) -> None:
        super().__init__(words)
        self.share = share


@dataclass(frozen=True)
class _Chord:
    """An old tangent."""

    factor: Factor
    data: Array
    since: float | None = None
    """N, the residual from which it led to the present one; None before its first use."""

    def is_worthwhile(self, residual: float, limit: float) -> bool:
        """Whether the rate at which it lowers the residual is enough to end before a new tangent
        would."""
        rate = KEPT if self.since is None else residual / self.since
        return residual * rate**CHORDS <= limit


def worst_place(model: ShellModel, c: Configuration, e: Evaluation) -> str:
    """Where the largest residual sits, in words: node, region, and what presses or pulls there."""
    r = np.zeros(model.pattern.size)
    r[model.free] = e.reduced[model.free]
    node = int(np.argmax(np.abs(r.reshape(-1, DOFS)[:, :3]).max(axis=1)))
    place = f"{model.node_name(node)} at ({', '.join(f'{v * 1e3:.2f}' for v in c.x[node])}) mm"
    if model.regions:
        quad = int(np.flatnonzero((model.quads == node).any(axis=1))[0])
        place += f" in the region {model.regions[quad]}"
    p = e.points
    acting = np.flatnonzero((p.node == node) & p.gradient.any(axis=1))
    said: dict[str, None] = {}
    for body, group in zip(p.body[acting], p.group[acting], strict=True):
        name = model.groups[group] if 0 <= group < len(model.groups) else str(group)
        what = "in contact with" if group < 0 else f"pulled by the springs {name} to"
        if group == ROPE:
            what = "pulled by a tendon to its eyelet in"
        said[f"{what} the body {model.bodies[body]}"] = None
    return ", ".join((place, *said))


def solve(
    model: ShellModel,
    start: Configuration,
    tension: Array,
    options: NewtonOptions,
    near: bool = False,
    before: Solution | None = None,
    forces: Prediction | None = None,
    settle: Settle | None = None,
) -> Solution:
    """Solve for an equilibrium near `start` under `tension` (nt,) N at the poses of `start`, and
    return it with its residual.

    From afar it begins with the whole steps of `fe_solver.solver.mixed_steps`, and goes on from
    where they lead by a search for less energy; from `near` it searches at once.  The tangent is
    the convex one far from equilibrium, and near it the consistent one.  With `before`, an
    equilibrium of the same model close by, a factor serves again (a chord iteration) while it
    lowers the residual fast, and that of `before` serves first; the residual then ends nearer to
    the tolerance than Newton's own iterations leave it.  With the `forces` that `before` predicts
    at `start` (`predict_motion`) it begins with a few whole steps from these.  In whole steps the
    model may `settle`; the solution has the one that it became.

    Where a sheet without compression comes near one only, it is sought with tension fields that are
    smoother at first (`SMOOTHER`).

    Raises ConvergenceError naming the place of the largest residual, or of an element that `start`
    crushes beyond what its material admits.

    >>> import numpy as np
    >>> from fe_solver.solver.newton import NewtonOptions, solve
    >>> from tests.proofs.fe.sheets import at_rest, clamp, guide, plate, sheet
    >>> points, quads = plate(20e-3, 5e-3, 4, 1)  # m: x from 0 to 20 mm
    >>> strip = clamp(sheet(points, quads, 100e6, 0.0, 0.5e-3), np.array([0, 1]))
    >>> model = guide(strip, [np.array([8, 9])], [(1.0, 0.0, 0.0)])  # one tendon, along x
    >>> found = solve(model, at_rest(model), np.array([2.5]), NewtonOptions())
    >>> f"{1e3 * (found.configuration.x[8, 0] - 20e-3):.3f} mm"
    '0.197 mm'
    """
    try:
        return _solve(model, start, tension, options, near, before, forces, settle)
    except _StuckError as stuck:
        wanted = model.section.smoothing
        if wanted is None or wanted >= SMOOTHER[0] or stuck.share > NEARLY:
            raise
    c, iterations, solves = start, 0, 0
    for smoothing in (*(s for s in SMOOTHER if s > wanted), wanted):
        easier = model.with_changes(section=model.section.with_smoothing(smoothing))
        solution = _solve(easier, c, tension, options, c is not start)
        c = solution.configuration
        iterations, solves = iterations + solution.iterations, solves + solution.solves
    return replace(solution, model=model, iterations=iterations, solves=solves)


def _solve(
    model: ShellModel,
    start: Configuration,
    tension: Array,
    options: NewtonOptions,
    near: bool = False,
    previous: Solution | None = None,
    forces: Prediction | None = None,
    settle: Settle | None = None,
) -> Solution:
    begun = MixedSteps(model, start, 0, 0)
    if not near or forces is not None:
        limits = options.max_iterations, options.tolerance, options.max_step, options.max_turn
        begun = take_mixed_steps(model, start, tension, *limits, forces, settle)
    search = _Search(tension, options, previous, begun, not near and begun.configuration is start)
    for iteration in range(begun.iterations, options.max_iterations + 1):
        if search.is_balanced():
            return search.solution(iteration)
        pulse(ITERATION, iteration, search.residual, search.force)
        if iteration == options.max_iterations or not (
            search.take_chord() or search.take_newton_step() or search.take_other_tangent()
        ):
            break
    if search.is_rounding:
        return search.solution(iteration)
    raise search.failure(iteration)


class _Search:
    """Newton's method on its way: where it stands, what it knows there, and its moves."""

    def __init__(
        self,
        tension: Array,
        options: NewtonOptions,
        previous: Solution | None,
        begun: MixedSteps,
        convex: bool,
    ) -> None:
        model = begun.model
        self.model, self.tension, self.options = model, tension, options
        self.previous, self.c, self.solves = previous, begun.configuration, begun.solves
        self.convex = convex
        """Whether the tangent here is the convex one."""
        self.stuck = self.given_up = False
        """Whether no step descends by this tangent; by either."""
        self.chord = None if begun.iterations else _chord_of(previous)
        self.factor = begun.factor or (previous.factor if previous else None)
        """A tangent near by, of a solution that follows a known one: it serves where a
        factorisation is dear."""
        known = begun.evaluation
        if known is None or known.convex:
            known = model.evaluate(self.c, tension, self.chord is None, convex)
        self.e = known
        data = self.chord.data if self.chord else self.e.data
        self.stiffest = 0.0 if data is None else stiffest_entry(model, data)
        if np.isinf(self.e.elements.energy):
            place = _crushed_place(model, self.c)
            raise _StuckError(f"the solve starts with the sheet crushed {place}")

    def is_balanced(self) -> bool:
        """Whether the residual is small, by the consistent tangent's rounding error too."""
        self._measure()
        if self.residual > self.limit:
            return False
        self.e, self.convex = self._consistent(), False
        assert self.e.data is not None
        self.stiffest = stiffest_entry(self.model, self.e.data)
        self._measure()
        return self.residual <= self.limit

    def _measure(self) -> None:
        self.residual, self.force = residual_norm(self.model, self.e)
        self.limit = self.options.tolerance * self.force + rounding(self.c, self.stiffest)

    def _consistent(self) -> Evaluation:
        """The evaluation with its consistent tangent."""
        if self.e.convex:
            return self.model.evaluate(self.c, self.tension, tangent=True)
        return self.model.with_tangent(self.c, self.e)

    def take_chord(self) -> bool:
        """Take the whole step that an old tangent's factor gives, while such steps lower the
        residual fast enough, if it is short and halves the residual."""
        chord, model = self.chord, self.model
        if chord is None or self.convex or not chord.is_worthwhile(self.residual, self.limit):
            return False
        self.solves += 1
        step = np.zeros(model.pattern.size)
        try:
            step[model.free] = -chord.factor.solve(self.e.reduced[model.free])
        except NotPositiveDefiniteError:
            return False
        if (
            not limit_step(step, self.options.max_step, self.options.max_turn)[1]
            <= CONSISTENT_BELOW
        ):
            return False
        trial = model.take_step(self.c, self.e.bases, step)
        balance = model.evaluate(trial, self.tension, tangent=False)
        if not _halves_residual(model, self.e, balance):
            return False
        self.c, self.e, self.chord = trial, balance, replace(chord, since=self.residual)
        return True

    def take_newton_step(self) -> bool:
        """Take a step by a new tangent, damped where parts of the sheet may be slack, as far along
        it as the energy falls."""
        longest = self.options.max_step, self.options.max_turn
        self.e = self.model.with_tangent(self.c, self.e)
        data = self.e.data
        assert data is not None
        self.stiffest = stiffest_entry(self.model, data)
        step, factor = descent_step(self.model, data, self.e.reduced, *longest, self.factor)
        self.solves += 1
        if self.factor is not None:
            self.factor = last_factorised(factor, self.factor)
        if not self.descend(step):
            return False
        # a new tangent's error is quadratic, so that its second use lowers it half as far
        again = self.previous is not None and factor is not None
        self.chord = _Chord(factor, data, self.residual / 2) if again and factor else None
        self.stuck = False
        return True

    def descend(self, step: Array) -> bool:
        """Go along the step: all of it, or a part of the step that predicts contacts, or of the
        step as it is; where none descends, nowhere.  A search that follows an equilibrium presses
        the nodes of the whole step."""
        whole = step if self.factor is None else limit_to_contact(self.model, self.e, step)
        moved, left = self._go_along(whole, 1)
        if moved:
            return True
        way, solves = active_set_step(self.model, self.e, step, self.factor)
        self.solves += solves
        if solves:
            return self._go_along(way, 4, convex=True)[0] or self._go_along(step, 7, left)[0]
        moved, left = self._go_along(step, 3, left, convex=True)
        return moved or self._go_along(step, 4, left)[0]

    def _go_along(
        self, step: Array, tries: int, first: float = 1.0, convex: bool = False
    ) -> tuple[bool, float]:
        """Go to the first of ever shorter steps, from `first` of it on, that descends; and the part
        to go on from.  A long step's end has the `convex` tangent in any case."""
        step, size = limit_step(step, self.options.max_step, self.options.max_turn)
        convex = convex or size > CONSISTENT_BELOW
        place = self.model, self.c, self.e, self.tension
        reached, left = _line_search(*place, step, tries, convex, first)
        if reached is not None:
            (self.c, self.e), self.convex = reached, convex
        return reached is not None, left

    def take_other_tangent(self) -> bool:
        """Where nothing descends, try the other tangent once, and then give up."""
        if self.stuck:
            self.given_up = True
            return False
        self.stuck, self.convex, self.chord = True, not self.convex, None
        self.e = self.model.evaluate(self.c, self.tension, tangent=True, convex=self.convex)
        return True

    @property
    def is_rounding(self) -> bool:
        """Whether the residual that no step lowers is rounding error."""
        return self.given_up and self.residual <= STUCK * self.limit

    def solution(self, iterations: int) -> Solution:
        """The equilibrium here.  Raises ConvergenceError for one that no sheet has."""
        place = self.model, self.c, self._consistent(), self.tension
        return _checked(Solution(*place, iterations, self.solves, self.residual))

    def failure(self, iterations: int) -> ConvergenceError:
        """What kept it from an equilibrium, in words.  Raises ConvergenceError for a tendon that is
        drawn up to its eyelet."""
        model, c, e = self.model, self.c, self.e
        _check_ropes(model, c)
        return _StuckError(
            f"the hood did not reach equilibrium in {iterations} iterations: the residual is "
            f"{self.residual:.2e} N against forces of {self.force:.2e} N, largest at "
            f"{worst_place(model, c, e)}. {_advice(model, model.with_tangent(c, e))}",
            self.residual / self.force,
        )


def _chord_of(previous: Solution | None) -> _Chord | None:
    if previous is None:
        return None
    assert previous.evaluation.data is not None
    return _Chord(previous.factor, previous.evaluation.data)


def _halves_residual(model: ShellModel, before: Evaluation, after: Evaluation) -> bool:
    halved = residual_norm(model, after)[0] < residual_norm(model, before)[0] / 2
    return halved and bool(np.isfinite(after.energy))


def _crushed_place(model: ShellModel, c: Configuration) -> str:
    """Where a strain is beyond what the material admits, in words, and what to try."""
    y = np.concatenate([c.x[model.quads], c.d[model.quads]], axis=1)
    energy = model.section.response(model.tables.strain(y)).energy
    quad = int(np.flatnonzero(~np.isfinite(energy).all(axis=1))[0])
    place = f"at {model.node_name(model.quads[quad, 0])}"
    if model.regions:
        place += f" in the region {model.regions[quad]}"
    return f"{place}. Try smaller steps of posture or tension, or another mesh."


def _check_ropes(model: ShellModel, c: Configuration) -> None:
    """Check that no rope is drawn up to its eyelet: there its line has no direction, and what it
    does to the hood jumps.  Raises ConvergenceError for one that is."""
    r = model.ropes
    length, _ = r.lines(c.x, c.position, c.rotation)
    if length.min(initial=np.inf) < SHORTEST:
        rope = int(length.argmin())
        raise ConvergenceError(
            f"{r.name(rope)}: its end on the hood, {model.node_name(r.node[rope])}, is drawn up to "
            f"the eyelet in the body {model.bodies[r.body[rope]]}: {1e3 * length[rope]:.3g} mm are "
            f"left between them, expected at least {1e3 * SHORTEST:g} mm. Lower its tension, or "
            "give it a stiffer hood"
        )


def _checked(solution: Solution) -> Solution:
    """The solution, unless a tendon is drawn up to its eyelet or a director has turned through the
    plane of an element: the discrete sheet has equilibria with elements folded back on their
    neighbours, which no sheet has.

    Raises ConvergenceError naming the place."""
    _check_ropes(solution.model, solution.configuration)
    model, facing = solution.model, director_cosines(solution.model, solution.configuration)
    if facing.min(initial=1.0) > 0:
        return solution
    raise ConvergenceError(
        f"the hood came to rest with a director turned through an element's plane, at "
        f"{model.node_name(model.quads.ravel()[facing.argmin()])}: no sheet does that. Try smaller "
        "steps of posture or tension, or a finer mesh."
    )


def _advice(model: ShellModel, e: Evaluation) -> str:
    assert e.data is not None
    if has_mechanism(e.data, model.pattern.slots):
        return f"The tangent stiffness is singular: {FREE}"
    return "Try smaller steps of posture or tension, a softer contact or a finer mesh."


def _line_search(
    model: ShellModel,
    c: Configuration,
    e: Evaluation,
    tension: Array,
    step: Array,
    tries: int,
    convex: bool,
    factor: float,
) -> tuple[tuple[Configuration, Evaluation] | None, float]:
    """The first of ever shorter steps, from `factor` of the step on, that lowers the energy enough,
    or, where the energy is below its rounding error, the residual; none turns a director into an
    element's plane.  Also the factor to go on from."""
    slope = float(step @ e.reduced)
    start_energy = model.potential(c, e.energy, tension)
    noise = 1e-11 * max(abs(start_energy), e.energy)
    for _ in range(tries if slope < 0 else 0):
        trial = model.take_step(c, e.bases, factor * step)
        if is_folded(model, trial) and not is_folded(model, c):
            factor *= 0.5
            continue
        balance = model.evaluate(trial, tension, tangent=False, convex=convex)
        rise = model.potential(trial, balance.energy, tension) - start_energy
        rise -= float(np.vdot(e.follower + balance.follower, trial.x - c.x)) / 2
        if rise <= 1e-4 * factor * slope or (rise <= noise and _halves_residual(model, e, balance)):
            return (trial, balance), factor
        parabola = -slope * factor**2 / (2 * (rise - slope * factor))
        factor = float(np.clip(parabola, 0.1 * factor, 0.5 * factor))
    return None, factor
