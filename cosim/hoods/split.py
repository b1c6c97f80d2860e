"""The hood that is a fixed split: what a case may say of it, and what its slips bear."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from cosim.fingers.common import EQUAL_SHARES, Extensor
from cosim.hoods.kind import (
    FINGERS,
    BuiltHood,
    HoodBuilder,
    HoodConfig,
    HoodKind,
    Site,
    no_variations,
)
from cosim.hoods.variation import Variation, shift
from cosim.schema.types import Number
from meshes.skeleton import BODIES

if TYPE_CHECKING:
    from rigid.model import FingerModel


class SplitHoodConfig(HoodConfig):
    """No hood at all: tendons that part into strands of fixed shares, `central` of what enters the
    hood going to the central slip (equal parts in the normative model: An et al. 1979)."""

    title: ClassVar[str] = "no hood: tendons that part in fixed shares"
    fits: ClassVar[tuple[str, ...]] = (*FINGERS, "planar", "hinge", "robot")
    is_coupled: ClassVar[bool] = False
    rungs: ClassVar[Mapping[str, str]] = {"split": "base/split"}
    example: ClassVar[tuple[str, ...]] = ("split_edc",)
    kind: Literal["split"]
    central: Annotated[Number, Field(ge=0, le=1)] = EQUAL_SHARES
    """Share of the central slip in what enters the hood."""

    @property
    def left_to_finger(self) -> Extensor:
        return Extensor(central=self.central)

    @property
    def shares_fixed(self) -> bool:
        return True

    def tendon_names(self, finger: str) -> tuple[str, ...]:
        return ()


def build(hood: SplitHoodConfig, site: Site) -> BuiltHood:
    """A hood of no tendons."""
    from rigid.hoods.pulley import PulleyHood

    model = site.anatomy.model
    slips = None if model is None else partial(split_slips, model, site.anatomy.hooded)
    return BuiltHood(PulleyHood({}, site.rest), own_slips=slips)


def split_slips(
    model: FingerModel, hooded: Sequence[str], tension: Mapping[str, float]
) -> dict[str, float]:
    """Forces (N) of the strands that end on the middle and on the distal phalanx, of the tendons
    `hooded` (tension by name, N)."""
    ends = {"central": BODIES[2], "terminal": BODIES[3]}
    strands = [
        (strand.path[-1].body, strand.share * tension[tendon.name])
        for tendon in model.tendons
        if tendon.name in hooded
        for strand in tendon.strands
    ]
    return {slip: sum(f for body, f in strands if body == end) for slip, end in ends.items()}


def variations(hood: SplitHoodConfig) -> Iterator[Variation]:
    """The share of the central slip, lower and higher by 0.1; there is nothing else to vary."""
    yield shift("central slip's share", {"hood.central": hood.central}, 0.1, None)
    yield from no_variations(hood)


BUILDER = HoodBuilder(build)
KIND = HoodKind(SplitHoodConfig, f"{__name__}:BUILDER", variations=variations)
