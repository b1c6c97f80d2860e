"""What identification may fit: parameters with bounds, and the settings that they make."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from math import ceil, exp, isfinite, log, log10
from pathlib import Path
from typing import Any, Literal, get_args

from cosim.case.file import Settings
from cosim.case.schema import Case
from cosim.errors import InputError
from cosim.hoods.shell.table import FibreMooneyRivlinConfig, TransverselyIsotropicConfig
from cosim.hoods.shell.variation import toe_settings
from cosim.schema import units
from cosim.schema.fields import is_number
from cosim.text_tables import read_toml

Values = Mapping[str, float]
"""By a parameter's name, in its unit."""
Scale = Literal["logarithmic", "linear"]
KEYS = {"low", "high", "start", "unit", "scale", "settings"}
CASES = "cases"
"""The table of the same file that is no parameter; see `cosim.analyses.identify.cases`."""
DIGITS = 4
"""Significant ones of a parameter found; on a linear scale, of its range."""


@dataclass(frozen=True)
class FitParameter:
    """A number to find within bounds, all in `unit`; what it sets is said by `templates`
    (KEY={value}), or, without them, by the built-in rule of that name.

    The search is for its `coordinate`: on a logarithmic scale (of positive numbers alone) the
    logarithm, on a linear one the fraction of the way from `low` to `high`."""

    name: str
    unit: str
    low: float
    high: float
    start: float
    templates: Settings = ()
    scale: Scale = "logarithmic"

    def __post_init__(self) -> None:
        positive = self.scale == "linear" or self.low > 0
        if not positive or not self.low < self.high or not self.low <= self.start <= self.high:
            order = "low < high" if self.scale == "linear" else "0 < low < high"
            signed = "" if positive else '; scale = "linear" is for numbers of any sign'
            raise InputError(
                f"parameter {self.name}: expected {order} and a start between them, not "
                f"low = {self.low:g}, high = {self.high:g}, start = {self.start:g}{signed}"
            )

    def format_value(self, value: float) -> str:
        """A value with its unit, as a case states it."""
        return f"{value!r} {self.unit}".rstrip()

    def coordinate(self, value: float) -> float:
        """What the search sees of a value."""
        if self.scale == "linear":
            return (value - self.low) / (self.high - self.low)
        return log(value)

    def value(self, coordinate: float) -> float:
        """The value at a coordinate, within the bounds, in digits as it is written."""
        for bound in (self.low, self.high):
            if coordinate == self.coordinate(bound):
                return bound
        linear = self.scale == "linear"
        way = coordinate * (self.high - self.low)
        value = self.low + way if linear else exp(coordinate)
        return min(max(float(f"{value:.12g}"), self.low), self.high)

    def round_coordinate(self, coordinate: float) -> float:
        """The coordinate of the nearest value of `DIGITS` digits within the bounds."""
        value = self.value(coordinate)
        if self.scale == "linear":
            value = round(value, DIGITS - ceil(log10(self.high - self.low)) + 1)
        else:
            value = float(f"{value:.{DIGITS}g}")
        return self.coordinate(min(max(value, self.low), self.high))


@dataclass(frozen=True)
class Free:
    """The parameters of a fit and what they set in a case."""

    parameters: tuple[FitParameter, ...]
    settings: Callable[[Values], Settings]


# Assumptions, wide on purpose.  c1 and moduli: from a gel to as stiff as along the tendons; the toe
# ends at a stretch of 1 + toe; c4 to the case file's bound.
_BOUNDS = {
    "c1": ("MPa", 0.02, 20.0),
    "toe": ("", 0.002, 0.08),
    "c4": ("", 20.0, 600.0),
    "modulus_across": ("MPa", 0.05, 100.0),
    "shear_modulus": ("MPa", 0.05, 50.0),
}


def free_built_in(case: Case) -> Free:
    """What no paper gives of the case's fibrous laws, one value for all regions: of the trans iso
    Mooney-Rivlin law c1, the `toe` (lam_max - 1) and c4, with c3 = c5 / (c4 exp(c4 toe)) so that
    the modulus along the fibres is smooth; of the linear law the modulus across and in shear.
    Fibres that are slack beyond the toe's bounds, as those beside the central slip, keep their own.

    Raises InputError where no region has such a law."""
    return _free(case, tuple(_built_in_parameters(case).values()))


def read_free(path: Path, case: Case) -> Free:
    """The parameters of a TOML file, a table for each: of a built-in one low, high and start where
    they are others; of any other these, unit, scale and `settings`, a list of "KEY={value}".  A
    file that has but the table of cases leaves the built-in ones free.

    Raises InputError with every fault, each with its table."""
    known = _built_in_parameters(case, needed=False)
    tables = {name: table for name, table in fit_tables(path).items() if name != CASES}
    if not tables:
        return free_built_in(case)
    parameters, faults = [], []
    for name, table in tables.items():
        try:
            parameters.append(_read(f"{path}: {name}", name, table, known))
        except InputError as error:
            faults.append(str(error))
    raise_faults(faults)
    return _free(case, tuple(parameters))


