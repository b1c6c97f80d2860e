"""Jobs whose nodes lie on a face of the sheet, moved to its mid-surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cosim.port import Array
from fe_solver.job.job import Job
from fe_solver.job.model import corner_means
from fe_solver.supports import SpringSet


def move_to_mid_surface(job: Job) -> Job:
    """The same sheet in the same place, with what holds and loads it acting on its mid-surface;
    springs keep their slack.

    A force F along a face of a sheet of thickness t is a couple F t / 2 on it.  Where that is many
    times the sheet's bending stiffness E t^3 / 12, as a point spring's on a thin sheet, the sheet
    turns about the point until the couple is gone, which no mesh of elements longer than thick can
    follow."""
    sheet = job.sheet
    height = corner_means(sheet.quads, sheet.height, len(sheet.points))
    points = sheet.points + height[:, None] * sheet.directors
    springs = tuple(_move(job, s, points) for s in job.springs)
    moved = replace(sheet, points=points, height=sheet.height - height[sheet.quads])
    return replace(job, sheet=moved, springs=springs)


def _move(job: Job, s: SpringSet, points: Array) -> SpringSet:
    before, after = (_lengths(job, s, x) for x in (job.sheet.points, points))
    return replace(s, length=s.length + after - before)


def _lengths(job: Job, s: SpringSet, points: Array) -> Array:
    """(k,) m of the springs with the sheet at rest."""
    origin = np.array([b.origin for b in job.bodies] or [np.zeros(3)])
    end = np.where((s.body >= 0)[:, None], origin[s.body] + s.anchor, points[s.other])
    return np.asarray(np.linalg.norm(points[s.nodes] - end, axis=1))
