"""What each part of a sheet carries beside what it is known to bear.

`cases/data/hood_strengths.csv` has what is in print, which is little: of most parts no ultimate
load was found, and that is what a table then says.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from cosim.text_tables import packaged_rows

NOT_KNOWN = "no strength in print"


@dataclass(frozen=True)
class Strength:
    """What is known of a part: the least that it bears, N, and what the sources say."""

    bears: float | None
    says: str


@cache
def strengths() -> Mapping[str, Strength]:
    """By the quantity of a summary that the part carries."""
    found: dict[str, list[Mapping[str, str]]] = {}
    for row in packaged_rows("hood_strengths"):
        found.setdefault(row.cells["quantity"], []).append(row.cells)
    return {quantity: _strength(rows) for quantity, rows in found.items()}


def _strength(rows: list[Mapping[str, str]]) -> Strength:
    least = [float(row["bears_N"]) for row in rows if row["bears_N"]]
    said = (f"{row['says']} ({row['source']}, {row['read']}{_count(row['n'])})" for row in rows)
    return Strength(max(least, default=None), "; ".join(said))


def _count(n: str) -> str:
    return f", n {n}" if n else ""


def strength_of(quantity: str) -> Strength:
    """What is known of the part that carries a quantity."""
    return strengths().get(quantity, Strength(None, NOT_KNOWN))


def insertion_forces(summary: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Label and quantity of the force in each insertion, region and set of springs of a sheet;
    nothing for a hood that is none."""
    if "region_force_N" not in summary:
        return
    for slip in summary.get("slip_force_N", ()):
        yield f"{slip} slip, insertion", f"slip_force_N.{slip}"
    for region in summary["region_force_N"]:
        yield f"{region.replace('_', ' ')}, middle", f"region_force_N.{region}"
    for springs in summary.get("spring_force_N", ()):
        if springs != "central_slip":  # the insertion above
            yield f"springs: {springs.replace('_', ' ')}", f"spring_force_N.{springs}"
