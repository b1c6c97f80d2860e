"""Fibres that are stretched in the sheet as it is laid out (FEBio's isochoric `in-situ stretch`).

The stress-free sheet is shorter along the fibre by the stretch s, and wider and thicker by its
square root, so that it has the same volume: laid out, a strip of an incompressible law that is free
across bears a uniaxial tension at the stretch s.  (Maas et al. 2016, J Mech Behav Biomed Mater
61:499.)
"""

from __future__ import annotations

import numpy as np

from cosim.port import Array


def in_situ_growth(stretch: Array, isochoric: Array | bool = True) -> Array:
    """The growth (ne, 2) along and across the fibres (see `shell.shell_tables`) of sheets whose
    fibres are stretched by `stretch` (ne,); across there is none where it is not `isochoric` (ne,),
    and the thickness stays (FEBio's F = diag(s, 1, 1))."""
    return np.stack([1 / stretch, np.where(isochoric, np.sqrt(stretch), 1.0)], axis=1) - 1


def stress_free_thickness(laid: Array, stretch: Array) -> Array:
    """The thickness (ne, ...) m, without stress, of a sheet that is `laid` (ne, ...) thick with
    fibres stretched by `stretch` (ne,)."""
    return laid * np.sqrt(stretch).reshape(-1, *[1] * (laid.ndim - 1))


def thickness_as_laid(stress_free: Array, growth: Array) -> Array:
    """The thickness (ne, ...) m, as laid, of a sheet of growth (ne,) along or (ne, 2) along and
    across: what is wider without stress by a stretch in situ is thicker by as much."""
    if growth.ndim == 1:
        return stress_free
    return stress_free / (1 + growth[:, 1]).reshape(-1, *[1] * (stress_free.ndim - 1))
