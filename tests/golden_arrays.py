"""Results as labelled arrays, and how far two results are apart: what tests/golden.py compares by.

golden.toml says what has another name, what may differ and which settings a case is run with.
"""

from __future__ import annotations

import csv
import json
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

Array = np.ndarray[Any, np.dtype[Any]]
NUMBERS = "iuf"  # kinds of dtype
Verdict = Literal["identical", "within", "fails in both", "different"]


@dataclass(frozen=True)
class Leaf:
    """An array of a result."""

    values: Array
    family: str
    """Arrays of one family share a unit; a difference is relative to the largest of them."""


Leaves = dict[str, Leaf]
"""By path, for example summary.json/posture_deg/MCP, results.nc/angle, results.nc/angle@units."""


@dataclass(frozen=True)
class Config:
    """What golden.toml says."""

    ignored: Sequence[str] = ()
    not_kept: Sequence[str] = ()
    common: Sequence[str] = ()
    floors: Mapping[str, float] = field(default_factory=dict)
    settings: Mapping[str, Sequence[str]] = field(default_factory=dict)
    renamed: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    vectors: Mapping[str, Sequence[str]] = field(default_factory=dict)

    def settings_of(self, case: str) -> list[str]:
        """The settings (KEY=VALUE) that a case is run with."""
        return [*self.common, *next((s for p, s in self.settings.items() if _match(p, case)), ())]

    def floor_of(self, path: str) -> float:
        """The difference up to which two values count as the same."""
        return next((f for p, f in self.floors.items() if _match(p, path)), 0.0)

    def is_ignored(self, path: str) -> bool:
        """Whether the array at the path may differ."""
        return any(_match(pattern, path) for pattern in self.ignored)

    def is_kept(self, path: str) -> bool:
        """Whether golden.json holds the numbers at the path."""
        return not any(_match(pattern, path) for pattern in (*self.ignored, *self.not_kept))

    def components_of(self, path: str) -> Sequence[str]:
        """The names that the items of an older tree's vector have now, with "-" where the sign
        changed; none of any other array."""
        found = (names for p, names in self.vectors.items() if _match(p, path))
        return next(found, ())

    def new_name(self, kind: str, name: str) -> str:
        """The present name of what had this one in an older tree."""
        for old, new in self.renamed.get(kind, {}).items():
            if found := _pattern(old).fullmatch(name):
                parts = iter(found.groups())
                return "".join(next(parts) if part == "*" else part for part in _parts(new))
        return name

    def old_setting(self, setting: str) -> str:
        """A setting as the older tree spells it."""
        key, equals, value = setting.partition("=")
        old = {new: old for old, new in self.renamed.get("settings", {}).items()}
        return old.get(key, key) + equals + value


def read_config(path: Path) -> Config:
    """The tables of golden.toml."""
    return Config(**tomllib.loads(path.read_text(encoding="utf-8")))


def _parts(pattern: str) -> list[str]:
    return re.split(r"(\*)", pattern)


@cache
def _pattern(pattern: str) -> re.Pattern[str]:
    return re.compile("".join("(.*)" if p == "*" else re.escape(p) for p in _parts(pattern)))


def _match(pattern: str, text: str) -> bool:
    return _pattern(pattern).fullmatch(text) is not None


def read_run(folder: Path) -> Leaves:
    """All arrays of a run's folder, by path."""
    leaves = flatten(read_summary(folder), "summary.json")
    leaves |= _read_dataset(folder / "results.nc")
    return leaves | _read_ledger(folder / "ledger.csv")


def read_summary(folder: Path) -> dict[str, Any]:
    """The summary of a run's folder."""
    summary: dict[str, Any] = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return summary


def flatten(value: Any, path: str, family: str | None = None) -> Leaves:
    """The arrays of nested tables and lists.

    The numbers of a table that holds nothing else are of one family, as they share a unit.
    """
    if isinstance(value, Mapping) and value:
        own = path if all(is_number(v) for v in value.values()) else None
        items = [(f"{path}/{key}", item) for key, item in value.items()]
        return {p: leaf for place, v in items for p, leaf in flatten(v, place, own).items()}
    if isinstance(value, list) and not _is_array(value):
        items = [(f"{path}/{i}", item) for i, item in enumerate(value)]
        return {p: leaf for place, v in items for p, leaf in flatten(v, place).items()}
    if value is None or value == {}:
        value = str(value)
    return {path: Leaf(np.array(value), family or path)}


