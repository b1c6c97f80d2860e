"""A hood of finite elements that relaxes: its sheet or cables, and its springs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from cosim.hoods.fe_view import spring_pulls
from cosim.hoods.giving import with_springs, with_variants
from cosim.hoods.kind import BuiltHood
from cosim.port import Array, Hood, HoodJacobian, Motion, Response
from fe_solver.forces.cables import Cables, cable_state
from fe_solver.hood.shell_hood import HoodState, ShellHood
from fe_solver.materials.prony import Memory, Prony

Law = tuple[float, Array]
"""A factor of the elastic law, and what is held besides, as of `Prony.law`."""


@dataclass(frozen=True)
class RelaxingState:
    """A hood's state, the law under which it was solved, and what its parts have borne."""

    hood: HoodState
    law: Law | None = None
    """None where no time has passed."""
    memory: Memory | None = None
    """None as `law`."""
    rest_energy: float = 0.0
    """J stored for good at the start."""


class RelaxingFeHood:
    """A hood of finite elements whose parts relax from the first step on; what it bears at rest,
    before that, does not."""

    def __init__(self, built: BuiltHood, prony: Prony) -> None:
        self.whole, self.prony, self._built = cast(ShellHood, built.hood), prony, built
        whole = self.whole
        self.bodies, self.tendons, self.sources = whole.bodies, whole.tendons, whole.sources
        self._last: tuple[Law | None, ShellHood] = (None, whole)

    def start(self, motion: Motion) -> RelaxingState:
        """The rest shape."""
        return RelaxingState(self.whole.start(motion))

    def advance(self, state: RelaxingState, motion: Motion, tension: Array, dt: float) -> Response:
        """The response `dt` s later.  Raises InputError and ConvergenceError."""
        state = self.begun(state, dt)
        law = None if state.memory is None else self.prony.law(state.memory, dt)
        hood = self.hood_under(law)
        response = hood.advance(state.hood, motion, tension, dt)
        after = replace(state, hood=response.state, law=law)
        return response._replace(state=self.remembered(after, dt))

    def begun(self, state: RelaxingState, dt: float) -> RelaxingState:
        """The state, with a memory where time begins to pass from rest."""
        if state.memory is not None or np.isinf(dt):
            return state
        begun = replace(state, memory=self.prony.start(borne(self.whole, state.hood)))
        return replace(begun, rest_energy=self.energy(begun))

    def remembered(self, state: RelaxingState, dt: float) -> RelaxingState:
        """A solved state with what it bears in its memory, `dt` s after that; at rest, infinitely
        long after, as it was."""
        if state.memory is None or np.isinf(dt):
            return state
        memory = self.prony.after(state.memory, borne(self.hood_of(state), state.hood), dt)
        return replace(state, memory=memory)

    def jacobian(self, state: RelaxingState) -> HoodJacobian:
        """Derivatives at a state that `advance` returned, for changes within its step."""
        return self.hood_of(state).jacobian(state.hood)

    def with_tolerance(self, tolerance: float) -> Hood:
        """The same hood: in a motion no round is a first one."""
        return self

    def hood_of(self, state: RelaxingState) -> ShellHood:
        """The hood under the law of a state."""
        return self.hood_under(state.law)

    def hood_under(self, law: Law | None) -> ShellHood:
        """The hood under a law, None the elastic one; the last one made is kept."""
        if law is None:
            return self.whole
        known = self._last[0]
        if known is None or known[0] != law[0] or not np.array_equal(known[1], law[1]):
            self._last = law, relaxed(self.whole, *law)
        return self._last[1]

    def energy(self, state: RelaxingState) -> float:
        """J stored in the hood for good since the start: what it gives back if it is unloaded
        slowly."""
        if state.memory is None:
            return 0.0
        hood, left = self.whole, self.prony.left
        slow = relaxed(hood, left, (1 - left) * state.memory.rest).model
        none = np.zeros(len(hood.tendons))
        stored = slow.evaluate(state.hood.configuration, none, tangent=False).energy
        return stored - state.rest_energy

    def built_of(self, state: RelaxingState) -> BuiltHood:
        """What there is to know of a state's hood, which takes `state.hood`."""
        assert self._built.around is not None
        return self._built.around(self.hood_of(state))

    def to_arrays(self, state: RelaxingState) -> dict[str, Array]:
        """All that a state is made of."""
        out = self.hood_of(state).to_arrays(state.hood)
        if state.law is not None:
            out |= {"law/factor": np.array(state.law[0]), "law/held": state.law[1]}
        if state.memory is not None:
            out |= {f"memory/{name}": part for name, part in state.memory._asdict().items()}
            out["memory/rest_energy"] = np.array(state.rest_energy)
        return out

    def from_arrays(self, arrays: Mapping[str, Array]) -> RelaxingState:
        """The state of `to_arrays`.  Raises InputError where the arrays are another hood's."""
        law = memory = None
        rest_energy = float(arrays.get("memory/rest_energy", 0.0))
        if "law/held" in arrays:
            law = float(arrays["law/factor"]), arrays["law/held"]
        if "memory/rest" in arrays:
            memory = Memory(*(arrays[f"memory/{name}"] for name in Memory._fields))
        hood = self.hood_under(law).from_arrays(arrays)
        return RelaxingState(hood, law, memory, rest_energy)


def relaxing_hood(built: BuiltHood, prony: Prony) -> BuiltHood:
    """Return a built hood whose parts relax, with all that looks at its states."""
    return with_variants(built, RelaxingFeHood(built, prony))


def borne(hood: ShellHood, state: HoodState) -> Array:
    """Return what a hood's parts bear (n,): the resultants of its sheet, the forces of its springs
    along themselves, set by set, and of its cables without their residual tension."""
    model = hood.model
    sheet = model.section.response(hood.strain(state)).force
    springs = [axial.force for axial, _ in spring_pulls(hood, state).values()]
    cables = cable_state(model.cables, state.configuration.x)
    residual = model.cables.residual * (1 + cables.strain)
    return np.concatenate([sheet.ravel(), *springs, cables.force - residual])


def relaxed(hood: ShellHood, factor: float, held: Array) -> ShellHood:
    """Return a hood in a step of its relaxation: the laws of its parts times `factor`, and what is
    `held` (n,), as of `borne`.  A spring or cable that cannot push has the rest length at which it
    bears nothing."""
    section, sets = hood.model.section, []
    first = 8 * section.count * section.points
    sheet = held[:first].reshape(section.count, section.points, 8)
    for s in hood.springs:
        own = slice(first, first + len(s.nodes))
        first = own.stop
        stiffness = factor * np.broadcast_to(s.law.stiffness, len(s.nodes))
        shorter = np.divide(held[own], stiffness, out=np.zeros(len(s.nodes)), where=stiffness > 0)
        law = replace(s.law, stiffness=stiffness)
        sets.append(replace(s, law=law, length=s.length - shorter))
    made = with_springs(hood, sets)
    model = made.model.with_changes(
        section=section.relaxed(factor, sheet),
        cables=_relaxed_cables(hood.model.cables, factor, held[first:]),
    )
    return replace(made, model=model)


def _relaxed_cables(cables: Cables, factor: float, held: Array) -> Cables:
    """Cells that bear what is `held` (k,) N too, by another length free of stress."""
    length = cables.length * (1 - held / (factor * cables.modulus * cables.section))
    share = length / cables.length
    return replace(
        cables,
        length=length,
        modulus=factor * share * cables.modulus,
        toe=cables.toe / share,
        residual=share * cables.residual,
    )
