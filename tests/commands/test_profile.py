"""`cosim run --profile`: the parts of a run and what they cost."""

from __future__ import annotations

from typer.testing import CliRunner

from cosim.case.file import load_case
from cosim.cli import app
from cosim.pipeline import run_case
from cosim.stopwatch import stopwatch, timed


def test_parts_lie_within_those_that_called_them_and_sum_their_factorisations():
    case = load_case("isometric_edc", ["hood.mesh.quads=104", "output.picture=false"])
    with stopwatch() as watch:
        run_case(case)
    parts = watch.parts
    assert parts["loaded equilibrium", "hood"].calls > 1
    assert parts["models",].calls == 1
    assert parts["models",].factorisations == 0
    for way, part in parts.items():
        within = [p for other, p in parts.items() if other[:-1] == way]
        assert sum(p.seconds for p in within) <= part.seconds
        assert sum(p.factorisations for p in within) <= part.factorisations
    loaded = parts["loaded equilibrium",].factorisations
    assert loaded >= parts["loaded equilibrium", "hood"].factorisations > 0


def test_nothing_is_measured_outside():
    with stopwatch() as watch:
        pass
    with timed("later"):
        pass
    assert not watch.parts


def test_the_command_prints_the_table_beside_its_results(tmp_path):
    line = ["run", "pulley_edc", "--out", str(tmp_path), "--no-pictures", "--profile"]
    done = CliRunner().invoke(app, line)
    assert done.exit_code == 0
    assert "factorisations" in done.stderr
    assert "loaded equilibrium" in done.stderr
    assert "factorisations" not in done.stdout


def test_several_processes_are_refused(tmp_path):
    line = ["run", "pulley_edc", "--out", str(tmp_path), "--profile", "--workers", "2"]
    done = CliRunner().invoke(app, line)
    assert done.exit_code == 2
    assert "--workers" in done.stderr
