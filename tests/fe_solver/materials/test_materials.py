"""The plane-stress laws, beside the rows of `cosim verify fe` on materials."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from cosim.errors import InputError
from fe_solver.materials import wrinkle_search
from fe_solver.materials.crossed_fibres import CrossedFibres
from fe_solver.materials.fibres import (
    ExponentialFamily,
    HolzapfelGasserOgden,
    TransIsoMooneyRivlin,
)
from fe_solver.materials.hyperelastic import NeoHookean, volume_ratio
from fe_solver.materials.linear import Isotropic, Law, LinearLaw, Orthotropic
from fe_solver.materials.section import one_law
from fe_solver.materials.tension_field import RESIDUAL, State, TensionField
from tests.proofs.fe import material_rows
from tests.proofs.fe.material_points import (
    axes,
    differences,
    fibre_tension,
    pull_uniaxially,
    relaxed_energy,
    rotate,
    strains,
    uniaxial,
)
from tests.proofs.fe.material_rows import LAWS, ORTHOTROPIC, SMOOTH, TENDON

CURVED = {n: law for n, law in LAWS.items() if not isinstance(law, LinearLaw | TensionField)}
MORE = {
    "auxetic neo-Hookean": NeoHookean(1e6, -0.3),
    "nearly incompressible neo-Hookean": NeoHookean(1e6, 0.4999),
    "stiff in bulk": replace(TENDON, k=2e13),
    "soft in bulk": replace(TENDON, k=1e4),
    "dispersed to isotropy": HolzapfelGasserOgden(1e4, 1e5, 2.0, 1 / 3, 0.0, 1e6),
    "soft in shear": TensionField(Orthotropic(1e8, 1e6, 0.3, 1e4, 1e4, 1e4), SMOOTH),
    "stiff in shear": TensionField(Orthotropic(1e8, 1e6, -2.0, 1e8, 1e4, 1e4), SMOOTH),
}


@pytest.mark.parametrize("name", MORE)
def test_tangent_of_uncommon_parameters(name: str) -> None:
    tangent, stress = differences(MORE[name], strains(100))
    assert tangent < 1e-6
    assert stress < 1e-6


@pytest.mark.parametrize("name", [*LAWS, *MORE])
def test_symmetric_tangent_and_rest(name: str) -> None:
    law = (LAWS | MORE)[name]
    tangent = law.response(strains(50)).tangent
    assert np.array_equal(tangent, np.swapaxes(tangent, -1, -2))
    rest = law.response(np.zeros(3))
    smoothing = law.smoothing if isinstance(law, TensionField) else 0.0
    assert abs(rest.energy) <= 1e-9 + 3 * smoothing**2 * rest.tangent.max()
    assert np.abs(rest.stress).max() < (1e-14 + 3 * smoothing) * rest.tangent.max()
    assert np.linalg.eigvalsh(rest.tangent).min() > 0
    assert all(np.all(np.asarray(G) > 0) for G in law.shear())


@pytest.mark.parametrize("name", CURVED)
def test_large_strains_have_an_answer(name: str) -> None:
    """A thousand stretches between a third and three in any direction."""
    rng = np.random.default_rng(3)
    F = rng.uniform(-1, 1, (1000, 2, 2)) + np.diag([1.5, 1.5])
    stretches = np.linalg.svd(F, compute_uv=False)
    F = F[(stretches[:, 1] > 1 / 3) & (stretches[:, 0] < 3)]
    C = np.swapaxes(F, -1, -2) @ F
    strain = np.stack([(C[:, 0, 0] - 1) / 2, (C[:, 1, 1] - 1) / 2, C[:, 0, 1]], -1)
    law = LAWS[name]
    if isinstance(law, HolzapfelGasserOgden):
        law = replace(law, k2=0.5)
    out = law.response(strain)
    assert len(F) > 500
    assert np.isfinite(out.energy).all()
    assert (out.energy >= -1e-9 * np.abs(out.energy).max()).all()
    assert np.isfinite(out.stress).all()
    assert np.isfinite(out.tangent).all()


@pytest.mark.parametrize("name", CURVED)
def test_inadmissible_strain_costs_infinite_energy(name: str) -> None:
    good = np.array([0.02, 0.01, 0.03])
    folded, crossed, broken = [-0.6, 0.0, 0.0], [0.0, 0.0, 1.5], [np.nan, 0.0, 0.0]
    both_negative = [-0.7, -0.7, 0.0]
    out = LAWS[name].response(np.array([folded, good, crossed, broken, both_negative]))
    assert np.array_equal(np.isinf(out.energy), [True, False, True, True, True])
    assert not out.stress[[0, 2, 3, 4]].any()
    assert not out.tangent[[0, 2, 3, 4]].any()
    alone = LAWS[name].response(good)
    assert np.array_equal(out.stress[1], alone.stress)
    assert np.array_equal(out.tangent[1], alone.tangent)


def test_energy_beyond_floating_point_is_infinite() -> None:
    out = LAWS["Holzapfel-Gasser-Ogden, k = 10 MPa"].response(np.array([30.0, 30.0, 0.0]))
    assert out.energy == np.inf
    assert not out.stress.any()


def test_crushed_auxetic_sheet_has_no_answer() -> None:
    law, crushed = NeoHookean(1e6, -0.3), np.array([-0.45, -0.45, 0.0])
    assert law.response(crushed).energy == np.inf
    assert np.isnan(volume_ratio(law, crushed))


@pytest.mark.parametrize("k", [1e3, 1e6, 1e9, 1e15])
def test_any_bulk_modulus_converges(k: float) -> None:
    strain = np.array([[2.0, 2.0, 0.0], [-0.45, -0.45, 0.0], [3.0, -0.49, 0.1], [0.05, 0, 0]])
    assert np.isfinite(replace(TENDON, k=k).response(strain).energy).all()


def test_fibre_that_yields_converges() -> None:
    """Stiff up to lam_max and soft beyond, with little bulk modulus: plain Newton cycles, and an
    unlimited step leaves the numbers."""
    law = TransIsoMooneyRivlin(1e3, 0.0, 5e5, 60.0, 0.0, 1.1, 1e4)
    strain = strains(500, 3.0) + np.array([1.2, 1.2, 0.0])
    C11, C22, C12 = 1 + 2 * strain[:, 0], 1 + 2 * strain[:, 1], strain[:, 2]
    admissible = (C11 > 0) & (C11 * C22 > C12**2)
    assert np.array_equal(np.isfinite(law.response(strain).energy), admissible)
    assert admissible.sum() > 400


@pytest.mark.parametrize("name", ["neo-Hookean", "Holzapfel-Gasser-Ogden, k = 10 MPa"])
def test_more_bulk_modulus_leads_to_no_change_of_volume(name: str) -> None:
    law = LAWS[name]
    assert isinstance(law, NeoHookean | HolzapfelGasserOgden)
    stiff = (
        replace(law, nu=0.5 - 1e-9) if isinstance(law, NeoHookean) else replace(law, k=1e9 * law.c)
    )
    assert np.abs(volume_ratio(stiff, strains(50)) - 1).max() < 1e-7


def test_compressible_fibre_laws_approach_the_incompressible() -> None:
    points = strains(50)
    for law in (TENDON, LAWS["Holzapfel-Gasser-Ogden, incompressible"]):
        exact = law.response(points)
        near = [replace(law, k=k).response(points) for k in (1e12, 1e14)]
        errors = [np.abs(n.stress - exact.stress).max() for n in near]
        scale = np.abs(exact.stress).max()
        assert errors[0] < 1e-3 * scale
        assert errors[1] == pytest.approx(errors[0] / 100, rel=0.01)


def test_fibre_energy_is_the_integral_of_its_tension() -> None:
    """Over the toe, across lam_max and beyond it; nothing in compression."""
    for stretch in (1.001, 1.01, 1.029999, 1.03, 1.2):
        exact = quad(
            lambda s: fibre_tension(TENDON, s) / s,
            1,
            stretch,
            points=[min(1.03, stretch)],
            epsabs=0,
            epsrel=1e-12,
        )[0]
        assert TENDON.fibre_energy(np.array(stretch)) == pytest.approx(exact, rel=1e-9)
    assert TENDON.fibre_energy(np.array(0.9)) == 0
    assert TENDON.tension(np.array(0.9)) == (0, 0)


def test_fibre_energy_is_continuous() -> None:
    for at in (1.0, 1.03):
        below, above = TENDON.fibre_energy(np.array([at - 1e-9, at + 1e-9]))
        assert above == pytest.approx(below, abs=1e-8 * 5e6)
    below, above = TENDON.tension(np.array([1.03 - 1e-9, 1.03 + 1e-9]))[0]
    assert above == pytest.approx(below, rel=1e-6)


def test_energies_of_fibres_have_no_noise() -> None:
    """A search for the least energy compares energies whose difference is far below each: what
    cancels in them would be noise in it.  They rise with the force, and squares of small strains
    are left."""
    for law, first, last, most in (
        (TransIsoMooneyRivlin(1e4, 1.0, 1e3, 31.6, 1e8, 1.0316), 0.0322, 0.035, 1e-9),
        (HolzapfelGasserOgden(1e-6, 1e8, 0.2, 0.0, 0.0), 0.0, 1e-7, 1e-14),
    ):
        strain = np.zeros((1, 1000, 8))
        strain[..., 0] = np.linspace(first, last, 1000)
        energy, force, _ = one_law(law, np.ones((1, 1000))).response(strain)
        mean = (force[0, 1:, 0] + force[0, :-1, 0]) / 2
        rises = np.diff(energy[0]) - mean * np.diff(strain[0, :, 0])
        assert np.abs(rises).max() < most  # J/m2 of c5 and k1 of 1e8 J/m2


def test_fibres_hold_at_rest_and_slacken_in_compression() -> None:
    for law, fibre in (
        (TENDON, float(TENDON.c3) * float(TENDON.c4)),
        (HolzapfelGasserOgden(1e4, 1e6, 1.0, 0.0, 0.0), 8 * 1e6),
    ):
        rest, pressed = law.response(np.array([[0, 0, 0], [-1e-6, 5e-7, 0.0]])).tangent
        assert rest[0, 0] - pressed[0, 0] == pytest.approx(fibre, rel=1e-4)


@pytest.mark.parametrize("name", [*LAWS, *MORE])
def test_parameters_by_element(name: str) -> None:
    """A value per element (k, 1) at strains (layers, k, 4, 3) is each element's own law."""
    law = (LAWS | MORE)[name]
    points = strains(2 * 3 * 4).reshape(2, 3, 4, 3)
    base = law.base if isinstance(law, TensionField) else law
    scales = (1.0, 1.1, 1.3)
    stiffness = next(iter(vars(base)))
    value = getattr(base, stiffness)

    def scaled(by: float | np.ndarray) -> Law:
        changed = replace(base, **{stiffness: value * by})
        return replace(law, base=changed) if isinstance(law, TensionField) else changed

    out = scaled(np.array(scales)[:, None]).response(points)
    assert out.tangent.shape == (2, 3, 4, 3, 3)
    for n, scale in enumerate(scales):
        alone = scaled(scale).response(points[:, n])
        for ours, other in zip(out, alone, strict=True):
            np.testing.assert_allclose(
                ours[:, n], other, rtol=1e-12, atol=1e-12 * np.abs(other).max()
            )


