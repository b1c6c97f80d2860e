"""A hood of finite elements of which parts give way or begin to act: its springs, and others, as
regions that tear and a slip that is tied to its bone."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, cast

import numpy as np

from cosim.coupling.events import Bearing, Schedule
from cosim.errors import InputError
from cosim.hoods.fe_view import REPAIRS, spring_pulls, stored_energy
from cosim.hoods.give_way import GiveWayConfig, check_parts
from cosim.hoods.kind import BuiltHood
from cosim.port import Array, Hood, HoodJacobian, Ints, Mask, Motion, Response
from fe_solver.hood.shell_hood import HoodState, ShellHood
from fe_solver.supports import SpringSet, links_of, springs_of

Forces = Mapping[str, Callable[[Any, Any], float]]
"""N that parts without springs bear, of a hood and its state, by name."""
MOST_KEPT = 8
"""Hoods with other shares left that are kept, the last ones made."""
NO_SPRINGS = np.zeros(0, dtype=np.intp)
OF_SPRINGS = ("stretch", "energy", "begins", "over_time", "over_stretch", "peels")


@dataclass(frozen=True)
class Unit:
    """What gives way at once: a part, or one place of a part that peels."""

    part: str
    place: tuple[int, int]
    """Its number among the places of its part, from 1, and how many these are."""
    springs: Ints
    """(k,) in the part's set; none of a part without springs."""
    when: GiveWayConfig
    share: float = 1.0
    """How much of the part's stiffness it has."""

    @property
    def name(self) -> str:
        """The part, with the place of one that peels."""
        return (
            self.part if self.place[1] == 1 else f"{self.part} {self.place[0]} of {self.place[1]}"
        )


def units_of(
    hood: ShellHood, stated: Mapping[str, GiveWayConfig], others: Forces
) -> tuple[Unit, ...]:
    """Return what gives way of a hood, with its parts without springs.  Raises InputError for parts
    that it has not, and for what those without springs cannot do."""
    sets = {s.name: s for s in hood.springs}
    check_parts(stated, [*sets, *others])
    out: list[Unit] = []
    for name, when in stated.items():
        wrong = [key for key in OF_SPRINGS if getattr(when, key)] if name not in sets else []
        if wrong:
            raise InputError(
                f"gives_way.{name}.{wrong[0]}: it has no springs, so that it gives way at a force "
                "or a time, at once and as a whole"
            )
        springs = NO_SPRINGS if name not in sets else np.arange(len(sets[name].nodes))
        if not when.peels:
            out.append(Unit(name, (1, 1), springs, when))
            continue
        stiffness = np.broadcast_to(sets[name].law.stiffness, len(springs))
        nodes, place = np.unique(sets[name].nodes, return_inverse=True)
        for i, share in enumerate(np.bincount(place, stiffness) / stiffness.sum()):
            out.append(Unit(name, (i + 1, len(nodes)), springs[place == i], when, float(share)))
    return tuple(out)


def bearing_of(
    hood: ShellHood,
    units: Sequence[Unit],
    state: HoodState,
    others: Forces,
    whole: ShellHood | None = None,
) -> Bearing:
    """Return what the units bear in a solved state of the hood; of one that relaxed its stretches
    count from the lengths of the `whole` one, and what it stored is not known."""
    laid, pulls = spring_pulls(whole or hood, state), spring_pulls(hood, state)
    sets = {s.name: (s, *pulls[s.name]) for s in hood.springs}
    rows = []
    for unit in units:
        i, when, force, stretch, energy = unit.springs, unit.when, 0.0, 0.0, 0.0
        if unit.part not in sets:
            force = others[unit.part](hood, state)
        else:
            springs, axial, along = sets[unit.part]
            each = axial.force[i]
            energy = float(axial.energy[i].sum()) if whole is None else np.nan
            of_repair = unit.part.startswith(REPAIRS)
            force = float(each.sum() if of_repair else np.linalg.norm(each @ along[i]))
            longer = np.maximum(
                laid[unit.part][0].stretch[i], 0.0 if springs.law.tension_only else -np.inf
            )
            place = np.unique(springs.nodes[i], return_inverse=True)[1]
            stretch = float(np.sqrt(np.bincount(place, longer**2).max()))
        borne = (force / unit.share, stretch, energy / unit.share)
        limits = (when.force, when.stretch, when.energy)
        shares = [b / limit for b, limit in zip(borne, limits, strict=True) if limit is not None]
        rows.append((force, stretch, energy, max(shares, default=0.0), 1.0))
    return Bearing(*np.array(rows).T)


@dataclass(frozen=True)
class GivingState:
    """A hood's state, and what is left of its parts."""

    hood: HoodState
    left: Array
    """(k,) the share of its stiffness that each unit has."""
    length: Array
    """(ns,) m, the springs' rest lengths, set by set."""


