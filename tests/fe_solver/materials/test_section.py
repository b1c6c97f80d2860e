"""Stress resultants: several materials side by side, and transverse shear at large strain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fe_solver.materials.fibres import HolzapfelGasserOgden
from fe_solver.materials.hyperelastic import NeoHookean
from fe_solver.materials.linear import Isotropic, Law
from fe_solver.materials.section import Patch, Section, join_sections
from fe_solver.materials.tension_field import TensionField
from tests.proofs.fe.material_rows import TENDON

LAWS: tuple[Law | TensionField, ...] = (
    TENDON,
    replace(TENDON, c1=3e5, lam_max=1.01),
    replace(TENDON, k=np.inf),
    replace(TENDON, k=np.inf, c5=5e7),
    Isotropic(1e6, 0.3),
    NeoHookean(1e6, 0.3),
    NeoHookean(np.array([[1e6], [2e6], [3e6]]), 0.3),
    HolzapfelGasserOgden(1e4, 1e5, 2.0, 0.1, 0.2, 1e6),
    HolzapfelGasserOgden(2e4, 1e5, 2.0, 0.1, 0.2, 1e6),
    HolzapfelGasserOgden(2e4, 1e5, 2.0, 0.1, 0.3, 1e6),
    TensionField(Isotropic(1e6, 0.3)),
    TensionField(Isotropic(2e6, 0.3)),
    TensionField(TENDON, 1e-2),
    TensionField(replace(TENDON, c1=3e5, lam_max=1.01), 1e-2),
)


def test_materials_side_by_side_answer_as_each_does_alone() -> None:
    rng = np.random.default_rng(4)
    shuffled = rng.permutation(3 * len(LAWS)).reshape(-1, 3)
    patches = [
        Patch(elements, law, rng.uniform(5e-4, 1e-3, (3, 4)), rng.uniform(0.5, 1.5, (3, 1)))
        for elements, law in zip(shuffled, LAWS, strict=True)
    ]
    strain = rng.uniform(-0.05, 0.05, (shuffled.size, 4, 8)) * [1, 1, 1, 100, 100, 100, 1, 1]
    together = join_sections(patches).response(strain)
    for p in patches:
        alone = join_sections([replace(p, elements=np.arange(3))]).response(strain[p.elements])
        for whole, own in zip(together, alone, strict=True):
            np.testing.assert_allclose(whole[p.elements], own, rtol=1e-14, atol=0)


@pytest.mark.parametrize("sliding", [False, True])
def test_fibres_that_slide_leave_a_bent_tendon_its_force_in_the_middle(sliding: bool) -> None:
    """Stretched by 5 % beyond its toe and bent round four times its thickness."""
    h = 1e-3
    law, strain = replace(TENDON, k=np.inf), np.zeros((1, 4, 8))
    strain[..., 0] = 0.05
    straight = sheet(law, 1, sliding=sliding).response(strain).force[0, 0]
    strain[..., 3] = 1 / (4 * h)
    force = sheet(law, 1, sliding=sliding).response(strain).force[0, 0]
    eccentric = force[3] / force[0]
    if sliding:
        at_rest = law.response(np.zeros(3)).tangent[0, 0]
        assert force[0] == pytest.approx(straight[0], rel=1e-12)
        assert force[3] == pytest.approx(at_rest * h**3 / 12 / (4 * h), rel=1e-12)
        assert eccentric < 0.06 * h
    else:
        assert eccentric > 0.2 * h


def test_a_linear_law_has_no_fibres_that_slide() -> None:
    with pytest.raises(ValueError, match="do not slide"):
        sheet(Isotropic(1e6, 0.3), 1, sliding=True)


def sheet(law: Law, count: int, **changes: float) -> Section:
    return join_sections([Patch(np.arange(count), law, np.full((count, 4), 1e-3), **changes)])


def test_patches_with_shear_corrections_of_their_own_keep_them() -> None:
    patches = [
        Patch(np.array([i]), TENDON, np.full((1, 4), 1e-3), shear_correction=k)
        for i, k in enumerate((0.5, 1.0))
    ]
    strain = np.zeros((2, 4, 8))
    strain[..., 6] = 0.01
    one, other = join_sections(patches).response(strain).force[..., 6]
    np.testing.assert_allclose(2 * one, other, rtol=1e-12)


def test_a_sheared_sheet_has_the_energy_of_an_incompressible_solid() -> None:
    """F = (a1, a2, l d) with a unit director d and det F = 1; fibres are slack."""
    rng = np.random.default_rng(11)
    a = np.eye(3)[:2] * [0.8, 0.9, 1] + rng.uniform(-0.1, 0.1, (50, 4, 2, 3))
    d = np.array([0, 0, 1]) + rng.uniform(-0.8, 0.8, (50, 4, 3))
    d /= np.linalg.norm(d, axis=-1, keepdims=True)
    stretch = 1 / np.einsum("egk,egk->eg", np.cross(a[..., 0, :], a[..., 1, :]), d)
    C = a @ np.swapaxes(a, -1, -2)
    assert C[..., 0, 0].max() < 1
    strain = np.zeros((50, 4, 8))
    strain[..., 0], strain[..., 1] = (C[..., 0, 0] - 1) / 2, (C[..., 1, 1] - 1) / 2
    strain[..., 2], strain[..., 6:] = C[..., 0, 1], np.einsum("egik,egk->egi", a, d)
    law = replace(TENDON, c2=0.0, k=np.inf)
    energy = sheet(law, 50, shear_correction=1.0).response(strain).energy
    solid = law.c1 * (np.trace(C, axis1=-2, axis2=-1) + stretch**2 - 3) * 1e-3
    np.testing.assert_allclose(energy, solid, rtol=1e-12)


@pytest.mark.parametrize("law", [NeoHookean(1e6, 0.3), TensionField(NeoHookean(1e6, 0.3))])
def test_no_director_comes_to_lie_in_the_sheet(law: Law) -> None:
    strain = np.zeros((3, 4, 8))
    strain[:, :, 6] = np.array([0.99, 0.9999, 1.0])[:, None]
    energy = sheet(law, 3).response(strain).energy[:, 0]
    assert energy[1] > 50 * energy[0]
    assert energy[2] == np.inf


@pytest.mark.parametrize("law", [LAWS[0], LAWS[2], LAWS[5], LAWS[7], LAWS[-1]])
def test_force_and_stiffness_of_a_sheared_sheet_are_derivatives(law: Law) -> None:
    rng, section, step = np.random.default_rng(12), sheet(law, 20), 1e-6
    strain = rng.uniform(-0.1, 0.1, (20, 4, 8)) * [1, 1, 1, 100, 100, 100, 4, 4]
    here = section.response(strain)
    for i, size in enumerate([1, 1, 1, 100, 100, 100, 1, 1]):
        way = step * size * np.eye(8)[i]
        up, down = section.response(strain + way), section.response(strain - way)
        slope = (up.energy - down.energy) / (2 * way[i])
        np.testing.assert_allclose(here.force[..., i], slope, atol=1e-5 * np.abs(slope).max())
        slopes = (up.force - down.force) / (2 * way[i])
        np.testing.assert_allclose(here.stiffness[..., i], slopes, atol=1e-5 * np.abs(slopes).max())
