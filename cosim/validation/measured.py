"""The tables of what was measured, one file a source, in `cases/data/measured`."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

from cosim.text_tables import packaged_rows


class Measured(NamedTuple):
    """A measured number, in `unit`."""

    quantity: str
    """What, and of which tendon, joint or axis, joined by dots."""
    unit: str
    value: float
    sd: float | None
    """Between the `n` specimens; None where the source has none."""
    n: int | None
    frame: str
    """The axes, or the sign."""
    fixture: str
    posture: str
    """MCP/PIP/DIP, deg, where it is known."""
    load: str
    read: str
    """How the number was got from the source."""
    source: str


@cache
def read_measured(source: str) -> tuple[Measured, ...]:
    """The rows of a source's file, in its order."""
    return tuple(_row(dict(row.cells)) for row in packaged_rows(f"measured/{source}"))


def _row(text: dict[str, str]) -> Measured:
    sd, n = text.pop("sd"), text.pop("n")
    return Measured(
        value=float(text.pop("value")),
        sd=float(sd) if sd else None,
        n=int(n) if n else None,
        **text,
    )


def values_by(source: str, posture: str = "") -> dict[str, float]:
    """The values of a source by quantity, those of a posture."""
    return {m.quantity: m.value for m in read_measured(source) if m.posture == posture}
