"""`cosim lesion`: a finger before and after, in a page and as tables."""

from __future__ import annotations

import csv
import io
import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from scipy.spatial import ConvexHull
from typer.testing import CliRunner

from cosim.analyses.lesion import TIPS
from cosim.cli import app
from cosim.commands import lesion as lesion_commands
from cosim.report import lesion_page
from cosim.report.lesion_page import (
    PIXEL,
    RunPair,
    limit_sentences,
    outline,
    same_layout,
    tables_of_lesion,
)
from cosim.report.tables import as_csv, as_markdown
from cosim.report.views import BoneSurface, Sheet
from cosim.report.words import question
from cosim.results.read import read_run

SHEET = "isometric_edc_transversely_isotropic"
COARSE = "hood.mesh.quads=120"
QUICK = "output.picture=false"
read = cache(read_run)
"""For runs that no test changes."""


def lesion(folder: Path, *arguments: str, code: int = 0) -> str:
    page = ["--page", str(folder / "page.html")] if "--page" not in arguments else []
    alone = ["--workers", "1"] if "--workers" not in arguments else []
    words = ["lesion", *arguments, *page, *alone, "--out", str(folder / "runs")]
    answer = CliRunner().invoke(app, words)
    assert answer.exit_code == code, answer.output
    return answer.output


@pytest.fixture(scope="module")
def sheet(tmp_path_factory) -> tuple[Path, str]:
    folder = tmp_path_factory.mktemp("lesion")
    settings = ('lesion.cut=["lateral_band_ulnar"]', COARSE, QUICK)
    said = lesion(folder, SHEET, *(part for s in settings for part in ("--set", s)))
    return folder, said


def rows_of(page: str, key: str) -> list[list[str]]:
    """Those that the page shows, then those that it folds."""
    tables = re.findall(rf'data-table="{key}(?:_more)?">.*?<tbody>(.*?)</table>', page, re.S)
    assert tables
    rows = re.findall(r"<tr>(.*?)</tr>", "".join(tables), re.S)
    return [re.findall(r"<td[^>]*?(?: data-value=\"([^\"]*)\")?>(.*?)</td>", row) for row in rows]


def test_the_page_shows_both_sides_and_their_difference(sheet):
    folder, said = sheet
    page = (folder / "page.html").read_text(encoding="utf-8")
    for tip in ("free", "held"):
        runs = [read(folder / "runs" / f"{SHEET}_{s}_{tip}") for s in ("before", "after")]
        rows = {cells[0][1]: cells for cells in rows_of(page, tip)}
        for joint in ("PIP", "DIP"):
            shown = [float(value) for value, _ in rows[f"{joint} angle"][2:]]
            angles = [run.summary["posture_deg"][joint] for run in runs]
            assert shown == pytest.approx([*angles, angles[1] - angles[0]], abs=1e-12)
        assert "lesion" not in runs[0].case_table
        assert runs[1].case_table["lesion"]["cut"] == ["lateral_band_ulnar"]
        assert ("fingertip force, distal" in rows) == (tip == "held")
    assert "DIP angle" in said
    words = re.sub(r"base64,[A-Za-z0-9+/=]+", "", page)  # a picture holds any letters
    assert "nan" not in words.lower().replace("finance", "")
    assert not re.search(r"(src|href)=\"(http|//)", page)


def test_the_page_lays_what_each_part_carries_beside_its_strength(sheet):
    page = (sheet[0] / "page.html").read_text(encoding="utf-8")
    run = read(sheet[0] / "runs" / f"{SHEET}_after_free")
    rows = {cells[0][1]: cells for cells in rows_of(page, "strength_free")}
    carried = run.summary["region_force_N"]["central_band"]
    assert float(rows["central band, middle"][2][0]) == pytest.approx(carried, abs=1e-12)
    assert float(rows["central slip, insertion"][3][0]) == 89.0
    assert rows["terminal slip, middle"][4][1] == "no strength in print"


def test_the_page_draws_two_postures_and_four_maps_on_one_scale(sheet):
    page = (sheet[0] / "page.html").read_text(encoding="utf-8")
    assert len(re.findall(r'<img alt="Postures', page)) == 2
    assert len(re.findall(r'<img alt="Green-Lagrange', page)) == 1
    maps = re.findall(r'<g aria-label="(.*?)">(.*?)</g>', page, re.S)
    assert [name for name, _ in maps] == [
        f"{side}, fingertip {tip}" for tip in ("free", "held") for side in ("before", "after")
    ]
    quads = [len(re.findall("<title>", drawn)) for _, drawn in maps]
    assert quads[0] == quads[2] > quads[1] == quads[3]  # one row is severed