class GivingFeHood:
    """A hood of finite elements as `cosim.coupling.events.GivingHood`."""

    def __init__(self, built: BuiltHood, stated: Mapping[str, GiveWayConfig]) -> None:
        whole = cast(ShellHood, built.hood)  # by the schema
        self.bodies, self.tendons, self.sources = whole.bodies, whole.tendons, whole.sources
        self.whole, self._built, self._others = whole, built, built.others()
        self.units = units_of(whole, stated, self._others)
        self.names = tuple(unit.name for unit in self.units)
        when = [
            (w.begins, w.time, w.over_time, w.over_stretch) for w in (u.when for u in self.units)
        ]
        each = zip(zip(*when, strict=True), (np.inf, np.inf, 0.0, 0.0), strict=True)
        self.schedule = Schedule(*(np.array([no if t is None else t for t in c]) for c, no in each))
        counts = np.cumsum([0, *(len(s.nodes) for s in whole.springs)]).tolist()
        self._first = dict(zip((s.name for s in whole.springs), counts, strict=False))
        self._variants: dict[bytes, ShellHood] = {}

    def start(self, motion: Motion) -> GivingState:
        """The rest shape, with all parts that act from the start."""
        length = np.concatenate([np.zeros(0), *(s.length for s in self.whole.springs)])
        left = np.isinf(self.schedule.begins).astype(float)
        return GivingState(self.whole.start(motion), left, length)

    def advance(self, state: GivingState, motion: Motion, tension: Array, dt: float) -> Response:
        """The response with what is left of the parts.  Raises InputError and ConvergenceError."""
        response = self.hood_of(state).advance(state.hood, motion, tension, dt)
        return response._replace(state=replace(state, hood=response.state))

    def jacobian(self, state: GivingState) -> HoodJacobian:
        """Derivatives at a state that `advance` returned."""
        return self.hood_of(state).jacobian(state.hood)

    def with_tolerance(self, tolerance: float) -> Hood:
        """The same hood: in a motion no round is a first one."""
        return self

    def with_left(self, state: GivingState, left: Array, begin: Mask) -> GivingState:
        """The state with other shares (k,), not in equilibrium; units that `begin` (k,) are free of
        stress in its shape."""
        length, hood = state.length.copy(), self.hood_of(state)
        pulls = spring_pulls(hood, state.hood)
        for i in np.flatnonzero(begin):
            unit = self.units[i]
            stretch = pulls[unit.part][0].stretch
            length[self._first[unit.part] + unit.springs] += stretch[unit.springs]
        laid = HoodState(state.hood.motion, state.hood.configuration)
        return GivingState(replace(laid, iterations=state.hood.iterations), left, length)

    def bearing(self, state: GivingState) -> Bearing:
        """What the units bear in a state that `advance` returned."""
        found = bearing_of(self.hood_of(state), self.units, state.hood, self._others)
        share = np.where(state.left > 0, found.share, 0.0)
        return found._replace(share=share, left=state.left)

    def energy(self, state: GivingState) -> float:
        """J stored in the hood."""
        return stored_energy(state.hood)

    def hood_of(self, state: GivingState) -> ShellHood:
        """The hood with what is left of its parts in a state."""
        if (state.left == 1.0).all() and np.isinf(self.schedule.begins).all():
            return self.whole
        key = state.left.tobytes() + state.length.tobytes()
        if key not in self._variants:
            self._variants = dict([*self._variants.items()][1 - MOST_KEPT :])
            self._variants[key] = self._weakened(state)
        return self._variants[key]

    def _weakened(self, state: GivingState) -> ShellHood:
        share, gone = np.ones(len(state.length)), []
        for unit, left in zip(self.units, state.left, strict=True):
            if unit.part in self._first:
                share[self._first[unit.part] + unit.springs] = left
            elif left == 0.0:
                gone.append(unit.part)
        base, sets = self.whole, []
        if gone and self._built.without is not None:
            base = cast(ShellHood, self._built.without(gone))
        for s in base.springs:
            own = slice(self._first[s.name], self._first[s.name] + len(s.nodes))
            law = replace(s.law, stiffness=share[own] * s.law.stiffness)
            sets.append(replace(s, law=law, length=state.length[own]))
        return with_springs(base, sets)

    def built_of(self, state: GivingState) -> BuiltHood:
        """What there is to know of a state's hood, which takes `state.hood`."""
        assert self._built.around is not None
        return self._built.around(self.hood_of(state))

    def to_arrays(self, state: GivingState) -> dict[str, Array]:
        """All that a state is made of."""
        inner = self.hood_of(state).to_arrays(state.hood)
        return {"left": state.left, "length": state.length, **inner}

    def from_arrays(self, arrays: Mapping[str, Array]) -> GivingState:
        """The state of `to_arrays`.  Raises InputError where the arrays are another hood's."""
        inner = dict(arrays)
        laid = self.whole.start(self.whole.rest)
        bare = GivingState(laid, inner.pop("left"), inner.pop("length"))
        return replace(bare, hood=self.hood_of(bare).from_arrays(inner))


def with_springs(hood: ShellHood, springs: Sequence[SpringSet]) -> ShellHood:
    """Return the hood with other laws and rest lengths of its springs: the same sets, with the same
    ends."""
    model = hood.model.with_changes(springs=springs_of(springs), links=links_of(springs))
    return replace(hood, model=model, springs=tuple(springs))


class VaryingHood(Hood, Protocol):
    """A hood whose states are each of another hood of finite elements of the same mesh."""

    def built_of(self, state: Any) -> BuiltHood:
        """What there is to know of a state's hood, which takes `state.hood`."""
        ...

    def energy(self, state: Any) -> float:
        """J stored in the hood."""
        ...


def giving_hood(built: BuiltHood, stated: Mapping[str, GiveWayConfig]) -> BuiltHood:
    """Return a built hood whose parts give way, with all that looks at its states.  Raises
    InputError."""
    return with_variants(built, GivingFeHood(built, stated))


def with_variants(built: BuiltHood, hood: VaryingHood) -> BuiltHood:
    """Return a built hood in place of which one that varies acts, with all that looks at its
    states."""
    positions = built.points.positions

    def looks(name: str) -> Callable[[Any], Any]:
        return lambda state: getattr(hood.built_of(state), name)(state.hood)

    points = replace(built.points, positions=lambda state: positions(state.hood))
    view, slips = looks("view"), looks("slips")
    return replace(built, hood=hood, view=view, slips=slips, points=points, energy=hood.energy)
