"""The scores of several models side by side: judged, as tables, and as files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim.case.schema import Case
from cosim.errors import InputError, Progress, quiet
from cosim.files import shown_path, temporary_folder, write_text
from cosim.results.table import csv_text
from cosim.scoring import references
from cosim.scoring.groups import row_words
from cosim.scoring.model import HandModel, read_hand
from cosim.scoring.names import FingerName
from cosim.scoring.page import score_page
from cosim.scoring.run import HandScore, judge

if TYPE_CHECKING:
    import pandas

COLUMNS = (
    *("model", "source", "finger", "group", "counts", "row", "unit", "measured", "sd", "value"),
    *("difference", "not_judged", "kind", "reference"),
)
PAGE, TABLE = "score.html", "score.csv"


@dataclass(frozen=True)
class Scores:
    """Models beside what was measured."""

    hands: tuple[HandScore, ...]
    refused: Mapping[str, str]
    """Why, of each model that could not be read as a finger."""

    @property
    def table(self) -> pandas.DataFrame:
        """A row for each measured number and model, as score.csv has them."""
        import pandas

        return pandas.DataFrame(list(self.records()), columns=list(COLUMNS))

    @property
    def summary(self) -> pandas.DataFrame:
        """A row for each model and group of measured numbers: the skill over no answer (1 is
        perfect), the place among the reference models, and why where there is none."""
        import pandas

        rows = [
            {
                "model": hand.model.name,
                "group": g.group.name,
                "skill": None if g.skill is None else g.skill.value,
                "low": None if g.skill is None else g.skill.low,
                "high": None if g.skill is None else g.skill.high,
                "numbers": len(g.judged),
                "place": None if g.rank is None else g.rank.place,
                "of": None if g.rank is None else g.rank.of,
                "noise": g.floor,
                "why_not": g.why_not,
            }
            for hand in self.hands
            for g in hand.groups
        ]
        return pandas.DataFrame(rows)

    def records(self) -> Iterator[dict[str, Any]]:
        """The rows of the table; what cannot be judged at all has one row that says why."""
        for hand in self.hands:
            model = hand.model
            for g in hand.groups:
                head = {
                    "model": model.name,
                    "source": model.source,
                    "finger": model.finger,
                    "group": g.group.name,
                    "counts": g.group.counts,
                }
                if g.why_not:
                    yield {**dict.fromkeys(COLUMNS), **head, "not_judged": g.why_not}
                    continue
                for row in g.rows:
                    t = row.target
                    yield head | {
                        "row": row_words(g.group, row),
                        "unit": t.unit,
                        "measured": t.reference,
                        "sd": t.sd,
                        "value": row.model,
                        "difference": row.difference,
                        "not_judged": g.unjudged.get(t.name, ""),
                        "kind": t.kind,
                        "reference": t.source,
                    }

    def write(self, out: Path) -> tuple[Path, Path]:
        """Write the page and the table, into the folder `out` or as the page `out` with the table
        beside; their paths.  Raises InputError where they cannot be written."""
        page = out if out.suffix == ".html" else out / PAGE
        table = page.with_suffix(".csv") if out.suffix == ".html" else out / TABLE
        write_text(page, score_page(self.hands, self.refused))
        rows = ([_digits(record[name]) for name in COLUMNS] for record in self.records())
        write_text(table, csv_text([COLUMNS, *rows]))
        return page, table

    def judged_values(self) -> Iterator[dict[str, Any]]:
        """The numbers of each model as `cases/data/score_references.csv` has them."""
        for hand in self.hands:
            for g in hand.groups:
                for row in g.judged:
                    if row.model is not None:
                        place = (hand.model.name, hand.model.finger, g.group.name, row.target.name)
                        values = (*place, _digits(row.model))
                        yield dict(zip(references.COLUMNS, values, strict=True))


def _digits(value: Any) -> Any:
    """A number to five digits, which hide a machine's last bits."""
    match value:
        case float():
            return float(f"{value:.5g}")
    return value


def score_models(
    given: Sequence[str | Path | Case],
    names: Mapping[str, Mapping[str, str]] | None = None,
    finger: FingerName | None = None,
    tolerance: float = 1e-4,
    workers: int = 2,
    progress: Progress = quiet,
) -> Scores:
    """The scores of models, each as `read_hand` takes it.  `names`: by a model's name, or by the
    empty text of all, from our names to the model's.

    Raises InputError where none can be judged; of several the others are."""
    with temporary_folder("score") as place:
        models: list[HandModel] = []
        refused: dict[str, str] = {}
        for i, one in enumerate(given):
            called, shown = _called(one)
            own = (names or {}).get(called, (names or {}).get("", {}))
            progress(f"reading {called}")
            try:
                hand = read_hand(one, Path(place) / str(i), finger, own, tolerance)
            except InputError as error:
                refused[shown] = str(error)
                continue
            twice = sum(m.name.partition(" (")[0] == hand.name for m in models)
            models.append(replace(hand, name=f"{hand.name} ({twice + 1})") if twice else hand)
        if not models:
            raise InputError("; ".join(refused.values()) or "score: name one or more models")
        return Scores(tuple(judge(models, workers, progress)), refused)


def _called(given: str | Path | Case) -> tuple[str, str]:
    """A model's name, and what messages call it."""
    match given:
        case Case():
            return given.name, given.name
        case str() | Path():
            return Path(given).stem, shown_path(Path(given))
