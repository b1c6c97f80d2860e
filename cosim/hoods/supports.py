"""What a case may say of the supports of a hood: contact with the bones, and springs."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, model_validator

from cosim.schema import units
from cosim.schema.fields import fault, quantity
from cosim.schema.types import Gap, Modulus, Number, Offset, Switch, Table

PENALTY = {"stiffness": "200 N/mm**3", "smoothing": "0.05 mm"}
"""What a contact has that states neither these nor a layer."""


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


class LayerConfig(Table):
    """Moduli of the tissue between hood and bones, which is as thick as `offset` and `heads` say:
    its pressure is that times the share of the thickness by which it is compressed, less at first
    and more as it is used up."""

    shafts: Modulus
    """Over the bones' backs."""
    faces: Modulus
    """Over the heads' articular faces."""
    sides: Modulus
    """Beside the heads' condyles."""


class ContactConfig(Table):
    """Contact of hood and bones: through a `layer` of tissue that gives, else by a penalty
    (`stiffness`, `smoothing`), with `penetration` augmented until no node penetrates further.
    `friction` is Coulomb's coefficient."""

    layer: LayerConfig | None = None
    """Tissue between hood and bones, in place of a penalty."""
    stiffness: (
        Annotated[float, quantity(units.CONTACT_STIFFNESS, above="0 N/mm**3", most="1e6 N/mm**3")]
        | None
    ) = None
    """Pressure per depth of penetration, of a penalty; 200 N/mm**3 where there is no layer."""
    smoothing: Gap | None = None
    """Gap within which a penalty's pressure sets in smoothly; 0.05 mm where there is no layer."""
    offset: ContactOffsetConfig
    """Height of the hood's face over the bare bone's back, by body, unloaded."""
    heads: HeadsConfig = HeadsConfig()
    """The same over the bones' heads; a head that is not named has what its bone's back has."""
    penetration: Gap | None = None
    """Deepest penetration, reached by augmentation; without it a penalty alone."""
    friction: Annotated[Number, Field(ge=0, le=2)] = 0.0
    """Coulomb's coefficient."""

    @model_validator(mode="before")
    @classmethod
    def _penalty_without_a_layer(cls, values: Any) -> Any:
        match values:
            case {"layer": layer} if layer is not None:
                return values
            case dict():
                return {**PENALTY, **values}
        return values

    @model_validator(mode="after")
    def _presses_one_way(self) -> ContactConfig:
        if self.layer is None:
            return self
        for name in ("stiffness", "smoothing", "penetration"):
            if getattr(self, name) is not None:
                raise fault(f"{name}: is of a penalty; leave it out, or leave out the layer")
        bare = [body for body, over in self.offset if not over]
        if bare:
            raise fault(
                f"offset.{bare[0]}: must be above 0 mm, since a layer needs a thickness; or write "
                'stiffness = "200 N/mm**3" (a penalty) in place of the layer'
            )
        return self


class SpringConfig(Table):
    """Stiffness of the whole set, N/m, and the stretch before it acts, m."""

    stiffness: Annotated[float, quantity(units.STIFFNESS, above="0 N/mm", most="1e7 N/mm")]
    """The stiffness of the whole set."""
    slack: Annotated[float, quantity(units.LENGTH, least="0 mm", most="20 mm")]
    """Stretch before it acts."""
    toe: Annotated[float, quantity(units.LENGTH, least="0 mm", most="20 mm")] = 0.0
    """Over so much stretch before and after the slack is gone a set that pulls only sets in."""
    tension_only: Switch = True
    """It pulls and never pushes."""
