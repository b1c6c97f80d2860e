"""The potential of a reduced network, fitted to samples of another hood."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cosim.port import Array
from rigid.hoods.reduced_sample import Sample as Sample
from rigid.hoods.reduced_sample import stacked as stacked

if TYPE_CHECKING:
    from rigid.hoods.reduced import Potential as Potential


def fitted(
    samples: Sample,
    joints: tuple[str, ...],
    tendons: tuple[str, ...],
    maps: Array | None = None,
) -> Potential:
    """The potential of a hood from samples of it, see `rigid.hoods.reduction.reduced`."""
    from rigid.hoods.reduction import reduced

    return reduced(samples, joints, tendons, maps=maps)
