"""What acts in the middle of the sheet, where FEBio's nodes lie on a face.

FEBio's shells have the displacement of the back face (sx, sy, sz) beside that of the nodes.  A
linear constraint (FEBio user manual 4, 3.11.19) gives a node of no element the mean of both, at
which springs then pull; or it lets both faces move against each other, so that the middle stands
still.  A force is put half on the nodes and half on the back (`shell_bottom`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cosim.errors import InputError
from cosim.port import Ints
from fe_solver.febio.bodies import AXES, Model
from fe_solver.febio.xml import Element, FebTag, tag
from fe_solver.job.job import PrescribedDisplacement
from fe_solver.sheet import Sheet

CONSTRAINT = "linear constraint"
FAR = 1e-7
"""m from the middle of the sheet, at which a node is not in it."""
WANTED = (
    "a linear constraint is read where it puts a node of no element in the middle of the sheet "
    "(half a shell node's x and half its sx, and so y and z), or holds it over a shell node (x: -1 "
    "times its sx)"
)


def constraint_tag(node: int, axis: str, front: float, back: float, of: int) -> Element:
    """A displacement of a node as a sum of factors times those of both faces over a shell's."""
    children = [
        tag("child_dof", tag("node", of), tag("dof", dof), tag("value", factor))
        for dof, factor in ((axis, front), (f"s{axis}", back))
        if factor
    ]
    return tag("bc", tag("node", node), tag("dof", axis), *children, type=CONSTRAINT)


def read_middle(
    model: Model, sheet: Sheet, boundary: Sequence[FebTag]
) -> tuple[list[int], list[PrescribedDisplacement]]:
    """What the linear constraints of a file say: its nodes in the middle, which become the sheet's
    in `model.shell`, and what holds the middle.  Raises InputError for any other constraint."""
    index, places = (
        {int(n): i for i, n in enumerate(model.mesh.node_ids)},
        sheet.moved(sheet.height),
    )
    means: dict[int, dict[str, int]] = {}
    held: dict[str, list[int]] = {axis: [] for axis in AXES}
    for t in (t for t in boundary if t.attribute("type") == CONSTRAINT):
        node, axis = _node(index, t), t.word("dof", "")
        children = t.all("child_dof")
        of = {_node(index, c) for c in children} or {node}
        factors = {c.word("dof", ""): c.value("value", 1.0) for c in children}
        over = int(model.shell[min(of)])
        is_of_one = axis in held and len(of) == 1 and over >= 0 and not t.value("offset", 0.0)
        if is_of_one and model.shell[node] == over and factors == {f"s{axis}": -1.0}:
            held[axis].append(over)
            continue
        means.setdefault(node, {})[axis] = over
        far = np.linalg.norm(model.mesh.points[node] * model.units.length - places[over])
        is_mean = is_of_one and factors == {axis: 0.5, f"s{axis}": 0.5}
        if not is_mean or model.shell[node] >= 0 or far > FAR or len({*means[node].values()}) > 1:
            raise t.fault(WANTED)
    for node, by_axis in means.items():
        if len(by_axis) < len(AXES):
            raise InputError(f"node {model.mesh.node_ids[node]}: {WANTED}; it lacks an axis")
        model.shell[node] = by_axis["x"]
    supports = [
        PrescribedDisplacement(np.array(nodes), AXES.index(axis), name=f"held {axis}")
        for axis, nodes in held.items()
        if nodes
    ]
    return [*means], supports


def shell_nodes(node_ids: Ints, boundary: Sequence[FebTag]) -> Ints:
    """The index (n,) of each node of a mesh, of one in the middle that of the shell's over it."""
    index, out = {int(n): i for i, n in enumerate(node_ids)}, np.arange(len(node_ids))
    for t in (t for t in boundary if t.attributes.get("type") == CONSTRAINT):
        for child in t.all("child_dof"):
            out[_node(index, t)] = _node(index, child)
    return out


def _node(index: Mapping[int, int], t: FebTag) -> int:
    """The index of the one node that a tag names.  Raises InputError."""
    t.tabled = True
    numbers = [] if t.rows is None else [int(n) for n in t.rows.values]
    if len(numbers) == 1 and numbers[0] in index:
        return index[numbers[0]]
    raise t.fault("expected <node> with the number of a node")


def is_in_middle(
    model: Model,
    nodes: Sequence[int],
    boundary: Sequence[FebTag],
    springs: Sequence[FebTag],
    loads: Sequence[FebTag],
) -> bool:
    """Whether what holds and loads the sheet acts in its middle, where springs end at `nodes`.
    Raises InputError where some of it does and some acts at a face."""
    backs = [t for t in loads if t.flag("shell_bottom")]
    if not backs and not any(t.attribute("type") == CONSTRAINT for t in boundary):
        return False
    fronts = [t for t in loads if t not in backs]
    differ = sorted(map(_said, backs)) != sorted(map(_said, fronts))
    at_face = [*backs, *fronts] if differ else []
    at_face += [t for t in boundary if t.attribute("type") not in (CONSTRAINT, "rigid")]
    for t in springs:
        ends = model.mesh.discrete.get(t.attribute("discrete_set"), np.zeros((0, 2), dtype=np.intp))
        if ((model.shell[ends] >= 0) & ~np.isin(ends, nodes)).any():
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
