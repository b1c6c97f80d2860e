"""The hood's generated mesh: complete, on the bones, the same hood at any fineness."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cosim.analyses.reduction.samples import Walk, sample_walks
from cosim.case.file import find_case, load_case
from cosim.hoods.fe_supports import pose_surfaces
from cosim.hoods.fe_view import guide_depth
from cosim.models.build import bone_surfaces, build, hood_mesh
from cosim.pipeline import run_case
from cosim.solve.session import Session
from fe_solver.hood.shell_hood import ShellHood
from meshes import hood as hood_generator
from meshes.hood_lines import (
    CENTRAL_END,
    COARSEST,
    LATERAL_END,
    LIGAMENT_ROWS,
    RETINACULAR_ROWS,
    SAGITTAL_ROWS,
    SLIP_END,
    SLIP_START,
    SPANS,
    TERMINAL_END,
    even_shares,
    fineness,
    rows,
)
from meshes.hood_mesh import ENDS, REGIONS, SPRINGS, HoodMesh, to_json
from meshes.skeleton import JOINTS
from tests.helpers import shells


def mesh_of(quads: int, elements: str = "linear") -> HoodMesh:
    settings = [f"hood.mesh.quads={quads}", f'hood.mesh.elements="{elements}"']
    return hood_mesh(load_case("isometric_edc", settings))


@pytest.fixture(scope="module")
def mesh() -> HoodMesh:
    return mesh_of(250)


@pytest.fixture(scope="module")
def hood() -> ShellHood:
    return shells.index_hood()


def test_the_generator_repeats_itself(mesh):
    assert to_json(mesh_of(250)) == to_json(mesh)


@pytest.mark.parametrize("quads", [120, 250, 600, 900, 2400])
def test_about_as_many_quads_as_asked_for(quads):
    """The nearest of the family, whose members have 1, 4, 9 ... times the quads of the coarsest."""
    laid = len(mesh_of(quads).quads)
    assert laid == COARSEST * fineness(quads) ** 2
    assert 0.6 < laid / quads < 1.7


@pytest.mark.parametrize("elements", ["linear", "quadratic"])
def test_every_line_of_a_coarser_mesh_is_one_of_a_finer_mesh(elements):
    """Regions' edges, tendons' ends and rows of springs lie where they lie in any mesh."""
    quadratic = elements == "quadratic"
    for quads in (104, 416, 936, 2600):
        stations = rows(quads, quadratic)
        ends = [TERMINAL_END, *(begin for begin, _, _ in SPANS)]
        assert np.abs(stations[:, None] - ends).min(axis=0) == pytest.approx(0, abs=1e-9)
    coarse, fine = (mesh_of(quads, elements) for quads in (416, 1664))
    assert len(fine.quads) == {"linear": 4, "quadratic": 9}[elements] * len(coarse.quads)
    for name in REGIONS:
        areas = [mesh.areas()[mesh.cells(name)].sum() for mesh in (coarse, fine)]
        assert areas[0] == pytest.approx(areas[1], rel=0.03), name


@pytest.mark.parametrize("along", [0, 1])
def test_a_regions_length_is_that_of_its_fibres_and_not_what_they_span(mesh, along):
    """Quads of 1 by 2 mm over a cylinder, each row starting a quad further round than the last: the
    span along the mean direction is a chord, and of all rows together."""
    radius, columns, rows = 10e-3, 12, 4
    i, j = np.meshgrid(np.arange(columns + 1), np.arange(rows + 1), indexing="ij")
    angle, height = (i + j) * 1e-3 / radius, j * 2e-3
    points = np.stack([radius * np.sin(angle), height, radius * np.cos(angle)], axis=2)
    number = np.arange(i.size).reshape(i.shape)
    corners = (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])
    quads = np.roll(np.stack(corners, axis=2).reshape(-1, 4), along, axis=1)
    p = points.reshape(-1, 3)
    fibre = p[corners[1].ravel()] - p[corners[0].ravel()]
    fibre /= np.linalg.norm(fibre, axis=1, keepdims=True)
    laid = replace(mesh, points=p, quads=quads, fibre=fibre)
    every = np.ones(len(quads), dtype=bool)
    for cells in (every, np.arange(len(quads)) % rows < 2):
        assert laid.length(cells) == pytest.approx(12e-3, rel=2e-3)


def test_length_times_width_of_a_region_is_its_area(mesh):
    """The sagittal bands run round the finger, and are as wide as they are long on it."""
    for name in ("sagittal_band_radial", "sagittal_band_ulnar"):
        cells = mesh.cells(name)
        width = mesh.areas()[cells].sum() / mesh.length(cells)
        assert width == pytest.approx(np.ptp(mesh.points[mesh.quads[cells], 0]), rel=0.05)


def test_nine_nodes_are_an_element():
    made = mesh_of(250, "quadratic")
    q = made.quads
    assert made.quadratic
    for first, middle, last in ((0, 4, 3), (1, 5, 2), (0, 6, 1), (3, 7, 2), (6, 8, 7), (4, 8, 5)):
        one, other = made.points[q[:, first]], made.points[q[:, last]]
        bulge = np.linalg.norm(made.points[q[:, middle]] - (one + other) / 2, axis=1)
        assert (bulge < 0.15 * np.linalg.norm(one - other, axis=1)).all()
        ends = made.station[q[:, [first, last]]]
        assert made.station[q[:, middle]] == pytest.approx(ends.mean(axis=1), abs=1e-3)
    assert made.lift is None or not made.lift.any()
    assert made.areas().sum() == pytest.approx(mesh_of(250).areas().sum(), rel=0.02)


def test_even_shares_follow_the_shape_functions():
    assert even_shares(np.arange(3.0), (0, 2), False) == pytest.approx(np.array([1, 2, 1]) / 4)
    assert even_shares(np.arange(3.0), (0, 1), False) == pytest.approx([0.5, 0.5, 0])
    places = np.array([0.0, 1, 2, 4, 6])
    assert even_shares(places, (0, 6), True) == pytest.approx(np.array([1, 4, 3, 8, 2]) / 18)


@pytest.mark.parametrize("elements", ["linear", "quadratic"])
@pytest.mark.parametrize("quads", [120, 600, 2400])
def test_what_holds_an_edge_holds_the_same_stretch_of_it_in_any_mesh(quads, elements):
    made = mesh_of(quads, elements)
    lines = {"sagittal": SAGITTAL_ROWS, "retinacular": RETINACULAR_ROWS, "ligament": LIGAMENT_ROWS}
    for name, (start, end) in lines.items():
        for side in ("radial", "ulnar"):
            held = made.springs[f"{name}_{side}"]
            assert held.shares is not None
            assert held.shares.sum() == pytest.approx(1.0, abs=1e-5)
            middle = np.average(made.station[held.nodes], weights=held.shares)
            assert middle == pytest.approx((start + end) / 2, abs=1e-4)
    slip = made.springs["central_slip"]
    assert slip.shares == pytest.approx(slip.shares[::-1], abs=1e-6)


def test_springs_of_a_hood_have_their_shares_of_the_stiffness(mesh):
    case = load_case("isometric_edc", ["hood.mesh.quads=250"])
    made = build(case).hood
    springs = made.model.springs
    for name, held in mesh.springs.items():
        if name not in case.hood.springs:
            continue
        own = springs.group == made.groups.index(name)
        np.testing.assert_array_equal(springs.node[own], held.nodes)
        whole = case.hood.springs[name].stiffness
        np.testing.assert_allclose(springs.stiffness[own], whole * held.shares, rtol=1e-5)


def test_the_mesh_names_every_region_and_set(mesh):
    assert set(mesh.region) == set(range(len(REGIONS)))
    assert set(mesh.springs) == set(SPRINGS)
    assert set(mesh.ends) == set(ENDS)
    assert set(mesh.tied) == {"distal"}
    assert set(mesh.rest_posture) == set(JOINTS)
    assert mesh.cells(*REGIONS).all()
    springs = np.unique(np.concatenate([s.nodes for s in mesh.springs.values()]))
    sets = [*mesh.ends.values(), *mesh.tied.values(), springs]
    assert all(len(s) for s in sets)
    assert len(np.unique(np.concatenate(sets))) == sum(len(s) for s in sets)  # held in one way only
    assert np.linalg.norm(mesh.fibre, axis=1) == pytest.approx(np.ones(len(mesh.quads)), abs=1e-5)


def corner_normals(mesh: HoodMesh) -> np.ndarray:
    p = mesh.points[mesh.quads]
    return np.cross(p - np.roll(p, 1, axis=1), np.roll(p, -1, axis=1) - p)


def test_quads_are_convex_and_face_alike(mesh):
    corners = corner_normals(mesh)
    mean = corners.mean(axis=1, keepdims=True)
    assert (np.einsum("nak,nak->na", corners, mean + 0 * corners) > 0).all()
    edges = np.concatenate([mesh.quads[:, [a, (a + 1) % 4]] for a in range(4)])
    assert len(np.unique(edges, axis=0)) == len(edges)  # a shared edge is run through both ways
    along = np.abs(np.einsum("nk,nk->n", mesh.fibre, mean[:, 0]))
    assert (along < 0.5 * np.linalg.norm(mean[:, 0], axis=1)).all()


def test_the_sheet_lies_on_the_bones_and_not_in_them(hood):
    gap = hood.gap(hood.start(hood.rest))
    assert gap.min() > 0
    assert np.median(gap[np.isfinite(gap)]) < 1.5e-3


@pytest.mark.parametrize("name", ["isometric_edc", "hood_minorflex_edc", "cable_ei"])
def test_extensor_tendons_slide_clear_of_the_metacarpal_up_to_the_mcp(name):
    assert guide_depth(build(load_case(name)).hood) == 0


@pytest.mark.slow
def test_a_line_into_the_metacarpals_head_is_missed_by_the_audit(monkeypatch):
    monkeypatch.setattr(hood_generator, "clear_guides", lambda *laid: None)
    summary = run_case(load_case("isometric_edc", ["hood.mesh.quads=251"])).summary
    assert summary["guide_depth_mm"] > 1.5
    assert summary["audit_missed"] == ["guide_depth_mm"]


def test_lifted_nodes_lay_a_sheet_on_a_cylinder_in_the_mean():
    """Between nodes on the surface itself the sheet runs too low, by a twelfth of w^2 / R."""
    radius, angle = 6e-3, np.radians([-70, -50, -35, -10, 15, 30, 50])
    row = np.column_stack([np.zeros(7), np.sin(angle), np.cos(angle)])
    points = radius * np.vstack([row, row]) + np.repeat([[0, 0, 0], [2e-3, 0, 0]], 7, axis=0)
    cells = np.array([[k, 7 + k, 8 + k, k + 1] for k in range(6)])

    class Cylinder:
        def value(self, points):
            across = points * [0, 1, 1]
            size = np.linalg.norm(across, axis=1)
            return size - radius, across / size[:, None]

    lift, outward = hood_generator._lift(points, cells, Cylinder())

    def height(nodes: np.ndarray) -> float:
        """Mean of a row's clearance."""
        share = (np.arange(100) + 0.5)[:, None, None] / 100
        p = (1 - share) * nodes[:6] + share * nodes[1:7]
        width = np.linalg.norm(np.diff(nodes[:7], axis=0), axis=1)
        return float(
            np.average((np.linalg.norm(p[..., 1:], axis=2) - radius).mean(axis=0), weights=width)
        )

    too_low = height(points)
    assert too_low < -0.05e-3
    assert abs(height(points + lift[:, None] * outward)) < 0.03 * -too_low
    flat = points * [1, 1, 0] + [0, 0, 1e-2]
    np.testing.assert_allclose(hood_generator._lift(flat, cells, Cylinder())[0], 0, atol=1e-6)


