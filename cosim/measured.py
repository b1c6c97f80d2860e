"""The collection of what was measured: one CSV a source in `cases/data/measured`, one schema.

A new source is a file SOURCE.csv with the columns of `Measured` and a line in `sources.csv`, of
`Source`.  A quantity is a kind and what it is of, joined by dots: `arm.EDC.PIP`; `QUANTITIES` has
the kinds.  Other modules name a number by its address, `SOURCE:QUANTITY`, and where that is not
one row `SOURCE:QUANTITY:POSTURE` or `SOURCE:QUANTITY:POSTURE:HAND`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError, field_validator, model_validator

from cosim.errors import InputError, first_twice, nearest_names
from cosim.schema.units import is_unit
from cosim.text_tables import CsvRow, CsvTable, read_csv

Evidence = Literal["experiment", "experiment at second hand", "published model", "inferred"]
"""At second hand: known from an abstract or another's text alone."""
SECOND_HAND: Evidence = "experiment at second hand"
JOINTS = ("MCP", "MCP_abduction", "PIP", "DIP")
AXES = ("distal", "proximal", "dorsal", "palmar", "radial", "ulnar", "size")
READ = ("printed", "figure", "data file", "abstract", "quoted", "computed")
"""How a number was got from its source; what follows a colon says more, of a figure the error."""
RANGE = "range"
"""The posture of a mean over the flexion of the joint that the quantity names."""
POSTURE = re.compile(r"range|(?:-?\d+(?:\.\d+)?|\?)(?:/(?:-?\d+(?:\.\d+)?|\?)){2}")
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_+]*")
TENSION = re.compile(r"(\d+(?:\.\d+)?) N\b")
DOI = re.compile(r"10\.\d{4,9}/\S+")


class QuantityKind(NamedTuple):
    """A kind of quantity."""

    words: str
    unit: str
    parts: tuple[str, ...]
    """What follows its name: `joint` and `axis` are of JOINTS and AXES, others any name."""
    sign: str = ""
    """What positive numbers mean, of every source; signs of a source that differ are turned."""


FLEXION = "flexion and radial abduction positive"
QUANTITIES: Mapping[str, QuantityKind] = {
    "arm": QuantityKind("moment arm", "mm", ("muscle", "joint"), FLEXION),
    "effective_arm": QuantityKind(
        "effective arm at a clamped fingertip: torque by the Jacobian over tension, of which the "
        "differences between joints are certain, the rest depends on where the moment was taken",
        *("mm", ("muscle", "joint"), FLEXION),
    ),
    "tendon_height": QuantityKind(
        "height of a tendon over the joint's axis", "mm", ("muscle", "joint"), "dorsal positive"
    ),
    "fingertip_force": QuantityKind("force of the fingertip", "N", ("muscle", "axis")),
    "force_over_tension": QuantityKind(
        "force of the fingertip over the tension", "%", ("muscle", "axis")
    ),
    "size": QuantityKind("size of the fingertip's force over the tension", "1", ("muscle",)),
    "angle_to_EDC": QuantityKind("angle to the force under EDC", "deg", ("muscle",)),
    "metacarpal_load": QuantityKind("load on the metacarpal", "N", ("muscle", "axis")),
    "flexion_moment_share": QuantityKind("share of the flexion moment", "%", ("muscle",)),
    "excursion": QuantityKind("excursion of the tendon", "mm", ("muscle", "joint")),
    "rotation": QuantityKind("turn of a free joint", "deg", ("muscle", "joint"), FLEXION),
    "arm_ratio": QuantityKind("ratio of two moment arms", "1", ("which", "joint")),
    "strip_arm": QuantityKind("arm of a strip by its line of force", "mm", ("part",)),
    "slip_ratio": QuantityKind("force of the terminal slip over the central slip's", "1", ()),
    "slip_force_loss": QuantityKind(
        "share of a slip's force that is lost as a joint flexes", "1", ("slip", "joints")
    ),
    "attachment_force": QuantityKind("force at an attachment of the extensor", "N", ("part",)),
    "attachment_ratio": QuantityKind(
        "force at the middle over that at the distal phalanx", "1", ("muscles",)
    ),
    "strain": QuantityKind("strain", "%", ("part", "direction", "statistic")),
    "posture_after": QuantityKind(
        "angle of a joint after a lesion or repair", "deg", ("lesion", "joint"), FLEXION
    ),
    "posture_change": QuantityKind(
        "turn of a joint by a lesion or repair", "deg", ("lesion", "joint"), FLEXION
    ),
    "force_loss": QuantityKind("loss of extension force by a cut", "N", ("cut", "joint")),
    "slip_glide": QuantityKind("movement of a slip as a joint flexes", "mm", ("slip", "joint")),
    "resistance_angle": QuantityKind(
        "flexion at which a joint resists most or least", "deg", ("joint", "statistic")
    ),
    "resistance_share": QuantityKind("share of the resistance", "%", ("part", "joint")),
    "lag_threshold": QuantityKind(
        "share of a tendon's width from which on a cut makes a joint lag", "%", ("part", "joint")
    ),
    "subluxation": QuantityKind("shift of the tendon after a cut", "%", ("cut",)),
    "joint_stiffness": QuantityKind("passive stiffness of a joint", "N m/rad", ("joint",)),
    "joint_damping": QuantityKind("damping of a joint", "N m s/rad", ("part",)),
    "rest_angle": QuantityKind("angle of a joint at rest", "deg", ("joint",), FLEXION),
    "band_angle": QuantityKind("angle of fibres to the square of the tendon", "deg", ("part",)),
    "pressure": QuantityKind("pressure", "kPa", ("part",)),
    "modulus": QuantityKind("modulus along the fibres", "MPa", ("part",)),
    "stiffness": QuantityKind("stiffness", "N/mm", ("part",)),
    "strength": QuantityKind("force that a part bears", "N", ("part",)),
    "demand": QuantityKind("force that is asked of a part", "N", ("part",)),
    "length": QuantityKind("length of a phalanx", "mm", ("part",)),
    "distance": QuantityKind("distance", "mm", ("part",)),
    "width": QuantityKind("width", "mm", ("part",)),
    "greatest_thickness": QuantityKind("greatest thickness", "mm", ("part",)),
    "thickness": QuantityKind("thickness", "mm", ("part",)),
    "section": QuantityKind("section", "mm2", ("part",)),
    "presence": QuantityKind("share of fingers that have a part", "%", ("part",)),
}
"""The kinds of quantity that others read by name; a file may have others, of a unit of a case."""


