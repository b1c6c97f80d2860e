"""A reduced hood as junctions and bands that MuJoCo has, fitted to its potential.

A potential of degree nine in three angles has no place in MuJoCo, whose equalities are quartics of
one joint or of one sum of joints.  What it has is a network: bands on the muscles' junctions s,

    T_j = k_j [a_j . s - l_j(theta)]^+,   sum_j a_jm T_j = T_m,   tau = sum_j T_j dl_j/dtheta,

whose lengths are here functions of all angles, and of which some join two junctions (a_j = e_m +-
e_n), so that muscles share what bears.  Its torques and excursions derive from one energy too, and
bands that come to bear one after the other make arms and stretch follow the load.

A function of two joints is a sum of functions of one sum each, since

    2 x y = (x + y)^2 - x^2 - y^2:

lengths are sums of the angles, of squares and cubes of each, and of squares of their pairs, and
each square or cube is a follower (`rigid.mjcf.hood`).  Coefficients c of l_j = sum_k c_jk B_k and
stiffnesses are found by Levenberg and Marquardt's method on joint torques over their size, the
fingertip's force, and excursions, with the derivatives of the equilibrium

    H ds = sum_j a_j (k_j [T_j > 0] B . dc_j - T_j dln k_j),   H = sum_j k_j [T_j > 0] a_j a_j^T.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, permutations
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from cosim.port import Array
from rigid.hoods.reduced import ReducedPotential
from rigid.hoods.reduction import TIP, Sample, tip_rows
from rigid.mjcf.hood import Band, Follower, HoodParts

ALONE = 2
"""Bands of each muscle alone."""
TOE, JOINED = 0.03, 0.1
"""At first: the second band bears from this part of the greatest tension on; what a band of two
muscles has of a muscle's own stiffness."""
SOFTEST, STIFFEST = 5.0, 3e5
"""N/m."""
LEAST_TORQUE = 0.15
"""The part of the median torque below which one counts as if it were as large."""
ONSETS = (3e-4, 1e-4, 3e-5, 0.0)
"""m, over which bands come to bear."""
NEWTON, ROUNDS, TRIES, START, ENOUGH = 40, 15, 14, 1.0, 1e-3
HOLD = 1e-3
"""N/m, of a junction that no band holds."""
EXCURSIONS = 2.0
"""Weight of excursions over their range."""


@dataclass(frozen=True)
class Ridge:
    """A power of a sum of joint angles, scaled to -1 to 1 in the box."""

    weights: Array
    """(n,) zeros and ones."""
    power: int


@dataclass(frozen=True)
class Lengths:
    """The functions B_k of which the bands' lengths are sums: 1, each angle, and ridges."""

    potential: ReducedPotential
    ridges: tuple[Ridge, ...]

    def centre_and_half(self, ridge: Ridge) -> tuple[float, float]:
        """The middle and half the range of a ridge's sum, rad."""
        p = self.potential
        return float(ridge.weights @ (p.low + p.high) / 2), float(ridge.weights @ p.half)

    def at(self, angle: Array) -> tuple[Array, Array]:
        """Values (s, K) and slopes (s, K, n) at angles (s, n)."""
        u, n = self.potential.scaled_angle(angle), angle.shape[1]
        values = [np.ones((len(u), 1)), u]
        slopes = [
            np.zeros((len(u), 1, n)),
            np.tile(np.diag(1 / self.potential.half), (len(u), 1, 1)),
        ]
        for ridge in self.ridges:
            middle, half = self.centre_and_half(ridge)
            x = (angle @ ridge.weights - middle) / half
            values.append(x[:, None] ** ridge.power)
            by_x = ridge.power * x ** (ridge.power - 1)
            slopes.append((by_x[:, None] * ridge.weights / half)[:, None])
        return np.concatenate(values, axis=1), np.concatenate(slopes, axis=1)


@dataclass(frozen=True)
class Bands:
    """Bands on junctions of m muscles."""

    shares: Array
    """(J, m): a."""
    lengths: Array
    """(J, K) m: c."""
    stiffness: Array
    """(J,) N/m: k."""


