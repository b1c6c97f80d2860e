"""The compiled form of the materials, held to their numpy form."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.special import expi

from cosim.port import Array
from fe_solver.elements import kernels
from fe_solver.materials.crossed_fibres import CrossedFibres, CrossedLinear
from fe_solver.materials.fibres import (
    DispersedFamily,
    ExponentialFamily,
    HolzapfelGasserOgden,
    TransIsoMooneyRivlin,
)
from fe_solver.materials.hyperelastic import NeoHookean
from fe_solver.materials.kernels import ASYMPTOTIC, _scaled_expi
from fe_solver.materials.linear import Isotropic, Law, Orthotropic, Stress
from fe_solver.materials.section import Patch, Resultants, Section, join_sections
from fe_solver.materials.tension_field import State, TensionField

compiled = pytest.mark.skipif(not kernels.COMPILED, reason="compiled kernels are switched off")
THICK = 1e-3
UNITS = np.array([1, 1, 1, 2 / THICK, 2 / THICK, 2 / THICK, 1, 1])
"""Generalized strains of a strain of one."""


def positive(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(np.log10(low), np.log10(high)).map(lambda x: float(10**x))


def numbers(low: float, high: float) -> st.SearchStrategy[float | Array]:
    """One for all, one for each of three elements, or for each of four points of each."""
    one = positive(low, high)
    return st.one_of(
        one,
        st.lists(one, min_size=3, max_size=3).map(lambda x: np.array(x)[:, None]),
        st.lists(one, min_size=12, max_size=12).map(lambda x: np.array(x).reshape(3, 4)),
    )


ANGLES = st.floats(-np.pi / 2, np.pi / 2)
BULK = st.one_of(st.just(np.inf), positive(1e4, 1e9))


def toe(kind: Any, *given: Any, k: float | None = None) -> Any:
    """A law with an exponential toe: c3, c4 (lam_max - 1), c5 and lam_max - 1 come last."""
    *first, c3, rise, c5, length = given
    more = () if k is None else (k,)
    return kind(*first, c3, rise / length, c5, 1 + length, *more)


TOE = (numbers(1e3, 1e6), positive(0.5, 10), positive(1e5, 1e9), positive(0.02, 0.2))
DISPERSED = (numbers(1e3, 1e6), positive(0.1, 10), st.floats(0, 1 / 3))
ONE_FAMILY = st.one_of(
    st.builds(
        toe, st.just(TransIsoMooneyRivlin), numbers(1e4, 1e7), positive(1, 1e6), *TOE, k=BULK
    ),
    st.builds(HolzapfelGasserOgden, numbers(1e4, 1e6), *DISPERSED, ANGLES, BULK),
)
FAMILY = st.one_of(
    st.builds(toe, st.just(ExponentialFamily), *TOE), st.builds(DispersedFamily, *DISPERSED)
)
CURVED = st.one_of(
    st.builds(NeoHookean, numbers(1e4, 1e8), st.floats(-0.3, 0.4999)),
    ONE_FAMILY,
    st.builds(CrossedFibres, ONE_FAMILY, FAMILY, ANGLES),
)
ORTHOTROPIC = st.builds(
    Orthotropic, numbers(1e7, 1e8), positive(1e6, 1e7), st.floats(0, 0.9), *[positive(1e5, 1e7)] * 3
)
STRAIGHT = st.one_of(
    st.builds(Isotropic, numbers(1e5, 1e8), st.floats(0, 0.49)),
    ORTHOTROPIC,
    st.builds(CrossedLinear, ORTHOTROPIC, positive(1e5, 1e8), ANGLES),
)


def sheet(law: Law | TensionField, seed: int, sliding: bool = False) -> Section:
    """Three elements of a law, with bending moduli and factors."""
    rng = np.random.default_rng(seed)
    thickness, factor = THICK * rng.uniform(0.5, 1, (3, 4)), rng.uniform(0.5, 1.5, (3, 1))
    bending = np.diag(rng.uniform(0, 1e6, 3))
    return join_sections([Patch(np.arange(3), law, thickness, factor, bending, sliding=sliding)])


def strains(seed: int, size: float, count: int = 3) -> Array:
    """Strains (count, 4, 8) of membrane, bending and shear."""
    rng = np.random.default_rng(seed)
    return UNITS * rng.uniform(-size, size, (count, 4, 8))


def errors(ours: Resultants, exact: Resultants) -> list[float]:
    """The largest errors of energy, force and stiffness over the stiffness of their element; what
    has no answer has none in both."""
    fine = np.isfinite(exact.energy)
    assert np.array_equal(np.isfinite(ours.energy), fine)
    assert not np.isnan(ours.energy).any()
    scaled = exact.stiffness * UNITS[:, None] * UNITS
    scale = np.abs(scaled).max(axis=(1, 2, 3))
    energy = np.where(fine, ours.energy - np.where(fine, exact.energy, 0), 0)
    force = (ours.force - exact.force) * UNITS
    stiffness = ours.stiffness * UNITS[:, None] * UNITS - scaled
    gaps = [np.abs(x).reshape(len(x), -1).max(axis=1) for x in (energy, force, stiffness)]
    return [float(np.max(gap / scale)) for gap in gaps]


@compiled
@given(CURVED, st.integers(0, 99), positive(1e-4, 1), st.booleans())
@settings(max_examples=100)
def test_hyperelastic_laws_answer_as_in_numpy(
    law: Law, seed: int, size: float, sliding: bool
) -> None:
    section, strain = sheet(law, seed, sliding), strains(seed, size)
    ours, exact = section.response(strain), section.respond_in_numpy(strain)
    assert max(errors(ours, exact)) < 1e-12  # examples were found at 1.6e-13


@compiled
@given(st.one_of(STRAIGHT, CURVED), st.integers(0, 99), positive(1e-4, 0.5), positive(1e-6, 1e-2))
@example(toe(TransIsoMooneyRivlin, 1e4, 1.0, 1e3, 1.0, 1e8, 10**-1.5, k=np.inf), 1, 0.1, 1e-6)
@settings(max_examples=100)
def test_tension_fields_answer_as_in_numpy(
    base: Law, seed: int, size: float, smoothing: float
) -> None:
    """To what Newton's last step leaves of the wrinkles; the tangent turns within the smoothing."""
    section, strain = sheet(TensionField(base, smoothing), seed), strains(seed, size)
    ours, exact = section.response(strain), section.respond_in_numpy(strain)
    energy, force, stiffness = errors(ours, exact)
    assert max(energy, force, smoothing * stiffness) < 1e-12


