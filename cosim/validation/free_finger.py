"""The free finger of Nimbarte et al. 2008: how far it turns, and the stiffness that its joints need
to turn as far as was measured.

The twelve angles are a test: nothing is fitted to them.  With the finger held where it stood in the
experiment, `holder` and passive joint together bear what the tendons do there, tau; about a rest
from which the joint turned by phi the secant stiffness that holds it without a holder is tau / phi.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from cosim.case.file import load_case
from cosim.results.compare import Comparison, Target
from cosim.validation.trial import Summaries, Trial

TURNS = "difference.posture_deg."
"""Before the joint in the measured quantity."""
SOURCE = "Nimbarte et al. 2008, abstract: the angle; ours: tension and arms in that posture"


def held_trial(free: Trial, targets: Sequence[Target]) -> Trial:
    """The trial of a free finger held at the measured angles.  Raises InputError."""
    posture = load_case(free.case).native_finger().posture.angles()
    angles = {j: np.degrees(posture[j]) + turn for j, turn in _turns(free.case, targets).items()}
    held = (f'finger.posture.{j}="{angle:.6g} deg"' for j, angle in angles.items())
    settings = ('finger.tip={kind="posture"}', *held)
    return replace(free, name=f"{free.case} held at the measured angles", settings=settings)


def _turns(case: str, targets: Sequence[Target]) -> dict[str, float]:
    """Turns (deg) by joint."""
    return {
        t.quantity.removeprefix(TURNS): t.reference
        for t in targets
        if t.case == case and t.reference is not None
    }


def needed_stiffness(
    held: Sequence[Trial], targets: Sequence[Target], summaries: Summaries
) -> Iterator[Comparison]:
    """The stiffness of ours beside the one that is needed, for each joint that turned; they judge
    nothing, and are left out where the held finger found no equilibrium."""
    for trial in held:
        if (summary := summaries.get(trial.name)) is None:
            continue
        torque = summary["joint_torque_Nmm"]
        for joint, turn in _turns(trial.case, targets).items():
            if turn:
                ours = torque["passive"][joint]
                needed = ours + torque["holder"][joint]
                yield _row(trial, joint, turn, ours, needed)


def _row(trial: Trial, joint: str, turn: float, ours: float, needed: float) -> Comparison:
    """turn: deg; ours, needed: N mm that the joint bears there, against the turn."""
    modelled, wanted = (-1e-3 * torque / np.radians(turn) for torque in (ours, needed))
    target = Target(
        f"{trial.muscle}: stiffness that the {joint} would need",
        f"needed_stiffness.{joint}",
        "N m/rad",
        float(wanted),
        None,
        None,
        None,
        SOURCE,
        "requirement",
        trial.name,
        note=f"{wanted / modelled:.1f} times ours: {abs(needed):.1f} N mm at {abs(turn):g} deg",
    )
    return Comparison(target, float(modelled))
