"""The smooth hull over the bones on which a hood is laid, in any posture of the finger."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from cosim.port import Array
from meshes.skeleton import BODIES, Skeleton, index_finger

BLEND = 6.0  # mm over which the sheet's frame turns from one bone's to the next one's
CLEARANCE = 0.03  # mm between the sheet and the level of contact at rest
PIP = 42.59  # mm, station of the joint
DIP = 67.73


class SmoothSurface(Protocol):
    """A smooth signed distance in a body's frame (m)."""

    def distance(self, points: Array) -> tuple[Array, Array, Array]:
        """Values (n,), gradients (n, 3), Hessians (n, 3, 3)."""
        ...


def along(skeleton: Skeleton, station: Array) -> Array:
    """The places (n,) m along the chain of joint centres of stations in mm of the index finger:
    each phalanx takes its own part of them, the metacarpal the proximal phalanx's."""
    own, index = skeleton.length, index_finger().length
    _, proximal, middle, distal = np.divide(own, index, out=np.ones(4), where=index > 0)
    over_middle, over_distal = np.clip(station - PIP, 0, DIP - PIP), np.maximum(station - DIP, 0)
    stretched = station + (middle / proximal - 1) * over_middle
    stretched = stretched + (distal / proximal - 1) * over_distal
    scale: float = own[1] / (PIP * 1e-3)
    return stretched * 1e-3 * scale


def carriers(skeleton: Skeleton, station: Array) -> Array:
    """The weights (n, 4) with which each body carries material `station` (m) along the chain,
    adding up to one."""
    joints = np.concatenate([[0.0], np.cumsum(skeleton.length[1:3])])
    width = BLEND * 1e-3
    u = np.clip((station[:, None] - joints + width) / (2 * width), 0, 1)
    passed = u * u * (3 - 2 * u)
    ones, zeros = np.ones((len(station), 1)), np.zeros((len(station), 1))
    return np.hstack([ones, passed]) - np.hstack([passed, zeros])


@dataclass(frozen=True)
class Centreline:
    """The chain of joint centres in a posture, with a frame that turns smoothly over the joints."""

    skeleton: Skeleton
    position: Array
    rotation: Array

    def frames(self, station: Array) -> tuple[Array, Array]:
        """Points (n, 3) and axes (n, 3, 3), columns distal, radial, dorsal, at stations (m)."""
        weight = carriers(self.skeleton, station)
        starts = np.concatenate([[0.0, 0.0], np.cumsum(self.skeleton.length[1:3])])
        along = (station[:, None] - starts)[..., None] * self.rotation[:, :, 0]
        point = np.einsum("nb,nbk->nk", weight, self.position + along)
        axes = np.einsum("nb,bij->nij", weight, self.rotation)
        u, _, vt = np.linalg.svd(axes)
        return point, u @ vt

    def at(self, station: Array, dorsal: Array, radial: Array) -> Array:
        """World points at stations and heights above and beside the chain (m)."""
        point, axes = self.frames(np.atleast_1d(station))
        return (
            point
            + np.atleast_1d(radial)[:, None] * axes[:, :, 1]
            + np.atleast_1d(dorsal)[:, None] * axes[:, :, 2]
        )


@dataclass(frozen=True)
class Level:
    """The union of the bones grown by an offset each (m); where it is negative, a node touches."""

    surfaces: Mapping[str, SmoothSurface]
    offset: Mapping[str, float]
    position: Array
    rotation: Array

    def value(self, points: Array) -> tuple[Array, Array]:
        """Smallest clearance (n,) and its gradient (n, 3) in the world frame."""
        best, slope = np.full(len(points), np.inf), np.zeros((len(points), 3))
        for i, body in enumerate(BODIES):
            local = (points - self.position[i]) @ self.rotation[i]
            value, gradient, _ = self.surfaces[body].distance(local)
            value = value - self.offset[body]
            nearer = value < best
            best[nearer] = value[nearer]
            slope[nearer] = gradient[nearer] @ self.rotation[i].T
        return best, slope

    def clearance(self, points: Array) -> Array:
        """Smallest clearance (n,) m of points (n, 3) in the world frame."""
        best = np.full(len(points), np.inf)
        for i, body in enumerate(BODIES):
            local = (points - self.position[i]) @ self.rotation[i]
            distance, _, _ = self.surfaces[body].distance(local)
            np.minimum(best, distance - self.offset[body], out=best)
        return best

    def push_out(self, points: Array, clearance: float | Array) -> Array:
        """Points (n, 3) moved along the gradient until each has its `clearance` (m, or (n,) m)."""
        points = points.copy()
        for _ in range(30):
            value, gradient = self.value(points)
            short = np.maximum(clearance - value, 0.0)
            if short.max() < 1e-7:
                break
            points += 1.02 * short[:, None] * gradient
        return points

    def rise_over_head(self, points: Array, lift: Array) -> Array:
        """The heights (n,) m by which points must rise dorsally, so that lines along the metacarpal
        from there to the MCP clear its level by `lift` (n,) m."""
        start = (points - self.position[0]) @ self.rotation[0]
        way = lines_to_joint(start)
        line = way.reshape(-1, 3)
        level = self.offset["metacarpal"] + CLEARANCE * 1e-3 + np.repeat(lift, way.shape[1])
        for _ in range(30):
            value, gradient, _ = self.surfaces["metacarpal"].distance(line)
            short = np.maximum(level - value, 0.0)
            if short.max() < 1e-7:
                break
            line[:, 2] += short / np.maximum(gradient[:, 2], 0.3)
        highest: Array = line[:, 2].reshape(way.shape[:2]).max(axis=1)
        return highest - start[:, 2]


