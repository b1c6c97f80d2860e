"""What a motion does over time, as curves: angles, forces, slips, torques, strain."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cosim.errors import InputError
from cosim.fingers.kinds import live_finger
from cosim.port import Array
from cosim.report.templates import floats
from cosim.report.views import View, slip_forces
from cosim.results.conventions import source_words
from cosim.results.result import Result

MOST_MOMENTS = 400
"""Moments of a curve, evenly spread."""
LEAST_CURVE = 1e-6
"""N, N mm or mm, below which a curve is none."""
STRAIN_FIELD = "along"
OF_STRAIN = (
    *("extensor_tendon_distal", "central_band", "central_slip"),
    *("lateral_band_radial", "lateral_band_ulnar", "terminal_slip"),
)
"""Regions whose strain over time is shown."""
MOST_DOTS = 12
OWN = "tendons of the finger"


@dataclass(frozen=True)
class Chart:
    """Curves on one pair of axes: by name, over the times (n,) s."""

    title: str
    axis: str
    """What the ordinate is, with its unit."""
    time: Array
    curves: Mapping[str, Array]


def charts_of(run: Result, view: View) -> list[Chart]:
    """The charts of a motion, those whose curves are zero throughout left out; none at rest."""
    if run.axis != "time":
        return []
    charts = [*_states(run), *_slips(run), *_torques(run), *_strain(view), *_dots(view)]
    return [
        chart
        for chart in charts
        if any(np.abs(y).max() > LEAST_CURVE for y in chart.curves.values())
    ]


def pack_charts(run: Result, view: View) -> Any:
    """The charts for page.js."""
    return [
        {
            "title": chart.title,
            "axis": chart.axis,
            "time": floats(chart.time),
            "curves": [{"name": name, "y": floats(y)} for name, y in chart.curves.items()],
        }
        for chart in charts_of(run, view)
    ]


def _moments(run: Result) -> np.ndarray:
    count = len(run.arrays.coordinates["time"].values)
    return np.unique(np.linspace(0, count - 1, min(count, MOST_MOMENTS)).round().astype(int))


def _names(run: Result, dimension: str) -> list[str]:
    return [str(name).replace("_", " ") for name in run.arrays.coordinates[dimension].values]


def _at(run: Result, name: str) -> Array:
    """An array at the moments."""
    return np.asarray(run.arrays.variables[name].values)[_moments(run)]


def _time(run: Result) -> Array:
    return np.asarray(run.arrays.coordinates["time"].values)[_moments(run)]


def _states(run: Result) -> Iterator[Chart]:
    time, angle = _time(run), np.rad2deg(_at(run, "angle"))
    turned = {
        f"{joint} (from {angle[0, i]:.0f}°)".replace("-", "−"): angle[:, i] - angle[0, i]
        for i, joint in enumerate(_names(run, "joint"))
    }
    yield Chart("Joint angles", "turned since the start, °", time, turned)
    force = dict(zip(_names(run, "axis"), _at(run, "tip_force").T, strict=True))
    yield Chart("Fingertip force", "force on the world, N", time, force)
    tension = {
        name: values
        for variable, dimension in (("tension", "tendon"), ("own_tension", "muscle"))
        if variable in run.arrays.variables
        for name, values in zip(_names(run, dimension), _at(run, variable).T, strict=True)
    }
    yield Chart("Tendons", "tension, N", time, tension)
    if "insertion_tension" in run.arrays.variables:
        left = dict(zip(_names(run, "muscle"), _at(run, "insertion_tension").T, strict=True))
        yield Chart("Tendons at their insertions", "tension left by friction, N", time, left)
        lost = {"all tendons": 1e3 * _at(run, "guide_loss")}
        yield Chart("Friction of tendons", "energy lost at guides, mJ", time, lost)
    if "motor_position" in run.arrays.variables:
        wound = dict(zip(_names(run, "motor"), 1e3 * _at(run, "motor_position").T, strict=True))
        yield Chart("Motors", "tendon drawn by, mm", time, wound)


def _slips(run: Result) -> Iterator[Chart]:
    slips = {name: force[_moments(run)] for name, force in slip_forces(run.arrays).items()}
    if slips:
        yield Chart("Slips", "force on the bone, N", _time(run), slips)


def _torques(run: Result) -> Iterator[Chart]:
    """The torques about each joint by source, from the ledger's moments; none of a finger whose
    case cannot be built again."""
    try:
        case = run.checked_case()
        stated = case.native_finger()
    except InputError:
        return
    finger = live_finger(stated, case.hood.left_to_finger)
    start = finger.start(stated.posture.angles())
    bodies, joints = list(finger.bodies), _names(run, "joint")
    times, angles = run.arrays.coordinates["time"].values, run.arrays.variables["angle"].values
    by_state: dict[str, dict[str, Array]] = {}
    for row in run.rows:
        books = by_state.setdefault(row.state, {})
        wrench = books.setdefault(_kind(row.source, finger.tendons), np.zeros((len(bodies), 6)))
        wrench[bodies.index(row.body)] += [*row.force, *row.moment]
    torques: dict[str, list[Array]] = {}
    at = [float(state.removesuffix(" s")) for state in by_state]
    for k, (time, books) in enumerate(zip(at, by_state.values(), strict=True)):
        q = angles[int(np.abs(times - time).argmin())]
        jacobian = finger.jacobian(replace(start, angles=np.array(q)))
        for kind, wrench in books.items():
            curve = torques.setdefault(kind, [np.zeros(len(joints))] * len(at))
            curve[k] = 1e3 * jacobian.T @ wrench.ravel()
    curves = {kind: np.array(curve) for kind, curve in torques.items() if kind}
    largest = max((float(np.abs(curve).max()) for curve in curves.values()), default=0.0)
    for j, joint in enumerate(joints):
        shown = {k: c[:, j] for k, c in curves.items() if np.abs(c[:, j]).max() > 0.01 * largest}
        if shown:
            yield Chart(f"Torques about {joint}", "torque, N mm", np.array(at), shown)


def _kind(source: str, tendons: tuple[str, ...]) -> str:
    """What a chart of torques calls a source of the ledger; nothing of what makes none."""
    if source.startswith("hood "):
        return "hood"
    if source in tendons:
        return OWN
    return "" if source in ("joint", "ground") else source_words(source)


def _strain(view: View) -> Iterator[Chart]:
    """The mean strain along the fibres of some regions, by area."""
    sheet = view.sheet
    field = next((f for f in view.fields if f.key == STRAIN_FIELD), None)
    if sheet is None or field is None or len(sheet.at) < 2:
        return
    corners = sheet.points[0][sheet.quads]
    across = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    area, region = np.linalg.norm(np.cross(*across), axis=1), np.array(sheet.region)
    curves = {
        name.replace("_", " "): field.values[:, on] @ area[on] / area[on].sum()
        for name in OF_STRAIN
        if (on := region == name).any()
    }
    time = np.array(view.times)[list(sheet.at)]
    yield Chart("Strain of the hood", "mean along the fibres, %", time, curves)


def _dots(view: View) -> Iterator[Chart]:
    """How far the user's points are from where they were at the start."""
    if view.dots is not None and len(view.dots.names) <= MOST_DOTS:
        way = 1e3 * np.linalg.norm(view.dots.position - view.dots.position[0], axis=-1)
        curves = {n.replace("_", " "): y for n, y in zip(view.dots.names, way.T, strict=True)}
        title, axis = "Your points", "way from the start, mm"
        yield Chart(title, axis, np.array(view.times), curves)
