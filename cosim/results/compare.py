"""Comparison with measured and published numbers: rows with a verdict, misses shown like hits.

A target is a number that somebody measured or published, with its source, or of the kind
"requirement" one that nobody measured and that the model is asked to have (a hood without torque
at rest).  A comparison is a target beside what a model says.

The CSV of targets (`read_targets`): its first line names the columns, lines beginning with `#` are
for people and say where the numbers are from.  It needs `quantity`, and `value` (or `reference`) or
a band; a file whose columns are parted by semicolons may have decimal commas.  Columns:

* name: what the row is called in tables; else the quantity;
* quantity: where a run's `summary.json` has the number, keys joined by dots; a component of
  a vector by its axis (distal, radial, dorsal) or the other way of one (proximal, ulnar, palmar),
  with the other sign: `difference.fingertip_force_N.palmar`;
* unit: of all numbers of the row; what the quantity's key ends in (`_N`, `_Nmm` N mm, `_mm`,
  `_deg`, `_rad`, `_percent` %, `_mJ`, `_s`, `_ms`, `_rad_per_s` rad/s, `_kPa`, `_V`), else 1;
* reference, or value: the measured or published number; may be empty where a band is given;
* measured (in place of reference): the address of a number of the collection (`cosim.measured`),
  which gives value, sd, band, source and kind where the row has none of its own;
* sd: its standard deviation; may be empty;
* n (may be left out): how many specimens the reference is the mean of;
* low, high: the ends of a band of acceptance, in the unit, not relative; either may be empty;
* source: paper and table; else the file;
* kind: experiment (where nothing is said), experiment at second hand (known from an abstract or
  another's text), published model, inferred, or requirement (nobody measured it: what the model is
  asked to have; tables count such rows apart, and the source says who asks);
* case (may be left out): the case that the row is for; empty is every case;
* geometry (may be left out): of the hood or finger that the row is about, where it is not ours;
* fitted (may be left out): yes where the model was fitted to this number;
* held_out (may be left out): yes where `cosim identify` must not fit to it, but judge by it;
* note (may be left out): the fingertip device of the reference, the reason of a miss, ...
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from cosim.errors import InputError
from cosim.files import write_text
from cosim.json_text import json_text
from cosim.measured import Evidence, measured_at
from cosim.port import AXES
from cosim.results.conventions import OPPOSITE
from cosim.schema.fields import is_number
from cosim.text_tables import CsvRow, CsvTable, read_csv, read_json_file

Kind = Literal[Evidence, "requirement"]
"""What a reference rests on."""
Verdict = Literal["inside 1 SD", "inside the band", "outside", "nothing to judge by", "no value"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
VERDICT_SHAPES: dict[Verdict, str] = dict(zip(VERDICTS, "●◆▲○–", strict=True))
"""What a verdict looks like besides its word and colour."""
UNITS = {
    "N": "N",
    "Nmm": "N mm",
    "mm": "mm",
    "deg": "deg",
    "rad": "rad",
    "percent": "%",
    "mJ": "mJ",
    "s": "s",
    "ms": "ms",
    "rad_per_s": "rad/s",
    "kPa": "kPa",
    "V": "V",
}
"""What a key of a summary ends in, and the unit that it says."""
COLUMNS = (
    *("name", "quantity", "unit", "model", "reference", "sd", "low", "high", "difference"),
    *("verdict", "source", "kind", "case", "geometry", "fitted", "note"),
)
"""The columns of a comparison, in files and tables."""


@dataclass(frozen=True)
class Target:
    """A number to compare with; see the module for what each field means."""

    name: str
    quantity: str
    unit: str
    reference: float | None
    sd: float | None
    low: float | None
    high: float | None
    source: str
    kind: Kind
    case: str = ""
    geometry: str = ""
    fitted: bool = False
    note: str = ""
    held_out: bool = False
    n: float | None = None
    place: str = field(default="", compare=False)
    """File and line that it was read from."""

    @property
    def called(self) -> str:
        """Its place and name, for errors."""
        return f"{self.place}: {self.name}" if self.place else self.name

    def __post_init__(self) -> None:
        if fault := _fault(self):
            raise InputError(f"{self.name or 'a row without a name'}: {fault}")


@dataclass(frozen=True)
class Comparison:
    """A target beside the model's number; None where the model does not say it."""

    target: Target
    model: float | None

    @property
    def difference(self) -> float | None:
        """As the function `difference` says."""
        return difference(self.target, self.model)

    @property
    def verdict(self) -> Verdict:
        """As the function `verdict` says."""
        return verdict(self.target, self.model)


