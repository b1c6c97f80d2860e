"""Cases of several people, from a table of the sizes of their fingers or of folders of their bones,
and the study that runs them side by side."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast, get_args

import numpy as np

from cosim.anatomy.case_folder import REPORT, check_case, check_name
from cosim.anatomy.own_case import OwnBones, OwnCase, OwnFinger, own_finger, write_own_case
from cosim.anatomy.user_bones import (
    PROPORTION,
    SIZE,
    Template,
    kinds_with_a_hood,
    span,
    template_of,
    width_of,
)
from cosim.errors import InputError, Progress, quiet
from cosim.files import check_folder, output_folder
from cosim.port import Hand
from cosim.text_tables import CsvRow, notes, read_csv, toml_text
from meshes.skeleton import BODIES

WHO = ("subject", "finger", "hand")
LENGTHS = {f"{body}_mm": body for body in BODIES}
"""Columns of the length of a bone from end to end; that of the metacarpal may be left out."""
WIDTHS = {f"{body}_width_mm": body for body in BODIES}
"""Columns of its greatest width from side to side; any may be left out."""
NEEDED = [*LENGTHS][1:]
EXAMPLE = ",".join((*WHO, *NEEDED))
BONES = "bones"
"""The column of a folder of bones, in place of sizes."""
LOAD = "load.toml"
OUTPUTS = {
    "tip_force": "fingertip_magnitude_N",
    "central": "slip_force_N.central",
    "terminal": "slip_force_N.terminal",
    "slip_ratio": "slip_ratio",
    **{f"arm_EDC_{joint}": f"moment_arm_mm.EDC.{joint}" for joint in ("MCP", "PIP", "DIP")},
    **{f"arm_FDP_{joint}": f"moment_arm_mm.FDP.{joint}" for joint in ("MCP", "PIP", "DIP")},
}


@dataclass(frozen=True)
class Subject:
    """A finger of a person, and where the table has it."""

    name: str
    place: str
    given: OwnBones


def read_people(path: Path) -> tuple[Subject, ...]:
    """The subjects of a CSV file.  Raises InputError that lists all faults by row and column."""
    table = read_csv(path, EXAMPLE)
    needed = WHO if BONES in table.columns else (*WHO, *NEEDED)
    faults = [
        f"{table.place}: column {name} is missing; expected at least {','.join(needed)}"
        for name in needed
        if name not in table.columns
    ]
    known = (*WHO, *LENGTHS, *WIDTHS, BONES)
    faults += [
        f"{table.place}: column {name} is unknown; expected some of {', '.join(known)}"
        for name in table.columns
        if name not in known
    ]
    subjects: dict[str, Subject] = {}
    for row in table.rows if not faults else ():
        found = list(_row_faults(row))
        name = row.cells["subject"]
        if name and name.lower() in subjects:
            found.append(
                f"{row.place}: subject {name!r} is in {subjects[name.lower()].place} too; each row "
                f"is a case of its own: name a second finger of a person otherwise, as {name}_ring"
            )
        given = OwnBones("index", {})
        try:
            given = given if found else _given(row, path.parent)
        except InputError as error:
            found.append(str(error))
        faults += found
        subjects.setdefault(name.lower(), Subject(name, row.place, given))
    if not faults and not table.rows:
        faults.append(f"{table.place}: no row follows; write one for each subject")
    _refuse(f"--from-table {path.name}", faults)
    return tuple(subjects.values())


def _refuse(what: str, faults: Sequence[str]) -> None:
    if faults:
        count = f"{len(faults)} fault" + ("s" if len(faults) > 1 else "")
        raise InputError("\n  ".join([f"{what}: {count}", *faults]))


def _row_faults(row: CsvRow) -> Iterator[str]:
    cells, has_bones = row.cells, bool(row.cells.get(BONES))
    sized = [name for name in (*LENGTHS, *WIDTHS) if name in cells]
    for name in (*WHO, *(() if has_bones else sized)):
        if not cells[name]:
            hint = f", or a folder in the column {BONES}" if name in sized else ""
            yield f"{row.place}: {name} is empty; write it{hint}"
    if not has_bones and (lacking := [name for name in NEEDED if name not in cells]):
        yield f"{row.place}: {BONES} is empty; write a folder, or add the column {lacking[0]}"
    if has_bones and (both := [name for name in sized if cells[name]]):
        yield f"{row.place}: {both[0]} and {BONES} are both stated; the bones have their size"
    name = cells["subject"]
    if name and not re.fullmatch(r"[A-Za-z][\w-]{0,60}", name):
        hint = "begins with a letter and goes on with letters, digits, _ and -"
        yield f"{row.place}: subject {name!r}: a name {hint}"
    if cells["hand"] and cells["hand"] not in get_args(Hand):
        yield f"{row.place}: hand is {cells['hand']!r}; expected right or left"
    kind = cells["finger"]
    if kind and kind not in kinds_with_a_hood():
        yield f"{row.place}: finger is {kind!r}; expected one of {', '.join(kinds_with_a_hood())}"
    elif kind and not has_bones:
        yield from _size_faults(row, template_of(kind), sized)


def _size_faults(row: CsvRow, template: Template, sized: Sequence[str]) -> Iterator[str]:
    lengths: dict[str, float] = {}
    for name in sized:
        try:
            value = row.number(name)
        except InputError as error:
            yield str(error)
            continue
        if value is None:
            continue
        ours = 1e3 * _ours(template, name)
        ratio = value / ours
        if SIZE[0] < ratio < SIZE[1]:
            if name in LENGTHS:
                lengths[name] = ratio
            continue
        units = {"m": 1e3, "cm": 10.0, "um": 1e-3, "in": 25.4}
        fits = next((u for u, mm in units.items() if SIZE[0] < ratio * mm < SIZE[1]), None)
        hint = "" if fits is None else f".  Is it in {fits}? Write {value * units[fits]:.4g}"
        yield (
            f"{row.place}: {name} is {value:g}; ours is {ours:.1f} mm, expected "
            f"{SIZE[0] * ours:.0f} to {SIZE[1] * ours:.0f} mm{hint}"
        )
    if lengths and max(lengths.values()) > PROPORTION * min(lengths.values()):
        low, high = (pick(lengths, key=lambda n: lengths[n]) for pick in (min, max))
        yield (
            f"{row.place}: {low} is {lengths[low]:.2f} times ours and {high} {lengths[high]:.2f} "
            "times: these do not belong to one finger"
        )


def _ours(template: Template, column: str) -> float:
    """The packaged bone's length or width, m, that a column states."""
    if column in LENGTHS:
        return span(template.bones[LENGTHS[column]])
    return width_of(template.bones[WIDTHS[column]])