@dataclass(frozen=True)
class Answer:
    """Bands in equilibrium at s states."""

    junction: Array
    """(s, m) m."""
    tension: Array
    """(s, J) N."""
    bearing: Array
    """(s, J) N/m, of the tensions by stretch."""
    torque: Array
    """(s, n) N m."""


def reduced_parts(potential: ReducedPotential, data: Sample, maps: Array) -> HoodParts:
    """Parts whose torques and excursions are the potential's, as nearly as bands can.  data: states
    of the potential, see `states_of`; maps (s, 3, n): from torques to the fingertip's force."""
    basis = Lengths(potential, tuple(_ridges(potential.joints)))
    first = _first_bands(potential, data, basis)
    return _parts(potential, basis, _Fit(basis, data, maps).solve(first))


def states_of(potential: ReducedPotential, angle: Array, tension: Array) -> Sample:
    """The potential at angles (s, n) rad and tensions (s, m) N."""
    slip = np.zeros((len(angle), 2))
    return Sample(angle, tension, *potential.derivatives(angle, tension), slip)


def _ridges(joints: tuple[str, ...]) -> Iterator[Ridge]:
    """Squares and cubes of each flexion, squares of each pair of joints."""
    one = np.eye(len(joints))
    for i, joint in enumerate(joints):
        if not joint.endswith("_abduction"):
            yield Ridge(one[i], 2)
            yield Ridge(one[i], 3)
    yield from (Ridge(one[i] + one[k], 2) for i, k in combinations(range(len(joints)), 2))


def _first_bands(potential: ReducedPotential, data: Sample, basis: Lengths) -> Bands:
    """Each muscle's bands with its mean excursion as length and its stretch in mid-box, and bands
    of two muscles that are much softer."""
    value, _ = basis.at(data.angle)
    own = [_own_bands(potential, data, value, m) for m in range(len(potential.muscles))]
    one = np.eye(len(own))
    shares = [one[m] for m in range(len(own)) for _ in range(ALONE)]
    lengths = [length for bands, _ in own for length in bands]
    stiffness = [k for _, stiffnesses in own for k in stiffnesses]
    pairs = [one[i] + one[k] for i, k in combinations(range(len(own)), 2)]
    pairs += [one[i] - one[k] for i, k in permutations(range(len(own)), 2)]
    soft = JOINED * float(np.mean(stiffness))
    for pair in pairs:
        lengths.append(sum(part * own[m][0][0] for m, part in enumerate(pair)))
        stiffness.append(soft)
    return Bands(np.array([*shares, *pairs]), np.array(lengths), np.array(stiffness))


def _own_bands(
    potential: ReducedPotential, data: Sample, value: Array, m: int
) -> tuple[list[Array], list[float]]:
    """Lengths (K,) and stiffnesses of a muscle's own bands."""
    most, parts = potential.most[m], np.linspace(0.0, 1.0, 101)
    tension = np.zeros((len(parts), len(potential.muscles)))
    tension[:, m] = parts * most
    middle = np.tile((potential.low + potential.high) / 2, (len(parts), 1))
    stretch = potential.derivatives(middle, tension).excursion[:, m]
    stretch = np.maximum.accumulate(stretch - stretch[0]) + 1e-5 * parts
    stretched = np.interp(data.tension[:, m] / most, parts, stretch)
    length = np.linalg.lstsq(value, data.excursion[:, m] - stretched, rcond=None)[0]
    begins = [0.0, *np.geomspace(TOE, 0.5, ALONE - 1), 1.0]
    ends = np.interp(begins, parts, stretch)
    slopes = np.diff(begins) * most / np.diff(ends)
    first = np.zeros(len(length))
    first[0] = 1.0
    stiffness = np.maximum(np.diff(slopes, prepend=0.0), JOINED * slopes[-1])
    return [length + first * end for end in ends[:-1]], [float(k) for k in stiffness]


