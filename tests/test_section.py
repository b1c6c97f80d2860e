"""Stress resultants of several materials side by side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fe_solver.fibre_materials import HolzapfelGasserOgden
from fe_solver.hyperelastic import NeoHookean
from fe_solver.materials import Isotropic, Law
from fe_solver.section import Patch, joined_sections
from fe_solver.tension_field import TensionField
from fe_solver.verification.material_rows import TENDON

LAWS: tuple[Law | TensionField, ...] = (
    TENDON,
    replace(TENDON, c1=3e5, lam_max=1.01),
    replace(TENDON, k=np.inf),
    replace(TENDON, k=np.inf, c5=5e7),
    Isotropic(1e6, 0.3),
    NeoHookean(1e6, 0.3),
    NeoHookean(np.array([[[1e6]], [[2e6]], [[3e6]]]), 0.3),
    HolzapfelGasserOgden(1e4, 1e5, 2.0, 0.1, 0.2, 1e6),
    HolzapfelGasserOgden(2e4, 1e5, 2.0, 0.1, 0.2, 1e6),
    HolzapfelGasserOgden(2e4, 1e5, 2.0, 0.1, 0.3, 1e6),
    TensionField(Isotropic(1e6, 0.3)),
    TensionField(Isotropic(2e6, 0.3)),
)


def test_materials_side_by_side_answer_as_each_does_alone() -> None:
    rng = np.random.default_rng(4)
    shuffled = rng.permutation(3 * len(LAWS)).reshape(-1, 3)
    patches = [
        Patch(elements, law, rng.uniform(5e-4, 1e-3, (3, 4)), rng.uniform(0.5, 1.5, (3, 1)))
        for elements, law in zip(shuffled, LAWS, strict=True)
    ]
    strain = rng.uniform(-0.05, 0.05, (shuffled.size, 4, 8)) * [1, 1, 1, 100, 100, 100, 1, 1]
    together = joined_sections(patches).response(strain)
    for p in patches:
        alone = joined_sections([replace(p, elements=np.arange(3))]).response(strain[p.elements])
        for whole, own in zip(together, alone, strict=True):
            np.testing.assert_allclose(whole[p.elements], own, rtol=1e-14, atol=0)