@pytest.mark.parametrize("name", ["isotropic", "neo-Hookean", "tension field, isotropic"])
@given(angle=st.floats(0, math.pi))
@settings(max_examples=20)
def test_isotropic_laws_know_no_axes(name: str, angle: float) -> None:
    law = LAWS[name]
    for strain in strains(5, 0.3):
        plain = law.response(strain)
        stress, tangent = rotate(law, strain, axes(angle))
        np.testing.assert_allclose(stress, plain.stress, atol=1e-11 * np.abs(plain.tangent).max())
        np.testing.assert_allclose(tangent, plain.tangent, atol=1e-8 * plain.tangent.max())


def test_full_dispersion_is_isotropic() -> None:
    law = MORE["dispersed to isotropy"]
    strain = np.array([0.1, -0.02, 0.05])
    stress, _ = rotate(law, strain, axes(0.7))
    np.testing.assert_allclose(stress, law.response(strain).stress, rtol=1e-12)


def test_families_mirror_and_merge() -> None:
    law = HolzapfelGasserOgden(1e4, 1e5, 2.0, 0.1, 0.5, 1e6)
    strain = np.array([0.1, 0.05, 0.08])
    mirrored = law.response(strain * [1, 1, -1])
    np.testing.assert_allclose(mirrored.stress, law.response(strain).stress * [1, 1, -1])
    across = replace(law, gamma=math.pi / 2)
    swapped = replace(law, gamma=0.0).response(strain[[1, 0, 2]]).stress[[1, 0, 2]]
    np.testing.assert_allclose(across.response(strain).stress, swapped, rtol=1e-9)


