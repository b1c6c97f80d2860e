"""The rungs of a ladder as tables: side by side for people, a row for each rung for programs."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict

from cosim.analyses.ladder import Rung
from cosim.results.compare import COMPONENTS, number
from cosim.results.write import plain

JOINTS = ("MCP", "PIP", "DIP")
EXTENSOR = "EDC"
"""Whose moment arms are shown."""
Figures = dict[str, float | None]


def figures(rung: Rung) -> Figures:
    """What is shown of a rung, by name and unit; None where its hood does not say."""
    force = rung.summary.get("fingertip_force_N", [None] * 3)
    unloaded = rung.summary.get("unloaded", {})
    out: Figures = {
        f"tip force {axis} N": value for axis, value in zip(COMPONENTS, force, strict=True)
    }
    out["tip force N"] = rung.summary.get("fingertip_magnitude_N")
    out["tip force at rest N"] = unloaded.get("fingertip_magnitude_N")
    change = rung.summary.get("difference", {})
    out["change of the tip force N"] = change.get("fingertip_magnitude_N")
    central, terminal = rung.slips.get("central"), rung.slips.get("terminal")
    out |= {"central slip N": central, "terminal slip N": terminal}
    out["terminal / central"] = terminal / central if terminal is not None and central else None
    out |= {f"excursion {name} mm": value for name, value in rung.excursions.items()}
    arms = rung.summary.get("moment_arm_mm", {}).get(EXTENSOR, {})
    out |= {f"arm {EXTENSOR} {joint} mm": arms.get(joint) for joint in JOINTS}
    out["wall s"] = rung.wall
    return out


def heading(rung: Rung) -> str:
    return f"{rung.name} *" if rung.is_own else rung.name


def side_by_side(rungs: Sequence[Rung]) -> list[tuple[str, ...]]:
    """A row for each figure that any rung has, a column for each rung; last the audits."""
    found = [figures(rung) for rung in rungs]
    names = dict.fromkeys(name for each in found for name in each)
    rows = [
        (name, *(number(each.get(name)) for each in found))
        for name in names
        if any(each.get(name) is not None for each in found)
    ]
    return [*rows, ("audits", *(_audits(rung) for rung in rungs))]


def _audits(rung: Rung) -> str:
    if rung.status != "converged":
        return rung.status
    missed = rung.summary["audit_missed"]
    return f"{len(missed)} missed" if missed else "kept"


def reasons(rungs: Sequence[Rung]) -> Iterator[str]:
    """What a reader must know beside the figures."""
    yield "tip force on the world and slips: loaded; *: the case's own hood"
    for rung in rungs:
        if rung.reason:
            yield f"{rung.name}: {rung.status}: {rung.reason}"
        elif missed := rung.summary["audit_missed"]:
            yield f"{rung.name}: audits missed: {', '.join(missed)}"


def to_csv(rungs: Sequence[Rung]) -> str:
    """A row for each rung."""
    found = [figures(rung) for rung in rungs]
    names = list(dict.fromkeys(name for each in found for name in each))
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(["rung", "own", "status", "reason", *names, "audits"])
    for rung, each in zip(rungs, found, strict=True):
        values = ["" if (v := each.get(name)) is None else f"{v:.9g}" for name in names]
        head = [rung.name, rung.is_own, rung.status, rung.reason]
        writer.writerow([*head, *values, _audits(rung)])
    return file.getvalue()


def to_json(rungs: Sequence[Rung]) -> str:
    """Everything, the runs' summaries too."""
    return json.dumps([asdict(rung) for rung in rungs], indent=2, default=plain) + "\n"


def to_markdown(rungs: Sequence[Rung], title: str) -> str:
    """The table side by side."""
    lines = [f"# {title}: ladder of hoods", "", _line(["", *map(heading, rungs)])]
    lines.append(_line(["---", *("---:" for _ in rungs)]))
    lines += [_line(row) for row in side_by_side(rungs)]
    return "\n".join([*lines, "", *(f"- {text}" for text in reasons(rungs))]) + "\n"


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |"
