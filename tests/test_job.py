"""Stand-alone jobs: what holds, loads and touches the sheet, steps in time, files and commands."""

from __future__ import annotations

import gzip
import json
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
import trimesh
from shells import clamped, contact, guided, mapped, plate, sheet
from typer.testing import CliRunner

from cosim.cli import app
from cosim.port import ConvergenceError, InputError, Motion
from fe_solver.curves import Curve, Drive
from fe_solver.febio.compare import quantities, rows
from fe_solver.febio.figures import PUBLISHED
from fe_solver.febio.like import facet_lift, febio_patch
from fe_solver.febio.read import read_feb
from fe_solver.febio.write import write_feb
from fe_solver.hood_job import job_of_hood
from fe_solver.job import (
    Body,
    ContactPair,
    Held,
    HeldDirector,
    Job,
    NodalForce,
    Part,
    Pressure,
    SpringLaw,
    SpringSet,
    Step,
    Tied,
)
from fe_solver.job_model import JobOptions, job_model
from fe_solver.job_results import write_job
from fe_solver.job_solve import solve_job, spread_times
from fe_solver.materials import Isotropic, Orthotropic
from fe_solver.mid_surface import on_mid_surface
from fe_solver.newton import NewtonOptions, solve
from fe_solver.section import one_law
from fe_solver.shapes import Capsule
from fe_solver.shell_hood import ShellHood

LENGTH, WIDTH, THICK, E = 20e-3, 5e-3, 0.5e-3, 100e6
RAMP = Curve((0.0, 1.0), (0.0, 1.0))
PLAIN = JobOptions(cached=False, spacing=0.5e-3)
COARSE = JobOptions(cached=False, spacing=1e-3)
NONE = (np.zeros((0, 3)), np.zeros((0, 3), dtype=np.intp))


def strip(nx: int = 10, ny: int = 3, nu: float = 0.0, **more) -> Job:
    """A flat strip along x, its nodes on the mid-surface."""
    X, quads = plate(LENGTH, WIDTH, nx, ny)
    ne = len(quads)
    job = Job(
        "strip",
        X,
        np.arange(1, len(X) + 1) * 10,
        quads,
        np.arange(1, ne + 1),
        np.zeros(ne, dtype=np.intp),
        (Part("skin", Isotropic(E, nu)),),
        np.full((ne, 4), THICK),
        np.zeros((ne, 4)),
        np.tile([1.0, 0, 0], (ne, 1)),
        steps=(Step("only", 1.0, 4),),
    )
    return replace(job, **more)


def at(job: Job, x: float) -> np.ndarray:
    return np.flatnonzero(np.isclose(job.points[:, 0], x))


def everywhere(job: Job) -> np.ndarray:
    return np.arange(len(job.points))


def pinned(job: Job, *components: int) -> tuple[Held, ...]:
    return tuple(Held(everywhere(job), c) for c in components)


def body(name: str = "bone", **more) -> Body:
    return Body(name, np.zeros(3), *NONE, **more)


def total(state, source: str, name: str) -> np.ndarray:
    return state.wrench[source][state.model.bodies.index(name), :3]


def test_a_prescribed_displacement_stretches_as_the_law_says():
    job, end = strip(), at(strip(), LENGTH)
    held = (Held(at(job, 0.0), 0), Held(end, 0, Drive(1e-3, RAMP)), *pinned(job, 1, 2))
    job = replace(job, held=held)
    (state,) = solve_job(job, options=PLAIN).states
    stretch = 1.05
    force = stretch * E * (stretch**2 - 1) / 2 * WIDTH * THICK
    assert state.configuration.x[end, 0] == pytest.approx(LENGTH + 1e-3, abs=1e-12)
    assert total(state, "guide", "displacement 2")[0] == pytest.approx(-force, rel=1e-9)
    assert total(state, "guide", "ground")[0] == pytest.approx(force, rel=1e-9)


def test_one_component_given_twice_and_not_alike_is_refused():
    job, end = strip(), at(strip(), LENGTH)
    job = replace(job, held=(*pinned(job, 0), Held(end, 0, Drive(1e-3, RAMP))))
    with pytest.raises(InputError, match=f"of {job.node(end[0])} is given twice"):
        solve_job(job, options=PLAIN)


