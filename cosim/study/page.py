"""The page of a study: one HTML file with everything in it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from cosim.report.templates import html_page
from cosim.results.compare import Target, number, reference_text
from cosim.results.picture import picture_address
from cosim.results.table import Cell, ReportTable
from cosim.study import plots as pictures
from cosim.study.answers import Band, Indices
from cosim.study.distributions import GridAxis, Law, Lognormal, Normal, TruncatedNormal, Uniform
from cosim.study.plan import StudyPlan
from cosim.study.results import StudyResults

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 110
MOST_RUNS = 12
"""Named of a failure's."""


def page(study: StudyResults, plan: StudyPlan, pictures_of_bands: Sequence[Figure] = ()) -> str:
    """The whole page; first the pictures of the bands, where there are any."""
    counts = study.table.status.value_counts().to_dict()
    return html_page(
        "page.html.j2",
        "cosim.study",
        study=study,
        plan=plan,
        runs=len(study.table),
        converged=counts.get("converged", 0),
        bands=[picture_address(figure, DPI) for figure in pictures_of_bands],
        waiting=counts.get("waiting", 0),
        audit=int(((study.table.status == "converged") & (study.table.reason != "")).sum()),
        failures=_failures(study),
        parameters=_parameters(plan),
        sampled=_sampling_text(plan),
        answers=[text for name in study.outputs if (text := _answer(study, name))],
        outputs=[_output(study, plan, name) for name in study.outputs],
    )


def _failures(study: StudyResults) -> ReportTable:
    rows = []
    for (status, reason), runs in study.failures.items():
        if status != "waiting":
            more = len(runs) - MOST_RUNS
            named = ", ".join(map(str, runs[:MOST_RUNS])) + (
                f" and {more} more" if more > 0 else ""
            )
            rows.append((len(runs), status, reason, named))
    return ReportTable("failures", "Failures", ("Runs", "Status", "Reason", "Which"), rows)


def _parameters(plan: StudyPlan) -> ReportTable:
    rows = []
    for p in plan.parameters:
        sets = [text.partition("=")[0] for text in p.settings]
        effects = (("sets", sets), ("scales", p.scale), ("shifts", p.shift))
        effect = "; ".join(f"{word} {', '.join(keys)}" for word, keys in effects if keys)
        code = Markup("<code>{}</code>").format(effect)
        rows.append((p.label, f"{_law(p.law)} {p.unit}".rstrip(), code))
    return ReportTable("parameters", "Parameters", ("Parameter", "Values", "In the case"), rows)


def _law(law: Law) -> str:
    match law:
        case Normal():
            return f"normal, {law.mean:g} ± {law.sd:g}"
        case Lognormal():
            return f"lognormal, {law.mean:g} ± {law.sd:g}"
        case TruncatedNormal():
            return f"normal, {law.mean:g} ± {law.sd:g}, cut at {law.low:g} and {law.high:g}"
        case Uniform():
            return f"uniform, {law.low:g} to {law.high:g}"
        case GridAxis():
            return _steps(law)


def _steps(law: GridAxis) -> str:
    shown = [f"{v:g}" if type(v) is float else str(v) for v in law.values]
    return ", ".join(shown) if len(shown) <= 8 else f"{len(shown)} from {shown[0]} to {shown[-1]}"


def _sampling_text(plan: StudyPlan) -> str:
    if plan.sampling is None:
        return "every combination of the values"
    s = plan.sampling
    if s.kind == "morris":
        return f"Morris' scheme, {s.n} trajectories, seed {s.seed}"
    names = {"saltelli": "Saltelli's scheme", "sobol": "Sobol's sequence", "random": "at random"}
    return f"{names.get(s.kind, 'Latin hypercube')}, {s.n} points, seed {s.seed}"


def _answer(study: StudyResults, name: str) -> str:
    """An output over the runs, and what it answers to most; nothing below two runs."""
    band = study.band(name)
    if band is None:
        return ""
    low, _, middle, _, high = map(number, band.quantiles)
    unit = "" if study.units[name] == "1" else f" {study.units[name]}"
    screened = study.screening(name) is not None
    known = screened or study.sobol(name) is not None or study.slopes(name) is not None
    most = [study.label(p) for p in pictures.strongest(study, name)[:2]] if known else []
    why = f"; it answers most to {' and '.join(most)}" if most else ""
    if screened:  # levels, whose spread is not that of the distributions
        return f"{study.label(name)}: {low} to {high}{unit} in 95 % of the runs at levels{why}."
    return f"{study.label(name)}: {middle}{unit} in the median, {low} to {high} in 95 %{why}."


