"""The hood's generated mesh and its file: complete, on the bones, read again or refused."""

from __future__ import annotations

import json

import numpy as np
import pytest
import shells
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.build import build, drawn_bones, hood_mesh
from cosim.build_ends import guide_depth
from cosim.build_shell import baked_surfaces
from cosim.case import find_case, load_case
from cosim.port import InputError
from cosim.reduction_samples import Walk, sampled
from cosim.run import Setting, run_case, settled
from fe_solver.mesh_geometry import node_directors
from fe_solver.shell import shell_tables
from fe_solver.shell_hood import ShellHood
from meshes import hood as hood_generator
from meshes.hood import LIGAMENT_ROWS, RETINACULAR_ROWS, SAGITTAL_ROWS
from meshes.hood_lines import CENTRAL_END, LATERAL_END, SLIP_END, SLIP_START, even_shares
from meshes.hood_mesh import (
    ENDS,
    REGIONS,
    SPRINGS,
    Attachment,
    HoodMesh,
    folded,
    read,
    to_json,
    write,
)
from meshes.skeleton import JOINTS


def mesh_of(quads: int, across: str = "linear") -> HoodMesh:
    settings = [f"hood.mesh.quads={quads}", f'hood.mesh.across="{across}"']
    return hood_mesh(load_case("isometric_edc", settings))


@pytest.fixture(scope="module")
def mesh() -> HoodMesh:
    return mesh_of(250)


@pytest.fixture(scope="module")
def hood() -> ShellHood:
    return shells.index_hood()


def test_the_generator_repeats_itself(mesh):
    assert to_json(mesh_of(250)) == to_json(mesh)


@pytest.mark.parametrize("across", ["linear", "quadratic"])
@pytest.mark.parametrize("quads", [250, 600, 2400])
def test_about_as_many_quads_as_asked_for(quads, across):
    """As whole rows and columns allow: a default of 672 or 716, others in proportion to it."""
    assert len(mesh_of(quads, across).quads) == pytest.approx(quads, rel=0.2)


@pytest.mark.parametrize("across", ["linear", "quadratic"])
def test_rows_and_columns_are_halved_in_a_mesh_four_times_as_large(across):
    coarse, fine = (len(mesh_of(quads, across).quads) for quads in (600, 2400))
    assert fine == 4 * coarse


def test_six_nodes_are_an_element_across_the_fibres():
    made = mesh_of(250, "quadratic")
    q, middle = made.quads, made.quads[:, 4:]
    assert made.quadratic
    ends = made.points[q[:, [0, 1]]], made.points[q[:, [3, 2]]]
    bulge = np.linalg.norm(made.points[middle] - (ends[0] + ends[1]) / 2, axis=2)
    assert (bulge < 0.15 * np.linalg.norm(ends[0] - ends[1], axis=2)).all()
    assert np.abs(made.station[middle] - made.station[q[:, [0, 1]]]).max() < 1e-3
    assert made.lift is None or not made.lift.any()
    assert made.areas().sum() == pytest.approx(mesh_of(250).areas().sum(), rel=0.02)


def test_even_shares_follow_the_shape_functions():
    assert even_shares(np.arange(3.0), (0, 2), False) == pytest.approx(np.array([1, 2, 1]) / 4)
    assert even_shares(np.arange(3.0), (0, 1), False) == pytest.approx([0.5, 0.5, 0])
    places = np.array([0.0, 1, 2, 4, 6])
    assert even_shares(places, (0, 6), True) == pytest.approx(np.array([1, 4, 3, 8, 2]) / 18)


@pytest.mark.parametrize("across", ["linear", "quadratic"])
@pytest.mark.parametrize("quads", [120, 600, 2400])
def test_what_holds_an_edge_holds_the_same_stretch_of_it_in_any_mesh(quads, across):
    made = mesh_of(quads, across)
    lines = {"sagittal": SAGITTAL_ROWS, "retinacular": RETINACULAR_ROWS, "ligament": LIGAMENT_ROWS}
    for name, (start, end) in lines.items():
        for side in ("radial", "ulnar"):
            held = made.springs[f"{name}_{side}"]
            assert held.shares is not None
            assert held.shares.sum() == pytest.approx(1.0, abs=1e-5)
            middle = held.shares @ made.station[held.nodes]
            assert middle == pytest.approx((start + end) / 2, abs=1e-4)
    slip = made.springs["central_slip"]
    assert slip.shares == pytest.approx(slip.shares[::-1], abs=1e-6)


