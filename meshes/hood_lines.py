"""Where the lines of nodes of a generated hood run, along the finger and across it, and how such a
line shares what loads it evenly.  Stations and sources as in `meshes.hood`."""

from __future__ import annotations

import numpy as np

from cosim.port import Array
from meshes.hull import PIP

# Stations, mm.
CENTRAL_END = -20.0  # [mi29]
LATERAL_END = -8.0  # [An] proximal MCP points of LU and UI, -.400 x 20
JOIN = 15.0  # [An] distal MCP points, (.318 + .432) x 20
HOOD_END = 9.4  # of the transverse fibres; [mi29] 7 to 13
INTRINSIC_END = HOOD_END  # of the intrinsic tendons; they run on as ropes (assumption)
SLIP_START = 36.0  # [trial]
OBLIQUE_END = PIP + 2.5  # of the wings, past the head of the proximal phalanx (assumption)
SLIP_END = 49.0  # [trial], 6.4 mm past the PIP
# Of the triangular ligament, at most; [mi29] 49 to 67.  Where bands meet it would come to a point.
TRIANGLE_START, TRIANGLE_END = 52.5, 59.5
MERGE = 63.0  # [trial]
TERMINAL_END = 73.0  # [trial], 5.3 mm past the DIP
# What holds the sheet, from and to.
SAGITTAL_ROWS = (-3.5, 3.5)  # [trial]
LIGAMENT_ROWS = (JOIN, JOIN + 5.25)  # of the adhesion under a lateral band [trial]
RETINACULAR_ROWS = (PIP - 2.5, PIP + 2.5)
OBLIQUE_ROWS = (PIP + 4.0, PIP + 6.0)  # [El-Gammal]
CAPSULE_ROWS = (PIP - 2.5, PIP + 2.5)  # assumption
# Each line on which something begins or ends, how many rows there are to the next one in the
# coarsest mesh, and how much they crowd towards its end: many rows where the sheet slides over a
# head in some posture (`meshes.coarseness`), and where the lateral bands turn off the slip.
SPANS = (
    (CENTRAL_END, 1, 0.3),
    (LATERAL_END, 1, 0.0),
    (SAGITTAL_ROWS[0], 2, 0.0),
    (SAGITTAL_ROWS[1], 1, 0.0),
    (HOOD_END, 1, 0.0),
    (JOIN, 1, 0.0),
    (LIGAMENT_ROWS[1], 3, 0.5),
    (SLIP_START, 2, 0.2),
    (RETINACULAR_ROWS[0], 3, 0.0),
    (RETINACULAR_ROWS[1], 2, 0.0),
    (SLIP_END, 1, 0.0),
    (TRIANGLE_START, 2, 0.0),
    (TRIANGLE_END, 1, 0.0),
    (MERGE, 2, 0.0),
    (68.0, 1, 0.0),
)
COARSEST = 104
"""Four-node elements, about, of a mesh with that many rows."""
CROWDED = 0.95  # of quadratic rows towards the central slip's end, where the held edge narrows it
TENDON = 0.5  # of the inner columns' half-angle, what is tendon and slip


def fineness(quads: int, quadratic: bool = False) -> int:
    """Return the whole number by which the coarsest mesh's rows and columns are multiplied for
    about `quads` four-node elements, or for quadratic ones, half again as wide.

    >>> from meshes.hood_lines import fineness
    >>> [fineness(quads) for quads in (120, 250, 900, 1500)]
    [1, 2, 3, 4]
    """
    times = max(1, round(np.sqrt(quads / COARSEST)))
    return max(1, round(2 * times / 3)) if quadratic else times


def quads_of(times: int, quadratic: bool = False) -> int:
    """Return the four-node elements, about, for which `fineness` is that whole number.

    >>> from meshes.hood_lines import quads_of
    >>> [quads_of(times) for times in (1, 2, 3, 4)]
    [104, 416, 936, 1664]
    """
    linear: int = round(3 * times / 2) if quadratic else times
    return COARSEST * linear**2


def rows(quads: int, quadratic: bool) -> Array:
    """Stations (mm) of the rows of nodes for about `quads` elements; every second one runs through
    the middles of quadratic elements.  Each mesh has the lines of SPANS, and as many times the
    coarsest one's rows between them as it is fine."""
    times = fineness(quads, quadratic)
    begins = [begin for begin, _, _ in SPANS]
    laid = [
        _within(a, b, n * times, CROWDED if quadratic and b == SLIP_END else crowd)
        for (a, n, crowd), b in zip(SPANS, [*begins[1:], TERMINAL_END], strict=True)
    ]
    lines = np.concatenate([*laid, [TERMINAL_END]])
    return _with_middles(lines) if quadratic else lines


def _within(first: float, end: float, count: int, crowded: float) -> Array:
    """Stations of `count` rows from `first` on before `end`, towards which they crowd."""
    u = np.linspace(0, 1, count, endpoint=False)
    return first + (end - first) * ((1 + crowded) * u - crowded * u * u)


def columns(quads: int, quadratic: bool) -> tuple[Array, Array, Array]:
    """Where the lines of nodes run: across the inner sheet (-1 ulnar to 1 radial, of its
    half-angle), across each lateral band (0 at the inner edge to 1), and across the triangular
    ligament (-1 to 1)."""
    times = fineness(quads, quadratic)
    middle = np.linspace(0, TENDON, times, endpoint=False)
    half = np.concatenate([middle, np.linspace(TENDON, 1, times + 1)])
    over_band = np.linspace(0, 1, times + 1)
    triangle = np.linspace(-1, 1, 2 * times + 1)
    if quadratic:
        half, over_band, triangle = map(_with_middles, (half, over_band, triangle))
    return np.concatenate([-half[:0:-1], half]), over_band, triangle


def _with_middles(ends: Array) -> Array:
    """The ends of elements in a row, and their middles."""
    return np.sort(np.concatenate([ends, (ends[1:] + ends[:-1]) / 2]))


def even_shares(place: Array, ends: tuple[float, float], quadratic: bool) -> Array:
    """The share (n,) that each node of a line at ascending places has of a load that is even
    between `ends`: by linear shape functions, or where every two spaces are an element by its
    quadratic ones; an element that is loaded in part keeps the linear ones, which leave no node a
    negative share."""
    inside = place[(place > ends[0]) & (place < ends[1])]
    cuts = np.concatenate([ends[:1], inside, ends[1:]])
    shapes = np.array([np.interp(cuts, place, one) for one in np.eye(len(place))])
    shares = (shapes[:, 1:] + shapes[:, :-1]) @ np.diff(cuts) / 2 / (ends[1] - ends[0])
    for i in range(1, len(place) - 1, 2) if quadratic else ():
        if ends[0] <= place[i - 1] and place[i + 1] <= ends[1]:
            more = (place[i + 1] - place[i - 1]) / (ends[1] - ends[0]) / 12
            shares[i - 1 : i + 2] += more * np.array([-1, 2, -1])
    return np.asarray(shares)
