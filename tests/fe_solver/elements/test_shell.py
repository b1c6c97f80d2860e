"""The shell element: invariance, derivatives, growth and fields; the rest of it is verified by
`tests/proofs/fe`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.port import rotation_matrix
from fe_solver.elements import kernels
from fe_solver.elements.mitc4 import CORNERS, GAUSS, shape
from fe_solver.elements.mitc9 import NINE
from fe_solver.elements.shell import (
    Array,
    ShellTables,
    element_blocks,
    element_response,
    shell_tables,
)
from fe_solver.materials.hyperelastic import NeoHookean
from fe_solver.materials.linear import Isotropic
from fe_solver.materials.section import Section, one_law
from fe_solver.materials.tension_field import TensionField
from fe_solver.solver.body_coupling import wrenches
from fe_solver.solver.fields import energy_fields, fields
from fe_solver.solver.model import Configuration
from fe_solver.solver.newton import solve
from tests.helpers import shells
from tests.proofs.fe import sheets
from tests.proofs.fe.sheets import (
    BENCHMARK,
    NO_TENSION,
    at_rest,
    clamp,
    guide,
    linear_response,
    mirror_plane,
    plate,
    sheet,
)

VECTORS = st.tuples(*[st.floats(-3, 3)] * 3).map(np.array)
SHAPES = {
    "square": (0.0, 0.0),
    "skew flat": (0.25, 0.0),
    "warped": (0.25, 0.3),
    "tri": (0.25, 0.3),
    "nine nodes": (0.1, 0.1),
}
"""Random distortion of the nodes in the plane and out of it."""


def element(name: str, growth: float = 0.0) -> tuple[ShellTables, Section, Array]:
    """Tables, section and reference y (1, 2k, 3) of one element of about unit size."""
    rng = np.random.default_rng(3)
    flat, high = SHAPES[name]
    nodes = NINE.nodes if name == "nine nodes" else CORNERS
    k = len(nodes)
    X = np.column_stack([nodes / 2, np.zeros(k)]) + rng.uniform(-1, 1, (k, 3)) * [flat, flat, high]
    D = np.array([0.0, 0, 1]) + high * rng.uniform(-1, 1, (k, 3))
    D /= np.linalg.norm(D, axis=1, keepdims=True)
    if name == "tri":
        X[3], D[3] = X[2], D[2]
    tables = shell_tables(X[None], D[None], np.array([[1.0, 0.4, 0.0]]), np.array([growth]))
    return tables, one_law(Isotropic(1.0, 0.3), np.full((1, k), 0.2)), np.vstack([X, D])[None]


def arc(X: Array, angle: float, length: float) -> Configuration:
    """A strip along x rolled onto an arc that turns by `angle` (rad), towards +z."""
    radius, turn = length / angle, X[:, 0] / length * angle
    x = np.column_stack([radius * np.sin(turn), X[:, 1], radius * (1 - np.cos(turn))])
    d = np.column_stack([-np.sin(turn), 0 * turn, np.cos(turn)])
    return Configuration(x, d, *sheets.GROUND)


def derivative(f, y, direction, step=0.1):
    """Along a direction, exact for polynomials up to the fourth degree: the energy is one."""
    at = [np.asarray(f(y + k * step * direction)) for k in (-2, -1, 1, 2)]
    return (at[0] - 8 * at[1] + 8 * at[2] - at[3]) / (12 * step)


@given(VECTORS, VECTORS, st.sampled_from(sorted(SHAPES)))
def test_a_rigid_motion_costs_nothing(turn, shift, name):
    tables, section, y = element(name)
    moved = y @ rotation_matrix(turn).T
    moved[:, : y.shape[1] // 2] += shift
    response = element_response(tables, section, moved)
    assert response.energy < 1e-24
    assert np.abs(response.gradient).max() < 1e-13


@pytest.mark.parametrize("name", ["warped", "nine nodes"])
def test_strains_do_not_see_how_far_away_an_element_is(name):
    """Their rounding errors are those of its own lengths: without that a fine mesh of the hood came
    no nearer to equilibrium than some 1e-8 of its forces."""
    tables, _, y = element(name)
    k = y.shape[1] // 2
    moved = y + 0.01 * np.random.default_rng(6).normal(size=y.shape)
    moved[:, :k] = np.round(moved[:, :k] * 2**20) / 2**20
    away = moved.copy()
    away[:, :k] += 2.0**20
    assert np.array_equal(tables.strain(away), tables.strain(moved))


LAWS = {
    "linear": Isotropic(1.0, 0.3),
    "neo-Hookean": NeoHookean(1.0, 0.3),
    "wrinkling": TensionField(Isotropic(1.0, 0.3), 1e-2),
}


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    ("name", "growth"), [("warped", 0.2), ("skew flat", 0.0), ("tri", 0.1), ("nine nodes", 0.2)]
)
def test_gradient_and_tangent_are_the_energys(name, growth, law, compiled, monkeypatch):
    """In nodal bases that are no rotations of the world's, with nodes off the mid-surface."""
    monkeypatch.setattr(kernels, "COMPILED", compiled and kernels.COMPILED)
    tables, _, y = element(name, growth)
    k = y.shape[1] // 2
    section = one_law(LAWS[law], np.full((1, k), 0.2))
    rng = np.random.default_rng(4)
    tables = replace(tables, height=rng.normal(size=(1, k)) / 10)
    y = y + (0.1 if k == 4 else 0.03) * rng.normal(size=y.shape)  # nearer to each other
    bases = rng.normal(size=(1, k, 3, 3)), rng.normal(size=(1, k, 3, 2))
    here = element_response(tables, section, y)
    blocks = element_blocks(tables, here, bases)

    def at(moved):
        return element_response(tables, section, moved)

    assert np.array_equal(here.gradient, at(y).gradient)
    assert np.array_equal(blocks, np.swapaxes(blocks, 1, 2))
    for u in rng.normal(size=(3, k, 5)):
        dx = np.einsum("aij,aj->ai", bases[0][0], u[:, :3])
        dd = np.einsum("aij,aj->ai", bases[1][0], u[:, 3:])
        step = 1e-3 * np.concatenate([dx, dd])[None]
        slope = derivative(lambda moved: at(moved).energy, y, step)
        assert np.vdot(here.gradient, step) == pytest.approx(slope, rel=1e-7)
        change = derivative(lambda moved: at(moved).gradient, y, step)[0]
        seen = np.concatenate(
            [
                np.einsum("aij,ai->aj", bases[0][0], change[:k]),
                np.einsum("aij,ai->aj", bases[1][0], change[k:]),
            ],
            axis=1,
        ).ravel()
        product = 1e-3 * blocks[0] @ u.ravel()
        assert product == pytest.approx(seen, abs=1e-6 * np.abs(seen).max())


