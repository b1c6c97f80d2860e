"""The hood mesh's file: written whole, read again, or refused with the place of its fault."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim.case.file import load_case
from cosim.errors import InputError
from cosim.models.build import hood_mesh
from fe_solver.elements.mesh_geometry import node_directors
from fe_solver.elements.shell import shell_tables
from meshes.hood_mesh import ENDS, SPRINGS, Attachment, HoodMesh, are_folded, read, to_json, write
from meshes.skeleton import JOINTS


def mesh_of(quads: int, elements: str = "linear") -> HoodMesh:
    settings = [f"hood.mesh.quads={quads}", f'hood.mesh.elements="{elements}"']
    return hood_mesh(load_case("isometric_edc", settings))


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


@pytest.mark.parametrize("elements", ["linear", "quadratic"])
def test_a_written_mesh_is_read_again(elements, tmp_path):
    mesh = mesh_of(250, elements)
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


def test_fields_of_directions_are_read_again_or_refused(tmp_path):
    content = small() | {"fields": {"slips": [[1, 1, 0], [2, 0, 0.1]]}}
    path = tmp_path / "hood.json"
    path.write_text(json.dumps(content))
    mesh = read(path)
    assert mesh.fields["slips"][0] == pytest.approx([0.5**0.5, 0.5**0.5, 0])
    write(mesh, path)
    assert read(path).fields["slips"] == pytest.approx(mesh.fields["slips"], abs=1e-5)
    for rows, words in (
        ([[1, 0, 0]], "one direction for each of 2"),
        ([[1, 0, 0], [0, 0, 0]], "quad 1 has no direction"),
        ([[1, 0, 0], [0, 0, 1]], "stands upright"),
    ):
        path.write_text(json.dumps(content | {"fields": {"slips": rows}}))
        with pytest.raises(InputError, match=rf"fields\.slips.*{words}"):
            read(path)


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


def change(content: dict, path: tuple, value: object) -> dict:
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
    file.write_text(json.dumps(change(small(), path, value)))
    with pytest.raises(InputError, match=r"mesh\.json") as caught:
        read(file)
    assert message in str(caught.value)


def test_a_quad_that_crosses_itself_is_found_however_its_corners_are_lifted():
    random = np.random.default_rng(0)
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    many = np.tile(square, (200, 1, 1))
    many[:, :, 2] = random.uniform(-0.15, 0.15, (200, 4))
    assert not are_folded(many).any()
    assert are_folded(many[:, [0, 1, 3, 2]]).all()
    reflex = square.copy()
    reflex[2] = [0.4, 0.4, 0.0]
    assert are_folded(reflex[None]).all()


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
    scratch.write_text(json.dumps(change(small(), path, value)))
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
