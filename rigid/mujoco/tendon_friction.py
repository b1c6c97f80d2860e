"""Coulomb friction of tendons where they wrap a surface or turn at a guide point (capstan).

`rigid.chain.capstan` has the law of one guide, with g = 1 where the tendon slides towards the
muscle ("loading"), -1 where it slides away ("unloading"), 0 without friction.  Each straight part
pulls its two ends, which are points of bones, with its own tension T_k.  With its length l_k and
those ends held on the bones,

    torque = -sum_k T_k dl_k/dq,    slide at guide k = -sum_{j >= k} dl_j    (towards the muscle),

so that forces and moments balance on every body, and the muscle's work less the bones' is

    sum_k (T_before - T_beyond) slide_k,

which is what the guides take.  In a motion g follows the slide, and depends on the way and not on
the speed.  A tendon of stiffness k that is given more tension stretches, and slides by c_k dT more,
c_k the part of 1/k that lies beyond the guide.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import mujoco
import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Ints, Mask
from rigid.chain.capstan import free_grip, grip_after, held_length, tension_ratio
from rigid.mujoco.tendon_paths import PULLEY, SITE

Sliding = Literal["loading", "unloading", "frictionless"]
GRIPS: Mapping[Sliding, float] = {"loading": 1.0, "unloading": -1.0, "frictionless": 0.0}
"""g of each way of sliding."""
PRESLIDING = 1e-4
"""m, the way over which friction turns from none to all where a case states none; an assumption:
a tenth of a millimetre is little beside an excursion and much beside what one step slides."""
NO_ARC = 1e-9
"""m, between two points of contact: the tendon touches a ring's inside in one point."""


@dataclass(frozen=True)
class TendonFriction:
    """Friction of one tendon."""

    coefficient: float
    """Coulomb's mu, of all its guides."""
    sliding: Sliding = "loading"
    """Which way it slides, or in a motion slid before the start."""
    presliding: float = PRESLIDING
    """m."""
    stiffness: float = np.inf
    """N/m, of the whole tendon, by which it slides at its guides as tension changes."""


class _Pattern(NamedTuple):
    """Which listed points are the ends of an arc at each place (n,), while the same surfaces are
    touched."""

    first: Ints
    last: Ints
    body: Ints
    ahead: Ints
    """The straight part by which the tendon leaves the place."""
    turns: Mask
    arc: Ints
    """The places where a surface is touched."""


class GuideReadings(NamedTuple):
    """Tendons with friction in one posture, by the n places where they begin, turn and end."""

    turn: Array
    """(n,) mu theta."""
    part: Array
    """(n, nq) m/rad, derivatives of the straight part after each place, its ends held on bones."""
    share: Array
    """(n,) of the tendon's tension in the place's strand."""
    first: Ints
    """(n,) where the place's strand begins."""
    owner: Ints
    """(n,) the tendon."""
    give: Array
    """(n,) m/N by which the tendon beyond each place stretches."""
    slides: Array
    """(n, nq) m/rad, the slide towards the muscle at each place."""

    def factors(self, grip: Array) -> tuple[Array, Array]:
        """The tension before and beyond each place over the muscle's, (n,) each."""
        loss = np.cumsum(self.turn * grip)
        loss -= (loss - self.turn * grip)[self.first]
        beyond = self.share * tension_ratio(loss, np.ones_like(loss))
        return beyond / tension_ratio(self.turn, grip), beyond

    def arms(self, grip: Array, arms: Array) -> Array:
        """The torques (nt, nq) m per N of each muscle; `arms`: those without friction, kept for
        tendons that have none."""
        out = arms.copy()
        out[self.owner] = 0.0
        np.subtract.at(out, self.owner, self.factors(grip)[1][:, None] * self.part)
        return out

    def beyond(self, grip: Array) -> tuple[dict[int, float], dict[int, float]]:
        """By tendon the tension at its insertions together over the muscle's, and mu theta of its
        strand that turns most."""
        last = np.append(self.first[1:] != self.first[:-1], True)
        total = np.cumsum(self.turn)
        through = (total - total[self.first])[last]
        ends, owner = self.factors(grip)[1][last], self.owner[last]
        tendons = [int(t) for t in np.unique(owner)]
        return (
            {t: float(ends[owner == t].sum()) for t in tendons},
            {t: float(through[owner == t].max()) for t in tendons},
        )

    def arms_by_grip(self, grip: Array) -> Array:
        """The derivatives (n, nq) m of a tendon's torques per N by the grip at each place."""
        by_part = self.factors(grip)[1][:, None] * self.part
        return self.turn[:, None] * _sum_beyond(self.first, by_part)


