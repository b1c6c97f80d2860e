"""A hood of finite elements of which parts give way or begin to act: its springs, and slips that
are tied to their bones."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from cosim.coupling.events import Bearing, Schedule
from cosim.errors import InputError, nearest_names
from cosim.hoods.fe_view import REPAIRS, stored_energy
from cosim.hoods.give_way import GiveWayConfig
from cosim.hoods.kind import BuiltHood
from cosim.port import Array, Hood, HoodJacobian, Ints, Mask, Motion, Response
from fe_solver.hood.shell_hood import TIE, HoodState, ShellHood
from fe_solver.supports import SpringSet

KEPT = 8
"""Hoods with other shares left that are kept, the ones used last."""


@dataclass(frozen=True)
class Unit:
    """What gives way at once: a part, or one place of a part that peels."""

    part: str
    place: tuple[int, int]
    """Its number among the places of its part, from 1, and how many these are."""
    springs: Ints
    """(k,) in the part's set; none of a slip that is tied."""
    when: GiveWayConfig
    share: float
    """Of the part's stiffness."""

    @property
    def name(self) -> str:
        """The part, with the place of one that peels."""
        return (
            self.part if self.place[1] == 1 else f"{self.part} {self.place[0]} of {self.place[1]}"
        )


def units_of(hood: ShellHood, stated: Mapping[str, GiveWayConfig]) -> tuple[Unit, ...]:
    """Return what gives way of a hood.  Raises InputError for parts that it has not, and for what a
    tied slip cannot do."""
    sets, tied = {s.name: s for s in hood.springs}, bool(len(hood.model.ties.node))
    known = [*sets, *([TIE] if tied and TIE not in sets else [])]
    out: list[Unit] = []
    for name, when in stated.items():
        if name not in known:
            near = nearest_names(name, known)
            hint = f"did you mean {near[0]}? " if near else ""
            raise InputError(
                f"gives_way: the hood has no part {name!r} that could; {hint}known: "
                f"{', '.join(known)}"
            )
        if name in sets:
            out += _units(name, sets[name], when)
            continue
        for key in ("stretch", "energy", "begins", "over_time", "over_stretch", "peels"):
            if getattr(when, key):
                raise InputError(
                    f"gives_way.{name}.{key}: the slip is tied to its bone, so that it gives way "
                    "at a force or a time, at once and as a whole"
                )
        out.append(Unit(name, (1, 1), np.zeros(0, dtype=np.intp), when, 1.0))
    return tuple(out)


def _units(name: str, springs: SpringSet, when: GiveWayConfig) -> list[Unit]:
    stiffness = np.broadcast_to(springs.law.stiffness, len(springs.nodes))
    if not when.peels:
        return [Unit(name, (1, 1), np.arange(len(stiffness)), when, 1.0)]
    nodes, place = np.unique(springs.nodes, return_inverse=True)
    shares = np.bincount(place, stiffness) / stiffness.sum()
    return [
        Unit(name, (i + 1, len(nodes)), np.flatnonzero(place == i), when, float(share))
        for i, share in enumerate(shares)
    ]


def bearing_of(hood: ShellHood, units: Sequence[Unit], state: HoodState) -> Bearing:
    """Return what the units bear in a solved state of the hood."""
    pulls = dict(zip((s.name for s in hood.springs), hood.pulls(state), strict=True))
    sets = {s.name: s for s in hood.springs}
    rows = []
    for unit in units:
        if unit.part not in sets:
            force = float(np.linalg.norm(hood.group_forces(state)[TIE]))
            rows.append((force, 0.0, 0.0, force / (unit.when.force or np.inf)))
            continue
        axial, along = pulls[unit.part]
        each, i = axial.force[unit.springs], unit.springs
        if unit.part.startswith(REPAIRS):
            force = float(each.sum())
        else:
            force = float(np.linalg.norm(each @ along[i]))
        longer = axial.stretch[i]
        if sets[unit.part].law.tension_only:
            longer = np.maximum(longer, 0.0)
        square = np.bincount(np.unique(sets[unit.part].nodes[i], return_inverse=True)[1], longer**2)
        stretch, energy = float(np.sqrt(square.max())), float(axial.energy[i].sum())
        when, inf = unit.when, np.inf
        shares = (
            force / (inf if when.force is None else unit.share * when.force),
            stretch / (inf if when.stretch is None else when.stretch),
            energy / (inf if when.energy is None else unit.share * when.energy),
        )
        rows.append((force, stretch, energy, max(shares)))
    return Bearing(*np.array(rows).T)