class Source(BaseModel):
    """A line of `sources.csv`: where the numbers of one file are from."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    source: str
    """The name of the file."""
    cited: str
    """Authors, year and where it appeared."""
    doi: str
    url: str
    licence: str
    """The licence of the data, where the source states one."""
    seen: str
    """How much of the source could be read."""
    what: str
    """What was measured, on what."""

    @property
    def text(self) -> str:
        """Where it appeared, with the DOI."""
        return ", doi ".join(filter(None, (self.cited, self.doi)))

    @model_validator(mode="after")
    def _check(self) -> Self:
        empty = [c for c in ("source", "cited", "seen", "what") if not getattr(self, c)]
        if empty:
            raise ValueError(f"{empty[0]} is empty")
        if self.doi and not DOI.fullmatch(self.doi):
            raise ValueError(f"doi is {self.doi!r}; expected for example 10.7717/peerj.7470")
        return self


class Measured(BaseModel):
    """A measured number, in `unit`: a value, or the bounds that its source prints."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    quantity: str
    """Its kind and what it is of, joined by dots."""
    unit: str
    value: float | None
    sd: float | None
    """Between the `n` specimens; None where the source has none."""
    low: float | None
    high: float | None
    """Bounds that the source prints, of the value or in its place."""
    n: int | None
    """Specimens; None where the source does not say."""
    hand: str
    """Which specimen, of a number that is of one; empty of a mean."""
    finger: Literal["", "index", "middle", "ring", "little", "several"]
    """Empty where the source does not say."""
    posture: str
    """MCP/PIP/DIP flexion, deg, `?` where it is not known, `range` of a mean over the flexion of
    the joint; empty where it is not known or does not matter."""
    frame: str
    """The axes, or the sign."""
    fixture: str
    """What holds finger and fingertip."""
    load: str
    read: str
    """How the number was got from the source: of READ, with more after a colon."""
    evidence: Evidence
    note: str
    cited: Source

    @field_validator("n", mode="before")
    @classmethod
    def _whole(cls, n: Any) -> Any:
        if n is not None and (n != int(n) or n < 1):
            raise ValueError("expected a whole number of specimens, or nothing")
        return None if n is None else int(n)

    @field_validator("posture")
    @classmethod
    def _posture(cls, text: str) -> str:
        if text and not POSTURE.fullmatch(text):
            raise ValueError("expected MCP/PIP/DIP in deg as 30/45/15, ? for one not known, range")
        return text

    @field_validator("read")
    @classmethod
    def _read(cls, text: str) -> str:
        if re.split("[:;]", text)[0] not in READ:
            raise ValueError(f"expected one of {', '.join(READ)}, and if wanted : and more")
        return text

    @field_validator("quantity")
    @classmethod
    def _quantity(cls, text: str) -> str:
        name, *parts = text.split(".")
        if not all(NAME.fullmatch(part) for part in (name, *parts)):
            raise ValueError("expected names joined by dots, for example arm.EDC.PIP")
        if (known := QUANTITIES.get(name)) is None:
            return text
        if len(parts) != len(known.parts):
            raise ValueError(f"expected {'.'.join((name, *map(str.upper, known.parts)))}")
        for what, part in zip(known.parts, parts, strict=True):
            names = {"joint": JOINTS, "axis": AXES}.get(what)
            if names and part not in names:
                raise ValueError(f"{part!r} is no {what}; expected one of {', '.join(names)}")
        return text

    @model_validator(mode="after")
    def _check(self) -> Self:
        known = QUANTITIES.get(self.kind)
        if known is not None and self.unit != known.unit:
            raise ValueError(f"unit is {self.unit!r}; {self.kind} is in {known.unit}")
        if self.unit not in ("1", "%") and not is_unit(self.unit):
            raise ValueError(f"unit is {self.unit!r}; expected a unit of a case, 1 or %")
        if self.value is None and self.low is None and self.high is None:
            raise ValueError("has neither a value nor low or high")
        if self.sd is not None and (self.sd <= 0 or self.value is None or self.n is None):
            raise ValueError("sd is more than 0, and has a value and n")
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ValueError("low is more than high")
        return self

    @property
    def kind(self) -> str:
        """The kind of quantity."""
        return self.quantity.partition(".")[0]

    @property
    def of(self) -> Mapping[str, str]:
        """What a quantity of a known kind is of, by the names of its parts."""
        parts = self.quantity.split(".")[1:]
        known = QUANTITIES.get(self.kind)
        names = known.parts if known else tuple(f"part {i}" for i, _ in enumerate(parts, 1))
        return dict(zip(names, parts, strict=True))

    @property
    def muscle(self) -> str:
        """The muscle that it is of, empty where it is of none."""
        return self.of.get("muscle", "")

    @property
    def joint(self) -> str:
        """The joint, likewise."""
        return self.of.get("joint", "")

    @property
    def axis(self) -> str:
        """The axis, likewise."""
        return self.of.get("axis", "")

    @property
    def angles(self) -> tuple[float, float, float] | None:
        """MCP, PIP and DIP flexion, deg, where all are known."""
        if not self.posture or self.posture == RANGE or "?" in self.posture:
            return None
        mcp, pip, dip = map(float, self.posture.split("/"))
        return mcp, pip, dip

    @property
    def tension(self) -> float | None:
        """N in the muscle, or in each of those, where the load says so first."""
        found = TENSION.match(self.load)
        return float(found[1]) if found else None

    @property
    def is_measured(self) -> bool:
        """Whether it is of an experiment, and neither of a model nor worked out."""
        return self.evidence in ("experiment", SECOND_HAND)

    @property
    def address(self) -> str:
        """What names it in other files."""
        return ":".join((self.cited.source, self.quantity, self.posture, self.hand)).rstrip(":")

    def number(self) -> float:
        """Its value.  Raises InputError where its source prints bounds alone."""
        if self.value is None:
            raise InputError(f"{self.address}: has bounds alone and no value")
        return self.value


