"""One case with hoods of growing detail, from a fixed split to a shell with fibres: the rungs of a
ladder, their tables and their picture."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.errors import InputError
from cosim.hoods.kind import HoodConfig
from cosim.hoods.kinds import rungs
from cosim.json_text import json_text
from cosim.models.fit import check_fit
from cosim.outcome import Outcome
from cosim.pipeline import plain_summary, run_each
from cosim.port import AXES
from cosim.report.templates import html_page
from cosim.results.compare import number
from cosim.results.conventions import vector_of
from cosim.results.looks import Look, look
from cosim.results.picture import new_picture, picture_address
from cosim.results.table import Cell, ReportTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

RUNGS = rungs()
"""From the coarsest to the finest, with the packaged case that states each hood."""
Status = Literal["converged", "failed", "does not apply"]


@dataclass(frozen=True)
class Rung:
    """What one hood says of the case."""

    name: str
    is_own: bool
    """Whether the hood is the one that the case states."""
    status: Status
    reason: str
    """Why there are no numbers; empty where there are."""
    wall: float
    """s, models and both equilibria."""
    summary: Mapping[str, Any]
    """The run's; empty where there are no numbers."""

    @property
    def slips(self) -> Mapping[str, float]:
        """N, central and terminal; empty of a hood without slips."""
        return self.summary.get("slip_force_N", {})

    @property
    def excursions(self) -> dict[str, float]:
        """mm, of the tendons that pull more when loaded, loaded less unloaded."""
        loaded, unloaded = self.summary, self.summary.get("unloaded", {})
        return {
            name: value - unloaded[key][name]
            for key in ("excursion_mm", "own_excursion_mm")
            for name, value in loaded.get(key, {}).items()
            if loaded["tension_N"][name] > unloaded["tension_N"][name]
        }


def solve_rungs(
    case: Case, workers: int, ended: Callable[[Rung], object] = lambda rung: None
) -> list[Rung]:
    """The rungs of a case, in so many processes (1: in this one); a hood that does not fit the case
    or has no equilibrium is one too, with the reason.  `ended` is called with each as it ends.

    Raises InputError for a case that is no equilibrium of a finger of ours."""
    _check(case)
    names = rungs_of(case)
    outcomes = run_each(
        [partial(case_on_rung, case, name) for name in names],
        plain_summary,
        workers,
        lambda _, i, outcome: ended(_rung(case, names[i], outcome)),
    )
    return [_rung(case, name, of) for name, of in zip(names, outcomes, strict=True)]


def _check(case: Case) -> None:
    if case.forward is not None:
        raise InputError(
            f"{case.name}: is a motion; a ladder compares equilibria. Leave out [forward]"
        )
    if not case.finger.is_native:
        raise InputError(f"{case.name}: its finger is an FMU; a ladder needs another kind")
    check_fit(case)


def rungs_of(case: Case) -> list[str]:
    """The ladder's, and before them the case's own where it is none of them."""
    rung = case.hood.rung()
    return [*RUNGS] if rung in RUNGS else [rung, *RUNGS]


def case_on_rung(case: Case, name: str) -> Case:
    """The case with the hood of a rung in place of its own, all else as it was."""
    if name == case.hood.rung():
        return case
    return case.model_copy(update={"hood": _hood(case, name)})


def _hood(case: Case, name: str) -> HoodConfig:
    stated = case.finger.shell_case
    laid: Any = None if stated is None else load_case(stated).hood
    hood: HoodConfig = load_case(RUNGS[name]).hood
    return hood.on_finger(case.finger.kind, laid)


def _rung(case: Case, name: str, outcome: Outcome[Any]) -> Rung:
    is_own, seconds = name == case.hood.rung(), outcome.seconds
    if outcome.error is not None:
        refused = outcome.status == "refused"
        status: Status = "does not apply" if refused else "failed"
        return Rung(name, is_own, status, outcome.reason, seconds, {})
    return Rung(name, is_own, "converged", "", seconds, outcome.result())