def _sum_beyond(first: Ints, values: Array) -> Array:
    """The sums (n, ...) over each place and those beyond it in its strand."""
    total = np.cumsum(values[::-1], axis=0)[::-1]
    after = np.concatenate([total, np.zeros_like(values[:1])])
    return np.asarray(total - after[np.searchsorted(first, first, side="right")])


class FrictionWork(NamedTuple):
    """Where the work at guides went, J."""

    lost: float
    """Made heat; never negative."""
    held: float
    """Taken up before the tendon slides, or given back."""
    from_stretch: float
    """What of both the muscles brought as their tendons stretched, the joints at rest."""


NO_WORK = FrictionWork(0.0, 0.0, 0.0)


@dataclass(frozen=True)
class FrictionStep:
    """Friction over one step in time, in which it follows the slide: implicit Euler's."""

    readings: GuideReadings
    presliding: Array
    arms: Array
    """(nt, nq) m, without friction."""
    grip: Array
    """(n,) at the start."""
    tension: Array
    """(nt,) N at the end, where the joints have not turned."""
    stiffness: Array
    """(nt,) N/m, by which it falls with the path's shortening."""
    change: Array
    """(nt,) N, of the tension since the last step."""

    def slide(self, turned: Array) -> Array:
        """The slide (n,) m at each guide after the joints have turned by (nq,) rad."""
        return self.readings.slides @ turned + self._stretch

    def grip_after(self, turned: Array) -> Array:
        """The grip (n,) after the joints have turned by (nq,) rad."""
        return grip_after(self.grip, self.slide(turned), self.presliding)

    def torque(self, grip: Array, turned: Array) -> tuple[Array, Array]:
        """What friction adds to the tendons' torques (nq,) N m, and its slope (nq, nq) by the
        joints' turn: linear about a grip (n,) that a turn led to, where guides do not yet slide."""
        r = self.readings
        extra = r.arms(grip, self.arms) - self.arms
        shortening = self.stiffness[:, None] * self.arms
        torque, slope = self.tension @ extra, -extra.T @ shortening
        free = free_grip(self.grip, self.slide(turned), self.presliding)
        sticks = np.abs(free) < 1.0
        pull = (self.tension - shortening @ turned)[r.owner[sticks]]
        by_grip = pull[:, None] * r.arms_by_grip(grip)[sticks]
        by_turn = r.slides[sticks] / self.presliding[sticks][:, None]
        at_rest = free[sticks] - by_turn @ turned
        return torque + by_grip.T @ (at_rest - grip[sticks]), slope + by_grip.T @ by_turn

    def work(self, grip: Array, turned: Array, tension: Array) -> FrictionWork:
        """Where the work went, with the grip (n,) and the tensions (nt,) N at the end."""
        r = self.readings
        before, beyond = tension[r.owner] * r.factors(grip)
        free = free_grip(self.grip, self.slide(turned), self.presliding)
        glided = self.presliding * (free - np.clip(free, -1.0, 1.0))
        taken_up = self.presliding * held_length(r.turn, self.grip, grip)
        return FrictionWork(
            float((before - beyond) @ glided),
            float(before @ taken_up),
            float((before - beyond) @ self._stretch),
        )

    @property
    def _stretch(self) -> Array:
        r = self.readings
        return r.give * self.change[r.owner]


