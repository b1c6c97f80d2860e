"""Where the port's quantities are among an FMU's variables: by name, kind, size and unit."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any

from cosim.errors import InputError, nearest_names
from cosim.fmu.archive import UnpackedFmu
from cosim.fmu.quantity import UNITS, Quantity

KINDS = {False: ("Real", "Float64"), True: ("Boolean",)}
"""FMI's types of a quantity, by whether it is a switch."""
CAUSALITIES = {
    "input": ("input",),
    "output": ("output", "local", "calculatedParameter"),
    "parameter": ("parameter", "structuralParameter", "input"),
}
MOST_SHOWN = 6


@dataclass(frozen=True)
class VariablePlace:
    """Variables that hold a quantity: each an entry of it (or one the whole array)."""

    references: tuple[int, ...]
    shape: tuple[int, ...]
    switch: bool

    @property
    def size(self) -> int:
        """The number of entries."""
        return prod(self.shape)


def places(
    opened: UnpackedFmu,
    quantities: Iterable[Quantity],
    names: Mapping[str, str],
    optional: Collection[str] = (),
    assume_si: bool = False,
) -> dict[str, VariablePlace]:
    """The place of every quantity; `names` gives, by quantity, the name of an array variable, or of
    the variables of its entries as a template (`F_{body}_{axis}`).  A quantity that `names` leaves
    out has the name that our own units give it; an `optional` one of these may be missing.
    `assume_si` takes a variable without unit to be in SI units.

    Raises InputError that lists what does not map."""
    quantities = list(quantities)
    known = [q.name for q in quantities]
    faults = [
        f"map.{name}: no such quantity; known are {', '.join(known)}"
        for name in names
        if name not in known
    ]
    variables = {v.name: v for v in opened.description.modelVariables}
    is_scalar = opened.description.fmiVersion == "2.0"
    located = {}
    for q in quantities:
        template = names.get(q.name, q.template if is_scalar else q.name)
        try:
            entries = [template] if "{" not in template else q.entries(template)
        except (KeyError, ValueError, IndexError):
            axes = ", ".join("{" + what + "}" for what, _ in q.axes) or "no placeholder"
            faults.append(f"map.{q.name} = {template!r}: it takes {axes}")
            continue
        if q.name in optional and q.name not in names and entries[0] not in variables:
            continue
        missing = [name for name in entries if name not in variables]
        if missing:
            faults.append(_absent(q, missing, variables))
            continue
        matched = [variables[name] for name in entries]
        faults += _misfits(q, matched, len(entries), _units(opened), assume_si)
        located[q.name] = VariablePlace(tuple(v.valueReference for v in matched), q.shape, q.switch)
    _refuse(opened.path, faults)
    return located


def _absent(quantity: Quantity, missing: Sequence[str], variables: Mapping[str, Any]) -> str:
    shown = ", ".join(missing[:MOST_SHOWN]) + (" ..." if len(missing) > MOST_SHOWN else "")
    near = nearest_names(missing[0], list(variables)[:5000])
    hint = f"; did you mean {near[0]}?" if near else ""
    return (
        f"{quantity.name}: the FMU has no variable {shown}{hint} (map.{quantity.name} names them)"
    )


def _misfits(
    q: Quantity, variables: Sequence[Any], entries: int, units: Mapping[str, Any], assume_si: bool
) -> list[str]:
    """What is wrong with the variables that hold a quantity; of one fault the first."""
    size = prod(q.shape) // entries if entries else 0
    for v in variables:
        if v.type not in KINDS[q.switch]:
            return [f"{v.name}: is of type {v.type}, expected {' or '.join(KINDS[q.switch])}"]
        if v.causality not in CAUSALITIES[q.causality]:
            return [f"{v.name}: its causality is {v.causality}, expected {q.causality}"]
        if prod(v.shape or ()) * entries != prod(q.shape):
            return [f"{v.name}: holds {prod(v.shape or ())} values, expected {size}"]
        fault = _wrong_unit(q, v, units, assume_si)
        if fault:
            return [fault]
    return []


def _units(opened: UnpackedFmu) -> dict[str, Any]:
    return {unit.name: unit.baseUnit for unit in opened.description.unitDefinitions}


def _wrong_unit(q: Quantity, variable: Any, units: Mapping[str, Any], assume_si: bool) -> str:
    if not q.unit:
        return ""
    name = variable.unit
    if name is None and variable.declaredType is not None:
        name = variable.declaredType.unit
    if name is None:
        advice = "if it is in SI units, write assume_si = true"
        return "" if assume_si else f"{variable.name}: states no unit, expected {q.unit}; {advice}"
    base = units.get(name)
    if base is None:
        return "" if name == q.unit else f"{variable.name}: is in {name!r}, expected {q.unit}"
    powers = {b: int(getattr(base, b)) for b in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")}
    stated = {b: power for b, power in powers.items() if power}
    if stated == UNITS[q.unit] and float(base.factor) == 1.0 and float(base.offset) == 0.0:
        return ""
    scale = "" if float(base.factor) == 1.0 else f" ({base.factor} SI units)"
    return f"{variable.name}: is in {name}{scale}, expected {q.unit}"


def _refuse(path: Path, faults: Sequence[str]) -> None:
    if faults:
        more = [f"and {len(faults) - MOST_SHOWN} more"] if len(faults) > MOST_SHOWN else []
        raise InputError("\n  ".join([f"{path}: does not map", *faults[:MOST_SHOWN], *more]))
