"""The folder of a case made of a user's anatomy: case file, hood mesh, bones, finger, report."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import cast

import numpy as np

from cosim.anatomy.read import Built, Defaults, UserAnatomy, read_anatomy
from cosim.case.file import json_schema, load_case
from cosim.errors import InputError
from cosim.files import check_folder, output_folder
from cosim.hoods.shell.table import ShellHoodConfig
from cosim.models.fit import check_fit
from cosim.schema.json_schema import CASE_SCHEMA, schema_line
from meshes.hood_mesh import write
from rigid.mjcf.write import mjcf_xml

BASE, BARE = "base/index_finger.toml", "base/split.toml"
REPORT = "cosim_new.txt"
"""Also what a folder of this command is known by."""


def new_case(name: str, given: UserAnatomy, out: Path) -> tuple[Path, tuple[str, ...]]:
    """Write the folder `out` whole or not at all; the case file and what there is to tell.

    Raises InputError for anything that the case could not be run with."""
    if not re.fullmatch(r"[A-Za-z0-9][\w-]{0,80}", name):
        raise InputError(f"{name!r}: a case's name is made of letters, digits, _ and -")

    check_folder(out, REPORT)
    made = read_anatomy(given, _defaults())
    with output_folder(out, REPORT) as part:
        write_case(part, name, given, made)
        _check(part / f"{name}.toml")
    return out / f"{name}.toml", made.report


def _defaults() -> Defaults:

    hood = cast(ShellHoodConfig, load_case(BASE).hood)
    return Defaults(hood.thickness, hood.contact)


def write_case(part: Path, name: str, given: UserAnatomy, made: Built) -> None:
    """The files of a case into the folder `part`."""
    if made.hood is not None:
        write(made.hood, part / "hood.json")
    if made.model is not None:
        (part / "finger.xml").write_text(mjcf_xml(made.model) + "\n", encoding="utf-8")
    scale = 1.0 if made.model is not None else given.length_scale
    for body, (points, faces) in (made.bones.surfaces if made.bones else {}).items():
        text = _obj(points / [scale, 1.0, 1.0], faces)
        (part / f"{body}.obj").write_text(text, encoding="utf-8")
    (part / CASE_SCHEMA).write_text(json.dumps(json_schema(), ensure_ascii=False), encoding="utf-8")
    lines = "\n".join(_case_lines(name, given, made))
    (part / f"{name}.toml").write_text(lines + "\n", encoding="utf-8")
    (part / REPORT).write_text("\n".join(made.report) + "\n", encoding="utf-8")


def _obj(points: np.ndarray, faces: np.ndarray) -> str:
    """m, in full precision."""
    rows = [f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
    rows += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    return "\n".join(rows) + "\n"


def _case_lines(name: str, given: UserAnatomy, made: Built) -> Iterator[str]:
    yield schema_line(CASE_SCHEMA)
    yield f"# Written by `cosim new`; {REPORT} says what was read, assumed, repaired and dropped."
    yield "# Materials, springs, passive joints, posture: the base case's until you state yours."
    yield f'extends = "{BASE if made.hood is not None else BARE}"'
    yield f"title = {json.dumps(f'{name}: own anatomy')}"
    yield "\n[finger]"
    if made.model is not None:
        yield 'path = "finger.xml"'
    elif given.length_scale != 1.0:
        yield f"length_scale = {given.length_scale!r}"
        yield "# The surfaces below are stored for a finger of length 1, which the scale lengthens."
    for body in made.bones.surfaces if made.bones else ():
        yield f'\n[finger.bones.{body}]\nsurface = "{body}.obj"\nunit = "m"\nframe = "ours"'
    yield "\n[tendons]     # what pulls: a tension, or an activation of the greatest force"
    for tendon, force in made.max_force.items():
        yield f'{tendon} = {{ max_force = "{force:.6g} N" }}'
    yield "# EDC = { activation = 0.1 }"
    if made.hood is None:
        return
    yield f'\n[hood]\nthickness = "{1e3 * made.hood.thickness:.6g} mm"'
    yield '\n[hood.mesh]\nkind = "file"\npath = "hood.json"'
    yield "\n[hood.contact.offset]"
    for body, height in made.offset.items():
        yield f'{body} = "{1e3 * height:.6g} mm"'


def _check(path: Path) -> None:
    """What `cosim check` does.  Raises InputError."""
    case = load_case(path)
    check_fit(case)
    case.hood.check_files()
