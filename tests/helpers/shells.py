"""The hoods of the index finger that tests share, as cases build them: a sheet and a net."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from fe_solver.hood.shell_hood import ShellHood

COARSE_NET = 'hood.mesh.spacing="3 mm"'


@cache
def index_hood(*overrides: str) -> ShellHood:
    """The index finger's hood of about 250 quads, as a case builds it."""
    from cosim.case.file import load_case
    from cosim.models.build import build

    hood = build(load_case("base/one_sheet.toml", ["hood.mesh.quads=250", *overrides])).hood
    return replace(hood, options=replace(hood.options, tolerance=1e-11))


@cache
def cable_hood(*overrides: str) -> ShellHood:
    """That of cables, of some 230 cells."""
    from cosim.case.file import load_case
    from cosim.models.build import build

    hood = build(load_case("cable_edc", [COARSE_NET, *overrides])).hood
    assert isinstance(hood, ShellHood)
    return replace(hood, options=replace(hood.options, tolerance=1e-12))
