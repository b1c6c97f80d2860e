"""Where the port's quantities are among an FMU's variables: by name, kind, size and unit."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import InputError, nearest_names
from cosim.fmu.archive import UnpackedFmu
from cosim.fmu.quantity import OPEN_AXES, UNITS, Quantity
from cosim.number_text import MOST_NUMBER, RANGE, read_number
from cosim.port import Array, Hand
from cosim.schema.units import Kind, parse

KINDS = {False: ("Real", "Float64"), True: ("Boolean",)}
"""FMI's types of a quantity, by whether it is a switch."""
CAUSALITIES = {
    "input": ("input",),
    "output": ("output", "local", "calculatedParameter"),
    "parameter": ("parameter", "structuralParameter", "input"),
}
LOADS = ("force", "moment", "pull_force", "pull_moment")
"""Outputs that may not be lost in part."""
MOST_SHOWN = 6


@dataclass(frozen=True)
class VariablePlace:
    """Variables that hold a quantity: each an entry of it (or one the whole array)."""

    references: tuple[int, ...]
    shape: tuple[int, ...]
    switch: bool
    factor: Array = field(default_factory=lambda: np.ones(1))
    offset: Array = field(default_factory=lambda: np.zeros(1))
    """(entries,) or (1,): a value in SI units is factor times that of the unit, and the offset."""

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
    hand: Hand = "right",
) -> dict[str, VariablePlace]:
    """The place of every quantity; `names` gives, by quantity, the name of an array variable, or of
    the variables of its entries as a template (`F_{body}_{axis}`).  A quantity that `names` leaves
    out has the name that our own units give it; an `optional` one of these may be missing.  A
    placeholder may be numbered from 1 on: `r[{body_index},{axis_index}]`.
    `assume_si` takes a variable without unit to be in SI units; the FMU speaks in the frame of
    `hand`.

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
            both = (f"{{{what}}}, {{{what}_index}}" for what, _ in q.axes)
            axes = ", ".join(both) or "no placeholder"
            faults.append(f"map.{q.name} = {template!r}: it takes {axes}")
            continue
        if q.name in optional and q.name not in names and entries[0] not in variables:
            continue
        missing = [name for name in entries if name not in variables]
        if missing:
            faults.append(_absent(q, missing, variables))
            continue
        is_load = q.causality == "output" and q.name in LOADS
        further = q.others(template, variables) if is_load and "{" in template else []
        if further:
            faults.append(_lost(q, further))
            continue
        matched = [variables[name] for name in entries]
        units = {unit.name: unit.baseUnit for unit in opened.description.unitDefinitions}
        found, scales = _misfits(q, matched, len(entries), units, assume_si)
        faults += found
        located[q.name] = VariablePlace(
            tuple(v.valueReference for v in matched), q.shape, q.switch, *_turned(q, scales, hand)
        )
    _refuse(opened.path, faults)
    return located


def _turned(q: Quantity, scales: Array, hand: Hand) -> Array:
    """Factor and offset of every entry, from those (entries, 2) of the variables, so that what is
    read of a left hand is the right one's."""
    if hand == "right":
        return scales.T
    return np.ravel(q.signs(hand)) * scales.T


def _absent(quantity: Quantity, missing: Sequence[str], variables: Mapping[str, Any]) -> str:
    shown = ", ".join(missing[:MOST_SHOWN]) + (" ..." if len(missing) > MOST_SHOWN else "")
    near = nearest_names(missing[0], list(variables)[:5000])
    hint = f"; did you mean {near[0]}?" if near else ""
    return (
        f"{quantity.name}: the FMU has no variable {shown}{hint} (map.{quantity.name} names them)"
    )