def is_number(value: Any) -> bool:
    """Whether a value of a summary is a number; a truth value is none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_array(value: list[Any]) -> bool:
    try:
        return np.array(value).dtype != object
    except ValueError:  # rows of different lengths
        return False


def _read_dataset(path: Path) -> Leaves:
    """Variables, their dimensions and their attributes."""
    import xarray

    leaves: dict[str, Any] = {}
    with xarray.open_dataset(path, engine="h5netcdf", decode_cf=False) as data:
        leaves |= {f"{path.name}@{key}": value for key, value in data.attrs.items()}
        for name, variable in data.variables.items():
            place = f"{path.name}/{name}"
            leaves[place] = variable.values
            leaves[f"{place}@dims"] = list(map(str, variable.dims))
            leaves |= {f"{place}@{key}": value for key, value in variable.attrs.items()}
    return {place: Leaf(_plain(value), place) for place, value in leaves.items()}


def _plain(value: Any) -> Array:
    array = np.array(value)
    return array.astype(str) if array.dtype == object else array


def _read_ledger(path: Path) -> Leaves:
    """(k, 3) forces and moments of each state, body and source, mostly k = 1."""
    rows: dict[tuple[str, ...], list[list[float]]] = {}
    with path.open(newline="", encoding="utf-8") as file:
        header = next(lines := csv.reader(file))
        for line in lines:
            rows.setdefault(tuple(line[:3]), []).append([float(x) for x in line[3:9]])
    leaves = {f"{path.name}@header": Leaf(np.array(header), path.name)}
    for (state, body, source), numbers in rows.items():
        for kind, columns in (("force", slice(3)), ("moment", slice(3, None))):
            leaves[f"{path.name}/{state}/{body}/{source}/{kind}"] = Leaf(
                np.array(numbers)[:, columns], f"{path.name}/{state}/{kind}"
            )
    return leaves


@dataclass(frozen=True)
class Comparison:
    """How far two results of a case are apart."""

    verdict: Verdict
    lines: Sequence[str] = ()
    """What differs, the worst first; of a result within the tolerance its worst array."""


def compare(old: Leaves, new: Leaves, tolerance: float, config: Config) -> Comparison:
    """Compare arrays of the same path, of `old` after renaming."""
    old, new = (_drop_ignored(leaves, config) for leaves in (_rename(old, config), new))
    faults = [f"missing: {path}" for path in old if path not in new]
    faults += [f"extra: {path}" for path in new if path not in old]
    scales = _scales(old, new)
    gaps: dict[str, float] = {}
    lines: dict[str, str] = {}
    for path in [path for path in old if path in new]:
        a, b = old[path].values, new[path].values
        if _are_identical(a, b):
            continue
        if (fault := _mismatch(a, b)) is not None:
            faults.append(f"{path}: {fault}")
            continue
        gaps[path], where = _gap(a, b, config.floor_of(path), scales[new[path].family])
        lines[path] = f"{path}: {gaps[path]:.1e} ({where})"
    ranked = sorted(gaps, key=lambda path: -gaps[path])
    faults += [lines[path] for path in ranked if gaps[path] > tolerance]
    if faults:
        return Comparison("different", faults)
    return Comparison("within", [lines[ranked[0]]]) if ranked else Comparison("identical")


def _drop_ignored(leaves: Leaves, config: Config) -> Leaves:
    return {path: leaf for path, leaf in leaves.items() if not config.is_ignored(path)}


def _rename(leaves: Leaves, config: Config) -> Leaves:
    """The arrays of an older tree under their present paths and labels.

    Raises ValueError where two get the same path.
    """
    out: Leaves = {}
    for path, leaf in _by_component(leaves, config):
        values = leaf.values
        if path.endswith("@dims"):
            data = path.partition("/")[0]
            dims = [config.new_name("keys", f"{data}/{name}") for name in values.tolist()]
            values = np.array([name.partition("/")[2] for name in dims])
        elif values.dtype.kind == "U":
            flat = [config.new_name("values", text) for text in values.ravel().tolist()]
            values = np.array(flat, dtype=str).reshape(values.shape)
        name = config.new_name("keys", path)
        if name in out:
            raise ValueError(f"the table of renamed keys makes two arrays {name}")
        out[name] = Leaf(values, leaf.family)
    return out


def _by_component(leaves: Leaves, config: Config) -> Iterator[tuple[str, Leaf]]:
    """The arrays, vectors whose items have a name now as one array for each."""
    for path, leaf in leaves.items():
        names = config.components_of(path) if leaf.values.ndim else ()
        for name, value in zip(names, leaf.values, strict=True) if names else ():
            signed = np.array(-value if name.startswith("-") else value)
            yield f"{path}/{name.removeprefix('-')}", Leaf(signed, leaf.family)
        if not names:
            yield path, leaf


def _scales(old: Leaves, new: Leaves) -> dict[str, float]:
    """The largest finite value of each family, of both results."""
    scales: dict[str, float] = {}
    for path, leaf in new.items():
        for values in (leaf.values, old.get(path, leaf).values):
            if values.dtype.kind in NUMBERS:
                finite = np.abs(values[np.isfinite(values)].astype(float))
                largest = float(finite.max(initial=0.0))
                scales[leaf.family] = max(scales.get(leaf.family, 0.0), largest)
    return scales


def _are_identical(a: Array, b: Array) -> bool:
    """Bit for bit; of texts, letter for letter."""
    if a.dtype.kind == b.dtype.kind == "U":
        return np.array_equal(a, b)
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


def _mismatch(a: Array, b: Array) -> str | None:
    """What keeps two arrays from being compared by their numbers."""
    if a.shape != b.shape:
        return f"shape {a.shape} is now {b.shape}"
    if a.dtype.kind in NUMBERS and b.dtype.kind in NUMBERS:
        return None
    if a.dtype.kind != b.dtype.kind:
        return f"type {a.dtype} is now {b.dtype}"
    i = np.argmax(a.ravel() != b.ravel())
    return f"{_short(a.ravel()[i])} is now {_short(b.ravel()[i])}"


def _short(value: Any) -> str:
    text = str(value)
    return repr(text if len(text) <= 60 else f"{text[:57]}...")


def _gap(a: Array, b: Array, floor: float, scale: float) -> tuple[float, str]:
    """The largest difference over the scale, and the two values that differ so much.

    A difference up to the floor counts as none.  NaN is NaN.
    """
    a, b = a.ravel().astype(float), b.ravel().astype(float)
    with np.errstate(invalid="ignore"):
        difference = np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0.0, np.abs(b - a))
    difference[np.isnan(difference)] = np.inf
    largest = float(difference.max(initial=0.0))
    if largest == 0.0:
        return 0.0, "same numbers, another type or sign of zero"
    i = int(difference.argmax())
    where = f"{a[i]:.9g} is now {b[i]:.9g}"
    return (0.0 if largest <= floor else largest / scale if scale else np.inf), where
