"""What a case may say of tendons of a builder's own: pulleys on the joints, points on the bones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from cosim.schema import units
from cosim.schema.fields import name_of, quantity
from cosim.schema.types import BodyName, Coordinate, TendonName
from meshes.skeleton import BODIES

if TYPE_CHECKING:
    from rigid.fingers.pulley_tendons import TendonRoute

FLEXION_JOINTS = ("MCP", "PIP", "DIP")
Radius = Annotated[float, quantity(units.LENGTH, least="-50 mm", most="50 mm")]
Pulleys = dict[
    TendonName,
    Annotated[dict[Annotated[str, name_of("joint", FLEXION_JOINTS)], Radius], Field(min_length=1)],
]
Point = tuple[Coordinate, Coordinate, Coordinate]
Points = dict[
    TendonName,
    Annotated[
        dict[BodyName, Annotated[tuple[Point, ...], Field(min_length=1, max_length=8)]],
        Field(min_length=1),
    ],
]


def routes(
    pulleys: Mapping[str, Mapping[str, float]],
    points: Mapping[str, Mapping[str, tuple[Point, ...]]],
) -> tuple[TendonRoute, ...]:
    """The routes of all tendons that either table names; points by bone, from proximal on."""
    from rigid.fingers.pulley_tendons import TendonRoute

    out = []
    for name in dict.fromkeys((*pulleys, *points)):
        radius, at = pulleys.get(name, {}), points.get(name, {})
        over = tuple((joint, radius[joint]) for joint in FLEXION_JOINTS if joint in radius)
        through = tuple((bone, at[bone]) for bone in BODIES if bone in at)
        out.append(TendonRoute(name, over, through))
    return tuple(out)
