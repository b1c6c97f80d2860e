"""What a written FMU of a case in motion computes: the finger, or finger and hood together.

A step of the master is cut into equal ones that are no longer than the case's `forward.step`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil
from types import SimpleNamespace

import numpy as np

from cosim.case.schema import Case, ForwardConfig
from cosim.coupling.motion import MotionState, RecordedFinger
from cosim.coupling.state_arrays import Special
from cosim.errors import InputError
from cosim.fmu.quantity import (
    KINEMATICS,
    Quantity,
    Values,
    motion_of,
    moving_answers,
    moving_quantities,
    tensions_of,
)
from cosim.fmu_export.part import (
    UnitPart,
    excursions,
    finger_places,
    motion_of_input,
    poses,
)
from cosim.models.motion import MovingModels, moving_models, special_states
from cosim.port import AffineLoad, Array, State

LONGER_STEP = 1e-9
"""The part of a step by which a master's may be longer than the case's."""
MOMENT = 1e-3
"""The part of a case's step after which the reactions at the start are read: they do not depend on
it, but for what moves within it."""
REACTIONS = ("tip_force", "tip_moment")


def moving_part(case: Case, forward: ForwardConfig, part: str, tangent: bool) -> UnitPart:
    """The finger, or "coupled" the finger and the hood, of a case in motion.  Raises InputError."""
    if forward.adaptive is not None:
        raise InputError(
            f"{case.name}: forward.adaptive: the master sets the steps of an FMU; leave it out"
        )
    if case.gives_way is not None and part == "finger":
        raise InputError(
            f"{case.name}: gives_way: is of the hood, which is no part of an FMU of the finger; "
            'leave it out, or write the part "coupled"'
        )
    both = moving_models(case, forward)
    if both.moves.prescribed.names:
        raise InputError(
            f"tendons.{both.moves.prescribed.names[0]}.excursion: an FMU in motion takes tensions; "
            "state one"
        )
    if part == "finger":
        return MovingFingerPart(both, tangent)
    return MovingCoupledPart(both)


def _steps(dt: float, longest: float) -> list[float]:
    """Equal steps (s) that make `dt`."""
    count = max(1, ceil(dt / longest * (1 - LONGER_STEP)))
    return [dt / count] * count


def _answers(finger: RecordedFinger, state: State) -> dict[str, Array]:
    """`moving_answers` in a state."""
    tip = finger.tip_wrench(state)
    return {
        "angle": finger.angles(state),
        "rate": finger.rates(state),
        "tip_force": tip[:3],
        "tip_moment": tip[3:],
        "energy": np.array(finger.energy(state)),
        "dissipation": np.array(finger.dissipation(state)),
    }


class MovingFingerPart(UnitPart):
    """The finger alone, under a load that holds at the end of each of its steps."""

    def __init__(self, both: MovingModels, tangent: bool = True) -> None:
        self.finger, self._longest = both.finger, both.moves.dt
        self._splinted = both.moves.splinted
        self._posture, f = both.posture, both.finger
        self.quantities = moving_quantities(f.bodies, f.joints, f.tendons, tangent=tangent)
        start = self.start()
        motion = f.motion(f.angles(start))
        at_start = {
            **self._outputs(start),
            "load_position": motion.position,
            "load_rotation": motion.rotation,
            "tension": both.first_tensions()[len(both.hood.tendons) :],
        }
        self.begin_at(at_start)

    def start(self) -> State:
        return self.finger.begin(self._posture)

    def step(self, state: State, given: Values, dt: float) -> tuple[State, Values]:
        if given[KINEMATICS.name]:
            return state, self._places(given["asked_angle"])
        load, tension = self._load(state, given), given.get("tension", np.zeros(0))
        for h in _steps(dt, self._longest):
            if self._splinted is not None:
                state = self._splinted.splinted(state)
            state = self.finger.step(state, load, tension, h)
        return state, self._outputs(state)

    def initial(self, given: Values) -> tuple[State, Values]:
        """The finger at rest in its posture; the fingertip's force is the reaction there."""
        start = self.start()
        if given[KINEMATICS.name]:
            return self.step(start, given, 0.0)
        moved = self.step(start, given, MOMENT * self._longest)[1]
        return start, {**self._outputs(start), **{name: moved[name] for name in REACTIONS}}

    def _load(self, state: State, given: Values) -> AffineLoad:
        bodies, n = self.finger.bodies, 6 * len(self.finger.bodies)
        wrench = np.hstack([given["force"], given["moment"]])
        if "load_motion" not in given:
            at = self.finger.motion(self.finger.angles(state))
            return AffineLoad(at, wrench, np.zeros((n, n)))
        pose = {"position": given["load_position"], "rotation": given["load_rotation"]}
        slope = given["load_motion"].reshape(n, n)
        return AffineLoad(motion_of_input(bodies, pose), wrench, slope)

    def _outputs(self, state: State) -> Values:
        return {
            **_answers(self.finger, state),
            **self._places(self.finger.angles(state)),
        }

    def _places(self, angles: Array) -> dict[str, Array]:
        f = self.finger
        return finger_places(f.motion(angles), f.tip(angles), f.path_lengths(angles))


