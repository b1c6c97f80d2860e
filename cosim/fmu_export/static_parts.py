"""What a written FMU computes: the hood, the finger or the coupled finger of a case.

A state is an opaque value that a step leaves as it was, as everywhere behind the port.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cosim.case.schema import Case
from cosim.coupling.equilibrium import CouplingOptions, Equilibrium, equilibrium
from cosim.coupling.finger_equilibrium import balance_finger
from cosim.coupling.state_arrays import Special
from cosim.errors import InputError
from cosim.fmu.quantity import (
    KINEMATICS,
    STATIC_STEP,
    TOLERANCE,
    WITH_TANGENT,
    Quantity,
    Values,
    finger_answers,
    finger_quantities,
    hood_quantities,
    tensions_of,
)
from cosim.fmu_export.part import (
    UnitPart,
    excursions,
    finger_places,
    loads,
    motion_of_input,
    poses,
)
from cosim.models.build import Models, tensions
from cosim.models.motion import special_states
from cosim.port import STATIC, Array, Hood, Load, PairState, Response, State, Tensions


class HoodPart(UnitPart):
    """The hood alone; a step is `Hood.advance`."""

    def __init__(self, case: Case, models: Models, tangent: bool = True) -> None:
        """Start the hood of a case.  Raises InputError for a case whose hood has no tendons."""
        self.hood = models.hood
        if not self.hood.tendons:
            raise InputError(
                f'{case.name}: hood.kind = "{case.hood.kind}" is part of the finger\'s own tendons;'
                " write the finger, or the coupled finger"
            )
        names = self.hood.bodies, self.hood.sources, self.hood.tendons
        self.quantities = hood_quantities(*names, tangent=tangent)
        motion = models.finger.motion(models.finger.start(models.posture))
        at_start = {
            **poses(motion),
            "tension": tensions(case, models)[0],
            STATIC_STEP.name: np.array(1.0),
        }
        self.begin_at(at_start)
        self._motion = motion
        self._first: tuple[list[Array], Response] | None = None

    def start(self) -> State:
        """Before the first step, which carries the hood to where the bodies are then."""
        return None

    def step(self, state: State, given: Values, dt: float) -> tuple[State, Values]:
        dt = STATIC if given[STATIC_STEP.name] else dt
        if state is None and dt == STATIC:
            response = self._first_response(given)
        else:
            response = self._advance(state, given, dt)
        out = loads(response)
        if given.get(WITH_TANGENT.name):
            out = {**out, **vars(self.hood.jacobian(response.state))}
        return response.state, out

    def initial(self, given: Values) -> tuple[State, Values]:
        """The hood at rest where the bodies are; its first step finds that again, from where they
        are then."""
        at_rest = {**given, STATIC_STEP.name: np.array(1.0)}
        return None, self.step(None, at_rest, 0.0)[1]

    def _first_response(self, given: Values) -> Response:
        """The static answer from the start, which the first step asks for again."""
        asked = [given[name] for name in ("position", "rotation", "tension", TOLERANCE.name)]
        kept = self._first
        if kept is None or not all(map(np.array_equal, kept[0], asked)):
            kept = self._first = (asked, self._advance(None, given, STATIC))
        return kept[1]

    def _advance(self, state: State, given: Values, dt: float) -> Response:
        motion = motion_of_input(self.hood.bodies, given)
        state = self.hood.start(motion) if state is None else state
        return self._solver(given).advance(state, motion, given["tension"], dt)

    def template(self) -> State:
        return self.hood.start(self._motion)

    def special(self) -> Special:
        return special_states(self.hood)

    def _solver(self, given: Values) -> Hood:
        tolerance = float(given[TOLERANCE.name])
        return self.hood.with_tolerance(tolerance) if tolerance > 0 else self.hood


class FingerPart(UnitPart):
    """The static finger alone: a step ends in its equilibrium under a load that follows its bodies.

    So far from equilibrium that a joint turns by more than a few degrees, it is a state on the way
    there (`cosim.coupling.finger_equilibrium.balance_finger`), and the load is asked for again."""

    def __init__(self, case: Case, models: Models, tangent: bool = True) -> None:
        self.finger, self.tolerance = models.finger, case.solve.tolerance
        self._posture = models.posture
        f = self.finger
        self.quantities = finger_quantities(f.bodies, f.joints, f.tendons, tangent=tangent)
        at_start = {
            **self._outputs(self.start(), np.zeros(3)),
            "tension": tensions(case, models)[1],
        }
        self.begin_at(at_start)

    def start(self) -> State:
        return self.finger.start(self._posture)

    def step(self, state: State, given: Values, dt: float) -> tuple[State, Values]:
        """`dt` plays no part: nothing here moves in time."""
        if given[KINEMATICS.name]:
            return state, self._places(self._at(given["asked_angle"]))
        wrench = np.hstack([given["force"], given["moment"]])
        bodies, n = self.finger.bodies, 6 * len(self.finger.bodies)
        load = Load(bodies, ("hood",), wrench[:, None], np.zeros((0, 6)))
        tension = given.get("tension", np.zeros(0))
        slope = given.get("load_motion", np.zeros((n, n))).reshape(n, n)
        new, balance = balance_finger(self.finger, state, load, tension, slope, self.tolerance)
        return new, self._outputs(new, balance.tip_force)

    def _at(self, angles: Array) -> State:
        """The finger at joint angles, with no reaction."""
        start = self.start()
        step = np.zeros(len(self.finger.unknowns(start)))
        step[: len(angles)] = angles - self.finger.angles(start)
        return self.finger.displace(start, step)

    def _outputs(self, state: State, tip_force: Array) -> dict[str, Array]:
        outputs = {"angle": self.finger.angles(state), "tip_force": tip_force}
        return {**outputs, **self._places(state)}

    def _places(self, state: State) -> dict[str, Array]:
        f = self.finger
        return finger_places(f.motion(state), f.tip(state), f.path_lengths(state))


@dataclass(frozen=True)
class _CoupledPartState:
    """A coupled equilibrium and the finger's paths at rest."""

    now: Equilibrium
    rest_excursion: Array
    rest_path: Array