@pytest.mark.parametrize("trial", range(30))
def test_tension_field_of_any_orthotropic_sheet(trial: int) -> None:
    """Against every direction, for moduli that differ by up to a thousand and any shear modulus."""
    rng = np.random.default_rng(trial)
    E1, E2 = 10 ** rng.uniform(0, 3, 2)
    G = np.sqrt(E1 * E2) * 10 ** rng.uniform(-2.5, 1.5)
    base = Orthotropic(E1, E2, rng.uniform(-0.95, 0.95) * np.sqrt(E1 / E2), G, G, G)
    points = rng.uniform(-1, 1, (10, 3)) / np.sqrt([E1, E2, min(G, np.sqrt(E1 * E2))])
    ours = TensionField(base).response(points).energy
    brute = np.array([relaxed_energy(base, e) for e in points])
    np.testing.assert_allclose(ours, brute, rtol=1e-4, atol=1e-5 * brute.max())


EVERY_BASE = {
    name: law
    for name, law in LAWS.items()
    if not isinstance(law, TensionField) and name != "transversely isotropic"
}


@pytest.mark.parametrize("name", EVERY_BASE)
def test_a_tension_field_is_in_tension_below_its_law(name: str) -> None:
    """Where it is taut it is the law, and nowhere is its energy or its stress more; convex."""
    base = EVERY_BASE[name]
    points = strains(500, 0.3) - 0.05
    full, law = base.response(points), TensionField(base)
    out, state = law.response(points), law.state(points)
    assert set(state) == set(State)
    assert (_least_stress(out.stress) >= -1e-5 * np.abs(full.tangent).max(axis=(1, 2))).all()
    assert (out.energy <= full.energy + 1e-9 * full.tangent.max()).all()
    assert (np.linalg.eigvalsh(out.tangent).min(axis=1) >= -1e-9 * full.tangent.max()).all()
    slack = state == State.SLACK
    assert np.abs(out.stress[slack]).max() < 1e-5 * full.tangent.max()
    scale = np.abs(full.stress).max(axis=1)
    firm = (state == State.TAUT) & (_least_stress(full.stress) > 0.05 * scale)
    assert firm.sum() > 10
    assert np.abs(out.stress - full.stress)[firm].max() < 1e-4 * scale[firm].max()