def bent(**more) -> Job:
    """Tied at one end, loaded across at the other."""
    job = strip(nu=0.3)
    ties, end = (Tied(at(job, 0.0), 0),), at(job, LENGTH)
    load = NodalForce(end, np.array([0.0, 0.0, 0.02]), RAMP)
    return replace(job, **{"bodies": (body(),), "tied": ties, "forces": (load,), **more})


def test_many_steps_end_where_one_does():
    whole = solve_job(bent(), options=PLAIN)
    parts = solve_job(bent(), options=PLAIN, times=[0.2, 0.5, 0.8, 1.0])
    far = whole.states[-1].configuration.x
    assert np.ptp(far[:, 2]) > 2e-3
    assert [s.time for s in parts.states] == [0.2, 0.5, 0.8, 1.0]
    assert np.abs(parts.states[-1].configuration.x - far).max() < 1e-9
    heights = [s.configuration.x[:, 2].max() for s in parts.states]
    assert heights == sorted(heights)
    assert parts.states[0].applied[2] == pytest.approx(0.2 * 0.02 * 4)


@pytest.mark.parametrize(
    ("shortest", "failures", "relaxations"), [(1e-3, range(2, 100), 0), (0.9, range(1, 2), 1)]
)
def test_short_steps_or_a_damped_motion_end_where_one_step_does(shortest, failures, relaxations):
    """Newton may not take the iterations that the whole load takes."""
    (whole,) = solve_job(bent(), options=PLAIN).states
    hasty = replace(PLAIN, shortest=shortest, newton=NewtonOptions(1e-8, max_iterations=8))
    result = solve_job(bent(), options=hasty)
    assert result.effort.failures in failures
    assert result.effort.relaxations == relaxations
    x = result.states[-1].configuration.x
    assert np.abs(x - whole.configuration.x).max() < 1e-9


def test_a_director_turned_through_its_element_is_no_solution():
    """Such a state is an equilibrium of the discrete sheet, of less energy even."""
    (state,) = solve_job(bent(), options=PLAIN).states
    c = state.configuration
    turned = c.d.copy()
    turned[at(bent(), LENGTH)[0]] *= -1
    with pytest.raises(ConvergenceError, match="turned through an element's plane, at node"):
        solve(state.model, replace(c, d=turned), np.zeros(0), PLAIN.newton, near=True)


def test_loads_and_bodies_balance_and_the_tie_carries_the_load():
    state = solve_job(bent(), options=PLAIN).states[-1]
    assert max(state.imbalance) < 1e-7
    assert total(state, "tie", "bone") == pytest.approx([0, 0, 0.08], abs=1e-7)
    arm = state.configuration.x[at(strip(), LENGTH), 0].mean()
    assert state.wrench["tie"][0, 4] == pytest.approx(-0.08 * arm, rel=1e-4)


def test_a_prediction_saves_iterations():
    first = solve_job(bent(), options=PLAIN, times=[0.5, 0.502])
    assert first.states[1].effort.iterations <= 3


def test_a_sheet_follows_the_body_that_turns_without_force():
    turn = (Drive(), Drive(0.7, RAMP), Drive())
    moved = (Drive(), Drive(), Drive(2e-3, RAMP))
    job = strip(nu=0.3)
    bone = Body("bone", np.array([3e-3, 0, 0]), *NONE, moved, turn)
    job = replace(job, bodies=(bone,), tied=(Tied(at(job, 0.0), 0),))
    result = solve_job(job, options=PLAIN)
    (state,) = result.states
    p, R = bone.pose(1.0)
    assert np.abs(state.configuration.x - (job.points - bone.origin) @ R.T - p).max() < 1e-8
    assert np.abs(state.wrench["tie"]).max() < 1e-7
    assert result.effort.steps >= 7


def test_a_hinge_holds_places_and_leaves_directors_free():
    job = bent(held=(Held(at(strip(), LENGTH), 2),), forces=())
    job = replace(job, pressures=(Pressure(np.arange(30), np.ones(30, int), Drive(-1e3, RAMP)),))
    stiff = solve_job(job, options=PLAIN).states[0]
    loose = replace(job, tied=(replace(job.tied[0], clamped=False),))
    hinged = solve_job(loose, options=PLAIN).states[0]
    moment = hinged.wrench["guide"][0, 4] + 0.0
    assert abs(moment) < 1e-9 < 1e-5 < abs(stiff.wrench["tie"][0, 4])
    assert hinged.configuration.x[:, 2].max() > 1.5 * stiff.configuration.x[:, 2].max()


