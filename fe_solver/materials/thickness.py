"""How much thicker a sheet gets as it deforms: from S33 = 0, which every law of a sheet assumes."""

from __future__ import annotations

import numpy as np

from cosim.port import Array
from fe_solver.materials.crossed_fibres import CrossedLinear
from fe_solver.materials.hyperelastic import Potential, volume_ratio
from fe_solver.materials.linear import Isotropic, Law, Orthotropic
from fe_solver.materials.tension_field import TensionField


def thickness_stretch(law: Law | TensionField, strain: Array) -> Array:
    """The current over the stress-free thickness (...) at the strain (..., 3), E11, E22, 2 E12.

    Hyperelastic: J / sqrt(det C) with C the plane's, where J = 1 of an incompressible law and
    follows from S33 = 0 else.  Linear: sqrt(1 + 2 E33) with E33 = -(nu13/E1 S11 + nu23/E2 S22); of
    an orthotropic law that says nothing of the thickness (nu23 = nu31 = 0), isotropic around the
    fibre is assumed: nu13 = nu12 and nu23 = E2 / (2 G23) - 1.  Of a tension field its base law's,
    without the wrinkles.  NaN where the law has no answer.

    >>> import numpy as np
    >>> from fe_solver.materials.linear import Isotropic
    >>> from fe_solver.materials.thickness import thickness_stretch
    >>> pulled = np.array([0.02, -0.3 * 0.02, 0.0])  # free to contract across
    >>> float(thickness_stretch(Isotropic(1e6, 0.3), pulled).round(6))
    0.993982
    """
    strain = np.asarray(strain, dtype=float)
    match law:
        case TensionField():
            return thickness_stretch(law.base, law.elastic_strain(strain))
        case CrossedLinear():  # fibres in the plane leave S33 to the base
            return thickness_stretch(law.base, strain)
        case Isotropic():
            along = across = law.nu / np.asarray(law.E)
        case Orthotropic():
            along, across = _contraction(law)
        case Potential():
            plane = (1 + 2 * strain[..., 0]) * (1 + 2 * strain[..., 1]) - strain[..., 2] ** 2
            with np.errstate(divide="ignore", invalid="ignore"):
                return np.asarray(volume_ratio(law, strain) / np.sqrt(plane))
        case _:
            raise TypeError(f"no thickness of a {type(law).__name__}")
    stress = law.response(strain).stress
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(1 - 2 * (along * stress[..., 0] + across * stress[..., 1])))


def _contraction(law: Orthotropic) -> tuple[Array, Array]:
    """nu13/E1 and nu23/E2, 1/Pa."""
    E1, E2 = np.asarray(law.E1), np.asarray(law.E2)
    if np.any(law.nu23) or np.any(law.nu31):
        E3 = E2 if law.E3 is None else np.asarray(law.E3)
        return law.nu31 / E3, law.nu23 / E2
    return law.nu12 / E1, 1 / (2 * np.asarray(law.G23)) - 1 / E2
