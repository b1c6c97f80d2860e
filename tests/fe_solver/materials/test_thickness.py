"""The stretch of a sheet's thickness against closed forms, and by FEBio's solids."""

from __future__ import annotations

import numpy as np
import pytest

from fe_solver.materials.crossed_fibres import CrossedLinear
from fe_solver.materials.fibres import HolzapfelGasserOgden, TransIsoMooneyRivlin
from fe_solver.materials.hyperelastic import NeoHookean
from fe_solver.materials.linear import Isotropic, Orthotropic
from fe_solver.materials.section import thickness_stretch
from fe_solver.materials.tension_field import TensionField
from fe_solver.q4ans.laws import solid_stress

LIGAMENT = {"c1": 1e6, "c2": 0.2e6, "c3": 0.1e6, "c4": 40.0, "c5": 60e6, "lam_max": 1.03}


def green(along: float, across: float, shear: float = 0.0) -> np.ndarray:
    return np.array([(along**2 - 1) / 2, (across**2 - 1) / 2, shear])


@pytest.mark.parametrize(
    "law", [TransIsoMooneyRivlin(**LIGAMENT), HolzapfelGasserOgden(1e6, 5e6, 10.0, 0.1, 0.5)]
)
@pytest.mark.parametrize(("along", "across"), [(1.2, 1.2**-0.5), (1.1, 1.1), (1.05, 0.8)])
def test_an_incompressible_sheet_keeps_its_volume(law, along, across):
    found = thickness_stretch(law, green(along, across))
    assert found == pytest.approx(1 / (along * across), rel=1e-12)


def test_a_linear_sheet_contracts_by_poissons_ratio():
    """Uniaxial stress: E33 = E22 = -nu E11.  Equibiaxial: E33 = -2 nu / (1 - nu) E11."""
    nu, e = 0.3, 0.04
    law = Isotropic(1e6, nu)
    uniaxial = thickness_stretch(law, np.array([e, -nu * e, 0.0]))
    assert uniaxial == pytest.approx(np.sqrt(1 - 2 * nu * e), rel=1e-12)
    biaxial = thickness_stretch(law, np.array([e, e, 0.0]))
    assert biaxial == pytest.approx(np.sqrt(1 - 4 * nu / (1 - nu) * e), rel=1e-12)


def test_a_fibrous_linear_sheet_is_alike_around_its_fibre():
    nu12, nu23, e = 0.4, 0.3, 0.02
    law = Orthotropic.transversely_isotropic(100e6, 2e6, nu12, 1e6, nu23)
    along = thickness_stretch(law, np.array([e, -nu12 * e, 0.0]))
    assert along == pytest.approx(np.sqrt(1 - 2 * nu12 * e), rel=1e-12)
    across = thickness_stretch(law, np.array([-nu12 * 2e6 / 100e6 * e, e, 0.0]))
    assert across == pytest.approx(np.sqrt(1 - 2 * nu23 * e), rel=1e-9)
    crossed = CrossedLinear(law, 50e6, 0.7)
    strain = np.array([[0.02, 0.01, 0.03], [0.0, -0.02, 0.01]])
    assert thickness_stretch(crossed, strain) == pytest.approx(thickness_stretch(law, strain))


@pytest.mark.parametrize(
    "law",
    [
        Isotropic(1e6, 0.3),
        Orthotropic(100e6, 2e6, 0.4, 1e6, 1e6, 1e6, 3e6, 0.2, 0.01),
        NeoHookean(1e6, 0.3),
        TransIsoMooneyRivlin(**LIGAMENT, k=50e6),
    ],
)
def test_a_solid_with_that_thickness_bears_nothing_across_it(law):
    strain = np.array([0.03, -0.01, 0.02])
    solid = np.zeros(6)
    solid[[0, 1, 3]] = strain
    solid[2] = (float(thickness_stretch(law, strain)) ** 2 - 1) / 2
    stress = solid_stress(law, solid)[0]
    assert abs(stress[2]) < 1e-9 * np.abs(stress).max()


def test_wrinkles_do_not_thin_a_sheet():
    """Pulled along, and shortened far more than it would contract: as in uniaxial tension."""
    field, nu, e = TensionField(Isotropic(1e6, 0.3)), 0.3, 0.02
    found = thickness_stretch(field, np.array([[e, -0.2, 0.0]]))
    assert found == pytest.approx(np.sqrt(1 - 2 * nu * e), rel=1e-4)
