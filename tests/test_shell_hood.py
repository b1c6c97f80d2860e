"""The hood on the bones: its mesh and mesh file, and what the shell does behind the port.

The port's own promises are in test_conformance."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import shells
from hypothesis import given, settings
from hypothesis import strategies as st
from test_conformance import index_motions

from cosim.build import hood_mesh
from cosim.case import load_case
from cosim.port import STATIC, ConvergenceError, InputError, Motion, Response
from fe_solver.fields import contact_pressure, fields
from fe_solver.hood_model import ContactLaw, Sheet, Tendon, node_directors, shell_hood
from fe_solver.materials import Isotropic
from fe_solver.newton import NewtonOptions
from fe_solver.section import one_law
from fe_solver.shell import shell_tables
from fe_solver.shell_hood import TIE, ShellHood
from meshes.hood_mesh import ENDS, REGIONS, SPRINGS, Attachment, HoodMesh, read, to_json, write
from meshes.skeleton import BODIES, JOINTS

TENSION = np.array([3.0, 1.0, 0.8, 0.5])


def mesh_of(quads: int) -> HoodMesh:
    return hood_mesh(load_case("isometric_edc", [f"hood.mesh.quads={quads}"]))


@pytest.fixture(scope="module")
def mesh() -> HoodMesh:
    return mesh_of(250)


@pytest.fixture(scope="module")
def hood() -> ShellHood:
    return shells.index_hood()


@pytest.fixture(scope="module")
def motion() -> Motion:
    return index_motions()[1]


@pytest.fixture(scope="module")
def solved(hood: ShellHood, motion: Motion) -> Response:
    return hood.advance(hood.start(motion), motion, TENSION, STATIC)


# The generated mesh


def test_the_generator_repeats_itself(mesh):
    assert to_json(mesh_of(250)) == to_json(mesh)


@pytest.mark.parametrize("quads", [250, 600, 2400])
def test_about_as_many_quads_as_asked_for(quads):
    assert len(mesh_of(quads).quads) == pytest.approx(quads, rel=0.02)


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


def test_a_written_mesh_is_read_again(mesh, tmp_path):
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


def test_tied_and_guided_nodes_are_on_their_places(hood, solved, motion):
    c, model = solved.state.configuration, hood.model
    for held in (model.ties, model.guides):
        local = np.einsum(
            "kji,kj->ki", motion.rotation[held.body], c.x[held.node] - motion.position[held.body]
        )
        if held is model.ties:
            assert local == pytest.approx(held.position, abs=1e-15)
            d = np.einsum("kij,kj->ki", motion.rotation[held.body], held.director)
            assert c.d[held.node] == pytest.approx(d, abs=1e-14)
        else:
            beside = np.cross(local - held.origin, held.direction)
            assert beside == pytest.approx(np.zeros_like(beside), abs=1e-15)
    assert np.linalg.norm(c.d, axis=1) == pytest.approx(np.ones(len(c.d)), abs=1e-14)


def test_tendons_pull_along_the_metacarpal(hood, solved, motion):
    load = solved.load
    proximal = -motion.rotation[0][:, 0]
    assert load.pull[:, :3] == pytest.approx(np.outer(TENSION, proximal), abs=1e-12)
    moved = (solved.state.configuration.x - hood.model.reference) @ proximal
    turned = hood.rest.rotation[0] @ motion.rotation[0].T
    assert turned == pytest.approx(np.eye(3))  # the metacarpal is the world's
    nodes = hood.model.guides.node
    assert solved.excursion == pytest.approx(hood.model.share @ moved[nodes], abs=1e-15)


def test_the_ledger_is_complete(hood, solved):
    forces = solved.load.wrench[..., :3].sum(axis=0)
    groups = hood.group_forces(solved.state)
    assert set(groups) == {*hood.groups, TIE}
    for name, force in groups.items():
        assert forces[hood.sources.index(name)] == pytest.approx(force, abs=1e-12)
    model, c = hood.model, solved.state.configuration
    assert hood.gap(solved.state).min() > -model.contacts[0].smoothing
    area = np.full(len(c.x), np.inf)
    for k in model.contacts:
        area[k.nodes] = k.area
    pressed = contact_pressure(model, c)[np.isfinite(area)] @ area[np.isfinite(area)]
    contact = np.linalg.norm(forces[hood.sources.index("contact")])
    assert 0 < contact <= pressed


def test_strain_is_the_fields(hood, solved):
    weight = hood.model.tables.weight
    mean = np.einsum("ng,ngc->nc", weight, hood.strain(solved.state)) / weight.sum(1)[:, None]
    seen = fields(hood.model, solved.state.configuration)
    assert seen.strain == pytest.approx(mean[:, :3], abs=1e-14)
    assert 0.005 < seen.strain[:, 0].max() < 0.2


def test_a_moved_hand_needs_no_iteration(hood, solved, motion):
    """The prediction is exact for a shift of the whole hand: guides, ties and free nodes alike."""
    shifted = motion.moved(np.eye(3), np.array([1e-3, -2e-3, 3e-3]))
    response = hood.advance(solved.state, shifted, TENSION, STATIC)
    assert response.state.iterations == solved.state.iterations
    assert response.excursion == pytest.approx(solved.excursion, abs=1e-12)


def test_a_small_turn_is_foreseen(hood, solved, motion):
    """From a known state a small turn takes fewer iterations than from afresh."""
    twist = np.zeros((4, 6))
    twist[1:, 4] = 2e-3
    near = hood.advance(solved.state, motion.displaced(twist), TENSION, STATIC)
    afresh = hood.advance(hood.start(motion), motion.displaced(twist), TENSION, STATIC)
    assert near.state.iterations - solved.state.iterations <= 5 < afresh.state.iterations
    wrench = afresh.load.wrench
    assert near.load.wrench == pytest.approx(wrench, abs=1e-6 * np.abs(wrench).max())


def test_a_loose_hood_stops_earlier_near_the_same_state(hood, solved, motion):
    loose = hood.loosely(1e-2)
    response = loose.advance(loose.start(motion), motion, TENSION, STATIC)
    assert response.state.iterations < solved.state.iterations
    assert response.load.total() == pytest.approx(solved.load.total(), abs=0.1)
    assert hood.loosely(1e-14).options == hood.options


def test_a_longer_terminal_slip_leaves_the_central_slip_more(hood, solved, motion):
    def central(extra: str) -> float:
        other = shells.index_hood(f"hood.extra_length.terminal_slip={extra}")
        response = other.advance(other.start(motion), motion, TENSION, STATIC)
        return float(np.linalg.norm(other.group_forces(response.state)["central_slip"]))

    laid = float(np.linalg.norm(hood.group_forces(solved.state)["central_slip"]))
    assert central("-0.5 mm") < 0.5 * laid
    assert central("0.5 mm") > 1.1 * laid


def test_extra_length_is_the_slips(hood, mesh):
    """The slip's stress-free area grows in proportion to its length."""
    extra = 0.5e-3
    longer = shells.index_hood("hood.extra_length.terminal_slip=0.5 mm")
    ratio = longer.model.tables.weight.sum(axis=1) / hood.model.tables.weight.sum(axis=1)
    slip = mesh.cells("terminal_slip")
    assert ratio[~slip] == pytest.approx(np.ones((~slip).sum()))
    length = extra / (ratio[slip] - 1)
    assert length == pytest.approx(np.full(slip.sum(), 10e-3), rel=0.1)  # 63 to 73 mm


