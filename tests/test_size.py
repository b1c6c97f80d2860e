"""How long the program may be: one number for what is installed and its cases, one for the tests.

They rise once an issue, in its last commit, by no more than it allows; what a change takes out is
its own to spend."""

from __future__ import annotations

from tests.helpers.folders import ROOT

PRODUCT = 103546
TESTS = 69769


def _lines(*packages: str) -> int:
    files = (path for package in packages for path in (ROOT / package).rglob("*.py"))
    return sum(len(path.read_text("utf-8").splitlines()) for path in files)


def test_the_product_is_no_longer_than_its_ceiling() -> None:
    assert _lines("cosim", "fe_solver", "rigid", "meshes", "cases") <= PRODUCT


def test_the_tests_are_no_longer_than_their_ceiling() -> None:
    assert _lines("tests") <= TESTS
