"""Coulomb friction of a tendon round one guide (capstan), and how it follows the slide.

    T_beyond = T_before exp(-mu theta g),    dg = d(slide) / s,    -1 <= g <= 1,

with the slide counted towards the muscle and `s` the presliding distance, over which friction turns
from none to all (Prandtl 1928; Dahl 1968).  What a step takes up of the slide before the tendon
glides is s dg; the rest rubs.
"""

from __future__ import annotations

import numpy as np

from cosim.port import Array


def tension_ratio(turn: Array, grip: Array) -> Array:
    """The tension beyond a guide over that before it; `turn`: mu theta."""
    return np.asarray(np.exp(-turn * grip))


def free_grip(grip: Array, slide: Array, presliding: Array | float) -> Array:
    """The grip after a slide (m) as if it had no limits: beyond -1 and 1 the tendon glides."""
    return np.asarray(grip + slide / presliding)


def grip_after(grip: Array, slide: Array, presliding: Array | float) -> Array:
    """The grip after a slide (m) over `presliding` (m)."""
    return np.clip(free_grip(grip, slide, presliding), -1.0, 1.0)


def held_length(turn: Array, before: Array, after: Array) -> Array:
    """The work per N of tension before a guide, and per m of presliding, that it takes up as its
    grip changes: the integral of 1 - exp(-mu theta g)."""
    change = tension_ratio(turn, after) - tension_ratio(turn, before)
    straight = after - before
    return straight + np.divide(change, turn, out=-straight, where=turn > 0)