def _least_stress(stress: np.ndarray) -> np.ndarray:
    S1, S2, S12 = stress.T
    return np.asarray((S1 + S2) / 2 - np.hypot((S1 - S2) / 2, S12))


@pytest.mark.parametrize("name", EVERY_BASE)
def test_wrinkles_leave_the_stress_of_a_strip(name: str) -> None:
    """A sheet that is pulled along an axis and pressed together across it bears what a strip does,
    which is free to contract."""
    base, law, e = EVERY_BASE[name], TensionField(EVERY_BASE[name]), 0.05
    strip = pull_uniaxially(base, e)[1]
    pressed = law.response(np.array([e, -0.3, 0.0])).stress
    np.testing.assert_allclose(pressed, strip, rtol=1e-3, atol=1e-3 * strip[0])


def test_a_slack_sheet_keeps_the_residual_of_its_lesser_modulus() -> None:
    law, modulus = TensionField(ORTHOTROPIC), ORTHOTROPIC.plane()[1, 1]
    slack = np.array([-0.1, -0.2, 0.01])
    out = law.response(slack)
    np.testing.assert_allclose(out.stress[:2], RESIDUAL * modulus * slack[:2], rtol=1e-3)
    np.testing.assert_allclose(
        np.diag(out.tangent), RESIDUAL * modulus * np.array([1, 1, 0.5]), rtol=1e-2
    )


