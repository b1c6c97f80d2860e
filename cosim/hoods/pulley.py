"""What a case may say of a hood that is cables over pulleys."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from cosim.schema.types import BodyName, Coordinate, Table, TendonName


class PathPoint(Table):
    """A point fixed to a body, in its frame, m."""

    body: BodyName
    point: tuple[Coordinate, Coordinate, Coordinate]


class PulleyHood(Table):
    """Tendons as straight lines through points fixed to bodies."""

    kind: Literal["pulley"]
    paths: dict[TendonName, Annotated[tuple[PathPoint, ...], Field(min_length=2)]]
