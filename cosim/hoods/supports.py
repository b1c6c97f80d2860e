"""What a case may say of that which holds a hood: contact with the bones, and springs."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cosim.schema import units
from cosim.schema.fields import quantity
from cosim.schema.types import Gap, Number, Offset, Switch, Table


class ContactOffsetConfig(Table):
    """Height of the hood's face, or of cables' centre lines, over the bare bone, m: what cartilage
    and capsule take."""

    metacarpal: Offset
    """Over the metacarpal."""
    proximal: Offset
    """Over the proximal phalanx."""
    middle: Offset
    """Over the middle phalanx."""
    distal: Offset
    """Over the distal phalanx."""


class ContactConfig(Table):
    """Contact of hood and bones: a penalty; with `penetration` augmented until no node penetrates
    further, with `friction` (Coulomb's coefficient) augmented too."""

    stiffness: Annotated[
        float, quantity(units.CONTACT_STIFFNESS, above="0 N/mm**3", most="1e6 N/mm**3")
    ]
    """Pressure per depth of penetration."""
    smoothing: Gap
    """Gap within which the pressure sets in smoothly."""
    offset: ContactOffsetConfig
    """Height of the hood's face over the bare bone, by body."""
    penetration: Gap | None = None
    """Deepest penetration, reached by augmentation; without it a penalty alone."""
    friction: Annotated[Number, Field(ge=0, le=2)] = 0.0
    """Coulomb's coefficient."""


class SpringConfig(Table):
    """Stiffness of the whole set, N/m, and the stretch before it acts, m."""

    stiffness: Annotated[float, quantity(units.STIFFNESS, above="0 N/mm", most="1e7 N/mm")]
    """Of the whole set."""
    slack: Annotated[float, quantity(units.LENGTH, least="0 mm", most="20 mm")]
    """Stretch before it acts."""
    tension_only: Switch = True
    """It pulls and never pushes."""
