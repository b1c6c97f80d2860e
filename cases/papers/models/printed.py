"""What publications print, as the tables beside the scripts hold it."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Literal, cast, get_args

Relation = Literal["input", "number", "at_most", "between", "other", "text"]
State = Literal["reproduced", "differs", "input", "set apart", "no number printed"]
REPRODUCED_WITHIN = 0.1
"""Relative difference within which a printed number is called reproduced."""
HELD_WITHIN = 1e-9
"""Relative difference within which a case holds a printed number."""


@dataclass(frozen=True)
class Printed:
    """What a publication prints: a row of its CSV in `cases/papers/`."""

    place: str
    """Where it is printed: "Table 5", "figure 9"."""
    item: str
    """What it is."""
    printed: str
    """As printed, for the reader."""
    unit: str
    values: tuple[float, ...]
    """The numbers, by `;` in the file."""
    relation: Relation
    """How ours stands to it: `input`, our case holds the same number; `number`, within 10 % of it;
    `at_most`, a bound; `between`, an interval; `other`, no result of the publication or another
    quantity than ours; `text`, no number."""
    ours: str
    """The name of our number, "" without one."""
    why: str
    """What is known of a difference, or what ours is instead."""

    @property
    def about(self) -> bool:
        """Whether the publication says "about", or the number is read off a figure."""
        return self.printed.startswith("about")

    def state(self, ours: Sequence[float]) -> State:
        """Whether `ours` reproduces what is printed.  An input of our cases is no result, and one
        that is not the publication's differs."""
        if self.relation == "text":
            return "no number printed"
        if self.relation == "other":
            return "set apart"
        if self.relation == "between":
            low, high = self.values
            same = all(low <= x <= high for x in ours)
        else:
            pairs = list(zip(ours, self.values, strict=True))
            if self.relation == "at_most":
                same = all(x <= most for x, most in pairs)
            else:
                within = REPRODUCED_WITHIN if self.relation == "number" else HELD_WITHIN
                same = all(abs(x - target) <= within * abs(target) for x, target in pairs)
        if not same:
            return "differs"
        return "input" if self.relation == "input" else "reproduced"


def read_printed(publication: str) -> list[Printed]:
    """What `cases/papers/PUBLICATION.csv` holds, in its order."""
    text = (files("cases") / "papers" / f"{publication}.csv").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    return [_printed(**cells) for cells in csv.DictReader(lines)]


def _printed(*, values: str, relation: str, **words: str) -> Printed:
    assert relation in get_args(Relation)
    numbers = tuple(float(value) for value in values.split(";") if value)
    return Printed(values=numbers, relation=cast(Relation, relation), **words)


def printed_values(publication: str, relation: Relation = "number") -> dict[str, tuple[float, ...]]:
    """The values that a publication prints, by the name of ours, of one relation to ours."""
    return {row.ours: row.values for row in read_printed(publication) if row.relation == relation}
