"""Tension field: the relaxed energy of a sheet too thin to bear compression.

Wrinkles add a positive semidefinite strain P that costs nothing (Pipkin 1986, IMA J Appl Math
36:85; Steigmann 1990, Proc R Soc A 429:141):

    W*(E) = min over P >= 0 of W(E + P) = max over S >= 0 of S.E - S.A.S / 2,    A = Q^-1

The sheet is taut (P = 0), slack (S = 0) or wrinkled with S = s t(x)t, and then by the second form
W* = max over t of (t.E.t)^2 / (2 A_tttt), t.E.t > 0: a search over one angle.  Stretching the axes
by the fourth roots of the moduli makes A_tttt = 1 + q sin^2 x of every orthotropic sheet, with x
twice the angle of t and q = 0 for an isotropic one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .materials import Array, Linear, Mask, Real, Stress, require, symmetric

SAMPLES = 9
"""Of each half of the quadrant of x in which the maximum lies."""
ISOTROPIC = 1e-14
"""Of q: rounding."""
MOST_STEPS = 60
CONVERGED = 1e-12
"""The last step, rad; those before it double the digits."""


class _Scaled(NamedTuple):
    """Strains on stretched axes, where A1111 = A2222 = 1."""

    stretch: tuple[Array, Array, Array]
    """Of E11, E22, 2 E12: E' = stretch E, S = stretch S'."""
    strain: tuple[Array, Array, Array]
    """E'."""
    q: Array
    mean: Array
    radius: Array
    """Of Mohr's circle of E'."""
    angle: Array
    """Of E' on Mohr's circle, from axis 1."""


def _scaled(Q: Array, strain: Array, points: Mask) -> _Scaled:
    """Of the points (a mask) alone."""
    det = Q[..., 0, 0] * Q[..., 1, 1] - Q[..., 0, 1] ** 2
    E1, E2 = det / Q[..., 1, 1], det / Q[..., 0, 0]
    root = np.sqrt(E1 * E2)
    q = (root / Q[..., 2, 2] - 2 * Q[..., 0, 1] * root / det - 2) / 4
    q = np.where(np.abs(q) < ISOTROPIC, 0.0, q)
    constants = (np.sqrt(E1), np.sqrt(E2), np.sqrt(root), q)
    s1, s2, s3, q = (
        x if x.ndim == 0 else np.broadcast_to(x, points.shape)[points] for x in constants
    )
    e1, e2, e3 = s1 * strain[points, 0], s2 * strain[points, 1], s3 * strain[points, 2]
    mean, half, shear = (e1 + e2) / 2, (e1 - e2) / 2, e3 / 2
    radius, angle = np.hypot(half, shear), np.arctan2(shear, half)
    return _Scaled((s1, s2, s3), (e1, e2, e3), q, mean, radius, angle)


def _slope(s: tuple[Array, ...], x: Array) -> tuple[Array, Array]:
    """Minus the logarithmic slope of (t.E'.t) / sqrt(1 + q sin^2 x), times what is positive, and
    its derivative by x; s is mean, radius, angle and q."""
    mean, radius, angle, q = s
    sin, cos = np.sin(x), np.cos(x)
    e, drop = mean + radius * np.cos(x - angle), radius * np.sin(x - angle)
    A = 1 + q * sin * sin
    value = drop * A + e * q * sin * cos
    rate = (e - mean) * A + drop * q * sin * cos + e * q * (cos * cos - sin * sin)
    return value, rate


def _height(s: tuple[Array, ...], x: Array) -> Array:
    """What the direction of tension maximises; its sign is that of the strain along it."""
    mean, radius, angle, q = s
    return (mean + radius * np.cos(x - angle)) / np.sqrt(1 + q * np.sin(x) ** 2)


def _highest(s: tuple[Array, ...], start: float, end: float) -> Array:
    """x of the highest point between start and end: samples, then Newton kept in a bracket."""
    grid = np.linspace(start, end, SAMPLES).reshape(-1, *[1] * s[0].ndim)
    best = np.argmax(_height(s, grid), axis=0)
    step = (end - start) / (SAMPLES - 1)
    x = start + best * step
    low, high = np.maximum(x - step, 0.0), np.minimum(x + step, np.pi / 2)
    rising, falling = _slope(s, high)[0] < 0, _slope(s, low)[0] > 0
    x = np.where(rising, high, np.where(falling, low, x))
    ends = rising | falling
    for _ in range(MOST_STEPS):
        value, rate = _slope(s, x)
        low, high = np.where(value < 0, x, low), np.where(value > 0, x, high)
        with np.errstate(divide="ignore", invalid="ignore"):
            new = x - value / rate
        inside = (rate > 0) & (new >= low) & (new <= high)
        new = np.where(ends | (value == 0), x, np.where(inside, new, (low + high) / 2))
        moved = np.abs(new - x).max(initial=0.0)
        x = new
        if moved <= CONVERGED:
            break
    return x


