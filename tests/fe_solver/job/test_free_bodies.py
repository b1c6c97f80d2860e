"""Bodies that equilibrium moves: their tangent, what holds them, and what is said where nothing
does.  Their closed forms are rows of `tests.proofs.fe.free_bodies`."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.cli import app
from cosim.errors import ConvergenceError, InputError
from cosim.port import rotation_matrix
from fe_solver.febio.read import read_feb
from fe_solver.febio.write import write_feb
from fe_solver.job.curves import Drive
from fe_solver.job.free_bodies import NO_TENSION, FreeBodies
from fe_solver.job.job import NodalForce, RigidLoad
from fe_solver.job.model import job_model
from fe_solver.job.solve import solve_job
from fe_solver.q4ans.bodies import Pull
from fe_solver.q4ans.model import SolidModel, solid_model
from fe_solver.q4ans.solve import solve_solid
from fe_solver.solver.newton import NewtonOptions, solve
from fe_solver.solver.residual import length_scale
from fe_solver.supports import Body, SpringLaw, SpringSet, Tied
from tests.fe_solver.febio.test_feb_steps import CLAMP, SOLVERS
from tests.fe_solver.job.test_passing import block, raised
from tests.helpers.feb_strips import FIXED, LENGTH, THICK, WIDTH, E, read_strip, strip_text
from tests.helpers.jobs import PLAIN, nodes_at
from tests.proofs.fe.free_bodies import BENDING as STIFF
from tests.proofs.fe.free_bodies import LENGTH as LONG
from tests.proofs.fe.free_bodies import along, blocked

BENDING = E * WIDTH * THICK**3 / 12
"""N mm2."""
TIED = CLAMP.removeprefix("<Boundary>").removesuffix("</Boundary>")
BOTH = FIXED + TIED


def rigid_load(kind: str, dof: str, value: float | str, more: str = "") -> str:
    inner = f'<rb>block</rb><dof>{dof}</dof><value lc="1">{value}</value>{more}'
    return f'<rigid_load type="{kind}">{inner}</rigid_load>'


def free_block(way: Body, *given: int) -> Body:
    """A body of which all motions but the given ones are free."""
    free = tuple(i not in given for i in range(6))
    return replace(way, displacement=(Drive(),) * 3, free=free)


def mixed_model(*given: int, touches: bool) -> SolidModel:
    """A strip that a free block is tied to, presses on and hangs on springs of, under all loads."""
    job = raised(block(gap=-0.05e-3), 1e-3)
    origin, at = np.array([8e-3, 1e-3, -1e-3]), job.sheet.points[:, 0]
    body = free_block(job.bodies[0], *given)
    body = replace(body, origin=origin, vertices=body.vertices - origin)
    nodes = np.flatnonzero((at > 0.015) & (at < 0.0175))
    anchor, end = np.full((len(nodes), 3), 1e-3), np.flatnonzero(np.isclose(at, at.max()))
    contact = replace(job.contacts[0], penalty=1e9, automatic=False)
    job = replace(
        job,
        bodies=(body, *job.bodies[1:]),
        contacts=(contact,) if touches else (),
        ties=(*job.ties, Tied(end, 0)),
        springs=(SpringSet.to_body("s", SpringLaw(300.0), nodes, 0, anchor, 2e-3),),
        forces=(NodalForce(end, (0.02, 0.1, 0.3)),),
        rigid_loads=(
            RigidLoad(0, (Drive(0.1), Drive(0.2), Drive(-0.4)), follows=True),
            RigidLoad(0, moment=(Drive(1e-4), Drive(2e-4), Drive(-3e-4))),
        ),
    )
    return solid_model(job)


def somewhere(model: SolidModel):
    """Nodes and loads far from equilibrium, the block moved and turned."""
    twists = np.zeros((len(model.job.bodies), 6))
    twists[0] = 1e-5, 1e-5, -1e-5, 0.02, -0.03, 0.01
    loads = model.at(1.0).carry(twists)
    shaken = model.rest + 1e-5 * np.random.default_rng(2).normal(size=model.rest.shape)
    return model.place(shaken, loads), loads


@pytest.mark.parametrize("given", [(), (1, 3, 5)])
def test_the_tangent_is_that_of_differences(given) -> None:
    """By motions of the body and of some nodes: ties, springs, forces at tied nodes, moments, and a
    force that follows."""
    model = mixed_model(*given, touches=False)
    (z, loads), bodies = somewhere(model), model.bodies
    factor = model.body_factor(bodies, z, loads, tuple(model.terms(z, loads)))
    tangent = (factor.spread.T @ factor.full @ factor.spread).toarray()
    for column in [*range(len(tangent) - 6 + len(given), len(tangent)), 0, 17, 40, 99]:
        motion = 1e-7 * factor.spread[:, [column]].toarray().ravel()
        ends = []
        for sign in (1, -1):
            nodes, twists = bodies.split(sign * motion)
            moved = loads.carry(twists)
            to = model.place(z + nodes, moved)
            ends.append(model.unbalanced(to, moved, tuple(model.terms(to, moved))).left)
        slope, scale = (ends[0] - ends[1]) / 2e-7, np.abs(tangent[:, column]).max()
        assert (np.abs(tangent[:, column] - slope) <= 1e-6 * scale).all()


def test_a_motion_of_all_turns_the_forces() -> None:
    """Contact, too: what nodes and body bear turns with them, K (v, w) = w x f."""
    model = mixed_model(touches=True)
    (z, loads), bodies = somewhere(model), model.bodies
    twist = np.array([3, -2, 1, 0.4, 0.7, -0.2])
    terms = tuple(model.terms(z, loads))
    assert all(np.abs(t.force).max(initial=0) > 0 for t in terms if len(t.nodes))
    nodes, wrench = model.imbalance(terms, loads), model.wrench(loads)[0]
    pulls = [Pull(t.nodes, t.force, t.stiffness, t.body) for t in terms]
    full = model.body_factor(bodies, z, loads, terms).full
    ties = bodies.tangent(z, loads.position, [], nodes, model.wrench(loads)[1])
    motion = np.zeros((len(wrench), 6))
    motion[0] = twist
    moved = twist[:3] + np.cross(twist[3:], z - loads.position[0])
    change = (full - ties) @ np.concatenate([moved.ravel(), motion.ravel()])
    borne = bodies.unbalanced(z, loads.position, pulls, nodes + loads.dead, 0 * wrench)
    by_node, by_body = bodies.split(borne)
    turned = np.concatenate([np.cross(twist[3:], by_body[0, i : i + 3]) for i in (0, 3)])
    found, on_body = bodies.split(change)
    np.testing.assert_allclose(found, np.cross(twist[3:], by_node), atol=1e-6 * np.abs(found).max())
    np.testing.assert_allclose(on_body[0], turned, atol=1e-6 * np.abs(turned).max())


def test_the_condensed_tangent_is_that_of_differences() -> None:
    """Of our own shell: what small twists of the block leave, the sheet solved anew at each."""
    size = STIFF / LONG**2
    force = RigidLoad(0, along(2, size), follows=True)
    job = blocked(rigid_loads=[force, RigidLoad(0, moment=along(1, -size * LONG))])
    model, options = job_model(job, PLAIN), NewtonOptions(tolerance=1e-12)
    bodies, shell = FreeBodies(model.motions, model.body_loads, np.inf), model.at(1.0)
    (state,) = solve_job(job, options=PLAIN).states
    at = solve(shell, state.configuration, NO_TENSION, options, True)
    tangent, length = bodies.tangent(at, 1.0), length_scale(shell)
    for column in range(6):
        twist = np.zeros((len(model.bodies), 6))
        twist[0, column] = 1e-6 / (length if column > 2 else 1.0) * length
        left = []
        for sign in (1, -1):
            c = at.configuration
            turned = rotation_matrix(sign * twist[:, 3:]) @ c.rotation
            moved = shell.move_bodies(c, c.position + sign * twist[:, :3], turned)
            near = solve(shell, moved, NO_TENSION, options, True)
            left.append(bodies.unbalanced(near, 1.0)[0])
        step = 2 * twist[0, column] * (length if column > 2 else 1.0)
        slope, scale = (left[0] - left[1]) / step, np.abs(tangent[:, column]).max()
        np.testing.assert_allclose(tangent[:, column], slope, atol=1e-3 * scale)


@pytest.mark.parametrize(
    ("boundary", "rigid", "words"),
    [
        (FIXED, "", "'block' is free, and nothing holds it: no tie, spring or contact"),
        (
            TIED,
            rigid_load("rigid_moment", "Rv", 1),
            "'block' with what is tied to it can move freely",
        ),
        (TIED, "", "the rigid body 'block' with what is tied to it can move freely"),
        (
            FIXED + TIED.replace("</rb>", "</rb><clamp_shells>0</clamp_shells>"),
            rigid_load("rigid_moment", "Rv", 1e-3),
            r"can move freely \(Rv\), and nothing resists it.*Fix or prescribe",
        ),
    ],
)
@SOLVERS
def test_a_body_that_nothing_holds_is_one_message(
    tmp_path: Path, boundary, rigid, words, solver
) -> None:
    with pytest.raises(InputError, match=words):
        solver(read_strip(tmp_path, boundary=boundary, rigid=rigid))


DOFS = "".join(f"<R{d}_dof>1</R{d}_dof>" for d in "xyz")
STAYS = f'<rigid_bc type="rigid_fixed"><rb>block</rb>{DOFS}</rigid_bc>'
LIFT = (
    '<rigid_bc type="rigid_displacement"><rb>block</rb><dof>z</dof><value lc="1">0.05</value>'
    "</rigid_bc>"
)
PARTLY = '<rigid_bc type="rigid_rotation"><rb>block</rb><dof>Rv</dof><value>0.1</value></rigid_bc>'


@pytest.mark.parametrize(
    ("rigid", "words"),
    [
        (PARTLY, "prescribed in part and free in part, which FEBio ends with an error"),
        (rigid_load("rigid_force", "x", 1), "expected <dof> with one of Rx, Ry, Rz"),
        (rigid_load("rigid_moment", "Rx", 1), "expected <dof> with one of Ru, Rv, Rw"),
        (
            rigid_load("rigid_force", "Rx", 1, "<load_type>2</load_type>"),
            "<load_type> 2 is not read",
        ),
        (
            rigid_load("rigid_moment", "Ru", 1, "<load_type>FOLLOW</load_type>"),
            "FOLLOW is not read",
        ),
        (rigid_load("rigid_force", "Rx", 1, "<relative>1</relative>"), "<relative> other than 0"),
        (rigid_load("rigid_couple", "Rx", 1), "rigid_couple"),
        (rigid_load("rigid_force", "Rx", 1).replace("block", "skin"), "'skin' is not rigid"),
    ],
)
def test_what_is_no_load_of_a_body_is_refused(tmp_path: Path, rigid: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_strip(tmp_path, boundary=BOTH, rigid=rigid)


def test_a_free_body_needs_its_centre(tmp_path: Path) -> None:
    text = strip_text(boundary=BOTH, rigid="")
    first, last = text.index("<center_of_mass>"), text.index("</center_of_mass>")
    path = tmp_path / "m.feb"
    path.write_text(text[:first] + text[last + len("</center_of_mass>") :])
    with pytest.raises(InputError, match="<center_of_mass>, at which its loads act"):
        read_feb(path)


@pytest.mark.parametrize("order", [1, -1])
def test_what_is_prescribed_and_fixed_is_prescribed(tmp_path: Path, order: int) -> None:
    """In whichever order; and not prescribed twice."""
    both = "".join([LIFT, STAYS][::order])
    body = read_strip(tmp_path, boundary=BOTH, rigid=both).bodies[0]
    assert [d.at(1.0) for d in body.displacement] == pytest.approx([0, 0, 0.05e-3])
    assert body.free == (False,) * 3 + (True,) * 3
    with pytest.raises(InputError, match="this motion of 'block' is prescribed twice"):
        read_strip(tmp_path, boundary=BOTH, rigid=both + LIFT)


@pytest.mark.parametrize("body", [-1, 2])
def test_a_load_of_a_body_that_is_not_there_is_refused(body: int) -> None:
    with pytest.raises(InputError, match=f"names body index {body}, and there are"):
        solve_job(blocked(rigid_loads=[RigidLoad(body, along(2, 1e-3))]), options=PLAIN)


def test_a_body_that_rolls_a_strip_up_needs_no_shorter_step() -> None:
    """A turn of 2 rad by an end moment, M L / EI, is taken a part at a time within one step."""
    moment = RigidLoad(0, moment=along(1, -2.0 * STIFF / LONG))
    result = solve_job(blocked(rigid_loads=[moment]), options=PLAIN)
    turn = result.states[-1].configuration.rotation[0]
    assert np.arctan2(-turn[0, 2], turn[0, 0]) == pytest.approx(2.0, rel=1e-3)
    assert result.effort.failures == 0


@pytest.mark.parametrize("still", [False, True])
@SOLVERS
def test_a_body_hangs_on_springs_alone(solver, still: bool) -> None:
    """On the clamped nodes of a strip, of which all or one end are held, by F / k below
    where it is without load."""
    load, stiffness, nodes = 0.02, 50.0, blocked().ties[0].nodes
    ends = blocked().sheet.points[nodes] - [0, 0, 5e-3]
    hung = SpringSet.to_body("s", SpringLaw(stiffness), nodes, 0, ends, 5e-3)
    ring = Body("ring", free=(False, False, True, False, False, False))
    pulled = RigidLoad(0, along(2, -load))
    job = blocked(ring, springs=(hung,), rigid_loads=(pulled,))
    clamp = job.ties[0]
    clamp = replace(clamp, nodes=np.arange(len(job.sheet.points))) if still else clamp
    (state,) = solver(replace(job, ties=(clamp,)), options=PLAIN).states
    way = state.configuration.position[0, 2]
    assert way == pytest.approx(-load / (stiffness * len(nodes)), rel=1e-5)


def test_what_is_applied_to_a_body_is_told_about_the_worlds_origin() -> None:
    force, moment = np.array([0, 0, 1e-3]), np.array([0, 1e-6, 0])
    loads = [RigidLoad(0, along(2, force[2])), RigidLoad(0, moment=along(1, moment[1]))]
    (state,) = solve_job(blocked(rigid_loads=loads), options=PLAIN).states
    arm = np.cross(state.configuration.position[0], force)
    assert abs(arm[1]) > 5 * moment[1]
    np.testing.assert_allclose(state.applied, [*force, *(moment + arm)], atol=1e-15)


@SOLVERS
def test_a_part_of_a_body_is_prescribed(tmp_path: Path, solver) -> None:
    """The end's height is given, all else is free: a beam whose end is lifted, 3 E I u / L^3."""
    job = read_strip(tmp_path, cells=16, boundary=BOTH, rigid=LIFT)
    (state,) = solver(job).states
    assert state.configuration.position[0, 2] == pytest.approx(0.05e-3)
    force = 3 * BENDING * 0.05 / LENGTH**3
    assert -state.wrench["tie"][0, 2] == pytest.approx(force, rel=0.01)
    assert state.configuration.rotation[0, 0, 2] == pytest.approx(-1.5 * 0.05 / LENGTH, rel=0.01)


