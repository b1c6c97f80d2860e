"""A stand-alone job: a sheet, what holds, loads and touches it, and steps in time.

Lengths in m, forces in N, stresses in Pa, angles in rad; one right-handed world frame.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cosim.errors import InputError, unexpected
from cosim.port import Array, Ints
from fe_solver.given import fill, indices, integers, numbers, several, spread
from fe_solver.job.curves import Curve, Drive, check_curve, drive_from, drives_from
from fe_solver.sheet import Sheet
from fe_solver.solver.continuation import SAME_TIME
from fe_solver.supports import STILL, WALL, ZERO, Body, ContactPair, SpringSet, Tied

MOST_INCREMENTS = 1_000_000
"""The most increments of a step."""


@dataclass(frozen=True)
class PrescribedDisplacement:
    """Nodes of which one displacement component is given."""

    nodes: Ints
    """(k,)."""
    component: int
    """0, 1, 2: x, y, z."""
    displacement: Drive = ZERO
    """m."""
    name: str = field(default="", compare=False)
    """Under which its reaction is given."""
    steps: tuple[int, ...] | None = None
    """Numbers of the job's steps in which it is in force; None in all."""

    def __post_init__(self) -> None:
        _check_component(self.component)
        moved = drive_from("displacement (m)", self.displacement)
        fill(self, nodes=indices("nodes", self.nodes), displacement=moved)


@dataclass(frozen=True)
class HeldDirector:
    """Nodes of which one component of the director keeps its initial value."""

    nodes: Ints
    """(k,)."""
    component: int
    """0, 1, 2: x, y, z."""
    name: str = field(default="", compare=False)
    """Under which its reaction is given."""
    steps: tuple[int, ...] | None = None
    """Numbers of the job's steps in which it is in force; None in all."""

    def __post_init__(self) -> None:
        _check_component(self.component)
        fill(self, nodes=indices("nodes", self.nodes))


def _check_component(given: object) -> None:
    if given not in (0, 1, 2):
        raise unexpected("component", "0, 1 or 2 for x, y or z", given)


@dataclass(frozen=True)
class NodalForce:
    """A force on nodes, in the world frame."""

    nodes: Ints
    """(k,)."""
    force: Array
    """(3,) N on each of the nodes."""
    curve: Curve | None = None
    """Its factor over time; None leaves it as it is at all times."""

    def __post_init__(self) -> None:
        force = numbers("force (N)", self.force, 3)
        if not np.isfinite(force).all():
            raise unexpected("force (N)", "finite numbers", self.force)
        check_curve(self.curve)
        fill(self, nodes=indices("nodes", self.nodes), force=force)


@dataclass(frozen=True)
class Pressure:
    """A pressure on elements."""

    quads: Ints
    """(k,) the elements."""
    sign: Ints
    """(k,) 1 where it pushes against the element's normal (right-handed about its corners), -1
    where along it."""
    pressure: Drive
    """Pa."""
    dead: bool = False
    """Whether it keeps the direction and area of the start."""

    def __post_init__(self) -> None:
        quads = indices("quads", self.quads)
        sign = spread("sign", integers("sign", self.sign), len(quads))
        fill(self, quads=quads, sign=sign, pressure=drive_from("pressure (Pa)", self.pressure))


@dataclass(frozen=True)
class BodyForce:
    """A force on the mass of elements, in the world frame, as gravity is."""

    quads: Ints
    """(k,) the elements."""
    density: Array
    """(k,) kg/m3, as laid."""
    acceleration: tuple[Drive, Drive, Drive]
    """m/s2 along x, y, z: the force on a mass of 1 kg."""

    def __post_init__(self) -> None:
        quads = indices("quads", self.quads)
        density = spread("density (kg/m3)", numbers("density (kg/m3)", self.density), len(quads))
        drives = drives_from("acceleration (m/s2)", self.acceleration)
        fill(self, quads=quads, density=density, acceleration=drives)


@dataclass(frozen=True)
class RigidLoad:
    """A force and a moment on a body, at its origin, in the world frame; they move it where
    equilibrium finds its motion (`Body.free`)."""

    body: int
    """Its number."""
    force: tuple[Drive, Drive, Drive] = STILL
    """N along x, y, z."""
    moment: tuple[Drive, Drive, Drive] = STILL
    """N m about x, y, z; they keep their axes while the body turns."""
    follows: bool = False
    """Whether the force turns with the body."""

    def __post_init__(self) -> None:
        fill(
            self,
            force=drives_from("force (N)", self.force),
            moment=drives_from("moment (N m)", self.moment),
        )

    def at(self, time: float) -> tuple[Array, Array]:
        """The force (3,) N, of one that follows in the body's frame, and the moment (3,) N m."""
        force, moment = (np.array([d.at(time) for d in m]) for m in (self.force, self.moment))
        return force, moment


