"""The kinds of shell element, by their number of nodes, and what is the same for all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.port import Ints
from fe_solver.elements.mitc4 import FOUR
from fe_solver.elements.mitc9 import NINE
from fe_solver.elements.strain_forms import Element

KINDS = {4: FOUR, 9: NINE}


def kind_of(nodes: NDArray) -> Element:
    """The kind of elements whose nodes, or something by node, are in `nodes` (ne, k, ...)."""
    return KINDS[nodes.shape[1]]


def display_quads(quads: Ints) -> Ints:
    """The four-node quads (h ne, 4) that show elements (ne, k), those of an element together."""
    return np.asarray(quads[:, kind_of(quads).shown].reshape(-1, 4))
