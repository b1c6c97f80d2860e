"""Our bones as another would scan them: turned, moved, triangulated anew, thinned, rough."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from meshes.bones import load_bone
from meshes.skeleton import BODIES
from rigid.model import Surface

EDGE = 0.6e-3
"""m; our own bones' is 0.45."""


def scanned(
    body: str,
    seed: int = 0,
    length: float = 1.0,
    width: float = 1.0,
    dropped: float = 0.1,
    noise: float = 0.0,
    moves: bool = True,
) -> tuple[Surface, np.ndarray, np.ndarray]:
    """A surface, m, and the rotation (3, 3) and place (3,) of our frame in it: a part `dropped` of
    its points removed, the others off by `noise` (m, rms)."""
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng([seed, BODIES.index(body)])
    points, faces = load_bone(body).scale(length, width).surface(EDGE)
    faces = _without(points, faces, rng.choice(len(points), int(dropped * len(points)), False))
    points = points + noise / np.sqrt(3) * rng.standard_normal(points.shape)
    turn = Rotation.random(rng=rng).as_matrix() if moves else np.eye(3)
    place = rng.uniform(-0.1, 0.1, 3) if moves else np.zeros(3)
    return (points @ turn.T + place, faces), turn, place


def _without(points: np.ndarray, faces: np.ndarray, dropped: np.ndarray) -> np.ndarray:
    """The faces of a closed surface where each dropped point falls onto its nearest neighbour."""
    to, gone = np.arange(len(points)), set(dropped.tolist())
    for i in dropped:
        beside = [n for n in np.unique(faces[(faces == i).any(axis=1)]) if n not in gone]
        if beside:
            to[i] = beside[int(np.linalg.norm(points[beside] - points[i], axis=1).argmin())]
    faces = to[faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    _, first, times = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
    )
    return faces[np.sort(first[times == 1])]  # two back to back close nothing


def write_surface(surface: Surface, path: Path, unit: float = 1e-3) -> Path:
    """Write a surface, m, in the unit (m)."""
    mesh = trimesh.Trimesh(np.asarray(surface[0]) / unit, surface[1], process=False)
    mesh.remove_unreferenced_vertices()
    assert mesh.is_watertight
    mesh.export(path)
    return path


def write_scans(folder: Path, seed: int = 0, **how: float) -> list[Path]:
    """Four files, mm, as `scanned` makes them."""
    folder.mkdir(parents=True, exist_ok=True)
    return [write_surface(scanned(body, seed, **how)[0], folder / f"{body}.stl") for body in BODIES]


def mirrored(surface: Surface) -> Surface:
    """The surface of the other hand."""
    return surface[0] * [1, -1, 1], surface[1][:, ::-1]
