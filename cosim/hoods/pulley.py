"""The hood of cables over pulleys: what a case may say of it, and how it is built."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from cosim.hoods.kind import FINGERS, BuiltHood, HoodBuilder, HoodConfig, HoodKind, Site
from cosim.port import Array, Motion
from cosim.schema.types import BodyName, Coordinate, Table, TendonName


class PathPointConfig(Table):
    """A point fixed to a body, in its frame, m."""

    body: BodyName
    """The body that it is fixed to."""
    point: tuple[Coordinate, Coordinate, Coordinate]
    """Place in the body's frame: distal, radial, dorsal."""


class PulleyHoodConfig(HoodConfig):
    """Tendons as straight lines through points fixed to bodies."""

    title: ClassVar[str] = "no deformable hood: cables through eyelets"
    fits: ClassVar[tuple[str, ...]] = (*FINGERS, "planar", "hinge", "robot", "fmu")
    example: ClassVar[tuple[str, ...]] = ("pulley_edc",)
    kind: Literal["pulley"]
    paths: dict[TendonName, Annotated[tuple[PathPointConfig, ...], Field(min_length=2)]]
    """Points that each tendon runs through, from proximal to its insertion."""

    @property
    def shares_fixed(self) -> bool:
        return True

    def tendon_names(self, finger: str) -> tuple[str, ...]:
        return tuple(self.paths)

    def lines(self, motion: Motion) -> Mapping[str, Array]:
        return {
            f"{name} cable": np.array([_world_points(motion, point) for point in path])
            for name, path in self.paths.items()
        }


def _world_points(motion: Motion, point: PathPointConfig) -> Array:
    position, rotation = motion.of(point.body)
    return position + rotation @ np.array(point.point)


def build(hood: PulleyHoodConfig, site: Site) -> BuiltHood:
    """Cables over pulleys that are fixed to the bodies, at rest in the site's poses."""
    from rigid.hoods.pulley import Cable
    from rigid.hoods.pulley import PulleyHood as Pulleys

    paths = hood.paths.items()
    cables = {name: Cable(tuple((p.body, p.point) for p in path)) for name, path in paths}
    return BuiltHood(Pulleys(cables, site.rest))


BUILDER = HoodBuilder(build)
KIND = HoodKind(PulleyHoodConfig, f"{__name__}:BUILDER")
