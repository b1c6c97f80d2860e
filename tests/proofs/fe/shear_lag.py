"""Shear lag: stiff fibres in a soft matrix pass their load from one to the next by shear."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fe_solver.materials.linear import Orthotropic
from tests.helpers.rows import Row
from tests.proofs.fe.paths import error_order
from tests.proofs.fe.sheets import (
    linear_response,
    mirror_plane,
    plate,
    sheet,
    with_nine_nodes,
)

ALONG, SHEAR = 1e8, 1e6
"""Pa: the fibres' modulus and the matrix's shear modulus."""
LENGTH, WIDTH = 3.0, 1.0
SOURCE = "exact: E u,xx + G u,yy = 0, u = cos(pi y / W) at one end"


def far_end(columns: int, nine: bool) -> float:
    """Displacement along the fibres at the free end of a strip whose other end is moved by
    cos(pi y / W), nothing moving across them, relative to the exact one."""
    X, quads = plate(LENGTH, WIDTH, 48, columns)
    if nine:
        X, quads = with_nine_nodes(X, quads)
    law = Orthotropic.transversely_isotropic(ALONG, SHEAR, 0.0, SHEAR, 0.0)
    start = np.isclose(X[:, 0], 0)
    none = np.zeros_like(start)
    held = np.column_stack([start, ~none, ~none])
    model = mirror_plane(sheet(X, quads, 0, 0, 0.1, law=law), np.zeros_like(held), held)
    values = np.zeros((len(X), 5))
    values[start, 0] = np.cos(np.pi * X[start, 1] / WIDTH)
    u = linear_response(model, np.zeros_like(X), values)[0]
    corner = np.isclose(X[:, 0], LENGTH) & np.isclose(X[:, 1], 0)
    return float(u[corner, 0][0] * np.cosh(np.pi / WIDTH * np.sqrt(SHEAR / ALONG) * LENGTH))


def rows() -> Iterator[Row]:
    """Yield rows of linear and of quadratic elements: four columns of the latter miss by a fiftieth
    of what eight of the former do, which have as many lines of nodes."""
    for nine, name, within in ((False, "four", 0.02), (True, "nine", 1e-3)):
        coarse, fine = far_end(2, nine) - 1, far_end(4, nine) - 1
        yield Row(
            "shear lag between stiff fibres", f"far end, {name}-node elements, 4 across", 1.0,
            1 + fine, within, SOURCE, order=error_order(coarse, fine),
        )  # fmt: skip
