"""Measure bone surfaces into the tables of `meshes/bones` (a developer's tool).

    python -m cases.measure_bones FINGER FOLDER

FOLDER holds 2mc.stl, 2proxph.stl, 2midph.stl and 2distph.stl (3mc.stl ... of the middle finger,
4mc.stl ... of the ring finger, 5mc.stl ... of the little finger) of MyoHub/myo_sim at 2cef885
(Apache-2.0), in metres, each in MyoHand's frame of its body.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cosim.extras import require
from cosim.port import Array
from meshes.bones import Bone, parse_table
from meshes.skeleton import BODIES, MYOHAND, myohand_finger


@dataclass(frozen=True)
class MeasurementPlan:
    """How one bone is measured; lengths in m."""

    file: str
    proximal: float
    """The x of the centre from which the rays of the proximal end fan out."""
    distal: float
    stations: int
    """Plane sections between the two."""
    fan: int
    """Rows of tilted rays at each end, the end point included."""
    angles: int


PARTS = dict(zip(BODIES, ("mc", "proxph", "midph", "distph"), strict=True))
ROWS = {"metacarpal": (50, 20, 80), "proximal": (40, 14, 64), "middle": (28, 14, 64)}
ROWS["distal"] = (22, 14, 64)
"""By bone: stations, rows of a fan, angles."""
FANS = {
    "index": ((-49e-3, 0.0), (10.5e-3, 42.5e-3), (7.0e-3, 24.5e-3), (5.0e-3, 15.5e-3)),
    "middle": ((-50e-3, 0.0), (10.7e-3, 44.5e-3), (7.0e-3, 28.4e-3), (4.8e-3, 16.2e-3)),
    "ring": ((-45e-3, 0.0), (10.0e-3, 40.3e-3), (6.5e-3, 24.2e-3), (4.7e-3, 16.0e-3)),
    "little": ((-40e-3, 0.0), (9.8e-3, 36.0e-3), (6.3e-3, 20.4e-3), (4.7e-3, 14.8e-3)),
}
"""By finger, the proximal and the distal centre of each of BODIES."""


def plan_of(finger: str, body: str) -> MeasurementPlan:
    """How a finger's bone is measured."""
    ray = {"index": 2, "middle": 3, "ring": 4, "little": 5}[finger]
    return MeasurementPlan(
        f"{ray}{PARTS[body]}.stl", *FANS[finger][BODIES.index(body)], *ROWS[body]
    )


HEADER = """\
Cross-sections of the {finger} finger's {name} bone: distance from a centre to the surface.
Unit: mm (tilt: deg). Frame: the body frame of meshes/skeleton.py: x distal, y radial, z dorsal.
Source: measured on {file} of MyoHub/myo_sim at 2cef885 (Apache-2.0) by casting rays from centres
on the bone's midline (python -m cases.measure_bones); the farthest crossing is kept.
Tilt: angle of the rays from +x; 90: plane section; 180 and 0: the proximal and the distal end.
Radii: at {angles} equal angles about x, the first dorsal (+z), increasing towards radial (+y).
x, y, z of the centre, tilt, radii"""


def read_stl(path: Path) -> Array:
    """The corners (nf, 3, 3) of a binary STL's triangles."""
    record = np.dtype([("xyz", "<f4", (4, 3)), ("attribute", "<u2")])
    return np.frombuffer(path.read_bytes(), record, offset=84)["xyz"][:, 1:].astype(float)


def farthest_hits(triangles: Array, origin: Array, rays: Array) -> Array:
    """The distance (n,) along unit rays (n, 3) from one origin to the last triangle they cross
    (Moeller and Trumbore, J Graphics Tools 2, 1997); nan through a hole."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    ab, ac, s = b - a, c - a, origin - a
    q = np.cross(s, ab)
    height = np.einsum("fi,fi->f", ac, q)
    out = np.empty(len(rays))
    for i, ray in enumerate(rays):
        p = np.cross(ray, ac)
        determinant = np.einsum("fi,fi->f", ab, p)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.einsum("fi,fi->f", s, p) / determinant
            v, t = q @ ray / determinant, height / determinant
        hit = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (t > 0)
        out[i] = t[hit].max() if hit.any() else np.nan
    return out


def midline(triangles: Array, x: Array) -> Array:
    """Points (n, 3) on the bone's midline at stations x: a parabola through the middles of the
    bone's extent in windows along it."""
    points = triangles.reshape(-1, 3)
    stations = np.linspace(points[:, 0].min(), points[:, 0].max(), 21)[2:-2]
    window = stations[1] - stations[0]
    near = [points[np.abs(points[:, 0] - s) < window] for s in stations]
    middle = np.array([(p.min(axis=0) + p.max(axis=0)) / 2 for p in near])
    y, z = (np.polyval(np.polyfit(stations, middle[:, k], 2), x) for k in (1, 2))
    return np.column_stack([x, y, z])