class _Fit:
    """The least squares problem of a set of bands."""

    def __init__(self, basis: Lengths, data: Sample, maps: Array) -> None:
        self._value, self._slope = basis.at(data.angle)
        self._data, self._onset = data, 0.0
        size = np.linalg.norm(data.torque, axis=1)
        size = np.maximum(size, LEAST_TORQUE * np.median(size))
        whole = np.eye(data.angle.shape[1]) / size[:, None, None]
        self._rows = np.concatenate([whole, tip_rows(data, maps) / TIP], axis=1)
        self._excursions = EXCURSIONS / float(np.ptp(data.excursion, axis=0).mean())

    def solve(self, bands: Bands) -> Bands:
        """The bands of least error, from first ones: first of bands that come to bear gradually,
        over ever shorter ways, so that the error is a smooth function of them."""
        for self._onset in ONSETS:
            bands = self._improve(bands)
        return bands

    def _improve(self, bands: Bands) -> Bands:
        reached = self._answer(bands, self._data.excursion)
        left, damping = self._left(reached), START
        for _ in range(ROUNDS):
            slopes = self._slopes(bands, reached)
            gram, right = slopes.T @ slopes, slopes.T @ left
            scale = np.diag(gram) + 1e-12 * np.diag(gram).max()
            for _ in range(TRIES):
                step = np.linalg.solve(gram + np.diag(damping * scale), -right)
                moved = _move(bands, step)
                other = self._answer(moved, reached.junction)
                new = self._left(other)
                if new @ new < left @ left:
                    break
                damping *= 4
            else:
                break
            gain = 1 - (new @ new) / (left @ left)
            bands, reached, left, damping = moved, other, new, damping / 4
            if gain < ENOUGH:
                break
        return bands

    def _pull(self, stretch: Array) -> tuple[Array, Array, Array]:
        """The square over two of a stretch, the stretch and one where a band bears, smoothly over
        the onset."""
        if self._onset == 0.0:
            taut = np.maximum(stretch, 0.0)
            return taut**2 / 2, taut, (stretch > 0).astype(float)
        half = np.sqrt(stretch**2 + self._onset**2)
        taut = (stretch + half) / 2
        energy = stretch * taut / 2 + self._onset**2 / 4 * np.log(stretch + half)
        return energy, taut, taut / half

    def _answer(self, bands: Bands, start: Array) -> Answer:
        """The equilibrium, by Newton's method with halved steps on the convex energy."""
        data, a, k = self._data, bands.shares, bands.stiffness
        length = self._value @ bands.lengths.T

        def energy(at: Array) -> Array:
            out: Array = self._pull(at @ a.T - length)[0] @ k - (at * data.tension).sum(axis=1)
            return out

        junction, hold = start.copy(), HOLD * np.eye(a.shape[1])
        for _ in range(NEWTON):
            _, taut, bears = self._pull(junction @ a.T - length)
            force = (k * taut) @ a - data.tension
            if np.abs(force).max() < 1e-9:
                break
            bend = np.einsum("sj,jm,jn->smn", k * bears, a, a) + hold
            step = -np.linalg.solve(bend, force[..., None])[..., 0]
            before, fall, part = energy(junction), (force * step).sum(axis=1), np.ones(len(step))
            for _ in range(TRIES):
                high = energy(junction + part[:, None] * step) > before + 1e-4 * part * fall + 1e-14
                if not high.any():
                    break
                part[high] /= 2
            junction = junction + part[:, None] * step
        _, taut, bears = self._pull(junction @ a.T - length)
        torque = np.einsum("sj,jk,skn->sn", k * taut, bands.lengths, self._slope)
        return Answer(junction, k * taut, k * bears, torque)

    def _left(self, answer: Answer) -> Array:
        """What is left of the rows, (s (n + 3 + m),)."""
        torque = np.einsum("srn,sn->sr", self._rows, answer.torque - self._data.torque)
        moved = self._excursions * (answer.junction - self._data.excursion)
        return np.concatenate([torque, moved], axis=1).ravel()

    def _slopes(self, bands: Bands, at: Answer) -> Array:
        """Derivatives of what is left by the lengths' coefficients and the logarithms of the
        stiffnesses, (rows, J K + J)."""
        a, on = bands.shares, at.bearing
        bend = np.einsum("sj,jm,jn->smn", on, a, a) + HOLD * np.eye(a.shape[1])
        moved = np.einsum("smn,jn->sjm", np.linalg.inv(bend), a)
        arms = np.einsum("jk,skn->sjn", bands.lengths, self._slope)
        turned = np.einsum("sjm,smn->sjn", moved, np.einsum("sj,jm,sjn->smn", on, a, arms)) - arms
        rows, weight = self._rows, self._excursions
        by_length = (
            np.einsum("srn,sj,sjn->srj", rows, on, turned)[..., None] * self._value[:, None, None]
        )
        by_length += np.einsum(
            "sj,srk->srjk", at.tension, np.einsum("srn,skn->srk", rows, self._slope)
        )
        by_junction = weight * np.einsum("sj,sjm,sk->smjk", on, moved, self._value)
        stiffer = -np.einsum("srn,sj,sjn->srj", rows, at.tension, turned)
        stiffer_junction = -weight * np.einsum("sjm,sj->smj", moved, at.tension)
        lengths = np.concatenate([by_length, by_junction], axis=1)
        stiffness = np.concatenate([stiffer, stiffer_junction], axis=1)
        count = lengths.shape[0] * lengths.shape[1]
        return np.hstack([lengths.reshape(count, -1), stiffness.reshape(count, -1)])


