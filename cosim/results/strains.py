"""Strains of a hood in numbers: by region and direction, from free of stress and from unloaded.

Longitudinal is along the mesh's lines along the finger (in sagittal bands: round it), whichever way
the fibres run.  The sheet's own strain over the central region is read by gauges at the markers.  A
cadaver experiment sees how markers on the hood move from the unloaded to the loaded state; the
sheet's own Green-Lagrange strain counts from where it is free of stress.  With l1 and l0 the
lengths of a material line in the two states, e = l1 / l0 - 1 is what markers show (engineering
strain), and (l1^2 / l0^2 - 1) / 2 the Green-Lagrange strain from the unloaded state.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from cosim.hoods.shell.view import HoodLook
from cosim.port import Array
from meshes.hood_mesh import REGIONS

Range = dict[str, float]
DIRECTIONS = ("longitudinal", "lateral")
TENSION_STATES = ("taut", "wrinkled", "slack")
GAUGE = 2e-3
"""m, the standard deviation of the bell over which a gauge at a marker reads the sheet (what lies
within 2.4 mm weighs by half and more); an assumption.  What single elements bear says nothing: at
the corners of what holds the sheet it grows without bound as they get smaller."""

SLACK = 0.05
"""Of both slips' force together, what a slip at most bears that hangs slack."""


def is_slack(slips: Mapping[str, float], slip: str) -> bool:
    """Whether a slip bears so little of both slips' force (N) that no quotient by it says
    anything."""
    return slips[slip] <= SLACK * sum(slips.values())


def strain_summary(look: HoodLook) -> dict[str, object]:
    """Percent, Green-Lagrange from free of stress: over the central region, and by region; N that
    each region passes on along its fibres; and of the area of the regions that are tension fields
    how much is taut, wrinkled and slack."""
    out: dict[str, object] = {
        "strain_percent": _over_central(look.line_strain, look),
        "region_strain_percent": _by_region(look.line_strain, look),
        "region_force_N": dict(look.region_force),
    }
    whole = look.area[look.tension >= 0].sum()
    if whole > 0:
        parts = (look.area[look.tension == i].sum() for i in range(len(TENSION_STATES)))
        shares = (100 * float(part / whole) for part in parts)
        out["tension_field_area_percent"] = dict(zip(TENSION_STATES, shares, strict=True))
    return out


def strain_change(before: HoodLook, now: HoodLook) -> dict[str, object]:
    """Percent, from the unloaded state `before`: Green-Lagrange and engineering over the central
    region, engineering by region and between the markers."""
    ratio = np.sqrt((1 + 2 * now.line_strain[:, :2]) / (1 + 2 * before.line_strain[:, :2]))
    return {
        "strain_percent": _over_central((ratio**2 - 1) / 2, now),
        "engineering_strain_percent": _over_central(ratio - 1, now),
        "region_engineering_strain_percent": _by_region(ratio - 1, now),
        "marker_strain_percent": {
            name: _range(strain.ravel(), np.ones(strain.size))
            for name, strain in zip(DIRECTIONS, marker_strains(before, now), strict=True)
        },
    }


def marker_strains(before: HoodLook, now: HoodLook) -> tuple[Array, Array]:
    """(rows - 1, columns) longitudinal and (rows, columns - 1) lateral engineering strains between
    neighbours of the marker grid, from `before` to `now`."""
    x0, x1 = now.markers.at(before.points), now.markers.at(now.points)

    def stretch(axis: int) -> Array:
        l0, l1 = (np.linalg.norm(np.diff(x, axis=axis), axis=2) for x in (x0, x1))
        return np.asarray(l1 / l0 - 1)

    return stretch(0), stretch(1)


def gauged(strain: Array, look: HoodLook) -> Array:
    """(m, 2) what gauges at the m markers read of strains (ne, 2 or 3) of the central region."""
    on = look.central
    middle = look.reference[look.quads[on]].mean(axis=1)
    place = look.markers.at(look.reference).reshape(-1, 1, 3)
    weight = look.area[on] * np.exp(-(((place - middle) / GAUGE) ** 2).sum(axis=2) / 2)
    return np.asarray(weight @ strain[on, :2] / weight.sum(axis=1, keepdims=True))


def _over_central(strain: Array, look: HoodLook) -> dict[str, Range]:
    """Mean over the area, extremes of what the gauges read."""
    out = _by_direction(strain, look.area, look.central)
    for name, read in zip(DIRECTIONS, gauged(strain, look).T, strict=True):
        out[name] |= {"min": 100 * float(read.min()), "max": 100 * float(read.max())}
    return out


def _by_region(strain: Array, look: HoodLook) -> dict[str, Mapping[str, Range]]:
    there = (i for i in range(len(REGIONS)) if (look.region == i).any())
    return {REGIONS[i]: _by_direction(strain, look.area, look.region == i) for i in there}


def _by_direction(strain: Array, area: Array, cells: np.ndarray) -> dict[str, Range]:
    return dict(_ranges(strain[cells], area[cells]))


def _ranges(strain: Array, area: Array) -> Iterator[tuple[str, Range]]:
    for name, column in zip(DIRECTIONS, strain.T[:2], strict=True):
        yield name, _range(column, area)


def _range(values: Array, weight: Array) -> Range:
    return {
        "min": 100 * float(values.min()),
        "mean": 100 * float(values @ weight / weight.sum()),
        "max": 100 * float(values.max()),
    }
