"""A hood reduced to one potential of joint angles and tensions, whatever it was before.

A tendon network has excursions and torques from one complementary energy psi(theta, T) of joint
angles and muscle tensions: x = dpsi/dT, tau = dpsi/dtheta (`rigid.hoods.network`).  In a hood that
is a sheet arms bend with the angles and shift with the load, and muscles share what bears on the
bones. Here psi is

    psi = sum_ag c_ag B_a(u) G_g(t),   B_a = prod_j u_j^p_aj,   G_g = prod_m f_(q_gm)(t_m),
    u = (theta - centre) / half,       t = T / most,
    f_0 = 1,  f_1 = t,  f_2 = t^2,  f_3 = (t + toe) log(1 + t / toe) - t,

so that arms are the exact derivatives of length functions: reciprocity holds to rounding whatever
the coefficients.  The terms of f_1 alone are length functions of connecting tendons (equation 4 of
the network's paper), f_2 and f_3 are what springs in series add, a straight one and one with an
exponential toe (T ~ exp(e) - 1, whose stretch is df_3/dt = log(1 + t / toe)), products what muscles
share.  A slip's force is what makes torques by its arms, so that it follows from them by what are
inverse arms, polynomials of the angles too:

    F_s = sum_b B_b(u) (d_sb0 + sum_j d_sbj tau_j).

A polynomial says nothing outside of the box where it was fitted: there it is refused.
Angles in rad, tensions in N, energies in J; all functions take any leading axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cosim.errors import ConvergenceError, InputError
from cosim.port import Array, Motion, Response
from rigid.hoods.joint_angles import Joint
from rigid.hoods.joint_hood import PROXIMAL, Derived, JointHood, JointState
from rigid.hoods.reduced_basis import (
    Basis,
    Numbers,
    derivatives,
    loadings,
    monomials,
    orders,
    powers_of,
    springs_of,
    unscale,
)
from rigid.model import Vector

SLIPS = ("central", "terminal")
AT_ONCE = 200
"""States whose products fit into a processor's cache: ten times faster than all at once."""
MARGIN = 0.1
"""Share of a box's width: so far beyond it the polynomial is still taken."""