@pytest.mark.skipif(not kernels.COMPILED, reason="numba is not installed")
def test_the_compiled_kernels_do_what_numpy_does(monkeypatch):
    model = shells.index_hood().model
    c = sheets.disturb(model, 1e-3, seed=1)
    compiled = model.evaluate(c, np.ones(4), tangent=True)
    monkeypatch.setenv("FE_SOLVER_THREADS", "2")
    monkeypatch.setattr(kernels, "PAYS", 1)
    assert np.array_equal(model.evaluate(c, np.ones(4), True).data, compiled.data)
    monkeypatch.setattr(kernels, "COMPILED", False)
    plain = model.evaluate(c, np.ones(4), tangent=True)
    assert plain.reduced == pytest.approx(compiled.reduced, abs=1e-12 * np.abs(plain.reduced).max())
    assert plain.data == pytest.approx(compiled.data, abs=1e-13 * np.abs(plain.data).max())


@given(VECTORS, st.sampled_from(sorted(SHAPES)))
def test_the_frame_plays_no_part(turn, name):
    """Mesh, fibres and deformation turned together: the same energy, the forces turned."""
    tables, section, y = element(name, growth=0.1)
    R = rotation_matrix(turn)
    X, D = np.split(y, 2, axis=1)
    turned = shell_tables(X @ R.T, D @ R.T, np.array([[1.0, 0.4, 0.0]]) @ R.T, np.array([0.1]))
    moved = y + 0.2 * np.random.default_rng(5).normal(size=y.shape)
    one = element_response(tables, section, moved)
    other = element_response(turned, section, moved @ R.T)
    assert other.energy == pytest.approx(one.energy, rel=1e-12)
    assert other.gradient == pytest.approx(one.gradient @ R.T, abs=1e-13)
    assert turned.strain(moved @ R.T) == pytest.approx(tables.strain(moved), abs=1e-13)


