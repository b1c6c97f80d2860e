"""Solving a Job: steps in time that grow and shrink by themselves, and what each state holds.

A step is predicted by one back-substitution for what moves and for what the loads change, solved by
Newton, and halved where Newton fails; where no step is short enough, a damped motion
(`fe_solver.solver.relaxation`) looks for the equilibrium before the solve gives up.
"""

from __future__ import annotations

import time as clock
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cosim.errors import ConvergenceError, InputError
from cosim.port import Array
from cosim.processes import one_blas_thread
from fe_solver.forces.loads import pressure_forces
from fe_solver.forces.springs import NodeSprings, Springs, node_spring_state, spring_state
from fe_solver.given import numbers
from fe_solver.job.checks import check_job
from fe_solver.job.free_bodies import FreeBodies
from fe_solver.job.job import Job, Step
from fe_solver.job.model import JobModel, JobOptions, check_supports, job_model, next_model
from fe_solver.job.phases import Phase, phases
from fe_solver.job.rigid_modes import require_supports
from fe_solver.solver.assembly import DOFS
from fe_solver.solver.augmented_contact import AugmentOptions, next_increment, solve_augmented
from fe_solver.solver.body_coupling import coupling, wrenches
from fe_solver.solver.continuation import SAME_TIME, Effort, TimeSteps, free_share
from fe_solver.solver.fields import Fields, contact_pressure, fields
from fe_solver.solver.mixed_steps import Prediction
from fe_solver.solver.model import Configuration, Evaluation, ShellModel
from fe_solver.solver.newton import Solution, solve
from fe_solver.solver.relaxation import RelaxOptions, relax

NO_TENSION = np.zeros(0)
QUICK = 12
"""Iterations up to which the next step is twice as long."""
REST = (1e-4, 1e-6, 1e-8)
"""Residuals over forces at which a damped motion is handed to Newton, the next where that fails:
near a snap the first moves of the sheet are slow."""


@dataclass(frozen=True)
class JobState:
    """An equilibrium of n nodes and nb bodies."""

    time: float
    """s."""
    configuration: Configuration
    bodies: tuple[str, ...]
    """(nb,) names: the job's own, then those that carry held nodes."""
    spring_forces: tuple[Array, ...]
    """By spring set of the job: (k,) N, positive in tension."""
    wrench: dict[str, Array]
    """(nb, 6) N and N m about each body's origin, of the sheet on the bodies, by source: contact,
    spring <set's number>, tie, guide."""
    applied: Array
    """(6,) N and N m about the world's origin of the loads."""
    penetration: float
    """The deepest penetration of a contact node, m."""
    residual: float
    """N, the largest that Newton left."""
    imbalance: tuple[float, float]
    """Force (N) and moment (N m) by which bodies and loads miss balance."""
    effort: Effort
    """What the steps since the last state took."""
    fields: Fields
    contact_pressure: Array
    """(n,) N/m2 of all bodies on each node."""
    reaction: Array
    """(n, 6) N and N m with which ties and held displacements act on each node, about it; see
    `fe_solver.job.results`."""

    @property
    def contact(self) -> Array:
        """The force (nb, 3) N of the sheet on each body through contact."""
        return self.wrench["contact"][:, :3]


@dataclass(frozen=True)
class ShellState(JobState):
    """An equilibrium of our own shell, with its model."""

    model: ShellModel


@dataclass(frozen=True)
class Touch:
    """What a contact pair did from the start to the last state."""

    pair: str
    body: str
    touched: bool
    """Whether it bore anything in a solved step."""
    nearest: float
    """m, the smallest gap in any of them, negative where it penetrates; infinite where the body was
    never as near as contact looks for it."""

    @property
    def words(self) -> str:
        """What is told of a pair that did not touch."""
        near = "nothing of the body was ever met"
        if np.isfinite(self.nearest):
            near = f"the gap was never less than {1e3 * self.nearest:.3g} mm"
        return f"contact {self.pair!r} with the body {self.body!r} never touched: {near}"


