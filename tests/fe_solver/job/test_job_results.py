"""What a solved job leaves behind, and the commands."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial

import meshio
import numpy as np
import pytest

from cosim.errors import InputError
from fe_solver.febio.read import read_feb
from fe_solver.febio.write import write_feb
from fe_solver.job import model
from fe_solver.job.curves import LoadCurve
from fe_solver.job.model import JobOptions
from fe_solver.job.results import write_job
from fe_solver.job.solve import _advice, solve_job
from fe_solver.q4ans.solve import alternatives, solve_solid
from fe_solver.supports import SpringLaw
from tests.helpers.jobs import (
    PLAIN,
    bending_job,
    change_job,
    run,
    spring_job,
    strip,
)
from tests.proofs.fe.febio_figures import PUBLISHED
from tests.proofs.fe.febio_models import Formulation, quantities, rows


def test_results_are_whole_and_can_be_read(tmp_path):
    result = solve_job(bending_job(), options=PLAIN, times=[0.5, 1.0])
    folder = write_job(tmp_path / "bent", result)
    told = json.loads((folder / "summary.json").read_text())
    assert [s["time"] for s in told["states"]] == [0.5, 1.0]
    mesh = meshio.read(folder / "state_001.vtu")
    x = result.states[1].configuration.x
    assert np.allclose(mesh.points, x)
    assert np.allclose(mesh.point_data["displacement"], x - result.job.sheet.points)
    assert {"strain", "stress"} <= set(mesh.cell_data)
    assert (folder / "states.pvd").read_text().count("state_00") == 2
    with meshio.xdmf.TimeSeriesReader(folder / "states.xdmf") as reader:
        reader.read_points_cells()
        time, points, _ = reader.read_data(1)
    assert time == 1.0
    assert np.allclose(points["displacement"], x - result.job.sheet.points)
    write_job(folder, result)
    assert [p.name for p in tmp_path.iterdir()] == ["bent"]
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter").write_text("dear")
    with pytest.raises(InputError, match="in the way"):
        write_job(tmp_path / "mine", result)


def test_the_force_of_every_spring_is_written(tmp_path):
    result = solve_job(spring_job(SpringLaw(2e3), 1.0), options=PLAIN, times=[0.5, 1.0])
    rows_ = (write_job(tmp_path / "out", result) / "springs.csv").read_text().splitlines()
    assert rows_[0] == "time,set,node,end,force_N"
    found = [line.split(",") for line in rows_[1:]]
    assert [f[:4] for f in found] == [[t, "string", "10", "bone"] for t in ("0.5", "1.0")]
    assert [float(f[4]) for f in found] == pytest.approx([0.5, 1.0])


def test_published_figures_are_compared_by_their_names():
    figures = PUBLISHED["free_iso_2000"]
    X, ids = np.zeros((3, 3)), np.array([11, 1, 1271])
    job = change_job(strip(), points=X, node_ids=ids)
    (state,) = solve_job(bending_job(), options=PLAIN).states
    moved = np.array([figures.displacement[i] for i in ids]) * 1e-3
    state = replace(
        state,
        configuration=replace(state.configuration, x=moved),
        spring_forces=(np.array([6.458, -1.0]),),
    )
    found = quantities(job, state, figures)
    table = {r.quantity: r for r in rows(figures, {Formulation.OWN: found})}
    assert len(table) == 7 + 3
    assert all(r.verdict == "agrees" for k, r in table.items() if k.startswith("u"))
    assert table["largest spring (N)"].off(6.458) == pytest.approx(0.0)
    assert table["sum of springs (N)"].verdict == "differs"


def test_the_command_solves_a_file_and_writes_its_result(tmp_path):
    job = bending_job(notes=("Output: left alone",))
    write_feb(job, tmp_path / "bent.feb")
    done = run("solve", tmp_path / "bent.feb", "--out", tmp_path / "out", "--states", "2")
    assert done.exit_code == 0, done.output
    assert "largest displacement" in done.output
    assert "t = 0.5" in done.output
    assert "reaction of body bone" in done.output
    assert "left out:" in done.output
    told = json.loads((tmp_path / "out" / "summary.json").read_text())
    (direct,) = solve_solid(read_feb(tmp_path / "bent.feb")).states
    top = np.linalg.norm(
        direct.configuration.x - read_feb(tmp_path / "bent.feb").sheet.points, axis=1
    )
    assert told["states"][-1]["largest_displacement_mm"] == pytest.approx(1e3 * top.max(), rel=1e-6)


def test_a_file_bends_as_febios_shells_unless_told_otherwise(tmp_path):
    """At nu = 0.3 thickness locking makes a sheet (1 - nu)^2 / (1 - 2 nu) = 1.225 times as stiff in
    bending, less where it is narrow and curls."""
    job = bending_job()
    write_feb(
        change_job(job, height=job.sheet.height + job.sheet.thickness / 2), tmp_path / "bent.feb"
    )
    largest = []
    for words in ((), ("--own-shell",)):
        done = run("solve", tmp_path / "bent.feb", "--out", tmp_path / f"out{len(words)}", *words)
        assert done.exit_code == 0, done.output
        told = json.loads((tmp_path / f"out{len(words)}" / "summary.json").read_text())
        largest.append(told["states"][-1]["largest_displacement_mm"])
    assert 1.03 < largest[1] / largest[0] < 1.225


def test_the_nearest_is_advised_first():
    job = spring_job(SpringLaw(1e3), 1.0)
    on_face = change_job(job, height=job.sheet.height + job.sheet.thickness / 2)
    told = _advice(on_face, 3, alternatives(on_face))
    places = [told.index(w) for w in ("--element q4ans", "--mid-surface")]
    assert places == sorted(places)
    assert not alternatives(job)  # nodes lie on no face
    assert "q4ans" not in _advice(on_face, 0, alternatives(on_face))  # perhaps nothing holds it
    assert _advice(job, 3, ()) == ""


@pytest.mark.slow
def test_the_command_tells_faults_by_its_exit_code(tmp_path, monkeypatch):
    """Where no equilibrium is found, after two halvings of the step."""
    monkeypatch.setattr(model, "JobOptions", partial(JobOptions, shortest=0.3))
    (tmp_path / "bad.feb").write_text("<febio_spec version='4.0'><Mesh></febio_spec>")
    bad = run("solve", tmp_path / "bad.feb", "--out", tmp_path / "out")
    assert bad.exit_code == 2
    assert bad.stderr.startswith("cosim: ")
    assert run("solve", tmp_path / "bad.feb", "--penetration", "1 kg").exit_code == 2
    assert run("bench", "febio").exit_code == 2
    assert run("bench", "febio", "--models", tmp_path).exit_code == 2
    loose = replace(spring_job(SpringLaw(1e3), 1.0), springs=())
    write_feb(loose, tmp_path / "loose.feb")
    lost = run("solve", tmp_path / "loose.feb", "--out", tmp_path / "out")
    assert lost.exit_code == 1
    assert "no equilibrium" in lost.stderr
    assert "--mid-surface" not in lost.stderr
    assert not (tmp_path / "out").exists()
    never = SpringLaw(1e3, table=LoadCurve((-1.0, 1.0), (0.0, 0.0)))
    write_feb(spring_job(never, 1.0), tmp_path / "slack.feb")
    slack = run("solve", tmp_path / "slack.feb", "--element", "q4ans", "--out", tmp_path / "out")
    assert slack.exit_code == 1
    assert "no equilibrium of q4ans" in slack.stderr
    assert "To try: --own-shell" in slack.stderr
    slack = run("solve", tmp_path / "slack.feb", "--out", tmp_path / "out")
    assert "our own shell, since FEBio's (q4ans) finds no equilibrium:" in slack.stdout
    assert slack.exit_code == 1
    assert "pull at a face of the sheet" in slack.stderr