class CoupledPart(UnitPart):
    """Hood and finger in equilibrium after each step, from rest at the resting tensions.

    A muscle's fibre is not part of it: tensions are inputs."""

    def __init__(self, case: Case, models: Models) -> None:
        self.models, self.resting = models, case.solve.resting_tension
        self.options = CouplingOptions(case.solve.tolerance, case.solve.max_iterations)
        hood, finger = models.hood, models.finger
        self.tendons = (*hood.tendons, *finger.tendons)
        self.quantities: tuple[Quantity, ...] = (
            *tensions_of(self.tendons),
            *finger_answers(finger.joints),
            excursions(self.tendons),
            *self._slips(),
        )
        posture = finger.angles(finger.start(models.posture))
        at_start = {"angle": posture, "tension": np.concatenate(tensions(case, models))}
        self.begin_at(at_start)

    def start(self) -> State:
        """Before the first step, which first finds rest at the resting tensions."""
        return None

    def step(self, state: State, given: Values, dt: float) -> tuple[State, Values]:
        """`dt` plays no part: nothing here moves in time."""
        if state is None:
            state = self._rest()
        solved = self._solve(state.now, given["tension"])
        state = _CoupledPartState(solved, state.rest_excursion, state.rest_path)
        return state, self._outputs(state)

    def template(self) -> State:
        return self._rest()

    def special(self) -> Special:
        return special_states(self.models.hood)

    def _rest(self) -> _CoupledPartState:
        finger, hood = self.models.finger, self.models.hood
        tension = np.full(len(self.tendons), self.resting)
        pulls = np.split(tension, [len(hood.tendons)])
        rest = equilibrium(
            self.models.pair, self.models.start(), Tensions(pulls[0], pulls[1]), self.options
        )
        return _CoupledPartState(rest, rest.excursion, finger.path_lengths(rest.finger_state))

    def _solve(self, last: Equilibrium, tension: Array) -> Equilibrium:
        """The equilibrium under other tensions: a hood whose tensions change is carried to its
        bodies anew.  Under the tensions that it balances an equilibrium stays as it is."""
        if np.array_equal(tension, [*last.hood_tension, *last.finger_tension]):
            return last
        hood, finger = np.split(tension, [len(self.models.hood.tendons)])
        state = last.response.state
        if not np.array_equal(hood, last.hood_tension):
            state = self.models.hood.start(last.motion)
        start = PairState(last.finger_state, state)
        return equilibrium(self.models.pair, start, Tensions(hood, finger), self.options)

    def _slips(self) -> list[Quantity]:
        if self.models.built.slips is None:
            return []
        over = (("slip", ("central", "terminal")),)
        return [Quantity("slip_force", "output", "N", "Force in the hood's slip.", over)]

    def _outputs(self, state: _CoupledPartState) -> Values:
        solved, finger = state.now, self.models.finger
        of_native = state.rest_path - finger.path_lengths(solved.finger_state)
        out = {
            "angle": finger.angles(solved.finger_state),
            "tip_force": solved.known_balance.tip_force,
            "excursion": np.concatenate([solved.excursion - state.rest_excursion, of_native]),
        }
        if self.models.built.slips is not None:
            slips = self.models.built.slips(solved.response.state)
            out["slip_force"] = np.array([slips["central"], slips["terminal"]])
        return out
