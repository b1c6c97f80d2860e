"""What a study leaves beside its table: answers as JSON and CSV, and the page.

The table of a study: a row for each run, in the study's order, independent of the clock, the
machine and the number of workers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim.files import output_file, relative_path, write_text
from cosim.json_text import json_text
from cosim.results.compare import unit_of, value_of
from cosim.schema.json_schema import STUDY_SCHEMA, with_schema
from cosim.study.answers import CONFIDENCE, QUANTILES, Indices, Screening
from cosim.study.bands import bands_of, bands_over_time, write_bands
from cosim.study.execute import StudyOutcome
from cosim.study.plan import StudyPlan
from cosim.study.results import FORMAT, MARK, StudyResults, finite, read_study
from cosim.study.store import Store

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


def write_study(plan: StudyPlan, done: StudyOutcome, store: Store, folder: Path) -> StudyResults:
    """Table, answers, bands and page in the folder.  Raises InputError where it cannot be
    written."""
    pictures: list[Figure] = []
    if plan.bands:
        bands = bands_of(plan, done, store)
        there = {*bands.quantity}
        plan = replace(plan, outputs={n: path for n, path in plan.outputs.items() if path in there})
        over_time = bands_over_time(plan, done, store)
        pictures = write_bands(plan, bands, over_time, folder)
    write_table(table_of(plan, done, store), folder)
    _write(folder / "study.toml", with_schema(plan.text, f"../{STUDY_SCHEMA}"))
    _write(folder / MARK, _json(facts_of(plan, store, folder)))
    study = read_study(folder)
    _write(folder / "answers.json", _json(answers_of(study)))
    _write(folder / "indices.csv", "\n".join(_index_lines(study)) + "\n")
    if plan.sampling is not None and plan.sampling.kind == "morris":
        _write(folder / "screening.csv", "\n".join(_screening_lines(study)) + "\n")
    from cosim.study.page import page

    _write(folder / "index.html", page(study, plan, pictures))
    return study


def facts_of(plan: StudyPlan, store: Store, folder: Path) -> dict[str, Any]:
    """What `StudyResults` reads."""
    s = plan.sampling
    return {
        "format": FORMAT,
        "name": plan.name,
        "title": plan.title,
        "case": str(plan.case.stem),
        "settings": list(plan.settings),
        "parameters": {p.name: p.label for p in plan.parameters},
        "outputs": dict(plan.outputs),
        "units": units_of(plan),
        "sampling": None if s is None else s.model_dump(),
        "store": relative_path(store.root, folder),
    }


def answers_of(study: StudyResults) -> dict[str, Any]:
    """The answers of every output, for machines: what `answers.json` holds."""
    return {
        "quantiles": list(QUANTILES),
        "confidence": CONFIDENCE,
        "failures": [
            {"status": status, "reason": reason, "runs": runs}
            for (status, reason), runs in study.failures.items()
        ],
        "outputs": {name: _answers(study, name) for name in study.outputs},
    }


def _answers(study: StudyResults, output: str) -> dict[str, Any]:
    band, indices, rough = study.band(output), study.indices(output), study.roughness(output)
    slopes, surface, effects = study.slopes(output), study.surface(output), study.screening(output)
    return {
        "unit": study.units[output],
        "band": None if band is None else band._asdict(),
        "too_few": study.too_few(output),
        "roughness": None if rough is None else rough.rms,
        "sobol": indices if isinstance(indices, str) else _by_parameter(study, indices),
        "morris": study.why_not_screened(output)
        if effects is None
        else _by_parameter(study, effects),
        "slopes": None
        if slopes is None
        else {
            "r2": slopes.r2,
            "rms": slopes.rms,
            "slope": dict(zip(study.numeric, finite(slopes.slope), strict=True)),
        },
        "surface": None
        if surface is None
        else {
            "r2": surface.r2,
            "r2_held_out": surface.held_out,
            "rms": surface.rms,
            "runs": surface.runs,
            "pairs": {" x ".join(pair): change for pair, change in study.pairs(output).items()},
        },
    }


def _by_parameter(study: StudyResults, found: Indices | Screening) -> dict[str, Any]:
    """Arrays as numbers by parameter, counts as they are."""
    counts = ("blocks", "trajectories", "planned")
    return {
        name: values if name in counts else dict(zip(study.parameters, finite(values), strict=True))
        for name, values in asdict(found).items()
        if name != "second"
    }


def _index_lines(study: StudyResults) -> Iterator[str]:
    """What there is not is empty."""
    yield "output,parameter,slope,first,first_conf,total,total_conf"
    for output in study.outputs:
        indices, slopes = study.sobol(output), study.slopes(output)
        each = {} if slopes is None else dict(zip(study.numeric, slopes.slope, strict=True))
        for i, name in enumerate(study.parameters):
            parts = [""] * 4
            if indices is not None:
                four = (indices.first, indices.first_conf, indices.total, indices.total_conf)
                parts = [repr(float(column[i])) for column in four]
            slope = repr(float(each[name])) if name in each else ""
            yield ",".join([output, name, slope, *parts])


def _screening_lines(study: StudyResults) -> Iterator[str]:
    """Morris' measures, in the outputs' units."""
    yield "output,parameter,mu,mu_star,mu_star_conf,sigma,sigma_conf"
    for output in study.outputs:
        found = study.screening(output)
        if found is None:
            continue
        columns = (found.mu, found.mu_star, found.mu_star_conf, found.sigma, found.sigma_conf)
        for i, name in enumerate(study.parameters):
            yield ",".join([output, name, *(repr(float(column[i])) for column in columns)])


def _json(content: Any) -> str:
    return json_text(content) + "\n"


def _write(path: Path, text: str) -> None:
    write_text(path, text)


STATUS = ("status", "reason")
KEY = "key"


def table_of(plan: StudyPlan, done: StudyOutcome, store: Store) -> pd.DataFrame:
    """Columns: run, the parameters, status and reason, the outputs, the address in the store.
    Runs that were not done are "waiting".  Of a parameter that is now a number and now a word every
    value is text."""
    import pandas as pd

    stored = {
        row.key: (
            row.status,
            row.reason,
            *[value_of(row.summary, quantity) for quantity in plan.outputs.values()],
        )
        for row in store.rows(set(done.keys.values()))
    }
    absent = (None,) * len(plan.outputs)
    records = []
    for run, point in enumerate(plan.points):
        key = done.keys.get(point, "")
        if point in done.refused:
            cells: tuple[Any, ...] = ("refused", done.refused[point], *absent)
        else:
            cells = stored.get(key, ("waiting", "", *absent))
        records.append((run, *point, *cells, key))
    names = [p.name for p in plan.parameters]
    columns = ["run", *names, *STATUS, *plan.outputs, KEY]
    table = pd.DataFrame.from_records(records, columns=columns)
    for name in names:
        if table[name].map(type).nunique() > 1:
            table[name] = table[name].map(str)
    return table.astype(dict.fromkeys(plan.outputs, float))


def units_of(plan: StudyPlan) -> dict[str, str]:
    """The unit of each parameter and output, by name; "1" of a factor, a plain number or a word."""
    return {p.name: p.unit or "1" for p in plan.parameters} | {
        name: unit_of(quantity) for name, quantity in plan.outputs.items()
    }


def write_table(table: pd.DataFrame, folder: Path) -> None:
    """table.parquet and table.csv, numbers in full.  Raises InputError."""
    with output_file(folder / "table.parquet") as part:
        table.to_parquet(part, index=False)
    with output_file(folder / "table.csv") as part:
        table.to_csv(part, index=False, lineterminator="\n")
