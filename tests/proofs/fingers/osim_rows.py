"""An .osim written by OpenSim, imported: lengths and moment arms against OpenSim's own.

`data/finger.osim` and OpenSim's figures of it (`data/finger_opensim.json`, with their provenance)
are made by `tests/helpers/make_osim.py`.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from cosim.port import Array
from rigid.opensim.osim import Imported, import_osim
from tests.helpers.folders import CASE_DATA, TEST_DATA
from tests.helpers.rows import Row

NAME = "OpenSim file, imported"
EXACT = 1e-9
"""m and m/rad: 1e-6 mm."""
WRAP_LENGTH, WRAP_ARM = 3e-6, 2e-4
"""m and m/rad: how far OpenSim's path over a cylinder is from the shortest one here.  Its points of
contact are not the geodesic's where the path runs askew, which its moment arms feel in the first
order and its lengths in the second."""
MASS = 1e-9
CYLINDER = "EDC"


@dataclass(frozen=True)
class Figures:
    """OpenSim's figures: postures (n, nq) rad, lengths (n, np) m, moment arms (n, np, nq) m/rad,
    positive where the path shortens, and mass matrices (n, nq, nq) kg m2."""

    provenance: str
    coordinates: tuple[str, ...]
    paths: tuple[str, ...]
    postures: Array
    lengths: Array
    arms: Array
    masses: Array


def shipped_models() -> tuple[Imported, Figures]:
    """The finger that travels with the program, imported, and OpenSim's figures of it."""
    imported = import_osim(CASE_DATA / "finger.osim")
    told = TEST_DATA / "opensim" / "finger_opensim.json"
    raw = json.loads(told.read_text(encoding="utf-8"))
    return imported, Figures(
        raw["provenance"],
        tuple(raw["coordinates"]),
        tuple(raw["paths"]),
        np.array(raw["postures"]),
        np.array(raw["lengths"]),
        np.array(raw["moment_arms"]),
        np.array(raw["mass_matrices"]),
    )


@dataclass(frozen=True)
class MjcfFigures:
    """An MJCF at postures: as in `Figures`."""

    lengths: Array
    arms: Array
    masses: Array


def at_postures(
    xml: str, coordinates: tuple[str, ...], paths: tuple[str, ...], postures: Array
) -> MjcfFigures:
    """Tendons and mass matrices of an MJCF at postures (n, nq) of named joints."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    rows = [model.tendon(name).id for name in paths]
    columns = [model.joint(name).dofadr[0] for name in coordinates]
    where = [model.joint(name).qposadr[0] for name in coordinates]
    lengths, arms, masses = [], [], []
    for posture in postures:
        data.qpos[where] = posture
        mujoco.mj_forward(model, data)
        dense, mass = np.zeros((model.ntendon, model.nv)), np.zeros((model.nv, model.nv))
        sparse = (model.ten_J_rownnz, model.ten_J_rowadr, model.ten_J_colind)
        mujoco.mju_sparse2dense(dense, data.ten_J, *sparse)
        mujoco.mj_fullM(model, data, mass)
        lengths.append(data.ten_length[rows])
        arms.append(-dense[np.ix_(rows, columns)])
        masses.append(mass[np.ix_(columns, columns)])
    return MjcfFigures(np.array(lengths), np.array(arms), np.array(masses))


def over_cylinder(
    xml: str, coordinates: tuple[str, ...], postures: Array, name: str, geom: str
) -> Array:
    """The lengths (n,) m of a tendon of three points whose last segment keeps to one side of a
    cylinder.  The shortest way is a line on the unrolled surface: hypot(tangents + arc, climb)."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    where = [model.joint(name).qposadr[0] for name in coordinates]
    radius, out = float(model.geom(geom).size[0]), []
    for posture in postures:
        data.qpos[where] = posture
        mujoco.mj_forward(model, data)
        points = np.array([data.site(f"{name}-{k}").xpos for k in range(3)])
        turn, centre = data.geom(geom).xmat.reshape(3, 3), data.geom(geom).xpos
        start, end, side = (
            (p - centre) @ turn for p in (*points[1:], data.site(f"{geom}-side").xpos)
        )
        out.append(np.linalg.norm(points[1] - points[0]) + _around(start, end, side, radius))
    return np.array(out)


def _around(start: Array, end: Array, side: Array, radius: float) -> float:
    """Length between two points in the cylinder's frame (axis z), past its side `side`."""
    near, far = np.linalg.norm(start[:2]), np.linalg.norm(end[:2])
    angles = [np.arctan2(p[1], p[0]) - np.arctan2(side[1], side[0]) for p in (start, end)]
    first, second = (np.angle(np.exp(1j * a)) for a in angles)
    arc = abs(first - second) - np.arccos(radius / near) - np.arccos(radius / far)
    if arc <= 0:
        return float(np.linalg.norm(end - start))
    tangents = np.sqrt(near**2 - radius**2) + np.sqrt(far**2 - radius**2)
    return float(np.hypot(tangents + radius * arc, end[2] - start[2]))


def rows() -> Iterator[Row]:
    """Largest differences over all postures, by path."""
    imported, told = shipped_models()
    ours = at_postures(imported.xml, told.coordinates, told.paths, told.postures)
    length = np.abs(ours.lengths - told.lengths).max(axis=0)
    arm = np.abs(ours.arms - told.arms).max(axis=(0, 2))
    for k, name in enumerate(told.paths):
        if name != CYLINDER:
            yield _row(f"{name}: length", length[k], 0.0, EXACT, told.provenance)
            yield _row(f"{name}: moment arms", arm[k], 0.0, EXACT, told.provenance)
    k, what = told.paths.index(CYLINDER), f"{CYLINDER} over a cylinder"
    exact = over_cylinder(imported.xml, told.coordinates, told.postures, CYLINDER, "mcp_head")
    helix = "closed form: a line on the unrolled cylinder"
    yield _row(f"{what}: length", np.abs(ours.lengths[:, k] - exact).max(), 0.0, EXACT, helix)
    source = f"{told.provenance}; its path over a cylinder is not the shortest"
    yield _row(f"{what}: length, OpenSim's", length[k], WRAP_LENGTH, 0.0, source)
    yield _row(f"{what}: moment arms, OpenSim's", arm[k], WRAP_ARM, 0.0, source)
    mass = np.abs(ours.masses - told.masses).max() / np.abs(told.masses).max()
    text = "mass matrix, largest difference over its largest entry"
    yield Row(NAME, text, 0.0, float(mass), MASS, told.provenance, "bound")


def _row(quantity: str, value: np.floating, target: float, tolerance: float, source: str) -> Row:
    unit = "m/rad" if "arms" in quantity else "m"
    text = f"{quantity}, largest difference, {unit}"
    return Row(NAME, text, target, float(value), tolerance, source, "bound")