@compiled
@pytest.mark.parametrize("base", [Isotropic(1e6, 0.3), NeoHookean(1e6, 0.3)])
def test_a_tension_field_answers_in_all_its_states(base: Law) -> None:
    strain = np.zeros((3, 4, 8))
    strain[0, :, :2], strain[1, :, :2], strain[2, :, :2] = 0.02, [0.02, -0.05], -0.03
    section = sheet(TensionField(base), 1)
    assert list(section.tension_state(strain)) == [State.TAUT, State.WRINKLED, State.SLACK]
    assert max(errors(section.response(strain), section.respond_in_numpy(strain))) < 1e-13


@compiled
@pytest.mark.parametrize("relaxed", [False, True])
@pytest.mark.parametrize("k", [np.inf, 1e6])
def test_what_is_no_strain_has_infinite_energy_and_no_force(k: float, relaxed: bool) -> None:
    law: Law | TensionField = TransIsoMooneyRivlin(1e5, 0.0, 1e5, 40.0, 1e7, 1.05, k)
    section = sheet(TensionField(law) if relaxed else law, 0)
    strain = np.zeros((3, 4, 8))
    folded, crossed, broken, steep = strain.reshape(12, 8)[:4]
    folded[0], crossed[2], broken[0], steep[6] = -0.6, 1.5, np.nan, 1.1
    with np.errstate(invalid="ignore"):
        ours, exact = section.response(strain), section.respond_in_numpy(strain)
    assert list(np.isfinite(ours.energy[0])) == [False] * 4
    assert np.isfinite(ours.energy[1:]).all()
    assert np.array_equal(ours.energy == np.inf, exact.energy == np.inf)
    np.testing.assert_allclose(ours.force, exact.force, rtol=1e-9, atol=1e-9, equal_nan=True)
    if not relaxed:
        np.testing.assert_array_equal(ours.force[0, [0, 1]], np.zeros((2, 8)))


