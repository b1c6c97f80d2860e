"""What a case may say of a region's fibres: direction, second family and stretch in situ."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any

from pydantic import Field, model_validator

from cosim.schema import units
from cosim.schema.fields import Text, fault, quantity
from cosim.schema.types import Modulus, Number, RegionConfig, Switch, Table

AngleGrid = float | tuple[float, ...] | tuple[tuple[float, ...], ...]
"""rad: one, a list, or a list of rows."""
_ANGLE = quantity(units.ANGLE, least="-90 deg", most="90 deg")


def _read_angles(value: Any) -> AngleGrid:
    if not isinstance(value, list | tuple):
        return float(_ANGLE.read(value))
    if not value:
        raise fault("is an empty list; write an angle, or one for each number of `along`")
    rows = [isinstance(item, list | tuple) for item in value]
    if not any(rows):
        return tuple(float(_ANGLE.read(item)) for item in value)
    if not all(rows) or len({len(item) for item in value}) > 1 or not value[0]:
        raise fault("its rows are not equally long; write an angle for each number of `across`")
    return tuple(tuple(float(_ANGLE.read(item)) for item in row) for row in value)


def _write_angles(value: Any) -> Any:
    return [_write_angles(v) for v in value] if isinstance(value, tuple) else _ANGLE.write(value)


_ANGLES = Text(
    _read_angles,
    _write_angles,
    (
        (
            "title",
            "angle with its unit: at least -90 deg, at most 90 deg; or a list of them, one for "
            "each number of along; or a list of such rows, with a column for each number of across",
        ),
        ("type", ("string", "array")),
        ("examples", ("20 deg", ("0 deg", "20 deg", "35 deg"))),
    ),
)
Fraction = Annotated[Number, Field(ge=0, le=1)]
Places = Annotated[tuple[Fraction, ...], Field(min_length=2)]


class DirectionConfig(Table):
    """Which way fibres run in the sheet.

    `angle` is from the mesh's line along the finger.  Positive, it turns from distal away from the
    finger's midline, on both sides of it: fibres open distally.  0 deg is along the finger, 90 deg
    round it.  With `along`, `angle` is a list: a spline through an angle at each of these
    places, 0 at the region's proximal end and 1 at its distal one.  With `across` too it is a list
    of rows, one for each place along, with an angle for each place across: 0 at the edge nearest to
    the midline (of a region that lies over it: at the midline), 1 at the far edge.

    `field` is the name of a field of directions in the mesh file, in place of an angle."""

    angle: Annotated[AngleGrid, _ANGLES] | None = None
    """Angle of the fibres from the mesh's line along the finger."""
    along: Places | None = None
    """Places of the angles from the region's proximal (0) to its distal end (1)."""
    across: Places | None = None
    """Places of the angles from the edge nearest to the midline (0) to the far one (1)."""
    field: str | None = None
    """Name of a field of directions in the mesh file, in place of `angle`."""

    @model_validator(mode="after")
    def _one_way(self) -> DirectionConfig:
        if (self.angle is None) == (self.field is None):
            raise fault("write either angle or field, the name of a field of the mesh file")
        if self.field is not None and (self.along or self.across):
            raise fault("along and across are places of angles; they do not go with field")
        for name in ("along", "across"):
            values = getattr(self, name) or ()
            if any(b <= a for a, b in pairwise(values)):
                raise fault(f"{name}: its numbers must increase")
        if self.field is None:
            self._check_shape()
        return self

    def _check_shape(self) -> None:
        stated = _shape(self.angle)
        if self.across and not self.along:
            raise fault("across goes with along; give that too")
        wanted = tuple(len(places) for places in (self.along, self.across) if places)
        if stated != wanted:
            expected = {
                0: "one angle, or along with a place for each angle",
                1: f"{len(self.along or ())} angles, one for each place along",
                2: f"{len(self.along or ())} rows of {len(self.across or ())} angles",
            }[len(wanted)]
            raise fault(f"angle: expected {expected}")


def _shape(angles: Any) -> tuple[int, ...]:
    return (len(angles), *_shape(angles[0])) if isinstance(angles, tuple) else ()


InSituStretch = Annotated[Number, Field(ge=0.9, le=1.2)]


class SecondFamilyConfig(Table):
    """A second fibre family: its direction, said as that of the first."""

    direction: DirectionConfig
    """Direction of the second family."""


class FibrousConfig(RegionConfig):
    """What every region with fibres may say: their `direction` (without it that of the mesh: along
    the finger, round it in sagittal bands), and `in_situ_stretch`, the stretch along the (first)
    fibres of the sheet as laid out, before anything moves or pulls."""

    direction: DirectionConfig | None = None
    """Direction of the (first) fibres; without it that of the mesh."""
    second: SecondFamilyConfig | None = None
    """A second family of fibres; without it there is one."""
    in_situ_stretch: InSituStretch = 1.0
    """Stretch along the (first) fibres of the sheet as laid out, before anything pulls."""

    @property
    def fibrous(self) -> FibrousConfig:
        """The region itself, which has fibres."""
        return self


class CurvedFibresConfig(FibrousConfig):
    """What a region says besides whose fibres stiffen as they are stretched: `sliding_fibres`, with
    which a thick tendon bends as a bundle of fascicles and not as a solid."""

    sliding_fibres: Switch = False
    """The fibres slide on each other as the sheet bends: its law acts on the middle of its
    thickness, and it bends as it does at rest."""

    @property
    def slides(self) -> bool:
        """Whether the fibres slide on each other."""
        return self.sliding_fibres


class SecondLinearConfig(SecondFamilyConfig):
    """Straight fibres that add `modulus` to the sheet's along themselves, and nothing else."""

    modulus: Modulus
    """What the family adds to the modulus along itself."""


class SecondMooneyRivlinConfig(SecondFamilyConfig):
    """Fibres of the trans iso Mooney-Rivlin law with numbers of their own."""

    c3: Modulus
    """Factor of the exponential toe."""
    c4: Annotated[Number, Field(gt=0, le=600)]
    """Exponent of the toe."""
    c5: Modulus
    """Modulus of the straight part."""
    lam_max: Annotated[Number, Field(gt=1, le=2)]
    """Stretch at which the fibres are straight."""


class SecondGasserConfig(SecondFamilyConfig):
    """Fibres of Holzapfel, Gasser and Ogden with numbers of their own."""

    k1: Modulus
    """Stiffness of the fibres at small stretch."""
    k2: Annotated[Number, Field(gt=0, le=1e4)]
    """Exponent of the stiffening."""
    dispersion: Annotated[Number, Field(ge=0, le=0.3333)]
    """Spread of the fibres: 0 aligned, 1/3 isotropic."""
