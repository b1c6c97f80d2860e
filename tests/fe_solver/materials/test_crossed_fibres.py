"""Two fibre families in one sheet, and fibres stretched in situ."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cosim.errors import InputError
from fe_solver.hood.fibre_families import family_angles, family_stretches, straight_stretches
from fe_solver.materials.crossed_fibres import CrossedFibres, CrossedLinear
from fe_solver.materials.fibres import (
    DispersedFamily,
    ExponentialFamily,
    HolzapfelGasserOgden,
    TransIsoMooneyRivlin,
)
from fe_solver.materials.linear import Law
from fe_solver.materials.section import Patch, join_sections, one_law
from fe_solver.materials.tension_field import TensionField
from fe_solver.sheet import in_situ_growth
from tests.proofs.fe.material_points import axes, differences, least_energy, rotate, strains
from tests.proofs.fe.material_rows import ARTERY, ISOTROPIC, ORTHOTROPIC, SOFT_TENDON, TENDON

MPA = 1e6
TOE = ExponentialFamily(0.3 * MPA, 40.0, 400 * MPA, 1.04)
ONE = HolzapfelGasserOgden(0.08 * MPA, 0.45 * MPA, 5.0, 0.1, 0.0, 10 * MPA)
LAWS: dict[str, Law] = {
    "linear": CrossedLinear(ORTHOTROPIC, 80 * MPA, 0.7),
    "incompressible": CrossedFibres(TENDON, TOE, 0.9),
    "compressible": CrossedFibres(SOFT_TENDON, TOE, -0.6),
    "dispersed": CrossedFibres(ONE, DispersedFamily(0.5 * MPA, 3.0, 0.05), 0.8),
}


@pytest.mark.parametrize("name", LAWS)
def test_tangents_and_stresses_agree_with_differences(name: str):
    tangent, stress = differences(LAWS[name], strains(100))
    assert tangent < 1e-6
    assert stress < 1e-6
    answer = LAWS[name].response(strains(20))
    assert np.array_equal(answer.tangent, np.swapaxes(answer.tangent, -1, -2))


@pytest.mark.parametrize("name", LAWS)
def test_an_angle_for_each_point_is_that_angle(name: str):
    law, angles = LAWS[name], np.array([0.2, 0.9, -0.4])
    points = strains(3)[:, None]
    law = type(law)(*list(vars(law).values())[:-1], angles[:, None])
    for i, angle in enumerate(angles):
        alone = type(law)(*list(vars(law).values())[:-1], float(angle)).response(points[i, 0])
        seen = law.response(points)
        assert seen.stress[i, 0] == pytest.approx(alone.stress, rel=1e-12)
        assert seen.tangent[i, 0] == pytest.approx(alone.tangent, rel=1e-12, abs=1e-3)


def test_two_equal_dispersed_families_are_those_of_the_one_law():
    mirrored = HolzapfelGasserOgden(0.08 * MPA, 0.9 * MPA, 5.0, 0.1, 0.4, 10 * MPA)
    crossed = CrossedFibres(ONE, DispersedFamily(0.9 * MPA, 5.0, 0.1), 0.8)
    for strain in strains(20):
        stress, tangent = rotate(crossed, strain, axes(-0.4))
        whole = mirrored.response(strain)
        assert stress == pytest.approx(whole.stress, rel=1e-9, abs=1e-6)
        assert tangent == pytest.approx(whole.tangent, rel=1e-9, abs=1e-3)


def test_which_family_is_called_the_first_does_not_matter():
    like = TransIsoMooneyRivlin(2e6, 0.0, TOE.c3, TOE.c4, TOE.c5, TOE.lam_max, 2e8)
    other = ExponentialFamily(0.5 * MPA, 60.0, 900 * MPA, 1.03)
    swapped = TransIsoMooneyRivlin(2e6, 0.0, other.c3, other.c4, other.c5, other.lam_max, 2e8)
    for strain in strains(20):
        one = rotate(CrossedFibres(like, other, 0.7), strain, axes(0.0))
        two = rotate(CrossedFibres(swapped, TOE, -0.7), strain, axes(0.7))
        assert two[0] == pytest.approx(one[0], rel=1e-9, abs=1e-6)
        assert two[1] == pytest.approx(one[1], rel=1e-9, abs=1e-3)


def test_patches_of_crossed_laws_answer_as_each_alone():
    laws = [LAWS["incompressible"], CrossedFibres(TENDON, TOE, -0.9), TENDON, LAWS["linear"]]
    thickness, strain = np.full((1, 4), 1e-3), np.zeros((len(laws), 4, 8))
    strain[..., :3] = strains(len(laws))[:, None]
    patches = [Patch(np.array([i]), law, thickness) for i, law in enumerate(laws)]
    whole = join_sections(patches).response(strain)
    for i, law in enumerate(laws):
        alone = one_law(law, np.array([1e-3])).response(strain[i : i + 1])
        np.testing.assert_allclose(whole.force[i], alone.force[0], rtol=1e-14)
        assert np.array_equal(whole.stiffness[i], alone.stiffness[0])


def test_what_fibres_a_law_has():
    assert family_angles(ISOTROPIC) == ()
    assert family_angles(TensionField(ORTHOTROPIC)) == (0.0,)
    assert family_angles(LAWS["linear"]) == (0.0, 0.7)
    assert family_angles(ARTERY) == pytest.approx((0.6, -0.6))
    assert family_angles(LAWS["dispersed"]) == pytest.approx((0.0, 0.8))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: CrossedLinear(ORTHOTROPIC, 0.0, 0.7), "modulus"),
        (lambda: CrossedFibres(TENDON, TOE, math.nan), "angle"),
        (lambda: ExponentialFamily(1.0, 40.0, 1.0, 1.0), "lam_max"),
        (lambda: DispersedFamily(1.0, 1.0, 0.5), "kappa"),
    ],
)
def test_what_no_fibres_are(make, words: str):
    with pytest.raises(InputError, match=words):
        make()


def test_growth_of_a_stretch_in_situ_keeps_the_volume():
    s = np.array([0.9, 1.0, 1.2])
    growth = in_situ_growth(s)
    assert np.prod(1 + growth, axis=1) * np.sqrt(s) == pytest.approx(np.ones(3))


def test_a_second_family_alone_is_the_law_of_one():
    """Its thickness is free too."""
    both = TransIsoMooneyRivlin(2e6, 0.7e6, 0.0, 1.0, 0.0, 2.0, 200e6)
    points = strains(5)
    only = CrossedFibres(both, TOE, 0.0).response(points).energy
    plain = TransIsoMooneyRivlin(2e6, 0.7e6, TOE.c3, TOE.c4, TOE.c5, TOE.lam_max, 200e6)
    assert only == pytest.approx(plain.response(points).energy, rel=1e-12)
    assert only == pytest.approx([least_energy(plain, e) for e in points], rel=1e-9)


@pytest.mark.parametrize(
    ("name", "straight"), [("incompressible", (1.03, 1.04)), ("linear", (1, 1))]
)
def test_a_stretch_along_a_family_is_that_of_a_line_in_its_direction(name, straight):
    """Of a plane deformation F: the length of F v."""
    F = np.array([[1.2, 0.3], [-0.1, 0.9]])
    E = (F.T @ F - np.eye(2)) / 2
    strain = np.array([[E[0, 0], E[1, 1], 2 * E[0, 1]]])
    for law in (LAWS[name], TensionField(LAWS[name])):
        angles = np.array(family_angles(law))
        lengths = np.linalg.norm(F @ [np.cos(angles), np.sin(angles)], axis=0)
        assert family_stretches(law, strain)[:, 0] == pytest.approx(lengths, rel=1e-14)
        assert straight_stretches(law) == pytest.approx(straight)
