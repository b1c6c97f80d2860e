"""What acts in the middle of the sheet, where FEBio's nodes lie on a face.

FEBio's shells have the displacement of the back face (sx, sy, sz) beside that of the nodes.  A
linear constraint (FEBio user manual 4, 3.11.19) gives a node of no element the mean of both, at
which springs then pull; or it lets both faces move against each other, so that the middle stands
still.  A force is put half on the nodes and half on the back (`shell_bottom`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cosim.errors import InputError
from cosim.port import Array
from fe_solver.febio.bodies import AXES, Model
from fe_solver.febio.xml import Element, FebTag, tag
from fe_solver.job.job import Job, PrescribedDisplacement
from fe_solver.job.model import move_to_mid_surface
from fe_solver.sheet import Sheet

CONSTRAINT = "linear constraint"
FAR = 1e-7
"""m from the middle of the sheet, at which a node is not in it."""
WANTED = (
    "a linear constraint is read where it puts a node of no element in the middle of the sheet "
    "(half a shell node's x and half its sx, and so y and z), or holds it over a shell node (x: -1 "
    "times its sx)"
)


def middle_of(sheet: Sheet) -> Array:
    """The middle (n, 3) m of the sheet over each of its nodes."""
    return sheet.moved(sheet.height)


def constraint_tag(node: int, axis: str, children: Sequence[tuple[int, str, float]]) -> Element:
    """A displacement of a node as the sum of others' (node, degree of freedom, factor)."""
    rows = [
        tag("child_dof", tag("node", n), tag("dof", dof), tag("value", factor))
        for n, dof, factor in children
    ]
    return tag("bc", tag("node", node), tag("dof", axis), *rows, type=CONSTRAINT)


def mean_tags(node: int, of: int) -> Iterator[Element]:
    """The constraints by which a node is in the middle over another, a shell's."""
    for axis in AXES:
        yield constraint_tag(node, axis, [(of, axis, 0.5), (of, f"s{axis}", 0.5)])


def held_tag(node: int, axis: str) -> Element:
    """The constraint by which the middle over a shell's node does not move along an axis."""
    return constraint_tag(node, axis, [(node, f"s{axis}", -1.0)])


@dataclass
class Middle:
    """What a file has in the middle of the sheet."""

    nodes: dict[int, int] = field(default_factory=dict)
    """Indices in the mesh of nodes in the middle, and in the sheet of those that they are over."""
    held: list[list[int]] = field(default_factory=lambda: [[], [], []])
    """By axis, the nodes of the sheet whose middle is held."""

    def supports(self) -> Iterator[PrescribedDisplacement]:
        """What holds the middle."""
        for component, nodes in enumerate(self.held):
            if nodes:
                yield PrescribedDisplacement(
                    np.array(nodes), component, name=f"held {AXES[component]}"
                )


def read_middle(model: Model, sheet: Sheet, boundary: Sequence[FebTag]) -> Middle:
    """What the linear constraints of a file say; nodes in the middle become the sheet's in
    `model.shell`.  Raises InputError for a constraint of any other kind."""
    out, index = Middle(), {int(n): i for i, n in enumerate(model.mesh.node_ids)}
    means: dict[int, dict[str, int]] = {}
    places = middle_of(sheet) / model.units.length
    for t in (t for t in boundary if t.attribute("type") == CONSTRAINT):
        node, axis = _node(index, t), t.word("dof", "")
        children = {c.word("dof", ""): c for c in t.all("child_dof")}
        of = {_node(index, c): c for c in children.values()}
        factors = {dof: c.value("value", 1.0) for dof, c in children.items()}
        over = int(model.shell[next(iter(of), node)])
        if axis not in tuple(AXES) or len(of) != 1 or over < 0 or t.value("offset", 0.0):
            raise t.fault(WANTED)
        if model.shell[node] == over and factors == {f"s{axis}": -1.0}:
            out.held[AXES.index(axis)].append(over)
        elif model.shell[node] < 0 and factors == {axis: 0.5, f"s{axis}": 0.5}:
            means.setdefault(node, {})[axis] = over
            far = np.linalg.norm(model.mesh.points[node] - places[over]) * model.units.length
            if len(set(means[node].values())) > 1 or far > FAR:
                raise t.fault(f"{WANTED}; this node lies elsewhere")
        else:
            raise t.fault(WANTED)
    for node, by_axis in means.items():
        if len(by_axis) < len(AXES):
            raise InputError(
                f"node {model.mesh.node_ids[node]}: {WANTED}; it has but {len(by_axis)}"
            )
        out.nodes[node] = next(iter(by_axis.values()))
    for node, over in out.nodes.items():
        model.shell[node] = over
    return out


def _node(index: Mapping[int, int], t: FebTag) -> int:
    """The index of the one node that a tag names.  Raises InputError."""
    t.tabled = True
    numbers = [] if t.rows is None else [int(n) for n in t.rows.values]
    if len(numbers) == 1 and numbers[0] in index:
        return index[numbers[0]]
    raise t.fault("expected <node> with the number of a node")


def check_middle(
    model: Model,
    middle: Middle,
    boundary: Sequence[FebTag],
    springs: Sequence[FebTag],
    loads: Sequence[FebTag],
) -> bool:
    """Whether what holds and loads the sheet acts in its middle.  Raises InputError where some of
    it does and some acts at a face."""
    backs = [t for t in loads if t.flag("shell_bottom")]
    if not (middle.nodes or any(middle.held) or backs):
        return False
    fronts = [t for t in loads if t not in backs]
    differ = sorted(map(_said, backs)) != sorted(map(_said, fronts))
    at_face = [*backs, *fronts] if differ else []
    at_face += [t for t in boundary if t.attribute("type") not in (CONSTRAINT, "rigid")]
    for t in springs:
        ends = model.mesh.discrete.get(t.attribute("discrete_set"), np.zeros((0, 2), dtype=np.intp))
        if ((model.shell[ends] >= 0) & ~np.isin(ends, [*middle.nodes])).any():
            at_face.append(t)
    if at_face:
        raise at_face[0].fault(
            "this acts at a face of the sheet, and other springs, loads or supports of the file in "
            "its middle (linear constraints, loads with and without shell_bottom): not both are "
            "read in one file"
        )
    return True


def _said(t: FebTag) -> tuple[str, ...]:
    """What a load says, but for its face."""
    inner = (c for c in t.children if c.name != "shell_bottom")
    said = [(c.name, c.attributes.get("lc", ""), " ".join(c.text.split())) for c in inner]
    return (t.attribute("type"), t.attribute("node_set"), *map(str, sorted(said)))


def moved_to_middle(job: Job) -> Job:
    """The job with its nodes, which are on a face, in the middle of the sheet; its springs' lengths
    are those of there already."""
    return replace(move_to_mid_surface(job), springs=job.springs)