def schedule_of(units: Sequence[Unit]) -> Schedule:
    """Return when units give way or begin by the clock, and how."""

    def each(key: str, missing: float) -> Array:
        stated = [getattr(unit.when, key) for unit in units]
        return np.array([missing if value is None else value for value in stated])

    return Schedule(
        each("begins", np.inf),
        each("time", np.inf),
        each("over_time", 0.0),
        each("over_stretch", 0.0),
    )


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
        self.whole = cast(ShellHood, built.hood)  # by the schema
        self.units, self._built = units_of(self.whole, stated), built
        self.names = tuple(u.name for u in self.units)
        self.schedule = schedule_of(self.units)
        self._variants: OrderedDict[bytes, ShellHood] = OrderedDict()
        self._untied: ShellHood | None = None

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies that are shared with the other side."""
        return self.whole.bodies

    @property
    def tendons(self) -> tuple[str, ...]:
        """The tendons that pull on it."""
        return self.whole.tendons

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of what acts on the bodies, in the ledger's order."""
        return self.whole.sources

    def start(self, motion: Motion) -> GivingState:
        """The rest shape, with all parts that act from the start."""
        length = [np.zeros(0), *(s.length for s in self.whole.springs)]
        left = np.where(np.isinf(self.schedule.begins), 1.0, 0.0)
        return GivingState(self.whole.start(motion), left, np.concatenate(length))

    def advance(self, state: GivingState, motion: Motion, tension: Array, dt: float) -> Response:
        """The response with what is left of the parts.  Raises InputError and ConvergenceError."""
        return self._own(state, self.hood_of(state).advance(state.hood, motion, tension, dt))

    def _own(self, state: GivingState, response: Response) -> Response:
        return response._replace(state=replace(state, hood=response.state))

    def jacobian(self, state: GivingState) -> HoodJacobian:
        """Derivatives at a state that `advance` returned."""
        return self.hood_of(state).jacobian(state.hood)

    def with_tolerance(self, tolerance: float) -> Hood:
        """The same hood: in a motion no round is a first one."""
        return self

    def left(self, state: GivingState) -> Array:
        """The share (k,) of its stiffness that each unit has left."""
        return state.left

    def with_left(self, state: GivingState, left: Array, begin: Mask) -> GivingState:
        """The state with other shares (k,), not in equilibrium; units that `begin` (k,) are free of
        stress in its shape."""
        length, first = state.length.copy(), self._first()
        pulls = self.hood_of(state).pulls(state.hood) if begin.any() else []
        names = [s.name for s in self.hood_of(state).springs]
        for unit in (u for u, on in zip(self.units, begin, strict=True) if on):
            stretch = pulls[names.index(unit.part)][0].stretch
            length[first[unit.part] + unit.springs] += stretch[unit.springs]
        hood = HoodState(
            state.hood.motion, state.hood.configuration, iterations=state.hood.iterations
        )
        return GivingState(hood, left, length)

    def bearing(self, state: GivingState) -> Bearing:
        """What the units bear in a state that `advance` returned."""
        found = bearing_of(self.hood_of(state), self.units, state.hood)
        return found._replace(share=np.where(state.left > 0, found.share, 0.0))

    def energy(self, state: GivingState) -> float:
        """J stored in the hood."""
        return stored_energy(state.hood)

    def _first(self) -> dict[str, int]:
        """Where each set's springs begin among all."""
        sets = self.whole.springs
        counts = np.cumsum([0, *(len(s.nodes) for s in sets)])
        return {s.name: int(n) for s, n in zip(sets, counts[:-1], strict=True)}

    def hood_of(self, state: GivingState) -> ShellHood:
        """The hood with what is left of its parts in a state."""
        if (state.left == 1.0).all() and np.isinf(self.schedule.begins).all():
            return self.whole
        key = state.left.tobytes() + state.length.tobytes()
        if key not in self._variants:
            self._variants[key] = self._weakened(state)
            if len(self._variants) > KEPT:
                self._variants.popitem(last=False)
        self._variants.move_to_end(key)
        return self._variants[key]

    def _weakened(self, state: GivingState) -> ShellHood:
        base, first, sets = self.whole, self._first(), []
        for unit, left in zip(self.units, state.left, strict=True):
            if unit.part not in first and left == 0.0:
                base = self._without_tie(unit.part)
        for s in base.springs:
            share = np.ones(len(s.nodes))
            for unit, left in zip(self.units, state.left, strict=True):
                if unit.part == s.name:
                    share[unit.springs] = left
            at = first[s.name]
            law = replace(s.law, stiffness=share * s.law.stiffness)
            sets.append(replace(s, law=law, length=state.length[at : at + len(s.nodes)]))
        return base.with_springs(sets)

    def _without_tie(self, part: str) -> ShellHood:
        if self._untied is None:
            assert self._built.untied is not None
            self._untied = cast(ShellHood, self._built.untied(part))
        return self._untied

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
        left, length = inner.pop("left"), inner.pop("length")
        bare = GivingState(self.start(self.whole.rest).hood, left, length)
        return replace(bare, hood=self.hood_of(bare).from_arrays(inner))


def giving_hood(built: BuiltHood, stated: Mapping[str, GiveWayConfig]) -> BuiltHood:
    """Return a built hood whose parts give way, with all that looks at its states.  Raises
    InputError."""
    hood = GivingFeHood(built, stated)

    def looks(name: str) -> Callable[[GivingState], Any]:
        return lambda state: getattr(hood.built_of(state), name)(state.hood)

    positions = built.points.positions
    return replace(
        built,
        hood=hood,
        view=looks("view") if built.view else None,
        slips=looks("slips") if built.slips else None,
        energy=hood.energy,
        points=replace(built.points, positions=lambda state: positions(state.hood)),
    )