def membrane_of(tables, y, u):
    """(4, 3) membrane strain at the Gauss points of a flat element by small displacements u (4, 2),
    and the frames (4, 2, 2) that it refers to."""
    moved = np.zeros_like(y)
    moved[0, :4, :2] = u
    return derivative(tables.strain, y, moved)[0, :, :3], tables.frame[0, :, :2, :2]


def tensor(strain):
    """(..., 2, 2) of (..., 3) components 11, 22 and twice 12."""
    e1, e2, shear = np.moveaxis(strain, -1, 0)
    return np.moveaxis(np.array([[e1, shear / 2], [shear / 2, e2]]), (0, 1), (-2, -1))


def test_a_flat_element_can_be_bilinear():
    """Ko, Lee and Bathe 2017: MITC4+ leaves a flat element as it is."""
    y, fibre = element("skew flat")[2], np.array([[1.0, 0.4, 0.0]])
    tables = shell_tables(y[:, :4], y[:, 4:], fibre, np.zeros(1), bilinear=True)
    X, u = y[0, :4, :2], np.random.default_rng(6).normal(size=(4, 2))
    strain, frames = membrane_of(tables, y, u)
    for g, (r, s) in enumerate(GAUSS):
        slopes = np.linalg.solve(np.stack(shape(r, s)[1:]) @ X, np.stack(shape(r, s)[1:])) @ u
        expected = frames[g] @ (slopes + slopes.T) / 2 @ frames[g].T
        assert tensor(strain[g]) == pytest.approx(expected, abs=1e-13)


def test_of_a_flat_elements_strain_two_fields_vary():
    """Its mean is the bilinear strain's; about it varies, along the centre's base vectors, what
    Pian and Sumihara assume of the stress; the bilinear strain's work on those fields is kept."""
    y, fibre = element("skew flat")[2], np.array([[1.0, 0.4, 0.0]])
    u = np.random.default_rng(6).normal(size=(4, 2))
    free, bilinear = (
        shell_tables(y[:, :4], y[:, 4:], fibre, np.zeros(1), bilinear=b) for b in (False, True)
    )
    share = free.weight[0] / free.weight.sum()
    (own, frames), (other, _) = (membrane_of(t, y, u) for t in (free, bilinear))
    world = [np.swapaxes(frames, 1, 2) @ tensor(e) @ frames for e in (own, other)]
    means = [np.einsum("g,gij->ij", share, e) for e in world]
    assert means[0] == pytest.approx(means[1], abs=1e-13)
    centre = np.stack(shape(0, 0)[1:]) @ y[0, :4, :2]
    lever = GAUSS[:, ::-1] - share @ GAUSS[:, ::-1]
    fields = np.einsum("gm,mi,mj->mgij", lever, centre, centre)
    for f in fields:
        works = [np.einsum("g,gij,gij->", share, f, e) for e in world]
        assert works[0] == pytest.approx(works[1], abs=1e-13)
    varied = (world[0] - means[0]).ravel()
    best = np.linalg.lstsq(fields.reshape(2, -1).T, varied, rcond=None)[0]
    assert best @ fields.reshape(2, -1) == pytest.approx(varied, abs=1e-13)
    assert np.abs(best).min() > 1e-2


@pytest.mark.parametrize("lean", [0.0, 0.5, -1.5])
def test_a_strip_of_parallelograms_bends_in_its_plane_exactly(lean):
    """One element over the depth, Poisson's ratio zero, under end moments: M^2 L / (E I)."""
    X, quads = plate(6.0, 1.0, 6, 1)
    X[:, 0] += lean * (X[:, 1] - 0.5)
    held = np.zeros(X.shape, dtype=bool)
    held[1, 0] = True
    model = clamp(sheet(X, quads, 12.0, 0.0, 1.0), np.array([0]))
    model = mirror_plane(model, np.zeros_like(held), held)
    load = np.zeros_like(X)
    load[[0, 1, -2, -1], 0] = [1, -1, -1, 1]
    u, _ = linear_response(model, load)
    assert np.vdot(load, u) == pytest.approx(6.0, rel=1e-9)


