"""An FMU in a model's place: a hood of the port over a loaded unit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass
from math import isinf
from pathlib import Path
from typing import Literal

import numpy as np

from cosim.errors import InputError
from cosim.fmu.mapping import VariablePlace, places
from cosim.fmu.quantity import STATIC_STEP, TOLERANCE, WITH_TANGENT, hood_quantities, tangent_of
from cosim.fmu.table import APART, Loading
from cosim.fmu.unit import SavedState, Unit
from cosim.port import Array, Hand, HoodJacobian, Load, Motion, Response, check_step, skew

TangentBy = Literal["outputs", "directional derivatives", "differences"]
ANSWERS = ("force", "moment", "excursion")
PULLS = ("pull_force", "pull_moment")
SHORT = 1e-3
"""s, the communication step of a unit that is asked for rest by its switch `static`."""
SHIFT, TURN, PULL = 1e-6, 2e-5, 1e-3
"""m, rad and N: steps of differences; small against a finger's sizes and a contact's smoothing,
large against what is left of a hood's residual."""


@dataclass(frozen=True)
class FmuState:
    """States of the unit before and after the step, with the step's inputs."""

    before: SavedState
    after: SavedState
    motion: Motion
    tension: Array
    dt: float


class FmuHood:
    """A hood of the port over an FMU.

    `names` maps quantities of `hood_quantities` to variables (see `mapping.places`); those of the
    tangent and the parameters may be missing.  `rest_step` (s): a communication step in
    which a unit without the switch `static` comes to rest.

    A state is a saved state of the unit, so that any may be advanced from any number of times.
    `tangent_by` says where `jacobian` comes from: outputs, directional derivatives, differences.
    `loading`: how the unit is loaded; `hand`: in whose frame it speaks.

    Raises InputError for an FMU that cannot be opened or does not map."""

    def __init__(
        self,
        path: Path,
        bodies: tuple[str, ...],
        tendons: tuple[str, ...],
        sources: tuple[str, ...],
        names: Mapping[str, str] | None = None,
        *,
        rest_step: float | None = None,
        assume_si: bool = False,
        loading: Loading = APART,
        hand: Hand = "right",
    ) -> None:
        self.bodies, self.tendons, self.sources = bodies, tendons, sources
        self.unit, self._rest_step, self._tolerance = Unit(path, loading), rest_step, 0.0
        quantities = hood_quantities(bodies, sources, tendons)
        tangent = [q.name for q in tangent_of(bodies, tendons)]
        optional = (*tangent, STATIC_STEP.name, TOLERANCE.name, WITH_TANGENT.name)
        self._place = places(self.unit.opened, quantities, names or {}, optional, assume_si, hand)
        self._tangent = [name for name in tangent if name in self._place]
        self.tangent_by: TangentBy = "differences"
        if self.unit.opened.differentiates:
            self.tangent_by = "directional derivatives"
        if len(self._tangent) == len(tangent):
            self.tangent_by = "outputs"
        self._begin = self.unit.save()

    @property
    def is_alive(self) -> bool:
        """Whether the unit can be stepped: false once its process has ended."""
        return self.unit.is_alive

    def start(self, motion: Motion) -> FmuState:
        """The unit as it was initialised; its first step finds the bodies where they are then."""
        return FmuState(self._begin, self._begin, motion, np.zeros(len(self.tendons)), np.inf)

    def advance(self, state: FmuState, motion: Motion, tension: Array, dt: float) -> Response:
        """Step the unit to a motion under tensions.  Raises InputError, among others where a step
        must be repeated that the unit cannot repeat, and ConvergenceError where the unit reports an
        error."""
        tension = np.asarray(tension, dtype=float)
        check_step(str(self.unit.opened.path), self, motion, tension, dt)
        answers = self._do_step(state.after, motion, tension, dt)
        new = FmuState(state.after, self.unit.save(), motion, tension, dt)
        wrench = np.concatenate([answers["force"], answers["moment"]], axis=2)
        pull = np.hstack([answers[name] for name in PULLS])
        load = Load(self.bodies, self.sources, wrench, pull)
        return Response(new, load, answers["excursion"])

    def jacobian(self, state: FmuState) -> HoodJacobian:
        """The derivatives of the last step's outputs by its inputs."""
        if state.before is state.after:
            raise InputError("this hood state has not been solved: call advance first")
        if self.tangent_by == "outputs":
            return self._read_jacobian(state)
        if self.tangent_by == "directional derivatives":
            return self._assemble_jacobian(state, self._directional_derivatives)
        return self._assemble_jacobian(state, self._finite_differences)

    def with_tolerance(self, tolerance: float) -> FmuHood:
        """The same unit with its parameter `tolerance` set, where it has one."""
        if TOLERANCE.name not in self._place:
            return self
        loose = copy(self)
        loose._tolerance = tolerance
        return loose

    def _do_step(
        self, start: SavedState, motion: Motion, tension: Array, dt: float, *, keep: bool = True
    ) -> dict[str, Array]:
        """The unit's answers to a step."""
        given: dict[str, Array | float] = {
            "position": motion.position,
            "rotation": motion.rotation,
            "tension": tension,
            STATIC_STEP.name: float(isinf(dt)),
            TOLERANCE.name: self._tolerance,
            WITH_TANGENT.name: float(self.tangent_by == "outputs"),
        }
        names, step = (*ANSWERS, *PULLS), self._communication_step(dt)
        return self.unit.step_from(start, self._place, given, step, names, keep=keep)

    def _communication_step(self, dt: float) -> float:
        if not isinf(dt):
            return dt
        if STATIC_STEP.name in self._place:
            return SHORT
        if self._rest_step is None:
            raise InputError(
                f"{self.unit.opened.path}: this FMU has no switch for static equilibrium; map one "
                "(hood.map.static), or write hood.rest_step, a step in which it comes to rest"
            )
        return self._rest_step

    def _read_jacobian(self, state: FmuState) -> HoodJacobian:
        n, nt = 6 * len(self.bodies), len(self.tendons)
        read = self.unit.values(self._place, self._tangent, at=state.after)
        return HoodJacobian(
            read["load_motion"].reshape(n, n),
            read["load_tension"].reshape(n, nt),
            read["excursion_motion"].reshape(nt, n),
            read["excursion_tension"].reshape(nt, nt),
        )

    def _assemble_jacobian(
        self, state: FmuState, slope: Callable[[FmuState, Array, Array], Array]
    ) -> HoodJacobian:
        """Column by column: the answers' slope along a twist (nb, 6) and a change of tension."""
        n, nt = 6 * len(self.bodies), len(self.tendons)
        columns = [
            slope(state, direction[:n].reshape(-1, 6), direction[n:])
            for direction in np.eye(n + nt)
        ]
        whole = np.stack(columns, axis=1)
        load, excursion = whole[:n], whole[n:]
        return HoodJacobian(load[:, :n], load[:, n:], excursion[:, :n], excursion[:, n:])

    def _directional_derivatives(self, state: FmuState, twist: Array, pull: Array) -> Array:
        self.unit.restore(state.after)
        turning = skew(twist[:, 3:]) @ state.motion.rotation
        seed = np.concatenate([twist[:, :3].ravel(), turning.ravel(), pull])
        unknown: list[VariablePlace] = [self._place[name] for name in ANSWERS]
        known = [self._place[name] for name in ("position", "rotation", "tension")]
        slopes = self.unit.derivative(unknown, known, seed)
        parts = np.split(slopes, np.cumsum([place.size for place in unknown])[:-1])
        answers = [part.reshape(place.shape) for part, place in zip(parts, unknown, strict=True)]
        return _stack(answers)

    def _finite_differences(self, state: FmuState, twist: Array, pull: Array) -> Array:
        """Central, from the state before the step; from the one after it for a static step, which
        has no memory and is nearer.  No tension is made negative."""
        step = SHIFT * twist[:, :3].any() + TURN * twist[:, 3:].any() + PULL * pull.any()
        start, down = state.after if isinf(state.dt) else state.before, state.tension - step * pull
        ends = []
        for sign, tension in ((1, state.tension + step * pull), (-1, np.maximum(down, 0.0))):
            motion = state.motion.displace(sign * step * twist)
            answers = self._do_step(start, motion, tension, state.dt, keep=False)
            ends.append(_stack([answers[name] for name in ANSWERS]))
        span = 2 * step if not pull.any() else (step + min(step, float(state.tension @ pull)))
        slope: Array = (ends[0] - ends[1]) / span
        return slope


def _stack(answers: list[Array]) -> Array:
    """The summed wrench of each body, then the excursions, (6 nb + nt,)."""
    force, moment, excursion = answers
    wrench = np.hstack([force.sum(axis=1), moment.sum(axis=1)])
    return np.concatenate([wrench.ravel(), excursion])
