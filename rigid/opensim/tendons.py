"""OpenSim's paths as MuJoCo's tendons, and by how much this changes their lengths.

A tendon of MuJoCo runs through points that are always there, round one sphere or cylinder a
segment.  Points that come and go are kept or left out, whichever is nearer over the ranges of
motion; of the surfaces on a segment that is kept which bends it most; ellipsoids and tori have
stand-ins.  What this changes is measured whole, as MuJoCo's length against that of OpenSim's path
pulled tight, at postures at random and along each coordinate that moves it.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
import numpy.typing as npt
from numpy.polynomial.polynomial import polyval

from cosim.port import Array
from rigid.opensim.components import GROUND, Transform
from rigid.opensim.joints import Coordinate
from rigid.opensim.mjcf import Coupling, mjcf_xml
from rigid.opensim.paths import Point, Surface, Tendon, Use, Way, Wrap
from rigid.opensim.skeleton import OsimSkeleton
from rigid.opensim.stand_ins import StandIn, stand_in_ellipsoid, stand_in_torus
from rigid.opensim.wrapping import Laid, tight_length

RANDOM, SWEEP = 60, 21
"""Postures within all ranges, and along each coordinate."""
MOST_CHOICES = 6
"""Points that come and go, of which every choice is tried; of more all or none."""
MOST_RANGE = 2 * np.pi
"""rad or m; a wider range is none of motion: there every path winds up."""
INSTEAD = np.pi / 4
"""rad to both sides of its default value, of a coordinate with a wider range."""
MOVED = 1e-9
"""m or 1, by which a body moves against another where a coordinate moves it."""
SHAPES = {"WrapCylinder": "cylinder", "WrapSphere": "sphere"}
"""MuJoCo's own kinds of surfaces."""
SEED = 1
Rows = npt.NDArray[np.intp]


class Postures:
    """Where the bodies of a skeleton stand at sampled values of its coordinates (rad, m), of which
    some follow others by `couplings`."""

    def __init__(self, skeleton: OsimSkeleton, couplings: Mapping[str, Coupling]):
        self.skeleton = skeleton
        known = skeleton.coordinates
        self._tied = {name: each for name, each in couplings.items() if name in known}
        rest = {c.name: c.default for c in known.values()}
        ranges = {
            name: _sampled(known[name], is_slide)
            for name, is_slide in skeleton.moving.items()
            if name not in self._tied
        }
        rng = np.random.default_rng(SEED)
        self.values = [
            rest | {name: float(rng.uniform(*span)) for name, span in ranges.items()}
            for _ in range(RANDOM)
        ]
        self.sweeps = {}
        for name, span in ranges.items():
            start = len(self.values)
            self.values += [rest | {name: float(x)} for x in np.linspace(*span, SWEEP)]
            self.sweeps[name] = slice(start, len(self.values))
        self.values = [self._follow(values) for values in self.values]
        self._model, data = self._built({})
        rotation, place = [], []
        for values in self.values:
            self._pose(self._model, data, values)
            rotation.append(data.xmat.reshape(-1, 3, 3).copy())
            place.append(data.xpos.copy())
        self._rotation, self._place = np.array(rotation), np.array(place)

    def lengths(self, tendons: Mapping[str, Tendon]) -> dict[str, Array]:
        """The lengths (n,) m of tendons in MuJoCo at all postures."""
        if not tendons:
            return {}
        model, data = self._built(tendons)
        out = []
        for values in self.values:
            self._pose(model, data, values)
            mujoco.mj_tendon(model, data)
            out.append(data.ten_length.copy())
        return dict(zip(tendons, np.array(out).T, strict=True))

    def frames(self, body: str, rows: Rows) -> tuple[Array, Array]:
        """The rotations (n, 3, 3) and places (n, 3) m of a body (path) in the world."""
        name = self.skeleton.bodies[body].tag.name if body != GROUND else "world"
        number = self._model.body(name).id
        return self._rotation[rows, number], self._place[rows, number]

    def place(self, points: Sequence[Point], rows: Rows) -> Array:
        """The places (n, points, 3) m of points in the world; those that move where they are."""
        out = np.empty((len(rows), len(points), 3))
        for k, point in enumerate(points):
            rotation, place = self.frames(point.body, rows)
            within = np.array([point.at(self.values[row]) for row in rows])
            out[:, k] = place + np.einsum("nij,nj->ni", rotation, within)
        return out

    def moving(self, bodies: Sequence[str], coordinates: set[str]) -> Rows:
        """The postures at random, and those along each coordinate of a set or that moves some
        bodies against each other."""
        rows = list(range(RANDOM))
        everything = np.arange(len(self.values))
        frames = [self.frames(body, everything) for body in bodies]
        turn, origin = frames[0]
        against = [
            np.concatenate(
                [
                    np.einsum("nji,nj->ni", turn, place - origin),
                    np.einsum("nji,njk->nik", turn, rotation).reshape(-1, 9),
                ],
                axis=1,
            )
            for rotation, place in frames
        ]
        for name, sweep in self.sweeps.items():
            moved = any(np.ptp(each[sweep], axis=0).max() > MOVED for each in against)
            if moved or name in coordinates:
                rows += range(sweep.start, sweep.stop)
        return np.array(rows)

    def _follow(self, values: dict[str, float]) -> dict[str, float]:
        out = dict(values)
        for _ in self._tied:  # one may follow another that follows
            for name, coupling in self._tied.items():
                out[name] = float(polyval(out[coupling.coordinate], coupling.polynomial))
        return out

    def _built(self, tendons: Mapping[str, Tendon]) -> tuple[mujoco.MjModel, mujoco.MjData]:
        text = mjcf_xml("s", (0, 0, 0), self.skeleton, tendons, ())
        model = mujoco.MjModel.from_xml_string(text)
        return model, mujoco.MjData(model)

    def _pose(
        self, model: mujoco.MjModel, data: mujoco.MjData, values: Mapping[str, float]
    ) -> None:
        for name, value in values.items():
            if name in self.skeleton.moving:
                data.joint(name).qpos[0] = value
        for screw in self.skeleton.followers:
            assert screw.curve is not None
            data.joint(screw.name).qpos[0] = screw.curve(values[screw.coordinate])
        mujoco.mj_kinematics(model, data)