def test_a_state_that_was_not_solved_has_no_derivatives(hood, motion):
    with pytest.raises(InputError, match="call advance first"):
        hood.jacobian(hood.start(motion))


def test_what_cannot_be_solved_is_an_error_that_names_a_node(hood, motion):
    hasty = replace(hood, options=NewtonOptions(max_iterations=1))
    with pytest.raises(ConvergenceError, match=r"node \d+ at"):
        hasty.advance(hasty.start(motion), motion, TENSION, STATIC)


def test_a_hood_that_nothing_holds_is_refused(motion):
    X, quads = shells.plate(10e-3, 4e-3, 2, 1)
    section = one_law(Isotropic(1e8, 0.3), np.full(2, 5e-4))
    sheet = Sheet(X, quads, np.tile([1.0, 0, 0], (2, 1)), section, np.zeros(2))
    carried = np.tile([1.0, 0, 0, 0], (6, 1))
    end = {"EDC": Tendon(np.array([0, 1]), np.array([0.5, 0.5]))}
    law = ContactLaw(1e11, 5e-5, {}, {})
    pull, options = np.array([-1.0, 0, 0]), NewtonOptions()
    for tied in ({}, {"distal": np.zeros(0, dtype=np.intp)}):
        with pytest.raises(InputError, match=r"no insertion holds the hood.*hood\.springs"):
            shell_hood(sheet, motion, carried, {}, tied, BODIES[0], pull, end, law, options)
    held = {"distal": np.array([4, 5])}
    hood = shell_hood(sheet, motion, carried, {}, held, BODIES[0], pull, end, law, options)
    assert hood.sources == (TIE, "contact", "guide")


@pytest.mark.parametrize("setting", ['penetration="1 um"', "friction=0.2"])
def test_augmented_contact_does_not_penetrate_and_balances(motion, setting):
    """Over the bones' splines, whose gradients are not quite unit vectors."""
    hood = shells.index_hood(f"hood.contact.{setting}")
    first = hood.advance(hood.start(motion), motion, TENSION, STATIC)
    second = hood.advance(first.state, motion, 1.1 * TENSION, STATIC)
    for response in (first, second):
        assert -1e-6 <= hood.gap(response.state).min() < 1e-6
        total = response.load.wrench.sum(axis=(0, 1))[:3] - response.load.pull[:, :3].sum(axis=0)
        assert np.abs(total).max() < 1e-8
    again = hood.advance(first.state, motion, 1.1 * TENSION, STATIC)
    assert np.array_equal(again.load.wrench, second.load.wrench)
    rubbing = first.state.solution.model.contacts[1].grip
    assert (rubbing is not None and rubbing.limit.max() > 0) == setting.startswith("friction")
