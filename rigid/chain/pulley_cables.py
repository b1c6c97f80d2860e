"""Cables over pulleys of constant radius on the joints of a planar chain, in closed form.

Between two joints a cable is the common tangent of their pulleys, fixed to the bone between; over a
pulley it winds up by the joint's turn.  So, with radii r (positive palmar of the axis, where the
cable flexes the joint; negative dorsal) and a tension T,

    torque_j = r_j T,      length = length at zero angles - sum_j r_j theta_j.

A pulley turns with the bone beyond its joint, or on the axis between the two: the joints' torques
are the same.  Metal of pulleys and drums is not modelled: a cable is wound on by enough turns to
stay on at any angle, and rubs nowhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Motion
from rigid.chain.kinematics import move_wrench

FREE_END = 0.03
"""m, of the cable on the first bone that pictures show."""
ARC_STEP = 0.2
"""rad, between two points of an arc that is drawn."""


@dataclass(frozen=True)
class PulleyCable:
    """A cable from the first bone to the bone beyond the last of its pulleys."""

    radii: Array
    """(k,) m, at the first k joints: positive palmar, negative dorsal, zero through the axis."""
    lengths: Array
    """(nj,) m, of the bones beyond the joints."""

    @staticmethod
    def over(
        name: str, radius: Mapping[str, float], joints: Sequence[str], lengths: Array
    ) -> PulleyCable:
        """The cable `name` over pulleys of a signed `radius` (m) by joint; it crosses a joint that
        is not named through its axis.  Raises InputError for an unknown joint and where two
        neighbours' pulleys are further apart in radius than their joints are."""
        unknown = [joint for joint in radius if joint not in joints]
        if unknown or not radius:
            raise InputError(
                f"pulleys of {name}: expected a radius for some of the joints {', '.join(joints)}, "
                f"got {', '.join(unknown) or 'none'}"
            )
        last = max(joints.index(joint) for joint in radius)
        radii = np.array([radius.get(joint, 0.0) for joint in joints[: last + 1]])
        for j, step in enumerate(np.diff(radii)):
            if abs(step) >= lengths[j]:
                raise InputError(
                    f"pulleys of {name}: from {joints[j]} to {joints[j + 1]} the cable's distance "
                    f"from the axis changes by {1e3 * abs(step):.4g} mm over a bone of "
                    f"{1e3 * lengths[j]:.4g} mm: no straight line touches both pulleys. Choose "
                    "smaller radii"
                )
        return PulleyCable(radii, lengths)

    @property
    def slopes(self) -> Array:
        """(k,) rad, by how much the cable on each bone before a pulley dips palmar of the bone."""
        dips = np.arcsin(np.diff(self.radii) / self.lengths[: len(self.radii) - 1])
        return np.concatenate([[0.0], dips])

    def length(self, angles: Array) -> float:
        """The cable's length, m, less a constant: what of it is straight beyond the first bone at
        zero angles, less what the joints' turns took up."""
        spans = self.lengths[: len(self.radii) - 1]
        straight = np.sqrt(spans**2 - np.diff(self.radii) ** 2).sum()
        return float(straight - self.radii @ angles[: len(self.radii)])

    def wrenches(self, motion: Motion) -> Array:
        """What a tension of 1 N does to each body: (nb, 6) N and N m about its origin, world
        frame.  A pulley belongs to the bone that its joint moves."""
        out = np.zeros((len(motion.bodies), 6))
        for j, (radius, dip) in enumerate(zip(self.radii, self.slopes, strict=True)):
            turn = motion.rotation[j]
            along = turn @ [np.cos(dip), 0.0, -np.sin(dip)]
            arm = turn @ (radius * np.array([-np.sin(dip), 0.0, -np.cos(dip)]))
            pull = np.concatenate([-along, np.cross(arm, -along)])  # on the bone beyond
            out[j + 1] += pull
            out[j] -= move_wrench(pull, motion.position[j + 1] - motion.position[j])
        return out

    def path(self, motion: Motion) -> Array:
        """The world points (n, 3) m, from the first bone to where the cable leaves its last
        pulley; over a palmar pulley it is drawn with the turn that keeps it wound on."""
        points, slopes = [], np.append(self.slopes, 0.0)
        for j, radius in enumerate(self.radii):
            turn, centre = motion.rotation[j], motion.position[j + 1]
            bend = turn.T @ motion.rotation[j + 1]
            sweep = slopes[j] - slopes[j + 1] - np.arctan2(bend[0, 2], bend[0, 0])
            sweep += 2 * np.pi if radius > 0 else 0.0
            at = -slopes[j] + np.linspace(0.0, sweep, 2 + int(abs(sweep) / ARC_STEP))
            spokes = np.stack([np.sin(at), np.zeros(len(at)), -np.cos(at)], axis=1) @ turn.T
            if j == 0:
                points.append(centre + radius * spokes[0] - FREE_END * turn[:, 0])
            points += list(centre + radius * spokes)
        return np.array(points)