def test_a_held_director_makes_a_mirror_of_the_edge():
    job = strip(nx=16)
    edge, end = at(job, 0.0), at(job, LENGTH)
    held = (Held(edge, 0), *(Held(end, c) for c in (0, 2)), *pinned(job, 1))
    load = Pressure(np.arange(48), np.ones(48, int), Drive(-200.0, RAMP))
    job = replace(job, held=held, pressures=(load,))
    state = solve_job(replace(job, held_directors=(HeldDirector(edge, 0),)), options=PLAIN).states[
        0
    ]
    assert np.abs(state.configuration.d[edge, 0]).max() < 1e-12
    assert np.abs(state.configuration.d[end, 0]).min() > 1e-2


@pytest.mark.parametrize("dead", [True, False])
def test_pressure_pushes_against_the_normal(dead):
    job = bent(forces=())
    quads = np.arange(len(job.quads))
    load = Pressure(quads, np.full(len(quads), -1), Drive(500.0, RAMP), dead)
    state = solve_job(replace(job, pressures=(load,)), options=PLAIN).states[0]
    area = 500.0 * LENGTH * WIDTH
    assert max(state.imbalance) < 1e-7
    if dead:
        assert state.applied[:3] == pytest.approx([0, 0, area], abs=1e-12)
    else:
        assert 0.5 * area < state.applied[2] < area
        assert np.linalg.norm(state.applied[:3]) < area


def sprung(law: SpringLaw, force: float, other: bool = False) -> Job:
    """A strip that slides along x, held by one spring against a force."""
    job = strip()
    first, last = int(at(job, 0.0)[0]), at(job, LENGTH)
    spring = SpringSet(
        "string",
        law,
        np.array([first]),
        np.array([0]),
        np.array([[-4e-3, 0.0, 0.0]]),
        np.array([-1]),
        np.array([3.5e-3]),
    )
    load = NodalForce(last, np.array([force / len(last), 0, 0]), RAMP)
    return replace(job, bodies=(body(),), held=pinned(job, 1, 2), springs=(spring,), forces=(load,))


@pytest.mark.parametrize(
    ("law", "stretch"),
    [
        (SpringLaw(2e3), 1e-3),
        (SpringLaw(2e3, tension_only=True), 1e-3),
        (SpringLaw(0.0, table=Curve((-1e-3, 0.0, 0.5e-3, 2e-3), (-1.0, 0.0, 0.5, 5.0))), 1e-3),
    ],
)
def test_a_spring_stretches_until_it_carries_the_load(law, stretch):
    (state,) = solve_job(sprung(law, 2.0), options=PLAIN).states
    (force,) = state.spring_forces
    assert force == pytest.approx([2.0], rel=1e-7)
    moved = state.configuration.x[0, 0]
    assert 4e-3 + moved - 3.5e-3 == pytest.approx(stretch, rel=1e-6)
    assert total(state, "spring 0", "bone")[0] == pytest.approx(2.0, rel=1e-7)


def test_a_spring_between_two_nodes_pulls_both():
    job = replace(strip(), held=(*pinned(strip(), 1, 2), Held(at(strip(), 0.0), 0)))
    a, b = (int(at(job, x)[0]) for x in (0.0, LENGTH))
    none = np.zeros((1, 3))
    tight = SpringSet(
        "tie",
        SpringLaw(500.0),
        *(np.array(v) for v in ([a], [-1])),
        none,
        np.array([b]),
        np.array([10e-3]),
    )
    (state,) = solve_job(replace(job, springs=(tight,)), options=PLAIN).states
    length = np.linalg.norm(state.configuration.x[b] - state.configuration.x[a])
    assert state.spring_forces[0][0] == pytest.approx(500.0 * (length - 10e-3), rel=1e-9)
    assert length < LENGTH - 1e-6
    assert max(state.imbalance) < 1e-8


