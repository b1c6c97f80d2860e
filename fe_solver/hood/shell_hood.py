"""The shell behind the port: a hood of finite elements that answers poses and tensions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from cosim.content_key import UnknownContentError, content_key
from cosim.errors import ConvergenceError, InputError, say
from cosim.port import Array, HoodJacobian, Load, Motion, Response
from cosim.stopwatch import timed
from fe_solver.forces.contact import compression
from fe_solver.hood.version import KNOWN, solver_version
from fe_solver.sheet import Sheet
from fe_solver.solver.augmented_contact import AugmentOptions, next_increment, solve_augmented
from fe_solver.solver.body_coupling import rope_travel, wrenches
from fe_solver.solver.continuation import Attempt, first_success
from fe_solver.solver.mixed_steps import Prediction, predict_motion
from fe_solver.solver.model import Configuration, ShellModel
from fe_solver.solver.newton import NewtonOptions, Solution, is_equilibrium, solve
from fe_solver.solver.relaxation import relax
from fe_solver.solver.residual import residual_norm
from fe_solver.supports import SpringSet
from fe_solver.vectors import cross

TIE = "terminal_slip"
"""The ledger's name of what the tied nodes do to their bone."""
BONE_SOURCES = ("contact", "guide")
"""The ledger's names of what the sheet itself does to the bones; springs have their sets' names."""
SMALL_TURN = 0.02
"""rad; below it the tangent predicts the hood's motion, above it the bones carry the nodes."""
SMALL_PULL, NO_PULL = 0.3, 0.1
"""Largest change of a tension that the tangent predicts, as a share of the largest tension, which
counts as no less than NO_PULL (N)."""
MAX_TURN = 0.2
"""rad that a joint turns at most in one solve.  A slack sheet may have several equilibria in a bent
posture (its central slip taut or not); which of them a long leap ends in is the mesh's whim."""
ON_THE_WAY = 3e-2
"""Newton's tolerance in the postures on the way to one that is far."""
ALIKE = 0.5
"""Difference of two steps, or of what they missed by, over the last: to here they are alike."""
MOST_HALVINGS = 4
NO_TURN, NO_WAY = 1e-7, 1e-12
"""rad and m of a pose that is the same but for rounding: an angle is known by its cosine."""
DETOUR_TENSION = 6.0
"""Added to every tension (N) on a detour: a sheet that folds in a joint when slack is then taut."""
IN_STEPS = "in steps"
BY_DETOUR, IN_HALVES, BY_DAMPING = RETRIES = "by a taut detour", "in halves", "by a damped motion"
"""Attempts that follow one that failed."""
SOFT_START = NewtonOptions(tolerance=1e-2)
"""Options for the equilibrium on softer contact that leads to the one that is sought."""


@dataclass(frozen=True)
class _Drift:
    """How far nodes (n, 3) m and directors (n, 3) came to rest from where the bones carried them;
    in a step of the same size they will about as far again."""

    x: Array
    d: Array

    @classmethod
    def of(cls, c: Configuration, carried: Configuration) -> _Drift:
        return cls(c.x - carried.x, c.d - carried.d)


@dataclass(frozen=True)
class _Course:
    """A step as the tangent predicts it, and by how much the last one like it missed."""

    step: Array
    """(free,) of the free degrees of freedom, to first order."""
    end: Configuration
    """To first order."""
    miss: _Drift | None = None
    """How far from there the hood comes to rest, in the square of the step's length; None where
    no step before says it."""
    steady: bool = False
    """Whether the step before missed alike."""

    def after(self, last: _Course | None) -> _Course:
        """This step with what the last one, if it was alike, missed by."""
        if last is None or last.miss is None or not (size := float(last.step @ last.step)):
            return self
        share = float(self.step @ last.step) / size
        if share <= 0 or not _is_alike(self.step, share * last.step):
            return self
        miss = _Drift(share**2 * last.miss.x, share**2 * last.miss.d)
        return replace(self, miss=miss, steady=last.steady)

    def guess(self, model: ShellModel) -> Configuration:
        """Where the hood comes to rest, to second order where that is known."""
        if self.miss is None or not self.steady:
            return self.end
        end, held = self.end, np.concatenate([model.ties.node, model.guides.node])
        x, d = end.x + self.miss.x, end.d + self.miss.d
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        x[held], d[held] = end.x[held], end.d[held]
        return replace(end, x=x, d=d)

    def ended(self, c: Configuration) -> _Course:
        """The step when the hood has come to rest, with what it missed by."""
        miss = _Drift.of(c, self.end)
        steady = self.miss is not None and _is_alike(miss.x, self.miss.x)
        return replace(self, miss=miss, steady=steady)


