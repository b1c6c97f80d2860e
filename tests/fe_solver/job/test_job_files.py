"""Jobs beside hoods and FEBio's models: the same sheet, its mid-surface, FEBio's hard cases."""

from __future__ import annotations

import gzip
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cosim.errors import InputError
from fe_solver.febio.read import read_feb
from fe_solver.febio.write import write_feb
from fe_solver.forces.springs import ROPE
from fe_solver.hood.as_job import job_of_hood
from fe_solver.job.job import NodalForce
from fe_solver.job.model import move_to_mid_surface
from fe_solver.job.solve import solve_job
from fe_solver.supports import Body, SpringLaw, SpringSet, Tied
from tests.helpers.febio_schema import faults
from tests.helpers.folders import ROOT, TEST_DATA
from tests.helpers.jobs import (
    COARSE,
    LENGTH,
    PLAIN,
    RAMP,
    THICK,
    body,
    change_job,
    nodes_at,
    rod_hood,
    roped_hood,
    strip,
    total,
)
from tests.proofs.fe.febio_models import quantities


def test_a_hood_and_its_job_agree_and_so_does_the_file(tmp_path):
    hood, bones = rod_hood()
    tension, tip = np.array([8.0]), np.array([[0.0] * 6, [0.2e-3, 0, 0.1e-3, 0, 0.02, 0]])
    motion = hood.rest.displace(tip)
    answer = hood.advance(hood.start(motion), motion, tension, np.inf)
    c = answer.state.configuration
    middle = job_of_hood(hood, motion, tension, bones, on_face=False)
    (state,) = solve_job(middle, options=COARSE).states
    moved = np.abs(c.x - middle.sheet.points).max()
    assert np.abs(state.configuration.x - c.x).max() < 0.01 * moved
    load = answer.load.wrench[0, answer.load.sources.index("contact"), :3]
    assert state.contact[0] == pytest.approx(load, abs=0.01 * np.abs(load).max())

    faced = job_of_hood(hood, motion, tension, bones)
    write_feb(faced, tmp_path / "hood.feb")
    assert faults(tmp_path / "hood.feb") == []
    again = read_feb(tmp_path / "hood.feb")
    (own,), (read,) = (solve_job(j, options=COARSE).states for j in (faced, again))
    assert np.abs(own.configuration.x - read.configuration.x).max() < 1e-4 * moved
    assert read.contact[0] == pytest.approx(own.contact[0], rel=1e-3, abs=1e-4)
    low = own.configuration.x[own.model.contacts[0].nodes]
    assert np.linalg.norm(low[:, 1:], axis=1).min() == pytest.approx(8e-3, abs=1e-5)


def test_ropes_and_springs_with_a_toe_pull_the_same_in_a_file(tmp_path):
    """A rope is a spring of constant force there, a toe a table."""
    hood, bones = roped_hood()
    tension, motion = np.array([4.0]), hood.rest
    answer = hood.advance(hood.start(motion), motion, tension, np.inf)
    c, points = answer.state.configuration, answer.state.solution.evaluation.points
    middle = job_of_hood(hood, motion, tension, bones, on_face=False)
    (state,) = solve_job(middle, options=COARSE).states
    moved = np.abs(c.x - middle.sheet.points).max()
    assert np.abs(state.configuration.x - c.x).max() < 0.01 * moved
    of_ropes = [total(state, f"spring {i}", "rod") for i in range(1, len(middle.springs))]
    for group, found in ((0, total(state, "spring 0", "rod")), (ROPE, np.sum(of_ropes, axis=0))):
        own = points.gradient[points.group == group].sum(axis=0)
        assert found == pytest.approx(own, abs=0.01 * np.abs(own).max())
    pulled = points.force[points.group == 0]
    assert middle.springs[0].name == "band"
    force = state.spring_forces[0]
    assert force == pytest.approx(pulled, abs=0.01 * pulled.max())
    assert force.min() > -1e-12

    faced = job_of_hood(hood, motion, tension, bones)
    write_feb(faced, tmp_path / "hood.feb")
    assert faults(tmp_path / "hood.feb") == []
    again = read_feb(tmp_path / "hood.feb")
    (own,), (read,) = (solve_job(j, options=COARSE).states for j in (faced, again))
    assert np.abs(own.configuration.x - read.configuration.x).max() < 1e-6
    forces = [np.sort(np.concatenate(s.spring_forces)) for s in (own, read)]
    assert forces[1] == pytest.approx(forces[0], abs=1e-3)
    for source in ("contact", "tie"):
        assert total(read, source, "rod") == pytest.approx(total(own, source, "rod"), abs=1e-3)