def _move(bands: Bands, step: Any) -> Bands:
    size = bands.lengths.size
    factor = np.exp(np.clip(step[size:], -1.0, 1.0))
    return replace(
        bands,
        lengths=bands.lengths + step[:size].reshape(bands.lengths.shape),
        stiffness=np.clip(bands.stiffness * factor, SOFTEST, STIFFEST),
    )


def _parts(potential: ReducedPotential, basis: Lengths, bands: Bands) -> HoodParts:
    joints, muscles = potential.joints, potential.muscles
    names = [_name(joints, ridge) for ridge in basis.ridges]
    junctions = tuple(f"{muscle}_junction" for muscle in muscles)
    followers, sizes = {}, []
    for name, ridge in zip(names, basis.ridges, strict=True):
        middle, half = basis.centre_and_half(ridge)
        size = half / ridge.power  # so that the follower turns no faster than its joints
        power = size * Polynomial([-middle / half, 1 / half]) ** ridge.power
        weights = {j: float(w) for j, w in zip(joints, ridge.weights, strict=True) if w}
        filled = [float(c) for c in power.coef] + [0.0] * (5 - len(power.coef))
        followers[name] = Follower(weights, (filled[0], filled[1], filled[2], filled[3], filled[4]))
        sizes.append(size)
    made, middle_angle = {}, (potential.low + potential.high) / 2
    n = 1 + len(joints)
    for k, (share, length, stiffness) in enumerate(
        zip(bands.shares, bands.lengths, bands.stiffness, strict=True)
    ):
        by_angle = length[1:n] / potential.half
        weights = {j: float(s) for j, s in zip(junctions, share, strict=True) if s}
        weights |= {j: -float(w) for j, w in zip(joints, by_angle, strict=True)}
        by_ridge = length[n:] / np.array(sizes)
        weights |= {name: -float(w) for name, w in zip(names, by_ridge, strict=True)}
        rest = float(length[0] - by_angle @ middle_angle)
        made[f"band_{k + 1}"] = Band(weights, rest, float(stiffness))
    pulls = {m: {j: -1.0} for m, j in zip(muscles, junctions, strict=True)}
    return HoodParts(pulls, junctions, made, followers)


def _name(joints: tuple[str, ...], ridge: Ridge) -> str:
    summed = "_plus_".join(j for j, w in zip(joints, ridge.weights, strict=True) if w)
    return f"{summed}_{'square' if ridge.power == 2 else 'cube'}"
