"""A case whose finger is an FMU, at rest: its two equilibria, and what is known of them.

A unit tells where its bodies are and what its fingertip does, not what it is made of: neither
torques by source nor the forces in its joints are in the result, and its ledger stays open.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cosim.build.fit import check_tendons
from cosim.build.models import built_on, site_of
from cosim.build.scheme import accelerator_of
from cosim.case.schema import Case
from cosim.fingers.kinds import unit
from cosim.fmu.finger import FingerAt, FmuFinger, Met, met, met_held
from cosim.port import Array, Hood, Progress, quiet


@dataclass(frozen=True)
class Settled:
    """The unloaded and the loaded equilibrium."""

    finger: FmuFinger
    hood: Hood
    states: Mapping[str, Met]


def finger_of(case: Case) -> FmuFinger:
    """The live finger of a case.  Raises InputError."""
    return unit(case.finger).at_rest()


def settled(case: Case, progress: Progress = quiet) -> Settled:
    """The equilibrium with every tendon at its resting tension, then the loaded one from there, by
    the case's scheme.  Raises InputError and ConvergenceError."""
    finger = finger_of(case)
    rest = finger.start().motion
    if finger.kinematics.tells_any:
        rest = finger.kinematics.at(np.zeros(len(finger.joints))).motion
    hood, resting = built_on(case, site_of(case, rest)).hood, case.solve.resting_tension
    check_tendons(case, (*hood.tendons, *finger.tendons))
    names, both = (hood.tendons, finger.tendons), (finger, hood)
    idle = [np.full(len(tendons), resting) for tendons in names]
    pulls = [np.array([case.tension(t) for t in tendons]) for tendons in names]
    unloaded = _solved(case, *both, idle, None, lambda text: progress(f"unloaded: {text}"))
    at = unloaded.finger
    loaded = _solved(case, *both, pulls, at, lambda text: progress(f"loaded: {text}"))
    return Settled(finger, hood, {"unloaded": unloaded, "loaded": loaded})


def _solved(
    case: Case,
    finger: FmuFinger,
    hood: Hood,
    pulls: list[Array],
    at: FingerAt | None,
    progress: Progress,
) -> Met:
    """By the case's scheme, under the hood's and the finger's own tensions."""
    tensions, coupling = (pulls[0], pulls[1]), case.coupling
    if coupling.scheme != "implicit":
        return met(finger, hood, *tensions, at, progress)
    return met_held(
        finger,
        hood,
        *tensions,
        accelerator_of(coupling),
        coupling.tolerance,
        case.solve.max_iterations,
        at,
        progress,
    )