class NotMeasured(BaseModel):
    """A line of `cases/data/not_measured.csv`: what nobody measured, or no text at hand prints."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    what: str
    of: str
    state: Literal["not measured", "not printed", "not read", "in conflict"]
    """Not measured: nobody did, as far as was seen; not printed: measured, without the number; not
    read: printed in a text that was not at hand; in conflict: texts contradict each other."""
    known: str
    """What is known of it."""
    stands_in: str
    """What the models of this project take in its place."""
    needed: str
    """What would measure it."""


DATA = Path(str(resources.files("cases"))) / "data"
FOLDER = DATA / "measured"
INDEX = "sources"
COLUMNS = tuple(name for name in Measured.model_fields if name != "cited")
"""The columns of a source's file."""


@cache
def sources() -> Mapping[str, Source]:
    """The sources by name, in the order of their index.

    Raises InputError for a file that is not in the index, and an entry without a file."""
    path = FOLDER / f"{INDEX}.csv"
    lines = [_made(Source, row) for row in _table(path, tuple(Source.model_fields)).rows]
    names = [line.source for line in lines]
    if twice := first_twice(names):
        raise InputError(f"{path}: {twice} stands there twice; keep one")
    files = {file.stem for file in FOLDER.glob("*.csv")} - {INDEX}
    for name in sorted(files ^ set(names)):
        lacking = f"no line for {name}.csv" if name in files else f"a line for {name}, no file"
        raise InputError(f"{path}: has {lacking}; a source is a file and a line")
    return {line.source: line for line in lines}


