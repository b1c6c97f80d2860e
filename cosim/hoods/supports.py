"""What a case may say of the supports of a hood: contact with the bones, and springs."""

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


class HeadConfig(Table):
    """What covers the head of a bone, m, where the hood slides over it as the joint flexes; no more
    than what covers the bone's back."""

    face: Offset
    """Over the articular face."""
    sides: Offset
    """Over the condyles' sides."""


class HeadsConfig(Table):
    """What covers the bones' heads, where it is not what covers their backs."""

    metacarpal: HeadConfig | None = None
    """At the MCP."""
    proximal: HeadConfig | None = None
    """At the PIP."""
    middle: HeadConfig | None = None
    """At the DIP."""


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
    """Height of the hood's face over the bare bone's back, by body."""
    heads: HeadsConfig = HeadsConfig()
    """The same over the bones' heads; a head that is not named has what its bone's back has."""
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
    toe: Annotated[float, quantity(units.LENGTH, least="0 mm", most="20 mm")] = 0.0
    """Over so much stretch before and after the slack is gone a set that pulls only sets in."""
    tension_only: Switch = True
    """It pulls and never pushes."""
