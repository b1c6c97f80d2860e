"""Points and gauges of the user's own on a sheet."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cosim
from cosim.errors import ReadingWarning
from cosim.hoods.shell.gauges import _lay_grid, _nearest_points, place_gauges, strain_between
from cosim.hoods.shell.point_table import GridConfig, read_points

SHEET = "isometric_edc_transversely_isotropic"
COARSE = {"hood.mesh.quads": 120, "output.picture": False}
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


def test_a_grid_on_a_sheet_that_is_stretched_has_its_strains_in_both_directions():
    sheet = np.array([[0.0, 0, 0], [2.0, 0, 0], [2.0, 1, 0], [0.0, 1, 0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    dots = {f"{i}{j}": (0.5 * i, 0.4 * j, 0.0) for i in range(4) for j in range(3)}
    found = replace(
        place_gauges(dots, {}, sheet, triangles), grids={"net": np.arange(12).reshape(4, 3)}
    )
    along, across = found.grid_strains(sheet * [1.1, 0.97, 1.0], sheet)["net"]
    assert 100 * along == pytest.approx(np.full((3, 3), 10.0))
    assert 100 * across == pytest.approx(np.full((4, 2), -3.0))


@pytest.fixture(scope="module")
def runs() -> tuple[cosim.Result, cosim.Result, np.ndarray, tuple[int, int]]:
    """A hood without points, the same with two of its nodes named, its undeformed nodes, and which
    they are."""
    case = cosim.load(SHEET).replace(COARSE)
    plain = cosim.run(case)
    laid = plain.hood.points - plain.hood.point_data["displacement"]
    line = [int(np.argmin(np.hypot(laid[:, 1], laid[:, 0] - x))) for x in (0.02, 0.03)]
    named = {
        name: [f"{1e3 * value:.9f} mm" for value in laid[i]]
        for name, i in zip("ab", line, strict=True)
    }
    grid = {"distal": ["10 mm", "30 mm"], "radial": ["-2 mm", "2 mm"], "count": [3, 2]}
    gauges = {"g": ["a", "b"], "first": ["net_1_1", "net_2_1"], "row": ["net_3_1", "net_3_2"]}
    dotted = case.replace({"hood.points": named, "hood.gauges": gauges, "hood.grids.net": grid})
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


def test_a_grid_spans_the_gauges_between_its_neighbours(runs):
    _, dotted, _, _ = runs
    for said in (dotted.summary, dotted.summary["difference"]):
        net, gauge = said["grid_strain_percent"]["net"], said["gauge_strain_percent"]
        for direction, name in (("longitudinal", "first"), ("lateral", "row")):
            low, mean, high = (net[direction][s] for s in ("min", "mean", "max"))
            assert low <= mean <= high
            assert low - 1e-9 <= gauge[name] <= high + 1e-9
        rows = dotted.summary["grid_strain_percent"]["net"]["lateral"]
        assert rows["min"] < rows["max"]


def test_a_gauge_is_compared_with_what_was_measured(runs, tmp_path):
    _, dotted, _, _ = runs
    path = tmp_path / "dots.csv"
    path.write_text("quantity,value,sd\ndifference.gauge_strain_percent.g,2,1\n")
    (row,) = cosim.compare(dotted, data=path).itertuples()
    assert row.unit == "%"
    assert row.model == dotted.summary["difference"]["gauge_strain_percent"]["g"]


def test_a_point_off_the_hood_and_a_gauge_without_its_point_are_refused():
    case = cosim.load(SHEET).replace(COARSE)
    off = case.replace({"hood.points": {"a": ["0 mm", "0 mm", "50 mm"]}})
    with pytest.raises(cosim.InputError, match=r"hood\.points\.a: is .* mm off .* nearest point"):
        cosim.run(off)
    dots = {"dot": ["0 mm", "0 mm", "9 mm"]}
    for ends, words in ((["dto", "dot"], "did you mean dot"), (["dot", "dot"], "both ends")):
        with pytest.raises(cosim.InputError, match=words):
            case.replace({"hood.points": dots, "hood.gauges": {"g": ends}})


@given(st.lists(st.floats(-0.3, 0.3), min_size=8, max_size=8))
def test_the_strain_between_two_states_is_that_of_the_way_from_one_to_the_other(entries):
    first, last = np.eye(2) + np.reshape(entries, (2, 2, 2))

    def strain(F: np.ndarray) -> np.ndarray:
        E = (F.T @ F - np.eye(2)) / 2
        return np.array([[E[0, 0], E[1, 1], 2 * E[0, 1]]])

    along = first[:, 0] / np.linalg.norm(first[:, 0])
    axes = np.column_stack([along, [-along[1], along[0]]])
    way = last @ np.linalg.inv(first) @ axes
    E = (way.T @ way - np.eye(2)) / 2
    (found,) = strain_between(strain(first), strain(last))
    assert found == pytest.approx([E[0, 0], E[1, 1], E[0, 1]], abs=1e-9)


DOTS = """# ink dots, as photographed
name, distal_mm, radial_mm, dorsal_cm
a, 20, -1.5, 0.9