@dataclass(frozen=True)
class JobResult:
    """The solved states of a job."""

    job: Job
    states: tuple[JobState, ...]
    """At the wanted times."""
    setup_s: float
    """CPU seconds to build the model, with the distances of its bodies."""
    effort: Effort
    """What all steps took."""
    element: str = "shell"
    """The kind of element: shell (ours) or q4ans (FEBio's)."""
    touches: tuple[Touch, ...] = ()
    """Whether each contact pair of the job touched."""


@dataclass(frozen=True)
class ShellResult(JobResult):
    """What our own shell says."""

    states: tuple[ShellState, ...]


@one_blas_thread()
def solve_job(
    job: Job,
    until: float | None = None,
    options: JobOptions | None = None,
    times: Sequence[float] | None = None,
    ways: Sequence[str] = (),
) -> ShellResult:
    """Solve a job for static equilibria at `times`, or else at the ends and must-points of its
    steps, up to `until` (its last step's end where None; later than that the curves go on as they
    say).  Times have no part in the way, which goes by the steps (see `way_marks`): another one is
    solved aside.

    `options` are tolerances and step lengths; `ways` are what to try first where no equilibrium is
    found, as the text of an error names them.  Returns the states in the order of their times, with
    what the solve took.

    Raises InputError as `job_model` does, for times that do not ascend from above 0 and for a state
    whose sheet could move as a rigid body without resistance, and ConvergenceError naming the time,
    the place, and what to try.

    >>> from fe_solver.job.job import Job, NodalForce
    >>> from fe_solver.job.solve import solve_job
    >>> from fe_solver.materials.linear import Isotropic
    >>> from fe_solver.sheet import plate
    >>> from fe_solver.supports import WALL, Tied
    >>> # a strip of 20 x 5 x 0.5 mm, clamped at x = 0, with 1 mN on each of the other end's nodes
    >>> sheet = plate(20e-3, 5e-3, 10, 3, Isotropic(100e6, 0.0), thickness=0.5e-3)
    >>> end = NodalForce(sheet.edge("x1"), (0, 0, 1e-3))
    >>> job = Job(sheet, ties=[Tied(sheet.edge("x0"), WALL)], forces=[end])
    >>> state = solve_job(job).states[-1]
    >>> deflection = state.configuration.x[sheet.edge("x1"), 2].mean()
    >>> beam = 4e-3 * 20e-3**3 / (3 * 100e6 * 5e-3 * 0.5e-3**3 / 12)  # F L^3 / (3 E I)
    >>> bool(abs(deflection / beam - 1) < 0.02)
    True
    """
    options = options or JobOptions()
    began = clock.process_time()
    wanted = output_times(job, until, times)
    first, *later = checked_phases(job)
    stepper = _JobSteps(job_model(first.job, options), options, ways, first, len(job.contacts))
    setup = clock.process_time() - began
    began = clock.process_time()
    marks, states = way_marks(job, wanted[-1], options.increments), list[ShellState]()
    for phase in (first, *later):
        if phase.begin < wanted[-1]:
            stepper.enter(phase)
            states += stepper.visit(phase.marks(marks), phase.within(wanted))
    effort = stepper.total(clock.process_time() - began)
    return ShellResult(job, tuple(states), setup, effort, touches=touches(job, stepper.contact))


def output_times(job: Job, until: float | None, times: Sequence[float] | None) -> list[float]:
    """`times`, or else the ends of the job's steps up to `until`.

    Raises InputError where they do not ascend from above 0."""
    given = spread_times(job, until) if times is None else times
    out = numbers("times (s)", given, None).tolist()
    if not out or not np.isfinite(out).all() or min(np.diff([0.0, *out])) <= 0:
        raise InputError(f"{job.name}: expected times that ascend from above 0, got {out}")
    return out


def spread_times(job: Job, until: float | None = None, states: int = 1) -> list[float]:
    """`states` evenly spaced times of each step of a job and its must-points, up to `until` and
    with it."""
    out: list[float] = []
    for begin, step in _spans(job):
        even = [begin + (step.end - begin) * (i + 1) / states for i in range(states)]
        out = _merge(out, [*even, *step.must])
    return out if until is None else _up_to(out, until)


