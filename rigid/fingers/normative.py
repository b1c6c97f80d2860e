"""A finger of the normative tables as one record, and the models that it makes.

The index, the middle, the ring and the little finger are four such records (`index`, `middle`,
`ring`, `little`); what the tables are, and how a path becomes a tendon, says `anatomy`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from meshes.skeleton import Skeleton
from rigid.fingers.anatomy import FLEXORS, FingerAnatomy, Row, Way, assemble, extensor, eyelets
from rigid.model import FingerModel, Surface, Vector

Ways = Mapping[str, tuple[Way, ...]]
"""By muscle, its strands."""
BOTH = ("RB", "UB")
"""The lateral bands that a long extensor pulls."""
LONG_EXTENSOR = "LE"


@dataclass(frozen=True)
class NormativeFinger:
    """What one finger differs in from another."""

    name: str
    o2o3: float
    """m, the unit of its tables: the middle phalanx between its two joint frames."""
    skeleton: Callable[[], Skeleton]
    rows: Mapping[str, Mapping[str, Row]]
    """By joint and name."""
    offset: Mapping[str, float]
    """Offset of each distal frame O from its joint's centre, in O2O3."""
    hooded: Mapping[str, tuple[str, tuple[str, ...]]]
    """By muscle that acts through a hood: its row at the MCP, and the lateral bands that it
    pulls."""
    areas: Mapping[str, float]
    """cm2, physiological cross-sections by muscle."""
    areas_source: str
    to_bone: Mapping[str, float] = field(default_factory=dict)
    """By such a muscle, the share that ends on the proximal phalanx.  Under a hood that lies on the
    bones it is a tendon of its own: RIp of RI."""
    on_bones: Ways = field(default_factory=lambda: FLEXORS)
    """The other muscles' strands."""
    bones: str = "index"
    """The finger of `meshes.skeleton.MYOHAND` whose measured bones it has."""
    reach: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """By joint, where it is not `anatomy.SHEATH_REACH`."""

    @property
    def intrinsic(self) -> dict[str, str]:
        """The tendons that join a hood from the sides, by their MCP rows."""
        return {name: row for name, (row, _) in self.hooded.items() if row != LONG_EXTENSOR}

    def strands(self, central: float) -> dict[str, tuple[Way, ...]]:
        """Each muscle's strands where a hood's slips carry fixed shares: `central` of what enters
        it is the central slip's."""
        out = {}
        for name, (row, bands) in self.hooded.items():
            ways, share = extensor(row, bands, central), self.to_bone.get(name, 0.0)
            if share:
                hooded = tuple(((1.0 - share) * part, rows) for part, rows in ways)
                ways = ((share, (("MCP", row),)), *hooded)
            out[name] = ways
        return {**out, **self.on_bones}

    def bone_strands(self) -> dict[str, tuple[Way, ...]]:
        """The strands that end on bones, for a hood that takes the others."""
        own = {f"{m}p": ((1.0, (("MCP", self.hooded[m][0]),)),) for m in self.to_bone}
        return {**own, **self.on_bones}

    def model(
        self,
        ways: Ways,
        skeleton: Skeleton,
        o2o3: float,
        bones: Mapping[str, Surface] | None = None,
    ) -> FingerModel:
        """The finger over a skeleton; o2o3: m, the unit of the tables; bones: surfaces by body,
        drawn instead of capsules."""
        anatomy = FingerAnatomy(self.name, self.rows, self.offset, ways, self.reach)
        return assemble(anatomy, skeleton, o2o3, bones)

    def scaled_model(self, ways: Ways, scale: float) -> FingerModel:
        """The finger, all lengths times `scale`."""
        return self.model(ways, self.skeleton().scale(scale), self.o2o3 * scale)

    def eyelets(self, along: float, across: float) -> dict[str, Vector]:
        """Points that hold the intrinsic tendons; see `anatomy.eyelets`."""
        return eyelets(self.rows, self.intrinsic, along, across)