LOAD = 0.05


def pressing_job(gap: float, friction: float = 0.0):
    """A block that may only rise, `gap` m below a strip, on a soft spring to it, under a load."""
    job = raised(block(gap=gap), 1e-3, friction=friction)
    body = free_block(job.bodies[0], 0, 1, 3, 4, 5)
    middle = nodes_at(job, job.sheet.points[:, 0].max() / 2)
    anchor = np.tile([10e-3, 2.5e-3, -1e-3], (len(middle), 1))
    spring = SpringSet.to_body("soft", SpringLaw(1.0), middle, 0, anchor, 1e-3)
    pushed = RigidLoad(0, (Drive(), Drive(), Drive(LOAD)))
    bodies = (body, *job.bodies[1:])
    return replace(job, bodies=bodies, springs=(spring,), rigid_loads=(pushed,))


@SOLVERS
def test_a_block_that_its_load_would_carry_through_a_strip_does_not_pass(solver) -> None:
    """From 3 mm below, where the spring alone would let it rise by 20 mm."""
    try:
        result = solver(pressing_job(3e-3), options=PLAIN)
    except ConvergenceError as error:
        assert "past what it touches" in str(error)
    else:
        assert result.touches[0].touched


@SOLVERS
@pytest.mark.parametrize("friction", [0.0, 0.2])
def test_a_block_presses_a_strip_with_its_load(solver, friction: float) -> None:
    """The contact bears its load, less what the spring does."""
    if friction and solver is solve_solid:
        return
    job, load = pressing_job(0.1e-3, friction), LOAD
    result = solver(job, options=PLAIN)
    (state,) = result.states
    borne = sum(w[0, 2] for w in state.wrench.values())
    assert borne == pytest.approx(-load, rel=1e-5)
    assert state.contact[0, 2] == pytest.approx(-load, rel=0.1)
    assert state.configuration.position[0, 2] > 0.1e-3
    assert result.touches[0].touched
    np.testing.assert_allclose(state.applied[:3], [0, 0, load], atol=1e-12)


@pytest.mark.parametrize("option", [[], ["--own-shell"]])
def test_a_free_body_is_told(tmp_path: Path, option: list[str]) -> None:
    """Table and summary; it is not written as a file."""
    path, moment = tmp_path / "model.feb", 0.01
    rigid = rigid_load("rigid_moment", "Rv", -moment)
    path.write_text(strip_text(cells=16, boundary=BOTH, rigid=rigid))
    command = ["solve", str(path), *option, "--out", str(tmp_path / "out")]
    out = CliRunner().invoke(app, command)
    assert out.exit_code == 0, out.output
    assert "turn of block" in out.output
    (state,) = json.loads((tmp_path / "out" / "summary.json").read_text())["states"]
    turn = state["motion_of_bodies"]["block"]["rotation_deg"][1]
    assert turn == pytest.approx(-np.degrees(moment * LENGTH / BENDING), rel=0.01)
    with pytest.raises(InputError, match="free bodies and loads on bodies are not written"):
        write_feb(read_strip(tmp_path, boundary=BOTH, rigid=""), tmp_path / "out.feb")
