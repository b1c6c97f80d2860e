"""Smooth bones of the fingers from tables of measured cross-sections.

A table holds rows of rays from a centre on the bone's midline.  Along the shaft the rays of a row
are normal to x (a plane section); towards each end the centre stays and the rays tilt until they
all point along the axis, so that the hollow and the rounded joint surfaces are rows like others
and the surface closes itself.  The frame is the body frame of `meshes.skeleton`.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.resources import files
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.port import Array
from meshes.skeleton import BODIES, MYOHAND

FINEST = 20e-6
"""m, the shortest edge length that `Bone.surface` accepts (a million triangles)."""


@dataclass(frozen=True)
class Bone:
    """Rays from centres, in the body frame; ns rows from the proximal to the distal end, na
    (even) equal angles, the first dorsal (+z), increasing towards radial (+y)."""

    name: str
    centres: Array
    """(ns, 3) m; the first column is the station along the bone."""
    tilt: Array
    """(ns,) rad, angle of a row's rays from +x: pi and 0 at the two ends, pi/2 in the shaft."""
    radii: Array
    """(ns, na) m, centre to surface; all alike in the first and the last row."""

    @property
    def points(self) -> Array:
        """The surface's points (ns, na, 3) m, where the rays meet the surface."""
        angle = np.arange(self.radii.shape[1]) * 2 * np.pi / self.radii.shape[1]
        across = np.stack([np.zeros_like(angle), np.sin(angle), np.cos(angle)], axis=-1)
        rays = np.sin(self.tilt)[:, None, None] * across
        rays[..., 0] += np.cos(self.tilt)[:, None]
        return self.centres[:, None] + self.radii[..., None] * rays

    def scale(self, length: float, width: float) -> Bone:
        """The bone with x times `length` and y and z times `width`."""
        if not (length > 0 and width > 0 and np.isfinite([length, width]).all()):
            raise InputError(
                f"bone {self.name}: scale factors must be positive, got {length} and {width}"
            )
        along, across = length * np.cos(self.tilt), width * np.sin(self.tilt)
        return Bone(
            self.name,
            self.centres * [length, width, width],
            np.arctan2(across, along),
            self.radii * np.hypot(along, across)[:, None],
        )

    def surface(self, edge: float = 0.45e-3) -> tuple[Array, NDArray[np.int64]]:
        """Watertight triangles of the bicubic spline through the table, edges of about `edge` m.

        The spline is periodic around the bone and, over both ends, along it (row i at angle a
        continues beyond an end as row -i at a + pi), hence C2 but at the two end points.
        Returns vertices (nv, 3) m and faces (nf, 3), counter-clockwise seen from outside.
        """
        if not edge >= FINEST:
            raise InputError(
                f"bone {self.name}: edge length must be {FINEST} m or more, got {edge}"
            )
        ns, na = self.radii.shape
        step = np.linalg.norm(np.diff(self.points, axis=0), axis=2).mean(axis=1)
        length = np.concatenate([[0.0], np.cumsum(step)])
        rows = max(4, round(length[-1] / edge))
        row = np.interp(np.linspace(0, length[-1], rows + 1), length, np.arange(ns))
        around = np.linalg.norm(np.diff(self.points, axis=1), axis=2).sum(axis=1)
        count = max(8, round(np.percentile(around, 75) / edge))
        column = np.arange(count) * na / count
        points = spline(self.points, row[1:-1], column)
        ends = self.points[[0, -1], 0]
        return np.vstack([points.reshape(-1, 3), ends]), _tube_triangles(rows - 1, count)

    def write_stl(self, path: Path | str, edge: float = 0.45e-3) -> None:
        """The surface as binary STL in metres."""
        vertices, faces = self.surface(edge)
        corners = vertices[faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        record = np.dtype([("xyz", "<f4", (4, 3)), ("attribute", "<u2")])
        out = np.zeros(len(faces), record)
        out["xyz"] = np.concatenate([normal[:, None], corners], axis=1)
        header = f"{self.name}, m".encode().ljust(80)
        Path(path).write_bytes(
            header + np.uint32(len(faces)).astype("<u4").tobytes() + out.tobytes()
        )


def spline(points: Array, row: Array, column: Array) -> Array:
    """Points (len(row), len(column), 3) of the doubly periodic cubic spline through points (ns, na,
    3) at fractional row and column numbers."""
    from scipy.ndimage import map_coordinates

    beyond = np.roll(points[-2:0:-1], points.shape[1] // 2, axis=1)
    torus = np.concatenate([points, beyond])
    at = np.meshgrid(row, column, indexing="ij")
    return np.stack(
        [map_coordinates(torus[..., k], at, order=3, mode="grid-wrap") for k in range(3)], axis=-1
    )


def _tube_triangles(rows: int, count: int) -> NDArray[np.int64]:
    """Triangles of `rows` rings of `count` vertices, closed by two last vertices, the first near
    the first ring."""
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(count), indexing="ij")
    a, b = i * count + j, i * count + (j + 1) % count
    sides = np.stack([a, a + count, b + count, a, b + count, b], axis=-1).reshape(-1, 3)
    here, there = np.arange(count), (np.arange(count) + 1) % count
    tip, last = np.full(count, rows * count), (rows - 1) * count
    start = np.stack([tip, here, there], axis=-1)
    end = np.stack([tip + 1, last + there, last + here], axis=-1)
    return np.vstack([start, sides, end])


@cache
def load_bone(name: str, finger: str = "index") -> Bone:
    """Return the measured bone of a body of `meshes.skeleton.BODIES` and of a finger of
    `meshes.skeleton.MYOHAND`, unscaled.

    Raises InputError for another name.

    >>> from meshes.bones import load_bone
    >>> vertices, triangles = load_bone("proximal").surface()
    >>> vertices.shape[1], triangles.shape[1]  # m, in the bone's frame
    (3, 3)
    """
    if name not in BODIES:
        raise InputError(f"no bone is named {name!r}; expected one of {', '.join(BODIES)}")
    if finger not in MYOHAND:
        known = ", ".join(MYOHAND)
        raise InputError(f"no bones are measured of a finger {finger!r}; expected one of {known}")
    text = files("meshes").joinpath("bones", finger, f"{name}.csv").read_text(encoding="utf-8")
    return parse_table(name, text)


@lru_cache(maxsize=64)
def bone_surface(
    name: str, length: float = 1.0, width: float = 1.0, finger: str = "index"
) -> tuple[Array, NDArray[np.int64]]:
    """Return the `Bone.surface` of a measured bone that is scaled; its arrays cannot be written.

    Raises InputError for another name, or a factor that is not positive.

    >>> from meshes.bones import bone_surface
    >>> longer, usual = (bone_surface("middle", length)[0] for length in (1.1, 1.0))
    >>> float((longer[-1] / usual[-1])[0].round(3))  # the distal end's x
    1.1
    """
    surface = load_bone(name, finger).scale(length, width).surface()
    for values in surface:
        values.setflags(write=False)
    return surface


def parse_table(name: str, text: str) -> Bone:
    """A bone from the text of its table: x, y, z (mm), tilt (deg), then the radii (mm)."""
    table = np.loadtxt(io.StringIO(text), delimiter=",", ndmin=2)
    bone = Bone(name, table[:, :3] * 1e-3, np.radians(table[:, 3]), table[:, 4:] * 1e-3)
    for values in (bone.centres, bone.tilt, bone.radii):
        values.setflags(write=False)
    return bone
