"""Devices about a fingertip in motion: a cage of six walls and a hollow sphere, with friction.

A sphere sits about the fingertip.  A device takes the position p (3,) of its centre from the
device's and its twist (6,), velocity m/s and angular velocity rad/s, all in the device's axes, and
answers with the wrench (6,), force N and moment N m about the sphere's centre, that it does to the
sphere.  Both laws are Simbody's: at a point of contact with inward normal n, depth x and velocity
v = v_n n + v_t of the sphere there

    f = f_e(x) (1 - a c v_n),  at least 0;     force  f n - f mu(|v_t|) v_t / |v_t|
    mu(v) = min(v / v_0, 1) (mu_d + 2 (mu_s - mu_d) / (1 + (v / v_0)^2)) + mu_v v

(Hunt and Crossley 1975, J Appl Mech 42:440; Simbody's HuntCrossleyForce, a = 3/2, and
ElasticFoundationForce, a = 1).  Friction vanishes with the velocity: a sphere at rest feels normal
forces alone, and one that is pushed along a wall creeps until something else holds it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt
from typing import Protocol

import numpy as np

from cosim.errors import InputError
from cosim.port import Array
from rigid.mujoco.step_data import CAGE, FREE, SHELL, DeviceData


@dataclass(frozen=True)
class TipContact:
    """The sphere about the fingertip and the law's constants; one material for both bodies.

    The numbers are the thesis's (section 2.2.1); the transition velocity, which it does not give,
    is Simbody's default."""

    radius: float = 0.004
    """m."""
    stiffness: float = 20e9
    """Cage: Pa, each body's plane-strain modulus.  Shell: Pa/m, pressure over depth.  The thesis
    puts one figure into both of OpenSim's fields, whose units differ."""
    dissipation: float = 0.99
    """s/m."""
    static_friction: float = 0.1
    dynamic_friction: float = 0.03
    viscous_friction: float = 0.6
    """s/m."""
    transition_velocity: float = 0.01
    """m/s."""

    def __post_init__(self) -> None:
        positive = (self.radius, self.stiffness, self.transition_velocity)
        others = (
            self.dissipation,
            self.static_friction,
            self.dynamic_friction,
            self.viscous_friction,
        )
        if not (min(positive) > 0 and min(others) >= 0 and np.isfinite([*positive, *others]).all()):
            raise InputError(
                "fingertip contact: radius, stiffness and transition velocity must be positive, "
                f"dissipation and friction not negative, all finite; got {self}"
            )

    def surface(self, kind: int, stiffness: float, gap: float) -> DeviceData:
        """In plain numbers."""
        return DeviceData(
            kind,
            stiffness,
            gap,
            self.radius,
            self.dissipation,
            self.static_friction,
            self.dynamic_friction,
            self.viscous_friction,
            self.transition_velocity,
        )


class Device(Protocol):
    """Anything that pushes a sphere about the fingertip."""

    @property
    def surface(self) -> DeviceData:
        """The device in plain numbers, for the inner loop."""
        ...

    def energy(self, position: Array) -> float:
        """The energy, J, stored elastically at a position (3,) m."""
        ...


@dataclass(frozen=True)
class Nothing:
    """No device: a free fingertip."""

    @property
    def surface(self) -> DeviceData:
        return TipContact().surface(FREE, 0.0, np.inf)

    def energy(self, position: Array) -> float:
        return 0.0


@dataclass(frozen=True)
class _Hollow:
    """A space about the sphere."""

    contact: TipContact = TipContact()
    width: float = 0.009
    """m, between opposite walls, or the inner diameter."""

    def __post_init__(self) -> None:
        if not 0 < self.gap < np.inf:
            raise InputError(
                f"fingertip {type(self).__name__.lower()}: its width must exceed the sphere's "
                f"diameter by a gap that is positive and finite, got a gap of {self.gap} m; choose "
                "it wider"
            )

    @property
    def gap(self) -> float:
        """The distance, m, that the sphere's centre can move before it touches."""
        return self.width / 2 - self.contact.radius


@dataclass(frozen=True)
class Cage(_Hollow):
    """A cube of six walls about a sphere (thesis: 9 mm wide, sphere of 8 mm), Hunt-Crossley.

    Hertz's law between a sphere of radius R and a half-space of the same modulus E reads in
    Simbody  f_e = 4/3 E* sqrt(R) x^(3/2)  with  E* = (E^(2/3) / 2)^(3/2) = E / 2^(3/2)."""

    @property
    def hertz(self) -> float:
        """N/m^1.5."""
        return 4.0 / 3.0 * self.contact.stiffness / 2**1.5 * sqrt(self.contact.radius)

    @property
    def surface(self) -> DeviceData:
        return self.contact.surface(CAGE, self.hertz, self.gap)

    def energy(self, position: Array) -> float:
        depth = np.maximum(np.abs(position) - self.gap, 0.0)
        return float(0.4 * self.hertz * (depth**2.5).sum())


@dataclass(frozen=True)
class Shell(_Hollow):
    """A hollow sphere about a sphere (thesis: 9 mm inside, sphere of 8 mm), elastic foundation.

    Springs of stiffness k per area cover the hollow sphere (radius R_o); each points at the centre
    of the sphere (radius R) and is as deep as it reaches inside.  With the centres d apart,
    x = d - (R_o - R), their resultant along the line of centres is in closed form

        f_e = pi R_o k / d^2 [ x^2 (R_o^2 - R^2 - d^2) / 2 + 2 R x^3 / 3 - x^4 / 4 ].

    Dissipation and friction act on the resultant at the sphere's outermost point, where Simbody
    takes them spring by spring: equal at rest, and while the patch is small."""

    @property
    def surface(self) -> DeviceData:
        return self.contact.surface(SHELL, self.contact.stiffness, self.gap)

    def energy(self, position: Array) -> float:
        """Half the springs' stiffness times their depths squared: pi k R_o / d (R x^3 / 3 -
        x^4 / 4)."""
        d = float(np.linalg.norm(position))
        x = max(d - self.gap, 0.0)
        if x == 0.0:
            return 0.0
        outer = self.width / 2
        return pi * self.contact.stiffness * outer / d * x**3 * (self.contact.radius / 3 - x / 4)
