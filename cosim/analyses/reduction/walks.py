"""Postures and loads in which a hood is sampled for a reduction, as walks from one to the next.

A grid of postures, between its points more of them by Sobol's sequences, and others at random that
are held out of the fit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from cosim.analyses.reduction.samples import Walk
from cosim.port import Array

GRID = {"MCP": (0.0, 22.0, 45.0), "PIP": (10.0, 32.0, 55.0), "DIP": (5.0, 20.0, 35.0)}
"""deg."""
LOW = 0.5
"""N, of a tendon's least load."""
MIXED = ((0.5,), (0.3, 0.1, 0.6))
"""Parts of the greatest loads, tendon by tendon and from the first again, where all pull."""
SPREAD, NEAR_ENDS = 512, 0.25
"""Postures spread over the grid's box in which each tendon pulls alone, and how many of them lie
nearer to its ends (arcsine distribution), where a polynomial errs most."""
ALONE_PARTS, MIXTURE_PARTS = (0.25, 1.0), (0.05, 0.65)
"""Ranges of the parts of the greatest loads: of tendons that pull alone, and where all pull."""
LEG = 24
"""Postures on a walk between the grid's points."""
SPREAD_SEED = 7
"""Seed of the first tendon's scrambled Sobol sequence; the other tendons' follow."""
HELD, HELD_PARTS, HELD_MIXED, SEED = 10, (0.3, 1.0), (0.1, 0.6), 2
"""Held out: so many postures at random within the grid for each tendon alone and for mixtures, each
with loads at random between these parts of the greatest."""


@dataclass(frozen=True)
class SampleRange:
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
    spread: int = SPREAD
    """Postures between the grid's points for each tendon alone; a third more for mixtures."""

    @property
    def mixtures(self) -> int:
        """The number of postures between the grid's points in which all tendons pull."""
        return 4 * self.spread // 3

    def postures(self, degrees: Array) -> Array:
        """Postures (p, n) rad: the grid's joints at (p, k) deg, the others at home."""
        postures = np.tile(self.home, (len(degrees), 1))
        postures[:, [self.joints.index(joint) for joint in self.grid]] = np.radians(degrees)
        return postures

    def inside(self, parts: Array) -> Array:
        """Angles (p, k) deg at parts (p, k) of the grid's box, 0 to 1."""
        low, high = np.array([[min(axis), max(axis)] for axis in self.grid.values()]).T
        degrees: Array = low + parts * (high - low)
        return degrees

    def single(self, tendon: int, parts: Array) -> Array:
        """Loads (p, m) N: one tendon at these parts (p,) of its greatest load, the others at
        rest."""
        loads = np.full((len(parts), len(self.most)), self.rest)
        loads[:, tendon] = parts * self.most[tendon]
        return loads


def grid_walks(within: SampleRange) -> list[Walk]:
    """A walk for each angle of the grid's first joint and each tendon, to and fro through the
    others, loaded and nearly not; and one for each mixture."""
    first, *others = within.grid.values()
    lines = _to_and_fro(others)
    most, unloaded = within.most, np.full(len(within.most), within.rest)
    loads = [
        np.array([full, np.where(full > within.rest, np.minimum(LOW, full / 2), full)])
        for full in np.where(np.eye(len(most)) > 0, most, within.rest)
    ]
    loads[0] = np.vstack([loads[0], unloaded])
    loads += [most[None] * np.resize(mixture, len(most)) for mixture in MIXED]
    walks = []
    for angle in first:
        postures = within.postures(np.column_stack([np.full(len(lines), angle), lines]))
        walks += [Walk(postures, load) for load in loads]
    return walks


def spread_walks(within: SampleRange) -> list[Walk]:
    """Between the grid's points: each tendon alone and mixtures, every posture with a load of its
    own, by Sobol's sequences."""
    count, tendons = len(within.grid), len(within.most)
    walks = []
    for k in range(tendons):
        for points in _spread(count, _sobol(count + 1, within.spread, SPREAD_SEED + k)):
            loads = within.single(k, _between(ALONE_PARTS, points[:, count]))
            walks += _legs(within, points[:, :count], loads)
    for points in _spread(count, _sobol(count + tendons, within.mixtures, SPREAD_SEED + tendons)):
        loads = within.most * _between(MIXTURE_PARTS, points[:, count:])
        walks += _legs(within, points[:, :count], loads)
    return walks


def held_out_walks(within: SampleRange) -> list[Walk]:
    """Each tendon alone and mixtures, every posture and its load drawn at random."""
    random, walks = np.random.default_rng(SEED), []
    count, tendons = len(within.grid), len(within.most)
    for k in range(tendons):
        points = random.random((HELD, count + 1))
        loads = within.single(k, _between(HELD_PARTS, points[:, count]))
        walks += _legs(within, points[:, :count], loads)
    points = random.random((HELD, count + tendons))
    loads = within.most * _between(HELD_MIXED, points[:, count:])
    return walks + _legs(within, points[:, :count], loads)


def _between(ends: tuple[float, float], parts: Array) -> Array:
    out: Array = ends[0] + (ends[1] - ends[0]) * parts
    return out


def _legs(within: SampleRange, points: Array, loads: Array) -> list[Walk]:
    """Walks from posture to near posture, each with its load (p, m) N; points (p, k) 0 to 1."""
    way, postures = _nearest_order(points), within.postures(within.inside(points))
    legs = [way[k : k + LEG] for k in range(0, len(way), LEG)]
    return [Walk(postures[leg], loads[leg, None]) for leg in legs]


def _to_and_fro(axes: Sequence[Sequence[float]]) -> Array:
    """All combinations (p, k), each one step from the one before."""
    lines = np.zeros((1, 0))
    for axis in axes:
        turns = [axis if i % 2 == 0 else axis[::-1] for i in range(len(lines))]
        lines = np.array(
            [[*line, value] for line, turn in zip(lines, turns, strict=True) for value in turn]
        )
    return lines


def _spread(count: int, points: Array) -> list[Array]:
    """Evenly spread, and the last of them with their first `count` numbers nearer to 0 and 1."""
    evenly, near_ends = np.split(points.copy(), [round((1 - NEAR_ENDS) * len(points))])
    near_ends[:, :count] = (1 - np.cos(np.pi * near_ends[:, :count])) / 2
    return [part for part in (evenly, near_ends) if len(part)]


def _sobol(dimension: int, count: int, seed: int) -> Array:
    """Points (count, dimension) between 0 and 1: the first of so many as balance."""
    drawn = qmc.Sobol(dimension, scramble=True, seed=seed).random_base2((count - 1).bit_length())
    return np.asarray(drawn[:count])


def _nearest_order(points: Array) -> list[int]:
    """The points' numbers, each followed by the nearest of those left; first that of least sum."""
    left = [int(k) for k in np.argsort(points.sum(axis=1))]
    way = [left.pop(0)]
    while left:
        far = np.abs(points[left] - points[way[-1]]).max(axis=1)
        way.append(left.pop(int(far.argmin())))
    return way