JOINTS = ("MCP", "PIP", "DIP")
EXTENSOR = "EDC"
"""Whose moment arms are shown."""
TOLD = {
    "tip force N": "Fingertip force",
    "central slip N": "Force in the central slip",
    "terminal slip N": "Force in the terminal slip",
}
"""The figures that a page begins with, in words."""
Figures = dict[str, float | None]


def figures(rung: Rung) -> Figures:
    """What is shown of a rung, by name and unit; None where its hood does not say."""
    force = rung.summary.get("fingertip_force_N", {})
    unloaded = rung.summary.get("unloaded", {})
    out: Figures = {f"tip force {axis} N": force.get(axis) for axis in AXES}
    out["tip force N"] = rung.summary.get("fingertip_magnitude_N")
    out["tip force at rest N"] = unloaded.get("fingertip_magnitude_N")
    change = rung.summary.get("difference", {})
    out["change of the tip force N"] = change.get("fingertip_magnitude_N")
    central, terminal = rung.slips.get("central"), rung.slips.get("terminal")
    out |= {"central slip N": central, "terminal slip N": terminal}
    out["terminal / central"] = terminal / central if terminal is not None and central else None
    out |= {f"excursion {name} from rest mm": value for name, value in rung.excursions.items()}
    arms = rung.summary.get("moment_arm_mm", {}).get(EXTENSOR, {})
    out |= {f"arm {EXTENSOR} {joint} mm": arms.get(joint) for joint in JOINTS}
    out["wall s"] = rung.wall
    return out


def heading(rung: Rung) -> str:
    """The rung's name over its column, with a star for the case's own."""
    name = rung.name.replace("_", " ")
    return f"{name} *" if rung.is_own else name


def spread(rungs: Sequence[Rung]) -> Iterator[str]:
    """A sentence for each of the first figures: from which hood to which it goes."""
    shown = [(rung, figures(rung)) for rung in rungs if rung.status == "converged"]
    for name, words in TOLD.items():
        known = [(value, rung.name) for rung, each in shown if (value := each[name]) is not None]
        if len(known) > 1:
            (low, least), (high, most) = min(known), max(known)
            yield f"{words}: {number(low, 3)} N ({least}) to {number(high, 3)} N ({most})."


def side_by_side(rungs: Sequence[Rung], title: str = "") -> ReportTable:
    """A row for each figure that any rung has, a column for each rung; last the audits."""
    by_rung = [figures(rung) for rung in rungs]
    rows: list[list[Cell]] = [
        [name, *(each.get(name) for each in by_rung)]
        for name in dict.fromkeys(name for each in by_rung for name in each)
        if any(each.get(name) is not None for each in by_rung)
    ]
    rows.append(["audits", *map(_audits, rungs)])
    return ReportTable("ladder", title, ["", *map(heading, rungs)], rows)


def _audits(rung: Rung) -> str:
    if rung.status != "converged":
        return rung.status
    missed = rung.summary["audit_missed"]
    return f"{len(missed)} missed" if missed else "kept"


def reasons(rungs: Sequence[Rung]) -> Iterator[str]:
    """What a reader must know beside the figures."""
    yield (
        "tip force on the world and slips: loaded; excursion: loaded less the same finger at rest, "
        "every tendon at its resting tension; *: the case's own hood"
    )
    for rung in rungs:
        if rung.reason:
            yield f"{rung.name}: {rung.status}: {rung.reason}"
        elif missed := rung.summary["audit_missed"]:
            yield f"{rung.name}: audits missed: {', '.join(missed)}"


def to_csv(rungs: Sequence[Rung]) -> str:
    """A row for each rung."""
    columns = [figures(rung) for rung in rungs]
    names = list(dict.fromkeys(name for each in columns for name in each))
    rows = [
        [r.name, r.is_own, r.status, r.reason, *map(each.get, names), _audits(r)]
        for r, each in zip(rungs, columns, strict=True)
    ]
    return ReportTable("", "", ["rung", "own", "status", "reason", *names, "audits"], rows).csv()