@dataclass(frozen=True)
class ReducedPotential:
    """psi and the slips' forces over a box of angles and tensions.

    Raises InputError where shapes do not fit or a box is empty."""

    joints: tuple[str, ...]
    muscles: tuple[str, ...]
    low: Array
    """(n,) rad."""
    high: Array
    """(n,) rad."""
    most: Array
    """(m,) N: tensions run from zero to this, which is their scale."""
    angle_powers: Numbers
    """(A, n) whole numbers."""
    tension_terms: Numbers
    """(G, m) of 0 to 3, which f stands for each muscle."""
    toe: float
    """The end of the toe as a share of `most`."""
    energy: Array
    """(A, G) J."""
    slip_powers: Numbers
    """(B, n) whole numbers."""
    slip: Array
    """(2, B, 1 + n) N and 1/m, central and terminal."""

    def __post_init__(self) -> None:
        n, m = len(self.joints), len(self.muscles)
        a, g, b = len(self.angle_powers), len(self.tension_terms), len(self.slip_powers)
        parts = (self.low, self.high, self.most, self.angle_powers, self.tension_terms)
        shapes = [np.shape(x) for x in (*parts, self.energy, self.slip_powers, self.slip)]
        if shapes != [(n,), (n,), (m,), (a, n), (g, m), (a, g), (b, n), (2, b, 1 + n)]:
            raise InputError(
                f"reduced hood of {n} joints and {m} muscles: expected bounds ({n},), ({n},) and "
                f"({m},), powers (A, {n}), terms (G, {m}), energy (A, G), powers (B, {n}) and "
                f"slips (2, B, {1 + n}); got {shapes}"
            )
        if not ((self.high > self.low).all() and (self.most > 0).all()):
            raise InputError("reduced hood: a range of its angles or tensions is empty")

    @property
    def half(self) -> Array:
        """Half the ranges (n,) of the angles, rad."""
        return (self.high - self.low) / 2

    def bases(self, angle: Array, tension: Array) -> tuple[Basis, Basis]:
        """In rad and N, of the angles (..., n) and of the tensions (..., m)."""
        first = monomials(self.angle_powers, self.scaled_angle(angle))
        second = loadings(self.tension_terms, tension / self.most, self.toe)
        return unscale(first, self.half), unscale(second, self.most)

    def derivatives(self, angle: Array, tension: Array) -> Derived:
        """At angles (..., n) and tensions (..., m)."""
        b, g = self.bases(angle, tension)
        by_force = np.einsum("ag,...gm->...am", self.energy, g.slope)
        at_force = np.einsum("ag,...g->...a", self.energy, g.value)
        by_forces = np.einsum("ag,...gmk->...amk", self.energy, g.curve)
        return Derived(
            np.einsum("...a,...an->...n", at_force, b.slope),
            np.einsum("...a,...am->...m", b.value, by_force),
            np.einsum("...a,...ank->...nk", at_force, b.curve),
            np.einsum("...an,...am->...nm", b.slope, by_force),
            np.einsum("...a,...amk->...mk", b.value, by_forces),
        )

    def derivatives_at(self, angle: Array, tension: Array) -> Derived:
        """As `derivatives`, of one state (n,) and (m,), without a batch's expense."""
        by_angle, by_tension = 1 / self.half, 1 / self.most
        first = np.stack(powers_of(int(self.angle_powers.max()), self.scaled_angle(angle)))
        second = np.stack(springs_of(tension * by_tension, self.toe))
        b = derivatives(self.angle_powers, first * orders(by_angle))
        g = derivatives(self.tension_terms, second * orders(by_tension))
        n, m = len(self.joints) + 1, len(self.muscles) + 1
        made = b.reshape(n * n, -1) @ self.energy @ g.reshape(m * m, -1).T
        by = made.reshape(n, n, m, m)
        return Derived(
            by[1:, 0, 0, 0], by[0, 0, 1:, 0], by[1:, 1:, 0, 0], by[1:, 0, 1:, 0], by[0, 0, 1:, 1:]
        )

    def slips(self, angle: Array, torque: Array) -> Array:
        """The slips' forces (..., 2) N, central and terminal, at angles (..., n) and torques (...,
        n); a slip bears tension alone."""
        forces = np.einsum("...ba,sba->...s", self.slip_rows(angle, torque), self.slip)
        return np.maximum(forces, 0.0)

    def slip_forces(self, angle: Array, torque: Array) -> dict[str, float]:
        """The slips' forces by name, N, at angles (n,) and torques (n,)."""
        return dict(zip(SLIPS, map(float, self.slips(angle, torque)), strict=True))

    def slip_rows(self, angle: Array, torque: Array) -> Array:
        """The terms (..., B, 1 + n) of which the slips' forces are sums."""
        b = monomials(self.slip_powers, self.scaled_angle(angle)).value
        one = np.ones((*torque.shape[:-1], 1))
        return b[..., None] * np.concatenate([one, torque], axis=-1)[..., None, :]

    def scaled_angle(self, angle: Array) -> Array:
        """The angles (..., n) scaled to -1 to 1 in the box."""
        return (angle - (self.low + self.high) / 2) / self.half

    def torques(self, angle: Array, tension: Array) -> Array:
        """The joint torques (..., n) N m, as of `derivatives`, without the rest."""
        shape = np.broadcast_shapes(angle.shape[:-1], tension.shape[:-1])
        states = [
            np.broadcast_to(x, (*shape, x.shape[-1])).reshape(-1, x.shape[-1])
            for x in (angle, tension)
        ]
        some = (slice(k, k + AT_ONCE) for k in range(0, max(len(states[0]), 1), AT_ONCE))
        torque: Array = np.concatenate([self._torques(*(x[part] for x in states)) for part in some])
        return torque.reshape(*shape, len(self.joints))

    def _torques(self, angle: Array, tension: Array) -> Array:
        """Joint torques at states (s, n) and (s, m)."""
        b = monomials(self.angle_powers, self.scaled_angle(angle), curved=False)
        g = loadings(self.tension_terms, tension / self.most, self.toe, curved=False)
        at_force = (g.value @ self.energy.T)[..., None, :]
        torque: Array = (at_force @ (b.slope / self.half))[..., 0, :]
        return torque

    def outside(self, angle: Array, tension: Array) -> str:
        """In words where a state (n,), (m,) lies outside of the box; empty where it does not."""
        lot = MARGIN * (self.high - self.low)
        places = [
            f"{joint} at {np.degrees(value):.4g} deg ({np.degrees(a):.4g} to "
            f"{np.degrees(b):.4g} deg)"
            for joint, value, a, b, extra in zip(
                self.joints, angle, self.low, self.high, lot, strict=True
            )
            if not a - extra <= value <= b + extra
        ]
        places += [
            f"{muscle} at {value:.4g} N (0 to {most:.4g} N)"
            for muscle, value, most in zip(self.muscles, tension, self.most, strict=True)
            if not value <= (1 + MARGIN) * most
        ]
        return ", ".join(places)


class ReducedHood(JointHood):
    """A potential on the bones, see `JointHood`: excursions are counted from where those of the
    hood that was reduced are, and outside of the box there is no answer."""

    sources, name = ("network",), "reduced hood"

    def __init__(
        self,
        potential: ReducedPotential,
        hinges: Sequence[Joint],
        bodies: tuple[str, ...],
        direction: Vector = PROXIMAL,
    ) -> None:
        super().__init__(potential.joints, potential.muscles, hinges, bodies, direction)
        self.potential = potential

    def derived(self, angle: Array, tension: Array) -> Derived:
        """The potential's derivatives at one state."""
        return self.potential.derivatives_at(angle, tension)

    def advance(self, state: JointState, motion: Motion, tension: Array, dt: float) -> Response:
        """As of `JointHood`.  Raises ConvergenceError outside of the box."""
        response = super().advance(state, motion, tension, dt)
        reached: JointState = response.state
        if where := self.potential.outside(reached.angles.value, reached.tension):
            raise ConvergenceError(
                f"reduced hood: {where} lies outside of what it was fitted to; reduce the hood "
                "over a wider range, or take the hood that it was reduced from"
            )
        return response
