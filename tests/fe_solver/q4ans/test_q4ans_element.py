"""FEBio's shell, its laws and its contact: what they pass, and where they lock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cosim.errors import InputError
from fe_solver.elements.mesh_geometry import node_directors
from fe_solver.materials.crossed_fibres import CrossedFibres, CrossedLinear
from fe_solver.materials.fibres import (
    DispersedFamily,
    ExponentialFamily,
    HolzapfelGasserOgden,
    TransIsoMooneyRivlin,
)
from fe_solver.materials.hyperelastic import NeoHookean
from fe_solver.materials.linear import Isotropic, Orthotropic
from fe_solver.materials.tension_field import TensionField
from fe_solver.q4ans.element import (
    SolidTables,
    solid_response,
    solid_strain,
    solid_tables,
)
from fe_solver.q4ans.facets import Facets, cut, find_triangles, pressures
from fe_solver.q4ans.laws import in_situ_strain, normal_modulus, solid_stress
from tests.helpers.jobs import COARSE, LENGTH, THICK, WIDTH, E, strip
from tests.proofs.fe.febio_rows import FEBIO_STRESS, MPA, febio_law
from tests.proofs.fe.sheets import map_grid

RNG = np.random.default_rng(5)
RUBBER = Isotropic(E, 0.4)
PENALTY = replace(COARSE, penetration=None)
UPRIGHT, ORIGIN = np.eye(3), np.zeros(3)
ALONG = np.array([1.0, 0.3, 0.2])


def solid(points, quads, thick: float = THICK) -> tuple[np.ndarray, np.ndarray]:
    """Both faces' nodes (2n, 3) and the elements' eight."""
    high = points + thick * node_directors(points, quads)
    return np.concatenate([points, high]), np.concatenate([quads, quads + len(points)], axis=1)


def split(pairs) -> np.ndarray:
    """The elements (ne, 8) as two triangles each."""
    first, second = pairs[:, [0, 1, 2, 2, 4, 5, 6, 6]], pairs[:, [0, 2, 3, 3, 4, 6, 7, 7]]
    return np.concatenate([first, second])


def patch(curved: bool) -> tuple[np.ndarray, np.ndarray]:
    """3 x 3 distorted quads, flat or on a cylinder."""

    def shape(uv):
        u, v = uv.T
        u, v = u + 0.1 * np.sin(5 * v) * u * (1 - u), v + 0.15 * np.sin(4 * u) * v * (1 - v)
        x, y = 4e-3 * u, 3e-3 * v
        if not curved:
            return np.column_stack([x, y, 0 * x])
        return np.column_stack([x, 5e-3 * np.sin(y / 5e-3), 5e-3 * np.cos(y / 5e-3)])

    return solid(*map_grid(3, 3, shape))


def tables_of(z, pairs) -> SolidTables:
    return solid_tables(z[pairs], np.tile(ALONG, (len(pairs), 1)))


def assemble(z, pairs, law) -> tuple[np.ndarray, np.ndarray]:
    """Forces (6n,) and the dense tangent of the nodes z."""
    force, blocks, _ = solid_response(tables_of(z, pairs), law, z[pairs])
    dofs = (3 * pairs[:, :, None] + np.arange(3)).reshape(len(pairs), 24)
    out, tangent = np.zeros(z.size), np.zeros((z.size, z.size))
    np.add.at(out, dofs, force)
    np.add.at(tangent, (dofs[:, :, None], dofs[:, None, :]), blocks)
    return out, tangent


def inner(z) -> np.ndarray:
    """The patch's nodes that do not lie on its edge, of both faces, as (6n,)."""
    n = len(z) // 2
    grid = np.zeros((4, 4), dtype=bool)
    grid[1:-1, 1:-1] = True
    assert grid.size == n
    return np.repeat(np.tile(grid.ravel(), 2), 3)


@pytest.mark.parametrize("curved", [False, True])
def test_a_rigid_motion_strains_nothing(curved):
    z, pairs = patch(curved)
    turn = Rotation.from_rotvec([0.7, -1.9, 1.1]).as_matrix()
    moved = z @ turn.T + [0.02, -0.03, 0.01]
    assert np.abs(solid_strain(tables_of(z, pairs), moved[pairs])).max() < 1e-12
    assert np.abs(solid_strain(tables_of(z, pairs), 1.01 * z[pairs])).max() > 1e-3