def to_json(rungs: Sequence[Rung]) -> str:
    """Everything, the runs' summaries too."""
    every = [{**asdict(r), "slips": dict(r.slips), "excursions": dict(r.excursions)} for r in rungs]
    return json_text(every, 2, ensure_ascii=True) + "\n"


def to_markdown(rungs: Sequence[Rung], title: str) -> str:
    """The table side by side, and what to know of it."""
    notes = "\n".join(f"- {text}" for text in reasons(rungs))
    return f"# {title}: ladder of hoods\n\n{side_by_side(rungs).markdown()}\n\n{notes}\n"


def to_html(rungs: Sequence[Rung], title: str) -> str:
    """A page that needs nothing else: what differs, picture, table and reasons."""
    return html_page(
        "ladder.html.j2",
        title=title,
        spread=list(spread(rungs)),
        reasons=list(reasons(rungs)),
        table=side_by_side(rungs, title),
        picture=picture_address(draw_ladder(rungs, title), DPI),
    )


DPI = 120
SLIPS = ("central slip N", "terminal slip N")
ARMS = tuple(f"arm {EXTENSOR} {joint} mm" for joint in JOINTS)


def draw_ladder(rungs: Sequence[Rung], title: str) -> Figure:
    """A chart of the rungs that have numbers; the case's own is marked by a star."""
    shown = [rung for rung in rungs if rung.status == "converged"]
    looks = {rung.name: look(i) for i, rung in enumerate(rungs)}
    figure = new_picture(13, 4.6)
    force, slips, arms = figure.subplots(1, 3)
    _vectors(force, shown, looks)
    _bars(slips, shown, looks, SLIPS, "force of the loaded slips, N")
    _bars(arms, shown, looks, ARMS, f"moment arm of {EXTENSOR}, mm")
    handles, labels = force.get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside right center")
    figure.suptitle(f"{title}: ladder of hoods (*: the case's own)", fontsize=11)
    return figure


def _vectors(axes: Axes, rungs: Sequence[Rung], looks: dict[str, Look]) -> None:
    """Distal to the right, dorsal up; a line from the force at rest to that under load."""
    for rung in rungs:
        states = (rung.summary["unloaded"], rung.summary)
        distal, _, dorsal = np.transpose([vector_of(s["fingertip_force_N"]) for s in states])
        axes.plot(distal, dorsal, lw=1.5, label=heading(rung), **looks[rung.name].line)
        axes.plot(distal[0], dorsal[0], "x", color=looks[rung.name].colour, ms=5)
        axes.plot(distal[1], dorsal[1], "o", color=looks[rung.name].colour, ms=5)
    axes.axhline(0, color="0.7", lw=0.8, zorder=0)
    axes.axvline(0, color="0.7", lw=0.8, zorder=0)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(title="tip force on the world (x: at rest)", xlabel="distal, N", ylabel="dorsal, N")
    axes.grid(alpha=0.3)


def _bars(
    axes: Axes, rungs: Sequence[Rung], looks: dict[str, Look], names: Sequence[str], title: str
) -> None:
    """A group for each name, a bar in it for each rung; none where a hood does not say."""
    width = 0.8 / max(len(rungs), 1)
    for i, rung in enumerate(rungs):
        values = [value if (value := figures(rung).get(n)) is not None else np.nan for n in names]
        place = np.arange(len(names)) + (i - (len(rungs) - 1) / 2) * width
        axes.bar(place, values, width, **looks[rung.name].bar)
    axes.axhline(0, color="0.7", lw=0.8)
    axes.set_xticks(range(len(names)), [n.rsplit(" ", 1)[0] for n in names])
    axes.set_title(title)
    axes.grid(axis="y", alpha=0.3)