@pytest.fixture(scope="module")
def packed(tmp_path_factory) -> Path:
    """A folder with one model of our own: 112 quads tied, guided, pulled and pressed on a rod."""
    folder = tmp_path_factory.mktemp("models")
    packed = TEST_DATA / "hood_over_rod.feb.gz"
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
    job = change_job(
        job,
        bodies=still if thin < 1 else job.bodies,
        thickness=thin * job.sheet.thickness,
        height=thin * job.sheet.height,
        contacts=tuple(replace(c, gap=c.gap + gap) for c in job.contacts),
    )
    (state,) = solve_job(job, options=replace(COARSE, **options)).states
    assert state.contact[0, 2] < -0.4
    assert state.penetration < 2e-6
    assert state.imbalance[0] < 1e-6


@pytest.mark.slow
def test_a_folder_of_models_is_timed(packed):
    words = ["-m", "tests.benches", "febio", "--models", str(packed), "--spacing", "1 mm"]
    env = {**os.environ, "COLUMNS": "200"}
    done = subprocess.run(
        [sys.executable, *words], cwd=ROOT, env=env, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "--element q4ans: CPU" in done.stdout
    job = read_feb(packed / "hood_over_rod.feb")
    (state,) = solve_job(job, options=replace(COARSE, penetration=None)).states
    for name, value in quantities(job, state, None).items():
        (line,) = (line for line in done.stdout.splitlines() if f" {name} " in line)
        assert float(line.split("│")[2].split()[0]) == pytest.approx(value, rel=1e-4)


def test_what_a_job_cannot_say_of_a_hood_is_refused():
    hood, bones = rod_hood()
    with pytest.raises(InputError, match="surface is not given"):
        job_of_hood(hood, hood.rest, np.array([1.0]), {})
    wider = replace(hood.sheet, growth=np.tile([0.1, 0.1], (len(hood.model.quads), 1)))
    stiff = replace(hood.sheet, parts=(replace(hood.sheet.parts[0], bending=1e7 * np.eye(3)),))
    refused = ((wider, "across its fibres"), (stiff, "bending_stiffness"), (None, "cables"))
    for sheet, words in refused:
        with pytest.raises(InputError, match=words):
            job_of_hood(replace(hood, sheet=sheet), hood.rest, np.array([1.0]), bones)


def test_on_its_mid_surface_a_sheet_is_pulled_straight_and_springs_keep_their_slack():
    """Pulled at a face, it bends by the force times half the thickness."""
    job, end = strip(), nodes_at(strip(), LENGTH)
    pull = NodalForce(end, np.array([0.5 / len(end), 0, 0]), RAMP)
    tied = Tied(nodes_at(job, 0.0), 0)
    job = change_job(
        job, height=job.sheet.height - THICK / 2, bodies=(body(),), ties=(tied,), forces=(pull,)
    )
    other = np.array([-1, int(end[1])])
    ends = SpringSet(
        "two", SpringLaw(10.0), end[:2], np.array([0, -1]), np.array([[0, 0, 9e-3], [0, 0, 0]]),
        other, np.array([0.03, 0.01]),
    )  # fmt: skip
    bent_, straight = (
        solve_job(j, options=PLAIN).states[-1].configuration
        for j in (job, move_to_mid_surface(job))
    )
    assert np.ptp(bent_.x[:, 2]) > 1e-4
    assert np.ptp(straight.x[:, 2]) < 1e-12
    moved = move_to_mid_surface(replace(job, springs=(ends,)))
    assert moved.sheet.points[:, 2] == pytest.approx(-THICK / 2)
    slack = np.hypot(LENGTH, 9e-3) - 0.03
    reach = np.hypot(LENGTH, 9e-3 + THICK / 2)
    assert moved.springs[0].length == pytest.approx([reach - slack, 0.01])