def difference(target: Target, model: float | None) -> float | None:
    """Model less reference; without a reference how far the model lies beyond the band's nearer
    end (negative: below it), 0 inside."""
    if model is None:
        return None
    if target.reference is not None:
        return model - target.reference
    if target.low is not None and model < target.low:
        return model - target.low
    if target.high is not None and model > target.high:
        return model - target.high
    return 0.0


def verdict(target: Target, model: float | None) -> Verdict:
    """One standard deviation first (its ends count as inside), then the band."""
    if model is None:
        return "no value"
    if _inside_sd(target, model):
        return "inside 1 SD"
    if _has_band(target):
        low = -np.inf if target.low is None else target.low
        high = np.inf if target.high is None else target.high
        return "inside the band" if low <= model <= high else "outside"
    return "outside" if target.sd is not None else "nothing to judge by"


def _inside_sd(target: Target, model: float) -> bool:
    if target.sd is None or target.reference is None:
        return False
    return abs(model - target.reference) <= target.sd


def _has_band(target: Target) -> bool:
    return target.low is not None or target.high is not None


def compare_with_targets(
    targets: Sequence[Target], summary: Mapping[str, Any], case: str
) -> tuple[Comparison, ...]:
    """The targets for `case` beside what its summary says.

    Raises InputError where a target's unit is not that of its quantity."""
    chosen = [t for t in targets if t.case in ("", case)]
    for target in chosen:
        if target.unit != (unit := unit_of(target.quantity)):
            raise InputError(
                f"{target.called}: {target.quantity} is in {unit}, the row in {target.unit}"
            )
    return tuple(Comparison(t, value_of(summary, t.quantity)) for t in chosen)


def value_of(summary: Mapping[str, Any], quantity: str) -> float | None:
    """The number at a path of keys joined by dots, or of A/B the ratio of two; None where the
    summary has no number there."""
    above, slash, below = quantity.partition("/")
    if slash:
        value, divisor = value_of(summary, above), value_of(summary, below)
        return value / divisor if value is not None and divisor else None
    part: Any = summary
    for key in quantity.split("."):
        part = parts_of(part).get(key)
    return float(part) if is_number(part) and np.isfinite(part) else None


def parts_of(value: Any) -> Mapping[str, Any]:
    """What a value of a summary holds, by name: of a vector its components along the axes and along
    their other ways; of a list its items by place; nothing of anything else."""
    if isinstance(value, Mapping):
        return {**value, **_other_ways(value)} if set(value) == set(AXES) else value
    if isinstance(value, Sequence) and not isinstance(value, str):
        return {str(i): item for i, item in enumerate(value)}
    return {}


def _other_ways(vector: Mapping[str, Any]) -> dict[str, float]:
    return {way: -vector[axis] for way, axis in OPPOSITE.items() if is_number(vector[axis])}


def numbers_of(summary: Mapping[str, Any]) -> dict[str, float]:
    """Every number of a summary, by the path that a target's `quantity` names it by."""
    return {path: float(value) for path, value in _leaves(summary, "")}


def _leaves(value: Any, path: str) -> Iterator[tuple[str, float]]:
    match value:
        case Mapping():
            for key, inner in value.items():
                yield from _leaves(inner, f"{path}.{key}" if path else str(key))
        case list():
            for i, inner in enumerate(value):
                yield from _leaves(inner, f"{path}.{i}")
        case _ if is_number(value):
            yield path, value


def unit_of(quantity: str) -> str:
    """The unit that a key of the path ends in, the last that ends in one, else 1; of A/B the ratio
    of two, 1 where they are alike."""
    above, slash, below = quantity.partition("/")
    if slash:
        units = unit_of(above), unit_of(below)
        return "1" if units[0] == units[1] else f"{units[0]} / ({units[1]})"
    for key in reversed(quantity.split(".")):
        for ending, unit in UNITS.items():
            if key.endswith(f"_{ending}") and not key.endswith(f"_per_{ending}"):
                return unit
    return "1"


def tally(rows: Sequence[Comparison]) -> dict[str, int]:
    """How many rows of each verdict, in the order of `VERDICTS`, then those of requirements, which
    are no evidence; verdicts of no row are left out."""
    required = [row.target.kind == "requirement" for row in rows]
    count = Counter(zip((row.verdict for row in rows), required, strict=True))
    return {
        f"{name} (requirement)" if asked else name: count[name, asked]
        for asked in (False, True)
        for name in VERDICTS
        if count[name, asked]
    }


def misses_first(rows: Sequence[Comparison]) -> list[Comparison]:
    """The rows without a value or outside first, else in their order."""
    return sorted(rows, key=lambda row: row.verdict not in ("no value", "outside"))


