"""The same shell solved by an independent program, where it is installed (extra `peers`).

Both programs run in processes of their own, with one thread: a peer that crashes is a failed row
that says why, and neither prints among our results."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.util import find_spec
from time import perf_counter
from typing import Any

import numpy as np

from cosim.port import ConvergenceError, CosimError

from ..linear_algebra import chosen
from ..model import ShellModel
from ..newton import NewtonOptions, solve
from ..shell import Array
from . import sheets
from .row import Row

LENGTH, ARC, RADIUS, THICKNESS = 60e-3, 15e-3, 8e-3, 0.5e-3
MODULUS, POISSON, LOAD = 100e6, 0.3, 0.05
"""m, Pa, N: a sheet of a finger's hood in size, bent over a cylinder along x, one end clamped, the
other pressed down (-z) evenly along its edge.  The figures are our choice; the peer solves the
same."""
STEPS = 5
TOLERANCE = 1e-8
"""Of Newton in both programs: ours over the largest nodal force, Kratos' over the step's first
residual."""
MESH = (90, 22)
ONE_THREAD = dict.fromkeys(
    ("FE_SOLVER_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"
)


@dataclass(frozen=True)
class Answer:
    """Mean deflection of the loaded edge along z (m; weighed with the load, so that the load times
    it is its work), linear solves of all steps, seconds for each, and the linear solver's name."""

    deflection: float
    solves: int
    solve_s: float
    linear: str


def strip(along: int, across: int) -> tuple[ShellModel, Array]:
    """The clamped sheet of along x across quads, and the load (n, 3) N."""

    def shape(uv: Array) -> Array:
        angle = (uv[:, 1] - 0.5) * ARC / RADIUS
        return np.column_stack([LENGTH * uv[:, 0], RADIUS * np.sin(angle), RADIUS * np.cos(angle)])

    X, quads = sheets.mapped(along, across, shape)
    model = sheets.sheet(X, quads, MODULUS, POISSON, THICKNESS)
    model = sheets.clamped(model, np.flatnonzero(X[:, 0] == 0))
    share = np.full(across + 1, 1 / across)
    share[[0, -1]] /= 2
    load = np.zeros_like(X)
    load[X[:, 0] == LENGTH, 2] = -LOAD * share
    return model, load


def deflection(load: Array, moved: Array) -> float:
    """Mean along z (m) of displacements (n, 3), weighed with the load (n, 3)."""
    return float(load[:, 2] @ moved[:, 2] / load[:, 2].sum())


def ours(along: int, across: int) -> Answer:
    """By this solver; the pattern's analysis, which a mesh needs once, is not in the time.

    Raises ConvergenceError."""
    model, load = strip(along, across)
    options, c, solves, spent = NewtonOptions(tolerance=TOLERANCE), sheets.at_rest(model), 0, 0.0
    model.evaluate(c, sheets.NO_TENSION, tangent=True)  # compiles the kernels
    for step in range(1, STEPS + 1):
        loaded = replace(model, dead=load * step / STEPS)
        assert loaded.pattern.analysis
        begin = perf_counter()
        solution = solve(loaded, c, sheets.NO_TENSION, options, near=True)
        spent += perf_counter() - begin
        c, solves = solution.configuration, solves + solution.solves
    return Answer(deflection(load, c.x - model.reference), solves, spent / solves, chosen())


def kratos(along: int, across: int) -> Answer:
    """By Kratos' corotational thick shell (MITC4 with enhanced membrane strains); its set-up and
    that of its matrix are not in the time.

    Raises ConvergenceError, and RuntimeError for what Kratos refuses."""
    import KratosMultiphysics as KM
    import KratosMultiphysics.StructuralMechanicsApplication as SMA

    KM.ParallelUtilities.SetNumThreads(1)
    sheet, load = strip(along, across)
    model = KM.Model()
    part = _kratos_part(KM, SMA, model, sheet)
    loaded = [part.Nodes[int(i) + 1] for i in np.flatnonzero(load[:, 2])]
    for node in loaded:
        part.CreateNewCondition("PointLoadCondition3D1N", node.Id, [node.Id], part.Properties[1])
    strategy = _kratos_newton(KM, part)
    solves, spent = 0, 0.0
    for step in range(1, STEPS + 1):
        part.ProcessInfo[KM.STEP] = step
        part.CloneTimeStep(float(step))
        for node in loaded:
            force = [0.0, 0.0, load[node.Id - 1, 2] * step / STEPS]
            node.SetSolutionStepValue(SMA.POINT_LOAD, KM.Array3(force))
        strategy.InitializeSolutionStep()
        strategy.Predict()
        begin = perf_counter()
        if not strategy.SolveSolutionStep():
            raise ConvergenceError(f"Kratos did not reach equilibrium in step {step} of {STEPS}")
        spent += perf_counter() - begin
        strategy.FinalizeSolutionStep()
        solves += part.ProcessInfo[KM.NL_ITERATION_NUMBER]
    moved = np.array([list(n.GetSolutionStepValue(KM.DISPLACEMENT)) for n in part.Nodes])
    return Answer(deflection(load, moved), solves, spent / solves, "Eigen's SparseLU")


