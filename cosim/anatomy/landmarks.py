"""Points that a user names on the bones: they override what is found, and tell the side."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from cosim.errors import InputError
from cosim.port import Array
from cosim.text_tables import read_csv
from meshes.skeleton import BODIES

LANDMARKS = {
    "distal_joint": ("metacarpal", "proximal", "middle"),
    "proximal_joint": ("proximal", "middle", "distal"),
    "flexion_radial": ("metacarpal", "proximal", "middle"),
    "flexion_ulnar": ("metacarpal", "proximal", "middle"),
    "abduction_dorsal": ("metacarpal",),
    "abduction_palmar": ("metacarpal",),
    "tip": ("distal",),
    "dorsal": BODIES,
    "radial": BODIES,
}
"""The bones on which each has a meaning: the centre of the joint at the bone's distal or proximal
end, two points on the flexion axis at its head, two on the MCP's abduction axis, the fingertip, any
point on its dorsal and on its radial side."""
AXES = {
    "flexion": ("flexion_radial", "flexion_ulnar"),
    "abduction": ("abduction_dorsal", "abduction_palmar"),
}
"""From the second point to the first."""
EXAMPLE = "bone,landmark,x,y,z"


def read_landmarks(path: Path) -> dict[tuple[str, str], Array]:
    """Points (3,) in the bones' unit and frames, by bone and name.  Raises InputError."""
    table = read_csv(path, EXAMPLE)
    if lacking := [name for name in EXAMPLE.split(",") if name not in table.columns]:
        raise InputError(f"--landmarks {table.place}: has no column {lacking[0]}; write {EXAMPLE}")
    x, y, z = (table.numbers(axis) for axis in "xyz")
    out: dict[tuple[str, str], Array] = {}
    for row, point in zip(table.rows, np.column_stack([x, y, z]), strict=True):
        bone, name = row.cells["bone"], row.cells["landmark"]
        if name not in LANDMARKS or bone not in LANDMARKS[name]:
            known = ", ".join(n for n, bones in LANDMARKS.items() if bone in bones)
            raise InputError(
                f"--landmarks {row.place}: {bone} has no {name!r}; expected a bone of "
                f"{', '.join(BODIES)}" + (f" and one of {known}" if known else "")
            )
        if (bone, name) in out:
            raise InputError(f"--landmarks {row.place}: {name} of the {bone} is there twice")
        out[bone, name] = point
    for axis, (first, second) in AXES.items():
        for bone in LANDMARKS[first]:
            a, b = (out.get((bone, name)) for name in (first, second))
            if a is None and b is None:
                continue
            if a is None or b is None or np.array_equal(a, b):
                raise InputError(
                    f"--landmarks {path}: the {bone}'s {axis} axis needs two points, {first} and "
                    f"{second}"
                )
    return out


def stated_axes(points: Mapping[tuple[str, str], Array]) -> dict[tuple[str, str], Array]:
    """With each flexion and abduction axis (3,), of length 1, beside the points."""
    out = dict(points)
    for axis, (first, second) in AXES.items():
        for bone in LANDMARKS[first]:
            if (bone, first) in points:
                way = points[bone, first] - points[bone, second]
                out[bone, axis] = way / np.linalg.norm(way)
    return out