def test_the_central_slip_is_held_at_its_own_height(mesh):
    case = load_case("isometric_edc", ["hood.mesh.quads=250"])
    held = mesh.springs["central_slip"]
    height = pose_surfaces(bone_surfaces(case))["middle"].distance(held.anchors).value
    level = case.hood.contact.offset.middle + mesh.thickness / 2
    np.testing.assert_allclose(height, level, atol=2e-6)


def with_rows_halved(monkeypatch: pytest.MonkeyPatch, first: float, last: float) -> None:
    """Hoods with twice as many rows between two stations (mm), and the others where they were."""
    laid = hood_generator.rows

    def halved(*sizes):
        rows = laid(*sizes)
        middle = (rows[1:] + rows[:-1]) / 2
        return np.sort(np.concatenate([rows, middle[(middle > first) & (middle < last)]]))

    monkeypatch.setattr(hood_generator, "rows", halved)


@pytest.mark.slow
def test_the_slips_shares_hang_on_no_row_over_the_pip(monkeypatch):
    """With strings down to the bare bone twice as many rows there made the ratio 2 % larger."""

    def ratio(quads: int) -> float:
        case = load_case("strain_lee2008_average_ti", [f"hood.mesh.quads={quads}"])
        return run_case(case).summary["slip_ratio"]

    before = ratio(600)
    with_rows_halved(monkeypatch, SLIP_START, SLIP_END)
    assert ratio(601) == pytest.approx(before, rel=0.01)