def _is_alike(a: Array, b: Array) -> bool:
    return float(np.linalg.norm(a - b)) <= ALIKE * float(np.linalg.norm(a))


@dataclass(frozen=True)
class HoodState:
    """A hood in equilibrium, or, before the first solve, carried there by its bones."""

    motion: Motion
    configuration: Configuration
    solution: Solution | None = None
    """None before the first solve."""
    iterations: int = 0
    """Newton iterations since the start."""
    attempt: str = ""
    """Which attempt of `ShellHood` converged here; empty in a state that was not solved."""
    course: _Course | None = None
    """The step that was predicted to here; None where none was, as after a large change."""


@dataclass(frozen=True)
class ShellHood:
    """A sheet or a net over the bones, as a Hood of the port."""

    model: ShellModel
    tendons: tuple[str, ...]
    rest: Motion
    """The pose in which the mesh is laid."""
    carriers: Array
    """(n, nb) how much of each node's motion each body carries in a large change of pose."""
    options: NewtonOptions = field(default_factory=NewtonOptions)
    augment: AugmentOptions | None = None
    """How far a node penetrates at most, where that is stated; contacts may rub then, and a state
    remembers their pressures and where they stick."""
    softer: float = 1.0
    """Share of the contact's stiffness with which a large change is solved first: what slides on a
    bone without resisting, as slack cables do, follows its curvature in steps that are longer the
    softer the contact."""
    leap: float = MAX_TURN
    """rad that a joint turns at most in one solve."""
    sheet: Sheet | None = None
    """What the model is made of; None of a net.  One whose fibres are stretched as it is laid out
    is not in equilibrium there, and is solved in the rest pose before anything moves."""
    springs: tuple[SpringSet, ...] = ()
    """The sets that the model's springs are made of."""

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies that are shared with the other side."""
        return self.model.bodies

    @property
    def groups(self) -> tuple[str, ...]:
        """Names of the springs' groups, each a source of the load."""
        return self.model.groups

    @property
    def lift(self) -> Array:
        """How much of the contact's offset makes up for the chords on which the sheet runs between
        its nodes, (n,) m."""
        lift = 0.0 if self.sheet is None else self.sheet.lift
        return np.broadcast_to(lift, len(self.model.reference))

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of what acts on the bodies, in the ledger's order."""
        return (*self.groups, TIE, *BONE_SOURCES)

    def start(self, motion: Motion) -> HoodState:
        """The rest shape, to be carried by the bones from the rest pose."""
        self._check(motion)
        m = self.model
        rest = Configuration(m.reference, m.directors, self.rest.position, self.rest.rotation)
        return HoodState(self.rest, rest)

    @timed("hood")
    def advance(self, state: HoodState, motion: Motion, tension: Array, dt: float) -> Response:
        """Static equilibrium at `motion` under `tension` (nt,); a massless hood has no memory, so
        `dt` plays no part.  Raises InputError and ConvergenceError."""
        del dt
        self._check(motion)
        tension = np.asarray(tension, dtype=float)
        if tension.shape != (len(self.tendons),) or not np.isfinite(tension).all():
            raise InputError(
                f"expected {len(self.tendons)} finite tensions {self.tendons}, got {tension}"
            )
        return self.response(self._reach(state, motion, tension))

    def response(self, state: HoodState) -> Response:
        """What a solved state does to the bodies."""
        c, s = state.configuration, _solution_of(state)
        load = Load(self.bodies, self.sources, self._by_source(s), self._pull(c, s.tension))
        return Response(state, load, self.model.excursion(c))

    def near(self, hood: ShellHood, state: HoodState, tension: Array) -> HoodState:
        """The equilibrium of this hood at the pose of another one's, to first order in what
        their parameters and nodes differ in: one Newton step with the other one's tangent.  The
        other one's mesh has the same quads."""
        s = _solution_of(state)
        m, c = self.model, self._start_from_hood(hood, state)
        step = np.zeros(m.pattern.size)
        e = m.evaluate(c, tension, tangent=False)
        step[m.free] = -s.factor.solve(e.reduced[m.free])
        c = m.take_step(c, e.bases, step)
        evaluation = m.evaluate(c, tension, tangent=True)
        solution = Solution(m, c, evaluation, tension, 1, 1, residual_norm(m, evaluation)[0])
        return HoodState(state.motion, c, solution, state.iterations + 1)

    def linearised(self, state: HoodState, motion: Motion) -> HoodState:
        """The state at poses nearby under the same tensions, to first order in the poses."""
        s, m = _solution_of(state), self.model
        twist, step = state.motion.twist_to(motion).ravel(), np.zeros(m.pattern.size)
        step[m.free] = s.sensitivity[:, : len(twist)] @ twist
        c = m.take_step(s.configuration, s.evaluation.bases, step)
        c = m.move_bodies(c, motion.position, motion.rotation)
        moved = replace(s, configuration=c, evaluation=m.evaluate(c, s.tension, tangent=False))
        return replace(state, motion=motion, configuration=c, solution=moved)

    def solve_from(self, hood: ShellHood, state: HoodState, tension: Array) -> HoodState:
        """The equilibrium under `tension` (nt,) N at the pose of another hood's, whose mesh has the
        same quads, by Newton's method from its shape.  Raises ConvergenceError."""
        start = self._start_from_hood(hood, state)
        s = solve(self.model, start, tension, self.options, True, _solution_of(state))
        return HoodState(state.motion, s.configuration, s, s.iterations)

    def _start_from_hood(self, hood: ShellHood, state: HoodState) -> Configuration:
        """Another hood's shape, with the nodes moved by as much as this one's are laid elsewhere on
        the bones."""
        c = state.configuration
        moved = _on_bodies(self) - _on_bodies(hood)
        x = c.x + np.einsum("nb,bij,bnj->ni", self.carriers, c.rotation, moved)
        return self.model.move_bodies(replace(c, x=x), c.position, c.rotation)

    @timed("hood's stiffness")
    def jacobian(self, state: HoodState) -> HoodJacobian:
        """Derivatives by back-substitution with the factor of the solved state."""
        s = _solution_of(state)
        _, wrench_motion, _, wrench_tension = s.coupling
        nm, by_follow = len(wrench_motion), s.residual_derivative.T @ s.sensitivity
        ropes = self.model.ropes.node.size
        excursion = rope_travel(self.model, state.configuration) if ropes else 0.0
        return HoodJacobian(
            wrench_motion - by_follow[:nm, :nm],
            wrench_tension - by_follow[:nm, nm:],
            excursion - by_follow[nm:, :nm],
            -by_follow[nm:, nm:],
        )

    def first_key(self, state: HoodState, motion: Motion, tension: Array) -> str | None:
        """A key of all that determines `advance` from a state of `start`: this hood, the poses, the
        tensions (nt,) N, the solver's code and the machine.  None for a state that was solved, for
        augmented contact, whose states `to_arrays` does not hold, and for a user's own material."""
        if self.augment is not None or state.solution is not None:
            return None
        try:
            return content_key(
                (solver_version(), self, state, motion, np.asarray(tension, dtype=float)), KNOWN
            )
        except UnknownContentError:
            return None

    def to_arrays(self, state: HoodState) -> dict[str, Array]:
        """All that a state of a hood without augmented contact is made of."""
        out = {f"motion/{k}": v for k, v in _pose(state.motion.position, state.motion.rotation)}
        c = state.configuration
        out |= {"x": c.x, "d": c.d, **dict(_pose(c.position, c.rotation))}
        out |= {"iterations": np.array(state.iterations), "attempt": np.array(state.attempt)}
        if state.solution is not None:
            s = state.solution
            out |= {"tension": s.tension, "residual": np.array(s.residual)}
            out["counts"] = np.array([s.iterations, s.solves])
        if (course := state.course) is not None and course.miss is not None:
            out |= {"course/step": course.step, "course/steady": np.array(course.steady)}
            out |= {"course/x": course.miss.x, "course/d": course.miss.d}
        return out

    def from_arrays(self, arrays: Mapping[str, Array]) -> HoodState:
        """The state of `to_arrays`, its tangent evaluated anew: the same bits.

        Raises InputError where the arrays are another hood's."""
        shape = self.model.reference.shape
        if "x" not in arrays or arrays["x"].shape != shape or arrays["d"].shape != shape:
            raise InputError(f"the state of another hood: expected {shape[0]} nodes")
        motion = Motion(self.bodies, arrays["motion/position"], arrays["motion/rotation"])
        c = Configuration(arrays["x"], arrays["d"], arrays["position"], arrays["rotation"])
        solution = None
        if "tension" in arrays:
            tension = arrays["tension"]
            evaluation = self.model.evaluate(c, tension, tangent=True)
            iterations, solves = (int(n) for n in arrays["counts"])
            residual = float(arrays["residual"])
            solution = Solution(self.model, c, evaluation, tension, iterations, solves, residual)
        spent, attempt = int(arrays["iterations"]), str(arrays.get("attempt", ""))
        course = None
        if "course/step" in arrays:
            miss = _Drift(arrays["course/x"], arrays["course/d"])
            course = _Course(arrays["course/step"], c, miss, bool(arrays["course/steady"]))
        return HoodState(motion, c, solution, spent, attempt, course)

    def is_solved(self, state: HoodState, motion: Motion, tension: Array) -> bool:
        """Whether a state of `from_arrays` is at rest at `motion` under `tension` (nt,) N."""
        s, c = state.solution, state.configuration
        poses = (state.motion.position, state.motion.rotation, c.position, c.rotation)
        asked = (motion.position, motion.rotation) * 2
        if s is None or not all(map(np.array_equal, (*poses, s.tension), (*asked, tension))):
            return False
        course, free = state.course, self.model.free
        if course is not None and course.miss is not None:
            parts = (course.step, course.miss.x, course.miss.d)
            if [part.shape for part in parts] != [free.shape, c.x.shape, c.d.shape]:
                return False
            if not all(np.isfinite(part).all() for part in parts):
                return False
        return is_equilibrium(s, self.options.tolerance)

    def with_tolerance(self, tolerance: float) -> ShellHood:
        """Return the same shell, its Newton stopped at a relative residual of `tolerance`."""
        loose = max(tolerance, self.options.tolerance)
        return replace(self, options=replace(self.options, tolerance=loose))

    def _check(self, motion: Motion) -> None:
        if motion.bodies != self.bodies:
            raise InputError(f"the hood shares the bodies {self.bodies}, got {motion.bodies}")

    def _carry(
        self, c: Configuration, motion: Motion, drift: _Drift | None = None
    ) -> Configuration:
        """Every node moved with the bodies that carry it, and by the drift of the step before as
        they turn it; tied and guided nodes exactly."""
        turn = motion.rotation @ np.swapaxes(c.rotation, 1, 2)
        moved = np.einsum("bij,bnj->bni", turn, c.x[None] - c.position[:, None])
        moved += motion.position[:, None]
        x = np.einsum("nb,bni->ni", self.carriers, moved)
        directors = c.d if drift is None else c.d + drift.d
        d = np.einsum("nb,bij,nj->ni", self.carriers, turn, directors)
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        if drift is not None:
            x += np.einsum("nb,bij,nj->ni", self.carriers, turn, drift.x)
        slid = self.model.move_bodies(c, motion.position, motion.rotation)
        held = np.concatenate([self.model.ties.node, self.model.guides.node])
        x[held] = slid.x[held]
        d[self.model.ties.node] = slid.d[self.model.ties.node]
        return Configuration(x, d, motion.position, motion.rotation)

    def _predict(
        self, state: HoodState, motion: Motion, tension: Array
    ) -> tuple[_Course, Prediction] | None:
        """To first order, the step to a nearby motion under other tensions and the hood's forces
        there; None where the change is too large for that."""
        s, twist = state.solution, state.motion.twist_to(motion)
        if s is None or np.abs(twist[:, 3:]).max() > SMALL_TURN:
            return None
        pulled = np.abs(tension - s.tension).max(initial=0.0)
        if pulled > SMALL_PULL * max(np.abs(tension).max(initial=0.0), NO_PULL):
            return None
        m, c, e = self.model, s.configuration, s.evaluation
        step = np.zeros(m.pattern.size)
        step[m.free] = s.sensitivity @ np.concatenate([twist.ravel(), tension - s.tension])
        moved = m.take_step(c, e.bases, step)
        moved = m.move_bodies(moved, motion.position, motion.rotation)
        end, forces = predict_motion(m, c, e, step, twist, moved)
        return _Course(step[m.free], end).after(state.course), forces

    def _reach(
        self,
        state: HoodState,
        motion: Motion,
        tension: Array,
        halvings: int | None = None,
        drift: _Drift | None = None,
    ) -> HoodState:
        """The state of the first of the `_attempts` that converges, with that one's name."""
        name, reached = first_success(self._attempts(state, motion, tension, halvings, drift))
        return reached if name == IN_STEPS else replace(reached, attempt=name)

    def _attempts(
        self,
        state: HoodState,
        motion: Motion,
        tension: Array,
        halvings: int | None,
        drift: _Drift | None,
    ) -> Iterator[Attempt[HoodState]]:
        """What is tried in turn to reach `motion` under `tension` (nt,) N.

        The whole way (without `halvings`): in steps, then by a detour on which the sheet is taut
        and does not fold.  There is no such way with friction, which would keep what the detour
        pulled.  One step of it: at once with the drift of the step before, without it, half of it
        first, and where no halving is left, or the step has no length, by a damped motion."""
        to = state, motion, tension
        if halvings is None:
            yield Attempt(IN_STEPS, partial(self._solve_in_steps, *to))
            rubs = any(k.friction for k in self.model.contacts)
            if not rubs and tension.min(initial=np.inf) <= DETOUR_TENSION:
                yield Attempt(BY_DETOUR, partial(self._solve_by_detour, *to), False)
            return
        if drift is not None:
            yield Attempt("with the drift before", partial(self._solve_once, *to, drift))
        yield Attempt("at once", partial(self._solve_once, *to))
        if halvings and not _stays(*to):
            yield Attempt(IN_HALVES, partial(self._solve_in_halves, *to, halvings))
        else:
            yield Attempt(BY_DAMPING, partial(self._relax, *to), False)

    def _solve_by_detour(self, state: HoodState, motion: Motion, tension: Array) -> HoodState:
        taut = self._solve_in_steps(state, motion, tension + DETOUR_TENSION)
        return self._solve_in_steps(taut, motion, tension)

    def _solve_in_steps(self, state: HoodState, motion: Motion, tension: Array) -> HoodState:
        """Solve at `motion` and, where that is far, on the way there, loosely unless friction holds
        what it meets; a sheet stretched in situ is balanced first where it was laid out."""
        stretched = self.sheet is not None and (self.sheet.stretch != 1.0).any()
        if stretched and state.solution is None:
            state = self._reach(state, state.motion, tension, MOST_HALVINGS)
        begin, start_pull = state.motion, state.solution.tension if state.solution else tension
        steps = int(np.ceil(_largest_turn(begin, motion) / self.leap))
        remembers, drift = self.augment is not None, None
        way = self if remembers else self.with_tolerance(ON_THE_WAY)
        for part in np.arange(1, steps) / max(steps, 1):
            pull = start_pull + part * (tension - start_pull)
            target = interpolate_motion(begin, motion, part)
            reached = way._reach(state, target, pull, MOST_HALVINGS, drift)
            if not remembers:
                drift = _Drift.of(reached.configuration, self._carry(state.configuration, target))
            state = reached
        return self._reach(state, motion, tension, MOST_HALVINGS, drift)

    def _solve_in_halves(
        self, state: HoodState, motion: Motion, tension: Array, halvings: int
    ) -> HoodState:
        say(f"the hood finds no equilibrium in one step; half of it first ({halvings} are left)")
        start_pull = state.solution.tension if state.solution else 0.0 * tension
        half = interpolate_motion(state.motion, motion, 0.5)
        middle = self._reach(state, half, (start_pull + tension) / 2, halvings - 1)
        return self._reach(middle, motion, tension, halvings - 1)

    def _solve_once(
        self, state: HoodState, motion: Motion, tension: Array, drift: _Drift | None = None
    ) -> HoodState:
        near = self._predict(state, motion, tension)
        if near is not None:
            course, forces = near
            s = self._equilibrium(state, course.guess(self.model), tension, forces)
            spent, course = state.iterations + s.iterations, course.ended(s.configuration)
            return HoodState(motion, s.configuration, s, spent, course=course)
        guess, spent = self._start_on_soft_contact(
            self._carry(state.configuration, motion, drift), tension
        )
        s = self._equilibrium(state, guess, tension)
        return HoodState(motion, s.configuration, s, state.iterations + spent + s.iterations)

    def _start_on_soft_contact(
        self, guess: Configuration, tension: Array
    ) -> tuple[Configuration, int]:
        """The guess, or near it the equilibrium on softer contact; and the iterations it took."""
        if self.softer == 1.0:
            return guess, 0
        contacts = self.model.contacts
        soft = tuple(k.softened(self.softer) for k in contacts)
        try:
            s = solve(self.model.with_changes(contacts=soft), guess, tension, SOFT_START)
        except ConvergenceError:
            return guess, SOFT_START.max_iterations
        return s.configuration, s.iterations

    def _relax(self, state: HoodState, motion: Motion, tension: Array) -> HoodState:
        c = relax(self.model, self._carry(state.configuration, motion), tension)
        s = self._equilibrium(state, c, tension)
        return HoodState(motion, s.configuration, s, state.iterations + s.iterations)

    def _equilibrium(
        self,
        state: HoodState,
        guess: Configuration,
        tension: Array,
        forces: Prediction | None = None,
    ) -> Solution:
        if self.augment is None:
            previous = None if forces is None else state.solution
            return solve(
                self.model, guess, tension, self.options, forces is not None, previous, forces
            )
        model = next_increment(state.solution) if state.solution else self.model
        return solve_augmented(model, guess, tension, self.options, self.augment)

    def _by_source(self, s: Solution) -> Array:
        """Return the wrenches on the bodies, (nb, ns, 6)."""
        out = np.zeros((len(self.bodies), len(self.sources), 6))
        parts = wrenches(self.model, s.configuration, s.evaluation, s.tension)
        names = {"contact": "contact", "tie": TIE, "guide": "guide"}
        names |= {f"spring {i}": group for i, group in enumerate(self.groups)}
        for part, wrench in parts.items():
            out[:, self.sources.index(names[part])] += wrench
        return out

    def _pull(self, c: Configuration, tension: Array) -> Array:
        """Return the wrench of each tendon on the hood about the world's origin, (nt, 6)."""
        g, ropes = self.model.guides, self.model.ropes
        along = np.einsum("kij,kj->ki", c.rotation[g.body], g.direction)
        place, share = c.x[g.node], self.model.share
        if len(ropes.node):
            along = np.concatenate([along, ropes.along(c.rotation)])
            place = np.concatenate([place, c.position[ropes.body] + ropes.arm(c.rotation)])
            share = np.hstack([share, ropes.share])
        force = (tension[:, None] * share) @ along
        moment = (tension[:, None] * share) @ cross(place, along)
        return np.hstack([force, moment])

    def group_forces(self, state: HoodState) -> dict[str, Array]:
        """Return the summed force of each spring group, and of the ties, on its bone, (3,) N in the
        world frame."""
        s = _solution_of(state)
        points = s.evaluation.points
        out = {g: points.gradient[points.group == i].sum(axis=0) for i, g in enumerate(self.groups)}
        out[TIE] = -s.evaluation.gradient_x[self.model.ties.node].sum(axis=0)
        return out

    def strain(self, state: HoodState) -> Array:
        """Return generalized strains at the Gauss points, (ne, g, 8), axis 1 along the fibre."""
        c, q = state.configuration, self.model.quads
        return self.model.tables.strain(np.concatenate([c.x[q], c.d[q]], axis=1))

    def compression(self, state: HoodState) -> float | None:
        """Return the largest share of its thickness by which a layer under the hood is compressed;
        None where it touches the bones by a penalty."""
        c, layered = state.configuration, [k for k in self.model.contacts if k.layer is not None]
        if not layered:
            return None
        shares = (compression(k, c.x, c.position, c.rotation) for k in layered)
        return max(float(share.max(initial=0.0)) for share in shares)

    def gap(self, state: HoodState) -> NDArray[np.float64]:
        """Return the smallest gap (n,) m of each node, or of the points that it is nearest to, to a
        bone's contact level; inf where it meets none."""
        c = state.configuration
        out = np.full(len(c.x), np.inf)
        for k in self.model.contacts:
            np.minimum.at(out, k.nodes, k.gap(c.x, c.position, c.rotation))
        return out


