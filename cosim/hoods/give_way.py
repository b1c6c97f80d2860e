"""What a case may say of parts of a hood that give way, or that begin to act."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Annotated

from pydantic import Field, model_validator

from cosim.errors import InputError, nearest_names
from cosim.schema import units
from cosim.schema.fields import fault, quantity
from cosim.schema.types import Switch, Table

PartName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,60}$")]
"""A spring set of the hood as results call it, a slip that is tied to its bone, or a region."""
Time = Annotated[float, quantity(units.TIME, least="0 s", most="1000 s")]


class GiveWayConfig(Table):
    """When a part of the hood gives way: at the first of `force`, `stretch`, `energy` and `time`
    that it reaches.  It then bears nothing (brittle), or less and less (`over_time`,
    `over_stretch`).  In an equilibrium nothing gives way: the summary says which part would first.
    """

    force: Annotated[float, quantity(units.FORCE, above="0 N", most="1000 N")] | None = None
    """Its force as the summary has it: `repair_force_N`, `spring_force_N`, `slip_force_N` or
    `region_force_N`."""
    stretch: Annotated[float, quantity(units.LENGTH, above="0 mm", most="50 mm")] | None = None
    """How much longer it is than at rest, where it is most so."""
    energy: Annotated[float, quantity(units.ENERGY, above="0 N*mm", most="1e5 N*mm")] | None = None
    """What it has stored; 1 N*mm is 1 mJ."""
    time: Time | None = None
    """In a motion, when it is let go."""
    begins: Time | None = None
    """In a motion, when it begins to act, free of stress in the shape that the hood has then."""
    over_time: Annotated[float, quantity(units.TIME, above="0 s", most="1000 s")] | None = None
    """How long it takes to let go, in which its stiffness falls evenly to nothing."""
    over_stretch: Annotated[float, quantity(units.LENGTH, above="0 mm", most="50 mm")] | None = None
    """How much further it stretches until its stiffness has fallen evenly to nothing."""
    peels: Switch = False
    """Each place at which it holds the hood gives way by itself, with its share of force and
    energy."""

    @model_validator(mode="after")
    def _check(self) -> GiveWayConfig:
        ends = (self.force, self.stretch, self.energy, self.time)
        if all(end is None for end in (*ends, self.begins)):
            raise fault(
                "says nothing of when: write force, stretch, energy or time at which it gives "
                "way, or begins"
            )
        soft = [k for k in ("over_time", "over_stretch") if getattr(self, k) is not None]
        if soft and all(end is None for end in ends):
            raise fault(f"{soft[0]}: never gives way; write force, stretch, energy or time too")
        if len(soft) == 2:
            raise fault("states over_time and over_stretch; leave one of them out")
        if self.time is not None and self.time <= (self.begins or 0.0):
            raise fault("time: must be after 0 s and after begins")
        return self


def check_parts(stated: Mapping[str, GiveWayConfig], known: Collection[str]) -> None:
    """Check that every part that gives way is among `known`.  Raises InputError."""
    for name in stated:
        if name not in known:
            near = nearest_names(name, known)
            hint = f"did you mean {near[0]}? " if near else ""
            raise InputError(
                f"gives_way: the hood has no part {name!r} that could; {hint}known: "
                f"{', '.join(known)}"
            )
