"""The numbers of reference models on the same rows, and a model's rank among them.

`cases/data/score_references.csv` holds what each reference model says of each measured number, as
`cosim score ... --update` wrote it."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from cosim.files import write_text
from cosim.results.compare import Comparison, number
from cosim.results.table import csv_text
from cosim.text_tables import packaged_rows
from cosim.validation.skill import skill

COLUMNS = ("model", "finger", "group", "row", "value")
SAME_MODEL = 1e-3
"""Relative: a model whose numbers are so near a reference's is that reference."""

REFERENCE_WORDS = {
    "an1979": "An 1979 (straight lines)",
    "myohand": "MyoHand",
    "split_edc": "fixed split",
    "pulley_edc": "pulleys",
    "network_edc": "network",
    "cable_edc": "cables",
    "isometric_edc": "hood of shells",
    "middle_minorflex_edc": "fixed split",
    "hood_minorflex_edc": "hood of shells",
}
"""The reference models in words."""


@dataclass(frozen=True)
class Rank:
    """A model's place among reference models by skill over no answer, on rows that both have."""

    skills: Mapping[str, float]
    """By reference model its own skill on the rows that it shares; best first."""
    better: tuple[str, ...]
    """Those with more skill than the model on those rows."""
    same: tuple[str, ...]
    """Those that say the same, which do not count."""

    @property
    def place(self) -> int:
        """1 is the best."""
        return 1 + len(self.better)

    @property
    def of(self) -> int:
        """How many models are compared, this one among them."""
        return 1 + len(self.skills) - len(self.same)

    @property
    def same_words(self) -> list[str]:
        """Those that say the same in words."""
        return [REFERENCE_WORDS.get(name, name) for name in self.same]

    @property
    def better_words(self) -> list[str]:
        """Those with more skill in words."""
        return [REFERENCE_WORDS.get(name, name) for name in self.better]

    @property
    def words(self) -> str:
        """The reference models with their skills, best first."""
        parts = (f"{REFERENCE_WORDS.get(n, n)} {number(v, 2)}" for n, v in self.skills.items())
        return ", ".join(parts)

    def __str__(self) -> str:
        return f"{self.place} of {self.of}" if self.of > 1 else "-"


@cache
def reference_values() -> Mapping[str, Mapping[tuple[str, str, str], float]]:
    """By reference model its numbers, by finger, group and row."""
    values: dict[str, dict[tuple[str, str, str], float]] = {}
    for row in packaged_rows("score_references"):
        c = row.cells
        values.setdefault(c["model"], {})[c["finger"], c["group"], c["row"]] = float(c["value"])
    return values


def rank_of(group: str, finger: str, rows: Sequence[Comparison]) -> Rank | None:
    """The rank of a model by its judged rows of a group; None where no reference model has half of
    them."""
    skills: dict[str, float] = {}
    better: list[str] = []
    same: list[str] = []
    for name, values in reference_values().items():
        shared = [r for r in rows if (finger, group, r.target.name) in values]
        theirs = [replace(r, model=values[finger, group, r.target.name]) for r in shared]
        if 2 * len(shared) < len(rows):
            continue
        ours, other = skill(shared, "no answer"), skill(theirs, "no answer")
        if ours is None or other is None:
            continue
        skills[name] = other.value
        if all(_is_same(a.model, b.model) for a, b in zip(shared, theirs, strict=True)):
            same.append(name)
        elif other.value > ours.value:
            better.append(name)
    if not skills:
        return None
    ordered = dict(sorted(skills.items(), key=lambda item: -item[1]))
    return Rank(ordered, tuple(n for n in ordered if n in better), tuple(same))


def _is_same(a: float | None, b: float | None) -> bool:
    return a is not None and b is not None and abs(a - b) <= SAME_MODEL * max(abs(a), abs(b))


def update_references(path: Path, values: Sequence[Mapping[str, object]]) -> None:
    """Write the numbers of models, by the columns of the file, in place of those that it has of
    models of their names and fingers; its first lines stay.  Raises InputError."""
    named = {(value["model"], value["finger"]) for value in values}
    lines = path.read_text(encoding="utf-8").splitlines()
    notes = [line for line in lines if line.startswith("#")]
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    kept = [row for row in rows if (row["model"], row["finger"]) not in named]
    order = list(REFERENCE_WORDS)
    every: list[Mapping[str, object]] = sorted(
        [*kept, *values],
        key=lambda r: order.index(str(r["model"])) if r["model"] in order else len(order),
    )
    table = csv_text([COLUMNS, *([row[name] for name in COLUMNS] for row in every)])
    write_text(path, "".join(f"{line}\n" for line in notes) + table)