class TendonGuides:
    """Where the tendons with friction of a compiled model turn."""

    def __init__(
        self,
        model: mujoco.MjModel,
        names: tuple[str, ...],
        friction: Mapping[str, TendonFriction],
    ) -> None:
        """names: of all the model's tendons.  Raises InputError for one that it lacks."""
        if unknown := sorted(set(friction) - set(names)):
            raise InputError(
                f"friction of {', '.join(unknown)}: the finger's own tendons are "
                f"{', '.join(names) or 'none'}"
            )
        friction = {name: friction[name] for name in names if name in friction}
        self.model, self.friction = model, friction
        self.tendons: Ints = np.array([names.index(name) for name in friction], dtype=np.intp)
        rows = [row for t in self.tendons for row in _places(model, int(t))]
        self._what = np.array([what for _, _, what, _ in rows], dtype=np.intp)
        self.owner = np.array([t for t, _, _, _ in rows], dtype=np.intp)
        self._share = np.array([share for _, _, _, share in rows])
        strand = np.array([s for _, s, _, _ in rows], dtype=np.intp)
        key = self.owner * 1000 + strand
        self._first = np.searchsorted(key, key, side="left").astype(np.intp)
        self._is_end = np.append(key[1:] != key[:-1], True)
        by_owner = [friction[names[t]] for t in self.owner]
        self._mu = np.array([f.coefficient for f in by_owner])
        self.coefficients = np.array([f.coefficient for f in friction.values()])
        """The coefficients of `tendons`."""
        self.grip = np.array([GRIPS[f.sliding] for f in by_owner])
        """(n,) g of the tendons as they slide."""
        self.presliding = np.array([f.presliding for f in by_owner])
        """(n,) m."""
        self._give = np.array([1.0 / f.stiffness for f in by_owner])
        self._read: tuple[Array, GuideReadings] | None = None
        self._moves = model.jnt_bodyid
        self._patterns: dict[bytes, _Pattern] = {}

    def read(self, data: mujoco.MjData) -> GuideReadings:
        """What friction depends on, in the posture of `data`; that of the last one is kept."""
        if self._read is None or not np.array_equal(self._read[0], data.qpos):
            into, out_of, way, turn, pattern = self._geometry(data)
            length = _norm(out_of - into)
            length[:-1] += _norm(into[1:] - out_of[:-1]) * ~self._is_end[:-1]
            beyond = _sum_beyond(self._first, length)
            give = self._give * beyond / beyond[self._first]
            part = self._parts(data, way, pattern)
            slides = -_sum_beyond(self._first, part)
            readings = GuideReadings(turn, part, self._share, self._first, self.owner, give, slides)
            self._read = data.qpos.copy(), readings
        return self._read[1]

    def wrenches(self, data: mujoco.MjData, tension: Array, grip: Array) -> Array:
        """The wrenches (nt, nbody, 6) of the tendons with friction on each body about its origin,
        world frame, under tensions (nt,) N."""
        into, out_of, way, _, pattern = self._geometry(data)
        beyond = self.read(data).factors(grip)[1]
        pull = (tension[self.owner] * beyond)[:, None] * way
        out = np.zeros((self.model.ntendon, self.model.nbody, 6))
        on = np.flatnonzero(~self._is_end)
        for points, places, force in ((out_of, on, pull[on]), (into, on + 1, -pull[on])):
            body = pattern.body[places]
            moment = np.cross(points[places] - data.xpos[body], force)
            np.add.at(out, (self.owner[places], body), np.hstack([force, moment]))
        return out

    def straight_parts(
        self, data: mujoco.MjData, tension: Array, grip: Array
    ) -> list[tuple[Array, Ints, float]]:
        """Ends (2, 3) m, their bodies (2,) and tension (N) of every straight part, under the
        muscles' tensions (nt,) N."""
        into, out_of, way, _, pattern = self._geometry(data)
        pull = tension[self.owner] * self.read(data).factors(grip)[1]
        return [
            (np.stack([out_of[k], into[k + 1]]), pattern.body[k : k + 2], float(pull[k]))
            for k in np.flatnonzero(way.any(axis=1))
        ]

    def _geometry(self, data: mujoco.MjData) -> tuple[Array, Array, Array, Array, _Pattern]:
        """Where the tendon comes to and leaves each place (n, 3), the directions (n, 3) in which it
        leaves, and mu theta (n,)."""
        pattern = self._pattern(data)
        listed = data.wrap_xpos.reshape(-1, 3)
        into, out_of = listed[pattern.first], listed[pattern.last]
        way = np.zeros_like(into)
        way[:-1] = into[1:] - out_of[:-1]
        way[self._is_end] = 0.0
        length = _norm(way)[:, None]
        way = np.divide(way, length, out=np.zeros_like(way), where=length > 0)
        came, goes = np.roll(way, 1, axis=0), way[pattern.ahead]
        turn = np.arctan2(_norm(_cross(came, goes)), (came * goes).sum(axis=1)) * pattern.turns
        arc = pattern.arc[_norm((out_of - into)[pattern.arc]) > NO_ARC]
        if len(arc):
            turn[arc] = self._arcs(data, arc, into[arc], out_of[arc], came[arc])
        return into, out_of, way, self._mu * turn, pattern

    def _arcs(
        self, data: mujoco.MjData, places: Ints, begin: Array, end: Array, came: Array
    ) -> Array:
        """The angles (k,) rad by which a tendon that came along `came` (k, 3) turns over surfaces
        between two points of each: of a helix the sum of its curvature."""
        geom = self._what[places]
        axis = data.geom_xmat.reshape(-1, 3, 3)[geom, :, 2]
        axis = axis * (self.model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CYLINDER)[:, None]
        a, b = begin - data.geom_xpos[geom], end - data.geom_xpos[geom]
        rise = ((b - a) * axis).sum(axis=1)
        a, b, came = (v - (v * axis).sum(axis=1, keepdims=True) * axis for v in (a, b, came))
        plane = _cross(a, came)
        plane /= _norm(plane)[:, None]
        angle = np.arctan2((_cross(a, b) * plane).sum(axis=1), (a * b).sum(axis=1))
        angle = np.where(angle < -0.5 * np.pi, angle + 2 * np.pi, np.maximum(angle, 0.0))
        along = _norm(a) * angle
        length = np.hypot(along, rise)
        return angle * np.divide(along, length, out=np.zeros_like(along), where=length > 0)

    def _parts(self, data: mujoco.MjData, way: Array, pattern: _Pattern) -> Array:
        """`GuideReadings.part`: the ends of a straight part move with their bones along it."""
        listed = data.wrap_xpos.reshape(-1, 3)
        body, out = pattern.body, np.zeros((len(way), self.model.nv))
        on = np.flatnonzero(~self._is_end)
        for points, places, sign in ((pattern.last, on, -1.0), (pattern.first, on + 1, 1.0)):
            lever = listed[points[places]][:, None] - data.xanchor
            along = (_cross(data.xaxis, lever) * way[on][:, None]).sum(axis=2)
            out[on] += sign * along * (self._moves <= body[places][:, None])
        return out

    def _pattern(self, data: mujoco.MjData) -> _Pattern:
        listed = data.wrap_obj.ravel()[: int(data.ten_wrapnum.sum())]
        key = listed.tobytes()
        if key not in self._patterns:
            self._patterns[key] = self._match(data, listed)
        return self._patterns[key]

    def _match(self, data: mujoco.MjData, listed: Ints) -> _Pattern:
        """The listed points of each place; a surface that is not touched is passed where the tendon
        was before."""
        n, model = len(self.owner), self.model
        first, last, body = (np.zeros(n, dtype=np.intp) for _ in range(3))
        touched, at, sites = np.zeros(n, dtype=bool), 0, iter(())
        for k, what in enumerate(self._what):
            if k == 0 or self.owner[k] != self.owner[k - 1]:
                at = int(data.ten_wrapadr[self.owner[k]])
                sites = iter(_site_bodies(model, int(self.owner[k])))
            while listed[at : at + 1] == PULLEY:
                at += 1
            if what == SITE:
                first[k] = last[k] = at
                body[k], touched[k], at = next(sites), True, at + 1
            elif listed[at] == what:
                first[k], last[k] = at, at + 1
                body[k], touched[k], at = model.geom_bodyid[what], True, at + 2
            else:
                first[k] = last[k] = last[k - 1]
                body[k] = body[k - 1]
        ahead = np.arange(n)
        for k in range(n - 2, -1, -1):
            if not touched[k + 1]:
                ahead[k] = ahead[k + 1]
        turns = touched & ~self._is_end & (self._first != np.arange(n))
        arc = np.flatnonzero(touched & (self._what != SITE))
        return _Pattern(first, last, body, ahead, turns, arc)


