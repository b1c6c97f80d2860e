import csv
import json
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from matplotlib.colors import to_rgb
from matplotlib.text import Text

from cosim.case.file import load_case, resolved_toml
from cosim.case.schema import Case
from cosim.errors import InputError
from cosim.hoods.view import STRAIN, HoodField
from cosim.results.audit import describe_misses
from cosim.results.conventions import FRAME, by_axis
from cosim.results.looks import BONE
from cosim.results.parts import LEDGER_HEADER, LedgerRow, Scene
from cosim.results.picture import as_plain_text
from cosim.results.result import Result
from cosim.results.scene import MOST_TRIANGLES, decimate
from cosim.results.scene_plot import VIEWS, draw
from cosim.results.write import with_nan
from tests.helpers.report_runs import arrays_of


def tube(radius: float = 5e-3, length: float = 40e-3, around: int = 24, along: int = 20):
    """A bone: vertices and triangles of an open tube along x."""
    t, x = np.meshgrid(np.arange(around) * 2 * np.pi / around, np.linspace(0, length, along))
    vertices = np.stack([x, radius * np.sin(t), radius * np.cos(t)], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(along - 1), np.arange(around), indexing="ij")
    a, b = i * around + j, i * around + (j + 1) % around
    c, d = b + around, a + around
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    return vertices, faces


def sheet(radius: float = 6.5e-3) -> HoodField:
    """A hood over the tube's dorsal side, 2 % longer at its distal end."""
    x, t = np.meshgrid(np.linspace(0, 40e-3, 21), np.linspace(-1, 1, 9), indexing="ij")
    points = np.stack([x, radius * np.sin(t), radius * np.cos(t)], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(20) * 9, np.arange(8), indexing="ij")
    a = (i + j).ravel()
    quads = np.stack([a, a + 9, a + 10, a + 1], axis=-1)
    strain = 0.02 * points[quads].mean(axis=1)[:, 0] / 40e-3
    return HoodField(points, quads, {"displacement": 0 * points}, {STRAIN: strain})


@pytest.fixture
def result() -> Result:
    tendon = np.array([[-0.02, 0, 0.007], [0, 0, 0.007]])
    tip = (np.array([0.04, 0, 0]), np.array([0.1, 0.0, -0.2]))
    scene = Scene(sheet(), (("proximal", *tube()),), (("EDC", tendon),), tip)
    dataset = xarray.Dataset(
        {"tension": ("tendon", [3.4], {"units": "N"})}, coords={"tendon": ["EDC"]}
    )
    row = LedgerRow(
        "loaded", "proximal", "contact", np.array([1.0, 0, -2.0]), np.array([0, 0.003, 0])
    )
    summary = {"case": "isometric_edc", "fingertip_force_N": by_axis((0.1, 0.2, 0.0))}
    text = resolved_toml(load_case("isometric_edc"))
    return Result(summary, arrays_of(dataset), (row,), scene, text, "isometric_edc")