def test_maps_have_one_scale_and_frame_the_parts_of_the_lesion(sheet, monkeypatch):
    pictures = []

    def keep(picture, dpi):
        pictures.append(picture)
        return ""

    monkeypatch.setattr(lesion_page, "picture_address", keep)
    runs = [read(sheet[0] / "runs" / f"{SHEET}_{side}_free") for side in ("before", "after")]
    pair = RunPair("free", *runs)
    lesion_page.lesion_page("title", ["cut"], ["lateral_band_ulnar"], [pair])
    panels = pictures[-1].axes[:2]
    for axes in panels:
        quads, frame = axes.collections
        assert quads.get_clim() == panels[0].collections[0].get_clim()
        assert to_hex(frame.get_edgecolor()[0]) == "#c2410c"
        assert len(frame.get_segments()) > 4
        assert axes.xaxis_inverted()  # distal to the left


def test_that_the_joints_were_freed_and_what_a_surgeon_sees_is_said_first(sheet):
    """The held index finger may turn by 5 deg, where a lesion would move next to nothing."""
    folder, said = sheet
    run = read(folder / "runs" / f"{SHEET}_after_free")
    assert "joints_at_limit" not in run.summary
    first = said.partition("DIP angle")[0]
    page = (folder / "page.html").read_text(encoding="utf-8")
    for text in (first, page):
        assert "holds each joint within 5 deg" in text
        assert "The intact finger stands at MCP" in text
    assert "What a surgeon would see" in page


@pytest.mark.parametrize(("torque", "is_said"), [(12.0, True), (0.0, False)])
def test_only_a_limit_that_bears_something_is_said(sheet, torque, is_said):
    """The end of a range of motion bears nothing of its own."""
    runs = [read(sheet[0] / "runs" / f"{SHEET}_{side}_free") for side in ("before", "after")]
    at = {"MCP": {"limit_torque_Nmm": torque}}
    at_limit = [replace(run, summary={**run.summary, "joints_at_limit": at}) for run in runs]
    said = list(limit_sentences([RunPair("free", *at_limit)]))
    assert any("at its limits (MCP)" in text for text in said) == is_said
    assert list(limit_sentences([RunPair("held", *at_limit)])) == []


def test_the_lesion_is_told_in_a_report_of_the_run_alone(sheet):
    run = read(sheet[0] / "runs" / f"{SHEET}_after_free")
    assert dict(question(run))["Lesion"] == "lateral band ulnar cut"
    whole = read(sheet[0] / "runs" / f"{SHEET}_before_free")
    assert "Lesion" not in dict(question(whole))


@pytest.fixture(scope="module")
def sheetless(tmp_path_factory) -> tuple[str, list[RunPair]]:
    """The page of a network without its central slip, and its four runs."""
    folder = tmp_path_factory.mktemp("network")
    settings = ('lesion.cut=["central_slip"]', QUICK, 'tendons.FDP.tension="1 N"')
    lesion(folder, "network_edc", *(part for s in settings for part in ("--set", s)))
    run = {
        (tip, side): read_run(folder / "runs" / f"network_edc_{side}_{tip}")
        for tip in TIPS
        for side in ("before", "after")
    }
    page = (folder / "page.html").read_text(encoding="utf-8")
    return page, [RunPair(tip, run[tip, "before"], run[tip, "after"]) for tip in TIPS]


def test_a_hood_without_a_sheet_has_postures(sheetless):
    page, _ = sheetless
    assert "there is no strain to map" in page
    assert "central slip" in page
    assert len(re.findall(r'<img alt="Postures', page)) == 2


def test_a_hood_without_a_sheet_has_tables(sheetless):
    tables = tables_of_lesion(sheetless[1])
    cells = {
        (r["table"], r["of"], r["column"]): r["value"]
        for r in csv.DictReader(io.StringIO(as_csv(tables)))
    }
    key = ("free", "force in the central slip")
    assert float(cells[(*key, "after")]) == 0.0
    assert float(cells[(*key, "before")]) == -float(cells[(*key, "after less before")]) > 0
    assert "## Fingertip held" in as_markdown(tables)