def _sampled(coordinate: Coordinate, is_slide: bool) -> tuple[float, float]:
    """The values (rad, m) between which a coordinate is sampled."""
    low, high = coordinate.range
    if high - low <= MOST_RANGE:
        return low, high
    by = 0.0 if is_slide else INSTEAD
    return coordinate.default - by, coordinate.default + by


@dataclass(frozen=True)
class Made:
    """A tendon of MuJoCo, the postures at which OpenSim's lengths (n,) m are known, and what is
    otherwise than OpenSim's."""

    tendon: Tendon
    rows: Rows
    lengths: Array
    changes: tuple[str, ...]


def made_tendon(name: str, way: Way, postures: Postures) -> Made:
    """The tendon of MuJoCo that comes nearest to a way, for a muscle of a name."""
    bodies = [p.body for p in way.points] + [use.surface.body for use in way.uses]
    of = {p.shown[0] for p in way.points if p.shown}
    rows = postures.moving(bodies, of.union(*(p.moved_by for p in way.points)))
    course = _Course(way, postures, rows)
    points, kept = _plain_points(way.points, course)
    wraps, changes = _wraps(name, way, course, kept)
    if any(p.shown for p in way.points):
        changes.insert(0, "points that come and go are plain or left out here")
    if any(p.moves for p in way.points):
        changes.insert(0, "points that move stand at their mean place here")
    return Made(Tendon(points, tuple(wraps)), rows, course.lengths, tuple(changes))


def off(made: Mapping[str, Made], postures: Postures) -> dict[str, float]:
    """By how much (m) the lengths of tendons are off OpenSim's at most."""
    lengths = postures.lengths({name: each.tendon for name, each in made.items()})
    return {
        name: float(np.abs(lengths[name][each.rows] - each.lengths).max())
        for name, each in made.items()
    }


class _Course:
    """A way of OpenSim at sampled postures: its points (n, points, 3) m and which are there, its
    lengths (n,) m, and by surface and segment what is touched: posture, extra length, middle."""

    def __init__(self, way: Way, postures: Postures, rows: Rows):
        self.values = [postures.values[row] for row in rows]
        self.places = postures.place(way.points, rows)
        self.there = np.array([[_is_there(p, v) for p in way.points] for v in self.values])
        self.frames = [_frames(use.surface, postures, rows) for use in way.uses]
        self.lengths = np.empty(len(rows))
        self.touched: dict[tuple[int, int], list[tuple[int, float, Array]]] = defaultdict(list)
        for n, there in enumerate(self.there):
            seen = np.flatnonzero(there)
            laid = [
                Laid(
                    use.surface.over, turn[n], at[n], *np.searchsorted(seen, (use.first, use.last))
                )
                for use, (turn, at) in zip(way.uses, self.frames, strict=True)
            ]
            self.lengths[n], found = tight_length(self.places[n, seen], laid)
            for touch in found:
                at_segment = touch.surface, int(seen[touch.segment])
                self.touched[at_segment].append((n, touch.extra, touch.middle))


def _is_there(point: Point, values: Mapping[str, float]) -> bool:
    return point.shown is None or point.shown[1] <= values[point.shown[0]] <= point.shown[2]


def _frames(surface: Surface, postures: Postures, rows: Rows) -> tuple[Array, Array]:
    rotation, place = postures.frames(surface.body, rows)
    return rotation @ surface.place.rotation, place + rotation @ surface.place.position


