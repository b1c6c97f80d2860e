"""The hood of cables that tests share: the index finger's, of some 230 cells."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from fe_solver.hood.shell_hood import ShellHood

COARSE = 'hood.mesh.spacing="3 mm"'


@cache
def cable_hood(*overrides: str) -> ShellHood:
    """As a case builds it."""
    from cosim.case.file import load_case
    from cosim.models.build import build

    hood = build(load_case("cable_edc", [COARSE, *overrides])).hood
    assert isinstance(hood, ShellHood)
    return replace(hood, options=replace(hood.options, tolerance=1e-12))