@pytest.mark.slow
def test_the_torque_of_a_tendon_over_the_pip_does_not_ripple_with_the_rows():
    """EI at 1.55 N, PIP from 38 to 53 deg: a row of the mesh is 7 to 16 deg of it."""
    turns = np.linspace(38.0, 53.0, 21)
    angles = np.tile(np.radians([26.6, 0.0, 0.0, 17.2]), (len(turns), 1))
    angles[:, 2] = np.radians(turns)
    walk = Walk(angles, np.array([[0.05, 1.55, 0.05, 0.05]]))
    (found,) = sample_walks(find_case("fingertip_fibres_edc"), (), [walk], 1)
    torque = np.array([state.torque[2] for state in found.states])
    smooth = np.polynomial.Polynomial.fit(turns, torque, 3)(turns)
    assert np.std(torque - smooth) < 4e-3 * np.abs(torque).mean()


@pytest.mark.slow
def test_a_slack_band_does_not_crumple_on_a_fine_mesh():
    """Elements of too even a shear had no equilibrium here."""
    angles = {"MCP": 0, "PIP": 60, "DIP": 30}
    posture = [f"finger.posture.{joint}={angle} deg" for joint, angle in angles.items()]
    case = load_case("strain_lee2008_average_ti", ["hood.mesh.quads=2400", *posture])
    summary = run_case(case).summary
    assert summary["audit"]["hood_force_balance"] < 1e-8
    assert summary["slip_ratio"] == pytest.approx(0.87, abs=0.1)


@pytest.mark.slow
def test_the_unloaded_finger_hangs_on_no_row_at_the_tendons_end(monkeypatch):
    """Lines through the head made the terminal slip's force 3.3 times as much with finer rows."""

    def terminal(quads: int) -> float:
        case = load_case("fingertip_fibres_edc", [f"hood.mesh.quads={quads}"])
        session, silent = Session(), lambda stage: None
        hood = session.models(case, silent).hood
        rest = session.unloaded_equilibrium(case, silent)
        return float(np.linalg.norm(hood.group_forces(rest.response.state)["terminal_slip"]))

    before = terminal(600)
    with_rows_halved(monkeypatch, CENTRAL_END, LATERAL_END)
    assert terminal(601) == pytest.approx(before, rel=0.05)