def way_marks(job: Job, last: float, increments: bool = False) -> list[float]:
    """The times that a solve goes by up to the last: the ends and must-points of its steps, and
    their `increments` where that is asked for or friction remembers the way."""
    remembers, out = any(c.friction > 0 for c in job.contacts), list[float]()
    for begin, step in _spans(job):
        count = step.increments if increments or remembers else 1
        even = [begin + (step.end - begin) * (i + 1) / count for i in range(count)]
        out = _merge(out, [*even, *step.must])
    return _up_to(out, last)


def _spans(job: Job) -> Iterator[tuple[float, Step]]:
    """The steps of a job, each with its begin."""
    begins = [0.0, *(s.end for s in job.steps)]
    return zip(begins, job.steps, strict=False)


def _merge(times: Sequence[float], more: Sequence[float]) -> list[float]:
    """All times in their order, those that are one once."""
    out: list[float] = []
    for time in sorted([*times, *more]):
        if not out or time > out[-1] * (1 + SAME_TIME):
            out.append(time)
    return out


def _up_to(times: Sequence[float], last: float) -> list[float]:
    """Those before the last time, and it."""
    return [t for t in times if t < last * (1 - SAME_TIME)] + [last]


def checked_phases(job: Job) -> list[Phase]:
    """The phases of a job.  Raises InputError as `check_job` and `check_supports` do for any."""
    out = phases(job)
    for phase in out if len(out) > 1 else ():
        check_job(phase.job)
        check_supports(phase.job)
    return out


def touches(job: Job, contact: ContactRecord) -> tuple[Touch, ...]:
    """What each contact pair of a job did."""
    return tuple(
        Touch(pair.name, job.bodies[pair.body].name, bool(touched), float(nearest))
        for pair, touched, nearest in zip(
            job.contacts, contact.touched, contact.nearest, strict=True
        )
    )


def _advice(job: Job, steps: int, ways: Sequence[str]) -> str:
    """What to try, the nearest first, where no equilibrium was found after so many steps."""
    tries = [*ways] if steps else []
    if job.springs and job.sheet.height.any():
        tries.append(
            "--mid-surface (fe_solver.job.model.move_to_mid_surface: the springs pull at a face of "
            "the sheet, on a thin one a couple beyond its bending stiffness)"
        )
    return f" To try, the nearest first: {'; '.join(tries)}." if tries else ""


class ContactRecord:
    """What contact pairs have done so far."""

    def __init__(self, pairs: int) -> None:
        self.touched = np.zeros(pairs, dtype=bool)
        self.nearest = np.full(pairs, np.inf)

    def add(self, pairs: Sequence[int], touched: Sequence[bool], gaps: Sequence[float]) -> None:
        """Count a solved step, of whose pairs (by number) these touch and have these gaps (m)."""
        on = np.array(pairs, dtype=np.intp)
        self.touched[on] |= np.array(touched, dtype=bool)
        self.nearest[on] = np.minimum(self.nearest[on], gaps)


