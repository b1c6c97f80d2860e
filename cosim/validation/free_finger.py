"""The free finger of Nimbarte et al. 2008: how far it turns, and the stiffness that its joints need
to turn as far as was measured.

The twelve angles are a test: nothing is fitted to them.  With the finger held where it stood in the
experiment, `holder` and passive joint together bear what the tendons do there, tau; about a rest
from which the joint turned by phi the secant stiffness that holds it without a holder is tau / phi.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from cosim.case.file import load_case
from cosim.results.compare import Comparison, Target
from cosim.validation.trial import Summaries, Trial

TURNS = "difference.posture_deg."
"""Before the joint in the measured quantity."""
SOURCE = "Nimbarte et al. 2008, abstract: the angle; ours: tension and arms in that posture"


def held_name(case: str) -> str:
    """The name of the trial in which the finger of a free case is held."""
    return f"{case} held at the measured angles"


def held_trials(targets: Sequence[Target]) -> tuple[Trial, ...]:
    """A trial for each case of the measured angles, held at them.  Raises InputError."""
    return tuple(_held(case, targets) for case in dict.fromkeys(t.case for t in targets))


def _held(case: str, targets: Sequence[Target]) -> Trial:
    posture = load_case(case).native_finger().posture.angles()
    angles = {j: np.degrees(posture[j]) + turn for j, turn in _turns(case, targets).items()}
    settings = [f'finger.posture.{j}="{angle:.6g} deg"' for j, angle in angles.items()]
    return Trial(held_name(case), case, ('finger.tip={kind="posture"}', *settings))


def _turns(case: str, targets: Sequence[Target]) -> dict[str, float]:
    """Turns (deg) by joint."""
    return {
        t.quantity.removeprefix(TURNS): t.reference
        for t in targets
        if t.case == case and t.reference is not None
    }


def needed_stiffness(targets: Sequence[Target], summaries: Summaries) -> Iterator[Comparison]:
    """The stiffness of ours beside the one that is needed, for each joint that turned; they judge
    nothing, and are left out where the held finger found no equilibrium."""
    for case in dict.fromkeys(t.case for t in targets):
        if (said := summaries.get(held_name(case))) is None:
            continue
        torque = said["joint_torque_Nmm"]
        for joint, turn in _turns(case, targets).items():
            if turn:
                ours = torque["passive"][joint]
                needed = ours + torque["holder"][joint]
                yield _row(case, joint, turn, ours, needed)


def _row(case: str, joint: str, turn: float, ours: float, needed: float) -> Comparison:
    """turn: deg; ours, needed: N mm that the joint bears there, against the turn."""
    own, wanted = (-1e-3 * torque / np.radians(turn) for torque in (ours, needed))
    muscle = case.rpartition("_")[2].upper()
    target = Target(
        f"{muscle}: stiffness that the {joint} would need",
        f"needed_stiffness.{joint}",
        "N m/rad",
        float(wanted),
        None,
        None,
        None,
        SOURCE,
        "requirement",
        held_name(case),
        note=f"{wanted / own:.1f} times ours: {abs(needed):.1f} N mm at {abs(turn):g} deg",
    )
    return Comparison(target, float(own))
