"""The force that each region of a sheet transmits along its fibres, through its middle.

The middle line of a region cuts elements.  The force that the region transmits there is the pull of
these elements on their nodes beyond the line: with W the energy of an element and x its nodes'
places, the sum of dW/dx over those nodes.  So the forces of all regions at one station add up to
what is pulled there, to the solver's tolerance, however coarse the mesh.  The force is positive
where the region is pulled; each element's is counted along its own line from the nodes before the
middle to those beyond.

The middle line lies halfway along a region whose fibres run along the finger, and halfway round it
where they run round (sagittal band, transverse fibres); of a region over the midline whose fibres
run round, it is the midline.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cosim.port import Array, State
from fe_solver.elements.shell import element_response
from fe_solver.hood.shell_hood import ShellHood as FeHood
from meshes.hood_mesh import REGIONS, HoodMesh, has_lateral_fibres
from meshes.hull import DIP, PIP
from meshes.region_places import region_places, turns
from meshes.skeleton import BODIES, JOINTS, Skeleton

STRIPS = {
    "PIP": ("central_slip", "lateral_band_radial", "lateral_band_ulnar"),
    "DIP": ("terminal_slip",),
}
"""By joint, regions whose force has an arm about it; over the PIP they lie beside each other."""
PAST = {"PIP": PIP + 4.1, "DIP": DIP + 4.0}
"""mm, the station at which the strips over a joint are cut: past the wings and short of where the
central slip ends; past what the flexed DIP's head presses on, short of the insertion."""
DISTAL_BONE = {"PIP": "middle", "DIP": "distal"}
"""The bone that begins at a joint's centre and on which the strips over it pull."""
SLACK_STRIP = 0.02
"""N below which a strip is slack, and its force has no line."""
ON_THE_LINE = 1e-6
"""Share of a region's extent within which a node counts as before its middle line."""


@dataclass(frozen=True)
class Crossing:
    """The elements (k,) that a line across a sheet runs through, and which of their nodes (k, 4 or
    9) lie beyond it."""

    elements: np.ndarray
    beyond: np.ndarray


def crossing(quads: np.ndarray, elements: np.ndarray, beyond: np.ndarray) -> Crossing:
    """Those of the `elements` of a mesh with `quads` (ne, 4 or 9) that have nodes on both sides of
    a line; `beyond` (n,) says which of all nodes lie beyond it."""
    side = beyond[quads[elements]]
    both = side.any(axis=1) & ~side.all(axis=1)
    return Crossing(elements[both], side[both])


def middle_crossings(mesh: HoodMesh, skeleton: Skeleton) -> dict[str, Crossing]:
    """Where the middle line of each region of the mesh runs, by its name."""
    turn, out = turns(mesh, skeleton).turn, {}
    for region in np.unique(mesh.region):
        name, elements = REGIONS[region], np.flatnonzero(mesh.region == region)
        distal, across = region_places(mesh, region, turn, mesh.station, turn)
        if not has_lateral_fibres(name):
            beyond = distal > 0.5 + ON_THE_LINE
        elif name.endswith(("_radial", "_ulnar")):
            beyond = across > 0.5 + ON_THE_LINE
        else:
            beyond = turn > ON_THE_LINE
        out[name] = crossing(mesh.quads, elements, beyond)
    return {name: line for name, line in out.items() if len(line.elements)}


def element_forces(hood: FeHood, state: State) -> Array:
    """The gradient (ne, k, 3) N of each element's energy by the places of its nodes."""
    model, c = hood.model, state.configuration
    nodes = np.concatenate([c.x[model.quads], c.d[model.quads]], axis=1)
    gradient = element_response(model.tables, model.section, nodes).gradient
    return np.asarray(gradient[:, : model.quads.shape[1]])


def crossing_force(force: Array, points: Array, quads: np.ndarray, line: Crossing) -> float:
    """The force (N) that elements pull with across a line; `force` (ne, k, 3) of all elements,
    `points` (n, 3) of the nodes."""
    placed, beyond = points[quads[line.elements]], line.beyond[..., None]
    count = line.beyond.sum(axis=1)[:, None]
    ahead = (placed * beyond).sum(axis=1) / count
    behind = (placed * ~beyond).sum(axis=1) / (beyond.shape[1] - count)
    way = (ahead - behind) / np.linalg.norm(ahead - behind, axis=1, keepdims=True)
    pull = (force[line.elements] * beyond).sum(axis=1)
    return float((pull * way).sum())


def region_forces(
    force: Array, points: Array, quads: np.ndarray, lines: Mapping[str, Crossing]
) -> dict[str, float]:
    """The force (N) that each region passes on, arguments as of `crossing_force`."""
    return {name: crossing_force(force, points, quads, line) for name, line in lines.items()}


@dataclass(frozen=True)
class JointStrips:
    """The strips over a joint: its distal bone (an index into BODIES), its axis (3,) of flexion in
    that bone's frame, and where the strips are cut just past it, by region."""

    bone: int
    axis: Array
    lines: Mapping[str, Crossing]


def joint_strips(mesh: HoodMesh, skeleton: Skeleton) -> tuple[JointStrips, ...]:
    """The strips over PIP and DIP, of those that the mesh has."""
    strips = []
    for joint, names in STRIPS.items():
        beyond = mesh.station > PAST[joint]
        cut = {n: crossing(mesh.quads, np.flatnonzero(mesh.cells(n)), beyond) for n in names}
        lines = {name: line for name, line in cut.items() if len(line.elements)}
        axis = skeleton.axis[JOINTS.index(joint)]
        strips.append(JointStrips(BODIES.index(DISTAL_BONE[joint]), axis, lines))
    return tuple(strips)


def all_strip_arms(
    hood: FeHood, state: State, force: Array, strips: Sequence[JointStrips]
) -> dict[str, float]:
    """`strip_arms` of the strips over all joints, at a state of the hood."""
    c, out = state.configuration, dict[str, float]()
    for over in strips:
        points, axis = c.x - c.position[over.bone], c.rotation[over.bone] @ over.axis
        out |= strip_arms(force, points, hood.model.quads, over.lines, axis)
    return out


def strip_arms(
    force: Array, points: Array, quads: np.ndarray, lines: Mapping[str, Crossing], axis: Array
) -> dict[str, float]:
    """The arm (m) about a joint's axis of the force that each strip passes on, by that force's line
    of action; positive where it extends, as a height over the axis is.  A slack strip has none.

    force: as of `crossing_force`; points: (n, 3) m from a point on the axis; axis: (3,) unit, of
    flexion."""
    out = {}
    for name, line in lines.items():
        pull = force[line.elements] * line.beyond[..., None]
        whole = np.linalg.norm(pull.sum(axis=(0, 1)))
        if whole > SLACK_STRIP:
            moment = np.cross(points[quads[line.elements]], pull).sum(axis=(0, 1))
            out[name] = float(moment @ axis / whole)
    return out