class _JobSteps(TimeSteps[ShellState]):
    """The equilibria of a job's shell."""

    def __init__(
        self,
        model: JobModel,
        options: JobOptions,
        ways: Sequence[str],
        phase: Phase,
        pairs: int,
    ) -> None:
        super().__init__(options.shortest, options.turn, QUICK)
        self.model, self.options, self.ways, self.phase = model, options, ways, phase
        self.solution: Solution | None = None
        self.contact = ContactRecord(pairs)
        self._prepare()

    def _prepare(self) -> None:
        """Note what the model of the phase says of steps."""
        pairs = [k.quads for k in self.model.job.contacts]
        thin = min((float(self.model.job.sheet.thickness[q].mean()) for q in pairs), default=np.inf)
        self.passage = max(thin, self.options.spacing)
        self.free: FreeBodies | None = None
        if self.model.motions.any():
            longest = self.passage if pairs else np.inf
            self.free = FreeBodies(self.model.motions, self.model.body_loads, longest)

    def _poses(self, time: float) -> tuple[Array, Array]:
        """Positions (nb, 3) m and rotations (nb, 3, 3) of the bodies at a time; what equilibrium
        moves is where it was last."""
        poses = self.model.poses(time)
        if self.free is None or self.solution is None:
            return poses
        return self.free.place(poses, self.solution.configuration)

    def enter(self, phase: Phase) -> None:
        """Go on with the conditions of a phase.  Raises InputError as `next_model` does."""
        last = self.solution
        if last is None or phase is self.phase:
            return
        kept = dict(zip(self.phase.pairs, next_increment(last).contacts, strict=True))
        self.model, shell, c = next_model(phase, last.configuration, kept, self.options)
        e = shell.evaluate(c, NO_TENSION, tangent=True)
        self.solution = Solution(shell, c, e, NO_TENSION, 0, 0, last.residual)
        self.phase, self.stride, self.failed = phase, np.inf, False
        self._prepare()

    def finish(self) -> None:
        """See `TimeSteps.finish`."""
        solution = self.solution
        assert solution is not None
        require_supports(
            self.model.job, self.time, solution.model, solution.configuration, solution.evaluation
        )
        if self.free is not None:
            self.free.check(solution, self.time, self.model.job.name)

    def state(self, effort: Effort) -> ShellState:
        """See `TimeSteps.state`."""
        assert self.solution is not None
        return job_state(self.model, self.solution, self.time, effort)

    def solve_step(self, time: float, is_last: bool) -> None:
        """By Newton from a prediction."""
        model, start = self._predict(time)
        found = self._equilibrium(model, start, self.solution is not None, is_last)
        self._accept(self._balance(found, time, is_last))

    def _balance(self, found: Solution, time: float, is_last: bool) -> Solution:
        """The equilibrium of the sheet and of the bodies that it moves, from the sheet's own."""
        if self.free is None:
            return found
        if self.solution is None:
            self.free.check(found, time, self.model.job.name)

        def reach(last: Solution, start: Configuration, forces: Prediction) -> Solution:
            return self._equilibrium(last.model, start, True, is_last, forces)

        return self.free.balance(found, time, reach)

    def _predict(self, time: float) -> tuple[ShellModel, Configuration]:
        """The model of a time, and a first guess at its equilibrium."""
        model, poses = self._model(time), self._poses(time)
        if self.solution is None:
            return model, model.move_bodies(self.model.start(), *poses)
        return model, predict(model, self.solution, *poses)

    def _accept(self, solution: Solution) -> None:
        self.solution = solution
        self.effort = self.effort.plus(iterations=solution.iterations, solves=solution.solves)
        contacts, c = solution.model.contacts, solution.configuration
        gaps = [k.gap(c.x, c.position, c.rotation) for k in contacts]
        known = [k.surface.outside - k.offset > g for k, g in zip(contacts, gaps, strict=True)]
        self.contact.add(
            self.phase.pairs,
            [bool((g <= k.smoothing).any()) for k, g in zip(contacts, gaps, strict=True)],
            [float(g[near].min(initial=np.inf)) for g, near in zip(gaps, known, strict=True)],
        )

    def free_share(self, time: float) -> float:
        """See `TimeSteps.free_share`; a point that is pushed out to another side than it came from
        has passed through, too."""
        contacts, (at, turned) = self.model.base.contacts, self._poses(self.time)
        after = self._poses(time)
        if not contacts or (np.array_equal(at, after[0]) and np.array_equal(turned, after[1])):
            return 1.0
        begin = self.model.start() if self.solution is None else self.solution.configuration
        _, end = self._predict(time)
        moved, entered = end.x - begin.x, [np.zeros((len(k.nodes), 3)) for k in contacts]

        def gaps(share: float) -> Array:
            x = begin.x + share * moved
            pose, out = self._poses(self.time + share * (time - self.time)), []
            for k, outwards in zip(contacts, entered, strict=True):
                value, normal, _ = k.surface.distance(k.local(x, *pose))
                gap = value - k.offset
                outwards[gap >= 0] = normal[gap >= 0]
                turned = np.einsum("ij,ij->i", outwards, normal) < 0
                out.append(np.where((value < 0) & turned, -np.inf, gap))
            return np.concatenate(out)

        places = ((k.local(begin.x, at, turned), k.local(end.x, *after)) for k in contacts)
        way = max(float(np.linalg.norm(b - a, axis=1).max(initial=0.0)) for a, b in places)
        return free_share(gaps, way, self.passage)

    def largest_turn(self, time: float) -> float:
        """See `TimeSteps.largest_turn`."""
        _, before = self._poses(self.time)
        _, after = self._poses(time)
        turn = after @ np.swapaxes(before, 1, 2)
        cosine = (np.trace(turn, axis1=1, axis2=2) - 1) / 2
        return float(np.arccos(np.clip(cosine, -1, 1)).max(initial=0.0))

    def _model(self, time: float) -> ShellModel:
        if self.solution is None:
            return self.model.at(time)
        return self.model.at(time, next_increment(self.solution).contacts)

    def _equilibrium(
        self,
        model: ShellModel,
        start: Configuration,
        near: bool,
        end: bool,
        forces: Prediction | None = None,
    ) -> Solution:
        """By Newton; augmented where a wanted state penetrates too deep, and wherever friction
        remembers the path."""
        o = self.options
        augment = AugmentOptions(penetration=o.penetration or np.inf)
        if any(k.friction > 0 for k in model.contacts):
            return solve_augmented(model, start, NO_TENSION, o.newton, augment)
        plain = solve(model, start, NO_TENSION, o.newton, near, forces=forces)
        if not end or penetration(plain) <= augment.penetration:
            return plain
        more = solve_augmented(model, plain.configuration, NO_TENSION, o.newton, augment)
        return replace(
            more, iterations=plain.iterations + more.iterations, solves=plain.solves + more.solves
        )

    def solve_at_last(self, time: float, is_last: bool, error: ConvergenceError) -> None:
        """By a damped motion."""
        model = self._model(time)
        last = self.model.start() if self.solution is None else self.solution.configuration
        c = model.move_bodies(last, *self._poses(time))
        try:
            solution = self._relax_then_solve(model, c, is_last)
            solution = self._balance(solution, time, is_last)
        except ConvergenceError as failed:
            raise ConvergenceError(
                f"{self.model.job.name}: no equilibrium was found at t = {time:.6g}, after "
                f"{self.effort.steps} steps up to t = {self.time:.6g} and {self.effort.failures} "
                f"that failed; nor by a damped motion ({failed}). {error}"
                + _advice(self.model.job, self.effort.steps, self.ways)
            ) from error
        self.effort = self.effort.plus(relaxations=1)
        self._accept(solution)

    def _relax_then_solve(self, model: ShellModel, c: Configuration, end: bool) -> Solution:
        """By a damped motion, then Newton; by a longer motion where Newton fails."""
        for tolerance in REST:
            c = relax(model, c, options=RelaxOptions(tolerance=tolerance))
            try:
                return self._equilibrium(model, c, True, end)
            except ConvergenceError as error:
                failed = error
        raise failed


