"""Live against OpenSim: the curves, and the muscle in the variants that the table leaves out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigid.muscle import curves
from rigid.muscle.curves import Curve
from rigid.muscle.dynamics import fibre_velocity
from rigid.muscle.millard import equilibrium
from rigid.muscle.parameters import DAMPED, Muscles
from tests.proofs.fingers import opensim_reference as reference
from tests.proofs.fingers.index_muscles import (
    WITHOUT_DAMPING,
    activation_rate,
    index_muscles,
    rigid_force,
)

opensim = pytest.importorskip("opensim")
pytestmark = pytest.mark.opensim

INDEX = index_muscles()
UNDAMPED = replace(INDEX, damping=0.0, curves=WITHOUT_DAMPING)
PAIRS = {
    "ActiveForceLengthCurve": (curves.active_force_length(minimum=0.1), (0.2, 2.1)),
    "FiberForceLengthCurve": (DAMPED.passive, (0.5, 2.5)),
    "ForceVelocityCurve": (DAMPED.velocity, (-1.5, 1.5)),
    "TendonForceLengthCurve": (DAMPED.tendon, (0.9, 1.2)),
}


@pytest.mark.parametrize("name", PAIRS)
def test_curves_are_opensims(name: str) -> None:
    curve, span = PAIRS[name]
    theirs = getattr(opensim, name)()
    x = np.linspace(*span, 1501)
    value, slope, _ = curve.evaluate(x)
    assert value == pytest.approx([theirs.calcValue(float(v)) for v in x], abs=1e-10)
    assert slope == pytest.approx([theirs.calcDerivative(float(v), 1) for v in x], abs=1e-9)


def test_inverse_force_velocity_is_opensims() -> None:
    ours: Curve = curves.force_velocity((0.1, 0.25), 5.0, (0.1, 0.15))
    theirs = opensim.ForceVelocityInverseCurve()
    y = np.linspace(-0.5, 2.0, 501)
    assert ours.inverse(y) == pytest.approx([theirs.calcValue(float(v)) for v in y], abs=1e-10)


def test_activation_dynamics_are_opensims() -> None:
    model = opensim.MuscleFirstOrderActivationDynamicModel(0.010, 0.040, 0.01, "muscle")
    for a in (0.01, 0.2, 0.6, 1.0):
        for u in (0.01, 0.2, 0.5, 1.0):
            ours = float(np.broadcast_to(activation_rate(INDEX, a, u), 8)[0])
            assert ours == pytest.approx(model.calcDerivative(a, u), abs=1e-10)


def test_undamped_muscle_is_opensims() -> None:
    activation, fibre, path = reference.motion_states(UNDAMPED)
    ours = fibre_velocity(UNDAMPED, activation, fibre, path)
    theirs = reference.velocity_table(UNDAMPED)
    scale = 10.0 * UNDAMPED.optimal_fibre_length
    assert ours / scale == pytest.approx(theirs / scale, abs=1e-7)
    force, _ = reference.resting_table(UNDAMPED)
    at = equilibrium(
        UNDAMPED, reference.ACTIVATIONS[:, None, None], reference.path_lengths(UNDAMPED)
    )
    assert at.force / UNDAMPED.max_force == pytest.approx(force / UNDAMPED.max_force, abs=1e-6)


@pytest.mark.parametrize("damping", [0.0, 0.1])
def test_rigid_tendon_is_opensims(damping: float) -> None:
    muscles: Muscles = replace(index_muscles(rigid_tendon=True), damping=damping)
    rng = np.random.default_rng(7)
    activation, x = rng.uniform(0.01, 1.0, (60, 8)), rng.uniform(0.3, 1.6, (60, 8))
    path = muscles.tendon_slack_length + x * muscles.optimal_fibre_length
    rate = rng.uniform(-1.5, 1.5, (60, 8)) * 10.0 * muscles.optimal_fibre_length
    ours = rigid_force(muscles, activation, path, rate)
    for i in range(8):
        rig = reference.Rig(muscles, i)
        theirs = [
            rig.rigid_force(float(p), float(v), float(a))
            for p, v, a in zip(path[:, i], rate[:, i], activation[:, i], strict=True)
        ]
        assert ours[:, i] == pytest.approx(theirs, abs=1e-7 * muscles.max_force[i])
