"""The summary of a run as short tables for the terminal; what a run does not have is left out."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rich.table import Table

from cosim.port import AXES
from cosim.results.compare import numbers_of, unit_of, value_of
from cosim.results.load_and_rest import describe_rest
from cosim.results.quantities import key_quantities, meaning_of
from cosim.results.table import ReportTable

LEAST_MOMENT = 1e-6
"""N mm, below which the fingertip carries none."""
COUNTS = ("steps", "hood_solves")
"""What a summary counts that is no iteration."""
ELSEWHERE = ("strain_percent", "energy_mJ")
"""Quantities that have rows of another form."""
MOST_DOTS = 8
"""Points, and gauges, that are shown: of more, as of a grid, the page and the files have them."""
Row = tuple[str, ...]


def tables(
    summary: Mapping[str, Any], mesh_errors: Mapping[str, float] | None = None
) -> list[Table]:
    """`rows_of` for the terminal."""
    return [ReportTable("", "", *block).in_terminal() for block in rows_of(summary, mesh_errors)]


def rows_of(
    summary: Mapping[str, Any], mesh_errors: Mapping[str, float] | None = None
) -> list[tuple[Row, list[Row]]]:
    """Header and rows of the tables: the states side by side, the tendons, the user's gauges and
    points on the hood, and the checks; with how far loaded numbers may be off by their mesh, by
    path, beside them."""
    state = ("", "loaded", "mesh error", "at rest")
    arms = [f"arm {joint.replace('_', ' ')} mm" for joint in _joints(summary)]
    tendon = ("tendon", "tension N", "excursion mm", *arms)
    blocks = [
        (state, [row for row in _states(summary, mesh_errors or {}) if any(row[1:])]),
        (tendon, [row for row in _tendons(summary) if any(row[1:])]),
        (("on the hood", "loaded", "at rest", "difference"), list(_dots(summary))),
        (("", ""), [row for row in _checks(summary) if row[1]]),
    ]
    return [_drop_empty_columns(header, rows) for header, rows in blocks if rows]


def batch_table(names: Sequence[str], summaries: Mapping[str, Mapping[str, Any] | None]) -> Table:
    """A row for each case of a batch: fingertip force, slips, time and how it ended.  A run that
    failed has no summary; one that the batch did not come to is not in `summaries`."""
    slips = ("central slip", "terminal slip")
    header = ("forces in N", "fingertip", *AXES, *slips, "time s", "ended")
    rows: list[Row] = []
    for name in names:
        summary = summaries.get(name)
        numbers = (
            _at(summary, "fingertip_magnitude_N"),
            *(_at(summary, "fingertip_force_N", axis) for axis in AXES),
            *(_at(summary, "slip_force_N", slip) for slip in ("central", "terminal")),
            _at(summary, "wall_s"),
        )
        ending = "not begun" if name not in summaries else _outcome_text(summary)
        rows.append((name, *(_number(value, 3) for value in numbers), ending))
    return ReportTable("", "", *_drop_empty_columns(header, rows)).in_terminal()


def _outcome_text(summary: Mapping[str, Any] | None) -> str:
    if summary is None:
        return "failed or stopped"
    missed = ", ".join(name.replace("_", " ") for name in summary.get("audit_missed", ()))
    done = "done, with a warning" if summary.get("warnings") else "done"
    return f"AUDIT MISSED: {missed}" if missed else done


def _drop_empty_columns(header: Row, rows: Sequence[Row]) -> tuple[Row, list[Row]]:
    """Without the columns that no row fills."""
    kept = [i for i in range(len(header)) if any(row[i] for row in rows)]
    return tuple(header[i] for i in kept), [tuple(row[i] for i in kept) for row in rows]


def _at(values: Any, *keys: str) -> Any:
    for key in keys:
        if isinstance(values, Mapping):
            values = values.get(key)
        else:
            return None
    return values


def _number(value: Any, digits: int = 4) -> str:
    return "" if value is None else f"{value + 0.0:.{digits}g}"  # no minus zero


def _states(summary: Mapping[str, Any], errors: Mapping[str, float]) -> Iterator[Row]:
    for label, path in key_quantities(summary):
        if path.split(".")[0] not in ELSEWHERE:
            loaded, rest = (_number(value_of(summary, at + path)) for at in ("", "unloaded."))
            error = f"± {errors[path]:.2g}" if path in errors else ""
            yield (f"{label}, {unit_of(path)}", loaded, error, rest)


def _dots(summary: Mapping[str, Any]) -> Iterator[Row]:
    """The user's gauges, then the points: how far each has moved, and its strain."""
    gauges = [path for path in numbers_of(summary) if path.startswith("gauge_strain_percent.")]
    points = list(_at(summary, "point_displacement_mm") or {})
    for path in gauges[:MOST_DOTS]:
        yield f"{meaning_of(path, summary)}, %".replace("_", " "), *_three(summary, path)
    for name in points[: MOST_DOTS if len(points) <= MOST_DOTS else 0]:
        moved = f"point_displacement_mm.{name}"
        yield f"displacement of {name.replace('_', ' ')}, mm", *_three(summary, moved, norm=True)
        for part in ("longitudinal", "lateral"):
            path = f"point_strain_percent.{name}.{part}"
            yield f"{meaning_of(path, summary)}, %".replace("_", " "), *_three(summary, path)
    if more := max(len(gauges) - MOST_DOTS, 0) + (len(points) if len(points) > MOST_DOTS else 0):
        yield f"and {more} gauges and points more, in summary.json", "", "", ""


