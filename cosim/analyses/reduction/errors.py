"""How far a reduced hood is off the hood that it was fitted to, and where most."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from cosim.analyses.reduction.reduce import Reduction, state_in_words, tip_maps
from cosim.analyses.reduction.walks import LOW
from cosim.hoods.lumped.build import Sample, stack
from cosim.port import Array

MARKS = {"tip force": 0.05, "slip forces": 0.10}


class Error(NamedTuple):
    """The relative errors of a quantity; see `errors`."""

    quantity: str
    fit: float
    """Median over the states that were fitted."""
    median: float
    """Median over the states that were held out."""
    most: float
    beyond: float
    """The part of those held out that is off by more than the mark."""
    where: str
    """The held state that is off most."""

    @property
    def mark(self) -> float | None:
        """The error that its quantity should keep; None where there is no such mark."""
        return MARKS.get(self.quantity.partition(",")[0])


def errors(reduction: Reduction) -> Iterator[Error]:
    """The errors of torques, tip force and slips: the difference's size over the quantity's, state
    by state (of both slips over the larger one's force; tip force: what holds a clamped tip against
    the hood's torques).

    Where joint torques cancel at the tip its force is small and its relative error without bound,
    so that the difference is given over the root mean square of all these states' tip forces, and
    over the sum of a state's tensions, too."""
    tendons = reduction.potential.muscles
    fitted, held = (_loaded_states(samples) for samples in (reduction.samples, reduction.held_out))
    on_grid = misses(reduction, fitted)
    for name, miss in misses(reduction, held).items():
        if np.isfinite(miss).any():
            worst = held[int(np.nanargmax(miss))]
            made = Error(
                name,
                float(np.nanmedian(on_grid[name])),
                float(np.nanmedian(miss)),
                float(np.nanmax(miss)),
                0.0,
                state_in_words(worst.angle, worst.tension, tendons),
            )
            beyond = 0.0 if made.mark is None else float((miss > made.mark).mean())
            yield made._replace(beyond=beyond)


def _loaded_states(samples: Sequence[Sample]) -> list[Sample]:
    """States in which a tendon pulls with more than LOW."""
    return [s for s in samples if s.tension.max() > LOW]


def misses(reduction: Reduction, samples: Sequence[Sample]) -> dict[str, Array]:
    """The relative misses (s,) of each state, by quantity."""
    data = stack(samples)
    made = reduction.potential.derivatives(data.angle, data.tension)
    slips = reduction.potential.slips(data.angle, made.torque)
    maps = tip_maps(reduction.case, data.angle)
    tip, aimed = (np.einsum("sij,sj->si", maps, torque) for torque in (made.torque, data.torque))
    off, size = np.linalg.norm(tip - aimed, axis=1), np.linalg.norm(aimed, axis=1)
    return {
        "joint torques": _relative(made.torque - data.torque, data.torque),
        "tip force": off / size,
        "tip force, of the mean": off / np.sqrt((size**2).mean()),
        "tip force, of all tensions": off / data.tension.sum(axis=1),
        "slip forces": np.abs(slips - data.slip).max(axis=1) / data.slip.max(axis=1),
    }


def _relative(off: Array, whole: Array) -> Array:
    out: Array = np.linalg.norm(off, axis=1) / np.linalg.norm(whole, axis=1)
    return out