def _kratos_part(KM: Any, SMA: Any, model: Any, sheet: ShellModel) -> Any:
    """Kratos' model of the sheet, its nodes and elements numbered from 1 in our order."""
    part = model.CreateModelPart("strip")
    part.ProcessInfo[KM.DOMAIN_SIZE] = 3
    pairs = [(KM.DISPLACEMENT, KM.REACTION), (KM.ROTATION, KM.REACTION_MOMENT)]
    for variable in (*sum(pairs, ()), SMA.POINT_LOAD):
        part.AddNodalSolutionStepVariable(variable)
    part.SetBufferSize(2)
    for i, x in enumerate(sheet.reference, 1):
        part.CreateNewNode(i, *map(float, x))
    values = part.Properties[1]
    values.SetValue(KM.YOUNG_MODULUS, MODULUS)
    values.SetValue(KM.POISSON_RATIO, POISSON)
    values.SetValue(KM.THICKNESS, THICKNESS)
    values.SetValue(KM.DENSITY, 1000.0)  # asked for, though nothing here has weight
    # In 10.4 the element of this name wants the law of a section, not one of plane stress.
    values.SetValue(KM.CONSTITUTIVE_LAW, SMA.ReissnerMindlinShellElasticConstitutiveLaw())
    for i, quad in enumerate(sheet.quads, 1):
        corners = [int(n) + 1 for n in quad]
        part.CreateNewElement("ShellThickElementCorotational3D4N", i, corners, values)
    variables = [
        [KM.KratosGlobals.GetVariable(f"{v.Name()}_{axis}") for v in pair]
        for pair in pairs
        for axis in "XYZ"
    ]
    for dof, reaction in variables:
        KM.VariableUtils().AddDof(dof, reaction, part)
        for i in sheet.ties.node:
            part.Nodes[int(i) + 1].Fix(dof)
    return part


def _kratos_newton(KM: Any, part: Any) -> Any:
    """Kratos' Newton, its mesh moving with the solution as its own shell solvers have it."""
    from KratosMultiphysics.python_linear_solver_factory import ConstructSolver

    linear = ConstructSolver(KM.Parameters('{"solver_type": "LinearSolversApplication.sparse_lu"}'))
    most, reactions, renew, move = 30, False, False, True
    strategy = KM.ResidualBasedNewtonRaphsonStrategy(
        part,
        KM.ResidualBasedIncrementalUpdateStaticScheme(),
        KM.ResidualCriteria(TOLERANCE, 1e-12),
        KM.ResidualBasedBlockBuilderAndSolver(linear),
        most,
        reactions,
        renew,
        move,
    )
    strategy.SetEchoLevel(0)
    strategy.Initialize()
    strategy.Check()  # only now: it asks the elements for their laws, and they have none before
    return strategy


PROGRAMS: dict[str, Callable[[int, int], Answer]] = {"ours": ours, "kratos": kratos}


def apart(call: Sequence[str]) -> Answer:
    """The answer that a command run with one thread prints, as JSON on the last of its lines that
    begin with a brace.

    Raises CosimError with the reason where it fails or crashes."""
    here = {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        call, capture_output=True, text=True, check=False, env={**os.environ, **ONE_THREAD, **here}
    )
    if done.returncode < 0:
        raise CosimError(f"crashed: {signal.Signals(-done.returncode).name}")
    answers = [line for line in done.stdout.splitlines() if line.startswith("{")]
    if done.returncode or not answers:
        raise CosimError(f"failed: {_reason(done.stderr)}")
    return Answer(**json.loads(answers[-1]))


def _reason(complaint: str) -> str:
    """The two lines from where an error is first named; before them is Python's trace, after them
    may be Kratos' own."""
    lines = [line.strip() for line in complaint.splitlines() if line.strip()]
    first = next((i for i, line in enumerate(lines) if "Error" in line), max(len(lines) - 1, 0))
    return " ".join(lines[first : first + 2]) or "no reason given"


def solved(program: str, along: int, across: int) -> Answer:
    """By one of the PROGRAMS in a process of its own.  Raises CosimError naming the program."""
    call = [sys.executable, "-m", __name__, program, str(along), str(across)]
    try:
        return apart(call)
    except CosimError as error:
        raise CosimError(f"{program} {error}") from error


def rows(along: int = MESH[0], across: int = MESH[1]) -> Iterator[Row]:
    """The strip's deflection, and an iteration's time, beside Kratos'; none where it is not
    installed."""
    if not find_spec("KratosMultiphysics"):
        return
    name, mesh = "hood strip", f"{along} x {across} quads"
    try:
        mine, peer = (solved(program, along, across) for program in ("ours", "kratos"))
    except CosimError as error:
        nan = float("nan")
        yield Row(name, f"not solved, {mesh}", nan, nan, 0.0, str(error), "absolute")
        return
    source = f"Kratos' corotational MITC shell, solved beside ours; {mesh}"
    yield Row(name, "mean deflection of the tip, m", peer.deflection, mine.deflection, 5e-3, source)
    yield Row(
        name, f"s an iteration, {mine.linear}, at most", peer.solve_s, mine.solve_s, 0.0,
        f"Kratos with {peer.linear}, one thread each", "bound",
    )  # fmt: skip


def _main(program: str, along: str, across: str) -> None:
    print(json.dumps(asdict(PROGRAMS[program](int(along), int(across)))), flush=True)


if __name__ == "__main__":
    _main(*sys.argv[1:])
