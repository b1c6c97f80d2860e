"""OpenSim's Millard2012EquilibriumMuscle at the parameters of `index_muscles`, as reference.

It makes the committed table; from the repository's root, with a Python that has `opensim`:

    python -m tests.proofs.fingers.opensim_reference tests/data/opensim/millard_opensim.npz
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from cosim.port import Array
from rigid.muscle.parameters import Muscles
from tests.proofs.fingers.index_muscles import index_muscles

ACTIVATIONS = np.linspace(0.0, 1.0, 11)
FIBRES = np.linspace(0.3, 1.6, 41)
"""Path length less the tendon's slack length, in optimal fibre lengths: from a slack muscle to one
that its passive fibres stretch."""
STATES = 100
"""Random states of motion, a muscle."""


def path_lengths(muscles: Muscles) -> Array:
    """The path lengths (41, n) m of the tables."""
    return muscles.tendon_slack_length + FIBRES[:, None] * muscles.optimal_fibre_length


def motion_states(muscles: Muscles) -> tuple[Array, Array, Array]:
    """Activations, fibre lengths and path lengths, (100, n) each; normalised fibres of 0.5 to 1.6,
    and tendons strained by -0.01 to 0.05."""
    rng = np.random.default_rng(2012)
    size = (STATES, len(muscles.names))
    activation, length = rng.uniform(0.01, 1.0, size), rng.uniform(0.5, 1.6, size)
    length = length * muscles.optimal_fibre_length
    tendon = muscles.tendon_slack_length * (1.0 + rng.uniform(-0.01, 0.05, size))
    return activation, length, np.sqrt(length**2 - muscles.width**2) + tendon


class Rig:
    """One OpenSim muscle between the ground and a slider, whose coordinate is the path length."""

    def __init__(self, muscles: Muscles, i: int) -> None:
        import opensim

        opensim.Logger.setLevelString("Off")
        self.model = opensim.Model()
        self.model.setGravity(opensim.Vec3(0))
        body = opensim.Body("end", 1.0, opensim.Vec3(0), opensim.Inertia(1.0))
        self.slider = opensim.SliderJoint("slider", self.model.getGround(), body)
        self.model.addBody(body)
        self.model.addJoint(self.slider)
        self.muscle = make(muscles, i)
        self.muscle.addNewPathPoint("origin", self.model.getGround(), opensim.Vec3(0))
        self.muscle.addNewPathPoint("insertion", body, opensim.Vec3(0))
        self.model.addForce(self.muscle)
        self.state = self.model.initSystem()

    def pose(self, path: float, rate: float, activation: float) -> Any:
        """The state at a path length (m), its rate (m/s) and an activation."""
        coordinate = self.slider.getCoordinate()
        coordinate.setValue(self.state, path)
        coordinate.setSpeedValue(self.state, rate)
        self.muscle.setActivation(self.state, activation)
        return self.state

    def resting(self, path: float, activation: float) -> tuple[float, float]:
        """Tendon force (N) and fibre length (m) in isometric equilibrium."""
        state = self.pose(path, 0.0, activation)
        self.muscle.computeFiberEquilibrium(state, False)
        self.model.realizeDynamics(state)
        return self.muscle.getTendonForce(state), self.muscle.getFiberLength(state)

    def velocity(self, path: float, activation: float, fibre: float) -> float:
        """The fibre's velocity (m/s) at a fibre length (m)."""
        state = self.pose(path, 0.0, activation)
        self.muscle.setFiberLength(state, fibre)
        self.model.realizeDynamics(state)
        return float(self.muscle.getFiberVelocity(state))

    def rigid_force(self, path: float, rate: float, activation: float) -> float:
        """Tendon force (N) of a muscle with a rigid tendon."""
        state = self.pose(path, rate, activation)
        self.model.realizeDynamics(state)
        return float(self.muscle.getTendonForce(state))


def make(muscles: Muscles, i: int) -> Any:
    """OpenSim's muscle with the parameters of muscle `i`."""
    import opensim

    muscle = opensim.Millard2012EquilibriumMuscle(
        muscles.names[i],
        float(muscles.max_force[i]),
        float(muscles.optimal_fibre_length[i]),
        float(muscles.tendon_slack_length[i]),
        float(muscles.pennation[i]),
    )
    muscle.setMaxContractionVelocity(float(np.asarray(muscles.max_velocity)[i]))
    muscle.setFiberDamping(float(np.asarray(muscles.damping)[i]))
    muscle.setMinimumActivation(float(np.asarray(muscles.min_activation)[i]))
    muscle.set_ignore_tendon_compliance(muscles.rigid_tendon)
    return muscle


def resting_table(muscles: Muscles) -> tuple[Array, Array]:
    """Tendon forces (N) and fibre lengths (m) at rest, (11, 41, n)."""
    out = np.empty((2, len(ACTIVATIONS), len(FIBRES), len(muscles.names)))
    paths = path_lengths(muscles)
    for i in range(len(muscles.names)):
        rig = Rig(muscles, i)
        for j, activation in enumerate(ACTIVATIONS):
            for k, path in enumerate(paths[:, i]):
                out[:, j, k, i] = rig.resting(float(path), float(activation))
    return out[0], out[1]


def velocity_table(muscles: Muscles) -> Array:
    """Fibre velocities (100, n) m/s at `motion_states`."""
    activation, fibre, path = motion_states(muscles)
    out = np.empty(path.shape)
    for i in range(len(muscles.names)):
        rig = Rig(muscles, i)
        for j, (a, length, total) in enumerate(
            zip(activation[:, i], fibre[:, i], path[:, i], strict=True)
        ):
            out[j, i] = rig.velocity(float(total), float(a), float(length))
    return out


def main(target: Path) -> None:
    """Writes the table."""
    import opensim

    muscles = index_muscles()
    force, fibre = resting_table(muscles)
    np.savez_compressed(
        target,
        provenance=np.array(
            f"OpenSim {opensim.GetVersion()}, Millard2012EquilibriumMuscle, its default curves, "
            "fiber_damping 0.1, minimum_activation 0.01, elastic tendon; the parameters of "
            "rigid/muscle/index_muscles.py. force (N), fibre (m): computeFiberEquilibrium at no "
            "velocity, (activation, path, muscle). velocity (m/s): getFiberVelocity at "
            "motion_states, (state, muscle). Made by: python -m "
            "tests.proofs.fingers.opensim_reference"
        ),
        muscles=np.array(muscles.names),
        activation=ACTIVATIONS,
        path=path_lengths(muscles),
        force=force,
        fibre=fibre,
        velocity=velocity_table(muscles),
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
