"""The file of all compared numbers: the same rows give the same bytes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, StringConstraints

from cosim.files import write_text
from cosim.json_text import json_text
from cosim.results.compare import Comparison, as_dict, number
from cosim.text_tables import read_json_file
from cosim.validation.records import check_record, six_digits
from cosim.validation.run import Board, by_kind
from cosim.validation.skill import HandGains, Skill, judging_rows
from cosim.validation.uncertainty import (
    JUDGEMENTS,
    Budget,
    NumberUncertainty,
    budget,
    known_of,
)
from cosim.validation.versions import Key, key_of
from cosim.version import __version__

FORMAT = "cosim scoreboard 5"


@dataclass(frozen=True)
class JudgedBoard:
    """A board with what is known of its numbers' uncertainty."""

    board: Board
    known: Mapping[Key, NumberUncertainty] = field(default_factory=dict)

    def known_of(self, row: Comparison) -> NumberUncertainty | None:
        """What is known of a row."""
        return self.known.get(key_of(self.board.group, row))

    def budget(self, row: Comparison) -> Budget:
        """The budget of a row."""
        return budget(row, self.known_of(row))

    def judgements(self) -> dict[str, dict[str, int]]:
        """How many of the rows that count are judged how, by answer: of each null model by the
        uncertainty of the model's number."""
        budgets = {row.target: self.budget(row) for row in judging_rows(self.board.rows)}
        return {
            answer: _in_order(
                Counter(budgets[r.target]._replace(error=r.difference).judgement for r in rows)
            )
            for answer, rows in self.board.answers().items()
        }

    def changed_verdicts(self) -> list[tuple[Comparison, Budget]]:
        """The rows that count whose verdict by one SD and whose judgement by u_val are not of one
        mind, with their budgets."""
        changed = []
        for row in judging_rows(self.board.rows):
            of_row = self.budget(row)
            minds = (row.verdict, of_row.judgement)
            if minds in (("outside", "within uncertainty"), ("inside 1 SD", "model differs")):
                changed.append((row, of_row))
        return changed


def join_uncertainty(
    boards: Sequence[Board], rows: Mapping[Key, NumberUncertainty]
) -> list[JudgedBoard]:
    """The boards with what is known of their numbers."""
    return [JudgedBoard(board, known_of(board, rows)) for board in boards]


def scoreboard(boards: Sequence[JudgedBoard]) -> str:
    """The text of the file."""
    plain = [b.board for b in boards]
    content = {
        "format": FORMAT,
        "version": __version__,
        "kinds": {
            b.group: _judge(b) | {"judgements": judgements_of_kind(boards, b)}
            for b in by_kind(plain)
        },
        "judged": {b.board.group: _judge(b.board) | {"judgements": b.judgements()} for b in boards},
        "failed": {name: why for b in plain for name, why in b.failures.items()},
        "groups": {b.board.group: [_row(b, row) for row in b.board.rows] for b in boards},
    }
    return json_text(content) + "\n"


def judgements_of_kind(boards: Sequence[JudgedBoard], kind: Board) -> dict[str, dict[str, int]]:
    """The judgements of a kind's groups together, by answer."""
    whole: dict[str, Counter[str]] = {}
    for board in boards:
        if board.board.kind == kind.kind and not board.board.variant:
            for answer, counts in board.judgements().items():
                whole.setdefault(answer, Counter()).update(counts)
    return {answer: _in_order(count) for answer, count in whole.items()}


def _in_order(count: Mapping[str, int]) -> dict[str, int]:
    return {word: count[word] for word in JUDGEMENTS if count.get(word)}


def _row(board: JudgedBoard, row: Comparison) -> dict[str, Any]:
    """The row, with its budget where something is known of it."""
    rounded = _round_digits(row)
    if board.known_of(row) is None:
        return rounded
    of_row = board.budget(row)
    numbers = {
        "u_num": of_row.u_num,
        "u_input": of_row.u_input,
        "u_data": of_row.u_data,
        "u_val_95": of_row.expanded,
    }
    words = {"judgement": of_row.judgement, "lacks": of_row.lacks}
    short = {k: None if v is None else float(f"{v:.3g}") for k, v in numbers.items()}
    return rounded | short | words


def _judge(board: Board) -> dict[str, Any]:
    return {
        "headline": board.headline,
        "kind": board.kind,
        "variant": board.variant,
        "tally": board.tallies(),
        "skill": [_skill(s) for s in board.skills],
        "by_hand": [_hand_gains(gains) for gains in board.by_hand],
        "noise": {unit: _rounded(noise._asdict()) for unit, noise in board.noise.items()},
    }