def as_dict(row: Comparison) -> dict[str, Any]:
    """The row with its difference and verdict, by COLUMNS."""
    target = row.target
    derived = {"model": row.model, "difference": row.difference, "verdict": row.verdict}
    return {c: derived[c] if c in derived else getattr(target, c) for c in COLUMNS}


def marks(target: Target) -> list[str]:
    """What a reader must know of the row: that it was fitted, and on which geometry."""
    return [mark for mark in ("fitted" if target.fitted else "", target.geometry) if mark]


def reference_text(target: Target) -> str:
    """The reference with its SD and band, in words."""
    parts = [] if target.reference is None else [number(target.reference)]
    if target.sd is not None:
        parts.append(f"± {number(target.sd)}")
    if target.low is not None and target.high is not None:
        parts.append(f"[{number(target.low)} to {number(target.high)}]")
    elif target.low is not None:
        parts.append(f"[at least {number(target.low)}]")
    elif target.high is not None:
        parts.append(f"[at most {number(target.high)}]")
    return " ".join(parts)


def number(value: float | None, digits: int = 4) -> str:
    """So many digits, never minus zero; an n-dash where there is none."""
    return "–" if value is None else f"{value + 0.0:.{digits}g}"


def _fault(target: Target) -> str | None:
    """What is wrong with a target, if anything."""
    empty = [c for c in ("name", "quantity", "unit", "source") if not getattr(target, c).strip()]
    if empty:
        return f"{empty[0]} is empty"
    if target.kind not in get_args(Kind):
        return f"kind is {target.kind!r}; expected {', '.join(get_args(Kind))}"
    if not isinstance(target.fitted, bool):
        return f"fitted is {target.fitted!r}; expected true or false"
    return _fault_of_numbers(target)


def _fault_of_numbers(target: Target) -> str | None:
    if target.reference is None and not _has_band(target):
        return "has neither a reference nor a band"
    if target.sd is not None and (target.sd < 0 or target.reference is None):
        return "sd must be 0 or more, and have a reference"
    if target.n is not None and not (target.n >= 1 and target.n == int(target.n)):
        return f"n is {target.n:g}; expected how many specimens, 1 or more"
    if target.low is not None and target.high is not None and target.low > target.high:
        return f"its band ends ({target.high:g}) below where it begins ({target.low:g})"
    return None


@dataclass(frozen=True)
class ForceVector:
    """A force in the sagittal plane beside its reference: (distal, dorsal), N."""

    label: str
    kind: Kind
    model: tuple[float, float] | None
    reference: tuple[float, float]
    sd: tuple[float, float] | None


def force_vectors(rows: Sequence[Comparison]) -> Iterator[ForceVector]:
    """The vectors of which one source gives both components in the plane, with a reference each:
    rows whose quantities are `...distal`, and `...dorsal` or `...palmar`."""
    normal = {
        _vector_key(row): (row, sign)
        for ending, sign in ((".palmar", -1.0), (".dorsal", 1.0))
        for row in rows
        if row.target.quantity.endswith(ending)
    }
    for first in (r for r in rows if r.target.quantity.endswith(".distal")):
        second, sign = normal.get(_vector_key(first), (None, 1.0))
        if second is None:
            continue
        reference = _in_plane(first.target.reference, second.target.reference, sign)
        if reference is not None:
            yield ForceVector(
                first.target.source,
                first.target.kind,
                _in_plane(first.model, second.model, sign),
                reference,
                _in_plane(first.target.sd, second.target.sd),
            )


def _vector_key(row: Comparison) -> tuple[str, str, str, str]:
    t = row.target
    return t.quantity.rpartition(".")[0], t.source, t.case, t.geometry


def _in_plane(
    distal: float | None, normal: float | None, sign: float = 1.0
) -> tuple[float, float] | None:
    return None if distal is None or normal is None else (distal, sign * normal)


FORMAT = "cosim comparison 1"
NEEDED = ("name", "quantity", "unit", "reference", "sd", "low", "high", "source", "kind")
"""What a row of a comparison in a file has at least."""
KNOWN = (*NEEDED, "value", "measured", "n", "case", "geometry", "fitted", "note", "held_out")
"""The columns that a CSV of targets may have."""
OF_BANDS = {
    **{"quantity": "quantity", "meaning": "name", "unit": "unit"},
    **{"p5": "low", "p50": "value", "p95": "high", "runs": "n"},
}
"""The columns of a study's bands, and what they are in a CSV of targets."""
YES = {"yes": True, "true": True, "1": True, "no": False, "false": False, "0": False, "": False}


