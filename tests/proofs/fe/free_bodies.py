"""A strip with a rigid block at its end, which equilibrium moves under forces and moments, and
conditions of single steps, against beams."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from cosim.port import Array, rotation_vector
from fe_solver.job.curves import Drive, LoadCurve
from fe_solver.job.job import Job, NodalForce, PrescribedDisplacement, RigidLoad, Step
from fe_solver.job.results import reactions
from fe_solver.job.solve import JobResult, JobState, solve_job
from fe_solver.materials.linear import Isotropic
from fe_solver.q4ans.solve import solve_solid
from fe_solver.sheet import plate
from fe_solver.supports import WALL, Body, Given, Tied
from tests.helpers.rows import Row

LENGTH, WIDTH, THICK, E = 20e-3, 4e-3, 0.2e-3, 100e6
BENDING = E * WIDTH * THICK**3 / 12
Solve = Callable[..., JobResult]
ELEMENTS: dict[Solve, str] = {solve_job: "our own shell", solve_solid: "q4ans"}
RAMP = LoadCurve((0.0, 1.0), (0.0, 1.0))
BEAM, ELASTICA = "beam theory", "a pure moment rolls a beam into an arc of M / E I"
MIDDLE = np.array([LENGTH, WIDTH / 2, -THICK / 2])
"""m, of the end of the mid-surface; the nodes are on the face z = 0."""


def along(axis: int, value: float) -> tuple[Drive, Drive, Drive]:
    """A ramp of one component."""
    x, y, z = (Drive(value if i == axis else 0.0, RAMP) for i in range(3))
    return x, y, z


def blocked(block: Body | None = None, **more) -> Job:
    """A strip clamped at x = 0, its other end tied to a block about the end's middle."""
    block = Body("block", MIDDLE, free=(True,) * 6) if block is None else block
    sheet = plate(LENGTH, WIDTH, 40, 2, Isotropic(E, 0.0), THICK)
    sheet = replace(sheet, height=np.full_like(sheet.height, -THICK / 2))
    ties = (Tied(sheet.edge("x0"), WALL, name="clamp"), Tied(sheet.edge("x1"), 0, name="block"))
    more = {"steps": (Step("only", 1.0, 10),), **more}
    return Job(sheet, ties=ties, bodies=(block,), name="blocked", **more)


def moved(state: JobState) -> tuple[Array, Array]:
    """How far the block's origin has moved (3,) m and turned (3,) rad."""
    c = state.configuration
    return c.position[0] - MIDDLE, rotation_vector(c.rotation[0])


def with_motions(*given: int) -> Body:
    """The block with these of its six motions held."""
    return Body("block", MIDDLE, free=tuple(i not in given for i in range(6)))


def load_rows(solve: Solve) -> Iterator[Row]:
    """Small loads: a force at the end, along the axis too, a moment, and both with a roller."""
    force, moment = 1e-5, 1e-6
    (state,) = solve(blocked(rigid_loads=[RigidLoad(0, along(2, force))])).states
    at, turned = moved(state)
    name = "block at a cantilever's end, force across"
    yield Row(name, "deflection", force * LENGTH**3 / (3 * BENDING), at[2], 2e-3, BEAM)
    yield Row(name, "turn", -force * LENGTH**2 / (2 * BENDING), turned[1], 2e-3, BEAM)
    clamp = reactions(blocked(), state.reaction)[0]
    yield Row(name, "reaction of the clamp, N", -force, clamp.force[:, 2].sum(), 1e-5, "statics")
    (state,) = solve(blocked(rigid_loads=[RigidLoad(0, along(0, 1e-3))])).states
    target = 1e-3 * LENGTH / (E * WIDTH * THICK)
    name = "block at a cantilever's end, force along"
    yield Row(name, "stretch", target, moved(state)[0][0], 1e-3, "E A")
    held = with_motions(2)
    job = blocked(held, rigid_loads=[RigidLoad(0, moment=along(1, moment))])
    (state,) = solve(job).states
    name = "block on a roller, moment"
    yield Row(name, "turn", moment * LENGTH / (4 * BENDING), moved(state)[1][1], 3e-3, BEAM)
    roller = state.wrench["tie"][0, 2]
    yield Row(name, "force on the roller, N", -1.5 * moment / LENGTH, roller, 3e-3, BEAM)