def lines_to_joint(start: Array) -> Array:
    """Points (n, 50, 3) m on the lines along the metacarpal, in its frame, from each of `start`
    (n, 3) to the MCP."""
    way = np.repeat(start[:, None], 50, axis=1)
    way[..., 0] = np.linspace(start[:, 0], 0.0, 50, axis=1)
    return way


def hull_radius(
    chain: Centreline, level: Level, first: float, last: float
) -> tuple[Array, Array, Array]:
    """Places along the chain (m) from `first` to `last` and some way beyond, angles (rad) and the
    radius about the chain (ns, na), m, of a smooth hull over the level set: outermost crossing of
    each ray, bridged over the joint gaps within 10 mm, smoothed.

    The hull is a property of the bones and not of the mesh: a few hundredths of a millimetre of
    slack decide how the slips share a tendon's force."""
    from scipy.ndimage import gaussian_filter, maximum_filter

    s = np.arange(np.floor(1e3 * first - 2), np.ceil(1e3 * last + 3), 0.5) * 1e-3
    phi = np.deg2rad(np.arange(-125.0, 126.0, 5.0))
    higher = max(0.0, max(level.offset.values()) - 5e-3)  # the rays reach as much further
    more = int(np.ceil(higher / 0.5e-3))
    radius = np.linspace(1.5e-3, 15e-3 + 0.5e-3 * more, 28 + more)
    point, axes = chain.frames(s)
    ray = np.cos(phi)[:, None] * axes[:, None, :, 2] + np.sin(phi)[:, None] * axes[:, None, :, 1]
    start = np.repeat(point, len(phi), axis=0)
    rho = _outermost_crossing(level, start, ray.reshape(-1, 3), radius).reshape(ray.shape[:2])
    for _ in range(3):  # Newton along the rays
        there = (point[:, None] + rho[..., None] * ray).reshape(-1, 3)
        clearance, gradient = level.value(there)
        slope = np.einsum("nk,nk->n", gradient, ray.reshape(-1, 3))
        step = np.where(slope > 0.3, clearance / np.where(slope > 0.3, slope, 1.0), 0.0)
        rho -= np.clip(step, -5e-4, 5e-4).reshape(rho.shape)
    rho = _bridge(rho, reach=10)
    return s, phi, gaussian_filter(maximum_filter(rho, (3, 3)), (2.0, 1.0), mode="nearest")


def _outermost_crossing(level: Level, start: Array, ray: Array, radius: Array) -> Array:
    """The radius (n,) beyond which each ray (n, 3) from its start (n, 3) stays outside the level;
    the inmost radius where it never was in.  A ray is followed inwards from the outermost radius
    until it is in."""
    out = np.full(len(ray), radius[0])
    rest = np.arange(len(ray))
    outer = level.clearance(start + radius[-1] * ray)
    is_in = outer < 0
    for inner_radius in radius[-2::-1]:
        inner = level.clearance(start[rest] + inner_radius * ray[rest])
        is_in |= inner < 0
        v0, v1 = inner[is_in], outer[is_in]
        out[rest[is_in]] = inner_radius + (radius[1] - radius[0]) * (v0 / (v0 - v1))
        rest, outer = rest[~is_in], inner[~is_in]
        is_in = is_in[~is_in]
        if not len(rest):
            break
    return out


def _bridge(rho: Array, reach: int) -> Array:
    """Each row no lower than any chord between rows at most `reach` to either side."""
    out = rho.copy()
    n = len(rho)
    for a in range(1, reach + 1):
        for b in range(1, reach + 1):
            i = np.arange(a, n - b)
            chord = (b * rho[i - a] + a * rho[i + b]) / (a + b)
            out[i] = np.maximum(out[i], chord)
    return out


@dataclass(frozen=True)
class Hull:
    chain: Centreline
    level: Level

    def points(self, station: Array, phi: Array) -> Array:
        """World points (n, 3) on the hull at stations (mm of the index finger; all the hood's) and
        angles (rad)."""
        from scipy.interpolate import RectBivariateSpline

        place = along(self.chain.skeleton, station)
        s, angles, rho = hull_radius(self.chain, self.level, place.min(), place.max())
        radius = RectBivariateSpline(s, angles, rho, kx=3, ky=3).ev(place, phi)
        radius = radius + CLEARANCE * 1e-3
        return self.chain.at(place, radius * np.cos(phi), radius * np.sin(phi))