def _skill(of_null: Skill) -> dict[str, Any]:
    """Skill to four decimals: a ratio of sums, near 1 at best; null where it is minus infinity."""
    values = {"skill": of_null.value, "low": of_null.low, "high": of_null.high}
    numbers = {k: round(v, 4) if v is not None and isfinite(v) else None for k, v in values.items()}
    counts = {"rows": of_null.rows, "trials": of_null.trials, "hands": of_null.hands}
    return {"null": of_null.null, **numbers, "fault": of_null.fault, **counts}


def _hand_gains(of_null: HandGains) -> dict[str, Any]:
    resamples = {f"{' '.join(r.hands)} ({r.ways})": r.gain for r in of_null.resamples}
    return {
        "null": of_null.null,
        "nearer": of_null.count,
        "skill": _rounded(of_null.skills),
        "gain": _rounded(of_null.gains),
        "without": _rounded(of_null.without),
        "resamples": _rounded(resamples),
        "perfect_skill": round(of_null.perfect, 4),
        "perfect_spread": [round(end, 4) for end in of_null.spread],
    }


def _rounded(numbers: Mapping[str, float]) -> dict[str, float]:
    return {name: round(value, 4) for name, value in numbers.items()}


def _round_digits(row: Comparison) -> dict[str, Any]:
    """The row in six digits, more than the models are good for; they hide a machine's last bits.
    The difference is that of the rounded numbers: of almost equal ones it would show these bits."""
    numbers = {k: six_digits(getattr(row.target, k)) for k in ("reference", "sd", "low", "high")}
    rounded = Comparison(replace(row.target, **numbers), six_digits(row.model))
    return {k: six_digits(v) for k, v in as_dict(rounded).items()}


def write_scoreboard(path: Path, boards: Sequence[JudgedBoard]) -> None:
    """Write the scoreboard.  Raises InputError where the file cannot be written."""
    write_text(path, scoreboard(boards))


SAME, LEAST = 1e-3, 1e-2
"""Numbers are the same that differ by less of themselves, or of this much of their unit."""
SAME_UNCERTAINTY = 0.05
"""The same of a part of the uncertainty."""
Text = Annotated[str, StringConstraints(max_length=500)]


class Row(BaseModel):
    """A row of a scoreboard, as far as it is compared."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)
    case: Text
    name: Text
    quantity: Text
    unit: Text
    model: float | None
    verdict: Text
    u_num: float | None = None
    u_input: float | None = None


class Rows(BaseModel):
    """The rows of a scoreboard by group."""

    model_config = ConfigDict(frozen=True, extra="ignore")
    groups: dict[Text, list[Row]]

    def by_key(self) -> dict[Key, Row]:
        """The rows by group, case, name and quantity."""
        return {(g, r.case, r.name, r.quantity): r for g, rows in self.groups.items() for r in rows}


def read_rows(path: Path) -> Rows:
    """The rows of a scoreboard that `cosim validate` wrote.  Raises InputError."""
    place = f"{path}: is no scoreboard.json of cosim validate"
    return check_record(Rows, read_json_file(path), place)


def differences(before: Rows, now: Rows, part: bool = False) -> list[str]:
    """What differs, a line each; where only `part` of the trials
    were run, what the earlier board has alone is left out."""
    theirs, ours = before.by_key(), now.by_key()
    alone = [("now", ours.keys() - theirs)]
    if not part:
        alone.insert(0, ("before", theirs.keys() - ours))
    missing = [
        f"{group}: {name}: there is such a number {where} alone"
        for where, keys in alone
        for group, _, name, _ in sorted(keys)
    ]
    return [*missing, *_numbers(theirs, ours)]


def _numbers(theirs: Mapping[Key, Row], ours: Mapping[Key, Row]) -> Iterator[str]:
    """The numbers and parts of the uncertainty that differ; a part that one board has not is none
    that differs."""
    for key in (k for k in theirs if k in ours):
        a, b = theirs[key], ours[key]
        words = [_unlike("", a.model, b.model, SAME)]
        if a.verdict != b.verdict:
            words.append(f"{a.verdict} before, {b.verdict} now")
        for part in ("u_num", "u_input"):
            pair = getattr(a, part), getattr(b, part)
            if None not in pair:
                words.append(_unlike(f"{part} ", *pair, SAME_UNCERTAINTY))
        if said := "; ".join(filter(None, words)):
            yield f"{key[0]}: {a.name}, {a.unit}: {said}"


def _unlike(what: str, theirs: float | None, ours: float | None, same: float) -> str:
    """How two numbers differ; empty where they do not."""
    if theirs is None or ours is None:
        is_same = theirs is ours
    else:
        is_same = abs(theirs - ours) <= same * max(abs(theirs), LEAST)
    return "" if is_same else f"{what}{number(theirs, 6)} before, {number(ours, 6)} now"
