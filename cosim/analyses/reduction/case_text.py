"""The case file of a reduction: the case that it extends, the hood that was fitted, and to what."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from textwrap import wrap
from typing import Any

import numpy as np

from cosim.analyses.reduction.errors import errors
from cosim.analyses.reduction.reduce import Reduction
from cosim.analyses.reduction.walks import (
    ALONE_PARTS,
    HELD,
    HELD_MIXED,
    HELD_PARTS,
    LOW,
    MIXED,
    MIXTURE_PARTS,
    NEAR_ENDS,
    SEED,
)
from cosim.case.file import Settings
from cosim.hoods.lumped.reduction import Potential
from cosim.schema import units
from cosim.schema.json_schema import CASE_SCHEMA, schema_line

WIDTH, DIGITS = 98, 9


def case_text(found: Reduction, title: str, base: str, settings: Settings) -> str:
    """TOML that extends the case `base` (a path or name) with the fitted hood and those of the
    settings that are not of the hood."""
    lines = [schema_line(CASE_SCHEMA)]
    lines += [f"# {line}".rstrip() for part in _provenance(found) for line in _wrap(part)]
    lines += [f"extends = {json.dumps(base)}", f"title = {json.dumps(title)}"]
    lines += [line for text in settings if (line := _assignment(text))]
    return "\n".join([*lines, *_hood(found.potential)]) + "\n"


def _wrap(text: str) -> list[str]:
    return wrap(text, WIDTH, subsequent_indent="    ", break_long_words=False) or [""]


def _provenance(found: Reduction) -> Iterator[str]:
    yield (
        f"Reduced with `cosim reduce` from the {found.case.hood.kind} hood of {found.case.name}, "
        "on bones held in postures."
    )
    yield ""
    for joint, axis in found.within.grid.items():
        yield f"  {joint}: {', '.join(f'{angle:g}' for angle in axis)} deg"
    loads = ", ".join(f"{name} {force:.4g} N" for name, force in found.loads.items())
    rest = found.case.solve.resting_tension
    yield f"  loads: {loads}; each alone, and at {LOW:g} N, the others at {rest:g} N"
    parts = "; ".join(", ".join(f"{part:g}" for part in mixture) for mixture in MIXED)
    yield f"  all at once, in parts of these loads (tendon by tendon, then again): {parts}"
    yield (
        f"  between the grid's points (Sobol): each alone in {found.within.spread} postures, "
        f"with {_ends(ALONE_PARTS)} of its load, and mixtures in {found.within.mixtures}, with "
        f"{_ends(MIXTURE_PARTS)} of each; {100 * NEAR_ENDS:g} % of them nearer to the box's ends"
    )
    yield (
        f"  {len(found.samples)} states fitted: torques, excursions, stiffness, arms, compliance, "
        f"slips; {len(found.held_out)} held out: at random (seed {SEED}), {HELD} postures for each "
        f"tendon alone, with {_ends(HELD_PARTS)} of its load, and for mixtures, with "
        f"{_ends(HELD_MIXED)} of each"
    )
    yield ""
    yield "Error, relative to the hood that it was reduced from:"
    for e in errors(found):
        marked = (
            ""
            if e.mark is None
            else (
                f" (mark: {100 * e.mark:.0f} %, beyond it {100 * e.beyond:.0f} % of those states)"
            )
        )
        yield (
            f"  {e.quantity}: median {100 * e.fit:.1f} % of the states fitted, "
            f"{100 * e.median:.1f} % of those held out, at most {100 * e.most:.1f} % there"
            f"{marked}, at {e.where}"
        )
    if found.failures:
        yield ""
        yield "Without an equilibrium, and left out (joints in the finger's order):"
        yield from (f"  {failure}" for failure in found.failures)
    yield ""


def _ends(parts: tuple[float, float]) -> str:
    return f"{parts[0]:g} to {parts[1]:g}"


def _assignment(text: str) -> str:
    """A setting as a line of TOML; none for one of the hood, which the fit has in it."""
    key, _, value = (part.strip() for part in text.partition("="))
    if key.split(".")[0].strip() == "hood":
        return ""
    try:
        tomllib.loads(f"value = {value}")
    except tomllib.TOMLDecodeError:
        value = json.dumps(value)
    return f"{key} = {value}"


def _hood(p: Potential) -> Iterator[str]:
    yield from ("", "[hood]", 'kind = "network"', "connecting = {}", "")
    yield "[hood.muscles]"
    yield from (f"{name} = {{}}" for name in p.muscles)
    yield from ("", "[hood.reduced]", f"toe = {p.toe!r}")
    for name, powers in (("angle_powers", p.angle_powers), ("tension_terms", p.tension_terms)):
        yield from _table(name, powers.tolist())
    yield from _table("energy", _short(p.energy))
    yield from _table("slip_powers", p.slip_powers.tolist())
    yield from _table("slips", [_short(slip) for slip in p.slip])
    yield from ("", "[hood.reduced.angles]")
    for joint, low, high in zip(p.joints, p.low, p.high, strict=True):
        ends = [units.spell(float(end), units.ANGLE) for end in (low, high)]
        yield f"{joint} = {json.dumps(ends)}"
    yield from ("", "[hood.reduced.tensions]")
    for muscle, most in zip(p.muscles, p.most, strict=True):
        yield f"{muscle} = {json.dumps(units.spell(float(most), units.FORCE))}"


def _short(values: np.ndarray) -> list[list[float]]:
    return [[float(f"{value:.{DIGITS}g}") for value in row] for row in values]


def _table(name: str, rows: list[Any]) -> Iterator[str]:
    """An array of arrays, a line for each."""
    yield f"{name} = ["
    yield from (f"    {json.dumps(row)}," for row in rows)
    yield "]"