def test_springs_of_a_hood_have_their_shares_of_the_stiffness(mesh):
    case = load_case("isometric_edc", ["hood.mesh.quads=250"])
    made = build(case).hood
    springs = made.model.springs
    for name, held in mesh.springs.items():
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
    sets = [*mesh.ends.values(), *mesh.tied.values(), *(s.nodes for s in mesh.springs.values())]
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
    height = baked_surfaces(drawn_bones(case))["middle"].distance(held.anchors).value
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
    (found,) = sampled(find_case("fingertip_fibres_edc"), (), [walk], 1)
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
    assert 3.4 < summary["slip_ratio"] < 3.9


@pytest.mark.slow
def test_the_unloaded_finger_hangs_on_no_row_at_the_tendons_end(monkeypatch):
    """Lines through the head made the terminal slip's force 3.3 times as much with finer rows."""

    def terminal(quads: int) -> float:
        case = load_case("fingertip_fibres_edc", [f"hood.mesh.quads={quads}"])
        models, rest = settled(Setting(case.setting_key(), case, lambda stage: None))
        return float(np.linalg.norm(models.hood.group_forces(rest.response.state)["terminal_slip"]))

    before = terminal(600)
    with_rows_halved(monkeypatch, CENTRAL_END, LATERAL_END)
    assert terminal(601) == pytest.approx(before, rel=0.05)


# The mesh file


def small() -> dict:
    """The content of a valid mesh file with two quads."""
    points = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0.1], [0, 1, 0], [1, 1, 0], [2, 1, 0]]) * 1e-3
    one = np.array([0, 3])
    mesh = HoodMesh(
        points,
        np.array([[0, 1, 4, 3], [1, 2, 5, 4]]),
        np.array([2, 3]),
        np.tile([1.0, 0, 0], (2, 1)),
        {"central": one, "radial": one[:1], "ulnar": one[1:]},
        {"central_slip": Attachment("middle", np.array([2, 5]), points[[2, 5]])},
        {"distal": np.array([1])},
        np.arange(6.0),
        dict.fromkeys(JOINTS, 0.1),
        0.0426,
        0.65e-3,
    )
    return json.loads(to_json(mesh))


@pytest.mark.parametrize("across", ["linear", "quadratic"])
def test_a_written_mesh_is_read_again(across, tmp_path):
    mesh = mesh_of(250, across)
    write(mesh, tmp_path / "hood.json")
    again = read(tmp_path / "hood.json")
    for name, value in vars(mesh).items():
        if isinstance(value, np.ndarray):
            assert getattr(again, name) == pytest.approx(
                value, abs=1e-7 if name == "points" else 1e-5
            )
    assert again.rest_posture == pytest.approx(mesh.rest_posture)
    for name in ENDS:
        assert np.array_equal(again.ends[name], mesh.ends[name])
    for name in SPRINGS:
        one, other = again.springs[name], mesh.springs[name]
        assert one.body == other.body
        assert np.array_equal(one.nodes, other.nodes)
        assert one.anchors == pytest.approx(other.anchors, abs=1e-7)
        assert one.shares == pytest.approx(other.shares, abs=1e-7)
    assert list(tmp_path.iterdir()) == [tmp_path / "hood.json"]


MISSING = object()
FAULTS = [
    (("format",), "hood mesh 2", 'expected "format"'),
    (("quads",), MISSING, "quads: expected rows of 4 numbers"),
    (("points", 1, 2), float("nan"), "points: row 1 holds a value that is not finite"),
    (("points", 1), [0, 1], "points: expected rows of 3 numbers"),
    (("points",), "none", "points: expected rows of 3 numbers"),
    (("points", 1, 2), 1e7, "points: row 1 holds a number above 1e+06; lengths are in mm"),
    (("points", 1, 2), 10**400, "points: expected rows of 3 numbers"),
    (("points", 5), [1, 0, 0], "quads: quad 1 is folded or has no area"),
    (("quads", 1), [1, 5, 2, 4], "quads: quad 1 is folded"),
    (("quads", 1), [1, 4, 5, 2], "quads: two quads run from node 1 to node 4"),
    (("quads", 1), [1, 2, 5, 4, 0, 3], "quads: expected rows of 4 numbers"),
    (("quads", 1, 0), 6, "quads: expected whole numbers of nodes, 0 to 5"),
    (("quads", 1, 0), 0.5, "quads: expected whole numbers"),
    (("quads",), [[0, 1, 4, 3]], "regions: expected a list of 1 names"),
    (("regions", 1), "elbow", "quad 1: unknown region 'elbow'; known are extensor_tendon"),
    (("fibre",), [[1, 0, 0]], "fibre: expected one direction for each of 2 quads"),
    (("fibre", 1), [0, 0, 0], "fibre: quad 1 has no direction"),
    (("fibre", 1), [0, 0, 2], "fibre: quad 1: the direction stands upright"),
    (("reach",), "far", "reach: expected numbers"),
    (("thickness",), -0.65, "thickness: must be positive, got -0.65 mm"),
    (("station",), [1, 2], "station: expected one number for each of 6 nodes"),
    (("ends",), {"central": [0]}, "ends: expected central, radial, ulnar; got central"),
    (("ends", "radial"), [7], "ends.radial: expected whole numbers of nodes"),
    (("tied",), {"distal": [3]}, "tied.distal: node 3 is also in ends; leave it in one"),
    (("tied",), {"distal": [2]}, "tied.distal: node 2 is also in springs.central_slip"),
    (("tied",), {"thumb": [0]}, 'tied: unknown name "thumb"; known are metacarpal'),
    (("springs", "central_slip", "body"), "thumb", "springs.central_slip.body: unknown name"),
    (("springs", "central_slip", "anchors"), [[0, 0, 0]], "2 nodes but 1 anchors"),
    (("springs", "central_slip", "shares"), [1], "2 nodes but 1 shares"),
    (("springs", "central_slip", "shares"), [1, 0], "shares: must be above 0 and at most 1, got 0"),
    (("springs", "central_slip", "shares"), [0.5, 2], "at most 1, got 2"),
    (("springs", "central_slip", "shares"), "even", "shares: expected numbers"),
    (("springs",), [], "springs: expected a table"),
    (("rest_posture_deg", "PIP"), "bent", "rest_posture_deg: expected numbers"),
]


