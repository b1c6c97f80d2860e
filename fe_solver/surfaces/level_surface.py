"""The triangles of a level of a field on a grid, by surface nets (Gibson 1998, MICCAI, LNCS
1496:888): a vertex in each cell that the level passes, four joined round each edge that it cuts."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.port import Array, Ints

CORNERS = np.array(list(itertools.product((0, 1), repeat=3)))
EDGES = [(a, b) for a, b in itertools.combinations(CORNERS, 2) if np.abs(a - b).sum() == 1]


def level_surface(values: Array, origin: Array, spacing: float) -> tuple[Array, Ints]:
    """Vertices (nv, 3) m and triangles (nt, 3), wound outwards, of where values (nx, ny, nz) at the
    nodes of a grid pass zero: positive outside, as they are all over the grid's border.

    >>> import numpy as np
    >>> from fe_solver.surfaces.closing import volume
    >>> from fe_solver.surfaces.level_surface import level_surface
    >>> x = np.arange(-12, 13) / 10
    >>> ball = np.linalg.norm(np.stack(np.meshgrid(x, x, x)), axis=0) - 1
    >>> inside = volume(*level_surface(ball, x[[0, 0, 0]], 0.1))
    >>> bool(abs(inside / (4 / 3 * np.pi) - 1) < 0.02)
    True
    """
    cells = np.array(values.shape) - 1
    corner = {tuple(c): _from(values, c, cells) for c in CORNERS}
    place, cuts = np.zeros((*cells, 3)), np.zeros(cells)
    for a, b in EDGES:
        low, high = corner[tuple(a)], corner[tuple(b)]
        cut = (low < 0) != (high < 0)
        share = low / np.where(cut, low - high, 1.0)
        place += cut[..., None] * (a + share[..., None] * (b - a))
        cuts += cut
    number = np.full(cells, -1)
    number[cuts > 0] = np.arange((cuts > 0).sum())
    at = np.argwhere(cuts > 0) + place[cuts > 0] / cuts[cuts > 0][:, None]
    quads = [_around(values < 0, number, axis) for axis in range(3)]
    a, b, c, d = np.concatenate(quads).T
    return origin + spacing * at, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def _from(values: NDArray[Any], first: Ints, count: Ints) -> NDArray[Any]:
    return values[tuple(slice(i, i + n) for i, n in zip(first, count, strict=True))]


def _around(inside: NDArray[np.bool_], number: Ints, axis: int) -> Ints:
    """The cells' numbers (k, 4) round each cut edge along an axis, right-handed about the way
    out."""
    step = np.eye(3, dtype=int)
    one, two = step[(axis + 1) % 3], step[(axis + 2) % 3]
    count = np.array(number.shape) - one - two
    ring = [_from(number, first, count) for first in (0 * one, one, one + two, two)]
    begin = _from(inside, one + two, count)
    end = _from(inside, one + two + step[axis], count)
    quads = np.stack(ring, axis=-1)
    return np.concatenate([quads[begin & ~end], quads[end & ~begin][:, ::-1]])
