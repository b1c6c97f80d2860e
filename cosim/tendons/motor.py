"""Motors that wind elastic tendons on spools, in a motion.

With x how far a motor has drawn its tendon's end and v its speed there, m = J n^2 the inertia of
motor and gear seen from the tendon, n = gear / spool the motor's turn per length, d how far the
path has shortened, k and b the tendon's stiffness, slack and backlash,

    m dv/dt = F(x, v) - T,    T = max(k (x - b - d), 0),

    F = e n tau where the motor drives, n tau / e where it is turned back,    e: efficiency

and tau the commanded torque, or that which turns a motor of this inertia to the commanded position
with critical damping, held within the motor's straight line from its greatest torque at rest
to none at its greatest speed.  A step is implicit Euler's for the motor; the path is as long as it
was at the step's start.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cosim.errors import InputError
from cosim.port import Array
from cosim.tendons.drive_tables import MotorConfig
from cosim.tendons.signals import factor_of
from cosim.tendons.table import TendonConfig

FASTEST = 20.0
"""m/s, that no tendon is drawn faster than."""
LAST = 1e-3
"""s, over which the speed of a commanded position is taken."""
HALVINGS = 80
"""How often the range of speeds in which a step's is sought is halved: below rounding."""


class MotorState(NamedTuple):
    """Motors at one time, (n,) each."""

    position: Array
    """m, how far each has drawn its tendon's end."""
    speed: Array
    """m/s."""
    home: Array
    """m, the lengths of the paths from which their shortening counts."""


class MotorStep(NamedTuple):
    """What motors make of a step, (n,) each."""

    tension: Array
    """N."""
    stiffness: Array
    """N/m, of the tendons that are taut."""
    state: MotorState


@dataclass(frozen=True)
class _Motor:
    """One motor, seen from its tendon."""

    table: MotorConfig
    stiffness: float
    """N/m, of the tendon."""
    lost: float
    """m, slack and backlash."""
    factor: Callable[[float], float]

    @property
    def turns(self) -> float:
        """The motor's turn per length that the tendon is drawn, rad/m."""
        return self.table.gear / self.table.spool

    @property
    def mass(self) -> float:
        """Inertia at the tendon, kg."""
        return self.table.inertia * self.turns**2

    def torque(self, time: float, position: float, speed: float) -> float:
        """The motor's torque, N m."""
        t = self.table
        greatest = t.greatest_torque
        if t.torque is not None:
            wanted = t.torque * self.factor(time)
        else:
            aim = self._aim(time)
            late = speed - (aim - self._aim(max(time - LAST, 0.0))) / LAST
            damping = 2.0 * np.sqrt(greatest / t.band * t.inertia * self.turns)
            wanted = greatest * (aim - position) / t.band - damping * late
        line = np.inf if t.greatest_speed is None else t.greatest_speed
        rate = self.turns * speed / line
        return float(np.clip(wanted, -greatest * min(1 + rate, 1.0), greatest * min(1 - rate, 1.0)))

    def _aim(self, time: float) -> float:
        """How far (m) the tendon's end is to be drawn."""
        return (self.table.position or 0.0) * self.factor(time)

    def force(self, time: float, position: float, speed: float) -> float:
        """The force on the tendon's end, N."""
        force = self.turns * self.torque(time, position, speed)
        drives = force * speed > 0
        return force * self.table.efficiency if drives else force / self.table.efficiency

    def tension(self, position: float, shortening: float) -> float:
        """The tendon's tension, N."""
        return max(self.stiffness * (position - self.lost - shortening), 0.0)

    def start(self) -> float:
        """How far (m) the end is drawn at rest under the first command, the path as it is."""
        t = self.table
        if t.torque is None:
            return self._aim(0.0)
        held = min(t.torque * self.factor(0.0), t.greatest_torque) * self.turns
        return self.lost + held / self.stiffness if held > 0 else 0.0

    def step(
        self, time: float, position: float, speed: float, shortening: float, dt: float
    ) -> tuple[float, float]:
        """Position and speed at `time` s, `dt` s later: what is left over rises with the speed, so
        that one speed balances it."""

        def left(v: float) -> float:
            x = position + dt * v
            pull = self.force(time, x, v) - self.tension(x, shortening)
            return self.mass * (v - speed) / dt - pull

        low, high = -FASTEST, FASTEST
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if left(middle) > 0 else (middle, high)
        v = 0.5 * (low + high)
        return position + dt * v, v


@dataclass(frozen=True)
class Motors:
    """The motors of a case, (n,), and where they stand among its tendons."""

    names: tuple[str, ...]
    where: Array
    each: tuple[_Motor, ...]

    @property
    def stiffness(self) -> Array:
        """The stiffnesses (n,) N/m of their tendons."""
        return np.array([motor.stiffness for motor in self.each])

    def initial(self, length: Array) -> MotorState:
        """Motors at rest under their first commands, with paths of `length` (n,) m."""
        position = np.array([motor.start() for motor in self.each])
        return MotorState(position, np.zeros(len(self.each)), length)

    def step(self, state: MotorState, time: float, length: Array, dt: float) -> MotorStep:
        """The motors at `time` s, `dt` s after `state` (0: at the start), with paths of `length`
        (n,) m."""
        shortening = state.home - length
        position, speed = state.position.copy(), state.speed.copy()
        tension, stiffness = np.zeros(len(self.each)), np.zeros(len(self.each))
        for i, motor in enumerate(self.each):
            short = float(shortening[i])
            if dt > 0.0:
                position[i], speed[i] = motor.step(time, position[i], speed[i], short, dt)
            tension[i] = motor.tension(position[i], short)
            stiffness[i] = motor.stiffness if tension[i] > 0 else 0.0
        return MotorStep(tension, stiffness, MotorState(position, speed, state.home))

    def signals(self, state: MotorState, time: float) -> Array:
        """How far each motor has drawn its tendon's end, m, and its torque, N m, (n, 2)."""
        torques = [
            motor.torque(time, float(x), float(v))
            for motor, x, v in zip(self.each, state.position, state.speed, strict=True)
        ]
        return np.stack([state.position, np.array(torques)], axis=1)


def motors(tables: Mapping[str, TendonConfig], tendons: tuple[str, ...]) -> Motors | None:
    """A case's motors among these tendons; None where none pulls."""
    names, each = [], []
    for name in tendons:
        tendon = tables.get(name, TendonConfig())
        table, elastic = tendon.actuation, tendon.elastic
        if isinstance(table, MotorConfig) and elastic is not None:
            lost = elastic.slack + table.backlash * table.spool
            names.append(name)
            each.append(_Motor(table, elastic.rate, lost, factor_of(tendon.signal)))
    where = np.array([tendons.index(name) for name in names], dtype=int)
    return Motors(tuple(names), where, tuple(each)) if names else None


def check_motors(tables: Mapping[str, TendonConfig], in_motion: bool) -> None:
    """Check that motors are used in a motion.  Raises InputError."""
    for name, tendon in tables.items():
        if isinstance(tendon.actuation, MotorConfig) and not in_motion:
            raise InputError(
                f"tendons.{name}.actuation: a motor takes time to act, an equilibrium has none; "
                "add a table [forward], or state the tension (motor's torque times gear times "
                'efficiency over the spool\'s radius, for example tension = "10 N")'
            )
