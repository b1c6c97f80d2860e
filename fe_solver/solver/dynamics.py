"""The shell in motion: density, viscosity, and one implicit step in time.

A step of Newmark's method (average acceleration, with numerical damping `damping` a: gamma = 1/2 +
a, beta = (1 + a)^2 / 4) is the minimum of the potential energy and of springs to where inertia
would take the nodes (Radovitzky and Ortiz 1999, Comput Methods Appl Mech Eng 172:203), so that the
one Newton finds it.  Directors carry their rotary inertia and move along straight lines in a step.
Viscosity is Kelvin and Voigt's: a second stress, linear in the strain's rate (backward Euler).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.port import Array
from fe_solver.elements.mesh_geometry import corner_shares
from fe_solver.forces.cables import cable_masses
from fe_solver.forces.loads import Inertia
from fe_solver.materials.linear import Isotropic
from fe_solver.materials.section import Resultants, Section, one_law
from fe_solver.solver.model import Configuration, ShellModel
from fe_solver.solver.newton import NewtonOptions, Solution, solve


@dataclass(frozen=True)
class Substance:
    """What resists motion: density (kg/m3), and viscosity (Pa s) of a uniaxial stretch."""

    density: float
    viscosity: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite([self.density, self.viscosity]).all() and self.density > 0):
            raise InputError(f"density must be positive and both finite, got {self}")
        if self.viscosity < 0:
            raise InputError(f"viscosity must not be negative, got {self.viscosity} Pa s")


@dataclass(frozen=True)
class DynamicState:
    """A shell in motion."""

    configuration: Configuration
    velocity: Array
    """(n, 3) m/s, of the nodes."""
    spin: Array
    """(n, 3) 1/s, rates of the directors."""
    acceleration: Array
    """(n, 3) m/s2, of the nodes."""
    turning: Array
    """(n, 3) 1/s2, accelerations of the directors."""


@dataclass(frozen=True)
class Viscous:
    """A section with a damper beside it, which started the step at the strain `before` (ne, 4,
    8)."""

    base: Section
    damper: Section
    before: Array

    @property
    def thickness(self) -> Array:
        """Thickness at the Gauss points (ne, g), m."""
        return self.base.thickness

    @property
    def smoothing(self) -> float | None:
        """As of `Section`."""
        return self.base.smoothing

    def with_smoothing(self, least: float) -> Viscous:
        """As of `Section`; the damper has no tension field."""
        return replace(self, base=self.base.with_smoothing(least))

    def tension_state(self, strain: Array) -> NDArray[np.int8]:
        """As of `Section`."""
        return self.base.tension_state(strain)

    def response(self, strain: Array) -> Resultants:
        """As of `Section`; the energy is that of the step's incremental potential."""
        elastic, viscous = self.base.response(strain), self.damper.response(strain - self.before)
        return Resultants(*(a + b for a, b in zip(elastic, viscous, strict=True)))

    def stress(self, strain: Array, z: float = 0.0) -> Array:
        """The elastic part, Pa."""
        return self.base.stress(strain, z)


def at_rest(c: Configuration) -> DynamicState:
    """A configuration that does not move (and feels no force)."""
    none = np.zeros_like(c.x)
    return DynamicState(c, none, none, none, none)


def masses(model: ShellModel, substance: Substance) -> tuple[Array, Array]:
    """The masses (n,) kg of the nodes and the inertias (n,) kg m2 of their directors: density times
    thickness, and times a twelfth of its cube, over each node's share of the area; and the cables'
    mass."""
    h = model.section.thickness
    share = corner_shares(model.quads)
    out = []
    for power in (h, h**3 / 12):
        element = (model.tables.weight * power).sum(axis=1) * substance.density
        spread = (element[:, None] * share).ravel()
        out.append(np.bincount(model.quads.ravel(), weights=spread, minlength=len(model.reference)))
    cables = cable_masses(model.cables, substance.density, len(model.reference))
    return out[0] + cables, out[1].astype(float)


def advance(
    model: ShellModel,
    state: DynamicState,
    tension: Array,
    dt: float,
    substance: Substance,
    options: NewtonOptions,
    damping: float = 0.0,
) -> tuple[DynamicState, Solution]:
    """One step of `dt` s; bodies are where `state` has them (see `ShellModel.move_bodies`).

    Raises InputError for a step that is not positive and ConvergenceError as `newton.solve`."""
    if not (np.isfinite(dt) and dt > 0 and 0 <= damping <= 1):
        raise InputError(f"expected dt > 0 (s) and damping in [0, 1], got {dt} and {damping}")
    beta, gamma = (1 + damping) ** 2 / 4, 0.5 + damping
    c = state.configuration
    mass, rotary = masses(model, substance)
    ahead = c.x + dt * state.velocity + dt**2 * (0.5 - beta) * state.acceleration
    turned = c.d + dt * state.spin + dt**2 * (0.5 - beta) * state.turning
    pull = beta * dt**2
    stepping = model.with_changes(
        inertia=Inertia(mass / pull, ahead, rotary / pull, turned),
        section=_viscous_section(model, c, dt, substance),
    )
    solution = solve(stepping, _guess(model, c, ahead), tension, options, near=True)
    end = solution.configuration
    acceleration, turning = (end.x - ahead) / pull, (end.d - turned) / pull
    velocity = state.velocity + dt * (gamma * acceleration + (1 - gamma) * state.acceleration)
    spin = state.spin + dt * (gamma * turning + (1 - gamma) * state.turning)
    return DynamicState(end, velocity, spin, acceleration, turning), solution


def kinetic_energy(model: ShellModel, state: DynamicState, substance: Substance) -> float:
    """The kinetic energy (J) of nodes and directors."""
    mass, rotary = masses(model, substance)
    return float(mass @ (state.velocity**2).sum(1) + rotary @ (state.spin**2).sum(1)) / 2


def _viscous_section(
    model: ShellModel, c: Configuration, dt: float, substance: Substance
) -> Section:
    if substance.viscosity == 0.0:
        return model.section
    damper = one_law(Isotropic(substance.viscosity / dt, 0.0), model.section.thickness)
    y = np.concatenate([c.x[model.quads], c.d[model.quads]], axis=1)
    damped: Section = Viscous(model.section, damper, model.tables.strain(y))  # type: ignore[assignment]
    return damped


def _guess(model: ShellModel, c: Configuration, ahead: Array) -> Configuration:
    """The nodes that are free where inertia alone would take them."""
    x = ahead.copy()
    for held in (model.ties.node, model.guides.node):
        x[held] = c.x[held]
    return replace(c, x=x)
