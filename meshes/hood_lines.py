"""Where the lines of nodes of a generated hood run, along the finger and across it, and how such a
line shares what loads it evenly.  Stations and sources as in `meshes.hood`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Stations, mm.
CENTRAL_END = -20.0  # [mi29]
LATERAL_END = -8.0  # [An] proximal MCP points of LU and UI, -.400 x 20
JOIN = 15.0  # [An] distal MCP points, (.318 + .432) x 20
SLIP_START = 36.0  # [trial]
SLIP_END = 49.0  # [trial], 6.4 mm past the PIP
MERGE = 63.0  # [trial]
TERMINAL_END = 73.0  # [trial], 5.3 mm past the DIP
# Where each span of rows begins, and its rows in a mesh of 600 quads: many where the sheet slides
# over a head, where the lateral bands turn off the slip and in the terminal slip, few over shafts.
SPANS = (
    (CENTRAL_END, 4),
    (LATERAL_END, 5),
    (0.0, 4),
    (4.0, 4),
    (JOIN, 4),
    (SLIP_START, 3),
    (40.0, 7),
    (44.5, 3),
    (SLIP_END, 5),
    (52.5, 9),
    (MERGE, 4),
    (68.0, 10),
)
# The same of elements that are quadratic across the fibres, which need fewer columns.
QUADRATIC_SPANS = (
    (CENTRAL_END, 4),
    (LATERAL_END, 5),
    (0.0, 3),
    (4.0, 5),
    (JOIN, 3),
    (21.0, 5),
    (SLIP_START, 6),
    (40.0, 8),
    (44.5, 6),
    (SLIP_END, 4),
    (52.5, 10),
    (MERGE, 4),
    (68.0, 11),
)
CROWDED = 0.95  # of rows towards the central slip's end, where the held edge narrows it
TENDON = 0.5  # of the inner columns' half-angle, what is tendon and slip
# Quadratic elements across a lateral band: what the inner half of them has of its width, since the
# band bends in its plane where it turns off the slip.
INNERMOST = ([0.0, 0.5, 1.0], [0.0, 0.3, 1.0])


def rows(quads: int, quadratic: bool) -> Array:
    """Stations (mm) of the rows for about `quads` elements."""
    fineness = np.sqrt(quads / 600)
    spans = QUADRATIC_SPANS if quadratic else SPANS
    begins, counts = [s for s, _ in spans], [max(1, round(n * fineness)) for _, n in spans]
    ends = zip(begins, [*begins[1:], TERMINAL_END], counts, strict=True)
    laid = [_within(a, b, n, CROWDED if quadratic and b == SLIP_END else 0.0) for a, b, n in ends]
    return np.concatenate([*laid, [TERMINAL_END]])


def _within(first: float, end: float, count: int, crowded: float) -> Array:
    """Stations of `count` rows from `first` on before `end`, towards which they crowd."""
    u = np.linspace(0, 1, count, endpoint=False)
    return first + (end - first) * ((1 + crowded) * u - crowded * u * u)


def columns(quads: int, quadratic: bool) -> tuple[Array, Array]:
    """Where the lines of nodes run: across the inner sheet (-1 ulnar to 1 radial, of its
    half-angle), and across each lateral band (0 at the inner edge to 1)."""
    fineness, counts = np.sqrt(quads / 600), (3, 2, 2) if quadratic else (3, 2, 3)
    tendon, side, band = (max(1, round(n * fineness)) for n in counts)
    middle = np.linspace(0, TENDON, tendon, endpoint=False)
    half = np.concatenate([middle, np.linspace(TENDON, 1, side + 1)])
    over_band = np.linspace(0, 1, band + 1)
    if quadratic:
        half, over_band = _with_middles(half), _with_middles(np.interp(over_band, *INNERMOST))
    return np.concatenate([-half[:0:-1], half]), over_band


def _with_middles(ends: Array) -> Array:
    """The ends of elements in a row, and their middles."""
    return np.sort(np.concatenate([ends, (ends[1:] + ends[:-1]) / 2]))


def even_shares(place: Array, ends: tuple[float, float], quadratic: bool) -> Array:
    """(n,) what each node of a line at ascending places has of a load that is even between `ends`:
    by linear shape functions, or where every two spaces are an element by its quadratic ones; an
    element that is loaded in part keeps the linear ones, which leave no node a negative share."""
    inside = place[(place > ends[0]) & (place < ends[1])]
    cuts = np.concatenate([ends[:1], inside, ends[1:]])
    shapes = np.array([np.interp(cuts, place, one) for one in np.eye(len(place))])
    shares = (shapes[:, 1:] + shapes[:, :-1]) @ np.diff(cuts) / 2 / (ends[1] - ends[0])
    for i in range(1, len(place) - 1, 2) if quadratic else ():
        if ends[0] <= place[i - 1] and place[i + 1] <= ends[1]:
            more = (place[i + 1] - place[i - 1]) / (ends[1] - ends[0]) / 12
            shares[i - 1 : i + 2] += more * np.array([-1, 2, -1])
    return np.asarray(shares)