def _on_bodies(hood: ShellHood) -> Array:
    """Return the nodes as laid out, in the bodies' frames, (nb, n, 3) m."""
    from_origin = hood.model.reference - hood.rest.position[:, None]
    return np.asarray(np.einsum("bji,bnj->bni", hood.rest.rotation, from_origin))


def interpolate_motion(start: Motion, end: Motion, part: float) -> Motion:
    """Poses a `part` (0 to 1) of the way, with each body so far as the one before it sees it, so
    that a chain of bodies stays whole."""
    from scipy.spatial.transform import Rotation

    position, rotation = np.empty_like(start.position), np.empty_like(start.rotation)
    parent = (np.zeros(3), np.eye(3))
    for i, (offsets, turns) in enumerate(zip(*_relative_poses(start, end), strict=True)):
        turn = part * Rotation.from_matrix(turns[1] @ turns[0].T).as_rotvec()
        offset = (1 - part) * offsets[0] + part * offsets[1]
        position[i] = parent[0] + parent[1] @ offset
        rotation[i] = parent[1] @ Rotation.from_rotvec(turn).as_matrix() @ turns[0]
        parent = position[i], rotation[i]
    return Motion(start.bodies, position, rotation)


def _relative_poses(start: Motion, end: Motion) -> tuple[Array, Array]:
    """Return the origins (nb, 2, 3) and rotations (nb, 2, 3, 3) of the bodies in both motions, as
    the body before each sees them; the first one's in the world."""
    p = np.stack([start.position, end.position], axis=1)
    R = np.stack([start.rotation, end.rotation], axis=1)
    back = np.swapaxes(R[:-1], 2, 3)
    offset = np.einsum("bmij,bmj->bmi", back, p[1:] - p[:-1])
    return np.concatenate([p[:1], offset]), np.concatenate([R[:1], back @ R[1:]])


def _largest_turn(start: Motion, end: Motion) -> float:
    """The most (rad) that a body turns as the one before it sees it."""
    turns = _relative_poses(start, end)[1][1:]
    cosine = (np.einsum("bij,bij->b", turns[:, 0], turns[:, 1]) - 1) / 2
    return float(np.arccos(np.clip(cosine, -1, 1)).max(initial=0.0))


def _stays(state: HoodState, motion: Motion, tension: Array) -> bool:
    """Whether a state was solved at these very poses under this tension, if less exactly: half of
    such a step is the step again."""
    if state.solution is None or _largest_turn(state.motion, motion) > NO_TURN:
        return False
    moved = np.abs(motion.position - state.motion.position).max()
    return bool(moved <= NO_WAY and np.array_equal(tension, state.solution.tension))


def _pose(position: Array, rotation: Array) -> tuple[tuple[str, Array], ...]:
    return ("position", position), ("rotation", rotation)


def _solution_of(state: HoodState) -> Solution:
    if state.solution is None:
        raise InputError("this hood state has not been solved: call advance first")
    return state.solution
