"""The ways of a MuJoCo model's spatial tendons and what their tension does to the bodies.

MuJoCo lists the points of a tendon strand by strand: a site gives one point, a surface that the
tendon touches two, a pulley none but a mark.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from cosim.port import Array
from rigid.chain.kinematics import Indices

PULLEY, SITE = -2, -1


@dataclass(frozen=True)
class _Way:
    """Sites' bodies in order along one tendon, and its strands' shares of the tension."""

    site_body: Indices
    share: Array


class TendonWays:
    """What every tendon of a compiled model runs over."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._geom_body = model.geom_bodyid
        self._bodies = model.nbody
        self._tendons = [_way(model, t) for t in range(model.ntendon)]

    def points(self, data: mujoco.MjData) -> list[list[Array]]:
        """World points (k, 3) m of each strand of each tendon, from origin to insertion."""
        return [[points for points, _, _ in self._strands(data, t)] for t in self._all]

    def wrenches(self, data: mujoco.MjData, tension: Array) -> Array:
        """The tendons' wrenches (nt, nbody, 6) on each body about its origin, world frame: at each
        point the strand's share of the tension times the directions to its neighbours; an end has
        one neighbour."""
        out = np.zeros((len(self._tendons), self._bodies, 6))
        for t in self._all:
            for points, body, share in self._strands(data, t):
                force = share * tension[t] * _along(points)
                lever = points - data.xpos[body]
                np.add.at(out[t], body, np.hstack([force, np.cross(lever, force)]))
        return out

    @property
    def _all(self) -> range:
        return range(len(self._tendons))

    def _strands(self, data: mujoco.MjData, tendon: int) -> Iterator[tuple[Array, Indices, float]]:
        """Points, their bodies and the share of each strand."""
        first, count = data.ten_wrapadr[tendon], data.ten_wrapnum[tendon]
        what = data.wrap_obj.ravel()[first : first + count]
        points = data.wrap_xpos.reshape(-1, 3)[first : first + count]
        way = self._tendons[tendon]
        body = self._geom_body[np.maximum(what, 0)]
        body[what == SITE] = way.site_body
        strand = np.cumsum(what == PULLEY)
        strand -= strand[0] if count else 0
        for s, share in enumerate(way.share):
            of = (strand == s) & (what != PULLEY)
            yield points[of].copy(), body[of], float(share)


def _along(points: Array) -> Array:
    """The sum (k, 3) of the unit vectors from each point to its neighbours; a tendon touches the
    inside of a ring in two points that are one."""
    segment = np.diff(points, axis=0)
    length = np.linalg.norm(segment, axis=1, keepdims=True)
    unit = np.divide(segment, length, out=np.zeros_like(segment), where=length > 0)
    none = np.zeros((1, 3))
    return np.vstack([unit, none]) - np.vstack([none, unit])


def _way(model: mujoco.MjModel, tendon: int) -> _Way:
    first, count = model.tendon_adr[tendon], model.tendon_num[tendon]
    kind = model.wrap_type[first : first + count]
    site = model.wrap_objid[first : first + count][kind == mujoco.mjtWrap.mjWRAP_SITE]
    divisor = model.wrap_prm[first : first + count][kind == mujoco.mjtWrap.mjWRAP_PULLEY]
    starts_whole = not count or kind[0] != mujoco.mjtWrap.mjWRAP_PULLEY
    share = np.concatenate([[1.0] if starts_whole else [], 1.0 / divisor])
    return _Way(model.site_bodyid[site], share)
