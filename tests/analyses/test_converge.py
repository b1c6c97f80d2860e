"""A case on several meshes: what is run, what is said of it, and what `cosim run` knows later."""

from __future__ import annotations

import csv
import json
from functools import partial
from pathlib import Path

import pytest
from typer.testing import CliRunner

import cosim
from cosim.analyses import converge
from cosim.analyses.converge import (
    MeshNumber,
    MeshStudy,
    add_errors,
    keep_errors,
    known_errors,
    meshes_of,
    shipped_errors,
    table_of,
)
from cosim.analyses.mesh_series import MeshSeries
from cosim.array_cache import OFF, VARIABLE
from cosim.case.schema import Case
from cosim.cli import app
from cosim.errors import ConvergenceError, InputError
from cosim.outcome import outcome_of
from cosim.results.summary_tables import rows_of
from meshes.hood_lines import fineness, quads_of

COARSE = {"hood.mesh.quads": 104, "output.picture": False}


@pytest.fixture
def cache(monkeypatch, tmp_path: Path) -> Path:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


def study_of(case: Case, values: tuple[float, ...] = (0.3, 0.25, 0.24)) -> MeshStudy:
    series = MeshSeries(factors=(0.25, 1.0, 2.25), values=values, bound=0.01)
    number = MeshNumber("fingertip force", "fingertip_magnitude_N", "N", series)
    return MeshStudy(case, 1, (104, 416, 936), (number,), {}, {})


@pytest.mark.parametrize("quadratic", [False, True])
def test_a_mesh_of_the_family_has_its_fineness(quadratic):
    every = range(1, 14)
    assert [fineness(quads_of(times, quadratic), quadratic) for times in every] == [*every]


def test_the_meshes_of_a_case_stand_about_its_own():
    case = cosim.load("isometric_edc")
    assert [each.hood.mesh.quads for each in meshes_of(case, 3)] == [104, 416, 936]
    assert meshes_of(case, 3)[1] is case
    about = case.replace({"hood.mesh.quads": 500})
    assert [each.hood.mesh.quads for each in meshes_of(about, 2)] == [500, 936]
    coarsest = case.replace(COARSE)
    assert [each.hood.mesh.quads for each in meshes_of(coarsest, 3)] == [104, 416, 936]


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("pulley_edc", "no mesh that can be refined"),
        ("cable_edc", "no mesh that can be refined"),
        ("motion_edc_fdp", "is a motion"),
    ],
)
def test_a_case_without_such_meshes_is_refused(name, why):
    done = CliRunner().invoke(app, ["converge", name])
    assert done.exit_code == 2
    assert why in done.stderr
    with pytest.raises(InputError, match=why):
        cosim.converge(name)


def test_the_table_says_order_error_and_verdict():
    table = table_of(study_of(cosim.load("isometric_edc")))
    (row,) = table.rows
    assert table.columns[1:4] == ("104", "416 *", "936")
    assert row[1:4] == ("0.3", "0.25", "0.24")
    assert row[-1] == "converges"
    (row,) = table_of(study_of(cosim.load("isometric_edc"), (0.3, 0.2, 0.25))).rows
    assert "up and down" in row[4]


def test_errors_are_known_of_the_same_case_and_number_alone(cache, tmp_path):
    case = cosim.load("isometric_edc", ["tendons.EDC.tension=5 N"])
    study, summary = study_of(case), {"fingertip_magnitude_N": 0.25}
    assert known_errors(case, summary) == {}
    keep_errors(study)
    index = study.numbers[0].series.index
    found = known_errors(case, summary)
    assert found == {"fingertip_magnitude_N": pytest.approx(index)}
    assert known_errors(case.replace({"title": "another"}), summary) == found
    assert known_errors(case, {"fingertip_magnitude_N": 0.5}) == {}
    assert known_errors(case.replace({"hood.thickness": "0.4 mm"}), summary) == {}
    (header, (row,)), *_ = rows_of(summary, found)
    assert header == ("", "loaded", "mesh error")
    assert row[2] == f"± {index:.2g}"
    assert rows_of(summary)[0][0] == ("", "loaded")
    file = tmp_path / "errors.json"
    add_errors(study, file)
    assert json.loads(file.read_text())["isometric_edc"]["numbers"].keys() == found.keys()


def test_the_shipped_errors_are_of_shipped_cases():
    for name, entry in shipped_errors().items():
        assert name in cosim.list_cases()
        assert all(index >= 0 for _, index in entry["numbers"].values())


def test_without_a_cache_nothing_is_kept(monkeypatch):
    monkeypatch.setenv(VARIABLE, OFF)
    case = cosim.load("isometric_edc", ["tendons.EDC.tension=5 N"])
    keep_errors(study_of(case))
    assert known_errors(case, {"fingertip_magnitude_N": 0.25}) == {}


def test_a_mesh_without_a_result_is_named_and_the_own_one_is_needed(monkeypatch):
    """A stand-in for the solver: a summary, or an error, for each mesh."""
    case = cosim.load("isometric_edc")

    def solve(*ends) -> MeshStudy:
        outcomes = [outcome_of(partial(end_of, i, end)) for i, end in enumerate(ends)]
        monkeypatch.setattr("cosim.pipeline.run_cases", lambda *_: enumerate(outcomes))
        return converge.solve_meshes(case, 3)

    def end_of(i, end):
        if end is None:
            raise ConvergenceError("no equilibrium")
        return {"case": "a", "fingertip_magnitude_N": end, "hood_quads": (i + 1) ** 2 * 104}

    (number,) = solve(0.3, 0.25, 0.24).numbers
    assert (number.label, number.unit) == ("fingertip force, magnitude", "N")
    assert number.series.bound == pytest.approx(0.0025)
    assert solve(0.25, 0.25, 0.25).numbers == ()
    study = solve(0.3, 0.25, None)
    assert study.reasons == {"936 quads": "no equilibrium"}
    assert study.numbers[0].series.verdict == "no value"
    assert "of_mesh_3" in converge.to_csv(study)
    with pytest.raises(ConvergenceError, match="isometric_edc: no equilibrium"):
        solve(0.3, None, 0.24)


@pytest.mark.slow
def test_the_command_runs_meshes_and_run_shows_their_errors(cache, tmp_path):
    words = ["isometric_edc", "--set", "hood.mesh.quads=104", "--out"]
    done = CliRunner().invoke(app, ["converge", *words, str(tmp_path / "c"), "--meshes", "2"])
    assert done.exit_code == 0, done.output
    content = json.loads((tmp_path / "c" / "isometric_edc" / "converge.json").read_text())
    assert (content["quads"], content["factors"]) == ([104, 416], [1, 4])
    numbers = {n["quantity"]: n for n in content["numbers"]}
    force = numbers["fingertip_magnitude_N"]
    assert force["gci"] == pytest.approx(3 * abs(force["values"][1] - force["values"][0]))
    assert force["why_no_order"] == "an order takes three meshes"
    assert {"slip_force_N.central", "moment_arm_mm.EDC.PIP"} <= numbers.keys()
    assert "difference.marker_strain_percent.lateral.mean" in numbers
    with (tmp_path / "c" / "isometric_edc" / "converge.csv").open(newline="") as file:
        assert [row["quantity"] for row in csv.DictReader(file)] == [*numbers]
    ran = CliRunner().invoke(app, ["run", *words, str(tmp_path / "r"), "--no-pictures"])
    assert f"± {force['gci']:.2g}" in ran.stdout
    assert "as cosim converge found it" in ran.stdout
