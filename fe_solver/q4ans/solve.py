"""Solving a job with `q4ans` elements: steps in time that grow and shrink by themselves.

A step is predicted by one back-substitution for what moves and for what the loads change, solved by
whole Newton steps, and halved where Newton fails.  A sheet that bends far is nearly inextensible:
no search for less residual follows that valley, whole steps leave it and come back.  Their tangent
has the stress that the last step predicted (see `fe_solver.solver.mixed_steps`), or the stress of
their error would keep them short.  Where there is contact, or springs that may be slack, the first
are kept short, so that these close and become taut before the sheet has swung past them.
"""

from __future__ import annotations

import time as clock
from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from cosim.errors import ConvergenceError, InputError
from cosim.port import Array
from cosim.processes import one_blas_thread
from fe_solver.job.free_bodies import MOTIONS, loose_words
from fe_solver.job.job import Job
from fe_solver.job.model import JobOptions
from fe_solver.job.phases import Phase
from fe_solver.job.rigid_modes import FreeMotions, Pieces, free_motions, unsupported
from fe_solver.job.solve import (
    ContactRecord,
    JobResult,
    JobState,
    checked_phases,
    output_times,
    touches,
    way_marks,
)
from fe_solver.q4ans.balance import Loads, Term, turns
from fe_solver.q4ans.bodies import BodyFactor, BodySystem, SingularError
from fe_solver.q4ans.facets import SEARCH_RADIUS, facet_gaps, facet_ways, nearest
from fe_solver.q4ans.model import (
    SolidModel,
    next_model,
    obstacles,
    solid_model,
)
from fe_solver.q4ans.state import SolidEquilibrium, solid_state
from fe_solver.solver.continuation import Effort, TimeSteps, free_share
from fe_solver.solver.linear_algebra import Factor, has_mechanism, positions
from fe_solver.vectors import cross

RESIDUAL_TOLERANCE = 1e-7
"""Residual over the largest force at a spring, in contact or of all reactions."""
MOST_ITERATIONS = 40
MOST_WHOLE = 25
"""Rounds of whole steps, after which short ones are tried."""
FIRST_STEP = 0.1
"""Share of the thickness: no node moves further in the first iteration, nor more than twice as far
in the next as in the last."""
SEARCHED = (1e-6, 1e-2)
"""Residuals over forces between which a step must lower the residual: there only contact that
opens and closes keeps Newton from the end."""
WHOLE_ITERATIONS = 12
"""Iterations after which every step must."""
HALVINGS = 5
SOFTER = (0.01, 0.1)
"""Shares of contact's penalty, taken one after the other where the first step from rest fails."""
TURN = 0.25
"""rad that a body turns at most in one step in time."""
QUICK = 20
"""Iterations up to which the next step is twice as long."""
SEARCHES = 10
"""Iterations after which contact keeps to the triangles that it has met, as FEBio's seg_up asks: a
point that slides over a bone's sharp edge would come and go for ever."""
MOST_AUGMENTATIONS = 30
MOST_SPIN = 1.2
"""rad that a body which equilibrium moves turns at most in the first whole step of an equilibrium:
what goes further is far from what the step predicts."""
FINEST = 0.25e-3
"""m: a step is foreseen to press a facet in by up to the thickness, or so much of a thin sheet."""


def alternatives(job: Job) -> list[str]:
    """What to try where our own shell finds no equilibrium of a job: this one where it can."""
    return [] if obstacles(job) else ["--element q4ans (FEBio's shell and contact)"]


