"""What a solved Job leaves behind: a summary, and its states for ParaView, in a folder that is
whole or not there."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from cosim.files import output_folder
from cosim.port import Array, Ints, rotation_vector
from fe_solver.elements.mitc9 import IN_TURN
from fe_solver.job.free_bodies import load_wrenches
from fe_solver.job.job import STANDING, Job
from fe_solver.job.solve import JobResult, JobState

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


def body_reactions(job: Job, state: JobState) -> dict[str, Array]:
    """The force and the couple about its origin (6,) N and N m with which what gives a body's
    motions acts on it, by the names of bodies with any that is given; zero where equilibrium finds
    the motion.

    With what holds the sheet itself (`reactions`, but those of ties to these bodies) they balance
    what is applied."""
    c, step = state.configuration, job.step_at(state.time) if job.steps else 0
    borne = np.asarray(sum(state.wrench.values()))
    borne = borne + load_wrenches(job.rigid_loads, state.time, c.rotation)[0]
    return {
        b.name: np.where(b.free, 0.0, -borne[i]) + 0.0
        for i, b in enumerate(b.during(step) for b in job.bodies)
        if b is not STANDING and not all(b.free)
    }


def _holds(job: Job) -> Iterator[tuple[str, tuple[int, ...] | None, Ints, list[int]]]:
    """The conditions: name, steps, nodes (k,) and which of force and couple they bear."""
    for i, t in enumerate(job.ties, 1):
        yield t.name or f"tied {i} to {job.bodies[t.body].name}", t.steps, t.nodes, [*range(6)]
    for i, h in enumerate(job.held, 1):
        yield h.name or f"held {i} along {AXES[h.component]}", h.steps, h.nodes, [h.component]
    for i, d in enumerate(job.held_directors, 1):
        yield d.name or f"held directors {i}", d.steps, d.nodes, [3, 4, 5]


SUMMARY = "summary.json"


def displacement(job: Job, state: JobState) -> Array:
    """The displacements (n, 3) m of the nodes."""
    return np.asarray(state.configuration.x - job.sheet.points)


def farthest(job: Job, state: JobState) -> tuple[float, int]:
    """The largest displacement, m, and the number of its node in the file."""
    size = np.linalg.norm(displacement(job, state), axis=1)
    return float(size.max()), int(job.sheet.node_ids[size.argmax()])


def body_motions(job: Job, state: JobState) -> dict[str, tuple[Array, Array]]:
    """By name of the bodies that equilibrium moves: displacement of the origin (3,) m, and the
    rotation vector (3,) degrees, of turns beyond half of one the shorter way."""
    c, step = state.configuration, job.step_at(state.time) if job.steps else 0
    return {
        b.name: (c.position[i] - b.origin, np.degrees(rotation_vector(c.rotation[i])))
        for i, b in enumerate(b.during(step) for b in job.bodies)
        if any(b.free)
    }


def state_summary(job: Job, state: JobState) -> dict[str, Any]:
    """The numbers one asks for first; keys end in their unit."""
    largest, node = farthest(job, state)
    springs = {
        s.name: {
            "largest_N": float(f.max(initial=0.0)),
            "sum_N": float(f.sum()),
            "active": int((f != 0).sum()),
            "springs": len(f),
        }
        for s, f in zip(job.springs, state.spring_forces, strict=True)
    }
    held = reactions(job, state.reaction, state.time)
    bodies = {
        name: {f"{source}_N": w[i, :3].tolist() for source, w in state.wrench.items() if w[i].any()}
        for i, name in enumerate(state.bodies)
    }
    return {
        "time": state.time,
        "largest_displacement_mm": 1e3 * largest,
        "largest_displacement_node": node,
        "force_on_bodies": bodies,
        "motion_of_bodies": {
            name: {"displacement_mm": (1e3 * at).tolist(), "rotation_deg": turned.tolist()}
            for name, (at, turned) in body_motions(job, state).items()
        },
        "reactions": {r.condition: {"force_N": r.force.sum(axis=0).tolist()} for r in held},
        "reactions_of_bodies": {
            name: {"force_N": w[:3].tolist(), "moment_Nmm": (1e3 * w[3:]).tolist()}
            for name, w in body_reactions(job, state).items()
        },
        "springs": springs,
        "penetration_um": 1e6 * state.penetration,
        "applied_N": state.applied[:3].tolist(),
        "residual_N": state.residual,
        "force_imbalance_N": state.imbalance[0],
        "moment_imbalance_Nmm": 1e3 * state.imbalance[1],
        "iterations": state.effort.iterations,
        "linear_solves": state.effort.solves,
        "steps": state.effort.steps,
        "cpu_s": state.effort.cpu_s,
    }


def summary(result: JobResult) -> dict[str, Any]:
    """All states, what was left out of the file, and what it cost."""
    e = result.effort
    return {
        "job": result.job.name,
        "element": result.element,
        "nodes": len(result.job.sheet.points),
        "elements": len(result.job.sheet.quads),
        "states": [state_summary(result.job, s) for s in result.states],
        "contacts": [
            {
                "pair": t.pair,
                "body": t.body,
                "touched": t.touched,
                "smallest_gap_mm": 1e3 * t.nearest if np.isfinite(t.nearest) else None,
            }
            for t in result.touches
        ],
        "setup_cpu_s": result.setup_s,
        "solve_cpu_s": e.cpu_s,
        "failed_steps": e.failures,
        "relaxations": e.relaxations,
        "notes": list(result.job.notes),
    }


def write_job(folder: Path | str, result: JobResult) -> Path:
    """Write summary.json, springs.csv, reactions.csv, a .vtu of each state with a .pvd of all, and
    an .xdmf.

    The folder appears whole, in the place of an earlier result, or not at all.  Raises InputError
    where it cannot be written."""
    target = Path(folder)
    with output_folder(target, SUMMARY) as part:
        _write_files(part, result)
    return target


def _write_files(folder: Path, result: JobResult) -> None:
    import meshio

    text = json.dumps(summary(result), indent=2, allow_nan=False)
    (folder / SUMMARY).write_text(text + "\n", encoding="utf-8")
    cells = _Cells(result.job)
    frames = []
    for i, state in enumerate(result.states):
        name = f"state_{i:03d}.vtu"
        points, data = point_data(result.job, state), cells.split(cell_data(result.job, state))
        mesh = meshio.Mesh(state.configuration.x, cells.blocks, points, data)
        mesh.write(folder / name, file_format="vtu")
        _add_body_reactions(folder / name, body_reactions(result.job, state))
        frames.append(f'<DataSet timestep="{state.time!r}" part="0" file="{name}"/>')
    lines = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "<Collection>"]
    lines += [*frames, "</Collection>", "</VTKFile>", ""]
    (folder / "states.pvd").write_text("\n".join(lines), encoding="utf-8")
    _write_xdmf(folder / "states.xdmf", result, cells)
    if result.job.springs:
        _write_springs(folder / "springs.csv", result)
    if result.job.ties or result.job.held or result.job.bodies:
        _write_reactions(folder / "reactions.csv", result)


def _add_body_reactions(path: Path, reaction: Mapping[str, Array]) -> None:
    """Add the reactions (6,) of bodies to a .vtu as field data, which meshio does not write."""
    mark, content = b"<UnstructuredGrid>", path.read_bytes()
    arrays = "".join(
        f'<DataArray type="Float64" Name={quoteattr(f"reaction of {name}")} NumberOfTuples="1" '
        f'NumberOfComponents="6" format="ascii">{" ".join(map(repr, w.tolist()))}</DataArray>'
        for name, w in reaction.items()
    )
    if arrays:
        field = f"<FieldData>{arrays}</FieldData>".encode()
        path.write_bytes(content.replace(mark, mark + b"\n" + field, 1))


def _write_reactions(path: Path, result: JobResult) -> None:
    """A row for each node that a condition holds in each state: the force and the couple about the
    node with which the condition acts on the sheet; and one without a node for each body of given
    motions, about its origin."""
    with path.open("w", encoding="utf-8", newline="") as stream:
        out = csv.writer(stream)
        names = [f"force_{a}_N" for a in AXES] + [f"couple_{a}_Nmm" for a in AXES]
        out.writerow(["time", "condition", "node", *names])
        for state in result.states:
            for r in reactions(result.job, state.reaction, state.time):
                values = np.concatenate([r.force, 1e3 * r.couple], axis=1) + 0.0
                for node, row in zip(result.job.sheet.node_ids[r.nodes], values, strict=True):
                    out.writerow([repr(state.time), r.condition, node, *map(repr, row.tolist())])
            for name, w in body_reactions(result.job, state).items():
                values = w * np.repeat([1.0, 1e3], 3)
                out.writerow([repr(state.time), f"body {name}", "", *map(repr, values.tolist())])


def _write_springs(path: Path, result: JobResult) -> None:
    """A row for each spring in each state: nodes by their numbers, force in N."""
    job = result.job
    with path.open("w", encoding="utf-8", newline="") as stream:
        out = csv.writer(stream)
        out.writerow(["time", "set", "node", "end", "force_N"])
        for state in result.states:
            for s, force in zip(job.springs, state.spring_forces, strict=True):
                ends = [
                    job.bodies[b].name if b >= 0 else f"node {job.sheet.node_ids[n]}"
                    for b, n in zip(s.body, s.other, strict=True)
                ]
                for node, end, f in zip(
                    job.sheet.node_ids[s.nodes], ends, force.tolist(), strict=True
                ):
                    out.writerow([repr(state.time), s.name, node, end, repr(f + 0.0)])


def _write_xdmf(path: Path, result: JobResult, cells: _Cells) -> None:
    """The mesh at rest with the displacement; numbers as text, so that it is one file."""
    from meshio.xdmf import TimeSeriesWriter

    with TimeSeriesWriter(path, data_format="XML") as writer:
        writer.write_points_cells(result.job.sheet.points, cells.blocks)
        for state in result.states:
            data = cells.split(cell_data(result.job, state))
            writer.write_data(state.time, point_data=point_data(result.job, state), cell_data=data)


class _Cells:
    """Quads, of four nodes or nine, and triangles as meshio has them, apart."""

    def __init__(self, job: Job) -> None:
        quads = job.sheet.quads
        triangle = quads[:, 2] == quads[:, 3]
        kinds = [("quad", ~triangle, [0, 1, 2, 3]), ("triangle", triangle, [0, 1, 2])]
        if quads.shape[1] == 9:
            kinds = [("quad9", ~triangle, IN_TURN)]
        self._rows = [np.flatnonzero(mask) for _, mask, _ in kinds if mask.any()]
        self.blocks = [(kind, quads[mask][:, nodes]) for kind, mask, nodes in kinds if mask.any()]

    def split(self, data: Mapping[str, Array]) -> dict[str, list[Array]]:
        return {name: [values[rows] for rows in self._rows] for name, values in data.items()}


def point_data(job: Job, state: JobState) -> dict[str, Array]:
    """Arrays (n,) and (n, 3) by name, SI units."""
    return {
        "displacement": displacement(job, state),
        "director": state.configuration.d,
        "contact_pressure": state.contact_pressure,
        "reaction": state.reaction[:, :3],
        "reaction_couple": state.reaction[:, 3:],
        "node": job.sheet.node_ids.astype(float),
    }


def cell_data(job: Job, state: JobState) -> dict[str, Array]:
    """Arrays (ne,) and (ne, 3) by name: means of the mid-surface, local axes 1 along the fibre."""
    means = state.fields
    return {
        "strain": means.strain,
        "stress": means.stress,
        "face_strain": np.column_stack([means.faces, np.zeros(len(means.faces))]),
        "part": job.sheet.part.astype(float),
        "element": job.sheet.element_ids.astype(float),
    }
