"""The examples in docstrings: each module that has any."""

from __future__ import annotations

import doctest
from importlib import import_module

import pytest

from tests.helpers.folders import ROOT

PACKAGES = ("cosim", "fe_solver", "rigid", "meshes", "cases")
WITH_EXAMPLES = tuple(
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for package in PACKAGES
    for path in sorted((ROOT / package).rglob("*.py"))
    if ">>> " in path.read_text(encoding="utf-8")
)


def test_the_public_modules_have_examples():
    public = {"cosim", "cosim.face", "cosim.port", "cosim.pipeline", "cosim.files"}
    assert public <= set(WITH_EXAMPLES)


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_the_examples_run(name, tmp_path, monkeypatch):
    """What differs is on the captured output."""
    monkeypatch.chdir(tmp_path)
    results = doctest.testmod(import_module(name))
    assert results.attempted
    assert not results.failed
