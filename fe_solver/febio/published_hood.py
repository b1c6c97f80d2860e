"""The published finger hood of FEBio's test suite (`Verify/mi29.feb`), with other moduli and
springs.

Its axes: x ulnar to radial, y palmar, z distal, mm; the numbers below are places measured on it.
The file itself is the user's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Mask
from fe_solver.febio.read import read_feb
from fe_solver.job.job import Job, NodalForce
from fe_solver.job.solve import ShellState, solve_job
from fe_solver.materials.linear import Isotropic
from fe_solver.sheet import ShellPart
from fe_solver.supports import Body, SpringLaw, SpringSet, Tied

QUADS = 4690
BODIES = ("Material 5", "Material 6", "Material 7", "Material 8")
PROXIMAL, MIDDLE, DISTAL = 1, 2, 3
"""Places of the phalanges among the file's bodies."""
CENTRE, HALF = -59e-3, 3e-3
"""m, x of the middle line and half the central tendon's width."""
BETWEEN = 7e-3
"""m, from the middle line to where the lateral bands lie."""
MCP, SLIP, MERGED = -20e-3, 22e-3, 41.6e-3
"""m, z of the MCP, of the PIP (22), and where the lateral bands have met."""
JOIN = -5e-3
ADHESION = 1e6
"""N/m of each adhesion: the thesis's 1000 N/mm."""
SHEET, THIN, INSERTION = 1, 2, 3
"""Parts: `Fiber` between the tendons, `Thin tendon` and `Insertion` of the central slip."""


@dataclass(frozen=True)
class Moduli:
    """Young's moduli (Pa) by region."""

    tendon_proximal: float
    tendon_distal: float
    central_band: float
    central_slip: float
    lateral_band: float
    terminal_slip: float
    sheet: float


MEAN_SD = {
    "tendon_proximal": (76.22, 24.53),
    "tendon_distal": (53.16, 21.24),
    "central_band": (100.61, 50.82),
    "central_slip": (100.76, 46.77),
    "lateral_band": (105.38, 85.06),
    "terminal_slip": (89.67, 48.29),
    "sheet": (54.68, 14.13),
}
"""MPa: Qian et al. 2014, as in table 4 of Jadelis's thesis."""


def qian_moduli(off: float) -> Moduli:
    """Return the measured moduli, `off` standard deviations from their means."""
    return Moduli(**{name: 1e6 * (mean + off * sd) for name, (mean, sd) in MEAN_SD.items()})


@dataclass(frozen=True)
class PublishedHood:
    """What the hood says under a pull of its central tendon."""

    strain: Array
    """(ne, 3) Green-Lagrange, along and across the finger."""
    area: Array
    """(ne,) m2."""
    regions: Mapping[str, Mask]
    """The elements (ne,) of central_tendon (MCP to PIP), between_bands (MCP to where the lateral
    bands meet), the latter as far as the PIP alone (between_bands_to_pip), central_slip and
    terminal_slip."""
    slip_force: dict[str, float]
    """N, on the middle and the distal phalanx at the slips' ends."""
    imbalance: tuple[float, float]
    """Force (N) and moment (N m) by which bodies and loads miss balance."""

    def summary(self) -> dict[str, Any]:
        """As of a run, as far as it goes."""
        return {
            "slip_force_N": self.slip_force,
            "slip_ratio": self.slip_force["terminal"] / self.slip_force["central"],
            "strain_percent": self.strain_ranges("central_tendon"),
            "region_strain_percent": {"central_slip": self.strain_ranges("central_slip")},
        }

    def strain_ranges(self, region: str) -> dict[str, dict[str, float]]:
        """Least, mean (by area) and largest strain over a region, %, along and across."""
        cells = self.regions[region]
        return {"longitudinal": self._range(0, cells), "lateral": self._range(1, cells)}

    def _range(self, component: int, cells: Mask) -> dict[str, float]:
        values, area = 100 * self.strain[cells, component], self.area[cells]
        return {
            "min": float(values.min()),
            "mean": float(values @ area / area.sum()),
            "max": float(values.max()),
        }


