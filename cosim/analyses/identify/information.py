"""Which parameters rows can tell, before anything is fitted to them.

The slopes of all rows, in their SDs, by the parameters, each over its whole range, are taken apart
into singular values: by how many SDs the rows change together as the parameters go along a
direction from one end to the other.  What changes them by less than `LEAST_CHANGE` they cannot
tell.  Rows count as points here, bands too, and slopes are those at the start: a parameter that
acts but elsewhere, as a slack spring, is not seen.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Mask

LEAST_CHANGE = 0.1
"""SDs by which all rows together change, at least, over a direction that they can tell."""
DIFFERENCE_NOISE = 1e-6
"""Relative to the largest singular value: what differences of solves do not show."""
TAKES_PART = 0.1
"""Share of a direction, and of what is lost of a parameter, from which a parameter is named."""


@dataclass(frozen=True)
class Information:
    """What rows can say of n parameters, at the start of a fit."""

    names: tuple[str, ...]
    """The parameters' names."""
    changes: Array
    """(n,) SDs, by which all rows together change over each parameter's range alone."""
    singular_values: Array
    """(n,) SDs, descending, over whole ranges."""
    directions: Array
    """(n, n), a row for each singular value."""
    correlation: Array
    """(n, n) of the parameters found, linearised; NaN of those that the rows cannot tell."""

    @property
    def told(self) -> Mask:
        """Which directions (n,) the rows can tell."""
        largest = self.singular_values.max(initial=0.0)
        return np.asarray(self.singular_values >= max(LEAST_CHANGE, DIFFERENCE_NOISE * largest))

    @property
    def rank(self) -> int:
        """How many directions the rows can tell."""
        return int(self.told.sum())

    @property
    def lost(self) -> tuple[tuple[str, ...], ...]:
        """The parameters that the rows cannot tell: alone, or together with what they cannot be
        told from."""
        none = self.directions[~self.told]
        share = none.T @ none
        left = [i for i in range(len(self.names)) if share[i, i] > TAKES_PART**2]
        groups = []
        while left:
            group, reached = [], [left.pop(0)]
            while reached:
                group.append(reached.pop())
                more = [j for j in left if abs(share[group[-1], j]) > TAKES_PART**2]
                reached += more
                left = [j for j in left if j not in more]
            groups.append(tuple(self.names[i] for i in sorted(group)))
        return tuple(groups)

    def faults(self) -> Iterator[str]:
        """Yield a line for each group of parameters that the rows cannot tell."""
        for group in self.lost:
            sizes = [float(self.changes[self.names.index(name)]) for name in group]
            if len(group) == 1 or max(sizes) < LEAST_CHANGE:
                yield (
                    f"{' and '.join(group)}: from bound to bound all rows together change by "
                    f"{max(sizes):.2g} SD, and it takes {LEAST_CHANGE:g} to tell"
                )
            else:
                yield (
                    f"{' and '.join(group)}: each changes the rows, but they cannot be told apart: "
                    "what one does the others undo"
                )


def information(names: Sequence[str], slopes: Array, ranges: Array) -> Information:
    """What slopes (m, n) by coordinates of so large ranges (n,) say."""
    n = len(names)
    scaled = slopes * ranges
    _, s, directions = np.linalg.svd(np.vstack([scaled, np.zeros((n, n))]), full_matrices=False)
    found = Information(
        tuple(names), np.linalg.norm(scaled, axis=0), s, directions, np.full((n, n), np.nan)
    )
    told = found.told
    parts = directions[told] / s[told, None]
    covariance, lost = parts.T @ parts, {name for group in found.lost for name in group}
    kept = [i for i, name in enumerate(names) if name not in lost]
    sd = np.sqrt(np.diag(covariance)[kept])
    found.correlation[np.ix_(kept, kept)] = covariance[np.ix_(kept, kept)] / np.outer(sd, sd)
    return found


def check_identifiable(found: Information) -> None:
    """Refuse what the rows cannot tell: InputError that names the parameters."""
    if faults := list(found.faults()):
        raise InputError(
            f"the rows can tell {found.rank} of {len(found.names)} parameters at the start:\n  "
            + "\n  ".join(faults)
            + "\n  fix all but one of them, add rows that depend on them, begin elsewhere, or fit "
            "nevertheless with --allow-unidentified"
        )
