"""Whether a user's hood is one: quads, winding, pieces; its scale, axes and place beside a finger.

Faults are sentences for people; quads and nodes are counted from 0 in the file's order.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import permutations, product

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Ints
from meshes.hood_lines import CENTRAL_END, INTRINSIC_END, TERMINAL_END
from meshes.hood_mesh import are_folded
from meshes.hull import Centreline, along

UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
"""m."""
SPAN = (0.45, 1.9)
"""Least and largest ratio of a hood's longest side to the finger from MCP to tip; our own hood's is
0.9 to 1.1."""
WARPED = np.deg2rad(30.0)
"""Between the normals of a quad's two halves."""
CLEARLY = 0.5
"""Other axes are named where the landmarks' distances are less than that with them."""
NEAR_OWN = 12e-3
"""m, mean distance of the landmarks from our own hood's."""
DORSAL = {"end_central": 9e-3, "tied_distal": 2.5e-3}
"""m above the chain of joint centres, of our own hood."""
BESIDE = {"radial": (-2.5e-3, 8.6e-3), "ulnar": (-1.8e-3, -8.3e-3)}
"""m dorsal and radial of it, the ends of our own hood's intrinsic tendons."""
AXES = "xyz"


@dataclass(frozen=True)
class Placing:
    """How a file's numbers become ours: x = axes (file's - origin) unit."""

    unit: str = "mm"
    axes: Array = field(default_factory=lambda: np.eye(3))
    """(3, 3) rows distal, radial, dorsal in the file's axes."""
    origin: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) of the MCP's centre, in the file's unit and axes."""

    def of(self, points: Array) -> Array:
        """The points (n, 3) m in the metacarpal's frame."""
        return np.asarray((points - self.origin) @ self.axes.T * UNITS[self.unit])

    @property
    def mirrors(self) -> bool:
        """Whether the placing mirrors the mesh."""
        return bool(np.linalg.det(self.axes) < 0)


def parse_axes(text: str) -> Array:
    """The matrix (3, 3) whose rows are our x (distal), y (radial), z (dorsal) in the file's axes,
    of a text like "z -x y".  Raises InputError."""
    words = text.split()
    out = np.zeros((3, 3))
    if len(words) == 3 and sorted(word.lstrip("+-") for word in words) == list(AXES):
        for i, word in enumerate(words):
            out[i, AXES.index(word[-1])] = -1.0 if word.startswith("-") else 1.0
        return out
    raise InputError(
        f"--axes {text!r}: write which axes of the file run distal, radial and dorsal, each of x, "
        'y, z once, for example "z -x y"'
    )


def axes_text(axes: Array) -> str:
    """The inverse of `parse_axes`."""
    at = np.abs(axes).argmax(axis=1)
    return " ".join(f"{'-' if axes[i, k] < 0 else ''}{AXES[k]}" for i, k in enumerate(at))


def scale_fault(extent: float, unit: str, reach: float) -> str:
    """Empty where a hood `extent` long (in its file's numbers) fits a finger of `reach` m."""
    ratio = extent * UNITS[unit] / reach
    if SPAN[0] <= ratio <= SPAN[1]:
        return ""
    fits = [u for u, m in UNITS.items() if SPAN[0] <= extent * m / reach <= SPAN[1]]
    hint = f"it would fit in {' or '.join(fits)}: --unit {fits[0]}" if fits else (
        "no unit of " + ", ".join(UNITS) + " makes it fit")  # fmt: skip
    return (
        f"the hood is {extent:.4g} {unit} long and the finger {1e3 * reach:.4g} mm from MCP to "
        f"tip; {hint}"
    )