def _given(row: CsvRow, folder: Path) -> OwnBones:
    """A row without faults.  Widths that no column states are as much wider as the bones are
    longer in the mean."""
    cells = row.cells
    kind, hand = cells["finger"], cast(Hand, cells["hand"])
    if cells.get(BONES):
        return OwnBones(kind, _bones(row, folder / cells[BONES]), hand)
    template = template_of(kind)
    stated = {name: 1e-3 * cast(float, row.number(name)) for name in cells if name.endswith("_mm")}
    longer = np.mean([m / _ours(template, n) for n, m in stated.items() if n in LENGTHS])
    sizes = {
        body: (
            stated[length],
            stated.get(width, float(longer) * _ours(template, width)),
        )
        for (length, body), width in zip(LENGTHS.items(), WIDTHS, strict=True)
        if length in stated
    }
    return OwnBones(kind, {}, hand, sizes=sizes)


def _bones(row: CsvRow, folder: Path) -> Mapping[str, Path]:
    """The surfaces in a folder, by body.  Raises InputError."""
    there = {
        body: path
        for body in BODIES
        for end in (".obj", ".stl")
        if (path := folder / f"{body}{end}").is_file()
    }
    if not there:
        names = ", ".join(f"{body}.stl" for body in BODIES)
        raise InputError(f"{row.place}: {BONES}: {folder} holds none of {names} (or .obj)")
    return there


