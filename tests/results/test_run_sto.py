"""`cosim show -o NAME.sto`: a run's motions and forces for OpenSim."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.case.file import load_case
from cosim.cli import app
from cosim.pipeline import run_case
from rigid.opensim.sto import read_sto


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    case = load_case("split_edc", ["output.picture=false"])
    result = run_case(case)
    return result.save(tmp_path_factory.mktemp("runs")), result.summary


def test_the_tables_hold_what_the_run_found(run: tuple[Path, dict]) -> None:
    folder, summary = run
    done = CliRunner().invoke(app, ["show", str(folder), "-o", str(folder / "run.sto")])
    assert done.exit_code == 0, done.output
    motion = read_sto(folder / "run_motion.sto", ("MCP", "MCP_abduction", "PIP", "DIP"))
    assert motion.time.tolist() == [0.0, 1.0]
    assert np.degrees(motion.values[1]) == pytest.approx(list(summary["posture_deg"].values()))
    forces = read_sto(folder / "run_forces.sto")
    last = dict(zip(forces.columns, forces.values[-1], strict=True))
    assert last["EDC_tension"] == pytest.approx(3.469)
    assert last["fingertip_force_vx"] == pytest.approx(summary["fingertip_force_N"]["distal"])
    assert last["fingertip_force_vz"] == pytest.approx(summary["fingertip_force_N"]["dorsal"])
    assert 1e3 * last["PIP_torque_EDC"] == pytest.approx(summary["joint_torque_Nmm"]["EDC"]["PIP"])


def test_what_is_no_run_is_one_message(tmp_path: Path, run: tuple[Path, dict]) -> None:
    done = CliRunner().invoke(app, ["show", str(tmp_path), "-o", str(tmp_path / "run.sto")])
    assert done.exit_code == 2
    assert "is not the folder of a run" in done.stderr
    (tmp_path / "results.nc").write_text("not netCDF")
    (tmp_path / "summary.json").write_text("{}")
    done = CliRunner().invoke(app, ["show", str(tmp_path), "-o", str(tmp_path / "run.sto")])
    assert done.exit_code == 2
    assert "cannot be read as a part of a run" in done.stderr
    (tmp_path / "file").touch()
    done = CliRunner().invoke(app, ["show", str(run[0]), "-o", str(tmp_path / "file" / "a.sto")])
    assert done.exit_code == 2
