"""OpenSim's paths as MuJoCo's tendons, and by how much this changes their lengths.

A tendon of MuJoCo runs through points that are always there, round one sphere or cylinder a
segment.  A point that moves is a light body on slides that follow its coordinate by quartics.  One
that comes and goes is kept, left out, or a tiny sphere that bends the path where the line would
pass on its wrong side, whichever is nearest over the ranges of motion.  Of the surfaces on a
segment that is kept which bends it most; ellipsoids and tori have stand-ins.  What this changes is
measured whole, as MuJoCo's length against that of OpenSim's path pulled tight, at postures at
random, along each coordinate that moves it, and where points come and go.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import mujoco
import numpy as np
import numpy.typing as npt
from numpy.polynomial.polynomial import polyval

from cosim.port import Array
from rigid.opensim.components import GROUND, Transform
from rigid.opensim.functions import quartic
from rigid.opensim.joints import Coordinate, Screw
from rigid.opensim.mjcf import SLIDE_INERTIA, Coupling, mjcf_xml
from rigid.opensim.paths import Point, Surface, Tendon, Use, Way, Wrap
from rigid.opensim.skeleton import LEAST_MASS, OsimSkeleton
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
VIA_RADIUS = 1e-6
"""m, of the sphere that stands for a point."""
BESIDE = 1e-9
"""How far from the end of its range, of that of the coordinate, a point that comes is looked at."""
AT_SWITCH = 10
"""Postures at random where a point comes or goes, on either side."""
DIRECTIONS = 400
"""That are tried for the side of such a point."""
SEED = 1
Rows = npt.NDArray[np.intp]


class Postures:
    """Where the bodies of a skeleton stand at sampled values of its coordinates (rad, m), of which
    some follow others by `couplings`, and where points of some ways come and go."""

    def __init__(
        self,
        skeleton: OsimSkeleton,
        couplings: Mapping[str, Coupling],
        ways: Iterable[Way] = (),
    ):
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
        self.switches: dict[tuple[str, float, float], range] = {}
        """By what a point depends on, the postures where it comes and goes."""
        shown = (p.shown for way in ways for p in way.points)
        for name, low, high in dict.fromkeys(filter(None, shown)):
            start, (least, most) = len(self.values), ranges.get(name, (0.0, 0.0))
            for end in (low, high):
                near = BESIDE * (most - least)
                if least < end < most:
                    self.values += [
                        self.values[k] | {name: end + side}
                        for side in (-near, near)
                        for k in range(AT_SWITCH)
                    ]
            self.switches[name, low, high] = range(start, len(self.values))
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
        slides = [
            (s.name, s.coordinate, coupling_of(s, self.skeleton).polynomial)
            for name, tendon in tendons.items()
            for s in tendon.slides(name)
        ]
        for values in self.values:
            for name, of, polynomial in slides:
                data.joint(name).qpos[0] = polyval(values[of], polynomial)
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

    def rows_of(self, way: Way) -> Rows:
        """The postures at random, those along each coordinate that moves a point of a way or its
        bodies against each other, and where its points come and go."""
        bodies = [p.body for p in way.points] + [use.surface.body for use in way.uses]
        shown = [p.shown for p in way.points if p.shown]
        coordinates = {name for name, *_ in shown}.union(*(p.moved_by for p in way.points))
        rows = [*range(RANDOM), *(row for each in set(shown) for row in self.switches[each])]
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


_HOW_BENT = (
    "{} of the points that come and go bend the path where the line would pass on their wrong side "
    "(where OpenSim lets them come its own length jumps by up to {:.2g} mm)"
)
_HOW_MOVED = (
    "points that move follow their coordinate by quartics, at most {:.2g} mm off along an axis, on "
    "bodies of {:g} kg with {:g} kg of inertia (no weight) on each slide"
)


def coupling_of(screw: Screw, skeleton: OsimSkeleton) -> Coupling:
    """The equality by which a joint of MuJoCo follows its coordinate."""
    assert screw.curve is not None
    found = quartic(screw.curve, *skeleton.coordinates[screw.coordinate].range)
    return Coupling(screw.coordinate, found.coefficients, found.error)


def made_tendon(name: str, way: Way, postures: Postures) -> Made:
    """The tendon of MuJoCo that comes nearest to a way, for a muscle of a name."""
    rows = postures.rows_of(way)
    course = _Course(way, postures, rows)
    kept, vias = _keep_points(name, way, course)
    wraps, changes = _wraps(name, way, course, kept)
    for at, via in vias.items():
        wraps[kept.index(at)] = via.wrap
    points = tuple(replace(way.points[i], shown=None) for i in kept)
    tendon = Tendon(points, tuple(wraps))
    if vias:
        jump = 1e3 * max(via.jump for via in vias.values())
        changes.insert(0, _HOW_BENT.format(len(vias), jump))
    if sum(p.shown is not None for p in way.points) > len(vias):
        changes.insert(0, "points that come and go are plain or left out here")
    if slides := tendon.slides(name):
        size = 1e3 * max(coupling_of(s, postures.skeleton).error for s in slides)
        changes.insert(0, _HOW_MOVED.format(size, LEAST_MASS, SLIDE_INERTIA))
    return Made(tendon, rows, course.lengths, tuple(changes))


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
        self.postures, self.rows = postures, rows
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


def _keep_points(name: str, way: Way, course: _Course) -> tuple[list[int], dict[int, _Via]]:
    """Which points are kept, and the spheres in the place of points that come and go, by the point
    before: those whose straight length is nearest to that between the points that are there."""
    coming = [i for i, point in enumerate(way.points) if point.shown is not None]
    always = [i for i in range(len(way.points)) if i not in coming]
    vias: dict[int, _Via] = {}
    choices = [("kept",) * len(coming), ("left out",) * len(coming)]
    if len(coming) <= MOST_CHOICES:
        vias = {i: via for i in coming if (via := _via(name, way, course, always, i))}
        whats = [("kept", "left out", *["bent"] * (i in vias)) for i in coming]
        choices = list(itertools.product(*whats))
    true = np.array(
        [_straight(at[there]) for at, there in zip(course.places, course.there, strict=True)]
    )
    best: tuple[float, list[int], dict[int, _Via]] = (np.inf, [], {})
    for choice in choices:
        what = dict(zip(coming, choice, strict=True))
        kept = [i for i in range(len(way.points)) if what.get(i, "kept") == "kept"]
        bent = [i for i in coming if what[i] == "bent"]
        alone = len({vias[i].between[0] for i in bent}) == len(bent)
        beside = [(max(k for k in kept if k < i), min(k for k in kept if k > i)) for i in bent]
        if len(kept) < 2 or not alone or beside != [vias[i].between for i in bent]:
            continue
        lengths = _straight(course.places[:, kept]) + sum(vias[i].extra for i in bent)
        error = float(np.abs(lengths - true).max())
        found = {vias[i].between[0]: vias[i] for i in bent}
        best = min(best, (error, kept, found), key=lambda each: each[0])
    return best[1], best[2]


class _Via(NamedTuple):
    """The sphere in the place of a point that comes and goes, the points between which it is, and
    how much longer (n,) m it makes the path; `jump` is by how much (m) it makes OpenSim's jump."""

    wrap: Wrap
    between: tuple[int, int]
    extra: Array
    jump: float