def test_a_result_reads_back(tmp_path: Path, result):
    import meshio

    case = load_case("isometric_edc")
    folder = result.save(tmp_path / "runs")
    assert folder == tmp_path / "runs" / "isometric_edc"
    assert json.loads((folder / "summary.json").read_text())["fingertip_force_N"] == by_axis(
        (0.1, 0.2, 0)
    )
    with xarray.open_dataset(folder / "results.nc", engine="h5netcdf") as dataset:
        xarray.testing.assert_identical(dataset.load(), result.data)
    with (folder / "ledger.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert tuple(header) == LEDGER_HEADER
    assert rows == [["loaded", "proximal", "contact", "1", "0", "-2", "0", "3", "0", "world"]]
    assert FRAME in (folder / "hood.vtu").read_text()
    mesh = meshio.read(folder / "hood.vtu")
    np.testing.assert_array_equal(mesh.points, result.scene.hood.points)
    np.testing.assert_array_equal(mesh.cells_dict["quad"], result.scene.hood.quads)
    np.testing.assert_array_equal(mesh.cell_data[STRAIN][0], result.scene.hood.cell_data[STRAIN])
    again = load_case(folder / "case.toml")
    assert again.model_copy(update={"name": case.name, "source": case.source}) == case
    assert (folder / "picture.png").read_bytes().startswith(b"\x89PNG")


def test_an_older_run_is_replaced_whole(tmp_path: Path, result):
    result.save(tmp_path)
    plain = resolved_toml(load_case("isometric_edc", ["output.picture=false"]))
    bare = replace(result, scene=Scene(None, (), ()), case_text=plain)
    folder = bare.save(tmp_path)
    assert {p.name for p in folder.iterdir()} == {
        *("summary.json", "case.toml", "results.nc", "ledger.csv")
    }
    assert [p.name for p in tmp_path.iterdir()] == ["isometric_edc"]


def test_a_result_that_cannot_be_written_leaves_the_older_one(tmp_path: Path, result):
    folder = result.save(tmp_path)
    before = (folder / "summary.json").read_text()
    with pytest.raises(TypeError, match="Path is not JSON serializable"):
        replace(result, summary={**result.summary, "wall_s": tmp_path}).save(tmp_path)
    assert (folder / "summary.json").read_text() == before
    assert [p.name for p in tmp_path.iterdir()] == ["isometric_edc"]


def test_an_unwritable_folder_is_the_users_fault(tmp_path: Path, result):
    (tmp_path / "runs").write_text("a file")
    with pytest.raises(InputError, match=r"cannot be written .* --out"):
        result.save(tmp_path / "runs")


def test_what_is_no_run_is_not_replaced(tmp_path: Path, result):
    keep = tmp_path / "isometric_edc" / "thesis.txt"
    keep.parent.mkdir()
    keep.write_text("years of work")
    with pytest.raises(InputError, match="no earlier run"):
        result.save(tmp_path)
    assert keep.read_text() == "years of work"


def polygons(scene: Scene, view: int) -> tuple[np.ndarray, np.ndarray]:
    """Corners (n, 4, 2) and face colours of a view, in the order of drawing."""
    (drawn,) = draw(scene, "x").axes[view].collections
    return np.array([path.vertices[:4] for path in drawn.get_paths()]), drawn.get_facecolor()


def test_views_look_along_their_axes():
    distal, radial, dorsal = np.eye(3) * 1e-3
    side, top = VIEWS
    np.testing.assert_allclose(side.project(distal), [-1, 0, 0])
    np.testing.assert_allclose(side.project(dorsal), [0, 1, 0])
    np.testing.assert_allclose(side.project(radial), [0, 0, 1], err_msg="radial is nearest")
    np.testing.assert_allclose(top.project(radial), [0, -1, 0])
    np.testing.assert_allclose(top.project(dorsal), [0, 0, 1], err_msg="dorsal is nearest")


@pytest.mark.parametrize(("palmar", "hidden"), [(False, False), (True, True)])
def test_what_is_nearer_is_drawn_over_what_lies_behind(result, palmar, hidden):
    hood = result.scene.hood
    turned = hood.points * (np.array([1, 1, -1]) if palmar else 1)
    scene = replace(result.scene, hood=replace(hood, points=turned), tendons=(), tip=None)
    corners, colour = polygons(scene, view=1)
    middle = np.array([20.5, -0.3])
    low, high = corners.min(axis=1), corners.max(axis=1)
    (over,) = np.nonzero(((low <= middle) & (middle <= high)).all(axis=1))
    top = colour[over[-1]]
    bone = to_rgb(BONE)
    is_bone = abs(top[0] / top[2] - bone[0] / bone[2]) < 1e-6
    assert is_bone == hidden


def test_colours_are_strain_in_per_cent_about_zero(result):
    figure = draw(result.scene, "x")
    bar = figure.axes[-1]
    low, high = bar.get_ylim()
    assert low == -high
    assert 1.8 < high < 2.0
    assert "%" in bar.get_ylabel()
    figure.draw_without_rendering()
    label = bar.yaxis.get_label().get_window_extent()
    assert label.x1 < figure.bbox.x1  # whole in the picture, ticks of three digits beside it


def test_the_force_is_named_with_its_magnitude(result):
    assert "force of the fingertip on the world, 0.22 N" in legend_of(draw(result.scene, "x"))


def legend_of(figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_a_large_surface_is_thinned_to_the_same_shape():
    vertices, faces = tube(around=150, along=150)
    coarse, fewer = decimate(vertices, faces)
    assert len(faces) > 4 * MOST_TRIANGLES
    assert 1000 < len(fewer) <= MOST_TRIANGLES
    np.testing.assert_allclose(np.ptp(coarse, axis=0), np.ptp(vertices, axis=0), atol=1e-3)
    radius = np.linalg.norm(coarse[np.unique(fewer)][:, 1:], axis=1)
    np.testing.assert_allclose(radius, 5e-3, atol=3e-4)


def test_numbers_that_are_none_are_null_and_are_read_back(tmp_path: Path, result):
    summary = {
        **result.summary,
        "wall_s": float("nan"),
        "beside": {"a.b": [1.0, -np.inf], "c": np.float64("nan")},
        "audit_missed": ["reciprocity"],
        "audit": {"reciprocity": float("nan")},
    }
    folder = replace(result, summary=summary).save(tmp_path)
    written = json.loads((folder / "summary.json").read_text(), parse_constant=pytest.fail)
    assert written["wall_s"] is None
    assert ["beside", "a.b", 1, "-inf"] in written["not_finite"]
    again = with_nan(written)
    assert np.isnan(again["wall_s"])
    assert again["beside"]["a.b"] == [1.0, -np.inf]
    assert np.isnan(again["beside"]["c"])
    assert "not_finite" not in again
    assert next(describe_misses(again)).startswith("reciprocity is nan, no number")


@pytest.mark.parametrize("where", ["scene_plot.draw", "ledger_plot.draw_ledger"])
@pytest.mark.parametrize("error", [RuntimeError, OSError])
def test_what_is_solved_is_not_lost_to_a_picture(tmp_path: Path, result, monkeypatch, where, error):
    def fail(*_: object) -> None:
        raise error("no font")

    monkeypatch.setattr(f"cosim.results.{where}", fail)
    with pytest.warns(UserWarning, match=r"\.png could not be made \(\w+: no font\)"):
        folder = result.save(tmp_path)
    assert {"summary.json", "results.nc", "hood.vtu"} <= {p.name for p in folder.iterdir()}
    assert len({p.name for p in folder.iterdir()} & {"picture.png", "ledger.png"}) == 1


def test_a_title_is_drawn_as_it_stands(tmp_path: Path, result):
    """A single `$` is no formula that has not ended."""
    for title in (r"then $\frac{1}{$", "$x$ and $", r"100 % \alpha_$"):
        case = case_named(title)
        named = replace(result, case_text=resolved_toml(case))
        texts = [t.get_text() for t in named.plot("ledger").findobj(Text) if not t.get_parse_math()]
        assert any(title in text for text in texts)
        folder = named.save(tmp_path)
        assert {"picture.png", "ledger.png"} <= {p.name for p in folder.iterdir()}


def case_named(title: str) -> Case:
    return load_case("isometric_edc").replace({"title": title})


@pytest.mark.parametrize("title", ["a\0b", "a\x1bb", "half of \ud83d"])
def test_a_text_that_no_file_can_hold_is_refused_when_the_case_is_read(title):
    with pytest.raises(InputError, match=r"title: holds the character U\+[0-9A-F]{4}"):
        case_named(title)


@given(st.text(st.characters(codec="utf-8", categories=("L", "N", "P", "S", "Zs")), min_size=1))
@settings(max_examples=30)
def test_a_name_of_any_letters_is_written_so_that_it_is_read_back(name):
    assume(name.strip() and not set(name) & {".", "/"})
    points = {name: ["20 mm", "0 mm", "9 mm"], f"{name}2": ["28 mm", "0 mm", "8 mm"]}
    hood = {"points": points, "gauges": {f"{name} gap": [name, f"{name}2"]}}
    text = resolved_toml(load_case("isometric_edc").replace({"hood": hood}))
    assert tomllib.loads(text)["hood"]["points"].keys() == points.keys()
    assert tomllib.loads(text)["hood"]["gauges"] == hood["gauges"]


def test_numbers_on_logarithmic_axes_are_plain():
    """Texts are drawn as they stand, so that those of a formula would be shown with its marks."""
    from matplotlib.figure import Figure

    figure = Figure()
    axes = figure.subplots()
    axes.loglog([1e-3, 1e3], [2.0, 8.0])
    as_plain_text(figure)
    figure.draw_without_rendering()
    labels = [*axes.get_xticklabels(), *axes.get_yticklabels(minor=True)]
    texts = {label.get_text() for label in labels}
    assert {"0.001", "1", "1000"} <= texts
    assert not any("$" in text for text in texts)