"b", 28.5, 0, 0.8
"""


def test_points_are_read_from_a_table(tmp_path):
    path = tmp_path / "dots.csv"
    path.write_text(DOTS, encoding="utf-8-sig")
    found = read_points(path)
    assert list(found) == ["a", "b"]
    assert found["a"] == pytest.approx((0.02, -0.0015, 0.009))
    path.write_text("name;dorsal_m;radial_um;distal_mm\nc;0.009;-20;4\n")
    assert read_points(path)["c"] == pytest.approx((0.004, -2e-5, 0.009))


def test_further_columns_of_points_are_left_out_and_told(tmp_path):
    path = tmp_path / "points.csv"
    path.write_text("name,distal [mm],radial_mm,dorsal_mm,strain\na,1,2,3,0.1\n")
    with pytest.warns(ReadingWarning, match="line 1: left out: strain"):
        assert read_points(path) == {"a": pytest.approx((1e-3, 2e-3, 3e-3))}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", r"dots\.csv: is empty; its first line names the columns, for example name,distal_mm"),
        ("name,distal_mm,radial_mm,dorsal_mm\n", "has no point below the names"),
        ("name,distal_mm,radial_mm\na,1,2\n", "line 1: has no column of dorsal"),
        ("name,distal_mm,radial_mm,z_mm\na,1,2,3\n", "line 1: has no column of dorsal"),
        ("name,distal,radial_mm,dorsal_mm\na,1,2,3\n", "column 'distal'.* with a unit"),
        ("name,distal_N,radial_mm,dorsal_mm\na,1,2,3\n", "column 'distal_N'"),
        ("name,distal_mm,distal_m,dorsal_mm\na,1,2,3\n", "two columns are of distal"),
        (DOTS + "c,1,two,0.3\n", "line 6: radial_mm is 'two'; expected a finite"),
        (DOTS + "c,1,2,30\n", "line 6, dorsal: 30 cm must be 200 mm or less"),
        (DOTS + "a,1,2,0.3\n", "line 6: two points are called a"),
        (DOTS + ",1,2,0.3\n", "line 6: '' is no name of a point"),
        (DOTS + "p.1,1,2,0.3\n", r"line 6: 'p\.1' is no name of a point: expected .* slashes"),
    ],
)
def test_a_table_of_points_that_is_wrong_is_refused_with_its_line(tmp_path, text, words):
    path = tmp_path / "dots.csv"
    path.write_text(text)
    with pytest.raises(cosim.InputError, match=words):
        read_points(path)
    with pytest.raises(cosim.InputError, match=words) as found:
        cosim.load("isometric_edc").replace({"hood.points_file": str(path)})
    assert str(found.value).count("\n") == 1  # one fault, on its line


def test_a_table_of_points_that_cannot_be_read_is_refused(tmp_path):
    with pytest.raises(cosim.InputError, match=r"hood\.points_file.* no such file"):
        cosim.load("isometric_edc").replace({"hood.points_file": str(tmp_path / "none.csv")})


def grid(count: tuple[int, int] = (3, 2), low: str = "0 mm", high: str = "10 mm") -> GridConfig:
    ends = {"distal": (low, high), "radial": ("-1 mm", "1 mm")}
    return GridConfig.model_validate({**ends, "count": count})


def test_a_grid_lies_on_the_face_that_a_camera_sees():
    """On a slope dorsal = 0.2 distal, above another sheet."""
    flat = np.array([[-1e-2, -1e-2, 0], [2e-2, -1e-2, 0], [2e-2, 1e-2, 0], [-1e-2, 1e-2, 0]])
    upper = flat + np.outer(flat[:, 0], [0, 0, 0.2]) + [0, 0, 0.01]
    corners = np.concatenate([s[t] for s in (flat, upper) for t in ([[0, 1, 2], [0, 2, 3]],)])
    laid = grid()
    found = dict(zip(laid.names("g"), _lay_grid("g", laid, corners), strict=True))
    assert list(found) == ["g_1_1", "g_1_2", "g_2_1", "g_2_2", "g_3_1", "g_3_2"]
    assert found["g_1_1"] == pytest.approx([0, -1e-3, 0.01])
    assert found["g_3_2"] == pytest.approx([1e-2, 1e-3, 0.012])
    with pytest.raises(cosim.InputError, match=r"hood\.grids\.g: 2 of 6 points are not over"):
        _lay_grid("g", grid(high="30 mm"), corners)


def test_a_grid_that_is_none_and_too_many_points_are_refused():
    case = cosim.load("isometric_edc")
    sides = {"distal": ["0 mm", "9 mm"], "radial": ["-1 mm", "1 mm"]}
    for table, words in (
        ({**sides, "count": [100, 30]}, "3000 points in all; at most 2500"),
        ({**sides, "count": [1, 3]}, "greater than or equal to 2"),
        ({**sides, "count": [2, 3], "distal": ["9 mm", "0 mm"]}, "distal: the second end must be"),
    ):
        with pytest.raises(cosim.InputError, match=words):
            case.replace({"hood.grids": {"g": table}})
    with pytest.raises(cosim.InputError, match="two points are called g_1_1"):
        case.replace(
            {
                "hood.grids": {"g": {**sides, "count": [2, 3]}},
                "hood.points": {"g_1_1": ["0 mm", "0 mm", "9 mm"]},
            }
        )


GRID = {"distal": ["19 mm", "24 mm"], "radial": ["-1 mm", "1 mm"], "count": [3, 2]}


@pytest.fixture(scope="module")
def listed(runs, tmp_path_factory) -> tuple[Path, cosim.Result]:
    """A case file that names the dots of `runs` in a table beside it, and a grid; and its run."""
    _, _, laid, nodes = runs
    folder = tmp_path_factory.mktemp("dots")
    rows = [
        f"{name},{','.join(f'{1e3 * v:.9f}' for v in laid[i])}"
        for name, i in zip("ab", nodes, strict=True)
    ]
    (folder / "dots.csv").write_text("\n".join(["name,distal_mm,radial_mm,dorsal_mm", *rows]))
    path = folder / "dotted.toml"
    path.write_text(
        f'extends = "{SHEET}"\ntitle = "dots"\noutput.picture = false\n'
        "hood.mesh.quads = 120\n"
        'hood.points_file = "dots.csv"\nhood.gauges.g = ["a", "b"]\nhood.gauges.k = '
        '["a", "grid_3_2"]\n[hood.grids.grid]\n'
        + "\n".join(f"{key} = {value}" for key, value in GRID.items())
    )
    return path, cosim.run(cosim.load(path))


def test_points_of_a_table_are_those_of_a_case(runs, listed):
    (_, dotted, _, _), (_, found) = runs, listed
    for part in (found.summary, found.summary["difference"]):
        same = dotted.summary if part is found.summary else dotted.summary["difference"]
        for name in "ab":
            for key in ("point_displacement_mm", "point_strain_percent"):
                assert part[key][name] == pytest.approx(same[key][name], abs=1e-6)
        assert part["gauge_strain_percent"]["g"] == pytest.approx(
            same["gauge_strain_percent"]["g"], abs=1e-6
        )


def test_a_grid_has_the_strains_of_the_quads_beneath(listed):
    _, found = listed
    names = found.data.hood_point.values.tolist()
    assert names == ["a", "b", *(f"grid_{i}_{j}" for i in (1, 2, 3) for j in (1, 2))]
    strain = found.data.hood_point_strain.sel(state="loaded", hood_point="grid_2_1")
    told = found.summary["point_strain_percent"]["grid_2_1"]
    assert list(told) == strain.surface_component.values.tolist()
    assert list(told.values()) == pytest.approx(100 * strain.values)
    position = found.data.hood_point_position.sel(hood_point="grid_2_1")
    laid = position.sel(state="loaded").values - 1e-3 * np.array(
        list(found.summary["point_displacement_mm"]["grid_2_1"].values())
    )
    assert laid[:2] == pytest.approx([21.5e-3, -1e-3], abs=1e-8)
    # its tendon is along the fibres, which are the lines of the mesh there
    corners = found.data.node.sel(state="loaded").values[found.data.quad_node.values]
    inside = [
        (part <= 1e-4).all(axis=1)
        for place in [position.sel(state="loaded").values]
        for part in (corners.min(axis=1) - place, place - corners.max(axis=1))
    ]
    (near,) = np.flatnonzero(inside[0] & inside[1])
    along, across, shear = found.data.strain.sel(state="loaded").values[near]
    assert strain.values == pytest.approx([along, across, shear / 2], abs=1e-12)


def test_a_strain_of_the_surface_is_compared_with_what_was_measured(listed, tmp_path):
    _, found = listed
    path = tmp_path / "measured.csv"
    rows = [
        "difference.point_strain_percent.grid_1_1.longitudinal,2,1",
        "point_displacement_mm.a.palmar,2,1",
    ]
    path.write_text("quantity,value,sd\n" + "\n".join(rows))
    strain, moved = cosim.compare(found, data=path).itertuples()
    change = found.summary["difference"]["point_strain_percent"]["grid_1_1"]
    assert (strain.unit, strain.model) == ("%", change["longitudinal"])
    assert moved.model == -found.summary["point_displacement_mm"]["a"]["dorsal"]
    path.write_text("quantity,value\npoint_strain_percent.grid_1_1.along,2\n")
    with pytest.raises(cosim.InputError, match=r"did you mean point_strain_percent\.grid_1_1\."):
        cosim.compare(found, data=path)


@pytest.mark.slow
def test_a_modulus_is_fitted_to_the_strains_of_a_grid(listed, tmp_path):
    """The run's own strains give back the modulus that it was run with."""
    path, found = listed
    names = [f"grid_{i}_{j}" for i in (1, 2, 3) for j in (1, 2)]
    rows = [
        f"difference.point_strain_percent.{name}.longitudinal,"
        f"{found.summary['difference']['point_strain_percent'][name]['longitudinal']},0.01"
        for name in names
    ]
    targets, free = tmp_path / "measured.csv", tmp_path / "free.toml"
    targets.write_text("quantity,value,sd\n" + "\n".join(rows))
    key = "hood.regions.central_band.modulus_along={value}"
    free.write_text(f'[E]\nlow = 60\nhigh = 180\nstart = 90\nunit = "MPa"\nsettings = ["{key}"]\n')
    fit = cosim.identify(path, targets, free, most=6)
    truth = cosim.load(path).hood.regions["central_band"].modulus_along
    assert 1e6 * fit.values["E"] == pytest.approx(truth, rel=2e-2)