@dataclass(frozen=True)
class People:
    """Cases that were written, and their study."""

    study: Path
    cases: tuple[OwnCase, ...]
    report: tuple[str, ...]


def new_people(
    name: str, subjects: Sequence[Subject], out: Path, progress: Progress = quiet
) -> People:
    """Write the folder `out` of a case for each subject, the load of all and the study NAME.toml of
    them, whole or not at all.  Raises InputError that lists the faults of all bones."""
    check_name(name)
    check_folder(out, REPORT)
    fingers: list[OwnFinger] = []
    faults = []
    for subject in subjects:
        progress(f"{subject.name}: bones and joints")
        try:
            fingers.append(own_finger(subject.given))
        except InputError as error:
            faults.append(f"{subject.place}: {subject.name}: {error}")
    _refuse("the people's bones", faults)
    cases: list[OwnCase] = []
    report: list[str] = []
    with output_folder(out, REPORT) as part:
        for subject, finger in zip(subjects, fingers, strict=True):
            progress(f"{subject.name}: lengths of the slips, {len(cases) + 1} of {len(subjects)}")
            (part / subject.name).mkdir()
            cases.append(write_own_case(subject.name, finger, part / subject.name, quiet))
            report.append(_words(cases[-1]))
        (part / LOAD).write_text(_load_text(name, fingers[0].template), encoding="utf-8")
        study = part / f"{name}.toml"
        study.write_text(_study_text(name, [s.name for s in subjects]), encoding="utf-8")
        check_case(part / LOAD)
        (part / REPORT).write_text("\n".join(report) + "\n", encoding="utf-8")
    return People(out / study.name, tuple(cases), tuple(report))


def _words(case: OwnCase) -> str:
    finger = case.finger
    lengths = ", ".join(f"{1e3 * part:.1f}" for part in finger.joints.skeleton.length[1:])
    met = "" if case.slips.is_met else "; the slips' shares of a pull are not met"
    return (
        f"{case.case.stem}: {finger.template.kind} finger of a {finger.hand} hand, phalanges "
        f"{lengths} mm from joint to joint, {finger.size:.3f} times ours; central slip "
        f"{1e3 * case.slips.central:+.3f} mm{met}"
    )


def _load_text(name: str, template: Template) -> str:
    remarks = [
        "What is done with every subject: the study lays this file over each one's case in place "
        "of what it extends here, our own finger.",
        "Strengths are ours: an activation pulls every subject with the same force.",
    ]
    posture = {"MCP": "30 deg", "MCP_abduction": "0 deg", "PIP": "45 deg", "DIP": "15 deg"}
    values = {
        "extends": template.base,
        "title": f"{name}: EDC at a tenth of its strength, at 30/45/15 deg",
        "finger": {"tip": {"kind": "point"}, "posture": posture},
        "tendons": {"EDC": {"activation": 0.1}},
    }
    return notes(remarks) + toml_text(values)


def _study_text(name: str, subjects: Sequence[str]) -> str:
    remarks = [
        f"Written by `cosim new`: `cosim study {name}.toml` solves {LOAD} for each subject.",
        f"Beside it, what the inputs are worth: `cosim study input_uncertainty --case {LOAD}` "
        'leaves a bands.csv, and this study names it: data = "PATH/bands.csv".',
    ]
    values = {
        "title": f"{name}: fingertip force, arms and slips over people",
        "case": LOAD,
        "bands": True,
        "parameters": {
            "subject": {"values": list(subjects), "settings": ["extends={value}/{value}.toml"]}
        },
        "outputs": OUTPUTS,
    }
    return notes(remarks) + toml_text(values)