def _lost(quantity: Quantity, further: Sequence[str]) -> str:
    shown = ", ".join(further[:MOST_SHOWN]) + (" ..." if len(further) > MOST_SHOWN else "")
    kinds = " or ".join(f"{what}s" for what, _ in quantity.axes if what in OPEN_AXES)
    return (
        f"{quantity.name}: the FMU also has {shown}, which would be lost; name all of its {kinds}, "
        f"or write map.{quantity.name} so that only what belongs to it fits"
    )


def _misfits(
    q: Quantity, variables: Sequence[Any], entries: int, units: Mapping[str, Any], assume_si: bool
) -> tuple[list[str], Array]:
    """What is wrong with the variables that hold a quantity, of one fault the first; factor and
    offset (entries, 2) of the unit of each."""
    size = prod(q.shape) // entries if entries else 0
    scales = []
    for v in variables:
        if v.type not in KINDS[q.switch]:
            known = " or ".join(KINDS[q.switch])
            return [f"{v.name}: is of type {v.type}, expected {known}"], np.zeros((1, 2))
        if v.causality not in CAUSALITIES[q.causality]:
            fault = f"{v.name}: its causality is {v.causality}, expected {q.causality}"
            return [fault], np.zeros((1, 2))
        if prod(v.shape or ()) * entries != prod(q.shape):
            holds = prod(v.shape or ())
            return [f"{v.name}: holds {holds} values, expected {size}"], np.zeros((1, 2))
        scale = _scale(q, v, units, assume_si)
        if isinstance(scale, str):
            return [scale], np.zeros((1, 2))
        scales.append(scale)
    return [], np.array(scales, dtype=float)


def _scale(
    q: Quantity, variable: Any, units: Mapping[str, Any], assume_si: bool
) -> tuple[float, float] | str:
    """Factor and offset of a variable's unit to SI, by the file's own definition of it, or where
    that defines nothing by its name; what is wrong where it is no unit of the quantity."""
    if not q.unit:
        return 1.0, 0.0
    name = variable.unit
    if name is None and variable.declaredType is not None:
        name = variable.declaredType.unit
    if name is None:
        advice = "if it is in SI units, write assume_si = true"
        fault = f"{variable.name}: states no unit, expected {q.unit}; {advice}"
        return (1.0, 0.0) if assume_si else fault
    base = units.get(name)
    if base is None:
        factor = _factor_by_name(name, q.unit)
        fault = f"{variable.name}: is in {name!r}, expected {q.unit}"
        return fault if factor is None else (factor, 0.0)
    factor, offset = read_number(str(base.factor)), read_number(str(base.offset))
    if offset is None or factor is None or not abs(factor) >= 1 / MOST_NUMBER:
        return (
            f"{variable.name}: its unit {name!r} has the factor {base.factor} and the offset "
            f"{base.offset}; expected numbers ({RANGE}), the factor not zero"
        )
    powers = {b: int(getattr(base, b)) for b in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")}
    stated = {b: power for b, power in powers.items() if power}
    without_rad = {b: power for b, power in UNITS[q.unit].items() if b != "rad"}
    if stated == UNITS[q.unit] or ("rad" not in stated and stated == without_rad):
        return factor, offset
    scale = "" if factor == 1.0 else f" ({base.factor} SI units)"
    return f"{variable.name}: is in {name}{scale}, expected {q.unit}"


def _factor_by_name(name: str, unit: str) -> float | None:
    """The SI units in one of that name; None where it is none of this quantity."""
    kind = Kind(unit, unit.replace(".", "*"), unit.replace(".", "*"), "")
    spelt = {"Nm": "N*m", "Nmm": "N*mm"}.get(name, name.replace(".", "*"))
    try:
        return parse(f"1 {spelt}", kind)
    except ValueError:
        return None


def _refuse(path: Path, faults: Sequence[str]) -> None:
    if faults:
        more = [f"and {len(faults) - MOST_SHOWN} more"] if len(faults) > MOST_SHOWN else []
        raise InputError("\n  ".join([f"{path}: does not map", *faults[:MOST_SHOWN], *more]))
