"""Results over a parameter of their cases: its values, their roughness, and their plot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.errors import CosimError, InputError
from cosim.port import Array
from cosim.results.compare import number, unit_of, value_of
from cosim.results.looks import look
from cosim.results.picture import as_plain_text, load_matplotlib, new_picture, show_in_notebooks
from cosim.results.quantities import check_quantity
from cosim.results.result import Result
from cosim.roughness import FEWEST, Roughness, roughness_along
from cosim.text_tables import leaves

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TOLD = ("fingertip_force_N.dorsal", "slip_force_N.central", "slip_force_N.terminal")
"""The quantities whose roughness `run_many` says."""


@dataclass(frozen=True)
class Sweep:
    """Results over one parameter of their cases, None where a run failed."""

    parameter: str
    unit: str
    place: Array
    """(n,) the parameter's values; of a run that failed halfway between its neighbours."""
    results: tuple[Result | None, ...]

    def values(self, quantity: str) -> Array:
        """The values (n,) of a quantity, nan where there is none.  Raises InputError."""
        check_quantity(quantity, [r.summary for r in self.results if r is not None])
        each = [r and value_of(r.summary, quantity) for r in self.results]
        return np.array(each, dtype=float)

    def roughness(self, quantity: str) -> Roughness:
        """The roughness of a quantity along the parameter.  Raises InputError."""
        return roughness_along(self.place, self.values(quantity), self.unit)


def sweep_over(results: Sequence[Result | CosimError], parameter: str) -> Sweep:
    """Results, in the sweep's order, over a parameter by its dotted key in the case file.

    Raises InputError where a case has no such number, or none has ended."""
    kept = tuple(r if isinstance(r, Result) else None for r in results)
    stated = {i: _stated(r, parameter) for i, r in enumerate(kept) if r is not None}
    units = {unit for _, unit in stated.values()}
    if len(units) != 1:
        found = f"units {', '.join(sorted(units))}" if units else "no run that has ended"
        raise InputError(f"{parameter}: expected runs with one unit of it, got {found}")
    place = np.interp(range(len(kept)), list(stated), [value for value, _ in stated.values()])
    return Sweep(parameter, units.pop(), place, kept)


def _stated(result: Result, parameter: str) -> tuple[float, str]:
    value = _values(result).get(parameter)
    text, _, unit = str(value).partition(" ")
    try:
        return float(text), unit
    except ValueError:
        raise InputError(
            f"{result.name}: {parameter} is {value!r}; expected the key of a number of the case, "
            'for example "finger.posture.PIP" or "tendons.EDC.tension"'
        ) from None


def _values(result: Result) -> dict[str, Any]:
    """The values of the case by dotted key."""
    return {".".join(path): value for path, value in leaves(result.case_table)}


def describe_sweep(results: Sequence[Result | CosimError]) -> str:
    """How rough results are along the one number in which their cases differ, in a sentence; empty
    where there is no such number or too few results."""
    tables = [_values(r) for r in results if isinstance(r, Result)]
    if len(tables) < FEWEST:
        return ""
    first = tables[0]
    keys = {key for t in tables for key in {**first, **t} if first.get(key) != t.get(key)}
    if len(keys) != 1:
        return ""
    try:
        sweep = sweep_over(results, keys.pop())
    except InputError:  # a word
        return ""
    each = {q: sweep.roughness(q).rms for q in TOLD if np.isfinite(sweep.values(q)).any()}
    said = ", ".join(f"{number(rms, 2)} {unit_of(q)} of {q}" for q, rms in each.items())
    return f"along {sweep.parameter} a cubic leaves {said}" if said else ""


def draw_over(sweep: Sweep, quantities: Sequence[str]) -> Figure:
    """Panels of the quantities over the parameter, those of one unit in one, with their roughness;
    a gap where a run failed.  Raises InputError."""
    load_matplotlib()
    show_in_notebooks()
    units = list(dict.fromkeys(unit_of(q) for q in quantities))
    figure = new_picture(8.5, 0.8 + 2.6 * len(units))
    panels = figure.subplots(len(units), 1, sharex=True, squeeze=False)[:, 0]
    order = np.argsort(sweep.place, kind="stable")
    for i, quantity in enumerate(quantities):
        unit, values = unit_of(quantity), sweep.values(quantity)
        label = f"{quantity}\nroughness {number(sweep.roughness(quantity).rms, 2)} {unit}"
        axes = panels[units.index(unit)]
        axes.plot(sweep.place[order], values[order], marker="o", ms=3, label=label, **look(i).line)
        axes.set_ylabel(unit)
    for axes in panels:
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    panels[-1].set_xlabel(f"{sweep.parameter}, {sweep.unit}".rstrip(", "))
    return as_plain_text(figure)