def floored(gap: float = 0.0, height: float = 0.0, side: int = -1, lift: float = 0.0) -> Job:
    """A strip pressed on the flat top of a block; its normals point up, away from it."""
    job = strip(nu=0.3)
    block = trimesh.creation.box(bounds=[[-5e-3, -5e-3, -6e-3], [25e-3, 10e-3, 0]])
    bone = Body("block", np.zeros(3), np.array(block.vertices), np.array(block.faces))
    quads = np.arange(len(job.quads))
    pair = ContactPair("pair", quads, np.full(len(quads), side), 0, bone.triangles, gap=gap)
    load = NodalForce(everywhere(job), np.array([0, 0, -1.0 / len(job.points)]), RAMP)
    job = replace(job, points=job.points + np.array([0, 0, lift]), height=job.height + height)
    held = tuple(Held(at(job, x), c) for x, c in ((0.0, 0), (0.0, 1), (LENGTH, 1)))
    return replace(job, bodies=(bone,), held=held, forces=(load,), contacts=(pair,))


@pytest.mark.parametrize(
    ("gap", "height", "rest"),
    [(0.0, 0.0, THICK / 2), (0.1e-3, 0.0, THICK / 2 + 0.1e-3), (0.0, THICK / 2, 0.0)],
)
def test_contact_holds_the_face_that_is_meant_at_its_gap(gap, height, rest):
    job = floored(gap, height, lift=rest + 1e-6)
    (state,) = solve_job(job, options=PLAIN).states
    assert state.contact[0] == pytest.approx([0, 0, -1.0], abs=1e-6)
    assert state.penetration < 2e-6
    assert np.abs(state.configuration.x[:, 2] - rest).max() < 3e-6
    assert max(state.imbalance) < 1e-6


def test_penetration_is_what_is_asked_for():
    job = floored(lift=THICK / 2)
    job = replace(job, held=(*job.held, Held(at(job, 0.0), 2)))
    load = NodalForce(at(job, LENGTH), np.array([0, 0, -5.0]), RAMP)
    fine = solve_job(replace(job, forces=(load,)), options=replace(PLAIN, penetration=1e-7))
    soft = solve_job(replace(job, forces=(load,)), options=replace(PLAIN, penetration=None))
    assert fine.states[0].penetration < 1e-7 < 1e-6 < soft.states[0].penetration


def test_nodes_that_a_body_carries_do_not_touch_it():
    job = floored(lift=THICK / 4)
    job = replace(job, held=(), tied=(Tied(at(job, 0.0), 0),))
    model = job_model(job, PLAIN)
    assert not np.isin(at(job, 0.0), model.base.contacts[0].nodes).any()
    assert len(model.base.contacts[0].nodes) == len(job.points) - len(at(job, 0.0))


def test_a_solve_that_fails_says_when_and_where():
    job = replace(sprung(SpringLaw(1e3), 1.0), springs=())
    options = replace(PLAIN, shortest=0.5, newton=NewtonOptions(max_iterations=5))
    with pytest.raises(ConvergenceError, match=r"strip: .* at t = .*node \d+0 at .*region skin"):
        solve_job(job, options=options)


def test_times_must_ascend():
    with pytest.raises(InputError, match="expected times that ascend"):
        solve_job(bent(), options=PLAIN, times=[0.5, 0.5])
    with pytest.raises(InputError, match="spacing = 0: expected more than zero"):
        JobOptions(spacing=0.0)
    assert spread_times(bent(), until=0.6, states=2) == [0.5, 0.6]
    assert spread_times(bent(), until=2.0) == [1.0, 2.0]


def test_febios_bending_is_stiffer_as_its_constant_thickness_strain_makes_it():
    section = one_law(Isotropic(E, 0.4), np.full(1, THICK))
    ours, theirs = section.linear[0, 0], one_of(febio_patch(section.patches[0]))
    ratio = theirs[3, 3] / ours[3, 3]
    assert ratio == pytest.approx(0.6**2 / 0.2, rel=1e-12)
    assert theirs[:3, :3] == pytest.approx(ours[:3, :3], rel=1e-12)
    assert theirs[6, 6] / ours[6, 6] == pytest.approx(1.2)
    with pytest.raises(InputError, match="Orthotropic"):
        febio_patch(replace(section.patches[0], law=Orthotropic(2.0, 1.0, 0.3, 1.0, 1.0, 1.0)))


def one_of(patch) -> np.ndarray:
    from fe_solver.section import Section

    return Section((patch,)).linear[0, 0]


