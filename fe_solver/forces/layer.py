"""A layer of tissue between a hood and a bone, which gives and stiffens as it is used up.

Compressed by the share e of its thickness h, a layer of modulus M bears the pressure

    p = M f(e),    f(e) = e^2 / ((e + TOE) (1 - e)),

which sets in smoothly (as tissue does, whose fibres are straightened first), is about M e beyond
the toe, and grows without bound as the layer is used up; from USED_UP on it goes on straight, so
that no trial step meets the end.  Its energy by area is W(d, h, M) = M h w(d / h), w' = f.
Thickness and modulus are fields over the bone: W depends on the point's place through all three, so
that forces are exact derivatives of the energy and a tendon is pressed towards where the layer is
thick or soft.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cosim.port import Array
from fe_solver.surfaces.shapes import Surface

TOE = 0.1
"""Share of the thickness over which the pressure sets in (assumption)."""
USED_UP = 0.8
"""Share of the thickness beyond which the law goes on straight: it bears 3.6 M there."""


@dataclass(frozen=True)
class Layer:
    """Fields over a bone in its body's frame, each a value with its derivatives."""

    thickness: Surface
    """m."""
    modulus: Surface
    """Pa."""
    usual: tuple[float, float]
    """What a point that does not touch yet expects to meet of both, m and Pa."""
    share: float = 1.0
    """The part of the modulus that acts; below 1 on the way to an equilibrium alone."""


class LayerResponse(NamedTuple):
    """A layer at k points, by area."""

    energy: Array
    """(k,) J/m2."""
    slopes: Array
    """(k, 3), the energy's derivatives by depth (the pressure, Pa), thickness and modulus."""
    second: Array
    """(k, 3, 3), its second derivatives."""


def pressure_law(share: Array) -> tuple[Array, Array, Array]:
    """Return w, f and f' at the shares (k,) of the thickness by which a layer is compressed.

    >>> import numpy as np
    >>> from fe_solver.forces.layer import pressure_law
    >>> work, pressure, slope = pressure_law(np.array([-0.1, 0.0, 0.3]))
    >>> pressure.round(4)  # over the modulus; none where the layer is not touched
    array([0.    , 0.    , 0.3214])
    """
    e = np.clip(share, 0.0, USED_UP)
    a, b = TOE**2 / (1 + TOE), 1 / (1 + TOE)
    work = a * np.log1p(e / TOE) - b * np.log1p(-e) - e
    pressure = e * e / ((e + TOE) * (1 - e))
    slope = b / (1 - e) ** 2 - a / (e + TOE) ** 2
    more = np.maximum(share - USED_UP, 0.0)
    return work + (pressure + slope * more / 2) * more, pressure + slope * more, slope


def layer_response(depth: Array, thickness: Array, modulus: Array) -> LayerResponse:
    """Return the energy by area, and its derivatives, of layers of `thickness` (k,) m and `modulus`
    (k,) Pa compressed by `depth` (k,) m."""
    e, h, M = depth / thickness, thickness, modulus
    work, pressure, slope = pressure_law(e)
    by_h = work - e * pressure
    second = np.empty((len(e), 3, 3))
    second[:, 0, 0] = M * slope / h
    second[:, 0, 1] = second[:, 1, 0] = -M * e * slope / h
    second[:, 1, 1] = M * e * e * slope / h
    second[:, 0, 2] = second[:, 2, 0] = pressure
    second[:, 1, 2] = second[:, 2, 1] = by_h
    second[:, 2, 2] = 0.0
    slopes = np.stack([M * pressure, M * by_h, h * work], axis=1)
    return LayerResponse(M * h * work, slopes, second)