def arc_rows(solve: Solve) -> Iterator[Row]:
    """Pure moments, to a whole circle."""
    for share in (0.25, 0.5, 1.0):
        angle = 2 * np.pi * share
        load = RigidLoad(0, moment=along(1, -angle * BENDING / LENGTH))
        (state,) = solve(blocked(rigid_loads=[load])).states
        at, turned = moved(state)
        end = LENGTH * np.array([np.sin(angle) / angle - 1, (1 - np.cos(angle)) / angle])
        name = f"block under a moment that rolls the strip by {360 * share:g} degrees"
        for axis, target in zip((0, 2), end, strict=True):
            words = f"displacement along {'xyz'[axis]} over the length"
            yield Row(name, words, target / LENGTH, at[axis] / LENGTH, 0.01, ELASTICA, "absolute")
        more = np.remainder(-turned[1] - angle + np.pi, 2 * np.pi) - np.pi
        yield Row(name, "turn over the arc's", 1.0, 1 + more / angle, 0.01, ELASTICA)


def follower_rows(solve: Solve) -> Iterator[Row]:
    """A force that turns with the block, large: the moment at the clamp is the force times the arm
    as it is; a rod shorter than the end's way under a force that keeps its direction."""
    force = 1.5 * BENDING / LENGTH**2
    for follows in (False, True):
        load = RigidLoad(0, along(2, force), follows=follows)
        (state,) = solve(blocked(rigid_loads=[load])).states
        c = state.configuration
        acting = c.rotation[0] @ [0, 0, force] if follows else np.array([0, 0, force])
        clamp = reactions(blocked(), state.reaction)[0]
        name = f"block under a force that {'follows it' if follows else 'keeps its direction'}"
        for axis in (0, 2):
            words = f"reaction of the clamp along {'xyz'[axis]} over the force"
            value = clamp.force[:, axis].sum() / force
            yield Row(name, words, -acting[axis] / force, value, 1e-5, "statics", "absolute")
        places = state.configuration.x[blocked().sheet.edge("x0")]
        about = (np.cross(places - c.position[0], clamp.force) + clamp.couple).sum(axis=0)
        yield Row(name, "moment about the block over F L", 0.0, about[1] / (force * LENGTH), 1e-5,
                  "statics", "absolute")  # fmt: skip


def step_rows(solve: Solve) -> Iterator[Row]:
    """A load of the first step, and a block that it holds, gone in the second."""
    force = 1e-5
    deflection = force * LENGTH**3 / (3 * BENDING)
    steps = (Step("first", 1.0, 4), Step("second", 2.0, 4))
    window = LoadCurve((0.0, 1.0, 1.25), (0.0, 1.0, 0.0))
    load = RigidLoad(0, (Drive(), Drive(), Drive(force, window)))
    bent, back = solve(blocked(steps=steps, rigid_loads=[load])).states
    name = "load of the first step on a block"
    yield Row(name, "deflection at its end", deflection, moved(bent)[0][2], 2e-3, BEAM)
    left = moved(back)[0][2] / deflection
    yield Row(name, "deflection at the second's end, over it", 0.0, left, 1e-6, BEAM, "absolute")
    held, free = (Given.STAYS,) * 6, (Given.FREE,) * 6
    constant = RigidLoad(0, along(2, force))
    for what, motions in (("released", (held, free)), ("fixed", (free, held))):
        block = Body("block", MIDDLE, motions=motions)
        job = blocked(block, steps=steps, rigid_loads=[constant])
        first, second = solve(job).states
        name = f"block that the second step has {what}"
        ends = (0.0, deflection) if what == "released" else (deflection, deflection)
        for state, target in zip((first, second), ends, strict=True):
            words = f"deflection at t = {state.time:g} over the free one"
            value = moved(state)[0][2] / deflection
            yield Row(name, words, target / deflection, value, 3e-3, BEAM, "absolute")
    end = blocked().sheet.edge("x1")
    prop = PrescribedDisplacement(end, 2, name="prop", steps=(0,))
    bare = Job(blocked().sheet, ties=[Tied(blocked().sheet.edge("x0"), WALL)])
    job = replace(bare, steps=steps, held=[prop], forces=[NodalForce(end, [0, 0, force / 3])])
    propped, loose = solve(job).states
    value = (loose.configuration.x - job.sheet.points)[end, 2].mean()
    name = "support of the first step"
    yield Row(name, "deflection at its end, m", 0.0,
              np.abs((propped.configuration.x - job.sheet.points)[:, 2]).max(), 1e-9, BEAM,
              "absolute")  # fmt: skip
    yield Row(name, "deflection once it is gone", deflection, value, 2e-3, BEAM)


def rows(solve: Solve) -> Iterator[Row]:
    """Loads small and large, and single steps, by one of the two elements."""
    for each in (load_rows, arc_rows, follower_rows, step_rows):
        for row in each(solve):
            yield replace(row, name=f"{row.name}, {ELEMENTS[solve]}")