@one_blas_thread()
def solve_solid(
    job: Job,
    until: float | None = None,
    options: JobOptions | None = None,
    times: Sequence[float] | None = None,
) -> JobResult:
    """Static equilibria of a job with `q4ans` elements at `times`, or else at the ends and
    must-points of its steps, up to `until`; see `solve_job`.  Of the options it follows
    `penetration` (None is FEBio's penalty alone), `shortest` and `increments`.

    Raises InputError for a job that these elements do not cover, for times that do not ascend from
    above 0 and for a sheet that could move without resistance, and ConvergenceError naming the
    time and the place."""
    options = options or JobOptions(penetration=None)
    began = clock.process_time()
    wanted = output_times(job, until, times)
    first, *later = checked_phases(job)
    stepper = _SolidSteps(solid_model(first.job), options, first, len(job.contacts))
    setup = clock.process_time() - began
    began = clock.process_time()
    marks, states = way_marks(job, wanted[-1], options.increments), list[JobState]()
    for phase in (first, *later):
        if phase.begin < wanted[-1]:
            stepper.enter(phase)
            states += stepper.visit(phase.marks(marks), phase.within(wanted))
    effort = stepper.total(clock.process_time() - began)
    told = touches(job, stepper.contact)
    return JobResult(job, tuple(states), setup, effort, "q4ans", told)


class _TurnsFarError(ConvergenceError):
    """A body turns too far in one step."""