@given(st.floats(-0.3, 0.5), st.floats(-3, 3))
def test_growth_along_the_fibre_alone_is_free_of_stress(growth, angle):
    """A flat element of any shape stretched by 1 + growth along its fibre."""
    fibre = np.array([np.cos(angle), np.sin(angle), 0.0])
    y = element("skew flat")[2]
    tables = shell_tables(y[:, :4], y[:, 4:], fibre[None], np.array([growth]))
    stretched = y.copy()
    stretched[:, :4] += growth * (y[:, :4] @ fibre)[..., None] * fibre
    assert np.abs(tables.strain(stretched)).max() < 1e-14
    area = np.cross(y[0, 2] - y[0, 0], y[0, 3] - y[0, 1])[2] / 2
    assert tables.weight.sum() == pytest.approx(area * (1 + growth))


@given(st.floats(-0.3, 0.5), st.floats(-3, 3))
def test_a_grown_element_is_one_laid_out_longer(growth, angle):
    """The same energy and forces in any deformation."""
    fibre = np.array([np.cos(angle), np.sin(angle), 0.0])
    _, section, y = element("skew flat")
    X, D = y[:, :4], y[:, 4:]
    grown = shell_tables(X, D, fibre[None], np.array([growth]))
    longer = X + growth * (X @ fibre)[..., None] * fibre
    laid = shell_tables(longer, D, fibre[None], np.zeros(1))
    moved = y + 0.2 * np.random.default_rng(7).normal(size=y.shape)
    one, other = (element_response(t, section, moved) for t in (grown, laid))
    assert one.energy == pytest.approx(other.energy, rel=1e-11)
    assert one.gradient == pytest.approx(other.gradient, abs=1e-11)


@pytest.mark.parametrize("growth", [-0.1, 0.3])
def test_a_grown_strip_relaxes_to_its_length(growth):
    X, quads = plate(4.0, 1.0, 8, 2)
    model = clamp(sheet(X, quads, 1e3, 0.3, 0.1, growth=growth), np.flatnonzero(X[:, 0] == 0))
    solution = solve(model, at_rest(model), NO_TENSION, BENCHMARK)
    grown = X * [1 + growth, 1, 1]
    assert solution.configuration.x == pytest.approx(grown, abs=1e-9)
    assert np.abs(fields(model, solution.configuration).stress).max() < 1e-6


def test_a_pulled_strip_carries_the_tendons_force():
    """Uniaxial tension: nominal stress is force over section, S11 that over the stretch."""
    X, quads = plate(4.0, 1.0, 8, 2)
    model = clamp(sheet(X, quads, 1e3, 0.0, 0.1), np.flatnonzero(X[:, 0] == 0))
    end = np.flatnonzero(X[:, 0] == 4)
    tip = end[[1, 0, 2]]
    model = guide(model, [tip], [(1.0, 0, 0)])
    model = replace(model, share=np.array([[0.5, 0.25, 0.25]]))
    force = np.array([30.0])
    solution = solve(model, at_rest(model), force, BENCHMARK)
    c = solution.configuration
    stretch = 1 + model.excursion(c)[0] / 4
    seen = fields(model, c)
    strain = (stretch**2 - 1) / 2
    assert seen.strain == pytest.approx(np.tile([strain, 0, 0], (16, 1)), abs=1e-10)
    assert seen.stress[:, 0] == pytest.approx(np.full(16, 300.0 / stretch))
    assert seen.stress[:, 0] == pytest.approx(np.full(16, 1e3 * strain))
    assert seen.faces == pytest.approx(np.full((16, 2), strain))


def test_faces_of_a_bent_strip():
    """Pure bending: strain -+ thickness / (2 radius), tensile on the face away from the centre."""
    X, quads = plate(10.0, 1.0, 40, 1)
    model = sheet(X, quads, 1.0, 0.3, 0.2)
    c = arc(X, 1.0, 10.0)
    seen = fields(model, c)
    assert seen.faces == pytest.approx(np.tile([0.01, -0.01], (40, 1)), abs=1e-4)
    assert np.abs(seen.strain).max() < 1e-4


def test_the_held_end_of_a_cantilever_carries_the_load():
    X, quads = plate(10.0, 1.0, 8, 1)
    model = clamp(sheet(X, quads, 1.2e6, 0.0, 0.1), np.flatnonzero(X[:, 0] == 0))
    tip, force = X[:, 0] == 10, np.array([0.0, 0, 2.0])
    loaded = replace(model, dead=np.outer(tip, force) / tip.sum())
    solution = solve(loaded, at_rest(model), NO_TENSION, BENCHMARK)
    c = solution.configuration
    held = wrenches(loaded, c, solution.evaluation, NO_TENSION)["tie"][0]
    load = np.concatenate([force, np.cross(c.x[tip].mean(axis=0), force)])
    assert held == pytest.approx(load, abs=1e-6)


