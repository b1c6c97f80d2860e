"""The shells that tests share: those of the verification, and the index finger's hood."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from fe_solver.hood.shell_hood import ShellHood
from fe_solver.verification.sheets import (
    BENCHMARK,
    GROUND,
    NO_TENSION,
    at_rest,
    clamp,
    contact,
    disturb,
    grid,
    guide,
    in_basis,
    linear_response,
    map_grid,
    mirror_plane,
    plate,
    sheet,
    with_nine_nodes,
)

__all__ = [
    "BENCHMARK",
    "GROUND",
    "NO_TENSION",
    "at_rest",
    "clamp",
    "contact",
    "disturb",
    "grid",
    "guide",
    "in_basis",
    "index_hood",
    "linear_response",
    "map_grid",
    "mirror_plane",
    "plate",
    "sheet",
    "with_nine_nodes",
]


@cache
def index_hood(*overrides: str) -> ShellHood:
    """The index finger's hood of about 250 quads, as a case builds it."""
    from cosim.case.file import load_case
    from cosim.models.build import build

    hood = build(load_case("base/one_sheet.toml", ["hood.mesh.quads=250", *overrides])).hood
    return replace(hood, options=replace(hood.options, tolerance=1e-11))
