"""A planar chain of rigid links in closed form, and the finger of Buchner et al. 1988.

Buchner, Hines and Hemami, A dynamic model for finger interphalangeal coordination, J Biomech 21
(1988), equation 7 and appendix: with the links' angles theta_i from the vertical, clockwise,

    J(theta) theta'' + J1(theta) theta'^2 + G(theta) = Q,

    J_ij = a_ij cos(theta_i - theta_j),   J1_ij = a_ij sin(theta_i - theta_j),
    a_ii = I_i + m_i k_i^2 + d_i^2 sum_l>i m_l,
    a_ij = d_i (m_j k_j + d_j sum_l>j m_l),  i < j,
    G_i = -g sin(theta_i) (m_i k_i + d_i sum_l>i m_l),

d lengths, k distances of the centres of mass from the proximal joints, I inertias about them.  G is
minus the gradient of what lifts the links, theta = 0 pointing up.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cosim.errors import InputError
from cosim.port import Array
from rigid.model import FingerModel, Hinge, Segment

STANDARD_GRAVITY = 9.80665


@dataclass(frozen=True)
class PlanarChain:
    """Arrays (n,) from the proximal link on: m, m, kg, kg m2."""

    length: Array
    centre: Array
    mass: Array
    inertia: Array
    gravity: float = STANDARD_GRAVITY
    """Gravity in m/s2, downwards."""

    def __post_init__(self) -> None:
        shapes = {np.shape(x) for x in (self.length, self.centre, self.mass, self.inertia)}
        if len(shapes) != 1 or not (self.length > 0).all() or not (self.mass > 0).all():
            raise InputError(
                "planar chain: expected as many lengths, centres, masses and inertias as links, "
                f"lengths and masses positive; got {self}"
            )

    def acceleration(self, angle: Array, rate: Array, torque: Array, tip_force: Array) -> Array:
        """The joints' accelerations (n,) rad/s2.

        angle, rate: (n,) of the joints in rad, flexion positive, the first from the horizontal;
        torque: (n,) N m on the joints; tip_force: (2,) N on the end, forward and up."""
        theta, speed = np.pi / 2 + np.cumsum(angle), np.cumsum(rate)
        apart = theta[:, None] - theta
        joint = torque - np.append(torque[1:], 0.0)
        reach = self.length[:, None] * np.stack([np.cos(theta), -np.sin(theta)], axis=1)
        inertia, centrifugal = self.coupling * np.cos(apart), self.coupling * np.sin(apart)
        force = joint + reach @ tip_force - centrifugal @ speed**2
        force += self.gravity * np.sin(theta) * self.first_moment
        return np.diff(np.linalg.solve(inertia, force), prepend=0.0)

    def energy(self, angle: Array, rate: Array) -> float:
        """The energy, J, kinetic and of height."""
        theta, speed = np.pi / 2 + np.cumsum(angle), np.cumsum(rate)
        inertia = self.coupling * np.cos(theta[:, None] - theta)
        height = self.gravity * self.first_moment @ np.cos(theta)
        return float(0.5 * speed @ inertia @ speed + height)

    @property
    def _beyond(self) -> Array:
        """The mass of the links after each, kg."""
        return np.cumsum(self.mass[::-1])[::-1] - self.mass

    @cached_property
    def first_moment(self) -> Array:
        """The links' first moments (n,) kg m: m_i k_i + d_i sum_l>i m_l."""
        return self.mass * self.centre + self.length * self._beyond

    @cached_property
    def coupling(self) -> Array:
        """The inertial coupling a_ij, (n, n) kg m2."""
        a = np.triu(self.length[:, None] * self.first_moment, 1)
        own = self.inertia + self.mass * self.centre**2 + self.length**2 * self._beyond
        return a + a.T + np.diag(own)

    def model(self, names: tuple[str, ...] = ("proximal", "middle", "distal")) -> FingerModel:
        """The same chain for MuJoCo: flexion about +y, bones along x, z up; gravity is the finger's
        to state."""
        joints = ("MCP", "PIP", "DIP")
        segments = [Segment("metacarpal", -0.04)]
        before = 0.0
        for i, name in enumerate(names):
            segments.append(
                Segment(
                    name,
                    float(self.length[i]),
                    (before, 0.0, 0.0),
                    hinges=(Hinge(joints[i], (0.0, 1.0, 0.0)),),
                    mass=float(self.mass[i]),
                    inertia=(float(self.inertia[i]),) * 3,
                    centre=(float(self.centre[i]), 0.0, 0.0),
                )
            )
            before = float(self.length[i])
        return FingerModel("planar finger", tuple(segments), (before, 0.0, 0.0))


BUCHNER = PlanarChain(
    length=np.array([0.046, 0.028, 0.020]),
    centre=np.array([0.023, 0.014, 0.010]),
    mass=np.array([0.125, 0.060, 0.040]),
    inertia=np.array([22e-6, 3.92e-6, 1.33e-6]),
)
"""Table 2: four fingers that move together."""
