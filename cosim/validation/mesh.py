"""How far the compared numbers change with the mesh: the same trials once more on finer ones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from cosim.case.file import load_case
from cosim.files import output_file
from cosim.json_text import json_text
from cosim.port import AXES
from cosim.results.compare import Comparison
from cosim.results.conventions import OPPOSITE
from cosim.validation.run import Board, six_digits
from cosim.validation.trial import Trial, TrialGroup
from cosim.version import __version__

FORMAT = "cosim mesh convergence 1"
SHARE = 0.02
"""The part of a number by which it may change; a force's components by that of the force, an angle
by that of a radian."""
POINTS = 0.1
"""How far a strain may change, %."""
Verdict = Literal["beyond", "no value", "within"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)


@dataclass(frozen=True)
class Change:
    """A number on the mesh of its case and on a finer one, both in `unit`."""

    group: str
    case: str
    name: str
    quantity: str
    unit: str
    model: float
    finer: float | None
    bound: float

    @property
    def change(self) -> float | None:
        """The number on the finer mesh less that on the case's own; None where one has none."""
        return None if self.finer is None else self.finer - self.model

    @property
    def verdict(self) -> Verdict:
        """Whether the change is within its bound."""
        if self.change is None:
            return "no value"
        return "within" if abs(self.change) <= self.bound else "beyond"


def on_finer_meshes(
    chosen: Sequence[TrialGroup], quads: int, settings: Sequence[str] = ()
) -> list[TrialGroup]:
    """The groups with `settings`, and with every hood that is generated laid out in about so many
    `quads`; without the trials on a published hood, whose mesh is its own.  Raises InputError."""
    own = [(g, [t for t in g.trials if not t.is_published]) for g in chosen]
    return [replace(g, trials=tuple(_finer(t, quads, settings) for t in ts)) for g, ts in own if ts]


def _finer(trial: Trial, quads: int, settings: Sequence[str]) -> Trial:
    own = (*trial.settings, *settings)
    hood = load_case(trial.case, own).hood
    finer = (f"hood.mesh.quads={quads}",) if hood.is_meshed_by_quads else ()
    return replace(trial, settings=(*own, *finer))


def changes(boards: Sequence[Board], finer: Sequence[Board]) -> list[Change]:
    """The change of every number that the mesh touches, once for all the references that it is
    compared with, those beyond their bound first."""
    after = {b.group: b for b in finer}
    found = [c for b in boards if b.group in after for c in _of_group(b, after[b.group])]
    return sorted(found, key=lambda c: VERDICTS.index(c.verdict))


def _of_group(board: Board, finer: Board) -> Iterator[Change]:
    forces, after = _forces(board.rows), {_key(row): row.model for row in finer.rows}
    seen = set()
    for row in board.rows:
        t, other = row.target, after.get(_key(row))
        number = (t.case or t.name, t.quantity, row.model)
        if row.model is None or number in seen or six_digits(other) == six_digits(row.model):
            continue
        seen.add(number)
        size = forces.get((t.case, t.quantity.rpartition(".")[0]), abs(row.model))
        bound = POINTS if t.unit == "%" else np.degrees(SHARE) if t.unit == "deg" else SHARE * size
        place = (board.group, t.case, t.name, t.quantity, t.unit)
        yield Change(*place, row.model, other, float(bound))


def _key(row: Comparison) -> tuple[str, ...]:
    t = row.target
    return t.case, t.name, t.quantity


def _forces(rows: Sequence[Comparison]) -> dict[tuple[str, str], float]:
    """Magnitudes by case and quantity, of forces whose components are compared."""
    parts: dict[tuple[str, str], dict[str, float]] = {}
    for row in rows:
        name, _, item = row.target.quantity.rpartition(".")
        if item in (*AXES, *OPPOSITE) and row.model is not None:
            parts.setdefault((row.target.case, name), {})[item] = row.model
    return {key: float(np.linalg.norm(list(found.values()))) for key, found in parts.items()}


def tally(found: Sequence[Change]) -> dict[str, int]:
    """How many numbers of each verdict."""
    return {v: sum(c.verdict == v for c in found) for v in VERDICTS}


def as_row(found: Change) -> dict[str, Any]:
    """Its fields, change and verdict, to six digits."""
    numbers = {**asdict(found), "change": found.change, "verdict": found.verdict}
    return {key: six_digits(value) for key, value in numbers.items()}


def write_changes(path: Path, quads: int, finer: Sequence[Board], found: Sequence[Change]) -> None:
    """Write the changes by a finer mesh.  Raises InputError where the file cannot be written."""
    content = {
        "format": FORMAT,
        "version": __version__,
        "quads": quads,
        "tally": tally(found),
        "failed": {name: why for b in finer for name, why in b.failures.items()},
        "rows": [as_row(c) for c in found],
    }
    with output_file(path) as part:
        part.write_text(json_text(content, ensure_ascii=True) + "\n", encoding="utf-8")
