"""Reactions by condition and node, against the loads that they bear in closed form."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import meshio
import numpy as np
import pytest

from fe_solver.febio.read import read_feb
from fe_solver.febio.write import write_feb
from fe_solver.job.curves import Drive
from fe_solver.job.job import HeldDirector, NodalForce, PrescribedDisplacement, RigidLoad
from fe_solver.job.results import body_reactions, reactions, write_job
from fe_solver.job.solve import solve_job
from fe_solver.q4ans.solve import solve_solid
from fe_solver.supports import WALL, Body, SpringLaw, SpringSet, Tied
from tests.fe_solver.job.test_passing import block, raised
from tests.helpers.jobs import (
    LENGTH,
    PLAIN,
    RAMP,
    THICK,
    WIDTH,
    E,
    change_job,
    fix_components,
    nodes_at,
    run,
    strip,
)

SOLVERS = pytest.mark.parametrize("solve", [solve_job, solve_solid])


def on_face(job):
    return change_job(job, height=np.full_like(job.sheet.height, THICK / 2))


def clamped(kind: str):
    """A strip held at x = 0 by a tie, or by displacements and directors."""
    job, first = on_face(strip(16, 2)), nodes_at(strip(16, 2), 0.0)
    if kind == "tie":
        return replace(job, ties=(Tied(first, WALL, name="clamp"),))
    held = tuple(PrescribedDisplacement(first, c, name="clamp") for c in range(3))
    still = tuple(HeldDirector(first, c, name="clamp") for c in range(3))
    return replace(job, held=held, held_directors=still)


def by_name(job, state):
    return {r.condition: r for r in reactions(job, state.reaction)}


@SOLVERS
@pytest.mark.parametrize("kind", ["tie", "displacements"])
def test_a_clamp_bears_the_load_and_its_moment(solve, kind):
    """A cantilever under F at its end, and its own sum by node: -F, and F times the arm that it has
    as it is bent; next to a load that acts on a held node itself, which passes into it at once."""
    job = clamped(kind)
    end, first, force = nodes_at(job, LENGTH), nodes_at(job, 0.0), np.array([0.0, 1e-3, 8e-3])
    loads = (
        NodalForce(end, force / len(end), RAMP),
        NodalForce(first[:1], np.array([0.3, 0, 0]), RAMP),
    )
    job = replace(job, forces=loads)
    (state,) = solve(job, options=PLAIN).states
    clamp, x = by_name(job, state)["clamp"], state.configuration.x
    assert clamp.nodes.tolist() == first.tolist()
    assert clamp.force.sum(axis=0) == pytest.approx(-force - [0.3, 0, 0], abs=1e-8)
    moment = (np.cross(x[first], clamp.force) + clamp.couple).sum(axis=0)
    borne = sum(np.cross(x[n], force / len(end)) for n in end) + np.cross(x[first[0]], [0.3, 0, 0])
    assert moment == pytest.approx(-borne, abs=1e-9)
    assert moment[1] == pytest.approx(8e-3 * LENGTH, rel=0.05)


@SOLVERS
def test_a_clamp_and_a_pull_are_told_apart(solve):
    """The stress of a stretched strip times its section, on either end; together they are nothing,
    which is all that one sum would say."""
    job = on_face(strip())
    first, end = nodes_at(job, 0.0), nodes_at(job, LENGTH)
    named = [(first, 0.0, "clamp"), (end, 1e-3, "pull")]
    held = tuple(PrescribedDisplacement(n, 0, Drive(u, RAMP), name) for n, u, name in named)
    job = replace(job, held=(*held, *fix_components(job, 1, 2)))
    job = replace(job, held_directors=(HeldDirector(first, 0), HeldDirector(end, 0)))
    (state,) = solve(job, options=PLAIN).states
    stretch = 1.05
    tension = stretch * E * (stretch**2 - 1) / 2 * WIDTH * THICK
    found = by_name(job, state)
    assert found["pull"].force.sum(axis=0) == pytest.approx([tension, 0, 0], rel=1e-6)
    assert found["clamp"].force.sum(axis=0) == pytest.approx([-tension, 0, 0], rel=1e-6)
    assert (found["pull"].nodes == end).all()
    assert not found["pull"].force[:, 1:].any()
    # an even pull: half as much on a corner node as on the others
    share = found["pull"].force[:, 0] / tension
    assert share == pytest.approx(np.array([1, 2, 2, 1]) / 6, rel=1e-3)


def test_what_two_conditions_hold_is_the_firsts():
    job = on_face(strip())
    first = nodes_at(job, 0.0)
    held = (
        PrescribedDisplacement(first, 0, name="one"),
        PrescribedDisplacement(first[:2], 0, name="two"),
        PrescribedDisplacement(first, 1),
    )
    reaction = np.zeros((len(job.sheet.points), 6))
    reaction[first, :2], reaction[first, 3:] = 1.0, [2.0, 3.0, 4.0]
    job = replace(job, held=held, held_directors=(HeldDirector(first, 1, name="still"),))
    found = {r.condition: r for r in reactions(job, reaction)}
    assert (found["still"].couple == [2.0, 3.0, 4.0]).all()
    assert not found["one"].couple.any()
    assert found["one"].force[:, 0].sum() == len(first)
    assert not found["two"].force.any()
    assert found["held 3 along y"].force[:, 1].sum() == len(first)


@pytest.mark.parametrize("words", [(), ("--own-shell",)])
def test_a_files_reactions_are_in_table_csv_and_vtu(words, tmp_path):
    """Under the names of the file's conditions, each sum the load's."""
    job = clamped("displacements")
    end = nodes_at(job, LENGTH)
    # written with nodes on the normal's face
    job = change_job(job, height=-job.sheet.height)
    write_feb(replace(job, forces=(NodalForce(end, (0, 0, 1e-3)),)), tmp_path / "bent.feb")
    assert {h.name for h in read_feb(tmp_path / "bent.feb").held} == {"held 1", "held 2", "held 3"}
    done = run("solve", tmp_path / "bent.feb", "-o", tmp_path / "out", *words)
    assert done.exit_code == 0, done.output
    assert "reaction of held 3" in done.output
    load = 1e-3 * len(end)
    (state,) = json.loads((tmp_path / "out" / "summary.json").read_text())["states"]
    assert state["reactions"]["held 3"]["force_N"] == pytest.approx([0, 0, -load], abs=1e-8)
    rows = [*csv.DictReader((tmp_path / "out" / "reactions.csv").open())]
    total = sum(float(r["force_z_N"]) for r in rows if r["condition"] == "held 3")
    assert total == pytest.approx(-load, rel=1e-6)
    data = meshio.read(tmp_path / "out" / "state_000.vtu").point_data
    assert data["reaction"].sum(axis=0) == pytest.approx([0, 0, -load], abs=1e-8)
    couple = sum(float(r["couple_y_Nmm"]) for r in rows)
    assert data["reaction_couple"][:, 1].sum() == pytest.approx(1e-3 * couple)
    assert couple == pytest.approx(1e3 * load * LENGTH, rel=0.05)


def pressed_job():
    """A strip, clamped and under a load, between a block that may only rise, which pushes it and
    hangs on it by a soft spring, and a bone that stands still, to which its end is tied."""
    job = raised(block(gap=0.1e-3), 1e-3)
    push, moved = job.bodies[0], np.array([8e-3, 2e-3, -1e-3])
    free = (False, False, True, False, False, False)
    push = replace(push, origin=moved, vertices=push.vertices - moved, displacement=(0, 0, 0))
    end = nodes_at(job, job.sheet.points[:, 0].max())
    middle = nodes_at(job, job.sheet.points[:, 0].max() / 2)
    anchor = np.tile([2e-3, 0.5e-3, 0], (len(middle), 1))
    soft = SpringSet.to_body("soft", SpringLaw(1.0), middle, 0, anchor, 1e-3)
    bone = Body("a <bone>", origin=job.sheet.points[end[0]] + [1e-3, 2e-3, 0])
    return replace(
        job,
        bodies=(replace(push, free=free), bone, *job.bodies[1:]),
        ties=(*(replace(t, body=t.body + (t.body > 0)) for t in job.ties), Tied(end, 1)),
        springs=(soft,),
        forces=(NodalForce(middle, (1e-3, 2e-3, 4e-3)),),
        rigid_loads=(
            RigidLoad(0, (0.02, 0, 0.05), follows=True),
            RigidLoad(1, (0.3, -0.1, 0.2), (1e-4, 2e-4, 3e-4)),
        ),
    )


@SOLVERS
def test_what_holds_bodies_and_sheet_balances_what_is_applied(solve, tmp_path):
    """In force and in moment about the world's origin, a body by itself too: of the block, whose
    rise is free, what pushes it up is not among what holds it."""
    job = pressed_job()
    result = solve(job, options=PLAIN)
    (state,) = result.states
    c, held = state.configuration, body_reactions(job, state)
    assert [*held] == ["block", "a <bone>"]  # and not the wall, which the clamp's are of
    clamp = next(r for r in reactions(job, state.reaction) if "wall" in r.condition)
    total = state.applied.copy()
    total[:3] += clamp.force.sum(axis=0)
    total[3:] += (np.cross(c.x[clamp.nodes], clamp.force) + clamp.couple).sum(axis=0)
    for i, w in enumerate(held.values()):
        total += np.concatenate([w[:3], w[3:] + np.cross(c.position[i], w[:3])])
    np.testing.assert_allclose(total[:3], 0, atol=1e-6 * 0.3)
    np.testing.assert_allclose(total[3:], 0, atol=1e-6 * 3e-3)
    block_ = held["block"]
    assert block_[2] == 0.0
    assert block_[0] == pytest.approx(-0.02, abs=1e-3)  # but for what the spring pulls
    folder = write_job(tmp_path / "out", result)
    data = meshio.read(folder / "state_000.vtu").field_data["reaction of a <bone>"]
    np.testing.assert_allclose(data.ravel(), held["a <bone>"], rtol=1e-12)
    (kept,) = json.loads((folder / "summary.json").read_text())["states"]
    assert kept["reactions_of_bodies"]["a <bone>"]["force_N"] == held["a <bone>"][:3].tolist()
    rows = [*csv.DictReader((folder / "reactions.csv").open())]
    (row,) = (r for r in rows if r["condition"] == "body a <bone>")
    assert (row["node"], float(row["couple_z_Nmm"])) == ("", pytest.approx(1e3 * data.ravel()[5]))
