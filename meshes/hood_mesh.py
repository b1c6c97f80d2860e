"""A hood mesh and its file: what a shell over the bones must say of itself.

The file is JSON, mm and degrees; `read` refuses what the solver could not use, naming the place.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.files import MB, read_bytes, write_text
from cosim.port import Array, Ints
from meshes.skeleton import BODIES, JOINTS

FORMAT = "hood mesh 1"

REGIONS = (
    "extensor_tendon_proximal",
    "extensor_tendon_distal",
    "central_band",
    "central_slip",
    "lateral_slip_radial",
    "lateral_slip_ulnar",
    "oblique_fibres_radial",
    "oblique_fibres_ulnar",
    "intrinsic_tendon_radial",
    "intrinsic_tendon_ulnar",
    "lateral_band_radial",
    "lateral_band_ulnar",
    "terminal_slip",
    "sagittal_band_radial",
    "sagittal_band_ulnar",
    "transverse_fibres_radial",
    "transverse_fibres_ulnar",
    "triangular_ligament",
)
ROUND = ("sagittal_band", "transverse_fibres", "triangular_ligament")
"""What a region's name begins with whose fibres run round the finger."""
SPRINGS = (
    "central_slip",
    "ligament_radial",
    "ligament_ulnar",
    "sagittal_radial",
    "sagittal_ulnar",
    "sagittal_hold_radial",
    "sagittal_hold_ulnar",
    "interosseous_hood_radial",
    "interosseous_hood_ulnar",
    "retinacular_radial",
    "retinacular_ulnar",
    "oblique_retinacular_radial",
    "oblique_retinacular_ulnar",
    "dorsal_capsule",
    "loose_tissue",
)
ENDS = ("central", "radial", "ulnar")
MOST_BYTES = 64 * MB
"""The largest mesh file, which takes some twenty times as much in memory."""
LARGEST_NUMBER = 1e6
"""No number of a mesh file is larger."""
SAME_PLACE = 1e-9
"""m, nodes nearer than that lie at one place."""
FOLDED = 0.01
"""Least corner of a quad over the mean of its four."""
FLAT = 0.1
"""Least square of the mean corner over the mean of their squares: less where they point apart."""


@dataclass(frozen=True)
class Attachment:
    """Hood nodes and the points of one body that springs join them to (k, 3), body frame, m, and
    how much of what they bear together is each one's (k,); None where it is the same."""

    body: str
    nodes: Ints
    anchors: Array
    shares: Array | None = None

    def of(self, on: NDArray[np.bool_], number: Ints) -> Attachment:
        """Those springs alone, their nodes by their new numbers."""
        shares = None if self.shares is None else self.shares[on]
        return Attachment(self.body, number[self.nodes[on]], self.anchors[on], shares)


