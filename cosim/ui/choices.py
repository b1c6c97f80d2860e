"""What the page lets one choose: packaged cases, and hoods for the case's finger."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from cosim.analyses.ladder import rungs_of
from cosim.case.file import packaged_cases
from cosim.case.schema import Case
from cosim.hoods.kinds import KINDS
from cosim.text_tables import read_toml


def rungs_in_words(case: Case) -> list[dict[str, str]]:
    """The hoods that can be put on the case's finger: rung and words."""
    if not case.finger.is_native:
        return [{"name": case.hood.rung(), "label": case.hood.title}]
    rungs = [
        rung
        for rung in rungs_of(case)
        if rung == case.hood.rung() or case.finger.kind in _kind_on(rung).fits
    ]
    return [{"name": rung, "label": _rung_label(case, rung)} for rung in rungs]


def _kind_on(rung: str) -> Any:
    return next(kind.table for kind in KINDS.values() if rung in kind.table.rungs)


def _rung_label(case: Case, rung: str) -> str:
    own = rung == case.hood.rung()
    return (
        f"{rung}: {case.hood.title} (the case's own)" if own else f"{rung}: {_kind_on(rung).title}"
    )


def shipped() -> Sequence[Mapping[str, str]]:
    """The packaged cases: name, family and title."""
    rows = [
        {"name": n, "family": p.parent.name, "title": str(read_toml(p).get("title", ""))}
        for n, p in packaged_cases().items()
    ]
    return sorted(rows, key=lambda row: (row["family"], row["name"]))