def _three(summary: Mapping[str, Any], path: str, norm: bool = False) -> tuple[str, str, str]:
    """A number, or the length of a vector, loaded, at rest and the difference."""
    places = ("", "unloaded.", "difference.")
    if not norm:
        loaded, rest, change = (_number(value_of(summary, at + path)) for at in places)
        return loaded, rest, change
    vectors = ([value_of(summary, f"{at}{path}.{axis}") for axis in AXES] for at in places)
    loaded, rest, change = (
        "" if None in v else _number(math.hypot(*(x for x in v if x is not None))) for v in vectors
    )
    return loaded, rest, change


def _joints(summary: Mapping[str, Any]) -> tuple[str, ...]:
    arms = (_at(summary, "moment_arm_mm") or {}).values()
    return tuple(dict.fromkeys(joint for arm in arms for joint in arm))


def _tendons(summary: Mapping[str, Any]) -> Iterator[Row]:
    columns = [_at(summary, key) or {} for key in ("tension_N", "excursion_mm", "moment_arm_mm")]
    for name in dict.fromkeys(name for column in columns for name in column):
        arms = [_number(_at(columns[2], name, joint)) for joint in _joints(summary)]
        yield (name, _number(columns[0].get(name)), _number(columns[1].get(name)), *arms)


def _checks(summary: Mapping[str, Any]) -> Iterator[Row]:
    for direction, strain in (_at(summary, "strain_percent") or {}).items():
        low, mean, high = (strain.get(key) for key in ("p5", "mean", "p95"))
        words = f"{_number(low)} to {_number(high)}, mean {_number(mean)}"
        yield f"{direction} strain %, 5th to 95th percentile", words if low is not None else ""
    if (device := _at(summary, "fingertip_device")) is not None:
        rest = {True: ", came to rest", False: ", still moving at the end"}
        yield "fingertip device", device + rest.get(_at(summary, "came_to_rest"), "")
    moment = _at(summary, "fingertip_moment_Nmm") or {}
    if any(abs(value) > LEAST_MOMENT for value in moment.values()):
        parts = (f"{axis} {_number(value)}" for axis, value in moment.items())
        yield "fingertip moment N mm", ", ".join(parts)
    yield from describe_rest(summary)
    for name, muscle in (_at(summary, "muscle") or {}).items():
        loaded, then = (
            _number(_at(muscle, key))
            for key in ("normalised_fibre_length", "assumed_normalised_fibre_length_unloaded")
        )
        yield f"fibre length of {name} over its optimum", f"{loaded}, assumed {then} when unloaded"
    for name, air in (_at(summary, "air") or {}).items():
        volts, pressure = (_number(_at(air, key)) for key in ("command_V", "pressure_kPa"))
        yield f"cylinder of {name} at the end", f"{volts} V, {pressure} kPa above the atmosphere"
    for name, energy in (_at(summary, "energy_mJ") or {}).items():
        yield f"energy: {name.replace('_', ' ')} mJ", _number(energy)
    yield "deepest penetration mm", _number(_at(summary, "max_penetration_mm"))
    yield "deepest compression of the layer mm", _number(_at(summary, "max_compression_mm"))
    yield "its largest share of the thickness", _number(_at(summary, "layer_used_up"))
    yield "tendons' lines under the bone mm", _number(_at(summary, "guide_depth_mm"))
    yield "ways in which the hood is unstable", _number(_at(summary, "hood_unstable_modes"))
    for name, value in (_at(summary, "audit") or {}).items():
        yield f"audit: {name.replace('_', ' ')}", f"{value:.1e}"
    for name, reason in (_at(summary, "audit_not_judged") or {}).items():
        yield f"audit: {name.replace('_', ' ')}", f"not judged: {reason}"
    for name, count in (_at(summary, "iterations") or {}).items():
        word = name.replace("_", " ")
        yield word if name in COUNTS else f"{word} iterations", _number(count)
    yield "interface residual left open", _number(_at(summary, "one_way", "interface_residual"))
    yield "counted twice", ", ".join(_at(summary, "double_counted") or ())
    if (missed := _at(summary, "audit_missed")) is not None:
        yield "AUDIT MISSED" if missed else "audit missed", ", ".join(missed) or "none"
    yield "quads", _number(_at(summary, "hood_quads"))
    yield "line cells", _number(_at(summary, "hood_cells"))
    yield "wall time s", _number(_at(summary, "wall_s"))
