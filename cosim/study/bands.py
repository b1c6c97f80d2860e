"""Bands of uncertainty: percentiles of a case's first numbers over the samples of a study, beside
the case as it is; over a key of the case, at each of its values; of a motion over its time, too."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.files import output_file
from cosim.port import Array
from cosim.results.compare import unit_of, value_of
from cosim.results.history_plot import slip_histories
from cosim.results.picture import new_picture
from cosim.results.quantities import first_numbers, meaning_of
from cosim.study.distributions import is_axis
from cosim.study.execute import StudyOutcome
from cosim.study.plan import Point, StudyPlan
from cosim.study.store import Store

if TYPE_CHECKING:
    import pandas as pd
    import xarray
    from matplotlib.figure import Figure

PERCENTILES = (5, 50, 95)
MIDDLE = 0.9
"""Between the first and the last of them."""
ENDS = [f"p{p}" for p in PERCENTILES]
MOST_LACKING = 4
"""Inputs left out that are named."""
MOST_CURVES = 6
"""The most curves: first numbers that are drawn over a key."""
MANY = 40
"""Places on a curve, beyond which the case as it is has no marks."""
GREY, BLUE = "0.75", "#0072b2"


def cost_of(plan: StudyPlan) -> str:
    """How many runs a study is, before they start."""
    total = len(plan.as_it_is) + plan.count
    sampled = sum(not is_axis(p.law) for p in plan.parameters)
    text = f"{total} runs of {plan.case.stem}"
    if plan.bands and plan.sampling is not None:
        at = len(plan.as_it_is)
        each = f", at {at} values of {plan.parameters[0].label}" if at > 1 else ""
        text += f": as it is and at {plan.sampling.n} samples of {sampled} inputs{each}"
    if plan.lacking:
        more = len(plan.lacking) - MOST_LACKING
        named = "; ".join(plan.lacking[:MOST_LACKING]) + (f" and {more} more" if more > 0 else "")
        text += f"\n{len(plan.lacking)} left out, of which the case has nothing: {named}"
    return text


def bands_of(plan: StudyPlan, done: StudyOutcome, store: Store) -> pd.DataFrame:
    """Columns quantity, meaning, unit, the axes' names, as_it_is, p5, p50, p95, runs: a row for
    each of the first numbers and the study's outputs at each value of the axes.  `runs`: samples
    that have the number; of fewer than two there are no percentiles."""
    import pandas as pd

    kept = {row.key: row.summary for row in store.rows(set(done.keys.values())) if row.summary}
    summaries = {point: kept[key] for point, key in done.keys.items() if key in kept}
    numbers = _numbers(plan, summaries)
    names, samples = _by_place(plan, summaries)
    records = []
    for path, meaning in numbers.items():
        for place, (nominal, points) in samples.items():
            each = [value_of(summaries[point], path) for point in points]
            values = [v for v in each if v is not None]
            own = value_of(summaries.get(nominal, {}), path)
            own = np.nan if own is None else own
            records.append((path, meaning, unit_of(path), *place, own, *_ends(values)))
    columns = ["quantity", "meaning", "unit", *names, "as_it_is", *ENDS, "runs"]
    return pd.DataFrame.from_records(records, columns=columns)


def bands_over_time(plan: StudyPlan, done: StudyOutcome, store: Store) -> pd.DataFrame:
    """The same of a motion's histories, with a column time_s after the axes' names: a row for each
    of its first numbers that has one (`histories`) at each time of the case as it is; others' times
    are gone between by straight lines.  Without rows where no run has a history."""
    import pandas as pd
    import xarray

    kept: dict[Point, tuple[Array, dict[str, Array]]] = {}
    for point, key in done.keys.items():
        if (file := store.arrays(key)).is_file():
            with xarray.open_dataset(file, engine="h5netcdf") as data:
                if "time" in data.dims:
                    kept[point] = data.time.values, histories(data)
    names, samples = _by_place(plan, kept)
    parts = []
    for place, (nominal, points) in samples.items():
        time, own = kept.get(nominal, (np.zeros(0), {}))
        for path, values in own.items():
            each = [
                np.interp(time, kept[p][0], kept[p][1][path]) for p in points if path in kept[p][1]
            ]
            rows = [_ends(at) for at in np.array(each).reshape(-1, len(time)).T]
            part = pd.DataFrame(rows, columns=[*ENDS, "runs"])
            fixed = {"quantity": path, "meaning": meaning_of(path, {}), "unit": unit_of(path)}
            part = part.assign(**fixed, **dict(zip(names, place, strict=True)))
            parts.append(part.assign(time_s=time, as_it_is=values))
    columns = ["quantity", "meaning", "unit", *names, "time_s", "as_it_is", *ENDS, "runs"]
    return pd.concat(parts)[columns] if parts else pd.DataFrame(columns=columns)


def histories(data: xarray.Dataset) -> dict[str, Array]:
    """What of a motion's first numbers its arrays HISTORIES have at every time, (nt,), by the path
    in its summary."""
    out: dict[str, Array] = {}
    force = data.tip_force.transpose("time", "axis").values
    if force.any():
        out = {f"fingertip_force_N.{a}": f for a, f in zip(data.axis.values, force.T, strict=True)}
        out["fingertip_magnitude_N"] = np.linalg.norm(force, axis=1)
    for words, values in slip_histories(data).items():
        out[f"slip_force_N.{words.partition(' ')[0]}"] = values
    for joint in data.joint.values:
        out[f"posture_deg.{joint}"] = np.degrees(data.angle.sel(joint=joint).values)
    return out


def _by_place(
    plan: StudyPlan, there: Collection[Point]
) -> tuple[list[str], dict[Point, tuple[Point, list[Point]]]]:
    """The axes' names, and by their values the point of the case as it is and the samples that
    are `there`."""
    names = [p.name for p in plan.axes]
    axes = [i for i, p in enumerate(plan.parameters) if p.name in names]
    out: dict[Point, tuple[Point, list[Point]]] = {
        tuple(nominal[i] for i in axes): (nominal, []) for nominal in plan.as_it_is
    }
    for point in plan.points:
        if point in there:
            out[tuple(point[i] for i in axes)][1].append(point)
    return names, out


def _ends(values: Sequence[float] | Array) -> tuple[float, ...]:
    """The percentiles, and of how many; none of fewer than two."""
    few = len(values) < 2
    ends = [np.nan] * 3 if few else np.percentile(values, PERCENTILES).tolist()
    return (*ends, len(values))


def _numbers(plan: StudyPlan, summaries: Mapping[Point, Mapping[str, Any]]) -> dict[str, str]:
    """Meaning by path of the numbers that have bands, by the case as it is or else by a sample.
    Raises InputError where no run has ended."""
    first = next((summaries[p] for p in (*plan.as_it_is, *summaries) if p in summaries), None)
    if first is None:
        raise InputError(
            f"{plan.name}: no run of {plan.case.stem} has a result, so there is no band"
        )
    rest = load_case(plan.case, plan.settings).solve.resting_tension
    numbers = {path: label for label, path in first_numbers(first, rest)}
    for name, path in plan.outputs.items():
        if value_of(first, path) is not None:
            numbers.setdefault(path, meaning_of(path, first) or name.replace("_", " "))
    return numbers


def write_bands(
    plan: StudyPlan, bands: pd.DataFrame, over_time: pd.DataFrame, folder: Path
) -> list[Figure]:
    """bands.csv and .png; of a motion bands_over_time.csv and, without axes, .png; the figures.
    Raises InputError where they cannot be written."""
    tables, figures = {"bands": bands}, {"bands": draw_bands(plan, bands)}
    if len(over_time):
        tables["bands_over_time"] = over_time
        if len(plan.as_it_is) == 1:
            figures["bands_over_time"] = _draw_curves(over_time, "time_s", "time, s")
    for name, table in tables.items():
        with output_file(folder / f"{name}.csv") as part:
            table.to_csv(part, index=False, lineterminator="\n")
    for name, figure in figures.items():
        with output_file(folder / f"{name}.png") as part:
            figure.savefig(part, format="png", dpi=110)
    return [*figures.values()]


def draw_bands(plan: StudyPlan, bands: pd.DataFrame) -> Figure:
    """The middle 90 % of the first numbers, with median and the case as it is: bars in panels by
    unit, or curves over the one axis of numbers."""
    axes = plan.axes
    if len(axes) == 1 and axes[0].law.is_numeric:  # type: ignore[union-attr]
        return _draw_curves(bands, axes[0].name, f"{axes[0].label}, {axes[0].unit}".rstrip(", "))
    return _draw_bars(bands)


def _draw_bars(bands: pd.DataFrame) -> Figure:
    units = [unit for _, unit in bands.groupby("unit", sort=False)]
    tall = [len(unit) + 1.6 for unit in units]
    figure = new_picture(9.5, 0.5 + 0.26 * sum(tall))
    panels = figure.subplots(len(units), 1, squeeze=False, height_ratios=tall)[:, 0]
    for axes, rows in zip(panels, units, strict=True):
        at = np.arange(len(rows))
        axes.barh(at, rows.p95 - rows.p5, 0.6, left=rows.p5, color=GREY, label="5 to 95 %")
        axes.scatter(rows.p50, at, marker="|", s=130, color="black", label="median", zorder=3)
        axes.scatter(rows.as_it_is, at, marker="D", s=22, color=BLUE, label="as it is", zorder=4)
        axes.set_yticks(at, rows.meaning, fontsize=8)
        axes.set_ylim(len(rows) - 0.4, -0.6)
        axes.use_sticky_edges = False
        axes.set_xlabel(rows.unit.iloc[0].replace("1", "no unit"), loc="right", labelpad=1)
        axes.grid(axis="x", alpha=0.3)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper right", ncols=3)
    return figure


def _draw_curves(bands: pd.DataFrame, key: str, label: str) -> Figure:
    numbers = [rows for _, rows in bands.groupby("quantity", sort=False)][:MOST_CURVES]
    high = (len(numbers) + 1) // 2
    figure = new_picture(9.5, 0.6 + 2.6 * high)
    panels = figure.subplots(high, 2, sharex=True, squeeze=False)
    for axes, rows in zip(panels.flat, numbers, strict=False):
        ordered = rows.sort_values(key)
        place = ordered[key]
        axes.fill_between(place, ordered.p5, ordered.p95, color=GREY, label="5 to 95 %", lw=0)
        axes.plot(place, ordered.p50, color="black", lw=1.2, label="median")
        marks = "D--" if len(place) <= MANY else "--"
        axes.plot(place, ordered.as_it_is, marks, color=BLUE, ms=4, label="as it is")
        axes.set_title(f"{rows.meaning.iloc[0]}, {rows.unit.iloc[0]}", fontsize=9)
        axes.grid(alpha=0.3)
    for axes in panels.flat[len(numbers) :]:
        axes.set_axis_off()
    for axes in panels[-1]:
        axes.set_xlabel(label)
    figure.legend(*panels.flat[0].get_legend_handles_labels(), loc="outside upper right", ncols=3)
    return figure