@pytest.mark.parametrize(("pressed", "state"), [(1e-5, State.TAUT), (2e-4, State.WRINKLED)])
def test_what_the_smoothing_alone_makes_is_no_wrinkle(pressed: float, state: State) -> None:
    """Ten times the smoothing is not told of, two hundred times is."""
    law = TensionField(Isotropic(1e8, 0.0))
    assert law.smoothing == 1e-6
    assert law.state(np.array([0.01, -pressed, 0.0])) == state


def test_a_wrinkle_that_is_not_found_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Newton takes a point without an answer for crushed, and goes no step to it."""
    strain = np.array([0.01, -0.02, 0.0])
    assert np.isfinite(TensionField(ORTHOTROPIC).response(strain).energy)
    for steps in ("FEW_STEPS", "MOST_STEPS"):
        monkeypatch.setattr(wrinkle_search, steps, 0)
    out = TensionField(ORTHOTROPIC).response(strain)
    assert out.energy == np.inf
    assert not out.stress.any()


def test_a_crushed_sheet_has_an_answer() -> None:
    """To a thousandth of its area, and of every law whose own stress there is beyond all bounds."""
    C = np.diag([1.2, 1e-6])
    strain = np.array([(C[0, 0] - 1) / 2, (C[1, 1] - 1) / 2, 0.0])
    for base in EVERY_BASE.values():
        assert np.isfinite(TensionField(base).response(strain).energy)


def test_parameters_by_point_are_each_points_own() -> None:
    """Within a law of two families too, in strains of all three states."""
    points = strains(24, 0.3).reshape(4, 6, 3) - 0.05
    angles = np.linspace(0.2, 0.9, 24).reshape(4, 6)
    base = replace(TENDON, c1=np.linspace(1e6, 3e6, 4)[:, None])
    family = ExponentialFamily(1e5, 40.0, 3e7, 1.03)
    out = TensionField(CrossedFibres(base, family, angles)).response(points)
    for i in range(4):
        for g in range(6):
            own = CrossedFibres(replace(TENDON, c1=base.c1[i, 0]), family, angles[i, g])
            alone = TensionField(own).response(points[i, g])
            np.testing.assert_allclose(out.stress[i, g], alone.stress, rtol=1e-9, atol=1e-3)


def test_tension_field_leaves_its_base_as_it_was() -> None:
    points = strains(20) - 0.05
    before = points.copy()
    TensionField(ORTHOTROPIC).response(points)
    np.testing.assert_array_equal(points, before)


def test_transverse_shear_of_a_transversely_isotropic_sheet() -> None:
    law = Orthotropic.transversely_isotropic(150e6, 20e6, 0.3, 8e6, 0.4)
    assert law.shear() == (8e6, pytest.approx(20e6 / 2.8))
    assert TensionField(law).shear() == law.shear()


def test_transverse_shear_of_fibre_laws_is_the_matrix() -> None:
    assert TENDON.shear() == (5.4e6, 5.4e6)
    assert LAWS["Holzapfel-Gasser-Ogden, incompressible"].shear() == (0.08e6, 0.08e6)


def test_small_strain_moduli() -> None:
    """Every law's tangent at rest is the linear one of its moduli."""
    rubber = NeoHookean(1e6, 0.3).response(np.zeros(3)).tangent
    np.testing.assert_allclose(rubber, Isotropic(1e6, 0.3).plane(), rtol=1e-12, atol=1e-6)
    soft = TransIsoMooneyRivlin(2e5, 1e5, 0.0, 60.0, 0.0, 1.03, 1e6)
    bulk, G = 1e6, 2 * 3e5
    E = 9 * bulk * G / (3 * bulk + G)
    expected = Isotropic(E, E / (2 * G) - 1).plane()
    np.testing.assert_allclose(soft.response(np.zeros(3)).tangent, expected, rtol=1e-12, atol=1e-6)
    assert soft.shear() == (G, G)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: Isotropic(-1.0, 0.3), r"Isotropic: E = -1 "),
        (lambda: Isotropic(math.inf, 0.3), r"E = inf"),
        (lambda: Isotropic(1.0, 0.5), r"nu = 0.5 .*between -1 and 0.5"),
        (lambda: Isotropic(1.0, math.nan), r"nu = nan"),
        (lambda: Isotropic(np.array([1.0, 0.0, 2.0]), 0.3), r"E = 0 "),
        (lambda: Orthotropic(1.0, 4.0, 0.5, 1.0, 1.0, 1.0), r"nu12 = 0.5 .*positive definite"),
        (lambda: Orthotropic(1.0, 4.0, 0.3, 1.0, 0.0, 1.0), r"G13 = 0 "),
        (
            lambda: Orthotropic.transversely_isotropic(1.0, 1.0, 0.6, 1.0, 0.4),
            r"nu23 = 0.4 .*solid",
        ),
        (lambda: NeoHookean(1.0, -1.0), r"nu = -1"),
        (lambda: replace(TENDON, lam_max=1.0), r"lam_max = 1 .*exceed 1"),
        (lambda: replace(TENDON, c3=-1.0), r"c3 = -1"),
        (lambda: replace(TENDON, c4=0.0), r"c4 = 0"),
        (lambda: replace(TENDON, c4=690.0), r"c4 = 690 .*below 700"),
        (lambda: replace(TENDON, c1=0.0, c2=0.0), r"c1 = 0 .*matrix"),
        (lambda: replace(TENDON, k=0.0), r"k = 0 "),
        (lambda: replace(TENDON, k=np.array([1.0, math.inf])), r"all elements alike"),
        (lambda: HolzapfelGasserOgden(1.0, 1.0, 1.0, 0.34, 0.0), r"kappa = 0.34 .*1/3"),
        (lambda: HolzapfelGasserOgden(1.0, 1.0, 0.0, 0.1, 0.0), r"k2 = 0"),
        (lambda: HolzapfelGasserOgden(1.0, 1.0, 1.0, 0.1, math.nan), r"gamma = nan"),
        (lambda: TensionField(ORTHOTROPIC, 0.0), r"smoothing = 0 .*above 0"),
    ],
)
def test_impossible_parameters_are_refused(make, told: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match=told):
        make()


def test_uniaxial_answers_do_not_depend_on_the_unit() -> None:
    law = TransIsoMooneyRivlin(2.0, 0.7, 0.5, 60.0, 900.0, 1.03, 200.0)
    soft = material_rows.SOFT_TENDON
    assert uniaxial(law, 1.05)[0] * 1e6 == pytest.approx(uniaxial(soft, 1.05)[0], rel=1e-12)
