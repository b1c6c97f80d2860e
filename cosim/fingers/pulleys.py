"""What a case may say of tendons of a builder's own: pulleys on the joints, points on the bones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

from pydantic import Field, model_validator

from cosim.schema import units
from cosim.schema.fields import fault, quantity
from cosim.schema.types import Coordinate, Table, TendonName

if TYPE_CHECKING:
    from rigid.fingers.pulley_tendons import TendonRoute

Radius = Annotated[float, quantity(units.LENGTH, least="-50 mm", most="50 mm")]
Point = tuple[Coordinate, Coordinate, Coordinate]
BonePoints = Annotated[tuple[Point, ...], Field(min_length=1, max_length=8)]


class PulleysConfig(Table):
    """Radii of the pulleys that a tendon runs over, each the tendon's moment arm over the joint's
    range: positive where the tendon flexes the joint (it runs palmar of the axis), negative where
    it extends it (dorsal).  The tendon ends on the bone beyond its last pulley, and crosses a joint
    without one through the axis.  A pulley turns with the bone beyond it: in abduction, which
    planar and hinge fingers have not, that of the MCP is off its flexion axis, and the arm off the
    radius by up to 1.6 % at 10, 6.4 % at 20, 14 % at 30 and 19 % at 35 degrees."""

    MCP: Radius | None = None
    """Radius of the pulley at the MCP."""
    PIP: Radius | None = None
    """Radius of the pulley at the PIP."""
    DIP: Radius | None = None
    """Radius of the pulley at the DIP."""

    @model_validator(mode="after")
    def _check_some(self) -> PulleysConfig:
        if not self.radius():
            raise fault('has no pulley; give it one, for example MCP = "8 mm"')
        return self

    def radius(self) -> dict[str, float]:
        """m by joint, of those that are stated."""
        return {joint: value for joint, value in self if value is not None}


class RouteConfig(Table):
    """Points that a tendon runs through on each bone, from proximal on, in the bone's frame
    (distal, radial, dorsal of its proximal joint; of the metacarpal's, the MCP).  Between points on
    two bones it runs straight, or over the pulley that it has at the joint between."""

    metacarpal: BonePoints | None = None
    """Points of the metacarpal."""
    proximal: BonePoints | None = None
    """Points of the proximal phalanx."""
    middle: BonePoints | None = None
    """Points of the middle phalanx."""
    distal: BonePoints | None = None
    """Points of the distal phalanx."""

    def points(self) -> dict[str, tuple[Point, ...]]:
        """m by bone, of those that are stated."""
        return {bone: value for bone, value in self if value is not None}


Pulleys = dict[TendonName, PulleysConfig]
Routes = dict[TendonName, RouteConfig]


def routes_of(pulleys: Mapping[str, PulleysConfig], points: Routes) -> tuple[TendonRoute, ...]:
    """The routes of all tendons that either table names."""
    from rigid.fingers.pulley_tendons import TendonRoute

    out = []
    for name in dict.fromkeys((*pulleys, *points)):
        radius = pulleys[name].radius() if name in pulleys else {}
        through = points[name].points() if name in points else {}
        out.append(TendonRoute(name, tuple(radius.items()), tuple(through.items())))
    return tuple(out)