def test_directors_may_point_to_either_side():
    X, quads = plate(10.0, 1.0, 8, 2)
    load = np.zeros_like(X)
    load[X[:, 0] == 10.0, 2] = 1e-3
    tips = []
    for side in (1.0, -1.0):
        directors = np.tile([0.0, 0.0, side], (len(X), 1))
        model = sheet(X, quads, 1e6, 0.3, 0.1, directors=directors)
        model = clamp(model, np.flatnonzero(X[:, 0] == 0))
        tips.append(linear_response(model, load)[0][:, 2].max())
    assert tips[1] == pytest.approx(tips[0], rel=1e-9)


@pytest.mark.parametrize("law", [Isotropic(1e3, 0.3), NeoHookean(1e3, 0.3)])
def test_the_energy_density_integrates_to_the_energy(law):
    """Also with bending, shear and growth; and a pulled strip has E e^2 / 2 everywhere."""
    X, quads = plate(4.0, 1.0, 8, 2)
    model = sheet(X, quads, 1e3, 0.3, 0.1, growth=0.02)
    model = replace(model, section=one_law(law, np.full(len(quads), 0.1)))
    rng = np.random.default_rng(3)
    c = at_rest(model)
    d = c.d + 0.05 * rng.normal(size=c.d.shape)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    c = replace(c, x=c.x + 0.01 * rng.normal(size=c.x.shape), d=d)
    seen = energy_fields(model, c)
    whole = model.evaluate(c, NO_TENSION, tangent=False).energy
    assert seen.density @ seen.volume == pytest.approx(whole, rel=1e-12)
    assert seen.volume.sum() == pytest.approx(4.0 * 1.02 * 0.1)
    assert whole > 0


def test_the_energy_density_of_a_pulled_strip():
    X, quads = plate(4.0, 1.0, 8, 2)
    model, e = sheet(X, quads, 1e3, 0.0, 0.1), 0.05
    c = at_rest(model)
    c = replace(c, x=c.x * [np.sqrt(1 + 2 * e), 1, 1])
    seen = energy_fields(model, c)
    assert seen.density == pytest.approx(np.full(len(quads), 1e3 * e**2 / 2))
    assert seen.stretch == pytest.approx(np.ones(len(quads)))


@pytest.mark.parametrize(("turn", "is_fold"), [(20.0, False), (30.0, True), (90.0, True)])
def test_sheets_that_meet_at_a_fold_keep_their_thickness(turn, is_fold):
    """The director in the fold leans by half of the turn (deg), and is the longer for it; a turn
    of up to 24 deg is a curve."""
    a = np.deg2rad(turn)
    row = np.array([[0.0, 0, 0], [1, 0, 0], [1 + np.cos(a), 0, np.sin(a)]])
    X = np.repeat(row, 2, axis=0) + np.tile([[0.0, 0, 0], [0, 1, 0]], (3, 1))
    quads = np.array([[0, 2, 3, 1], [2, 4, 5, 3]])
    longest = sheet(X, quads, 1e8, 0.3, 0.01, fibre=(1.0, 0.1, 0.5)).tables.mitre.max()
    assert longest == pytest.approx(1 / np.cos(a / 2) if is_fold else 1.0)


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("name", ["warped", "tri", "nine nodes"])
def test_the_change_of_a_strain_is_its_derivative(name, compiled, monkeypatch):
    """Of nodes off the mid-surface; by a step of one it is exact, since strains are quadratic."""
    monkeypatch.setattr(kernels, "COMPILED", compiled and kernels.COMPILED)
    tables, _, y = element(name, 0.2)
    rng = np.random.default_rng(9)
    tables = replace(tables, height=rng.normal(size=tables.height.shape) / 10)
    dy = rng.normal(size=y.shape)
    change = tables.strain_change(y, dy)
    difference = (tables.strain(y + dy) - tables.strain(y - dy)) / 2
    assert change == pytest.approx(difference, abs=1e-12 * np.abs(difference).max())
    assert tables.strain_change(y, 2 * dy) == pytest.approx(2 * change, rel=1e-12, abs=1e-14)
