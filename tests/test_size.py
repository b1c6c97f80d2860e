"""How long the program may be: one number for what is installed and its cases, one for the tests.

They rise once an issue, in its last commit, by no more than it allows; what a change takes out is
its own to spend."""

from __future__ import annotations

import re

from tests.helpers.folders import ROOT

PACKAGES = ("cosim", "fe_solver", "rigid", "meshes", "cases")
PRODUCT = 112001
TESTS = 75306


def _lines(*packages: str) -> int:
    files = (path for package in packages for path in (ROOT / package).rglob("*.py"))
    return sum(len(path.read_text("utf-8").splitlines()) for path in files)


def test_the_product_is_no_longer_than_its_ceiling() -> None:
    assert _lines(*PACKAGES) <= PRODUCT


def test_the_tests_are_no_longer_than_their_ceiling() -> None:
    assert _lines("tests") <= TESTS


def test_a_constant_of_a_module_says_of_what_it_is() -> None:
    """Names that had ten values in five units."""
    vague = "NEAR|SAME|CLOSE|SMALL|FEW|MOST|LEAST|ROUNDING|TOLERANCE|PATIENCE"
    kinds = re.compile(rf"^({vague})(: [^=]+)? = (?!Kind\(|Quantity\()", re.M)
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            assert kinds.findall(path.read_text("utf-8")) == [], path


def test_a_docstring_says_what_a_thing_is_and_not_of_what() -> None:
    for path in (p for package in PACKAGES for p in (ROOT / package).rglob("*.py")):
        assert re.findall(r'^\s*r?"""Of ', path.read_text("utf-8"), re.M) == [], path