def rod_job(across: int) -> tuple[Job, float]:
    """A sheet on a cylinder of 8 mm, normals outwards, and the rise of its facets over chords."""

    def shape(uv):
        a = (uv[:, 1] - 0.5) * 15 / 8
        return np.column_stack([LENGTH * uv[:, 0], 8e-3 * np.sin(a), 8e-3 * np.cos(a)])

    X, _ = mapped(6, across, shape)
    job = strip(6, across, points=X)
    chord = 2 * 8e-3 * np.sin(15 / 16 / across)
    return job, chord**2 / (8 * 8e-3)


def test_facets_lie_nearer_to_a_convex_bone_by_two_thirds_of_their_rise():
    job, rise = rod_job(20)
    quads = np.arange(len(job.quads))
    sign = 1 if job_normal_up(job) else -1
    pair = ContactPair("p", quads, np.full(len(quads), -sign), 0, NONE[1])
    inner = np.abs(job.points[:, 1]) < 5e-3
    assert facet_lift(job, pair)[inner] == pytest.approx(2 / 3 * rise, rel=0.01)


def job_normal_up(job: Job) -> bool:
    from fe_solver.hood_model import node_directors

    return bool(node_directors(job.points, job.quads)[:, 2].mean() > 0)


def rod_hood() -> tuple[ShellHood, dict]:
    """A sheet over a rod, tied, sprung, touching it and pulled by one tendon."""

    def shape(uv):
        a, r = (uv[:, 1] - 0.5) * 15 / 8, 8.3e-3 + 0.05e-3 * (1 - uv[:, 0])
        return np.column_stack([30e-3 * uv[:, 0], r * np.sin(a), r * np.cos(a)])

    X, quads = mapped(14, 8, shape)
    model = sheet(X, quads, E, 0.4, THICK, bodies=("rod", "tip"))
    model = clamped(model, np.flatnonzero(X[:, 0] > 29e-3), 1)
    model = guided(model, [np.flatnonzero(X[:, 0] == 0)], [(-1.0, 0, 0)])
    free = np.flatnonzero((X[:, 0] > 0) & (X[:, 0] < 29e-3))
    rod = Capsule(np.array([-0.01, 0, 0]), np.array([0.04, 0, 0]), 8e-3)
    touching = replace(contact(model, rod, free, 2e11, 2e-6), offset=np.full(len(free), THICK / 2))
    model = replace(model, contacts=(touching,))
    rest = Motion(("rod", "tip"), np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)))
    carriers = np.tile([1.0, 0.0], (len(X), 1))
    round_ = trimesh.creation.cylinder(8e-3, sections=256, segment=[[-0.01, 0, 0], [0.04, 0, 0]])
    bones = {"rod": (np.array(round_.vertices), np.array(round_.faces))}
    hood = ShellHood(model, ("EDC",), rest, carriers, (), NewtonOptions(tolerance=1e-9))
    return hood, bones


def test_a_hood_and_its_job_agree_and_so_does_the_file(tmp_path):
    hood, bones = rod_hood()
    tension, tip = np.array([8.0]), np.array([[0.0] * 6, [0.2e-3, 0, 0.1e-3, 0, 0.02, 0]])
    motion = hood.rest.displaced(tip)
    answer = hood.advance(hood.start(motion), motion, tension, np.inf)
    c = answer.state.configuration
    middle = job_of_hood(hood, motion, tension, bones, on_face=False)
    (state,) = solve_job(middle, options=COARSE).states
    moved = np.abs(c.x - middle.points).max()
    assert np.abs(state.configuration.x - c.x).max() < 0.01 * moved
    load = answer.load.wrench[0, answer.load.sources.index("contact"), :3]
    assert state.contact[0] == pytest.approx(load, abs=0.01 * np.abs(load).max())

    faced = job_of_hood(hood, motion, tension, bones)
    write_feb(faced, tmp_path / "hood.feb")
    again = read_feb(tmp_path / "hood.feb")
    (own,), (read,) = (solve_job(j, options=COARSE).states for j in (faced, again))
    assert np.abs(own.configuration.x - read.configuration.x).max() < 1e-4 * moved
    assert read.contact[0] == pytest.approx(own.contact[0], rel=1e-3, abs=1e-4)
    low = own.configuration.x[own.model.contacts[0].nodes]
    assert np.linalg.norm(low[:, 1:], axis=1).min() == pytest.approx(8e-3, abs=1e-5)