def quad_faults(points: Array, quads: Ints) -> list[str]:
    """List what no hood can have among points (n, 3) and quads (ne, 4), a triangle as (a, b, c,
    c)."""
    out = []
    triangle = quads[:, 2] == quads[:, 3]
    if triangle.any():
        out.append(
            f"{triangle.sum()} of {len(quads)} cells are triangles, the first is cell "
            f"{np.argmax(triangle)}; a hood is made of quads alone: recombine them, or mesh anew"
        )
    own = np.sort(quads[~triangle], axis=1)
    doubled = (own[:, 1:] == own[:, :-1]).any(axis=1)
    if doubled.any():
        first = np.flatnonzero(~triangle)[np.argmax(doubled)]
        out.append(f"{doubled.sum()} quads name a node twice, the first is quad {first}")
    _, first, times = np.unique(
        np.sort(quads, axis=1), axis=0, return_index=True, return_counts=True
    )
    if (times > 1).any():
        out.append(
            f"{(times > 1).sum()} cells are there twice, the first is cell "
            f"{first[np.argmax(times > 1)]}; remove the doubles"
        )
    bad = are_folded(points[quads[~triangle]])
    if bad.any():
        those = np.flatnonzero(~triangle)[bad]
        more = ", ..." if len(those) > 8 else ""
        out.append(
            f"{len(those)} quads have a reflex corner, cross themselves or have no area: quads "
            f"{', '.join(map(str, those[:8]))}{more} (nodes of the first: "
            f"{quads[those[0]].tolist()}); order the nodes around them, or mesh anew"
        )
    return out


def count_warped(points: Array, quads: Ints) -> int:
    """Number of quads whose two halves meet at a large angle."""
    p = points[quads]
    one = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    two = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 0])
    size = np.linalg.norm(one, axis=1) * np.linalg.norm(two, axis=1)
    cosine = np.einsum("nk,nk->n", one, two) / np.maximum(size, 1e-30)
    return int((cosine < np.cos(WARPED)).sum())


def wind_alike(cells: Ints) -> tuple[Ints, Ints]:
    """The cells (ne, 3 or 4) all wound as the first of their piece, and the numbers of those turned
    over.

    Raises InputError where more than two meet at an edge, or they close to a Moebius band."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    edges, pair = _neighbours(cells)
    n, (i, j) = len(cells), pair.T // cells.shape[1]
    against = edges[pair[:, 0], 0] == edges[pair[:, 1], 0]  # both run along it in one sense
    if not against.any():
        return cells, np.zeros(0, dtype=np.intp)
    both = np.concatenate([i, j]), np.concatenate([j, i])
    graph = coo_array((np.ones(2 * len(i)), both), shape=(n, n)).tocsr()
    clash = dict(zip(zip(*both, strict=True), np.tile(against, 2), strict=True))
    flip = np.zeros(n, dtype=bool)
    parts, label = connected_components(graph, directed=False)
    for part in range(parts):
        order, before = breadth_first_order(graph, int(np.argmax(label == part)), directed=False)
        for k in order[1:]:
            flip[k] = flip[before[k]] ^ clash[(before[k], k)]
    if (flip[i] ^ flip[j] ^ against).any():
        raise InputError("the cells close to a one-sided band (Moebius); no side of it is outside")
    return np.where(flip[:, None], cells[:, ::-1], cells), np.flatnonzero(flip)


def _neighbours(cells: Ints) -> tuple[Ints, Ints]:
    """Directed edges (m, 2), those of a cell in a row, and pairs (k, 2) of them that are one edge.

    Raises InputError where more than two cells share one."""
    edges = np.stack([cells, np.roll(cells, -1, axis=1)], axis=2).reshape(-1, 2)
    _, number, times = np.unique(
        np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    number = number.reshape(-1)
    if (times > 2).any():
        a, b = edges[np.flatnonzero(number == np.argmax(times > 2))[0]]
        raise InputError(
            f"{times.max()} cells meet at the edge from node {a} to node {b}; a sheet has two "
            "at most"
        )
    inner = np.flatnonzero(times[number] == 2)
    return edges, inner[np.argsort(number[inner], kind="stable")].reshape(-1, 2)


def piece_faults(points: Array, quads: Ints, size: float) -> list[str]:
    """Pieces that do not hang together and nodes at one place; `size`: a length of the mesh."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    used = np.unique(quads)
    twins = cKDTree(points[used]).query_pairs(1e-7 * size, output_type="ndarray")
    if len(twins):
        a, b = sorted(used[twins[0]].tolist())
        return [
            f"{len(twins)} pairs of nodes lie at one place, the first are {a} and {b}, so that "
            "the sheet is not joined there; merge them"
        ]
    pairs = np.vstack([quads[:, [0, 1]], quads[:, [1, 2]], quads[:, [2, 3]]])
    n = len(points)
    graph = coo_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(n, n))
    _, label = connected_components(graph, directed=False)
    own, counts = np.unique(label[quads[:, 0]], return_counts=True)
    if len(own) == 1:
        return []
    sizes = ", ".join(str(count) for count in sorted(counts, reverse=True)[:8])
    lost = int(quads[np.argmax(label[quads[:, 0]] != own[counts.argmax()]), 0])
    return [
        f"the hood falls into {len(own)} pieces of {sizes} quads; node {lost} is not joined to "
        "the largest: join them, or leave the small ones out"
    ]