def solve_published_hood(path: str | Path, moduli: Moduli, pull: float) -> PublishedHood:
    """The hood of the file with `moduli`, adhesions as springs and `pull` (N) at its central end,
    bending and touching as thin sheets do; the other two ends keep the file's 0.25 N.

    Raises InputError for another file, and ConvergenceError."""
    job = read_feb(path)
    if len(job.sheet.quads) != QUADS or tuple(b.name for b in job.bodies) != BODIES:
        raise InputError(
            f"{path}: is not the published hood: expected Verify/mi29.feb of FEBio's test suite, "
            f"with {QUADS} shell elements and the bodies {', '.join(BODIES)}"
        )
    job = _with_adhesions(_scale_pull(_with_moduli(job, moduli), pull))
    job = replace(job, sheet=replace(job.sheet, fibre=_along(job)))
    (state,) = solve_job(job, times=[1.0]).states
    return _observe(job, state)


def _middles(job: Job) -> Array:
    return np.asarray(job.sheet.points[job.sheet.quads].mean(axis=1))


def _along(job: Job) -> Array:
    """The unit directions (ne, 3) of the finger's axis z in the quads' planes."""
    p = job.sheet.points[job.sheet.quads]
    normal = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    out = np.array([0.0, 0, 1]) - normal[:, 2:] * normal
    return np.asarray(out / np.linalg.norm(out, axis=1, keepdims=True))


def _with_moduli(job: Job, m: Moduli) -> Job:
    x, _, z = _middles(job).T
    middle = np.abs(x - CENTRE) < HALF
    slip = (job.sheet.part == THIN) | (job.sheet.part == INSERTION)
    values = np.select(
        [job.sheet.part == SHEET, slip, z > MERGED, z < MCP, middle & (z < JOIN), middle],
        [
            m.sheet,
            m.central_slip,
            m.terminal_slip,
            m.tendon_proximal,
            m.tendon_distal,
            m.central_band,
        ],
        m.lateral_band,
    )
    kinds, part = np.unique(values, return_inverse=True)
    parts = tuple(ShellPart(f"{1e-6 * E:g} MPa", Isotropic(float(E), 0.4)) for E in kinds)
    return replace(job, sheet=replace(job.sheet, parts=parts, part=part))


def _scale_pull(job: Job, pull: float) -> Job:
    """The end with the most nodes is the central tendon's."""
    central = max(range(len(job.forces)), key=lambda i: len(job.forces[i].nodes))

    def scale_force(f: NodalForce) -> NodalForce:
        assert f.curve is not None  # the file ramps its loads
        return replace(f, force=f.force * pull / f.curve.at(1.0))

    forces = [scale_force(f) if i == central else f for i, f in enumerate(job.forces)]
    return replace(job, forces=tuple(forces))


def _with_adhesions(job: Job) -> Job:
    """Springs in place of what is tied to the proximal phalanx."""
    held = [t for t in job.ties if t.body == PROXIMAL]
    springs = tuple(_adhesion(job, t, job.bodies[PROXIMAL]) for t in held)
    kept = tuple(t for t in job.ties if t.body != PROXIMAL)
    return replace(job, ties=kept, springs=(*job.springs, *springs))


def _adhesion(job: Job, tied: Tied, body: Body) -> SpringSet:
    name = f"adhesion at node {job.sheet.node_ids[tied.nodes[0]]}"
    law, anchor = SpringLaw(ADHESION / len(tied.nodes)), job.sheet.points[tied.nodes] - body.origin
    return SpringSet.to_body(name, law, tied.nodes, tied.body, anchor, 0.0)


def _observe(job: Job, state: ShellState) -> PublishedHood:
    tie = {body: float(np.linalg.norm(state.wrench["tie"][body, :3])) for body in (MIDDLE, DISTAL)}
    return PublishedHood(
        state.fields.strain,
        state.model.tables.weight.sum(axis=1),
        regions_at(_middles(job)),
        {"central": tie[MIDDLE], "terminal": tie[DISTAL]},
        state.imbalance,
    )


def regions_at(middles: Array) -> dict[str, Mask]:
    """Return the regions in which strains are read, by the middles of a hood's cells (ne, 3), m in
    the file's axes."""
    x, _, z = middles.T
    off = np.abs(x - CENTRE)
    return {
        "central_tendon": (off < HALF) & (z > MCP) & (z < SLIP),
        "between_bands": (off < BETWEEN) & (z > MCP) & (z < MERGED),
        "between_bands_to_pip": (off < BETWEEN) & (z > MCP) & (z < SLIP),
        "central_slip": (off < HALF) & (z > SLIP - 8e-3) & (z < SLIP + 3e-3),
        "terminal_slip": z > MERGED,
    }