def predict(
    model: ShellModel, solution: Solution, position: Array, rotation: Array
) -> Configuration:
    """First-order prediction of the equilibrium of `model` with its bodies at new poses, from the
    solution of a model that differs from it by its loads."""
    from scipy.spatial.transform import Rotation

    last_model, c, e = solution.model, solution.configuration, solution.evaluation
    turn = Rotation.from_matrix(rotation @ np.swapaxes(c.rotation, 1, 2)) if len(rotation) else None
    right = -loads_in_bases(model, c, e.bases) + loads_in_bases(last_model, c, e.bases)
    carried = _carried(last_model, model)
    if carried.any():
        assert e.data is not None
        right = right + model.pattern.full(e.data) @ carried
    if turn is not None:
        twist = np.hstack([position - c.position, turn.as_rotvec()])
        if twist.any():
            right = right + coupling(last_model, c, e, NO_TENSION)[0] @ twist.ravel()
    step = np.zeros(model.pattern.size)
    step[model.free] = -solution.factor.solve(right[model.free])
    return model.move_bodies(model.take_step(c, e.bases, step), position, rotation)


def _carried(before: ShellModel, after: ShellModel) -> Array:
    """The motion (5n,) in the nodes' bases by which guided nodes are brought to other places on
    their bodies."""
    g, out = after.guides, np.zeros((len(after.reference), DOFS))
    moved = np.einsum("kji,kj->ki", g.axes, g.origin - before.guides.origin)
    out[g.node, :3] = np.where(g.held, moved, 0.0)
    return out.ravel()


