"""Interconnected tendons in joint space: what muscles' forces become at the joints.

Development and Validation of Modeling Framework for Interconnected Tendon Networks in Robotic and
Human Fingers, equations 1 to 11.  Tendons cross joints at moment arms that are constant or linear
in the joint's own angle, r_ij = a_ij + b_ij theta_i; a tendon's length function is their integral
(4).  Each muscle i pulls a junction, and springs k_j lead from it to the bones:

    f_ij = k_j [s_i - l_j(theta)]^+,    sum_j f_ij = f_i.                                 (6, 7)

The left side of (7) is piecewise linear and rises: spring j begins to bear at the force

    F_j = sum_(l_l < l_j) k_l (l_j - l_l),

so that, with these forces sorted, the springs that bear and the position s_i follow at once.
Position, tensions and torques derive from the complementary energy of the junction,

    psi_i(theta, f_i) = f_i s_i - sum_j f_ij^2 / (2 k_j),   s_i = dpsi/df_i,   tau = dpsi/dtheta,

which is why forces and excursions are conjugate, and why (11) needs no quadrature.
Tensions in N, lengths in m, angles in rad; all functions take any leading axes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cosim.errors import InputError
from cosim.port import Array


@dataclass(frozen=True)
class Arms:
    """Moment arms of k tendons about n joints, (n, k) each: r_ij = constant + slope theta_i, m and
    m/rad; positive arms flex and shorten their tendon."""

    constant: Array
    slope: Array

    def at(self, angle: Array) -> Array:
        """The arms (..., n, k) m at angles (..., n)."""
        return self.constant + self.slope * angle[..., None]

    def lengths(self, angle: Array) -> Array:
        """The lengths (..., k) m, the integral of the arms from zero angles (4): how far each
        tendon's end would move proximally."""
        return angle @ self.constant + 0.5 * angle**2 @ self.slope


class Junction(NamedTuple):
    """Equilibrium of the junction of one muscle with its p springs."""

    position: Array
    """(...) m, proximal positive."""
    tension: Array
    """(..., p) N."""


def junction(length: Array, stiffness: Array, force: Array) -> Junction:
    """Return the equilibrium of equation 7, solved exactly: lengths (..., p) m, stiffnesses (p,)
    N/m, force (...) N >= 0.

    >>> import numpy as np
    >>> from rigid.hoods.network import junction
    >>> found = junction(np.array([0.0, 1e-3]), np.array([1e3, 1e3]), np.array(3.0))
    >>> found.tension  # N: the longer tendon bears less
    array([2., 1.])
    """
    order = np.argsort(length, axis=-1)
    k = stiffness[order]
    nearest = length.min(axis=-1)
    reach = length - nearest[..., None]
    sorted_reach = np.take_along_axis(reach, order, axis=-1)
    total, held_back = np.cumsum(k, axis=-1), np.cumsum(k * sorted_reach, axis=-1)
    begins = total * sorted_reach - held_back
    last = np.maximum((begins < force[..., None]).sum(axis=-1) - 1, 0)[..., None]
    bearing, lost = (np.take_along_axis(x, last, axis=-1)[..., 0] for x in (total, held_back))
    move = (force + lost) / bearing
    return Junction(nearest + move, stiffness * np.maximum(move[..., None] - reach, 0.0))