class MovingCoupledPart(UnitPart):
    """Finger and hood in motion by the case's scheme, from rest in the posture with the hood in
    equilibrium at the case's first tensions.

    A muscle's fibre is not part of it: tensions are inputs, constant over a master's step."""

    def __init__(self, both: MovingModels) -> None:
        self.both, finger, hood = both, both.finger, both.hood
        self.tendons = (*hood.tendons, *finger.tendons)
        residual = "Relative, of the loads at the interface, in the last step."
        whole = (
            *tensions_of(self.tendons),
            *moving_answers(finger.joints),
            *motion_of(finger.bodies, "output"),
            excursions(hood.tendons),
            Quantity("residual", "output", "", residual),
        )
        self.quantities = tuple(q for q in whole if 0 not in q.shape)
        if (giving := both.moves.giving) is not None:
            left = "Share of its stiffness that each part has that gives way."
            names = tuple(name.replace(" ", "_") for name in giving.names)
            self.quantities += (Quantity("left", "output", "", left, (("part", names),)),)
        start = finger.begin(both.posture)
        at_start = {
            **_answers(finger, start),
            **poses(finger.motion(finger.angles(start))),
            "tension": both.first_tensions(),
        }
        self.begin_at(at_start)

    def start(self) -> State:
        """Before the first step, which first finds the hood's equilibrium in the posture."""
        return None

    def step(self, state: MotionState | None, given: Values, dt: float) -> tuple[State, Values]:
        moves = replace(self.both.moves, drive=HeldTensions(given["tension"]))
        if state is None:
            state = self._begin()
        for h in _steps(dt, moves.dt):
            state = replace(moves, dt=h).advance(state)
        return state, self._outputs(state)

    def initial(self, given: Values) -> tuple[State, Values]:
        """Finger and hood at rest in the posture; what the tensions do there at once."""
        start = self._begin()
        moved = self.step(start, given, MOMENT * self.both.moves.dt)[1]
        at_once = {n: moved[n] for n in (*REACTIONS, "excursion", "residual") if n in moved}
        return start, {**self._outputs(start), **at_once}

    def template(self) -> State:
        return self._begin()

    def special(self) -> Special:
        return special_states(self.both.hood, self.both.finger)

    def _begin(self) -> MotionState:
        moves = self.both.moves
        return replace(moves.begin(moves.finger.begin(self.both.posture)), drive=None)

    def _outputs(self, state: MotionState) -> Values:
        finger, c = self.both.finger, state.coupled
        out = {
            **_answers(finger, c.finger),
            **poses(finger.motion(finger.angles(c.finger))),
            "residual": np.array(c.residual),
        }
        if c.point.excursion.size:
            out["excursion"] = c.point.excursion
        if (giving := self.both.moves.giving) is not None:
            out["left"] = giving.bearing(c.hood).left
        return out


@dataclass(frozen=True)
class HeldTensions:
    """The drive of tendons whose tensions (nt,) N are given: `cosim.coupling.motion.TendonDrive`.
    It has no state."""

    tension: Array

    def start(self, length: Array) -> State:
        return None

    def pull(self, state: State, time: float, length: Array, dt: float) -> SimpleNamespace:
        return SimpleNamespace(tension=self.tension, state=state)

    def settle_at(self, state: State, length: Array) -> State:
        return state

    def cylinder_signals(self, state: State, time: float) -> Array:
        return np.zeros((0, 2))

    def motor_signals(self, state: State, time: float) -> Array:
        return np.zeros((0, 2))
