"""The known strengths of the parts of a sheet, to set beside what they carry.

The collection of measurements (`cosim.measured`) has what is in print, which is little.  For most
parts no ultimate load was found, and the tables say so.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from cosim.measured import Measured, measured_of_kind

NOT_KNOWN = "no strength in print"


@dataclass(frozen=True)
class Strength:
    """What is known of a part: the least that it bears, N, and what the sources say."""

    bears: float | None
    says: str


def strength_of(quantity: str) -> Strength:
    """What is known of the part that carries a quantity of a summary."""
    _, _, part = quantity.rpartition(".")
    part = f"{part}_slip" if quantity.startswith("slip_force_N.") else part
    borne, asked = (
        [m for m in measured_of_kind(kind, measured=False) if m.of["part"] == part]
        for kind in ("strength", "demand")
    )
    least = [n for m in borne if (n := m.low if m.value is None else m.value) is not None]
    says = "; ".join(map(_words, (*borne, *asked)))
    return Strength(max(least, default=None), says or NOT_KNOWN)


def _words(m: Measured) -> str:
    size = f"{m.value:g}" if m.value is not None else f"at least {m.low:g}"
    n = f", n {m.n}" if m.n else ""
    return f"{size} {m.unit}: {m.note} ({m.cited.text}, {m.read}{n})"


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