@dataclass(frozen=True)
class Network:
    """Muscles that cross n joints themselves (`direct`, k = m muscles) and over junctions
    (`connecting`, k springs).  A muscle without springs acts by its direct arms alone.

    Raises InputError where shapes do not fit, a stiffness is not positive or a spring has no
    muscle, or more than one."""

    joints: tuple[str, ...]
    muscles: tuple[str, ...]
    direct: Arms
    connecting: Arms
    stiffness: Array
    """(k,) N/m, the diagonal of K_ct."""
    connection: Array
    """(k, m) of zeros and ones: C."""
    rest: Array
    """(k,) m: lengths at zero angles, positive for a spring that is slack there by so much."""

    def __post_init__(self) -> None:
        n, m, k = len(self.joints), len(self.muscles), len(self.stiffness)
        arms = [x.shape for a in (self.direct, self.connecting) for x in (a.constant, a.slope)]
        shapes = [*arms, self.connection.shape, self.rest.shape]
        if shapes != [(n, m), (n, m), (n, k), (n, k), (k, m), (k,)]:
            raise InputError(
                f"tendon network of {n} joints, {m} muscles, {k} connecting tendons: expected "
                f"direct arms (n, m), connecting arms (n, k), C (k, m), rest (k,); got {shapes}"
            )
        if not (self.stiffness > 0).all() or not (self.connection.sum(axis=1) == 1).all():
            raise InputError(
                "tendon network: expected positive stiffnesses (N/m), and each connecting tendon "
                f"on one muscle; got {self.stiffness} and C = {self.connection.tolist()}"
            )

    def lengths(self, angle: Array) -> Array:
        """The connecting tendons' lengths (..., k) m, l_ct(theta) (4)."""
        return self.connecting.lengths(angle) + self.rest

    def solve(self, angle: Array, force: Array) -> tuple[Array, Array]:
        """Junction positions (..., m) m and connecting tensions (..., k) N at angles (..., n) and
        muscle forces (..., m) (6, 7); the position is 0 for a muscle without a junction."""
        length = self.lengths(angle)
        leading = np.broadcast_shapes(length.shape[:-1], force.shape[:-1])
        position = np.zeros((*leading, force.shape[-1]))
        tension = np.zeros((*leading, length.shape[-1]))
        for i, springs in enumerate(self.connection.T.astype(bool)):
            if springs.any():
                met = junction(length[..., springs], self.stiffness[springs], force[..., i])
                position[..., i], tension[..., springs] = met.position, met.tension
        return position, tension

    def distribution(self, angle: Array, force: Array) -> Array:
        """The tension shares (..., k, m): T(theta, f) (8), of forces (..., m) above zero; with the
        operating forces it is the constant T(theta) of (9)."""
        _, tension = self.solve(angle, force)
        return self.connection * tension[..., None] / force[..., None, :]

    def effective_arms(self, angle: Array, force: Array) -> Array:
        """The effective moment arms (..., n, m) m: R = R_m + R_ct T (10)."""
        through = self.connecting.at(angle) @ self.distribution(angle, force)
        return self.direct.at(angle) + through

    def torque(self, angle: Array, force: Array) -> Array:
        """The joint torques (..., n) N m (2)."""
        _, tension = self.solve(angle, force)
        arms = ((self.direct, force), (self.connecting, tension))
        return sum((np.einsum("...nk,...k->...n", a.at(angle), f) for a, f in arms), np.zeros(()))

    def complementary_energy(self, angle: Array, force: Array) -> Array:
        """The complementary energy (..., m) J: psi of each muscle's junction."""
        position, tension = self.solve(angle, force)
        return force * position - (tension**2 / (2 * self.stiffness)) @ self.connection

    def excursion(self, angle: Array, force: Array) -> Array:
        """The excursions (..., m) m: how far each muscle's end has moved proximally from where all
        arms integrate to zero, with the springs' stretch under the forces (..., m)."""
        position, _ = self.solve(angle, force)
        return self.direct.lengths(angle) + position

    def constant_force_excursion(self, angle: Array, operating: Array) -> Array:
        """The excursions (..., m) m by the integral of R^T at constant operating forces (11), but
        for a constant."""
        return self.direct.lengths(angle) + self.complementary_energy(angle, operating) / operating

    def sharing(self, angle: Array, force: Array) -> Array:
        """The derivatives (..., k, m) of the connecting tensions by the muscles' forces; of the
        springs that bear, their parts of the stiffness at the junction."""
        return self.sharing_at(angle, self.solve(angle, force)[0])

    def sharing_at(self, angle: Array, position: Array) -> Array:
        """The same with the junctions at their positions (..., m) m of `solve`."""
        slack = self.lengths(angle)[..., None] - position[..., None, :]
        bearing = self.connection * self.stiffness[:, None] * (slack <= 0)
        total = bearing.sum(axis=-2, keepdims=True)
        return np.divide(bearing, total, out=np.zeros_like(bearing), where=total > 0)