def _via(name: str, way: Way, course: _Course, always: Sequence[int], i: int) -> _Via | None:
    """The sphere for a point; None where it is never there, always, or a surface is beside it."""
    before = max((k for k in always if k < i), default=None)
    after = min((k for k in always if k > i), default=None)
    there = course.there[:, i]
    if before is None or after is None or there.all() or not there.any():
        return None
    if any(before <= segment < after for _, segment in course.touched):
        return None
    point, (a, p, b) = way.points[i], (course.places[:, k] for k in (before, i, after))
    along = b - a
    part = ((p - a) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), MOVED**2)
    turn = course.postures.frames(point.body, course.rows)[0]
    line = a + np.clip(part, 0, 1)[:, None] * along - p
    line = np.einsum("nji,nj->ni", turn, line)
    longer = np.linalg.norm(p - a, axis=1) + np.linalg.norm(b - p, axis=1)
    longer = longer - np.linalg.norm(along, axis=1)
    sides = np.random.default_rng(SEED).normal(size=(DIRECTIONS, 3))
    sides = np.array([line[~there].mean(axis=0), -line[there].mean(axis=0), *sides])
    sides /= np.maximum(np.linalg.norm(sides, axis=1), MOVED)[:, None]
    bent = line @ sides.T < 0
    worst = np.where(bent == there[:, None], 0.0, longer[:, None])
    side = sides[int(np.argmin((worst**2).sum(axis=0)))]
    place = Transform(np.eye(3), point.position)
    wrap = Wrap(f"{name}-{i}-via", point.body, place, VIA_RADIUS, None, side)
    assert point.shown is not None
    at_switch = np.isin(course.rows, course.postures.switches[point.shown])
    jump = float(longer[at_switch].max(initial=0.0))
    return _Via(wrap, (before, after), np.where(line @ side < 0, longer, 0.0), jump)


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
