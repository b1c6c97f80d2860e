"""A coupled equilibrium without a case file, with the names of a result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cosim.coupling.equilibrium import Equilibrium
from cosim.port import Pair
from cosim.results.audit import HOOD_BALANCES, Audit, missed_bounds
from cosim.results.conventions import by_axis, by_name
from cosim.results.parts import joint_forces

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class CoupledResult(Equilibrium):
    """What `cosim.couple` found: what a `Result` has, as far as finger and hood tell it, by the
    same names and in the same units."""

    pair: Pair
    slips: Mapping[str, float]
    """N, in the central and the terminal slip; empty of a hood that does not tell them."""

    @property
    def tip_force(self) -> dict[str, float]:
        """The force of the fingertip on the world (N), along the world's axes."""
        return by_axis(self.pair.finger.tip_force(self.finger_state))

    @property
    def posture(self) -> dict[str, float]:
        """Joint angles (deg) by joint."""
        finger = self.pair.finger
        return by_name(finger.joints, np.rad2deg(finger.angles(self.finger_state)))

    @property
    def excursions(self) -> dict[str, float]:
        """Excursions (mm) by tendon of the hood, positive proximally."""
        return by_name(self.pair.hood.tendons, 1e3 * self.excursion)

    @property
    def moment_arms(self) -> pandas.DataFrame:
        """Moment arms (mm), a row for each tendon of the hood and a column for each joint; flexion
        and radial abduction are positive.  Empty of a finger that does not say how its bodies
        turn."""
        import pandas

        turns = self.pair.finger.jacobian(self.finger_state)
        if turns is None:
            return pandas.DataFrame()
        arms = 1e3 * self.jacobian.load_tension.T @ turns
        return pandas.DataFrame(arms, self.pair.hood.tendons, self.pair.finger.joints)

    @property
    def joint_torques(self) -> pandas.DataFrame:
        """Torques about each joint (N mm), a row for each source; those of one joint add up to
        zero.  Empty of a finger that reports no forces."""
        import pandas

        torques = {} if self.balance is None else self.balance.torque
        rows = {source: 1e3 * torque for source, torque in torques.items()}
        return pandas.DataFrame.from_dict(
            rows, orient="index", columns=list(self.pair.finger.joints)
        )

    @property
    def joint_forces(self) -> pandas.DataFrame:
        """Bone-to-bone forces (N), a row for each joint: on the bone distal of it, along the
        world's axes.  Empty of a finger that reports no forces."""
        import pandas

        books = self.pair.finger.ledger(self.finger_state, self.load, self.finger_tension)
        joint = books.get("joint")
        bodies, joints = self.load.bodies, self.pair.finger.joints
        forces = {} if joint is None else joint_forces(joint, bodies, joints)
        return pandas.DataFrame(forces).T

    @cached_property
    def audit(self) -> Audit:
        """The residuals with their bounds."""
        figures = by_name(HOOD_BALANCES, self.load.imbalance(self.motion))
        if self.balance is not None:
            figures["finger_residual"] = self.finger_residual
            figures["interface_residual"] = self.interface_residual
        return Audit(figures, tuple(missed_bounds(figures)))

    def __repr__(self) -> str:
        force = ", ".join(f"{axis} {value:.3g}" for axis, value in self.tip_force.items())
        return f"<CoupledResult: fingertip force {force} N; {self.audit}>"