def changed(content: dict, path: tuple, value: object) -> dict:
    place = content
    for key in path[:-1]:
        place = place[key]
    if value is MISSING:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return content


@pytest.mark.parametrize(("path", "value", "message"), FAULTS)
def test_a_faulty_mesh_file_is_refused(tmp_path, path, value, message):
    file = tmp_path / "mesh.json"
    file.write_text(json.dumps(changed(small(), path, value)))
    with pytest.raises(InputError, match=r"mesh\.json") as caught:
        read(file)
    assert message in str(caught.value)


def test_a_quad_that_crosses_itself_is_found_however_its_corners_are_lifted():
    random = np.random.default_rng(0)
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    many = np.tile(square, (200, 1, 1))
    many[:, :, 2] = random.uniform(-0.15, 0.15, (200, 4))
    assert not folded(many).any()
    assert folded(many[:, [0, 1, 3, 2]]).all()
    reflex = square.copy()
    reflex[2] = [0.4, 0.4, 0.0]
    assert folded(reflex[None]).all()


def test_a_hood_in_two_pieces_is_refused(tmp_path):
    content = small()
    content["points"] += [[x + 5, y, z] for x, y, z in content["points"]]
    content["quads"] += [[n + 6 for n in quad] for quad in content["quads"]]
    for key in ("regions", "fibre", "station"):
        content[key] *= 2
    (tmp_path / "two.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"2 pieces \(node 6 is not joined to node 0"):
        read(tmp_path / "two.json")


@pytest.mark.parametrize("text", ["", "[]", "{", '{"format": "hood mesh 1"}', "[" * 5000])
def test_a_file_that_is_no_mesh_is_refused(tmp_path, text):
    (tmp_path / "none.json").write_text(text)
    with pytest.raises(InputError, match=r"none\.json"):
        read(tmp_path / "none.json")
    with pytest.raises(InputError, match=r"absent\.json"):
        read(tmp_path / "absent.json")


def places(value: object, path: tuple = ()) -> list[tuple]:
    """Every key and index of a JSON value."""
    inner = value.items() if isinstance(value, dict) else enumerate(value)
    out = []
    for key, item in inner:
        out.append((*path, key))
        if isinstance(item, dict | list):
            out += places(item, (*path, key))
    return out


VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=8)
    | st.just(10**400),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=6,
)


@pytest.fixture(scope="module")
def scratch(tmp_path_factory):
    return tmp_path_factory.mktemp("mesh") / "mesh.json"


@settings(max_examples=400)
@given(st.sampled_from(places(small())), VALUES | st.just(MISSING))
def test_any_value_anywhere_is_read_or_refused(scratch, path, value):
    """What is read can be computed with."""
    scratch.write_text(json.dumps(changed(small(), path, value)))
    try:
        mesh = read(scratch)
    except InputError as error:
        assert "mesh.json" in str(error)
        return
    directors = node_directors(mesh.points, mesh.quads)
    tables = shell_tables(
        mesh.points[mesh.quads], directors[mesh.quads], mesh.fibre, np.zeros(len(mesh.quads))
    )
    assert np.isfinite(tables.offset).all()


# The shell behind the port