def measure(name: str, plan: MeasurementPlan, triangles: Array) -> Bone:
    """The table of one bone from its triangles (nf, 3, 3) in the body frame."""
    ends = np.full(plan.fan, 1.0)
    shaft = np.linspace(plan.proximal, plan.distal, plan.stations)
    x = np.concatenate([plan.proximal * ends, shaft, plan.distal * ends])
    fan = np.linspace(0, np.pi / 2, plan.fan, endpoint=False)
    tilt = np.concatenate([np.pi - fan, np.full(plan.stations, np.pi / 2), fan[::-1]])
    centres = midline(triangles, x)
    unit = Bone(name, np.zeros_like(centres), tilt, np.ones((len(x), plan.angles)))
    radii = np.array(
        [farthest_hits(triangles, c, r) for c, r in zip(centres, unit.points, strict=True)]
    )
    _close_holes(radii, 1e3 * centres[:, None] + 2 * unit.points)
    return Bone(name, centres, tilt, radii)


def _close_holes(radii: Array, places: Array) -> None:
    """Put a smooth surface through the neighbours of rays that hit none, in place; places (ns, na,
    3) mm: somewhere on the rays."""
    from scipy.interpolate import RBFInterpolator

    hole = np.isnan(radii)
    if hole.any():
        smooth = RBFInterpolator(places[~hole], radii[~hole], neighbors=200)
        radii[hole] = smooth(places[hole])


def table(bone: Bone, plan: MeasurementPlan, finger: str = "index") -> str:
    """The text of the table, rounded to 3 decimals."""
    header = HEADER.format(finger=finger, name=bone.name, file=plan.file, angles=plan.angles)
    rows = np.column_stack([bone.centres * 1e3, np.degrees(bone.tilt), bone.radii * 1e3])
    lines = [f"# {line}" for line in header.splitlines()]
    lines += [",".join(f"{v:.3f}" for v in row) for row in rows]
    return "\n".join(lines) + "\n"


def dorsal_samples(triangles: Array, bone: Bone, density: float = 40e6) -> Array:
    """Points (n, 3) spread evenly (per m2) over the measured surface dorsal of the midline."""
    rng = np.random.default_rng(0)
    a, b, c = np.moveaxis(triangles, 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    which = rng.choice(len(area), size=int(area.sum() * density), p=area / area.sum())
    u, v = rng.random((2, len(which), 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    points = a[which] + u * (b - a)[which] + v * (c - a)[which]
    points = np.vstack([points, triangles.reshape(-1, 3)])
    return points[points[:, 2] > np.interp(points[:, 0], bone.centres[:, 0], bone.centres[:, 2])]


def fit_error(triangles: Array, bone: Bone) -> Array:
    """Distances (m) from the dorsal half of the measured surface to the regenerated one."""
    import pyvista

    vertices, faces = bone.surface()
    surface = pyvista.PolyData.from_regular_faces(vertices, faces.tolist())
    samples = pyvista.PolyData(dorsal_samples(triangles, bone))
    return np.abs(samples.compute_implicit_distance(surface)["implicit_distance"])


def main() -> None:
    """Measure the bones of a folder, as the module says."""
    require("the distance of measured surfaces", "pyvista")
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("finger", choices=tuple(MYOHAND))
    parser.add_argument("folder", type=Path, help="folder of the four STL files")
    given = parser.parse_args()
    skeleton = myohand_finger(given.finger)
    for name in BODIES:
        plan = plan_of(given.finger, name)
        triangles = read_stl(given.folder / plan.file)
        triangles = skeleton.from_source(name, triangles.reshape(-1, 3)).reshape(-1, 3, 3)
        text = table(measure(name, plan, triangles), plan, given.finger)
        path = Path(__file__).parents[1] / "meshes" / "bones" / given.finger / f"{name}.csv"
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
        error = fit_error(triangles, parse_table(name, text)) * 1e3
        print(
            f"{name}: {len(text) / 1e3:.0f} kB; distance of {len(error)} dorsal points, mm: "
            f"mean {error.mean():.3f}, 95 % {np.percentile(error, 95):.3f}, max {error.max():.3f}"
        )


if __name__ == "__main__":
    main()