def test_a_motion_leaves_the_path_of_each_point(listed):
    path, _ = listed
    short = {
        "finger.tip": {"kind": "free"},
        "finger.limit": {"half_range": "40 deg", "damping": "0.01 N*m*s/deg"},
        "forward": {"duration": "4 ms", "must_rest": False},
    }
    moved = cosim.run(cosim.load(path).replace(short))
    way = moved.data.hood_point_position
    assert way.dims == ("time", "hood_point", "axis")
    assert (way.sizes["time"], way.sizes["hood_point"]) == (5, 8)
    moves = np.linalg.norm(np.diff(way.values, axis=0), axis=-1)
    assert (moves[1:] > 0).all()  # the scheme's pose of the first step is that at rest
    # the end is where the summary's displacement leads from where the dots were laid
    dots = read_points(path.parent / "dots.csv")
    for name, place in dots.items():
        step = np.array(list(moved.summary["point_displacement_mm"][name].values()))
        end = way.sel(hood_point=name).values[-1]
        assert end == pytest.approx(place + 1e-3 * step, abs=1e-8)
    a, b = (way.sel(hood_point=name).values[-1] for name in "ab")
    length = np.linalg.norm(np.subtract(dots["b"], dots["a"]))
    assert moved.summary["gauge_strain_percent"]["g"] == pytest.approx(
        100 * (np.linalg.norm(b - a) / length - 1), abs=1e-4
    )
    (row,) = cosim.compare(moved, data=_measured(path.parent)).itertuples()
    assert row.model == moved.summary["gauge_strain_percent"]["g"]


def _measured(folder: Path) -> Path:
    path = folder / "end.csv"
    path.write_text("quantity,value,sd\ngauge_strain_percent.g,2,1\n")
    return path
