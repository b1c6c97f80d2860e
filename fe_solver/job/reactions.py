"""What each condition of a job holds the sheet with, by node."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cosim.port import Array, Ints
from fe_solver.job.job import Job

AXES = "xyz"


@dataclass(frozen=True)
class Reaction:
    """The forces and couples of one condition on the sheet."""

    condition: str
    nodes: Ints
    """(k,) indices in the sheet, in ascending order."""
    force: Array
    """(k, 3) N on each of them."""
    couple: Array
    """(k, 3) N m on each of them, about the node."""


def reactions(job: Job, reaction: Array, time: float | None = None) -> list[Reaction]:
    """The supports' forces and couples on the nodes, `reaction` (n, 6) N and N m, by the conditions
    that bear them; those of one name together.

    What two conditions hold alike is the first one's.  Conditions without a name are numbered; with
    a `time` (s), those in force at it are given."""
    step = None if time is None else job.step_at(time)
    parts: dict[str, Array] = {}
    left = reaction.copy()
    for name, steps, nodes, components in _holds(job):
        if step is not None and steps is not None and step not in steps:
            continue
        part = parts.setdefault(name, np.full_like(reaction, np.nan))
        part[nodes] = np.nan_to_num(part[nodes])
        rows = np.ix_(nodes, np.array(components))
        part[rows] += left[rows]
        left[rows] = 0.0
    out = []
    for name, part in parts.items():
        nodes = np.flatnonzero(~np.isnan(part[:, 0]))
        out.append(Reaction(name, nodes, part[nodes, :3], part[nodes, 3:]))
    return out


def _holds(job: Job) -> Iterator[tuple[str, tuple[int, ...] | None, Ints, list[int]]]:
    """The conditions: name, steps, nodes (k,) and which of force and couple they bear."""
    for i, t in enumerate(job.ties, 1):
        yield t.name or f"tied {i} to {job.bodies[t.body].name}", t.steps, t.nodes, [*range(6)]
    for i, h in enumerate(job.held, 1):
        yield h.name or f"held {i} along {AXES[h.component]}", h.steps, h.nodes, [h.component]
    for i, d in enumerate(job.held_directors, 1):
        yield d.name or f"held directors {i}", d.steps, d.nodes, [3, 4, 5]