@pytest.fixture(scope="module")
def packed(tmp_path_factory) -> Path:
    """A folder with one model of our own: 112 quads tied, guided, pulled and pressed on a rod."""
    folder = tmp_path_factory.mktemp("models")
    packed = Path(__file__).parent / "data" / "hood_over_rod.feb.gz"
    (folder / "hood_over_rod.feb").write_bytes(gzip.decompress(packed.read_bytes()))
    return folder


@pytest.mark.parametrize(
    ("thin", "gap", "options"),
    [
        (1.0, 0.0, {"contact_factor": 10.0, "penetration": None}),
        (1.0, 0.0, {"contact_factor": 100.0, "penetration": None}),
        (1.0, -0.2e-3, {}),
        (0.2, 0.0, {}),
        (0.1, 0.0, {}),
    ],
)
def test_stiff_contact_a_gap_and_thin_sheets_are_solved(packed, thin, gap, options):
    """What FEBio failed on in a model of this kind (its README): all balance.  The tip of thinner
    sheets stands still, as so few quads would buckle in zigzags where it turns."""
    job = read_feb(packed / "hood_over_rod.feb")
    still = tuple(Body(b.name, b.origin, b.vertices, b.triangles) for b in job.bodies)
    job = replace(
        job,
        bodies=still if thin < 1 else job.bodies,
        thickness=thin * job.thickness,
        height=thin * job.height,
        contacts=tuple(replace(c, gap=c.gap + gap) for c in job.contacts),
    )
    (state,) = solve_job(job, options=replace(COARSE, **options)).states
    assert state.contact[0, 2] < -0.4
    assert state.penetration < 2e-6
    assert state.imbalance[0] < 1e-6


def test_a_folder_of_models_is_timed(packed):
    done = run("bench", "febio", "--models", packed, "--spacing", "1 mm")
    assert done.exit_code == 0, done.output
    assert "no figure" in done.output
    job = read_feb(packed / "hood_over_rod.feb")
    (state,) = solve_job(job, options=replace(COARSE, penetration=None)).states
    for name, value in quantities(job, state, None).items():
        (line,) = (line for line in done.output.splitlines() if f" {name} " in line)
        assert float(line.split("│")[2]) == pytest.approx(value, rel=1e-4)


def test_what_a_job_cannot_say_of_a_hood_is_refused():
    hood, bones = rod_hood()
    with pytest.raises(InputError, match="surface is not given"):
        job_of_hood(hood, hood.rest, np.array([1.0]), {})
    model = replace(
        hood.model, tables=replace(hood.model.tables, weight=1.1 * hood.model.tables.weight)
    )
    with pytest.raises(InputError, match="extra length"):
        job_of_hood(replace(hood, model=model), hood.rest, np.array([1.0]), bones)


def test_results_are_whole_and_can_be_read(tmp_path):
    result = solve_job(bent(), options=PLAIN, times=[0.5, 1.0])
    folder = write_job(tmp_path / "bent", result)
    told = json.loads((folder / "summary.json").read_text())
    assert [s["time"] for s in told["states"]] == [0.5, 1.0]
    mesh = meshio.read(folder / "state_001.vtu")
    x = result.states[1].configuration.x
    assert np.allclose(mesh.points, x)
    assert np.allclose(mesh.point_data["displacement"], x - result.job.points)
    assert {"strain", "stress"} <= set(mesh.cell_data)
    assert (folder / "states.pvd").read_text().count("state_00") == 2
    with meshio.xdmf.TimeSeriesReader(folder / "states.xdmf") as reader:
        reader.read_points_cells()
        time, points, _ = reader.read_data(1)
    assert time == 1.0
    assert np.allclose(points["displacement"], x - result.job.points)
    write_job(folder, result)
    assert [p.name for p in tmp_path.iterdir()] == ["bent"]
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter").write_text("dear")
    with pytest.raises(InputError, match="in the way"):
        write_job(tmp_path / "mine", result)