@cache
def read_measured(source: str) -> tuple[Measured, ...]:
    """The rows of a source's file, in its order.  Raises InputError, with line and column."""
    if source not in sources():
        near = _near(source, sources())
        raise InputError(f"{source!r} is no source of the collection{near}")
    return read_source(FOLDER / f"{source}.csv", sources()[source])


def read_source(path: Path, cited: Source) -> tuple[Measured, ...]:
    """The rows of a file of a source.  Raises InputError, with line and column."""
    rows = _table(path, COLUMNS).rows
    out = tuple(_made(Measured, row, cited=cited) for row in rows)
    seen: dict[tuple[str, ...], str] = {}
    for row, m in zip(rows, out, strict=True):
        key = (m.quantity, m.posture, m.hand, m.load, m.finger, m.frame)
        if key in seen:
            raise InputError(f"{row.place}: {m.address} stands there twice, see {seen[key]}")
        seen[key] = row.place
    return out


@cache
def all_measured() -> tuple[Measured, ...]:
    """The rows of all sources.  Raises InputError."""
    return tuple(row for source in sources() for row in read_measured(source))


def measured_of_kind(kind: str, *, finger: str = "", measured: bool = True) -> list[Measured]:
    """The rows of a kind of quantity; with `measured` those of experiments alone, not what models
    say or what was worked out; with a `finger` those of that finger."""
    return [
        m
        for m in all_measured()
        if m.kind == kind and (m.is_measured or not measured) and finger in ("", m.finger)
    ]


def measured_at(address: str) -> Measured:
    """The row at an address.  Raises InputError where there is none, or more than one."""
    source, _, rest = address.partition(":")
    quantity, posture, hand = (*rest.split(":"), "", "")[:3]
    found = [
        m
        for m in read_measured(source)
        if m.quantity == quantity and m.hand == hand and posture in ("", m.posture)
    ]
    if len(found) == 1:
        return found[0]
    if found:
        places = ", ".join(dict.fromkeys(f"{m.posture} ({m.load})" for m in found))
        raise InputError(f"{address!r} names {len(found)} measured numbers: at {places}")
    near = _near(quantity, dict.fromkeys(m.quantity for m in read_measured(source)))
    raise InputError(f"{address!r} names no measured number{near}")


def _near(name: str, known: Iterable[str]) -> str:
    near = nearest_names(name, known)
    return f"; did you mean {near[0]!r}?" if near else ""


def values_of(source: str, posture: str = "", hand: str = "") -> dict[str, float]:
    """The values of a source by quantity, those of a posture and a hand."""
    rows = (m for m in read_measured(source) if (m.posture, m.hand) == (posture, hand))
    return {m.quantity: m.value for m in rows if m.value is not None}


@cache
def not_measured() -> tuple[NotMeasured, ...]:
    """What nobody measured, in the order of its file.  Raises InputError."""
    table = _table(DATA / "not_measured.csv", tuple(NotMeasured.model_fields))
    return tuple(_made(NotMeasured, row) for row in table.rows)


def _table(path: Path, columns: tuple[str, ...]) -> CsvTable:
    """A table with these columns, in any order."""
    table = read_csv(path, ",".join(columns))
    if missing := [c for c in columns if c not in table.columns]:
        listed = ", ".join(table.columns)
        raise InputError(f"{table.place}: has no column {missing[0]!r}; it has {listed}")
    if more := [c for c in table.columns if c not in columns]:
        expected = ", ".join(columns)
        raise InputError(f"{table.place}: has a column {more[0]!r}; expected {expected}")
    return table


Line = TypeVar("Line", bound=BaseModel)
NUMBERS = ("value", "sd", "low", "high", "n")


def _made(model: type[Line], row: CsvRow, **more: Any) -> Line:
    """A line as its model has it.  Raises InputError with file, line and column."""
    cells: dict[str, Any] = dict(row.cells)
    if model is Measured:
        cells |= {column: row.number(column) for column in NUMBERS}
    try:
        return model(**cells, **more)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        raise InputError(f"{row.place}: {_fault(fault, row)}") from None


def _fault(fault: Mapping[str, Any], row: CsvRow) -> str:
    words = str(fault["msg"]).removeprefix("Value error, ").replace("Input should be", "expected")
    if not fault["loc"]:
        return words
    column = str(fault["loc"][0])
    return f"{column} is {row.cells.get(column, '')!r:.60}; {words}"
