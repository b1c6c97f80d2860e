"""Targets and comparisons in files: CSV, JSON, Markdown.

The CSV of targets (`read_targets`): its first line names the columns, lines beginning with `#` are
for people and say where the numbers are from.  Columns:

* name: what the row is called in tables;
* quantity: where a run's `summary.json` has the number, keys joined by dots; an item of a vector
  by its place from 0 or as distal, palmar, radial: `difference.fingertip_force_N.distal`;
* unit: of all numbers of the row; must be what the quantity's key ends in (`_N`, `_Nmm` N mm,
  `_mm`, `_deg`, `_percent` %, `_mJ`, `_s`, `_rad_per_s` rad/s), else 1;
* reference: the measured or published number; may be empty where a band is given;
* sd: its standard deviation; may be empty;
* low, high: the ends of a band of acceptance, in the unit, not relative; either may be empty;
* source: paper and table, or file;
* kind: experiment, experiment at second hand (known from an abstract or another's text), published
  model, inferred, or requirement (nobody measured it: what the model is asked to have; tables count
  such rows apart, and the source says who asks);
* case (may be left out): the case that the row is for; empty is every case;
* geometry (may be left out): of the hood or finger that the row is about, where it is not ours;
* fitted (may be left out): yes where the model was fitted to this number;
* note (may be left out): the fingertip device of the reference, the reason of a miss, ...
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cosim.files import written_whole
from cosim.port import InputError
from cosim.results.compare import COLUMNS, Comparison, Target, as_dict, marks, number, stated

FORMAT = "cosim comparison 1"
NEEDED = ("name", "quantity", "unit", "reference", "sd", "low", "high", "source", "kind")
OPTIONAL = ("case", "geometry", "fitted", "note")
YES = {"yes": True, "true": True, "1": True, "no": False, "false": False, "0": False, "": False}


def to_json(rows: Sequence[Comparison]) -> str:
    content = {"format": FORMAT, "rows": [as_dict(row) for row in rows]}
    return json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def to_csv(rows: Sequence[Comparison]) -> str:
    """Numbers in full; what is not there is empty."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    for row in rows:
        values = as_dict(row)
        writer.writerow(values | {"fitted": "yes" if row.target.fitted else "no"})
    return text.getvalue()


def to_markdown(rows: Sequence[Comparison]) -> str:
    """A table for a README: numbers to four digits, the reference with its SD or band."""
    lines = ["| what | model | reference | difference | verdict | source | kind |"]
    lines.append("|---|---|---|---|---|---|---|")
    for row in rows:
        t = row.target
        name = " ".join([t.name, *(f"[{mark}]" for mark in marks(t))])
        model, gap = number(row.model), number(row.difference)
        cells = (name, f"{model} {t.unit}", stated(t), gap, row.verdict, t.source, t.kind)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def write_json(path: Path, rows: Sequence[Comparison]) -> None:
    """Raises InputError where the file cannot be written."""
    with written_whole(path) as part:
        part.write_text(to_json(rows), encoding="utf-8")


def read_json(path: Path) -> tuple[Comparison, ...]:
    """The rows of a file that `write_json` wrote; differences and verdicts are found anew.

    Raises InputError, naming the row."""
    try:
        content = json.loads(_text(path))
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: is no JSON ({error})") from error
    rows = content.get("rows") if isinstance(content, dict) else None
    if rows is None or content.get("format") != FORMAT or not isinstance(rows, list):
        raise InputError(f'{path}: is no comparison; expected "format": "{FORMAT}" and "rows"')
    return tuple(_row_of(f"{path}: row {i + 1}", row) for i, row in enumerate(rows))


def _row_of(place: str, row: Any) -> Comparison:
    if not isinstance(row, dict) or not {"model", *NEEDED} <= set(row):
        raise InputError(f"{place}: lacks one of model, {', '.join(NEEDED)}")
    numbers = {c: _float(place, c, row[c]) for c in ("model", "reference", "sd", "low", "high")}
    words = {c: str(row.get(c, "")) for c in ("name", "quantity", "unit", "source", "kind")}
    words |= {c: str(row.get(c, "")) for c in ("case", "geometry", "note")}
    model = numbers.pop("model")
    return Comparison(
        _target(place, {**words, **numbers, "fitted": row.get("fitted", False)}), model
    )


def read_targets(path: Path) -> tuple[Target, ...]:
    """The targets of a CSV file; the module says what its columns hold.

    Raises InputError, naming line and column."""
    lines = [(n, line) for n, line in enumerate(_text(path).splitlines(), 1) if _says(line)]
    if not lines:
        raise InputError(f"{path}: is empty; expected a line with {', '.join(NEEDED)}")
    table = list(csv.reader([line for _, line in lines], skipinitialspace=True))
    header = [cell.strip() for cell in table[0]]
    _check_header(path, header)
    found = zip((n for n, _ in lines), table, strict=False)
    return tuple(_read_row(f"{path}: line {n}", header, row) for n, row in list(found)[1:])


def _says(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _check_header(path: Path, header: list[str]) -> None:
    lacking = [c for c in NEEDED if c not in header]
    unknown = [c for c in header if c not in (*NEEDED, *OPTIONAL)]
    if lacking or unknown or len(set(header)) < len(header):
        raise InputError(
            f"{path}: expected the columns {', '.join(NEEDED)}, and if wanted "
            f"{', '.join(OPTIONAL)}, each once; the first line has {', '.join(header)}"
        )


def _read_row(place: str, header: list[str], cells: list[str]) -> Target:
    if len(cells) != len(header):
        raise InputError(f"{place}: has {len(cells)} cells, the first line {len(header)}")
    row: dict[str, Any] = {c: cell.strip() for c, cell in zip(header, cells, strict=True)}
    for column in ("reference", "sd", "low", "high"):
        row[column] = _float(place, column, row[column] or None)
    fitted = row.get("fitted", "").lower()
    if fitted not in YES:
        raise InputError(f"{place}: fitted is {fitted!r}; expected yes or no")
    return _target(place, {**row, "fitted": YES[fitted]})


def _target(place: str, values: Mapping[str, Any]) -> Target:
    try:
        return Target(**values)
    except InputError as error:
        raise InputError(f"{place}: {error}") from error


def _float(place: str, column: str, value: Any) -> float | None:
    if value is None:
        return None
    try:
        if isinstance(value, bool):
            raise ValueError
        out = float(value)
    except (TypeError, ValueError):
        out = np.nan
    if not np.isfinite(out):
        raise InputError(f"{place}: {column} is {value!r}; expected a number or nothing")
    return out


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no text in UTF-8"
        raise InputError(f"{path}: cannot be read ({reason})") from error