def _output(study: StudyResults, plan: StudyPlan, name: str) -> dict[str, Any]:
    of_case = [t for t in plan.targets if t.case in ("", plan.case.stem)]
    targets = [t for t in of_case if t.quantity == plan.outputs[name]]
    band, indices, surface = study.band(name), study.indices(name), study.surface(name)
    pairs = study.pairs(name)
    no_indices = indices if isinstance(indices, str) and _wants(plan, "saltelli") else ""
    not_screened = study.why_not_screened(name) if _wants(plan, "morris") else ""
    figures: dict[str, Figure | None] = {
        "band": None, "screening": None, "influence": None, "scatter": None
    }  # fmt: skip
    if band is not None:
        figures["band"] = pictures.draw_band(study, name, targets)
        figures["screening"] = pictures.draw_screening(study, name)
        figures["influence"] = pictures.draw_influence(study, name)
        figures["scatter"] = pictures.draw_scatter(study, name)
    drawn = None if surface is None else pictures.draw_surface(study, name, surface)
    label, unit = study.label(name), "" if study.units[name] == "1" else study.units[name]

    def table(kind: str, columns: str, rows: Sequence[Sequence[Cell]]) -> ReportTable:
        return ReportTable(f"{kind}-{name}", f"{label}: {kind}", columns.split("|"), rows, 3)

    by_unit = f", {unit}" if unit else ""
    return {
        "name": name,
        "label": label,
        "path": plan.outputs[name],
        "unit": unit,
        "band": band,
        "too_few": study.too_few(name),
        "numbers": {} if band is None else _numbers(band) | _roughness(study, name),
        "targets": table(
            "beside", "Beside|Reference|The runs|Kind|Source", [_target(t, band) for t in targets]
        ),
        "why_not": no_indices or not_screened,
        "screening": table(
            "screening",
            f"Parameter|Mean effect μ{by_unit}|Mean size μ*|SD σ",
            _screening_rows(study, name),
        ),
        "indices": table(
            "indices",
            "Parameter|First order|Total",
            _index_rows(study, indices) if isinstance(indices, Indices) else [],
        ),
        "slopes": study.slopes(name),
        "surface": surface,
        "pairs": table(
            "pairs",
            f"Pair|{label}{by_unit}",
            [(" × ".join(map(study.label, p)), x) for p, x in pairs.items()],
        ),
        "pictures": {
            key: picture_address(f, DPI) for key, f in {**figures, "surface": drawn}.items()
        },
    }


def _wants(plan: StudyPlan, kind: str) -> bool:
    """Whether the sampling is of the kind."""
    return plan.sampling is not None and plan.sampling.kind == kind


def _numbers(band: Band) -> dict[str, str]:
    low, quarter, middle, upper, high = band.quantiles
    return {
        "mean ± SD": f"{number(band.mean)} ± {number(band.sd, 3)}",
        "median": number(middle),
        "middle 50 %": f"{number(quarter)} to {number(upper)}",
        "middle 95 %": f"{number(low)} to {number(high)}",
        "runs": str(band.runs),
    }


def _roughness(study: StudyResults, name: str) -> dict[str, str]:
    found = study.roughness(name)
    if found is None or not found.rms >= 0:
        return {}
    return {f"rms beyond a cubic over {study.label(study.numeric[0])}": number(found.rms, 2)}


def _target(target: Target, band: Band | None) -> tuple[str, ...]:
    """A measured number, and how the band lies to it."""
    ends = _ends(target)
    where = "no runs"
    if band is not None:
        low, high = band.quantiles[0], band.quantiles[-1]
        apart = ends[1] < low or ends[0] > high
        inside = ends[0] <= band.quantiles[2] <= ends[1]
        where = "median inside" if inside else "apart" if apart else "overlaps, median outside"
    return target.name, reference_text(target), where, target.kind, target.source


def _ends(target: Target) -> tuple[float, float]:
    """The ends of one SD about the mean where there is one, else of the band."""
    if target.reference is not None:
        sd = target.sd or 0.0
        return target.reference - sd, target.reference + sd
    low = -float("inf") if target.low is None else target.low
    return low, float("inf") if target.high is None else target.high


def _index_rows(study: StudyResults, indices: Indices) -> list[tuple[str, str, str]]:
    order = [
        study.parameters.index(n)
        for n in sorted(study.parameters, key=lambda n: -indices.total[study.parameters.index(n)])
    ]
    return [
        (
            study.label(study.parameters[i]),
            f"{indices.first[i]:.3f} ± {indices.first_conf[i]:.3f}",
            f"{indices.total[i]:.3f} ± {indices.total_conf[i]:.3f}",
        )
        for i in order
    ]


def _screening_rows(study: StudyResults, name: str) -> list[tuple[Cell, ...]]:
    found = study.screening(name)
    if found is None:
        return []
    return [
        (
            study.label(study.parameters[i]),
            float(found.mu[i]),
            f"{number(float(found.mu_star[i]), 3)} ± {number(float(found.mu_star_conf[i]), 2)}",
            f"{number(float(found.sigma[i]), 3)} ± {number(float(found.sigma_conf[i]), 2)}",
        )
        for i in sorted(range(len(found.mu)), key=lambda i: -found.mu_star[i])
    ]