@dataclass(frozen=True)
class HoodMesh:
    """A hood free of stress, at `rest_posture` (rad), in the metacarpal frame, m."""

    points: Array
    quads: Ints
    """(ne, 4), or (ne, 9) of quadratic elements: then come the middles of the edges between corners
    0 and 3, 1 and 2, 0 and 1, 3 and 2, and the element's own."""
    region: Ints
    """(ne,) index into REGIONS."""
    fibre: Array
    """(ne, 3) unit."""
    ends: Mapping[str, Ints]
    """Loaded ends: nodes that slide along the metacarpal's axis."""
    springs: Mapping[str, Attachment]
    tied: Mapping[str, Ints]
    """Nodes tied to a body, by body."""
    station: Array
    """(n,) mm, where each node was laid."""
    rest_posture: Mapping[str, float]
    reach: float
    """Distance from the MCP to the PIP centre of the finger that it was laid on, m."""
    thickness: float
    """Thickness of the sheet whose mid-surface the points are, m."""
    lift: Array | None = None
    """(n,) m, how much higher than the sheet's face each node touches a bone; None is nowhere."""
    fields: Mapping[str, Array] = field(default_factory=dict)
    """Unit directions (ne, 3) by name, which a case may give a region's fibres."""
    whole: HoodMesh | None = None
    """The mesh before its cuts, which change no size of what they leave; None is this one."""
    left: Array | None = None
    """What a cut left (ne,) of each quad's width; None is all of it."""

    def areas(self) -> Array:
        """The quads' areas (ne,) m2."""
        p = self.points[display_quads(self.quads)]
        area = np.linalg.norm(np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1]), axis=1) / 2
        return np.asarray(area.reshape(len(self.quads), -1).sum(axis=1))

    def length(self, cells: NDArray[np.bool_]) -> float:
        """Mean length (m) along the fibres of the quads `cells` (ne,): that of the mesh's own
        strips, each a chain of quads from one to the next across the fibres."""
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        quads = display_quads(self.quads[cells])
        fibre = np.repeat(self.fibre[cells], len(quads) // cells.sum(), axis=0)
        middle = (self.points[quads] + self.points[np.roll(quads, -1, axis=1)]) / 2
        spans = middle[:, [1, 2]] - middle[:, [3, 0]]  # between the middles of opposite edges
        lengths = np.linalg.norm(spans, axis=2)
        way = np.abs(np.einsum("nki,ni->nk", spans, fibre) / lengths).argmax(axis=1)
        row = np.arange(len(quads))
        # the two edges that each quad's fibres cross; quads that share such an edge are one strip
        edges = np.stack([quads, np.roll(quads, -1, axis=1)], axis=2)
        crossed = np.sort(np.concatenate([edges[row, 1 - way], edges[row, 3 - way]]), axis=1)
        _, edge = np.unique(crossed, axis=0, return_inverse=True)
        count = len(quads) + int(edge.max()) + 1
        links = coo_array(
            (np.ones(len(edge)), (np.tile(row, 2), len(quads) + edge.ravel())), (count, count)
        )
        strips = connected_components(links, directed=False, return_labels=False)
        return float(lengths[row, way].sum() / strips)

    def extent(self, region: str) -> tuple[float, float]:
        """The mean length along the fibres, and the width, m, of a region as it was laid."""
        mesh = self.whole or self
        cells = mesh.cells(region)
        length = mesh.length(cells)
        return length, float(mesh.areas()[cells].sum()) / length

    @property
    def quadratic(self) -> bool:
        """Whether its elements are quadratic."""
        return self.quads.shape[1] == 9

    def cells(self, *names: str) -> NDArray[np.bool_]:
        """Mask of the quads in the named regions."""
        return np.isin(self.region, [REGIONS.index(n) for n in names])

    def part_cells(self, name: str) -> Ints:
        """The nodes (m, k) of the quads in a region."""
        return self.quads[self.cells(name)]


def has_lateral_fibres(region: str) -> bool:
    """Whether a region's fibres run round the finger, and not along it."""
    return region.startswith(ROUND)


def display_quads(quads: Ints) -> Ints:
    """The four-node quads that show elements (ne, 4) or (ne, 9), those of an element together."""
    quarters = [[0, 6, 8, 4], [6, 1, 5, 8], [4, 8, 7, 3], [8, 5, 2, 7]]
    shown = quarters if quads.shape[1] == 9 else [[0, 1, 2, 3]]
    return np.asarray(quads[:, shown].reshape(-1, 4))


def pairs(quads: Ints) -> Ints:
    """The pairs of nodes (m, 2) of the elements (ne, 4) or (ne, 9) that join all of each one's."""
    q = display_quads(quads)
    return np.vstack([q[:, [0, 1]], q[:, [1, 2]], q[:, [2, 3]]])


def to_json(mesh: HoodMesh) -> str:
    """The mesh file's text: deterministic, mm and degrees."""
    millimetres = lambda a: np.round(np.asarray(a) * 1e3, 4).tolist()  # noqa: E731
    content: dict[str, Any] = {
        "format": FORMAT,
        "unit": "mm",
        "frame": "metacarpal: origin MCP centre, x distal, y radial, z dorsal",
        "source": "generated by meshes/hood.py; see its proportions for their sources",
        "reach": round(mesh.reach * 1e3, 4),
        "thickness": round(mesh.thickness * 1e3, 4),
        "rest_posture_deg": {
            k: round(float(np.rad2deg(v)), 6) for k, v in mesh.rest_posture.items()
        },
        "points": millimetres(mesh.points),
        "station": mesh.station.tolist(),
        "quads": mesh.quads.tolist(),
        "regions": [REGIONS[i] for i in mesh.region],
        "fibre": mesh.fibre.tolist(),
        "ends": {k: v.tolist() for k, v in mesh.ends.items()},
        "tied": {k: v.tolist() for k, v in mesh.tied.items()},
        "springs": {
            k: {"body": a.body, "nodes": a.nodes.tolist(), "anchors": millimetres(a.anchors)}
            | ({} if a.shares is None else {"shares": a.shares.tolist()})
            for k, a in mesh.springs.items()
        },
    }
    if mesh.lift is not None:
        content["lift"] = millimetres(mesh.lift)
    if mesh.fields:
        content["fields"] = {
            name: np.round(values, 6).tolist() for name, values in mesh.fields.items()
        }
    rows = [f" {json.dumps(k)}: {json.dumps(v)}" for k, v in content.items()]
    return "{\n" + ",\n".join(rows) + "\n}\n"


def write(mesh: HoodMesh, path: Path) -> None:
    """Write the mesh file, whole or not at all.  Raises InputError."""
    write_text(path, to_json(mesh))


def read(path: Path) -> HoodMesh:
    """Read a mesh file.  Raises InputError naming the file, the key and what was expected.

    >>> from importlib.resources import files
    >>> from meshes.hood_mesh import read
    >>> mesh = read(files("meshes") / "hoods" / "index_416.json")
    >>> f"{len(mesh.quads)} quads, {1e6 * mesh.areas().sum():.0f} mm2"
    '416 quads, 1387 mm2'
    """
    try:
        content = json.loads(read_bytes(Path(path), MOST_BYTES).decode("utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"hood mesh {path}: cannot be read as JSON ({error})") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InputError(f'hood mesh {path}: expected "format": "{FORMAT}"; is it a hood mesh?')
    return _Reader(str(path), content).mesh()


@dataclass(frozen=True)
class _Reader:
    path: str
    content: dict[str, Any]

    def fault(self, key: str, text: str) -> InputError:
        return InputError(f"hood mesh {self.path}: {key}: {text}")

    def array(self, value: Any, key: str, columns: int | None) -> Array:
        """Finite numbers (n, columns), or (n,) for None."""
        shape = "numbers" if columns is None else f"rows of {columns} numbers"
        try:
            out = np.array(value, dtype=float)
        except (TypeError, ValueError, OverflowError):
            raise self.fault(key, f"expected {shape}") from None
        if out.size == 0 or out.ndim != (1 if columns is None else 2):
            raise self.fault(key, f"expected {shape}")
        if columns is not None and out.shape[1] != columns:
            raise self.fault(key, f"expected {shape}")
        if not np.isfinite(out).all():
            row = int(np.argwhere(~np.isfinite(out))[0, 0])
            raise self.fault(key, f"row {row} holds a value that is not finite")
        if np.abs(out).max() > LARGEST_NUMBER:
            row = int(np.argwhere(np.abs(out) > LARGEST_NUMBER)[0, 0])
            raise self.fault(
                key, f"row {row} holds a number above {LARGEST_NUMBER:g}; lengths are in mm"
            )
        return out

    def indices(self, value: Any, key: str, count: int, columns: int | None = None) -> Ints:
        out = self.array(value, key, columns)
        if (out != np.round(out)).any() or out.min() < 0 or out.max() >= count:
            raise self.fault(key, f"expected whole numbers of nodes, 0 to {count - 1}")
        return out.astype(np.intp)

    def table(self, key: str) -> dict[str, Any]:
        value = self.content.get(key)
        if not isinstance(value, dict):
            raise self.fault(key, "expected a table of names")
        return value

    def mesh(self) -> HoodMesh:
        c = self.content
        points = self.array(c.get("points"), "points", 3) * 1e-3
        n = len(points)
        quads = self.elements(c.get("quads"), n)
        fibre = self.array(c.get("fibre"), "fibre", 3)
        region = self.regions(c.get("regions"), len(quads))
        if len(fibre) != len(quads):
            raise self.fault("fibre", f"expected one direction for each of {len(quads)} quads")
        short = np.flatnonzero(np.linalg.norm(fibre, axis=1) < 1e-6)
        if len(short):
            raise self.fault("fibre", f"quad {short[0]} has no direction; give it one in its plane")
        station = self.array(c.get("station"), "station", None)
        if len(station) != n:
            raise self.fault("station", f"expected one number for each of {n} nodes")
        posture = self.table("rest_posture_deg")
        angles = self.array([posture.get(j, 0.0) for j in JOINTS], "rest_posture_deg", None)
        ends = {k: self.indices(v, f"ends.{k}", n) for k, v in self.table("ends").items()}
        if set(ends) != set(ENDS):
            raise self.fault("ends", f"expected {', '.join(ENDS)}; got {', '.join(ends)}")
        tied = {
            self.name(k, "tied", BODIES): self.indices(v, f"tied.{k}", n)
            for k, v in self.table("tied").items()
        }
        springs = {
            self.name(k, "springs", SPRINGS): self.attachment(v, f"springs.{k}", n)
            for k, v in self.table("springs").items()
        }
        mesh = HoodMesh(
            points,
            quads,
            region,
            fibre / np.linalg.norm(fibre, axis=1, keepdims=True),
            ends,
            springs,
            tied,
            station,
            dict(zip(JOINTS, np.deg2rad(angles).tolist(), strict=True)),
            self.length("reach"),
            self.length("thickness"),
            self.lift(n),
            self.fields(len(quads)),
        )
        self.check_quads(mesh)
        self.check_whole(mesh)
        self.check_sets(mesh)
        return mesh

    def elements(self, value: Any, count: int) -> Ints:
        """Elements of four nodes, or all of nine."""
        first = value[0] if isinstance(value, list) and value else None
        nine = isinstance(first, list) and len(first) == 9
        return self.indices(value, "quads", count, 9 if nine else 4)

    def length(self, key: str) -> float:
        """A positive length in mm, as m."""
        if key not in self.content:
            raise self.fault(key, "is missing; expected a length in mm")
        (value,) = self.array([self.content[key]], key, None)
        if value <= 0:
            raise self.fault(key, f"must be positive, got {value:g} mm")
        return float(value) * 1e-3

    def lift(self, count: int) -> Array | None:
        if "lift" not in self.content:
            return None
        out = self.array(self.content["lift"], "lift", None) * 1e-3
        if len(out) != count:
            raise self.fault("lift", f"expected one number for each of {count} nodes")
        return out

    def fields(self, count: int) -> dict[str, Array]:
        """Directions by name, one for each quad."""
        out = {}
        for name, rows in (self.table("fields") if "fields" in self.content else {}).items():
            values, key = self.array(rows, f"fields.{name}", 3), f"fields.{name}"
            if len(values) != count:
                raise self.fault(key, f"expected one direction for each of {count} quads")
            length = np.linalg.norm(values, axis=1, keepdims=True)
            if (length < 1e-6).any():
                raise self.fault(key, f"quad {int(np.argmin(length))} has no direction")
            out[name] = values / length
        return out

    def name(self, value: str, key: str, known: tuple[str, ...]) -> str:
        if value not in known:
            raise self.fault(key, f'unknown name "{value}"; known are {", ".join(known)}')
        return value

    def regions(self, value: Any, count: int) -> Ints:
        if not isinstance(value, list) or len(value) != count:
            raise self.fault("regions", f"expected a list of {count} names, one for each quad")
        for i, name in enumerate(value):
            if name not in REGIONS:
                known = ", ".join(REGIONS)
                raise self.fault("regions", f"quad {i}: unknown region {name!r}; known are {known}")
        return np.array([REGIONS.index(name) for name in value])

    def attachment(self, value: Any, key: str, count: int) -> Attachment:
        if not isinstance(value, dict):
            raise self.fault(key, "expected a table with body, nodes and anchors")
        body = self.name(str(value.get("body")), f"{key}.body", BODIES)
        nodes = self.indices(value.get("nodes"), f"{key}.nodes", count)
        anchors = self.array(value.get("anchors"), f"{key}.anchors", 3) * 1e-3
        if len(anchors) != len(nodes):
            raise self.fault(key, f"{len(nodes)} nodes but {len(anchors)} anchors")
        if "shares" not in value:
            return Attachment(body, nodes, anchors)
        shares = self.array(value["shares"], f"{key}.shares", None)
        if len(shares) != len(nodes):
            raise self.fault(key, f"{len(nodes)} nodes but {len(shares)} shares")
        wrong = shares[(shares <= 0) | (shares > 1)]
        if len(wrong):
            raise self.fault(f"{key}.shares", f"must be above 0 and at most 1, got {wrong[0]:g}")
        return Attachment(body, nodes, anchors, shares)

    def check_quads(self, mesh: HoodMesh) -> None:
        """Each quad is convex, its fibre lies in it, and neighbours face the same way."""
        q = mesh.quads
        p, quads = mesh.points[q[:, :4]], display_quads(q)
        folded = are_folded(mesh.points[quads]).reshape(-1, len(quads) // len(q)).any(axis=1)
        bad = folded | (mesh.areas() < 1e-12)
        if bad.any():
            i = int(np.argmax(bad))
            raise self.fault("quads", f"quad {i} is folded or has no area; its nodes are {q[i]}")
        mean = _corners(p).mean(axis=1)
        size = np.einsum("nk,nk->n", mean, mean)
        directions = {"fibre": mesh.fibre} | {f"fields.{k}": v for k, v in mesh.fields.items()}
        for key, values in directions.items():
            upright = np.einsum("nk,nk->n", values, mean) ** 2 > 0.99 * size
            if upright.any():
                i = int(np.argmax(upright))
                raise self.fault(key, f"quad {i}: the direction stands upright on the quad")
        edges = np.concatenate([q[:, [a, (a + 1) % 4]] for a in range(4)])
        found, count = np.unique(edges, axis=0, return_counts=True)
        if (count > 1).any():
            a, b = found[np.argmax(count > 1)]
            raise self.fault(
                "quads", f"two quads run from node {a} to node {b}; neighbours must face one way"
            )

    def check_sets(self, mesh: HoodMesh) -> None:
        """No node is held in two ways."""
        sets = [
            *((f"tied.{k}", v) for k, v in mesh.tied.items()),
            ("ends", np.unique(np.concatenate(list(mesh.ends.values())))),
        ]
        sprung = [(f"springs.{k}", v.nodes) for k, v in mesh.springs.items()]
        for i, (key, nodes) in enumerate(sets):
            for other, more in (*sets[i + 1 :], *sprung):
                both = np.intersect1d(nodes, more)
                if len(both):
                    raise self.fault(key, f"node {both[0]} is also in {other}; leave it in one")

    def check_whole(self, mesh: HoodMesh) -> None:
        from scipy.spatial import cKDTree

        used = np.zeros(len(mesh.points), dtype=bool)
        used[mesh.quads] = True
        if not used.all():
            raise self.fault("points", f"node {int(np.argmin(used))} belongs to no quad; remove it")
        parts, label = _pieces(mesh)
        if parts > 1:
            lost = int(np.argmax(label != label[0]))
            raise self.fault(
                "quads", f"the hood falls into {parts} pieces (node {lost} is not joined to node 0)"
            )
        twins = cKDTree(mesh.points).query_pairs(SAME_PLACE, output_type="ndarray")
        if len(twins):
            i, j = sorted(twins[0].tolist())
            raise self.fault(
                "points", f"node {j} lies where node {i} does; merge the mesh's duplicate nodes"
            )


def are_folded(corners: Array) -> NDArray[np.bool_]:
    """Which (n,) quads (n, 4, 3) have a reflex corner, cross themselves or have no area."""
    corner = _corners(corners)
    mean = corner.mean(axis=1)
    least = np.einsum("nak,nk->na", corner, mean).min(axis=1, initial=np.inf)
    size = np.einsum("nk,nk->n", mean, mean)
    apart = FLAT * np.einsum("nak,nak->n", corner, corner) / 4
    return (least <= FOLDED * size) | (size <= apart)


def _corners(p: Array) -> Array:
    """The cross product, (n, 4, 3) for quads (n, 4, 3), of the edges that meet at each corner."""
    return np.cross(p - np.roll(p, 1, axis=1), np.roll(p, -1, axis=1) - p)


def _pieces(mesh: HoodMesh) -> tuple[int, Ints]:
    """Number of connected pieces and each node's piece."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    joined, n = pairs(mesh.quads), len(mesh.points)
    graph = coo_array((np.ones(len(joined)), tuple(joined.T)), shape=(n, n))
    return connected_components(graph, directed=False)
