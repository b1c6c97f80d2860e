"""The potential of a reduced network, fitted to samples of another hood."""

from __future__ import annotations

from cosim.port import Array
from rigid.hoods.reduced import ReducedPotential as Potential
from rigid.hoods.reduced_sample import Sample as Sample
from rigid.hoods.reduced_sample import stack as stack
from rigid.hoods.reduction import reduce_hood


def fit_potential(
    samples: Sample,
    joints: tuple[str, ...],
    tendons: tuple[str, ...],
    maps: Array | None = None,
) -> Potential:
    """The potential of a hood from samples of it, see `rigid.hoods.reduction.reduce_hood`."""
    return reduce_hood(samples, joints, tendons, maps=maps)
