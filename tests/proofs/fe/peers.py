"""The same shell solved by an independent program, where it is installed (extra `peers`).

Each program runs in a process of its own, with one thread: a peer that crashes is a failed row that
says why, and none prints among our results."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib import import_module
from time import perf_counter
from typing import Any

import numpy as np

from cosim import extras
from cosim.errors import ConvergenceError, CosimError
from cosim.port import Array
from fe_solver.solver.linear_algebra import backend_name
from fe_solver.solver.model import ShellModel
from fe_solver.solver.newton import NewtonOptions, solve
from tests.helpers.rows import Row
from tests.proofs.fe import sheets
from tests.proofs.fe.json_command import python, run_json_command, threads
from tests.proofs.fe.paths import error_order, limit

LENGTH, ARC, RADIUS, THICKNESS = 60e-3, 15e-3, 8e-3, 0.5e-3
MODULUS, POISSON, LOAD = 100e6, 0.3, 0.05
"""m, Pa, N: a sheet of a finger's hood in size, bent over a cylinder along x, one end clamped, the
other pressed down (-z) evenly along its edge.  The figures are our choice; the peer solves the
same.  The largest strain is 0.7 %, so that Kratos' law of small strains in turned axes and ours of
Green's strain differ by less than the meshes do."""
NAME = "hood strip"
STEPS = 5
TOLERANCE = 1e-8
"""Newton's tolerance in both programs: ours over the largest nodal force, Kratos' over the step's
first residual."""
MESHES = ((24, 6), (48, 12), (96, 24))
WITHIN = 5e-3
"""On the finest mesh; four times as much on one half as fine, as both converge by order two."""


@dataclass(frozen=True)
class Answer:
    """What a program answers."""

    deflection: float
    """m, mean along z of the loaded edge, weighed so that the load times it is its work."""
    solves: int
    """Linear solves of all steps."""
    solve_s: float
    """For each of them."""
    linear: str
    """The linear solver's name."""


def strip(along: int, across: int) -> tuple[ShellModel, Array]:
    """The clamped sheet of along x across quads, and the load (n, 3) N."""

    def shape(uv: Array) -> Array:
        angle = (uv[:, 1] - 0.5) * ARC / RADIUS
        return np.column_stack([LENGTH * uv[:, 0], RADIUS * np.sin(angle), RADIUS * np.cos(angle)])

    X, quads = sheets.map_grid(along, across, shape)
    model = sheets.sheet(X, quads, MODULUS, POISSON, THICKNESS)
    model = sheets.clamp(model, np.flatnonzero(X[:, 0] == 0))
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
    assert model.pattern.analysis
    for step in range(1, STEPS + 1):
        loaded = model.with_changes(dead=load * step / STEPS)
        begin = perf_counter()
        solution = solve(loaded, c, sheets.NO_TENSION, options, near=True)
        spent += perf_counter() - begin
        c, solves = solution.configuration, solves + solution.solves
    return Answer(deflection(load, c.x - model.reference), solves, spent / solves, backend_name())


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
    strategy, linear = _kratos_newton(KM, part)
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
    return Answer(deflection(load, moved), solves, spent / solves, linear)


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


def _kratos_newton(KM: Any, part: Any) -> tuple[Any, str]:
    """Kratos' Newton, its mesh moving with the solution as its own shell solvers have it, and the
    name of its linear solver: the fastest direct one that it has here."""
    import_module("KratosMultiphysics.LinearSolversApplication")
    factory = KM.LinearSolverFactory()
    name = next(filter(factory.Has, KM.SparseSpace.FastestDirectSolverList()))
    most, reactions, renew, move = 30, False, False, True
    strategy = KM.ResidualBasedNewtonRaphsonStrategy(
        part,
        KM.ResidualBasedIncrementalUpdateStaticScheme(),
        KM.ResidualCriteria(TOLERANCE, 1e-12),
        KM.ResidualBasedBlockBuilderAndSolver(
            factory.Create(KM.Parameters(json.dumps({"solver_type": name})))
        ),
        most,
        reactions,
        renew,
        move,
    )
    strategy.SetEchoLevel(0)
    strategy.Initialize()
    strategy.Check()  # only now: it asks the elements for their laws, and they have none before
    return strategy, name


PROGRAMS: dict[str, Callable[[int, int], Answer]] = {"ours": ours, "kratos": kratos}


def is_installed() -> bool:
    """Whether the peer is installed."""
    return extras.is_installed("KratosMultiphysics")


def solve_with_peer(program: str, along: int, across: int) -> Answer:
    """By one of the PROGRAMS in a process of its own.  Raises CosimError naming the program."""
    call = python("-m", __name__, program, str(along), str(across))
    try:
        return Answer(**run_json_command(call, threads(1, 1)))
    except CosimError as error:
        raise CosimError(f"{program} {error}") from error


def rows(meshes: Sequence[tuple[int, int]] = MESHES) -> Iterator[Row]:
    """The strip's deflection on meshes each twice as fine as the one before, what it tends to, and
    an iteration's time, beside Kratos'; none where it is not installed."""
    if not is_installed():
        return
    try:
        pairs = [
            (solve_with_peer("ours", *mesh), solve_with_peer("kratos", *mesh)) for mesh in meshes
        ]
    except CosimError as error:
        nan = float("nan")
        yield Row(NAME, "not solved", nan, nan, 0.0, str(error), "absolute")
        return
    tips = np.array([[a.deflection for a in pair] for pair in pairs])
    yield from _tip_rows(meshes, tips)
    mine, peer = pairs[-1]
    yield Row(
        NAME, f"s an iteration, {mine.linear}, at most", peer.solve_s, mine.solve_s, 0.0,
        f"Kratos with {peer.linear}, assembly and solve, one thread each, the finest mesh", "bound",
    )  # fmt: skip


def _tip_rows(meshes: Sequence[tuple[int, int]], tips: Array) -> Iterator[Row]:
    """Yield rows of the deflections (k, 2) of the two programs on k meshes; the order is that of
    their difference."""
    source = "Kratos' corotational thick shell (MITC4), solved beside ours"
    apart = np.abs(tips[:, 0] - tips[:, 1])
    for k, (along, across) in enumerate(meshes):
        within = WITHIN * 4 ** (len(meshes) - 1 - k)
        order = error_order(apart[k - 1], apart[k]) if k else None
        what = f"mean deflection of the tip, {along} x {across}, m"
        yield Row(NAME, what, float(tips[k, 1]), float(tips[k, 0]), within, source, order=order)
    mine, peer = (limit(*tips[-2:, i]) for i in (0, 1))
    what = "mean deflection of the tip, extrapolated, m"
    yield Row(NAME, what, peer, mine, WITHIN, f"{source}; both by order two from the last two")


def _main(program: str, along: str, across: str) -> None:
    print(json.dumps(asdict(PROGRAMS[program](int(along), int(across)))), flush=True)


if __name__ == "__main__":
    _main(*sys.argv[1:])