def to_json(rows: Sequence[Comparison]) -> str:
    """The text of a file that `read_json` reads."""
    content = {"format": FORMAT, "rows": [as_dict(row) for row in rows]}
    return json_text(content) + "\n"


def write_json(path: Path, rows: Sequence[Comparison]) -> None:
    """Write rows to a file that `read_json` reads.  Raises InputError where it cannot be
    written."""
    write_text(path, to_json(rows))


def read_json(path: Path) -> tuple[Comparison, ...]:
    """The rows of a file that `write_json` wrote; differences and verdicts are found anew.

    Raises InputError, naming the row."""
    content = read_json_file(path)
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
    """The targets of a CSV file; the module says what its columns hold.  Of a bands.csv that a
    study left they are its medians and the middle 90 %.

    Raises InputError, naming line and column."""
    table = read_csv(path, "quantity,value,sd")
    if set(OF_BANDS) < set(table.columns):
        table = _bands_as_targets(table)
    numbers = {"value", "reference", "measured", "low", "high"}
    lacking = "quantity" not in table.columns or not numbers & set(table.columns)
    unknown = [c for c in table.columns if c not in KNOWN]
    if lacking or unknown or {"value", "reference"} <= set(table.columns):
        raise InputError(
            f"{path}: expected the columns quantity and value (or reference), and if wanted "
            f"{', '.join(c for c in KNOWN if c not in ('quantity', 'value', 'reference'))}, each "
            f"once; the first line has {', '.join(table.columns)}"
        )
    return tuple(_target_of(row, path.name) for row in table.rows)


def _bands_as_targets(table: CsvTable) -> CsvTable:
    def target(row: CsvRow) -> CsvRow:
        cells = {new: row.cells[old] for old, new in OF_BANDS.items()}
        return replace(row, cells=cells | {"kind": "inferred"})

    rows = [target(row) for row in table.rows if row.cells["p50"]]
    others = [name for name in table.columns if name not in (*OF_BANDS, "as_it_is")]
    return replace(table, columns=(*OF_BANDS.values(), "kind", *others), rows=tuple(rows))


def _target_of(row: CsvRow, file: str) -> Target:
    quantity = row.cells["quantity"]
    beside = {"name": quantity, "unit": unit_of(quantity), "source": file, "kind": "experiment"}
    filled = {c: text for c, text in row.cells.items() if text or c not in beside}
    numbers = {column: row.number(column) for column in ("reference", "sd", "low", "high")}
    if "value" in filled:
        numbers["reference"] = row.number("value")
        del filled["value"]
    specimens = row.number("n")
    filled.pop("n", "")
    if address := filled.pop("measured", ""):
        beside, numbers, of_source = _of_collection(row, address, beside, numbers)
        specimens = specimens or of_source
    marks = {column: filled.get(column, "").lower() for column in ("fitted", "held_out")}
    for column, mark in marks.items():
        if mark not in YES:
            raise InputError(f"{row.place}: {column} is {mark!r}; expected yes or no")
    said = {column: YES[mark] for column, mark in marks.items()}
    return _target(row.place, {**beside, **filled, **numbers, **said, "n": specimens})


def _of_collection(
    row: CsvRow, address: str, beside: Mapping[str, str], numbers: Mapping[str, float | None]
) -> tuple[dict[str, str], dict[str, float | None], int | None]:
    """What a row has beside its own texts, its numbers, and how many specimens, by the measured one
    at an address."""
    if numbers["reference"] is not None:
        raise InputError(f"{row.place}: has a reference and a measured number; keep one")
    try:
        m = measured_at(address)
    except InputError as error:
        raise InputError(f"{row.place}: measured: {error}") from error
    if m.unit != beside["unit"]:
        raise InputError(f"{row.place}: {address} is in {m.unit}, the row in {beside['unit']}")
    of_source = {"reference": m.value, "sd": m.sd, "low": m.low, "high": m.high}
    own = {column: value for column, value in numbers.items() if value is not None}
    return {**beside, "source": m.cited.cited, "kind": m.evidence}, {**of_source, **own}, m.n


def _target(place: str, values: Mapping[str, Any]) -> Target:
    try:
        return Target(**values, place=place)
    except InputError as error:
        raise InputError(f"{place}: {error}") from error


def _float(place: str, column: str, value: Any) -> float | None:
    if value is None:
        return None
    try:
        if isinstance(value, bool):
            raise ValueError
        out = float(value)
    except (TypeError, ValueError, OverflowError):
        out = np.nan
    if not np.isfinite(out):
        raise InputError(f"{place}: {column} is {value!r:.60}; expected a number or nothing")
    return out