def _cross(a: Array, b: Array) -> Array:
    """Vectors' products; numpy's function for them takes several times as long."""
    ahead, behind = [1, 2, 0], [2, 0, 1]
    return np.asarray(a[..., ahead] * b[..., behind] - a[..., behind] * b[..., ahead])


def _norm(vectors: Array) -> Array:
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=-1)))


def _places(model: mujoco.MjModel, tendon: int) -> list[tuple[int, int, int, float]]:
    """Tendon, strand, surface (SITE of a point) and share of each place along a tendon."""
    start, count = model.tendon_adr[tendon], model.tendon_num[tendon]
    strand, share, out = 0, 1.0, list[tuple[int, int, int, float]]()
    for w in range(start, start + count):
        kind = model.wrap_type[w]
        if kind == mujoco.mjtWrap.mjWRAP_PULLEY:
            strand += bool(out)
            share = 1.0 / model.wrap_prm[w]
        elif kind == mujoco.mjtWrap.mjWRAP_SITE:
            out.append((tendon, strand, SITE, share))
        else:
            out.append((tendon, strand, int(model.wrap_objid[w]), share))
    return out


def _site_bodies(model: mujoco.MjModel, tendon: int) -> Ints:
    start, count = model.tendon_adr[tendon], model.tendon_num[tendon]
    is_site = model.wrap_type[start : start + count] == mujoco.mjtWrap.mjWRAP_SITE
    bodies: Ints = model.site_bodyid[model.wrap_objid[start : start + count][is_site]]
    return bodies