def test_on_its_mid_surface_a_sheet_is_pulled_straight_and_springs_keep_their_slack():
    """Pulled at a face, it bends by the force times half the thickness."""
    job, end = strip(), at(strip(), LENGTH)
    pull = NodalForce(end, np.array([0.5 / len(end), 0, 0]), RAMP)
    tied = Tied(at(job, 0.0), 0)
    job = replace(
        job, height=job.height - THICK / 2, bodies=(body(),), tied=(tied,), forces=(pull,)
    )
    other = np.array([-1, int(end[1])])
    ends = SpringSet(
        "two", SpringLaw(10.0), end[:2], np.array([0, -1]), np.array([[0, 0, 9e-3], [0, 0, 0]]),
        other, np.array([0.03, 0.01]),
    )  # fmt: skip
    bent_, straight = (
        solve_job(j, options=PLAIN).states[-1].configuration for j in (job, on_mid_surface(job))
    )
    assert np.ptp(bent_.x[:, 2]) > 1e-4
    assert np.ptp(straight.x[:, 2]) < 1e-12
    moved = on_mid_surface(replace(job, springs=(ends,)))
    assert moved.points[:, 2] == pytest.approx(-THICK / 2)
    slack = np.hypot(LENGTH, 9e-3) - 0.03
    reach = np.hypot(LENGTH, 9e-3 + THICK / 2)
    assert moved.springs[0].length == pytest.approx([reach - slack, 0.01])


def test_the_force_of_every_spring_is_written(tmp_path):
    result = solve_job(sprung(SpringLaw(2e3), 1.0), options=PLAIN, times=[0.5, 1.0])
    rows_ = (write_job(tmp_path / "out", result) / "springs.csv").read_text().splitlines()
    assert rows_[0] == "time,set,node,end,force_N"
    found = [line.split(",") for line in rows_[1:]]
    assert [f[:4] for f in found] == [[t, "string", "10", "bone"] for t in ("0.5", "1.0")]
    assert [float(f[4]) for f in found] == pytest.approx([0.5, 1.0])


def test_published_figures_are_compared_by_their_names():
    figures = PUBLISHED["free_iso_2000"]
    X, ids = np.zeros((3, 3)), np.array([11, 1, 1271])
    job = replace(strip(), points=X, node_ids=ids)
    (state,) = solve_job(bent(), options=PLAIN).states
    moved = np.array([figures.displacement[i] for i in ids]) * 1e-3
    state = replace(
        state,
        configuration=replace(state.configuration, x=moved),
        spring_forces=(np.array([6.458, -1.0]),),
    )
    found = quantities(job, state, figures)
    table = {r.quantity: r for r in rows(figures, found, found)}
    assert len(table) == 7 + 3
    assert all(r.verdict == "agrees" for k, r in table.items() if k.startswith("u"))
    assert table["largest spring (N)"].difference == pytest.approx(0.0)
    assert table["sum of springs (N)"].verdict == "differs"


def run(*words: str):
    return CliRunner().invoke(app, [str(w) for w in words])


def test_the_command_solves_a_file_and_writes_its_result(tmp_path):
    job = bent(notes=("Output: left alone",))
    write_feb(job, tmp_path / "bent.feb")
    done = run("solve", tmp_path / "bent.feb", "--out", tmp_path / "out", "--states", "2")
    assert done.exit_code == 0, done.output
    assert "largest displacement" in done.output
    assert "t = 0.5" in done.output
    assert "left out:" in done.output
    told = json.loads((tmp_path / "out" / "summary.json").read_text())
    (direct,) = solve_job(read_feb(tmp_path / "bent.feb"), options=PLAIN).states
    top = np.linalg.norm(direct.configuration.x - read_feb(tmp_path / "bent.feb").points, axis=1)
    assert told["states"][-1]["largest_displacement_mm"] == pytest.approx(1e3 * top.max(), rel=1e-6)


def test_the_command_tells_faults_by_its_exit_code(tmp_path):
    (tmp_path / "bad.feb").write_text("<febio_spec version='4.0'><Mesh></febio_spec>")
    bad = run("solve", tmp_path / "bad.feb", "--out", tmp_path / "out")
    assert bad.exit_code == 2
    assert bad.stderr.startswith("cosim: ")
    assert run("solve", tmp_path / "bad.feb", "--penetration", "1 kg").exit_code == 2
    assert run("bench", "febio").exit_code == 2
    assert run("bench", "febio", "--models", tmp_path).exit_code == 2
    loose = replace(sprung(SpringLaw(1e3), 1.0), springs=())
    write_feb(loose, tmp_path / "loose.feb")
    lost = run("solve", tmp_path / "loose.feb", "--out", tmp_path / "out")
    assert lost.exit_code == 1
    assert "no equilibrium" in lost.stderr
    assert not (tmp_path / "out").exists()
