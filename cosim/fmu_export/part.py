"""What the parts of an exported unit share."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from cosim.coupling.state_arrays import Special
from cosim.errors import InputError
from cosim.fmu.quantity import Quantity, Values
from cosim.port import Array, Motion, Response, State

ORTHONORMAL = 1e-6
"""How far from a rotation the matrix of a pose may be."""


class UnitPart(ABC):
    """What an FMU holds."""

    quantities: tuple[Quantity, ...]
    """The inputs, parameters and outputs."""
    begin: Values
    """What they are at the start."""

    def begin_at(self, values: Values) -> None:
        """Let the quantities begin with these values, those that are left out at zero."""
        self.begin = {q.name: values.get(q.name, q.zero()) for q in self.quantities}

    @abstractmethod
    def start(self) -> State:
        """The state to begin from."""

    @abstractmethod
    def step(self, state: State, given: Values, dt: float) -> tuple[State, Values]:
        """The state and the outputs after `dt` s of constant inputs.

        Raises InputError and ConvergenceError; `state` stays valid."""

    def initial(self, given: Values) -> tuple[State, Values]:
        """The state to begin from and the outputs at the start under the inputs `given`: the end of
        a step, where nothing moves in time.

        Raises InputError and ConvergenceError."""
        return self.step(self.start(), given, 0.0)

    def template(self) -> State:
        """A state after a step, by which written ones are read."""
        return self.start()

    def special(self) -> Special:
        """How states are written that hold more than arrays.  Raises InputError where they cannot
        be."""
        return {}


def excursions(tendons: tuple[str, ...]) -> Quantity:
    """The output of a coupled finger by which its tendons have moved."""
    moved = "How far the tendon's end has moved along its pull since rest."
    return Quantity("excursion", "output", "m", moved, (("tendon", tendons),))


def finger_places(motion: Motion, tip: Array | None, path: Array) -> dict[str, Array]:
    """Where a finger's parts are as an FMU's values, of what it has."""
    values = {"path": path, **poses(motion)} | ({} if tip is None else {"tip": tip})
    return {name: value for name, value in values.items() if value.size}


def loads(response: Response) -> Values:
    """A hood's answer as an FMU's outputs."""
    load = response.load
    return {
        "force": load.wrench[..., :3],
        "moment": load.wrench[..., 3:],
        "pull_force": load.pull[:, :3],
        "pull_moment": load.pull[:, 3:],
        "excursion": response.excursion,
    }


def poses(motion: Motion) -> dict[str, Array]:
    """Poses as an FMU's values: origins (nb, 3) m and rotations (nb, 3, 3), world frame."""
    return {"position": motion.position, "rotation": motion.rotation}


def motion_of_input(bodies: tuple[str, ...], given: Values) -> Motion:
    """The poses that an input states.  Raises InputError for a matrix that is no rotation."""
    turn = given["rotation"]
    off = np.abs(turn @ np.swapaxes(turn, 1, 2) - np.eye(3)).max(axis=(1, 2))
    off = np.maximum(off, np.abs(np.linalg.det(turn) - 1))
    if not (off <= ORTHONORMAL).all():
        worst = int(np.argmax(off))
        raise InputError(
            f"rotation of {bodies[worst]}: is no rotation matrix, off by {off[worst]:.1e}; set all "
            "nine entries before a step"
        )
    return Motion(bodies, given["position"], turn)
