"""Small jobs that tests solve: strips held, sprung, pressed, and a hood over a rod."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import trimesh
from typer.testing import CliRunner

from cosim.cli import app
from cosim.port import Motion
from fe_solver.hood.build import ContactLaw, HoodSupports, TendonEnd, shell_hood
from fe_solver.hood.shell_hood import ShellHood
from fe_solver.job.curves import LoadCurve
from fe_solver.job.job import Job, NodalForce, PrescribedDisplacement, Step
from fe_solver.job.model import JobOptions
from fe_solver.materials.linear import Isotropic
from fe_solver.sheet import even_sheet, plate
from fe_solver.solver.newton import NewtonOptions
from fe_solver.supports import Body, ContactPair, SpringLaw, SpringSet, Tied
from fe_solver.surfaces.shapes import Capsule
from tests.proofs.fe.sheets import map_grid

LENGTH, WIDTH, THICK, E = 20e-3, 5e-3, 0.5e-3, 100e6
RAMP = LoadCurve((0.0, 1.0), (0.0, 1.0))
PLAIN = JobOptions(cached=False, spacing=0.5e-3)
COARSE = JobOptions(cached=False, spacing=1e-3)


def change_job(job: Job, **more) -> Job:
    """The job with other values of its own fields and of its sheet's."""
    own = {name: more.pop(name) for name in [*more] if name not in vars(job.sheet)}
    return replace(job, sheet=replace(job.sheet, **more), **own)


def strip(nx: int = 10, ny: int = 3, nu: float = 0.0, **more) -> Job:
    """A flat strip along x, its nodes on the mid-surface."""
    sheet = plate(LENGTH, WIDTH, nx, ny, Isotropic(E, nu), THICK)
    ids = {"node_ids": np.arange(1, len(sheet.points) + 1) * 10}
    ids["element_ids"] = np.arange(1, len(sheet.quads) + 1)
    parts = (replace(sheet.parts[0], name="skin"),)
    job = Job(replace(sheet, parts=parts, **ids), steps=(Step("only", 1.0, 4),), name="strip")
    return change_job(job, **more)


def nodes_at(job: Job, x: float) -> np.ndarray:
    return np.flatnonzero(np.isclose(job.sheet.points[:, 0], x))


def all_nodes(job: Job) -> np.ndarray:
    return np.arange(len(job.sheet.points))


def fix_components(job: Job, *components: int) -> tuple[PrescribedDisplacement, ...]:
    return tuple(PrescribedDisplacement(all_nodes(job), c) for c in components)


def body(name: str = "bone", **more) -> Body:
    return Body(name, **more)


def total(state, source: str, name: str) -> np.ndarray:
    return state.wrench[source][state.bodies.index(name), :3]


def bending_job(**more) -> Job:
    """Tied at one end, loaded across at the other."""
    job = strip(nu=0.3)
    ties, end = (Tied(nodes_at(job, 0.0), 0),), nodes_at(job, LENGTH)
    load = NodalForce(end, np.array([0.0, 0.0, 0.02]), RAMP)
    return change_job(job, **{"bodies": (body(),), "ties": ties, "forces": (load,), **more})


def spring_job(law: SpringLaw, force: float, other: bool = False) -> Job:
    """A strip that slides along x, held by one spring against a force."""
    job = strip()
    first, last = int(nodes_at(job, 0.0)[0]), nodes_at(job, LENGTH)
    end = np.array([[-4e-3, 0.0, 0.0]])
    spring = SpringSet.to_body("string", law, np.array([first]), 0, end, 3.5e-3)
    load = NodalForce(last, np.array([force / len(last), 0, 0]), RAMP)
    return replace(
        job, bodies=(body(),), held=fix_components(job, 1, 2), springs=(spring,), forces=(load,)
    )


def contact_job(gap: float = 0.0, height: float = 0.0, side: int = -1, lift: float = 0.0) -> Job:
    """A strip pressed on the flat top of a block; its normals point up, away from it."""
    job = strip(nu=0.3)
    block = trimesh.creation.box(bounds=[[-5e-3, -5e-3, -6e-3], [25e-3, 10e-3, 0]])
    bone = Body("block", np.zeros(3), np.array(block.vertices), np.array(block.faces))
    quads = np.arange(len(job.sheet.quads))
    pair = ContactPair("pair", quads, np.full(len(quads), side), 0, bone.triangles, gap=gap)
    load = NodalForce(all_nodes(job), np.array([0, 0, -1.0 / len(job.sheet.points)]), RAMP)
    job = change_job(
        job, points=job.sheet.points + np.array([0, 0, lift]), height=job.sheet.height + height
    )
    held = tuple(
        PrescribedDisplacement(nodes_at(job, x), c) for x, c in ((0.0, 0), (0.0, 1), (LENGTH, 1))
    )
    return replace(job, bodies=(bone,), held=held, forces=(load,), contacts=(pair,))


def one_of(patch) -> np.ndarray:
    from fe_solver.materials.section import Section

    return Section((patch,)).linear[0, 0]


def rod_hood(springs=(), eyelet=None, turned=False) -> tuple[ShellHood, dict]:
    """A sheet over a rod, tied, sprung, touching it and pulled by one tendon; `turned`: its normals
    point the other way."""

    def shape(uv):
        a, r = (uv[:, 1] - 0.5) * 15 / 8, 8.3e-3 + 0.05e-3 * (1 - uv[:, 0])
        return np.column_stack([30e-3 * uv[:, 0], r * np.sin(a), r * np.cos(a)])

    points, quads = map_grid(14, 8, shape)
    quads = quads[:, ::-1] if turned else quads
    hooded = even_sheet(points, quads, Isotropic(E, 0.4), THICK)
    X, end = hooded.points, hooded.edge("x0")
    rod = Capsule(np.array([-0.01, 0, 0]), np.array([0.04, 0, 0]), 8e-3)
    supports = HoodSupports(
        Motion(("rod", "tip"), np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1))),
        np.tile([1.0, 0.0], (len(X), 1)),
        springs,
        (Tied(np.flatnonzero(X[:, 0] > 29e-3), 1),),
        "rod",
        np.array([-1.0, 0, 0]),
        {"EDC": TendonEnd(end, np.full(len(end), 1 / len(end)), eyelet)},
        ContactLaw(2e11, 2e-6, {"rod": rod}, {"rod": 0.0}),
        NewtonOptions(tolerance=1e-9),
    )
    round_ = trimesh.creation.cylinder(8e-3, sections=256, segment=[[-0.01, 0, 0], [0.04, 0, 0]])
    bones = {"rod": (np.array(round_.vertices), np.array(round_.faces))}
    return shell_hood(hooded, supports), bones


def roped_hood() -> tuple[ShellHood, dict]:
    """The same, its tendon hung on ropes through an eyelet 12 mm off, with one-sided springs to the
    rod that set in over a toe: two taut, two within their toe, two slack far beyond it."""
    X = rod_hood()[0].model.reference
    held = np.flatnonzero(np.isclose(X[:, 0], X[:, 0].max() / 2))[[0, 1, 3, 5, 7, 8]]
    slack = 3e-3 + 1e-3 * np.array([-0.8, 0.2, 2.5, 2.5, 0.2, -0.8])
    law = SpringLaw(300.0, tension_only=True, toe=0.6e-3)
    band = SpringSet.to_body("band", law, held, 0, X[held] + np.array([3e-3, 0.0, 0.0]), slack)
    return rod_hood((band,), np.array([-12e-3, 2e-3, 8.4e-3]))


def run(*words: str):
    return CliRunner().invoke(app, [str(w) for w in words])