@dataclass(frozen=True)
class Step:
    """A stretch of time."""

    name: str
    end: float
    """s."""
    increments: int
    """How many a solve whose answer remembers its way takes, as one with friction does, and any
    that is asked to."""
    must: tuple[float, ...] = ()
    """s, times in it that are solved and kept in any case."""

    def __post_init__(self) -> None:
        if not (numbers("end (s)", self.end).ndim == 0 and 0 < self.end < np.inf):
            raise unexpected(f"step {self.name!r}: end (s)", "a time above 0", self.end)
        count = self.increments
        if not (numbers("increments", count).ndim == 0 and count in range(1, MOST_INCREMENTS + 1)):
            raise unexpected("increments", f"a whole number from 1 to {MOST_INCREMENTS}", count)
        fill(self, increments=int(count))


STANDING = Body("wall")
"""The body that a tie to WALL is of."""


@dataclass(frozen=True)
class Job:
    """Everything that a stand-alone solve needs; sequences are kept as tuples."""

    sheet: Sheet
    ties: Sequence[Tied] = ()
    """Nodes that move with a body, or stand still."""
    held: Sequence[PrescribedDisplacement] = ()
    """Displacements of nodes that are given."""
    held_directors: Sequence[HeldDirector] = ()
    """Directors of nodes that do not turn."""
    springs: Sequence[SpringSet] = ()
    """Springs between nodes, or from nodes to a body."""
    forces: Sequence[NodalForce] = ()
    """Dead loads on nodes."""
    pressures: Sequence[Pressure] = ()
    """Pressures that follow the elements."""
    body_forces: Sequence[BodyForce] = ()
    """Forces on the mass of the elements."""
    rigid_loads: Sequence[RigidLoad] = ()
    """Forces and moments on bodies."""
    contacts: Sequence[ContactPair] = ()
    """Faces of the sheet that touch a body."""
    bodies: Sequence[Body] = ()
    """Those that ties, springs and contacts number, and after them the wall where something is
    tied to it."""
    steps: Sequence[Step] = (Step("load", 1.0, 1),)
    """The spans of time to solve, one after the other."""
    name: str = "job"
    """The job's name in messages and files."""
    notes: Sequence[str] = ()
    """What a file holds and this job leaves out."""

    def __post_init__(self) -> None:
        for name, kind in _KINDS.items():
            fill(self, **{name: several(name, getattr(self, name), kind, f"{kind.__name__}(...)")})
        ties, bodies = tuple(self.ties), tuple(self.bodies)
        if any(t.body == WALL for t in ties):
            wall = next((i for i, b in enumerate(bodies) if b is STANDING), len(bodies))
            bodies = (*bodies[:wall], STANDING, *bodies[wall + 1 :])
            ties = tuple(replace(t, body=wall) if t.body == WALL else t for t in ties)
        fill(self, ties=ties, bodies=bodies)
        self._check_steps()

    def _check_steps(self) -> None:
        """Check what belongs to single steps.  Raises InputError."""
        count = len(self.steps)
        for name in _OF_STEPS:
            for steps in (c.steps for c in getattr(self, name) if c.steps is not None):
                wrong = [i for i in steps if i not in range(count)]
                if wrong:
                    raise InputError(
                        f"{self.name}: one of the {name} names the step {wrong[0]}, and there are "
                        f"{count}, from 0 on"
                    )
        for b in self.bodies:
            if len(b.free) != 6 or not all(len(m) == 6 for m in b.motions):
                raise unexpected(f"body {b.name!r}", "six motions", b.motions or b.free)
            if b.motions and len(b.motions) != count:
                raise unexpected(f"body {b.name!r}: motions", f"of {count} steps", len(b.motions))

    def during(self, step: int) -> Job:
        """The job with the conditions of one of its steps, by number; itself where they are those
        of all."""
        kept: dict[str, Any] = {
            name: tuple(c for c in getattr(self, name) if c.steps is None or step in c.steps)
            for name in _OF_STEPS
        }
        bodies = tuple(b.during(step) for b in self.bodies)
        same = all(a is b for a, b in zip(bodies, self.bodies, strict=True))
        if same and all(len(now) == len(getattr(self, name)) for name, now in kept.items()):
            return self
        return replace(self, bodies=bodies, **kept)

    def step_at(self, time: float) -> int:
        """The number of the step that a time (s) is in or ends; after the last step, the last."""
        ends = [s.end * (1 + SAME_TIME) for s in self.steps[:-1]]
        return bisect_left(ends, time)


_OF_STEPS = ("ties", "held", "held_directors", "contacts")
"""The conditions that may be in force in some steps alone."""
_KINDS = {
    "ties": Tied,
    "held": PrescribedDisplacement,
    "held_directors": HeldDirector,
    "springs": SpringSet,
    "forces": NodalForce,
    "pressures": Pressure,
    "body_forces": BodyForce,
    "rigid_loads": RigidLoad,
    "contacts": ContactPair,
    "bodies": Body,
    "steps": Step,
    "notes": str,
}
"""What each list of a job holds."""