def _direction(s: _Scaled) -> Array:
    """x (twice the angle of the tension from axis 1) of wrinkled points, on stretched axes.

    By the symmetries of A the maximum lies in the quadrant of the strain's own angle."""
    if not np.any(s.q):
        return s.angle
    folded = np.arctan2(np.abs(np.sin(s.angle)), np.abs(np.cos(s.angle)))
    problem = (s.mean, s.radius, folded, s.q)
    one, two = _highest(problem, 0.0, np.pi / 4), _highest(problem, np.pi / 4, np.pi / 2)
    x = np.where(_height(problem, one) >= _height(problem, two), one, two)
    return np.arctan2(
        np.copysign(np.sin(x), np.sin(s.angle)), np.copysign(np.cos(x), np.cos(s.angle))
    )


def _wrinkled(s: _Scaled) -> Stress:
    """Energy, stress and tangent (on the given axes) of wrinkled points, zero at slack ones.

    W(E, x) = e^2 / (2 A) is at its maximum by x, so that the tangent is W_EE - W_Ex W_xE / W_xx."""
    x = _direction(s)
    sin, cos = np.sin(x), np.cos(x)
    v = ((1 + cos) / 2, (1 - cos) / 2, sin / 2)
    v_x = (-sin / 2, sin / 2, cos / 2)
    e = np.maximum(v[0] * s.strain[0] + v[1] * s.strain[1] + v[2] * s.strain[2], 0)
    e_x = v_x[0] * s.strain[0] + v_x[1] * s.strain[1] + v_x[2] * s.strain[2]
    A, A_x = 1 + s.q * sin * sin, 2 * s.q * sin * cos
    A_xx = 2 * s.q * (cos * cos - sin * sin)
    tension, tension_x = e / A, e_x / A - e * A_x / A**2
    W_xx = tension_x * e_x + tension * (s.mean - e) - tension * tension_x * A_x
    W_xx = W_xx - tension**2 * A_xx / 2
    bears = e > 0
    taut, turning = bears / A, bears / np.where(W_xx < 0, -W_xx, np.inf)
    mixed = [tension * d + tension_x * n for d, n in zip(v_x, v, strict=True)]
    stress = np.stack([k * tension * n for k, n in zip(s.stretch, v, strict=True)], -1)
    entries: dict[tuple[int, int], Real] = {
        (i, k): s.stretch[i] * s.stretch[k] * (taut * v[i] * v[k] + turning * mixed[i] * mixed[k])
        for i in range(3)
        for k in range(i, 3)
    }
    return Stress(e * tension / 2, stress, symmetric(entries, e.shape))


@dataclass(frozen=True)
class TensionField:
    """A linear law without compression: (1 - residual) W* + residual W of the base law.

    `residual` (default 1e-3) is the share of its stiffness that a slack sheet keeps, for a tangent
    that is not singular; it adds as much of the base law's compression.  Use it for the membrane
    strain; bending is the base law's."""

    base: Linear
    residual: float = 1e-3

    def __post_init__(self) -> None:
        fine = 0 <= self.residual < 1
        require(self, "residual", self.residual, fine, "it must lie between 0 and 1, 1 excluded")

    def response(self, strain: Array) -> Stress:
        """See `materials.Law.response`: any strain has an answer."""
        full = self.base.response(strain)
        S, share = full.stress, self.residual
        taut = (S[..., 0] + S[..., 1] >= 0) & (S[..., 0] * S[..., 1] >= S[..., 2] ** 2)
        if taut.all():
            return full
        loose = ~taut
        w = _wrinkled(_scaled(self.base.plane(), strain, loose))
        energy, stress, tangent = np.array(full.energy), full.stress, full.tangent.copy()
        energy[loose] = share * energy[loose] + (1 - share) * w.energy
        stress[loose] = share * stress[loose] + (1 - share) * w.stress
        tangent[loose] = share * tangent[loose] + (1 - share) * w.tangent
        return Stress(energy, stress, tangent)

    def shear(self) -> tuple[Real, Real]:
        return self.base.shear()
