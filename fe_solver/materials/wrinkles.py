"""The energy of a sheet with wrinkles at m points, its balance and its tangent (`tension_field`).

Wrinkles of the strain P = A A', A (2, 2), cost little:

    energy = W(E + P) + cost,    cost = - mu log det P + r P:P / 2

with the barrier mu and the residual stiffness r.  They grow by a symmetric X, to A (1 + X) A', so
that P stays positive; P is linear in X, by a map T from X11, X22, X12.  With log det (1 + X) =
tr X - X:X / 2 + ... the derivatives by X are

    slope     = T' (S(E + P) + r P) - mu (1, 1, 0)         zero in balance, S + r P = mu P^-1
    curvature = T' (C(E + P) + r) T + mu diag(1, 1, 2)

In balance the relaxed energy has the stress S(E + P), since its slope by P is zero; a strain dE
makes the wrinkles grow by - curvature^-1 T' C dE, so that its tangent is C - C T curvature^-1 T' C.
"""

from __future__ import annotations

from dataclasses import dataclass, is_dataclass, replace
from typing import Any, NamedTuple, cast

import numpy as np

from cosim.port import Array, Mask
from fe_solver.materials.kernels import EPSILON
from fe_solver.materials.linear import Law, Stress

SQUARED = np.array([1.0, 1.0, 0.5])
"""P:P from the squares of P11, P22 and 2 P12."""


class WrinkleCost(NamedTuple):
    """What makes wrinkles' cost."""

    barrier: Array
    """(m,) J/m3, mu."""
    residual: Array
    """(m,) Pa, r."""


@dataclass(frozen=True)
class WrinkledSheet:
    """A law at m strains, to which wrinkles add theirs."""

    law: Law
    """Its parameters are floats or (m,)."""
    strain: Array
    """(m, 3) E11, E22, 2 E12."""
    cost: WrinkleCost

    def at(self, points: Mask) -> WrinkledSheet:
        """Some of the points."""
        cost = WrinkleCost(*(x[points] for x in self.cost))
        law = cast(Law, parameters_at(self.law, points))
        return WrinkledSheet(law, self.strain[points], cost)

    def with_barrier(self, times: float) -> WrinkledSheet:
        """The sheet whose barrier is so many times as high."""
        return replace(self, cost=self.cost._replace(barrier=times * self.cost.barrier))

    def base(self, A: Array) -> Stress:
        """The law's answer at E + P."""
        return self.law.response(self.strain + wrinkle_strain(A))

    def energy(self, A: Array, base: Stress) -> Array:
        """The energy (m,) J/m3 where the law's answer is `base`."""
        residual = self.cost.residual / 2 * (np.square(wrinkle_strain(A)) @ SQUARED)
        return np.asarray(base.energy + residual - self.cost.barrier * log_det(A))

    def slope(self, A: Array, base: Stress) -> Array:
        """The energy's derivatives (m, 3) by the growth, zero in balance."""
        stress = base.stress + self.cost.residual[:, None] * SQUARED * wrinkle_strain(A)
        by_barrier = self.cost.barrier[:, None] * np.array([1.0, 1.0, 0.0])
        return np.asarray(np.einsum("mij,mi->mj", strain_by_growth(A), stress) - by_barrier)

    def curvature(self, A: Array, base: Stress) -> Array:
        """The energy's second derivatives (m, 3, 3) by the growth."""
        T = strain_by_growth(A)
        stiff = base.tangent + self.cost.residual[:, None, None] * np.diag(SQUARED)
        barrier = self.cost.barrier[:, None, None] * np.diag([1.0, 1.0, 2.0])
        return np.asarray(np.swapaxes(T, 1, 2) @ stiff @ T + barrier)

    def tangent(self, A: Array, base: Stress) -> Array:
        """The relaxed energy's second derivatives (m, 3, 3) by the sheet's strain, in balance."""
        C, by_strain = base.tangent, np.swapaxes(strain_by_growth(A), 1, 2) @ base.tangent
        growth = solve_symmetric(self.curvature(A, base), by_strain)
        out = C - np.swapaxes(by_strain, 1, 2) @ growth
        return np.asarray((out + np.swapaxes(out, 1, 2)) / 2)


def parameters_at(part: Any, points: Mask) -> Any:
    """A law, or a part of one, whose parameters that differ by point are those of some points."""
    values: dict[str, Any] = {}
    for name, value in vars(part).items():
        if is_dataclass(value):
            values[name] = parameters_at(value, points)
        elif np.ndim(value):
            values[name] = np.broadcast_to(value, points.shape)[points]
    return replace(part, **values) if values else part


def wrinkle_strain(A: Array) -> Array:
    """The strain P = A A' (m, 3) as E11, E22, 2 E12."""
    (a, b), (c, d) = np.moveaxis(A, 0, 2)
    return np.stack([a * a + b * b, c * c + d * d, 2 * (a * c + b * d)], axis=1)


def log_det(A: Array) -> Array:
    """The logarithm (m,) of the determinant of P."""
    (a, b), (c, d) = np.moveaxis(A, 0, 2)
    return np.asarray(2 * np.log(np.abs(a * d - b * c)))


def strain_by_growth(A: Array) -> Array:
    """The map T (m, 3, 3) from X11, X22, X12 to the strain that wrinkles A (1 + X) A' gain."""
    (a, b), (c, d) = np.moveaxis(A, 0, 2)
    rows = [
        [a * a, b * b, 2 * a * b],
        [c * c, d * d, 2 * c * d],
        [2 * a * c, 2 * b * d, 2 * (a * d + b * c)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def grow(A: Array, X: Array) -> Array:
    """Wrinkles' A L (m, 2, 2) of the strain A (1 + X) A', X (m, 3), with L L' = 1 + X."""
    L = np.zeros((len(X), 2, 2))
    L[:, 0, 0] = np.sqrt(1 + X[:, 0])
    L[:, 1, 0] = X[:, 2] / L[:, 0, 0]
    L[:, 1, 1] = np.sqrt(1 + X[:, 1] - L[:, 1, 0] ** 2)
    return A @ L


def solve_symmetric(matrix: Array, right: Array) -> Array:
    """The solutions (m, 3, k) of symmetric matrices (m, 3, 3), of nearly singular ones too; NaN of
    those that are singular to the last digit."""
    scale = 1 / np.sqrt(np.diagonal(matrix, axis1=1, axis2=2))[:, :, None]
    even = matrix * scale * np.swapaxes(scale, 1, 2) + EPSILON * np.eye(3)
    even[np.linalg.det(even) == 0] = np.nan
    return np.asarray(scale * np.linalg.solve(even, scale * right))


def principal_values(x: Array) -> tuple[Array, Array]:
    """The principal values (m, 2), the greater first, of tensors (m, 3) of components 11, 22, 12,
    and their directions (m, 2, 2), as columns."""
    mean, radius = (x[:, 0] + x[:, 1]) / 2, np.hypot((x[:, 0] - x[:, 1]) / 2, x[:, 2])
    angle = np.arctan2(x[:, 2], (x[:, 0] - x[:, 1]) / 2) / 2
    c, s = np.cos(angle), np.sin(angle)
    axes = np.moveaxis(np.array([[c, -s], [s, c]]), 2, 0)
    return np.stack([mean + radius, mean - radius], axis=1), axes
