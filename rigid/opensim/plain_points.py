"""Path points that come and go, or move in their body, as plain points; and what that changes.

MuJoCo's tendons run through points that are fixed.  Of all ways to keep or leave out the points
that are there only in a range of a coordinate, that is taken whose length is nearest to OpenSim's
over the coordinates' ranges.  The lengths compared are those of straight lines between the points.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import mujoco
import numpy as np

from cosim.port import Array
from rigid.opensim.components import GROUND
from rigid.opensim.mjcf import mjcf_xml
from rigid.opensim.paths import Point, Way, point_wraps
from rigid.opensim.skeleton import OsimSkeleton

RANDOM, SWEEP = 60, 41
"""Postures within all ranges, and along each coordinate that a point depends on."""
MOST_CHOICES = 6
"""Points that come and go, of which every choice is tried; of more all or none."""
STEEP, LEAST_JUMP = 4.0, 1e-3
"""A step of a sweep that is so many times as long as those beside it, and so many m more."""
MOST_RANGE = 2 * np.pi
"""rad or m; a wider range is none of motion: there every path winds up."""
SEED = 1


class Postures:
    """Where the bodies of a skeleton stand at sampled coordinates, and how long tendons are."""

    def __init__(self, skeleton: OsimSkeleton, ways: Mapping[str, Way] = MappingProxyType({})):
        self.skeleton = skeleton
        self.model = mujoco.MjModel.from_xml_string(mjcf_xml("s", (0, 0, 0), skeleton, ways, ()))
        self.data = mujoco.MjData(self.model)
        self.rng = np.random.default_rng(SEED)

    def sample(self, coordinates: Sequence[str]) -> list[dict[str, float]]:
        """Values of all coordinates (rad, m): at random, and along each of those named with the
        others at their defaults."""
        known = self.skeleton.coordinates
        free = [c for c in known.values() if not c.locked]
        rest = {c.name: c.default for c in known.values()}
        random = [
            rest | {c.name: float(self.rng.uniform(*c.range)) for c in free} for _ in range(RANDOM)
        ]
        sweeps = [
            rest | {name: float(value)}
            for name in coordinates
            if not known[name].locked
            for value in np.linspace(*known[name].range, SWEEP)
        ]
        return [*random, *sweeps]

    def lengths(self, values: Mapping[str, float]) -> Array:
        """The lengths (m) of the tendons."""
        self._pose(values)
        mujoco.mj_tendon(self.model, self.data)
        return self.data.ten_length.copy()

    def place(self, values: dict[str, float], points: Sequence[Point]) -> Array:
        """The points (n, 3) m in the world; those that move where they are then."""
        self._pose(values)
        out = []
        for point in points:
            name = self.skeleton.bodies[point.body].tag.name if point.body != GROUND else "world"
            body = self.data.body(name)
            out.append(body.xpos + body.xmat.reshape(3, 3) @ point.at(values))
        return np.array(out)

    def _pose(self, values: Mapping[str, float]) -> None:
        for name, value in values.items():
            if name in self.skeleton.moving:
                self.data.joint(name).qpos[0] = value
        for screw in self.skeleton.followers:
            assert screw.curve is not None
            self.data.joint(screw.name).qpos[0] = screw.curve(values[screw.coordinate])
        mujoco.mj_kinematics(self.model, self.data)


def jumps(skeleton: OsimSkeleton, ways: Mapping[str, Way]) -> dict[str, float]:
    """By how much (m) the length of a tendon jumps, of those that do as one coordinate moves
    through its range: where a path changes the side on which it passes a surface."""
    postures = Postures(skeleton, ways)
    found: dict[str, float] = {}
    for name in skeleton.moving:
        low, high = skeleton.coordinates[name].range
        if high - low > MOST_RANGE:
            continue
        sweep = postures.sample([name])[RANDOM:]
        steps = np.diff([postures.lengths(values) for values in sweep], axis=0)
        beside = np.pad(np.abs(steps), ((1, 1), (0, 0)), mode="reflect")
        much = np.abs(steps) - STEEP * np.maximum(beside[:-2], beside[2:])
        for tendon, most in zip(ways, much.max(axis=0), strict=True):
            if most > LEAST_JUMP:
                at = np.abs(steps[:, list(ways).index(tendon)]).max()
                found[tendon] = max(float(at), found.get(tendon, 0.0))
    return found


def as_plain(way: Way, postures: Postures) -> tuple[Way, float]:
    """The way with plain points alone, and by how much (m) its straight length is off OpenSim's at
    most."""
    coming = [i for i, point in enumerate(way.points) if point.shown is not None]
    of = {p.shown[0] for p in way.points if p.shown} | {
        name for p in way.points for name in p.moved_by
    }
    samples = postures.sample(sorted(of))
    fixed = [
        replace(p, position=np.mean([p.at(values) for values in samples], axis=0), moves=None)
        for p in way.points
    ]
    true = np.array([_length(postures.place(v, _there(way.points, v))) for v in samples])
    choices = list(itertools.product((True, False), repeat=min(len(coming), MOST_CHOICES)))
    if len(coming) > MOST_CHOICES:
        choices = [(True,) * len(coming), (False,) * len(coming)]
    best: tuple[float, list[int]] = (np.inf, [])
    for choice in choices:
        left = {i for i, is_kept in zip(coming, choice, strict=True) if not is_kept}
        kept = [i for i in range(len(fixed)) if i not in left]
        lengths = [_length(postures.place(v, [fixed[i] for i in kept])) for v in samples]
        best = min(best, (float(np.abs(lengths - true).max()), kept), key=lambda pair: pair[0])
    error, kept = best
    points = tuple(replace(fixed[i], shown=None) for i in kept)
    return Way(points, point_wraps(way, kept), way.changes), error


def _there(points: Sequence[Point], values: dict[str, float]) -> list[Point]:
    return [p for p in points if p.shown is None or p.shown[1] <= values[p.shown[0]] <= p.shown[2]]


def _length(places: Array) -> float:
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
