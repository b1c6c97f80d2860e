"""A cantilever strip of shells as a FEBio file, of any kind of element."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fe_solver.febio.read import read_feb
from fe_solver.job.job import Job

LENGTH, WIDTH, THICK, E = 8.0, 2.0, 0.3, 100.0
"""mm and MPa."""
CORNERS = [(0, 0), (2, 0), (2, 2), (0, 2)]
MIDDLES = [(1, 0), (2, 1), (1, 2), (0, 1)]
TRIANGLES = [
    [(0, 0), (2, 0), (2, 2), (1, 0), (2, 1), (1, 1)],
    [(0, 0), (2, 2), (0, 2), (1, 1), (1, 2), (0, 1)],
]
CELLS = {
    "quad4": [CORNERS],
    "quad8": [CORNERS + MIDDLES],
    "quad9": [CORNERS + MIDDLES + [(1, 1)]],
    "tri3": [t[:3] for t in TRIANGLES],
    "tri6": TRIANGLES,
}
"""The elements of a cell of each kind: their nodes in halves of it."""
FIXED = (
    '<bc name="f" node_set="left" type="zero displacement"><x_dof>1</x_dof><y_dof>1</y_dof>'
    '<z_dof>1</z_dof></bc><bc name="s" node_set="left" type="zero shell displacement"><sx_dof>1'
    "</sx_dof><sy_dof>1</sy_dof><sz_dof>1</sz_dof></bc>"
)
BLOCK = (
    '<material id="2" name="block" type="rigid body"><density>1</density><center_of_mass>'
    f"{LENGTH},{WIDTH / 2},0</center_of_mass></material>"
)
RAMP = (
    '<load_controller id="1" type="loadcurve"><points><pt>0,0</pt><pt>1,1</pt></points>'
    "</load_controller>"
)
CONTROL = "<Control><time_steps>4</time_steps><step_size>0.25</step_size></Control>"


def strip_text(
    kind: str = "quad4",
    cells: int = 8,
    loads: str = "",
    *,
    modulus: str = f"<E>{E}</E>",
    density: str = "<density>1</density>",
    thickness: str = f"<shell_thickness>{THICK}</shell_thickness>",
    sets: str = "",
    data: str = "",
    boundary: str = FIXED,
    control: str = CONTROL,
    curves: str = RAMP,
    steps: str = "",
    bow: float = 0.0,
    nu: float = 0.0,
    rigid: str | None = None,
) -> str:
    """A strip from x = 0, where it is clamped, to LENGTH: `cells` by two cells, arched by `bow`
    (mm); its end nodes are the set "right".  With conditions `rigid` there is a rigid body, the
    block, about the end's middle."""
    number: dict[tuple[int, int], int] = {}
    rows = []
    for i in range(cells):
        for j in range(2):
            for element in CELLS[kind]:
                nodes = [(2 * i + a, 2 * j + b) for a, b in element]
                rows.append([number.setdefault(n, len(number) + 1) for n in nodes])
    x = np.array(list(number)) / (2 * cells, 4)
    z = 4 * bow * x[:, 0] * (1 - x[:, 0])
    points = np.column_stack([x * (LENGTH, WIDTH), z])
    left, right = (
        ",".join(str(n) for (a, _), n in number.items() if a == at) for at in (0, 2 * cells)
    )
    nodes = "".join(
        f'<node id="{i}">{",".join(map(repr, p))}</node>' for i, p in enumerate(points.tolist(), 1)
    )
    elements = "".join(
        f'<elem id="{i}">{",".join(map(str, row))}</elem>' for i, row in enumerate(rows, 1)
    )
    block = "" if rigid is None else BLOCK
    return f"""<?xml version="1.0"?><febio_spec version="4.0"><Module type="solid"/>{control}
<Material><material id="1" name="skin" type="isotropic elastic">{density}{modulus}<v>{nu}</v>
</material>{block}</Material>
<Mesh><Nodes name="all">{nodes}</Nodes><Elements type="{kind}" name="strip">{elements}</Elements>
<NodeSet name="left">{left}</NodeSet><NodeSet name="right">{right}</NodeSet>{sets}</Mesh>
<MeshDomains><ShellDomain name="strip" mat="skin">{thickness}</ShellDomain></MeshDomains>
<MeshData>{data}</MeshData><Boundary>{boundary}</Boundary><Rigid>{rigid or ""}</Rigid>
<Loads>{loads}</Loads>{steps}
<LoadData>{curves}</LoadData></febio_spec>"""


def quadratic_text() -> str:
    """A file of eight-node shells with formulas, maps, part lists, a weight and two steps, a tag or
    a row in a line each."""
    control = "<Control><time_steps>2</time_steps><step_size>0.25</step_size></Control>"
    load = (
        '<Loads><nodal_load node_set="@edge:end" type="nodal_force"><value lc="1">0,max(t, 0.1),-t'
        '</value></nodal_load><body_load type="body force" elem_set="@part_list:both">'
        '<force lc="2">0,0,9810</force></body_load><surface_load type="pressure" '
        'surface="@part_list:both"><pressure type="math">1e-5*t^2</pressure><shell_bottom>1'
        "</shell_bottom></surface_load></Loads>"
    )
    step = f"<step>{control}{load}</step>"
    values = "".join(f'<e lid="{i}">{100 - i}</e>' for i in range(1, 9))
    text = strip_text(
        "quad8",
        4,
        modulus='<E type="math">map_E*(1 + X/8)</E>',
        sets='<PartList name="both">strip</PartList>'
        '<Edge name="end"><line2 id="1">1,2</line2></Edge>',
        data=f'<ElementData name="map_E" elem_set="@part_list:both">{values}</ElementData>',
        control="",
        steps=f"<Step>{step}{step}</Step>",
        curves=RAMP + '<load_controller id="2" type="math-interval"><interval>0,1</interval>'
        "<math>sin(pi*t/2)</math></load_controller>",
        bow=0.4,
    )
    return text.replace("><", ">\n<")


def read_strip(folder: Path, kind: str = "quad4", cells: int = 8, loads: str = "", **more) -> Job:
    """The job of such a file."""
    path = folder / "strip.feb"
    path.write_text(strip_text(kind, cells, loads, **more))
    return read_feb(path)


def end_nodes(job: Job) -> np.ndarray:
    return np.flatnonzero(np.isclose(job.sheet.points[:, 0], 1e-3 * LENGTH))
