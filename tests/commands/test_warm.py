"""`cosim info --warm`."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

import cosim
from cosim.cli import app
from cosim.commands import warm
from cosim.files import shown_path
from cosim.kernels.kernel import CompiledKernel
from cosim.models.build import anatomy_of


def _bones(name: str) -> str:
    case = cosim.load(name)
    return anatomy_of(case.finger, case.hood.left_to_finger).key if case.hood.lies_on_bones else ""


def test_it_bakes_the_bones_of_all_shipped_cases():
    warmed = {_bones(warmup.case) for warmup in warm.WARMUPS}
    assert {_bones(name) for name in cosim.list_cases()} <= warmed


@pytest.fixture
def quick(monkeypatch):
    """What it builds and solves left out."""
    done = []
    monkeypatch.setattr(warm, "_warm_up", lambda warmup: done.append(warmup.case))
    return done


def test_it_says_what_it_did_and_where(quick, monkeypatch, tmp_path):
    kernels = [CompiledKernel("a.f", 2, 0, tmp_path), CompiledKernel("a.g", 0, 1, tmp_path)]
    monkeypatch.setattr(warm, "compiled_kernels", lambda: iter(kernels))
    said = CliRunner().invoke(app, ["info", "--warm"])
    assert said.exit_code == 0
    assert "2 kernels compiled and 1 found compiled" in said.output
    assert f"kernels are kept in {shown_path(tmp_path)}" in said.output
    assert "distances of bones are kept" in said.output
    assert quick == [warmup.case for warmup in warm.WARMUPS]


def test_it_fails_at_once_where_kernels_cannot_be_kept(quick, monkeypatch):
    kernels = [CompiledKernel("a.f", 1, 0, None)]
    monkeypatch.setattr(warm, "compiled_kernels", lambda: iter(kernels))
    said = CliRunner().invoke(app, ["info", "--warm"])
    assert said.exit_code == 2
    assert "set NUMBA_CACHE_DIR" in said.stderr
    assert quick == []


@pytest.mark.slow
@pytest.mark.parametrize("name", ["isometric_edc", "forward_edc", "network_contact"])
def test_after_it_a_run_compiles_nothing(name, tmp_path, monkeypatch):
    import os
    import subprocess
    import sys

    from tests.helpers.folders import ROOT

    code = f"""
from cosim.cli import app
from cosim.kernels.kernel import compiled_kernels
app(["info", "--warm"], standalone_mode=False)
before = sum(k.compiled for k in compiled_kernels())
import cosim
cosim.run(cosim.load({name!r}))
print("anew:", sum(k.compiled for k in compiled_kernels()) - before)
"""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, text=True
    )
    assert done.stdout.endswith("anew: 0\n"), done.stderr
