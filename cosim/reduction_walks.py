"""Postures and loads in which a hood is sampled for a reduction, as walks from one to the next.

A grid of postures, between its points more of them by Sobol's sequences, and others at random that
are held out of the fit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from cosim.port import Array
from cosim.reduction_samples import Walk

GRID = {"MCP": (0.0, 30.0, 60.0), "PIP": (10.0, 32.0, 55.0), "DIP": (5.0, 20.0, 35.0)}
"""deg."""
LOW = 0.5
"""N, of a tendon's least load."""
MIXED = ((0.5,), (0.3, 0.1, 0.6))
"""Of the greatest loads, tendon by tendon and from the first again: all pull."""
ALONE_SPREAD, ALONE_LEG = 32, 16
"""Postures spread over the grid's box in which each tendon pulls alone, and how many of them a walk
passes."""
MIXTURES, MIXTURE_POSTURES, LEAST_PART, MOST_PART = 16, 8, 0.05, 0.65
"""Mixtures of loads spread over these parts of the greatest, and each one's own postures."""
SPREAD_SEEDS = (7, 21, 22)
"""Of the scrambled Sobol sequences: postures alone, postures of mixtures, mixtures."""
HELD_POSTURES, HELD_LOAD, SEED = 8, 0.9, 2
"""Held out: postures at random within the grid, with each tendon at this part of its load, and a
mixture at random."""


@dataclass(frozen=True)
class Within:
    """Where and how far a hood is sampled; n joints, k of them with a grid, m tendons."""

    joints: tuple[str, ...]
    home: Array
    """(n,) rad, of the joints without a grid."""
    grid: Mapping[str, tuple[float, ...]]
    """deg by joint, in the order of `joints`."""
    most: Array
    """(m,) N, the greatest loads."""
    rest: float
    """N, of a tendon that does not pull."""

    def postures(self, degrees: Array) -> Array:
        """(p, n) rad: the grid's joints at (p, k) deg, the others at home."""
        found = np.tile(self.home, (len(degrees), 1))
        found[:, [self.joints.index(joint) for joint in self.grid]] = np.radians(degrees)
        return found

    def inside(self, parts: Array) -> Array:
        """(p, k) deg at parts (p, k) of the grid's box, 0 to 1."""
        low, high = np.array([[min(axis), max(axis)] for axis in self.grid.values()]).T
        found: Array = low + parts * (high - low)
        return found

    def alone(self, part: float) -> Array:
        """(m, m) N: each tendon at this part of its greatest load, the others at rest."""
        return np.where(np.eye(len(self.most)) > 0, part * self.most, self.rest)


def grid_walks(within: Within) -> list[Walk]:
    """A walk for each angle of the grid's first joint and each tendon, to and fro through the
    others, loaded and nearly not; and one for each mixture."""
    first, *others = within.grid.values()
    lines = _to_and_fro(others)
    most, unloaded = within.most, np.full(len(within.most), within.rest)
    loads = [
        np.array([full, np.where(full > within.rest, np.minimum(LOW, full / 2), full)])
        for full in within.alone(1.0)
    ]
    loads[0] = np.vstack([loads[0], unloaded])
    loads += [most[None] * np.resize(mixture, len(most)) for mixture in MIXED]
    walks = []
    for angle in first:
        postures = within.postures(np.column_stack([np.full(len(lines), angle), lines]))
        walks += [Walk(postures, load) for load in loads]
    return walks


def spread_walks(within: Within) -> list[Walk]:
    """Between the grid's points: each tendon alone, and mixtures, each in postures of its own, by
    Sobol's sequences."""
    count = len(within.grid)
    at_alone, at_mixed, of_mixed = SPREAD_SEEDS
    alone = _chained(within.inside(_sobol(count, ALONE_SPREAD, at_alone)))
    legs = [alone[k : k + ALONE_LEG] for k in range(0, ALONE_SPREAD, ALONE_LEG)]
    walks = [Walk(within.postures(leg), load[None]) for leg in legs for load in within.alone(1.0)]
    mixed = within.inside(_sobol(count, MIXTURES * MIXTURE_POSTURES, at_mixed))
    parts = LEAST_PART + (MOST_PART - LEAST_PART) * _sobol(len(within.most), MIXTURES, of_mixed)
    for k, part in enumerate(parts):
        here = within.postures(_chained(mixed[k::MIXTURES]))
        walks.append(Walk(here, (within.most * part)[None]))
    return walks


def held_walks(within: Within) -> list[Walk]:
    """A walk for each load through postures at random within the grid."""
    random = np.random.default_rng(SEED)
    parts = np.array([random.random(HELD_POSTURES) for _ in within.grid]).T
    postures = within.postures(within.inside(parts))
    postures = postures[np.argsort(postures.sum(axis=1))]
    mixture = within.most * random.uniform(0.1, 0.6, len(within.most))
    return [Walk(postures, load[None]) for load in (*within.alone(HELD_LOAD), mixture)]


def _to_and_fro(axes: Sequence[Sequence[float]]) -> Array:
    """(p, k) all combinations, each one step from the one before."""
    lines = np.zeros((1, 0))
    for axis in axes:
        turns = [axis if i % 2 == 0 else axis[::-1] for i in range(len(lines))]
        lines = np.array(
            [[*line, value] for line, turn in zip(lines, turns, strict=True) for value in turn]
        )
    return lines


def _sobol(dimension: int, count: int, seed: int) -> Array:
    """(count, dimension) between 0 and 1."""
    return np.asarray(qmc.Sobol(dimension, scramble=True, seed=seed).random(count))


def _chained(points: Array) -> Array:
    """The points, each followed by the nearest of those left; first the one of least sum."""
    left = list(np.argsort(points.sum(axis=1)))
    way = [left.pop(0)]
    while left:
        far = np.abs(points[left] - points[way[-1]]).max(axis=1)
        way.append(left.pop(int(far.argmin())))
    return points[way]
