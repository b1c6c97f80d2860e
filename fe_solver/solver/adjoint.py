"""Adjoint sensitivities: how a scalar result changes with the shell's parameters.

At an equilibrium R(u, p) = 0 a scalar J(u, p) changes with a parameter p by

    dJ/dp = @J/@p - L . @R/@p,    K L = @J/@u,

with the one factorisation K of the solution for all parameters (Tortorelli and Michaleris 1994,
Inverse Probl Eng 1:71).  The partial derivatives by p are central differences at the frozen
configuration, where R and J are smooth in p: nothing is solved again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fe_solver.materials.section import Section
from fe_solver.solver.body_coupling import coupling, wrenches
from fe_solver.solver.model import Configuration, Evaluation, ShellModel
from fe_solver.solver.newton import Solution

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Change = Callable[[float], ShellModel]
"""The model with a parameter changed by a fraction of itself (or, of a length, by metres)."""

STEP = 1e-5
LENGTH_STEP = 1e-8
"""m."""


class Scalar(Protocol):
    """A result that depends on the configuration and, it may be, on the parameters."""

    def value(self, model: ShellModel, c: Configuration, e: Evaluation, tension: Array) -> float:
        """At a configuration, in equilibrium or not."""
        ...

    def gradient(self, model: ShellModel, c: Configuration, e: Evaluation, tension: Array) -> Array:
        """(5n,) by the degrees of freedom in the nodes' bases."""
        ...


@dataclass(frozen=True)
class WrenchOf:
    """Sum of weights (nb, 6) times the wrench of the shell on each body."""

    weights: Array

    def value(self, model: ShellModel, c: Configuration, e: Evaluation, tension: Array) -> float:
        """N, N m, as the weights are."""
        return float(np.vdot(self.weights, sum(wrenches(model, c, e, tension).values())))

    def gradient(self, model: ShellModel, c: Configuration, e: Evaluation, tension: Array) -> Array:
        """By reciprocity from the residual's dependence on the bodies' poses."""
        return -coupling(model, c, e, tension)[0] @ self.weights.ravel()


@dataclass(frozen=True)
class ExcursionOf:
    """Sum of weights (nt,) times the tendons' excursions."""

    weights: Array

    def value(self, model: ShellModel, c: Configuration, e: Evaluation, tension: Array) -> float:
        """m."""
        return float(self.weights @ model.excursion(c))

    def gradient(self, model: ShellModel, c: Configuration, e: Evaluation, tension: Array) -> Array:
        """The tendons' pulls."""
        return -coupling(model, c, e, tension)[2] @ self.weights


@dataclass(frozen=True)
class PositionOf:
    """Sum of weights (n, 3) times the nodes' positions."""

    weights: Array

    def value(self, model: ShellModel, c: Configuration, e: Evaluation, tension: Array) -> float:
        """m."""
        return float(np.vdot(self.weights, c.x))

    def gradient(self, model: ShellModel, c: Configuration, e: Evaluation, tension: Array) -> Array:
        """The weights in the nodes' bases."""
        out = np.zeros((len(c.x), 5))
        out[:, :3] = np.einsum("nij,ni->nj", e.bases[0], self.weights)
        return out.ravel()


@dataclass(frozen=True)
class StrainOf:
    """Sum of weights (ne, 4, 8) times the generalized strains at the Gauss points."""

    weights: Array

    def value(self, model: ShellModel, c: Configuration, e: Evaluation, tension: Array) -> float:
        """As the strains (and, of bending, 1/m) are weighted."""
        y = np.concatenate([c.x[model.quads], c.d[model.quads]], axis=1)
        return float(np.vdot(self.weights, model.tables.strain(y)))

    def gradient(self, model: ShellModel, c: Configuration, e: Evaluation, tension: Array) -> Array:
        """The nodal forces that stress resultants equal to the weights would make."""
        y = np.concatenate([c.x[model.quads], c.d[model.quads]], axis=1)
        by_x, by_d = model.nodal(model.tables.forces(y, self.weights))
        A, T = e.bases
        parts = [np.einsum("nij,ni->nj", A, by_x), np.einsum("nij,ni->nj", T, by_d)]
        return np.concatenate(parts, axis=1).ravel()


def sensitivities(
    solution: Solution, scalar: Scalar, changes: Mapping[str, tuple[Change, float]]
) -> dict[str, float]:
    """dJ/dp of every named parameter: its `Change` and the step of the differences (see `modulus`,
    `thickness`, `stiffness`, `slack`).  Per fraction of a parameter, or per metre of a length."""
    model, c, e = solution.model, solution.configuration, solution.evaluation
    tension, free = solution.tension, solution.model.free
    gradient = scalar.gradient(model, c, e, tension)[free]
    adjoint = solution.factor.solve(gradient)

    def at(changed: ShellModel) -> tuple[Array, float]:
        there = changed.evaluate(c, tension, tangent=False)
        return there.reduced[free], scalar.value(changed, c, there, tension)

    out = {}
    for name, (change, step) in changes.items():
        (r1, j1), (r0, j0) = at(change(step)), at(change(-step))
        out[name] = float((j1 - j0 - adjoint @ (r1 - r0)) / (2 * step))
    return out


def modulus(model: ShellModel, elements: Mask) -> tuple[Change, float]:
    """All moduli of the laws of the elements (ne,), by the same fraction."""

    def change(fraction: float) -> ShellModel:
        more = 1 + fraction * elements[:, None]
        patches = [replace(p, factor=p.factor * more[p.elements]) for p in model.section.patches]
        return replace(model, section=Section(tuple(patches)))

    return change, STEP


def thickness(model: ShellModel, elements: Mask) -> tuple[Change, float]:
    """The thickness of the elements (ne,), by a fraction; the mid-surface stays where it is."""

    def change(fraction: float) -> ShellModel:
        more = 1 + fraction * elements[:, None]
        patches = [
            replace(p, thickness=p.thickness * more[p.elements]) for p in model.section.patches
        ]
        return replace(model, section=Section(tuple(patches)))

    return change, STEP


def stiffness(model: ShellModel, group: int) -> tuple[Change, float]:
    """The stiffness of a group of springs, by a fraction."""
    s = model.springs

    def change(fraction: float) -> ShellModel:
        factor = np.where(s.group == group, 1 + fraction, 1.0)
        return replace(model, springs=replace(s, stiffness=s.stiffness * factor))

    return change, STEP


def slack(model: ShellModel, group: int) -> tuple[Change, float]:
    """The slack length of a group of springs, by metres."""
    s = model.springs

    def change(metres: float) -> ShellModel:
        more = np.where(s.group == group, metres, 0.0)
        return replace(model, springs=replace(s, length=s.length + more))

    return change, LENGTH_STEP
