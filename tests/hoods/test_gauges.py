"""Points and gauges of the user's own on a sheet."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cosim
from cosim.hoods.shell.gauges import _nearest_points, place_gauges

COARSE = {"hood.mesh.quads": 150, "output.picture": False}
TRIANGLE = np.array([[[0.0, 0, 0], [2.0, 0, 0], [0.0, 1, 0]]])
NUMBERS = st.floats(-3, 3)


@given(NUMBERS, NUMBERS, NUMBERS)
def test_no_other_point_of_a_triangle_is_nearer(x, y, z):
    point = np.array([x, y, z])
    (weights,), (distance,) = _nearest_points(point, TRIANGLE)
    assert (weights >= -1e-12).all()
    assert weights.sum() == pytest.approx(1.0)
    assert np.linalg.norm(weights @ TRIANGLE[0] - point) == pytest.approx(distance)
    u, v = np.meshgrid(np.linspace(0, 1, 60), np.linspace(0, 1, 60))
    inside = u + v <= 1
    grid = u[inside, None] * TRIANGLE[0, 1] + v[inside, None] * TRIANGLE[0, 2]
    assert distance <= np.linalg.norm(grid - point, axis=1).min() + 1e-12


def test_a_gauge_on_a_sheet_that_is_stretched_has_its_strain():
    sheet = np.array([[0.0, 0, 0], [2.0, 0, 0], [2.0, 1, 0], [0.0, 1, 0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    dots = {"a": (0.25, 0.5, 1e-3), "b": (1.75, 0.5, -1e-3), "c": (0.25, 0.9, 0.0)}
    found = place_gauges(dots, {"along": ("a", "b"), "across": ("a", "c")}, sheet, triangles)
    longer = sheet * [1.1, 0.97, 1.0]
    strain = found.strain(longer, sheet)
    assert strain == {"along": pytest.approx(10.0), "across": pytest.approx(-3.0)}
    moved = found.displacements(longer, sheet)["b"]
    assert moved == pytest.approx({"distal": 175.0, "radial": -15.0, "dorsal": 0.0})


@pytest.fixture(scope="module")
def runs() -> tuple[cosim.Result, cosim.Result, np.ndarray, tuple[int, int]]:
    """A hood without points, the same with two of its nodes named, its undeformed nodes, and which
    they are."""
    case = cosim.load("isometric_edc").replace(COARSE)
    plain = cosim.run(case)
    laid = plain.hood.points - plain.hood.point_data["displacement"]
    line = [int(np.argmin(np.hypot(laid[:, 1], laid[:, 0] - x))) for x in (0.02, 0.03)]
    named = {
        name: [f"{1e3 * value:.9f} mm" for value in laid[i]]
        for name, i in zip("ab", line, strict=True)
    }
    dotted = case.replace({"hood.points": named, "hood.gauges": {"g": ["a", "b"]}})
    return plain, cosim.run(dotted), laid, (line[0], line[1])


def test_points_change_nothing_and_move_with_the_sheet(runs):
    plain, dotted, laid, (i, j) = runs
    np.testing.assert_array_equal(plain.data.node, dotted.data.node)
    before, after = (plain.data.node.sel(state=s).values for s in ("unloaded", "loaded"))
    moved = dotted.summary["point_displacement_mm"]["a"]
    assert list(moved.values()) == pytest.approx(1e3 * (after[i] - laid[i]), abs=1e-5)

    def length(x: np.ndarray) -> float:
        return float(np.linalg.norm(x[j] - x[i]))

    strain = dotted.summary["gauge_strain_percent"]["g"]
    assert strain == pytest.approx(100 * (length(after) / length(laid) - 1), abs=1e-5)
    change = dotted.summary["difference"]["gauge_strain_percent"]["g"]
    assert change == pytest.approx(100 * (length(after) / length(before) - 1), abs=1e-5)


def test_a_gauge_is_compared_with_what_was_measured(runs, tmp_path):
    _, dotted, _, _ = runs
    path = tmp_path / "dots.csv"
    path.write_text("quantity,value,sd\ndifference.gauge_strain_percent.g,2,1\n")
    (row,) = cosim.compare(dotted, data=path).itertuples()
    assert row.unit == "%"
    assert row.model == dotted.summary["difference"]["gauge_strain_percent"]["g"]


def test_a_point_off_the_hood_and_a_gauge_without_its_point_are_refused():
    case = cosim.load("isometric_edc").replace(COARSE)
    off = case.replace({"hood.points": {"a": ["0 mm", "0 mm", "50 mm"]}})
    with pytest.raises(cosim.InputError, match=r"hood\.points\.a: is .* mm off .* nearest point"):
        cosim.run(off)
    dots = {"dot": ["0 mm", "0 mm", "9 mm"]}
    for ends, words in ((["dto", "dot"], "did you mean dot"), (["dot", "dot"], "both ends")):
        with pytest.raises(cosim.InputError, match=words):
            case.replace({"hood.points": dots, "hood.gauges": {"g": ends}})