def _plain_points(points: Sequence[Point], course: _Course) -> tuple[tuple[Point, ...], list[int]]:
    """The points as they are kept, fixed in their bodies, and which these are: those whose straight
    length is nearest to that between the points that are there."""
    fixed = [
        replace(p, position=np.mean([p.at(v) for v in course.values], axis=0), moves=None)
        if p.moves
        else p
        for p in points
    ]
    coming = [i for i, point in enumerate(points) if point.shown is not None]
    choices = list(itertools.product((True, False), repeat=min(len(coming), MOST_CHOICES)))
    if len(coming) > MOST_CHOICES:
        choices = [(True,) * len(coming), (False,) * len(coming)]
    true = np.array(
        [_straight(at[there]) for at, there in zip(course.places, course.there, strict=True)]
    )
    best: tuple[float, list[int]] = (np.inf, [])
    for choice in choices:
        left = {i for i, is_kept in zip(coming, choice, strict=True) if not is_kept}
        kept = [i for i in range(len(points)) if i not in left]
        error = float(np.abs(_straight(course.places[:, kept]) - true).max())
        best = min(best, (error, kept), key=lambda pair: pair[0])
    return tuple(replace(fixed[i], shown=None) for i in best[1]), best[1]


def _straight(places: Array) -> Array:
    return np.asarray(np.linalg.norm(np.diff(places, axis=-2), axis=-1).sum(axis=-1))


def _wraps(
    name: str, way: Way, course: _Course, kept: Sequence[int]
) -> tuple[list[Wrap | None], list[str]]:
    """The wraps between the points that are kept, and what is otherwise than OpenSim's."""
    out: list[Wrap | None] = []
    changes: list[str] = []
    for start, end in itertools.pairwise(kept):
        between = f"between {way.points[start].name} and {way.points[end].name}"
        most: dict[int, float] = defaultdict(float)
        for (number, segment), found in course.touched.items():
            if start <= segment < end:
                most[number] = max(most[number], *(extra for _, extra, _ in found))
        chosen = max(most, key=lambda number: most[number], default=None)
        for number in most:
            if number != chosen:
                what = _named(way.uses[number].surface)
                changes.append(f"no {what} {between}, longer there by {1e3 * most[number]:.2g} mm")
        if chosen is None:
            out.append(_untouched(way, start, end))
            continue
        surface = way.uses[chosen].surface
        if surface.tag.kind in SHAPES:
            out.append(_native(surface))
            continue
        stand_in = _stand_in(surface, course, chosen, (start, end))
        wrap = _wrap_of(f"{name}-{surface.tag.name}-{start}", surface, stand_in)
        out.append(wrap)
        changes.append(
            f"a {stand_in.shape} of {1e3 * wrap.radius:.3g} mm for {_named(surface)} {between}"
        )
    names = [wrap.name for wrap in out if wrap is not None]
    several = sorted({name for name in names if names.count(name) > 1})
    changes += [f"{name!r} may bend several segments, in OpenSim one at a time" for name in several]
    return out, changes


def _named(surface: Surface) -> str:
    return f"{surface.tag.kind} {surface.tag.name!r}"


def _untouched(way: Way, start: int, end: int) -> Wrap | None:
    """MuJoCo's own surface of a segment, if it has one, that no sampled posture has touched."""
    uses = [
        u for u in way.uses if u.surface.tag.kind in SHAPES and u.first < end and start < u.last
    ]
    if len(uses) != 1 or _never(uses[0], way.points[start], way.points[end]):
        return None
    return _native(uses[0].surface)


def _never(use: Use, start: Point, end: Point) -> bool:
    fixed = start.body == end.body == use.surface.body and not (start.moves or end.moves)
    return fixed and use.surface.clear_of(start.position, end.position)


def _native(surface: Surface) -> Wrap:
    radius, *half = surface.size
    return Wrap(
        surface.tag.name,
        surface.body,
        surface.place,
        radius,
        half[0] if half else None,
        surface.side,
    )


def _stand_in(surface: Surface, course: _Course, number: int, segment: tuple[int, int]) -> StandIn:
    """The stand-in of a surface on a segment, fitted to its lengths."""
    turn, at = course.frames[number]
    a, b = (np.einsum("nji,nj->ni", turn, course.places[:, k] - at) for k in segment)
    lengths = np.linalg.norm(b - a, axis=1)
    touched = [
        each
        for (surface_of, k), found in course.touched.items()
        if surface_of == number and segment[0] <= k < segment[1]
        for each in found
    ]
    for n, extra, _ in touched:
        lengths[n] += extra
    if surface.tag.kind == "WrapTorus":
        circle, tube = surface.size
        return stand_in_torus(a, b, lengths, (circle, tube))
    middles = np.array([middle for *_, middle in touched])
    return stand_in_ellipsoid(a, b, lengths, np.array(surface.size), middles)


def _wrap_of(name: str, surface: Surface, made: StandIn) -> Wrap:
    place = surface.place @ Transform(made.rotation, made.place)
    half = 2 * made.radius if made.shape == "cylinder" else None
    side = np.zeros(3) if made.shape == "hole" else made.side
    return Wrap(name, surface.body, place, made.radius, half, side)
