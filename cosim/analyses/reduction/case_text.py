"""The case file of a reduction: the case that it extends, the hood that was fitted, and to what."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from cosim.analyses.reduction import walks
from cosim.analyses.reduction.errors import errors
from cosim.analyses.reduction.reduce import Reduction
from cosim.case.file import Settings
from cosim.hoods.lumped.build import ReducedPotential
from cosim.schema import units
from cosim.schema.json_schema import CASE_SCHEMA, schema_line
from cosim.text_tables import notes, toml_settings, toml_text

DIGITS = 9


def case_text(reduction: Reduction, title: str, base: str, settings: Settings) -> str:
    """TOML that extends the case `base` (a path or name) with the fitted hood and those of the
    settings that are not of the hood."""
    head = f"{schema_line(CASE_SCHEMA)}\n{notes(_provenance(reduction))}"
    kept = [text for text in settings if text.partition(".")[0].strip() != "hood"]
    stated = toml_text({"extends": base, "title": title}) + toml_settings(kept)
    return f"{head}{stated}\n{toml_text({'hood': _hood(reduction.potential)})}"


def _provenance(reduction: Reduction) -> Iterator[str]:
    yield (
        f"Reduced with `cosim export` from the {reduction.case.hood.kind} hood of "
        f"{reduction.case.name}, on bones held in postures."
    )
    yield ""
    for joint, axis in reduction.within.grid.items():
        yield f"  {joint}: {', '.join(f'{angle:g}' for angle in axis)} deg"
    loads = ", ".join(f"{name} {force:.4g} N" for name, force in reduction.loads.items())
    rest = reduction.case.solve.resting_tension
    yield f"  loads: {loads}; each alone, and at {walks.LOW:g} N, the others at {rest:g} N"
    parts = "; ".join(", ".join(f"{part:g}" for part in mixture) for mixture in walks.MIXED)
    yield f"  all at once, in parts of these loads (tendon by tendon, then again): {parts}"
    yield (
        f"  between the grid's points (Sobol): each alone in {reduction.within.spread} postures, "
        f"with {_ends(walks.ALONE_PARTS)} of its load, and mixtures in "
        f"{reduction.within.mixtures}, with {_ends(walks.MIXTURE_PARTS)} of each; "
        f"{100 * walks.NEAR_ENDS:g} % of them nearer to the box's ends"
    )
    yield (
        f"  {len(reduction.samples)} states fitted: torques, excursions, stiffness, arms, "
        f"compliance, slips; {len(reduction.held_out)} held out: at random (seed {walks.SEED}), "
        f"{walks.HELD} postures for each tendon alone, with {_ends(walks.HELD_PARTS)} of its load, "
        f"and for mixtures, with {_ends(walks.HELD_MIXED)} of each"
    )
    yield ""
    yield "Error, relative to the hood that it was reduced from:"
    for e in errors(reduction):
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
    if reduction.failures:
        yield ""
        yield "Without an equilibrium, and left out (joints in the finger's order):"
        yield from (f"  {failure}" for failure in reduction.failures)
    yield ""


def _ends(parts: tuple[float, float]) -> str:
    return f"{parts[0]:g} to {parts[1]:g}"


def _hood(p: ReducedPotential) -> dict[str, Any]:
    ends = zip(p.joints, p.low, p.high, strict=True)
    most = zip(p.muscles, p.most, strict=True)
    return {
        "kind": "network",
        "connecting": {},
        "muscles": {name: {} for name in p.muscles},
        "reduced": {
            "toe": p.toe,
            "angle_powers": p.angle_powers.tolist(),
            "tension_terms": p.tension_terms.tolist(),
            "energy": _short(p.energy),
            "slip_powers": p.slip_powers.tolist(),
            "slips": [_short(slip) for slip in p.slip],
            "angles": {
                joint: [units.spell(float(end), units.ANGLE) for end in (low, high)]
                for joint, low, high in ends
            },
            "tensions": {muscle: units.spell(float(force), units.FORCE) for muscle, force in most},
        },
    }


def _short(values: np.ndarray) -> list[list[float]]:
    return [[float(f"{value:.{DIGITS}g}") for value in row] for row in values]
