"""The folder of a case made of a user's anatomy: case file, hood mesh, bones, finger, report."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, cast

import numpy as np

from cosim.anatomy.read import Built, Defaults, UserAnatomy, read_anatomy
from cosim.case.file import json_schema, load_case
from cosim.errors import InputError
from cosim.files import check_folder, output_folder
from cosim.hoods.shell.table import ShellHoodConfig
from cosim.models.fit import check_fit
from cosim.schema.json_schema import CASE_SCHEMA, schema_line
from cosim.text_tables import notes, toml_text
from meshes.hood_mesh import write
from rigid.mjcf.write import mjcf_xml

BASE, BARE = "base/index_finger.toml", "base/split.toml"
REPORT = "cosim_new.txt"
"""Also what a folder of this command is known by."""


def new_case(name: str, given: UserAnatomy, out: Path) -> tuple[Path, tuple[str, ...]]:
    """Write the folder `out` whole or not at all; the case file and what there is to tell.

    Raises InputError for anything that the case could not be run with."""
    check_name(name)
    check_folder(out, REPORT)
    built = read_anatomy(given, _defaults())
    with output_folder(out, REPORT) as part:
        write_case(part, name, given, built)
        check_case(part / f"{name}.toml")
    return out / f"{name}.toml", built.report


def check_name(name: str) -> None:
    """Check that a case can be called so.  Raises InputError."""
    if not re.fullmatch(r"[A-Za-z0-9][\w-]{0,80}", name):
        raise InputError(f"{name!r}: a case's name is made of letters, digits, _ and -")


def _defaults() -> Defaults:
    hood = cast(ShellHoodConfig, load_case(BASE).hood)
    return Defaults(hood.thickness, hood.contact)


def write_case(part: Path, name: str, given: UserAnatomy, built: Built) -> None:
    """The files of a case into the folder `part`."""
    if built.hood is not None:
        write(built.hood, part / "hood.json")
    if built.model is not None:
        (part / "finger.xml").write_text(mjcf_xml(built.model) + "\n", encoding="utf-8")
    scale = 1.0 if built.model is not None else given.length_scale
    for body, (points, faces) in (built.bones.surfaces if built.bones else {}).items():
        text = obj_text(points / [scale, 1.0, 1.0], faces)
        (part / f"{body}.obj").write_text(text, encoding="utf-8")
    write_schema(part)
    (part / f"{name}.toml").write_text(_case_text(name, given, built), encoding="utf-8")
    (part / REPORT).write_text("\n".join(built.report) + "\n", encoding="utf-8")


def write_schema(part: Path) -> None:
    """The schema that editors complete the case by, into its folder."""
    (part / CASE_SCHEMA).write_text(json.dumps(json_schema(), ensure_ascii=False), encoding="utf-8")


def obj_text(points: np.ndarray, faces: np.ndarray) -> str:
    """The text of an OBJ file, m, in full precision."""
    rows = [f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
    rows += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    return "\n".join(rows) + "\n"


def _case_text(name: str, given: UserAnatomy, built: Built) -> str:
    remarks = [
        f"Written by `cosim new`; {REPORT} says what was read, assumed, repaired and dropped.",
        "Materials, springs, passive joints, posture: the base case's until you state yours.",
        "Tendons pull by a tension, or by an activation of the greatest force: "
        "EDC = { activation = 0.1 }.",
    ]
    if any("muscle" in table for table in built.tendons.values()):
        remarks.append("A tendon with a muscle pulls by an activation; without it, by a tension.")
    finger: dict[str, Any] = {}
    if built.model is not None:
        finger["path"] = "finger.xml"
    elif given.length_scale != 1.0:
        finger["length_scale"] = given.length_scale
        remarks.append("Bones are stored for a finger of length 1, which the scale lengthens.")
    if built.bones:
        finger["bones"] = {
            body: {"surface": f"{body}.obj", "unit": "m", "frame": "ours"}
            for body in built.bones.surfaces
        }
    values: dict[str, Any] = {
        "extends": BASE if built.hood is not None else BARE,
        "title": f"{name}: own anatomy",
        "finger": finger,
        "tendons": built.tendons,
    }
    if built.hood is not None:
        values["hood"] = {
            "thickness": f"{1e3 * built.hood.thickness:.6g} mm",
            "mesh": {"kind": "file", "path": "hood.json"},
            "contact": {"offset": {body: f"{1e3 * m:.6g} mm" for body, m in built.offset.items()}},
        }
    return f"{schema_line(CASE_SCHEMA)}\n{notes(remarks)}{toml_text(values)}"


def check_case(path: Path) -> None:
    """What `cosim check` does.  Raises InputError."""
    case = load_case(path)
    check_fit(case)
    case.hood.check_files()