@pytest.mark.parametrize("form", ["csv", "json", "md"])
def test_the_command_writes_the_tables_that_are_asked_for(tmp_path, monkeypatch, sheetless, form):
    monkeypatch.setattr(lesion_commands, "_solve_runs", lambda case, out, workers: sheetless[1])
    out = tmp_path / f"table.{form}"
    given = ("network_edc", "--set", 'lesion.cut=["central_slip"]')
    lesion(tmp_path, *given, "--format", form, "--page", str(out))
    text = out.read_text(encoding="utf-8")
    tables = tables_of_lesion(sheetless[1])
    if form == "json":
        assert set(json.loads(text)["tables"]) == {"free", "held"}
    else:
        assert text == {"csv": as_csv, "md": as_markdown}[form](tables)


@pytest.mark.slow
def test_the_tables_are_the_same_for_any_number_of_workers(tmp_path):
    given = ("network_edc", "--set", 'lesion.cut=["central_slip"]', "--set", QUICK)
    texts = []
    for workers in ("1", "2"):
        page = tmp_path / f"{workers}.csv"
        how = ("--format", "csv", "--page", str(page), "--workers", workers)
        lesion(tmp_path / workers, *given, *how)
        texts.append(page.read_bytes())
    assert texts[0] == texts[1]


@pytest.mark.parametrize(("form", "name"), [("json", "page.html"), ("html", "page.csv")])
@pytest.mark.parametrize("more", [(), ("--repairs", "mallet")])
def test_a_name_that_tells_another_form_is_refused(tmp_path, form, name, more):
    given = ("lesion_mallet", "--format", form, "--page", str(tmp_path / name), *more)
    assert f"expected a name that ends in .{form}" in lesion(tmp_path, *given, code=2)
    assert not list(tmp_path.iterdir())


def test_a_case_without_a_lesion_is_refused(tmp_path):
    assert "has no table [lesion]" in lesion(tmp_path, "split_edc", code=2)
    assert not (tmp_path / "page.html").exists()


def test_what_does_not_converge_is_named_and_leaves_no_page(tmp_path):
    settings = ("solve.max_iterations=1", 'lesion.cut=["central_slip"]')
    given = [part for s in settings for part in ("--set", s)]
    said = lesion(tmp_path, "two_band_edc", *given, code=1)
    assert "two_band_edc_before_free: " in said
    assert not (tmp_path / "page.html").exists()


def test_an_outline_is_the_bone_s_own():
    """Of a box that is turned by 90 degrees in the sagittal plane."""
    x, y, z = np.meshgrid(np.linspace(0, 0.02, 60), [-3e-3, 3e-3], [-1e-3, 2e-3], indexing="ij")
    box = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    turn = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    faces = ConvexHull(box).simplices
    bone = BoneSurface("box", box, faces, np.array([[0.1, 0, 0.0]]), turn[None])
    drawn = outline(bone, -1)
    assert drawn.min(axis=0) == pytest.approx([0.099, -0.02], abs=4e-4)
    assert drawn.max(axis=0) == pytest.approx([0.102, 0.0], abs=4e-4)
    x, y = drawn[:-1].T
    area = 0.5 * abs(float(np.sum(x * np.roll(y, 1) - y * np.roll(x, 1))))
    assert area == pytest.approx(0.02 * 3e-3, rel=0.15)


def test_an_outline_of_a_bone_with_few_vertices_is_in_one_piece():
    """A tetrahedron, whose sides have no vertices between their ends."""
    corners = 1e-3 * np.array([[0, 0, 0], [20, 0, 0], [0, 5, 0], [0, 0, 8.0]])
    faces = np.array([[0, 1, 2], [0, 1, 3], [1, 2, 3], [0, 2, 3]])
    bone = BoneSurface("tetrahedron", corners, faces, np.zeros((1, 3)), np.eye(3)[None])
    drawn = outline(bone, 0)
    assert np.array_equal(drawn[0], drawn[-1])
    assert np.linalg.norm(np.diff(drawn, axis=0), axis=1).max() < 2 * PIXEL
    x, z = drawn[:-1].T
    area = 0.5 * abs(float(np.sum(x * np.roll(z, 1) - z * np.roll(x, 1))))
    assert area == pytest.approx(0.5 * 0.02 * 0.008, rel=0.1)


def test_a_part_of_a_sheet_lies_where_the_whole_does():
    points = np.array([[i, j, 0.0] for i in range(4) for j in range(2)]) * 1e-3
    flat = points[:, :2] + 1.0
    blank = Sheet(np.zeros((0, 4), dtype=int), (), flat, (0,), points[None], ())
    part = Sheet(blank.quads, (), np.zeros((4, 2)), (0,), points[None, 2:6], ())
    assert same_layout(part, points[2:6], blank, points) == pytest.approx(flat[2:6])
    moved = points[2:6] + 1e-4
    assert same_layout(part, moved, blank, points) is part.flat