def raise_faults(faults: Iterable[str]) -> None:
    """Raise InputError with all faults, each once, if there are any."""
    each = [fault.replace("\n", "\n  ") for fault in dict.fromkeys(faults)]
    if len(each) == 1:
        raise InputError(each[0])
    if each:
        raise InputError("\n  ".join([f"{len(each)} faults", *each]))


def fit_tables(path: Path) -> dict[str, Any]:
    """The tables of a file of parameters.  Raises InputError."""
    tables = read_toml(path)
    if not tables or not all(isinstance(table, dict) for table in tables.values()):
        raise InputError(f"{path}: expected a table for each parameter, for example [c1]")
    return tables


def _read(
    place: str, name: str, table: dict[str, Any], known: Mapping[str, FitParameter]
) -> FitParameter:
    if unknown := sorted(set(table) - KEYS):
        raise InputError(f"{place}: unknown {', '.join(unknown)}; known: {', '.join(sorted(KEYS))}")
    numbers = {
        key: _number(place, key, table[key]) for key in ("low", "high", "start") if key in table
    }
    if "settings" not in table:
        if name not in known:
            raise InputError(
                f"{place}: give settings, for example ['hood.springs.ligament_radial.slack="
                f"{{value}}']; without them this case knows {', '.join(known) or 'none'}"
            )
        if "scale" in table:
            raise InputError(f"{place}: scale goes with settings; {name} is logarithmic")
        p = known[name]
        low, high = numbers.get("low", p.low), numbers.get("high", p.high)
        return FitParameter(name, p.unit, low, high, numbers.get("start", p.start))
    templates, scale = table["settings"], table.get("scale", "logarithmic")
    if not isinstance(templates, list) or not all("={value}" in str(text) for text in templates):
        raise InputError(f"{place}: settings: expected a list of texts KEY={{value}}")
    if scale not in get_args(Scale):
        raise InputError(f"{place}: scale = {scale!r}: expected {' or '.join(get_args(Scale))}")
    if lacking := sorted({"low", "high", "start"} - set(numbers)):
        raise InputError(f"{place}: lacks {', '.join(lacking)}")
    unit = str(table.get("unit", ""))
    return FitParameter(name, unit, **numbers, templates=tuple(map(str, templates)), scale=scale)


def _number(place: str, key: str, value: Any) -> float:
    if not is_number(value) or not isfinite(value):
        raise InputError(f"{place}: {key} = {value!r}: expected a number, in `unit`")
    return float(value)


def _built_in_parameters(case: Case, needed: bool = True) -> dict[str, FitParameter]:
    """The built-in parameters of a case, from where it has them."""
    found = {}
    for name, values in _stated_values(case).items():
        of, low, high = _BOUNDS[name]
        mean = exp(sum(map(log, values)) / len(values))
        found[name] = FitParameter(name, of, low, high, min(max(mean, low), high))
    if needed and not found:
        raise InputError(
            "no region has a law whose parameters are fitted without a file that frees some "
            "(trans_iso_mooney_rivlin or transversely_isotropic)"
        )
    return found


def _stated_values(case: Case) -> dict[str, list[float]]:
    """What the regions say of each, in its unit."""
    curved, straight = _laws(case)
    megapascal = units.parse("1 MPa", units.PRESSURE)
    found = {
        "c1": [law.c1 / megapascal for law in curved.values()],
        "toe": [law.lam_max - 1 for law in curved.values() if _shares_toe(law)],
        "c4": [law.c4 for law in curved.values() if _shares_toe(law)],
        "modulus_across": [law.modulus_across / megapascal for law in straight.values()],
        "shear_modulus": [law.shear_modulus / megapascal for law in straight.values()],
    }
    return {name: values for name, values in found.items() if values}


def _laws(
    case: Case,
) -> tuple[Mapping[str, FibreMooneyRivlinConfig], Mapping[str, TransverselyIsotropicConfig]]:
    return case.hood.laws("trans_iso_mooney_rivlin"), case.hood.laws("transversely_isotropic")


def _shares_toe(law: FibreMooneyRivlinConfig) -> bool:
    return law.lam_max - 1 <= _BOUNDS["toe"][2]


def _free(case: Case, parameters: tuple[FitParameter, ...]) -> Free:
    def settings(values: Values) -> Settings:
        own = [p for p in parameters if p.templates]
        others = {p.name: values[p.name] for p in parameters if not p.templates}
        texts = [
            t.replace("{value}", p.format_value(values[p.name])) for p in own for t in p.templates
        ]
        return (*_built_in_settings(case, others), *texts)

    return Free(parameters, settings)


def _built_in_settings(case: Case, values: Values) -> Iterator[str]:
    curved, straight = _laws(case)
    for name, law in curved.items():
        if "c1" in values:
            yield f"hood.regions.{name}.c1={values['c1']!r} MPa"
        if ("toe" in values or "c4" in values) and _shares_toe(law):
            c4, toe = values.get("c4", law.c4), values.get("toe", law.lam_max - 1)
            yield from toe_settings(name, law.c5, c4, toe)
    for name in straight:
        for key in ("modulus_across", "shear_modulus"):
            if key in values:
                yield f"hood.regions.{name}.{key}={values[key]!r} MPa"