def loads_in_bases(model: ShellModel, c: Configuration, bases: tuple[Array, Array]) -> Array:
    """Return the dead loads and the pressure in the nodes' bases A (n, 3, 3) and T (n, 3, 2),
    (5n,) N and N m."""
    out = np.zeros((len(c.x), 5))
    out[:, :3] = np.einsum("nij,ni->nj", bases[0], nodal_loads(model, c.x))
    if model.couples is not None:
        out[:, 3:] = np.einsum("nij,ni->nj", bases[1], model.couples)
    return out.ravel()


def nodal_loads(model: ShellModel, x: Array) -> Array:
    """Return the dead loads and the pressure on the nodes, (n, 3) N."""
    out = np.zeros_like(x) if model.dead is None else model.dead.copy()
    if model.pressure is not None:
        np.add.at(out, model.quads, pressure_forces(x[model.quads], model.pressure))
    return out


def job_state(model: JobModel, solution: Solution, time: float, effort: Effort) -> ShellState:
    """What an equilibrium holds."""
    shell, c, e = solution.model, solution.configuration, solution.evaluation
    wrench = wrenches(shell, c, e, NO_TENSION)
    loads = nodal_loads(shell, c.x)
    arms = np.cross(c.x, loads) + (0.0 if shell.couples is None else np.cross(c.d, shell.couples))
    applied = np.concatenate([loads.sum(axis=0), arms.sum(axis=0)])
    borne = model.body_loads(time, c.rotation)[0]
    rigid = np.concatenate(
        [
            borne[:, :3].sum(axis=0),
            (borne[:, 3:] + np.cross(c.position, borne[:, :3])).sum(axis=0),
        ]
    )
    total = np.asarray(sum(wrench.values()))
    force = total[:, :3].sum(axis=0) - applied[:3]
    moment = (total[:, 3:] + np.cross(c.position, total[:, :3])).sum(axis=0) - applied[3:]
    return ShellState(
        time,
        c,
        shell.bodies,
        _spring_forces(model.job, shell, c),
        wrench,
        applied + rigid,
        penetration(solution),
        solution.residual,
        (float(np.linalg.norm(force)), float(np.linalg.norm(moment))),
        effort,
        fields(shell, c),
        contact_pressure(shell, c),
        _reaction(shell, c, e),
        shell,
    )


def _reaction(model: ShellModel, c: Configuration, e: Evaluation) -> Array:
    """The force and couple (n, 6) N and N m with which ties and guides act on each node."""
    out, guides = np.zeros((len(c.x), 6)), model.guides
    held = np.concatenate([model.ties.node, guides.node])
    out[held, :3] = e.gradient_x[held]
    turned = np.concatenate([model.ties.node, guides.node[guides.steady]])
    out[turned, 3:] = np.cross(c.d[turned], e.gradient_d[turned])
    return out


def penetration(solution: Solution) -> float:
    """Return how deep the deepest contact node penetrates, m."""
    c = solution.configuration
    gaps = [k.gap(c.x, c.position, c.rotation) for k in solution.model.contacts]
    return max((float(np.max(-g, initial=0.0)) for g in gaps), default=0.0)


def _spring_forces(job: Job, model: ShellModel, c: Configuration) -> tuple[Array, ...]:
    to_body = spring_state(model.springs, c.x, c.position, c.rotation).force
    between = node_spring_state(model.links, c.x).force
    return forces_by_set(job, (model.springs, to_body), (model.links, between))


def forces_by_set(
    job: Job, to_bodies: tuple[Springs, Array], between: tuple[NodeSprings, Array]
) -> tuple[Array, ...]:
    """Forces (k,) N of each spring set of a job, in its order, from those of its springs to bodies
    and of its springs between nodes."""
    out = []
    for i, s in enumerate(job.springs):
        force = np.zeros(len(s.nodes))
        for chosen, (springs, values) in ((s.body >= 0, to_bodies), (s.body < 0, between)):
            force[chosen] = values[springs.group == i]
        out.append(force)
    return tuple(out)