class _SolidSteps(TimeSteps[JobState]):
    """The equilibria of a job's `q4ans` elements."""

    def __init__(self, model: SolidModel, options: JobOptions, phase: Phase, pairs: int) -> None:
        super().__init__(options.shortest, TURN, QUICK)
        self.options, self.contact = options, ContactRecord(pairs)
        self._begin(model, phase, model.rest, 0.0, None)

    def _begin(
        self,
        model: SolidModel,
        phase: Phase,
        z: Array,
        residual: float,
        multipliers: tuple[Array | float, ...] | None,
    ) -> None:
        """Stand at an equilibrium z (2n, 3) m of a model at the begin of its phase."""
        self.model, self.phase = model, phase
        loads = model.at(phase.begin, multipliers)
        terms = tuple(model.terms(z, loads))
        self.pattern = model.pattern(terms)
        self.last = SolidEquilibrium(phase.begin, z, loads, terms, residual)
        self.factor: tuple[SolidEquilibrium, Factor] | None = None

    def enter(self, phase: Phase) -> None:
        """Go on with the conditions of a phase."""
        if phase is self.phase:
            return
        last = self.last
        kept = dict(zip(self.phase.pairs, last.loads.multipliers, strict=True))
        multipliers = tuple(kept.get(pair, 0.0) for pair in phase.pairs)
        model = next_model(phase, last.z, last.loads, multipliers)
        self._begin(model, phase, last.z, last.residual, multipliers)
        self.stride, self.failed = np.inf, False

    def finish(self) -> None:
        """See `TimeSteps.finish`."""
        self._augment()
        self._require_supports()

    def state(self, effort: Effort) -> JobState:
        """See `TimeSteps.state`."""
        return solid_state(self.model, self.last, effort)

    def solve_step(self, time: float, is_last: bool) -> None:
        """From rest, where nothing tells which points will touch, by softer contact if not at
        once."""
        z, loads = self._predict(time)
        try:
            self._accept(self._equilibrium(self.model, z, loads, time))
            return
        except SingularError as error:
            if not self.effort.steps:
                raise self._loose(error, self.time) from error
            raise
        except ConvergenceError:
            if self.effort.steps or not self.model.facets:
                raise
        for share in SOFTER:
            found = self._equilibrium(self.model.with_penalty(share), z, loads, time)
            z, loads = found.z, found.loads
        self._accept(self._equilibrium(self.model, z, loads, time))

    def _loose(self, error: SingularError, time: float) -> InputError:
        """The error for bodies that can move without resistance."""
        job, bodies = self.model.job, self.model.bodies
        assert bodies is not None
        moved = np.abs(error.bodies) * np.repeat([1.0, bodies.length], 3)
        body = int(moved.max(axis=1).argmax())
        motions = [n for n, m in zip(MOTIONS, moved[body], strict=True) if m > 0.1 * moved.max()]
        tied = bool((bodies.tied == body).any())
        return InputError(loose_words(job.name, time, job.bodies[body].name, motions, tied))

    def _accept(self, found: SolidEquilibrium) -> None:
        if self.model.bodies is not None and self._share(found.z, found.loads) < 1.0:
            raise ConvergenceError("A free body goes too far in a step, past what it touches")
        self.last = found
        pressed = self.model.contacts(found.z, found.loads)
        self.contact.add(
            self.phase.pairs,
            [bool((p.pressure > 0).any()) for p in pressed],
            [nearest(p.depth) for p in pressed],
        )

    def free_share(self, time: float) -> float:
        """See `TimeSteps.free_share`."""
        m, last = self.model, self.last
        if not m.facets:
            return 1.0
        new = m.at(time, last=last.loads)
        still = np.array_equal(last.loads.position, new.position)
        still &= np.array_equal(last.loads.rotation, new.rotation)
        if still and np.array_equal(m.place(last.z, new), last.z):
            return 1.0
        return self._share(*self._predict(time))

    def _share(self, z: Array, new: Loads) -> float:
        """The share of the way to nodes z (2n, 3) m and loads on which nothing is passed
        through."""
        m, last = self.model, self.last
        if not m.facets:
            return 1.0
        moved = z - last.z
        reach = min(max(m.thickness, FINEST), SEARCH_RADIUS / 2)
        far, way = [], 0.0
        for f in m.facets:
            ways = facet_ways(
                f,
                (last.z, last.loads.position[f.body], last.loads.rotation[f.body]),
                (last.z + moved, new.position[f.body], new.rotation[f.body]),
            )
            far.append(f.take(np.flatnonzero(ways > reach)))
            way = max(way, float(ways.max(initial=0.0)))

        def gaps(share: float) -> Array:
            z, poses = last.z + share * moved, m.poses(share, last.loads, new)
            found = [facet_gaps(f, z, *(p[f.body] for p in poses)) for f in far if len(f.quads)]
            return np.concatenate([g.ravel() for g in found])

        return free_share(gaps, way, reach)

    def solve_at_last(self, time: float, is_last: bool, error: ConvergenceError) -> None:
        """Give up, as nothing is left to try.  Raises ConvergenceError."""
        e = self.effort
        raise ConvergenceError(
            f"{self.model.job.name}: no equilibrium of q4ans elements was found at t = {time:.6g}, "
            f"after {e.steps} steps up to t = {self.last.time:.6g} and {e.failures} that failed. "
            f"{error}."
        ) from error

    def largest_turn(self, time: float) -> float:
        """See `TimeSteps.largest_turn`."""
        last = self.last.loads
        turned = turns(last.rotation, self.model.at(time, last=last).rotation)
        return float(np.linalg.norm(turned, axis=1).max(initial=0.0))

    def _factorise(self, terms: Sequence[Term]) -> Factor:
        self.effort = self.effort.plus(solves=1)
        return self.pattern.factorise(terms)

    def _predict(self, time: float) -> tuple[Array, Loads]:
        """First-order prediction of the equilibrium at a time, and its loads.

        A body that moves by w leaves the forces on it as they would be if the nodes moved by -w and
        all turned with it.  From rest, where no spring is taut yet, loads are left to Newton."""
        m, last = self.model, self.last
        new = m.at(time, last.loads.multipliers, last.loads)
        given = m.place(last.z, new) - last.z
        if m.bodies is not None:
            return self._predict_with(m.bodies, new, given)
        right = np.zeros_like(last.z)
        if self.effort.steps:
            right[:] = last.loads.dead - new.dead
        turn = turns(last.loads.rotation, new.rotation)
        shift = new.position - last.loads.position
        for t in last.terms:
            moved = given[t.nodes]
            if t.body is not None and len(t.body):
                arm = last.z[t.nodes] - last.loads.position[t.body][:, None]
                spin = np.broadcast_to(turn[t.body][:, None], arm.shape)
                moved = moved - shift[t.body][:, None] - cross(spin, arm)
                np.add.at(right, t.nodes, cross(spin, t.force))
            np.add.at(right, t.nodes, t.product(moved))
        if not right[m.free].any():
            return last.z + given, new
        if self.factor is None or self.factor[0] is not last:
            self.factor = last, self._factorise(last.terms)
        step = np.zeros_like(last.z)
        step[m.free] = -self.factor[1].solve(right[m.free])
        return m.place(last.z + given + step, new), new

    def _predict_with(self, bodies: BodySystem, new: Loads, given: Array) -> tuple[Array, Loads]:
        """The same, with bodies that equilibrium moves."""
        m, last = self.model, self.last
        twists = np.hstack(
            [new.position - last.loads.position, turns(last.loads.rotation, new.rotation)]
        )
        motion = np.concatenate([given.ravel(), twists.ravel()])
        if not motion.any():
            return last.z, new
        factor = self._body_factor(bodies, last.z, last.loads, last.terms)
        right = factor.full @ motion
        nodes, twists = bodies.split(factor.step(factor.spread.T @ right))
        new = new.carry(twists)
        return m.place(last.z + given + nodes, new), new

    def _body_factor(
        self, bodies: BodySystem, z: Array, loads: Loads, terms: Sequence[Term]
    ) -> BodyFactor:
        self.effort = self.effort.plus(solves=1)
        return self.model.body_factor(bodies, z, loads, terms)

    def _step(
        self, m: SolidModel, z: Array, loads: Loads, terms: Sequence[Term], left: Array
    ) -> tuple[Array, Array]:
        """The steps of the nodes (2n, 3) m and of the bodies (nb, 6) m and rad."""
        if m.bodies is not None:
            factor = self._body_factor(m.bodies, z, loads, terms)
            return m.bodies.split(factor.step(left))
        step = np.zeros_like(z)
        step[m.free] = -self._factorise(terms).solve(left)
        return step, np.zeros((len(loads.position), 6))

    def _equilibrium(self, m: SolidModel, z: Array, loads: Loads, time: float) -> SolidEquilibrium:
        """By whole steps where nothing opens and closes, or else by short ones.  Raises
        ConvergenceError."""
        if not m.facets and not np.any(m.springs.tension_only):
            try:
                return self._by_newton(m, z, loads, time, MOST_WHOLE, short=False)
            except _TurnsFarError:
                raise
            except ConvergenceError:
                pass
        return self._by_newton(m, z, loads, time, MOST_ITERATIONS, short=True)

    def _by_newton(
        self, m: SolidModel, z: Array, loads: Loads, time: float, most: int, short: bool
    ) -> SolidEquilibrium:
        """By up to `most` iterations, of which short ones begin short and are searched along.
        Raises ConvergenceError."""
        with np.errstate(all="ignore"):
            terms = tuple(m.terms(z, loads))
            for iteration in range(most):
                force, left = unbalanced = m.unbalanced(z, loads, terms)
                missed, scale = unbalanced.size, m.scale(force, terms)
                if missed <= RESIDUAL_TOLERANCE * scale or missed <= m.rounding(z, terms):
                    terms = tuple(m.terms(z, loads))
                    return SolidEquilibrium(time, z, loads, terms, missed)
                if not np.isfinite(missed):
                    break
                if iteration == SEARCHES:
                    loads = m.search_contacts(z, loads)
                step, twists = self._step(m, z, loads, terms, left)
                turned = float(np.linalg.norm(twists[:, 3:], axis=1).max(initial=0.0))
                share, searched = 1.0, False
                if not short and iteration == 0 and turned > MOST_SPIN:
                    raise _TurnsFarError(f"A body turns by {turned:.3g} rad in one step")
                if short:
                    longest = FIRST_STEP * 2.0**iteration * m.thickness
                    way = [np.abs(step).max(), np.abs(twists[:, :3]).max(initial=0.0)]
                    if m.bodies is not None:
                        way.append(turned * m.bodies.length)
                    share = min(1.0, longest / float(max(way)))
                    limits = (SEARCHED[0] * scale, SEARCHED[1] * scale)
                    searched = limits[0] < missed < limits[1] or iteration >= WHOLE_ITERATIONS
                limit, part = missed if searched else np.inf, (share * step, share * twists)
                z, loads, terms = _move(m, z, terms, part, loads, limit)
                self.effort = self.effort.plus(iterations=1)
        raise ConvergenceError(self._words(z, force, missed, scale, most))

    def _words(self, z: Array, force: Array, missed: float, scale: float, most: int) -> str:
        if not np.isfinite(missed):
            return "An element is turned inside out, or its law has no answer"
        size = np.linalg.norm(np.where(self.model.free, force, 0.0), axis=1)
        worst = int(size.argmax())
        sheet = self.model.job.sheet
        place = ", ".join(f"{1e3 * v:.2f}" for v in z[worst])
        return (
            f"After {most} iterations {missed:.2e} N do not balance, against forces of "
            f"{scale:.2e} N, most at {sheet.node(worst % len(sheet.points))} at ({place}) mm"
        )

    def _deepest(self) -> float:
        return self.model.deepest(self.last.z, self.last.loads)

    def _augment(self) -> None:
        """Raise contact's multipliers until it penetrates no deeper than wanted."""
        limit = self.options.penetration
        if limit is None:
            return
        for _ in range(MOST_AUGMENTATIONS):
            if self._deepest() <= limit:
                return
            z, loads = self.last.z, self.last.loads
            pressure = tuple(p.pressure for p in self.model.contacts(z, loads))
            loads = loads._replace(multipliers=pressure)
            self._accept(self._equilibrium(self.model, z, loads, self.last.time))
        raise ConvergenceError(
            f"{self.model.job.name}: at t = {self.last.time:.6g} contact penetrates by "
            f"{1e6 * self._deepest():.3g} um after {MOST_AUGMENTATIONS} augmentations; "
            "allow more, or take FEBio's penalty alone: --penetration none"
        )

    def _require_supports(self) -> None:
        """Check the supports.  Raises InputError where the sheet or a body can move without
        resistance."""
        if self.model.bodies is not None:
            try:
                self._body_factor(self.model.bodies, self.last.z, self.last.loads, self.last.terms)
            except SingularError as error:
                raise self._loose(error, self.last.time) from error
            return
        data = self.pattern.data(self.last.terms)
        if has_mechanism(data, self.pattern.slots):
            raise unsupported(self.model.job, self.last.time, self._free_motions(data))

    def _free_motions(self, data: Array) -> tuple[FreeMotions, ...]:
        """What moves as a rigid body without resistance by the tangent of `data`."""
        m, z, slots = self.model, self.last.z, self.pattern.slots
        pieces = Pieces.of(m.pairs, z)
        shifts = np.broadcast_to(np.eye(3), (len(z), 3, 3))
        moves = np.concatenate([shifts, np.moveaxis(pieces.turns(z), 0, 2)], axis=2)
        tangent = sp.csc_array((data[positions(slots)], slots.indices, slots.indptr), slots.shape)
        missed = m.imbalance(self.last.terms, self.last.loads)[m.free]
        return free_motions(pieces, moves, m.free.ravel(), tangent, float(np.abs(missed).sum()))


def _move(
    model: SolidModel,
    z: Array,
    terms: tuple[Term, ...],
    step: tuple[Array, Array],
    loads: Loads,
    limit: float,
) -> tuple[Array, Loads, tuple[Term, ...]]:
    """After a step of nodes (2n, 3) m and bodies (nb, 6) m and rad, or the first of ever shorter
    ones whose residual is below the limit (N), or the best of them."""
    tried: list[tuple[float, Array, Loads, tuple[Term, ...]]] = []
    for halving in range(HALVINGS):
        part, twists = (s / 2**halving for s in step)
        to, moved = z + part, loads
        if model.bodies is not None:
            moved = loads.carry(twists)
            to = model.place(to, moved)
        found = tuple(model.terms(to, moved, (terms, part)))
        missed = model.unbalanced(to, moved, found).size
        tried.append((missed, to, moved, found))
        if missed < limit or limit == np.inf:
            break
    return min(tried, key=lambda t: t[0])[1:]