def landmarks(chain: Centreline) -> dict[str, Array]:
    """Where the ends of our own hood lie on a finger, m, in the metacarpal's frame."""
    s = along(chain.skeleton, np.array([CENTRAL_END, TERMINAL_END]))
    places = {
        "end_central": (s[0], DORSAL["end_central"], 0.0),
        "tied_distal": (s[1], DORSAL["tied_distal"], 0.0),
    }
    beyond = along(chain.skeleton, np.array([INTRINSIC_END]))[0]
    for side, (dorsal, radial) in BESIDE.items():
        places[f"end_{side}"] = (beyond, dorsal, radial)
    return {
        name: chain.at(np.array([x]), np.array([dorsal]), np.array([radial]))[0]
        for name, (x, dorsal, radial) in places.items()
    }


def axes_fault(found: Mapping[str, Array], chain: Centreline, axes: Array) -> tuple[str, Array]:
    """What is wrong with the axes (3, 3) by which the landmarks `found` (m, ours) were turned, if
    anything, and how far (3,) m the hood then lies from where ours would."""
    aims = landmarks(chain)
    names = [name for name in aims if name in found]
    here = np.array([found[name] for name in names])
    there = np.array([aims[name] for name in names])
    shift = here.mean(axis=0) - there.mean(axis=0)
    here, there = here - here.mean(axis=0), there - there.mean(axis=0)

    def miss(turn: Array) -> float:
        return float(np.linalg.norm(here @ turn.T - there, axis=1).mean())

    across = found["end_radial"] - found["end_ulnar"]
    best = min((turn for turn in _all_turns() if turn[1] @ across > 0), key=miss)
    own = miss(np.eye(3))
    if across[1] > 0 and miss(best) > CLEARLY * own:
        if own > NEAR_OWN:
            return (
                f"the hood's ends lie {1e3 * own:.0f} mm in the mean from where they would on this "
                "finger, whichever way it is turned; check --posture, --unit and --axes"
            ), shift
        return "", shift
    right = axes_text(best @ axes)
    if np.linalg.det(best) < 0:
        return (
            "the hood is mirrored: its radial side lies ulnar (a left hand?), or two of its axes "
            f'are swapped. What fits is --axes "{right}", which '
            + (
                "mirrors it into a right hand"
                if np.linalg.det(best @ axes) < 0
                else "mirrors nothing"
            )
        ), shift
    return f'the hood\'s axes are not distal, radial, dorsal; what fits is --axes "{right}"', shift


def _all_turns() -> list[Array]:
    """The 48 ways to permute and mirror axes."""
    eye = np.eye(3)
    return [
        eye[list(order)] * np.array(signs)[:, None]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]


def other_origin(placing: Placing, shift: Array) -> str:
    """What to say of a hood that lies `shift` (3,) m off its place."""
    ours = placing.origin + placing.axes.T @ shift / UNITS[placing.unit]
    where = " ".join(f"{x:.4g}" for x in ours)
    return (
        f"the hood lies {1e3 * np.linalg.norm(shift):.0f} mm from where it would on this finger: "
        f"the MCP's centre is not at --origin; by the hood's ends it is near --origin \"{where}\" "
        "(in the file's unit and axes), to be measured on the bones"
    )