@pytest.mark.parametrize("law", [RUBBER, febio_law(2000)])
def test_a_constant_strain_is_met_and_balances(law):
    z, pairs = patch(False)
    F = np.eye(3) + 0.01 * np.array([[1.0, 2, 1], [-1, -0.5, 2], [0.3, 0.4, -0.6]])
    tables = tables_of(z, pairs)
    strain = solid_strain(tables, (z @ F.T)[pairs])
    normal = np.sign(z[-1, 2]) * np.array([0, 0, 1.0])
    along = ALONG * [1, 1, 0] / np.hypot(*ALONG[:2])
    axes = np.column_stack([along, np.cross(normal, along), normal])
    e = axes.T @ (F.T @ F - np.eye(3)) / 2 @ axes
    exact = [e[0, 0], e[1, 1], e[2, 2], 2 * e[0, 1], 2 * e[1, 2], 2 * e[0, 2]]
    assert np.abs(strain - exact).max() < 1e-12
    force, _, _ = solid_response(tables, law, (z @ F.T)[pairs])
    total = np.zeros(z.shape)
    np.add.at(total, pairs, force.reshape(-1, 8, 3))
    through = total.reshape(2, -1, 3).sum(axis=0).ravel()  # the faces' tractions are opposite
    assert np.abs(through[inner(z)[: z.size // 2]]).max() < 1e-10 * np.abs(force).max()


def bend_sheet(z, curvature: float) -> np.ndarray:
    """(6n,) m of a flat sheet bent about y, to first order, its mid-surface at half its height."""
    x, height = z[:, 0], z[:, 2] - THICK / 2
    u = np.column_stack([-curvature * height * x, 0 * x, curvature * x**2 / 2])
    return u.ravel()


@pytest.mark.parametrize(("nu", "locks"), [(0.0, 1.0), (0.3, 0.49 / 0.4), (0.4, 1.8)])
def test_a_bent_patch_balances_and_locks_as_its_thickness_is_held(nu, locks):
    """Energy against that of a plate: (1 - nu)^2 / (1 - 2 nu) too much."""
    z, pairs = patch(False)
    for elements in (pairs, split(pairs)):
        _, K = assemble(z, elements, Isotropic(E, nu))
        u, area = bend_sheet(z, 0.1), 4e-3 * 3e-3
        force = K @ u
        assert np.abs(force[inner(z)]).max() < 1e-9 * np.abs(force).max()
        plate = E * THICK**3 / 12 / (1 - nu**2) * 0.1**2 * area / 2
        assert u @ force / 2 == pytest.approx(locks * plate, rel=1e-9)


def test_fanned_directors_do_not_thin_the_sheet():
    z, pairs = patch(False)
    low, high = np.split(z, 2)
    turn = Rotation.from_rotvec(low[:, :1] / 4e-3 * [0, 0.5, 0.2])
    fanned = np.concatenate([low, low + turn.apply(high - low)])
    strain = solid_strain(tables_of(z, pairs), fanned[pairs])
    assert np.abs(strain[..., 2]).max() < 1e-12
    assert np.abs(strain[..., 0]).max() > 1e-2


def tip(nu: float) -> float:
    """Deflection of a strip bent into a cylinder, over that of a plate."""
    job = strip(10, 1)
    z, pairs = solid(job.sheet.points, job.sheet.quads)
    _, K = assemble(z, pairs, Isotropic(E, nu))
    free = np.ones(z.shape, dtype=bool)
    free[:, 1] = False
    free[z[:, 0] == 0] = False
    load = np.zeros(z.shape)
    load[np.isclose(z[:, 0], LENGTH), 2] = 0.25e-3
    u = np.linalg.solve(K[np.ix_(free.ravel(), free.ravel())], load[free])
    bending = E * WIDTH * THICK**3 / 12 / (1 - nu**2)
    return float(u @ load[free] / 1e-3 / (1e-3 * LENGTH**3 / (3 * bending)))


def test_a_cantilever_is_too_stiff_by_thickness_locking():
    assert tip(0.0) == pytest.approx(1.0, abs=5e-3)
    assert tip(0.4) == pytest.approx(1 / 1.8, rel=5e-3)


SECOND = ExponentialFamily(MPA, 40.0, 500 * MPA, 1.02)
CROSSED = CrossedFibres(febio_law(200), SECOND, 0.7)
NET = HolzapfelGasserOgden(7 * MPA, 100 * MPA, 20, 0.1, 0.0, 900 * MPA)
LAWS = {
    "isotropic": RUBBER,
    "orthotropic": Orthotropic(4 * E, 2 * E, 0.3, E / 2, E / 3, E / 4, 1.5 * E, 0.2, 0.1),
    "neo-Hookean": NeoHookean(E, 0.4),
    "soft fibres": febio_law(200),
    "stiff fibres": febio_law(5000),
    "Mooney-Rivlin": TransIsoMooneyRivlin(2 * MPA, MPA, 0, 1, 0, 2, 500 * MPA),
    "dispersed": HolzapfelGasserOgden(7 * MPA, 100 * MPA, 20, 0.1, 0.6, 900 * MPA),
    "aligned": HolzapfelGasserOgden(7 * MPA, 100 * MPA, 20, 0, 0, 900 * MPA),
    "crossed": CROSSED,
    "crossed, dispersed": CrossedFibres(NET, DispersedFamily(50 * MPA, 30, 0.05), -0.7),
}


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
def test_a_laws_tangent_is_that_of_its_stress(law):
    strain = RNG.normal(scale=0.02, size=(9, 6)) + np.array([0.03, 0, 0, 0, 0, 0])
    _, stiff = solid_stress(law, strain)
    assert np.abs(stiff - np.swapaxes(stiff, 1, 2)).max() < 1e-12 * np.abs(stiff).max()
    way = RNG.normal(size=strain.shape)
    ahead, behind = (solid_stress(law, strain + h * way)[0] for h in (1e-6, -1e-6))
    exact = (stiff @ way[..., None])[..., 0]
    assert np.abs((ahead - behind) / 2e-6 - exact).max() < 1e-7 * np.abs(exact).max()


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
def test_without_normal_stress_a_solid_is_a_sheet(law):
    strain = np.array([0.02, 0.005, 0, 0.01, 0, 0])
    for _ in range(20):
        stress, stiff = solid_stress(law, strain)
        strain[2] -= stress[2] / stiff[2, 2]
    sheet = law.response(strain[[0, 1, 3]]).stress
    assert stress[[0, 1, 3]] == pytest.approx(sheet, rel=1e-9, abs=1e-9 * np.abs(sheet).max())


def test_a_second_family_is_the_first_one_turned():
    """A law of two like families answers to a strain mirrored about their bisector alike."""
    base = febio_law(200)
    like = ExponentialFamily(base.c3, base.c4, base.c5, base.lam_max)
    half = 0.35
    law = CrossedFibres(base, like, 2 * half)
    axis = np.array([np.cos(half), np.sin(half), 0])
    mirror = 2 * np.outer(axis, axis) - np.diag([1.0, 1, -1])
    e = RNG.normal(scale=0.02, size=(3, 3))
    e = e + e.T + np.diag([0.03, 0.03, 0])

    def stress(e):
        six = np.array([e[0, 0], e[1, 1], e[2, 2], 2 * e[0, 1], 2 * e[1, 2], 2 * e[0, 2]])
        s, _ = solid_stress(law, six)
        return np.array([[s[0], s[3], s[5]], [s[3], s[1], s[4]], [s[5], s[4], s[2]]])

    assert stress(mirror @ e @ mirror) == pytest.approx(mirror @ stress(e) @ mirror, rel=1e-9)
    assert np.abs(stress(e) - mirror @ stress(e) @ mirror).max() > 0.1 * MPA


def test_a_stretch_in_situ_strains_as_its_gradient_does():
    """C_e = F_p C F_p with F_p = diag(s, s^-1/2, s^-1/2) in the fibre's axes, at every point."""
    z, pairs = patch(False)
    s, fibres = 1.05, np.tile(ALONG, (len(pairs), 1))
    F = np.eye(3) + 0.02 * np.array([[1.0, 2, 1], [-1, -0.5, 2], [0.3, 0.4, -0.6]])
    y = (z @ F.T)[pairs]
    plain = solid_strain(solid_tables(z[pairs], fibres), y)[0, 0]
    e11, e22, e33, e12, e23, e13 = plain * [1, 1, 1, 0.5, 0.5, 0.5]
    C = np.eye(3) + 2 * np.array([[e11, e12, e13], [e12, e22, e23], [e13, e23, e33]])
    grown = np.diag([s, s**-0.5, s**-0.5])
    e = (grown @ C @ grown - np.eye(3)) / 2
    exact = [e[0, 0], e[1, 1], e[2, 2], 2 * e[0, 1], 2 * e[1, 2], 2 * e[0, 2]]
    found = solid_strain(solid_tables(z[pairs], fibres, s), y)
    assert np.abs(found - exact).max() < 1e-12
    factors, initial = in_situ_strain(s)
    assert factors[:3].prod() == pytest.approx(1.0)
    assert found[0, 0] == pytest.approx(factors * plain + initial, abs=1e-12)


@pytest.mark.parametrize("stretch", [0.97, 1.0, 1.04])
@pytest.mark.parametrize("law", [RUBBER, febio_law(200), febio_law(5000), CROSSED])
def test_the_tangent_is_that_of_the_forces(law, stretch):
    z, pairs = patch(True)
    y = (z * [1.04, 1.01, 0.98])[pairs] + RNG.normal(size=(len(pairs), 8, 3)) * 2e-6
    tables = solid_tables(z[pairs], np.tile(ALONG, (len(pairs), 1)), stretch)
    _, K, _ = solid_response(tables, law, y)
    assert np.abs(K - np.swapaxes(K, 1, 2)).max() < 1e-12 * np.abs(K).max()
    way = RNG.normal(size=y.shape)
    ahead, behind = (solid_response(tables, law, y + h * way)[0] for h in (1e-9, -1e-9))
    exact = (K @ way.reshape(-1, 24, 1))[..., 0]
    assert np.abs((ahead - behind) / 2e-9 - exact).max() < 1e-6 * np.abs(exact).max()


@pytest.mark.parametrize("k", FEBIO_STRESS)
def test_the_law_meets_febios_stresses(k):
    for stretch, (cauchy, volume, lateral) in FEBIO_STRESS[k].items():
        squares = np.array([stretch, 1 + lateral, volume / stretch / (1 + lateral)]) ** 2
        stress, _ = solid_stress(febio_law(k), np.append((squares - 1) / 2, np.zeros(3)))
        real = stress[:3] * squares / volume / MPA
        assert real == pytest.approx([cauchy, 0, 0], abs=2e-8 * k)  # J has eight decimals


def test_the_modulus_through_the_thickness():
    assert normal_modulus(RUBBER) == pytest.approx(E)
    soft = TransIsoMooneyRivlin(2 * MPA, 0.0, 0.0, 60.0, 0.0, 1.03, 1e6 * MPA)
    assert normal_modulus(soft) == pytest.approx(3 * 4 * MPA, rel=1e-4)
    stretchy = Orthotropic(E, E, 0.3, E, E, E, E / 10)
    assert normal_modulus(stretchy) == pytest.approx(E / 10)
    with pytest.raises(InputError, match="Orthotropic: is not positive definite"):
        solid_stress(replace(stretchy, nu23=4.0), np.zeros(6))
    with pytest.raises(InputError, match="incompressible"):
        solid_stress(febio_law(np.inf), np.zeros(6))
    with pytest.raises(InputError, match="TensionField: is not known"):
        solid_stress(TensionField(RUBBER), np.zeros(6))
    with pytest.raises(InputError, match="CrossedLinear: is not known"):
        solid_stress(CrossedLinear(RUBBER, E, 0.4), np.zeros(6))
    with pytest.raises(InputError, match="CrossedFibres: is incompressible"):
        solid_stress(replace(CROSSED, base=febio_law(np.inf)), np.zeros(6))
    several = np.array([[[0.1]], [[0.2]]])
    for law in (replace(CROSSED, angle=several), replace(febio_law(200), c3=MPA * several)):
        with pytest.raises(InputError, match=f"{type(law).__name__}: varies within the part"):
            solid_stress(law, np.zeros(6))
    linear = Isotropic(E, 0.0)  # S33 = p33 E (p33 E33 + E0), p33 = 1 / s
    assert normal_modulus(linear, 1.25) == pytest.approx(E / 1.25**2)


FLAT = np.array([[[-9, -9, 0], [40, -9, 0], [40, 20, 0]], [[-9, -9, 0], [40, 20, 0], [-9, 20, 0]]])


def on_flat(turn=UPRIGHT, shift=ORIGIN) -> tuple[Facets, np.ndarray, np.ndarray, np.ndarray]:
    """A strip on a plane of two long triangles, its nodes 3 um deep at x = 0 and as far out of it
    at the other end; and the body's pose."""
    job = strip()
    x = job.sheet.points + np.outer(2 * job.sheet.points[:, 0] / LENGTH - 1, [0, 0, 3e-6])
    triangles, count = cut(1e-3 * FLAT.astype(float), 2e-3), len(job.sheet.quads)
    facets = Facets(job.sheet.quads, np.full(count, -1), np.full(count, 2e11), 0, triangles)
    return facets, x @ turn.T + shift, shift, turn


def test_contact_is_the_sum_of_its_pressures_in_any_frame():
    facets, *there = on_flat()
    found = pressures(facets, *there)
    assert found.depth.max() == pytest.approx(3e-6 * (1 - 0.1 * (1 - 3**-0.5)), rel=1e-9)
    assert (found.pressure > 0).mean() == 0.5
    assert found.pressure == pytest.approx(2e11 * np.maximum(found.depth, 0))
    share = LENGTH * WIDTH / found.pressure.size
    assert found.force[2] == pytest.approx(-found.pressure.sum() * share, rel=1e-6)
    assert found.force[2] == pytest.approx(-2e11 * 3e-6 * WIDTH * LENGTH / 4, rel=1e-2)
    assert found.gradient.reshape(-1, 3).sum(axis=0) == pytest.approx(found.force)
    turn = Rotation.from_rotvec([0.4, 2.0, -0.3]).as_matrix()
    other = pressures(*on_flat(turn, np.array([0.1, -0.2, 0.05])))
    assert other.force == pytest.approx(turn @ found.force, rel=1e-6, abs=1e-9)


def test_contacts_tangent_is_that_of_normals_which_stay():
    facets, x, *pose = on_flat()
    blocks = pressures(facets, x, *pose).blocks
    way = np.tile([0, 0, 1.0], (len(x), 1))
    ahead, behind = (pressures(facets, x + h * way, *pose).gradient for h in (1e-11, -1e-11))
    exact = np.einsum("kij,kj->ki", blocks, way[facets.quads].reshape(-1, 12))
    assert np.abs((ahead - behind) / 2e-11 - exact).max() < 1e-6 * np.abs(exact).max()


def test_a_multiplier_presses_and_a_gap_is_kept():
    facets, *there = on_flat()
    plain, raised = pressures(facets, *there), pressures(facets, *there, 1e6)
    assert raised.pressure == pytest.approx(np.maximum(1e6 + 2e11 * plain.depth, 0))
    kept = pressures(replace(facets, gap=1e-6), *there)
    assert kept.depth == pytest.approx(plain.depth + 1e-6)


def test_contact_keeps_to_the_triangles_that_it_has_met():
    facets, x, *pose = on_flat()
    met = find_triangles(facets, x, *pose)
    assert (met >= 0).all()
    beside = x + np.array([0.05, 0, -1e-6])
    assert (find_triangles(facets, beside, *pose) < 0).all()
    kept = pressures(facets, beside, *pose, met=met)
    assert kept.depth == pytest.approx(pressures(facets, x, *pose).depth + 1e-6, abs=1e-12)


def test_what_no_triangle_faces_is_not_touched():
    facets, x, *pose = on_flat()
    beside = x + np.array([0.05, 0, -1e-6])
    assert not pressures(facets, beside, *pose).force.any()
    assert not pressures(facets, x - [0, 0, 3e-3], *pose).force.any()
    from_below = replace(facets, side=-facets.side)
    assert not pressures(from_below, x, *pose).force.any()


def test_long_triangles_are_cut_into_short_ones():
    pieces = cut(1e-3 * FLAT.astype(float), 2e-3)
    u, v = pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0]
    area = np.cross(u, v)[:, 2] / 2
    assert area.min() > 0
    assert area.sum() == pytest.approx(49e-3 * 29e-3)
    edge = np.linalg.norm(np.roll(pieces, 1, axis=1) - pieces, axis=2)
    assert 1e-3 < edge.max() <= 2e-3
