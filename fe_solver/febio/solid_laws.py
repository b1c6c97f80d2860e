"""FEBio's laws with all six strains, for elements whose thickness is free: `isotropic elastic` and
`trans iso Mooney-Rivlin` (FEBio user manual, Materials; Weiss, Maker and Govindjee 1996, Comput
Methods Appl Mech Eng 135:107).

Components are in the order of `PAIRS`; strains are Green-Lagrange with engineering shears, stresses
second Piola-Kirchhoff, axis 1 along the fibre, axis 3 through the thickness.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.port import InputError

from ..fibre_materials import TransIsoMooneyRivlin
from ..materials import Isotropic, Law

Array = NDArray[np.float64]

PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
FIRST, SECOND = np.array(PAIRS).T
SHEAR = FIRST != SECOND
ONE = np.array([1.0, 1, 1, 0, 0, 0])
FIBRE = np.array([1.0, 0, 0, 0, 0, 0])


def covered(law: Law) -> bool:
    """Whether `solid_stress` knows the law."""
    if isinstance(law, TransIsoMooneyRivlin):
        return bool(np.isfinite(law.k)) and not np.any(law.c2)
    return isinstance(law, Isotropic)


def solid_stress(law: Law, strain: Array) -> tuple[Array, Array]:
    """Stress (..., 6), Pa, and its derivative (..., 6, 6) at strains (..., 6); not finite where the
    law has no answer.

    Raises InputError for a law that is not covered."""
    if not covered(law):
        raise InputError(f"{type(law).__name__}: not known with all six strains")
    if isinstance(law, TransIsoMooneyRivlin):
        return _fibred(law, strain)
    assert isinstance(law, Isotropic)
    mu = float(law.E) / (2 * (1 + float(law.nu)))
    stiff = 2 * mu * float(law.nu) / (1 - 2 * float(law.nu)) * np.outer(ONE, ONE)
    stiff += np.diag(mu * np.where(SHEAR, 1.0, 2.0))
    return strain @ stiff, np.broadcast_to(stiff, (*strain.shape, 6))


def normal_modulus(law: Law) -> float:
    """Pa, of a pull through the unstrained sheet's thickness, its sides free: 1 / the compliance.

    Raises InputError for a law that is not covered."""
    return float(1 / np.linalg.inv(solid_stress(law, np.zeros(6))[1])[2, 2])


def _fibred(law: TransIsoMooneyRivlin, strain: Array) -> tuple[Array, Array]:
    """W = c1 (I1~ - 3) + F(sqrt I4~) + k/2 (ln J)^2 by C, times 2 and 4."""
    C = np.zeros((*strain.shape[:-1], 3, 3))
    C[..., FIRST, SECOND] = C[..., SECOND, FIRST] = strain * np.where(SHEAR, 1.0, 2.0)
    C += np.eye(3)
    inverse = np.linalg.inv(C)
    log = np.log(np.linalg.det(C))[..., None] / 2
    ci, turn = inverse[..., FIRST, SECOND], _paired(inverse)
    trace, fibre = np.trace(C, axis1=-2, axis2=-1)[..., None], C[..., 0, 0, None]
    a = np.exp(-2 / 3 * log)
    i4 = a * fibre
    tension, rate = law.tension(np.sqrt(i4))
    by4, by44 = tension / (2 * i4), (rate - 2 * tension) / (4 * i4**2)
    d1, h1 = _isochoric(ONE, trace, a, ci, turn)
    d4, h4 = _isochoric(FIBRE, fibre, a, ci, turn)
    stress = law.c1 * d1 + by4 * d4 + law.k / 2 * log * ci
    stiff = law.c1 * h1 + by4[..., None] * h4 + by44[..., None] * _outer(d4, d4)
    stiff = stiff + law.k / 4 * _outer(ci, ci) - law.k / 2 * log[..., None] * turn
    return 2 * stress, 4 * stiff


def _isochoric(
    direction: Array, value: Array, a: Array, ci: Array, turn: Array
) -> tuple[Array, Array]:
    """Derivatives by C of a (direction : C), a = J^(-2/3); `value` (..., 1) is direction : C."""
    first = a * (direction - value / 3 * ci)
    mixed = _outer(np.broadcast_to(direction, ci.shape), ci)
    mixed = mixed + np.swapaxes(mixed, -1, -2)
    v = value[..., None]
    return first, a[..., None] * (-mixed / 3 + v / 9 * _outer(ci, ci) + v / 3 * turn)


def _outer(a: Array, b: Array) -> Array:
    return a[..., :, None] * b[..., None, :]


def _paired(inverse: Array) -> Array:
    """(..., 6, 6) minus the derivative of C's inverse by C."""
    i, j, k, l = FIRST[:, None], SECOND[:, None], FIRST, SECOND  # noqa: E741
    straight = inverse[..., i, k] * inverse[..., j, l]
    return np.asarray((straight + inverse[..., i, l] * inverse[..., j, k]) / 2)