@compiled
def test_any_number_of_threads_gives_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    law = TransIsoMooneyRivlin(1e5, 1e3, 1e5, 40.0, 1e7, 1.05, 1e8)
    patches = [Patch(np.arange(0, 50), law, np.full((50, 4), THICK))]
    patches += [Patch(np.arange(50, 100), TensionField(law), np.full((50, 4), THICK))]
    section, strain = join_sections(patches), strains(3, 0.05, 100)
    alone = section.response(strain)
    monkeypatch.setenv("FE_SOLVER_THREADS", "3")
    monkeypatch.setattr(kernels, "PAYS", 1)
    for one, other in zip(alone, section.response(strain), strict=True):
        assert np.array_equal(one, other)


@dataclass(frozen=True)
class Doubled:
    """A law of somebody's own."""

    base: Law

    def response(self, strain: Array) -> Stress:
        return Stress(*(2 * x for x in self.base.response(strain)))

    def shear(self) -> tuple[float, float]:
        return 1e6, 1e6


@dataclass(frozen=True)
class Softer(NeoHookean):
    """A law derived from one of ours, which answers otherwise."""

    def response(self, strain: Array) -> Stress:
        return Stress(*(x / 2 for x in super().response(strain)))


@pytest.mark.parametrize("relaxed", [False, True])
def test_laws_of_ones_own_answer_beside_ours(relaxed: bool) -> None:
    rubber, strain = NeoHookean(1e6, 0.3), strains(5, 0.03, 1)[[0, 0, 0]]
    strain[..., 6:] = 0.0
    for own, times in ((Doubled(rubber), 2.0), (Softer(1e6, 0.3), 0.5)):
        laws: list[Law | TensionField] = [own, rubber, Isotropic(1e6, 0.3)]
        if relaxed:
            laws = [TensionField(law) for law in laws]
        one = np.full((1, 4), THICK)
        section = join_sections([Patch(np.array([i]), law, one) for i, law in enumerate(laws)])
        ours = section.response(strain)
        assert max(errors(ours, section.respond_in_numpy(strain))) < 1e-13
        force = ours.force[..., :3]
        np.testing.assert_allclose(force[0], times * force[1], rtol=1e-6, atol=1e-9)


def test_the_fibre_energy_needs_no_exponential_integral_of_scipys() -> None:
    integral = getattr(_scaled_expi, "function", _scaled_expi)
    x = np.concatenate([np.geomspace(0.01, 700, 300), ASYMPTOTIC * np.array([1 - 1e-15, 1])])
    ours = np.array([integral(float(v)) for v in x])
    np.testing.assert_allclose(ours, np.exp(-x) * expi(x), rtol=2e-13, atol=1e-15)


def test_a_smoother_tension_field_is_a_section_of_its_own() -> None:
    """The kernel's numbers are those of the new section, not what was gathered of the old one."""
    section, strain = sheet(TensionField(Isotropic(1e6, 0.3)), 2), strains(2, 0.01)
    before = section.response(strain)
    smoother = section.with_smoothing(1e-3).response(strain)
    assert not np.array_equal(before.energy, smoother.energy)
    law = replace(section.patches[0], law=TensionField(Isotropic(1e6, 0.3), 1e-3))
    assert np.array_equal(join_sections([law]).response(strain).energy, smoother.energy)
