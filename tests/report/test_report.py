"""Run folders as tables, views and still drawings."""

from __future__ import annotations

import csv
import io
import json
import re
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cosim.case.file import load_case
from cosim.cli import app
from cosim.errors import InputError
from cosim.json_text import json_text
from cosim.pipeline import run_case
from cosim.report.drawings import Arrow, arrows_of, plane, sagittal
from cosim.report.flat import flatten_sheet
from cosim.report.histories import charts_of
from cosim.report.page import write_report
from cosim.report.tables import last_ledger, tables_of
from cosim.report.views import box, difference_view, limits, pack_views, view_of
from cosim.report.words import answer, closure, commands, doubts, question, tendon_pulls, trust
from cosim.results.read import read_run, read_runs
from tests.helpers.report_runs import DATA, run_into, write_motion_run, write_swinging_run

QUICK = "output.picture=false"


read = cache(read_run)
"""For runs that no test changes."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("runs")


@pytest.fixture(scope="module")
def hood(folder) -> Path:
    return run_into(folder, "isometric_edc", "hood.mesh.quads=120", QUICK)


@pytest.fixture(scope="module")
def split(folder) -> Path:
    return run_into(folder, "split_edc", QUICK)


@pytest.fixture(scope="module")
def motion(folder, hood) -> Path:
    return write_motion_run(hood, folder / "moved")


@pytest.fixture
def data(tmp_path) -> Path:
    path = tmp_path / "data.csv"
    path.write_text(DATA, encoding="utf-8")
    return path


def cylinder(radius=6e-3, length=40e-3, rows=15, columns=9, bent=0.0):
    """A part of a cylinder along x over its dorsal side, and its true laid-out coordinates."""
    x, angle = np.meshgrid(
        np.linspace(0, length, rows), np.linspace(-1.2, 1.2, columns), indexing="ij"
    )
    points = np.stack([x, radius * np.sin(angle), radius * np.cos(angle)], axis=-1).reshape(-1, 3)
    true = np.stack([x, radius * angle], axis=-1).reshape(-1, 2)
    i, j = np.meshgrid(np.arange(rows - 1) * columns, np.arange(columns - 1), indexing="ij")
    a = (i + j).ravel()
    return points, np.stack([a, a + columns, a + columns + 1, a + 1], axis=-1), true


def test_a_cylinder_is_laid_out_true_to_length():
    points, quads, true = cylinder()
    flat = flatten_sheet(points, quads)
    chord = 6e-3 * 2 * np.sin(0.15)  # of the polygon that the sheet is
    assert flat[:, 0] == pytest.approx(true[:, 0], abs=1e-9)
    assert flat[:, 1] == pytest.approx(true[:, 1] * chord / (6e-3 * 0.3), abs=1e-9)


def test_what_a_sheet_is_laid_out_as_does_not_hang_on_how_its_quads_turn():
    points, quads, _ = cylinder()
    flat = flatten_sheet(points, quads)
    assert flatten_sheet(points, quads[:, ::-1]) == pytest.approx(flat, abs=1e-9)


def test_a_hood_is_laid_out_without_a_fold_and_nearly_true(hood):
    shape = read(hood).hood
    assert shape is not None
    reference = shape.points - shape.point_data["displacement"]
    flat = flatten_sheet(reference, shape.quads)[shape.quads]
    diagonal = [flat[:, 2] - flat[:, 0], flat[:, 3] - flat[:, 1]]
    signed = diagonal[0][:, 0] * diagonal[1][:, 1] - diagonal[0][:, 1] * diagonal[1][:, 0]
    solid = reference[shape.quads]
    true = np.linalg.norm(np.cross(solid[:, 2] - solid[:, 0], solid[:, 3] - solid[:, 1]), axis=1)
    assert np.all(np.sign(signed) == np.sign(signed[0]))
    assert np.percentile(np.abs(np.abs(signed) / true - 1), 90) < 0.1


def test_two_pieces_are_laid_out_beside_each_other():
    points, quads, _ = cylinder()
    both = flatten_sheet(
        np.concatenate([points, points]), np.concatenate([quads, quads + len(points)])
    )
    one, two = both[: len(points), 1], both[len(points) :, 1]
    assert one.max() < two.min()
    assert np.ptp(one) == pytest.approx(np.ptp(two))


def test_a_folder_that_is_no_run_is_refused(tmp_path, hood):
    with pytest.raises(InputError, match="is not the folder of a run"):
        read_run(tmp_path)
    for name in ("results.nc", "summary.json", "case.toml", "ledger.csv", "hood.vtu"):
        broken = tmp_path / name
        shutil.copytree(hood, broken)
        (broken / name).write_text("= no such thing")
        with pytest.raises(InputError, match=name):
            read_run(broken)


def test_a_run_named_twice_is_refused(hood):
    with pytest.raises(InputError, match="named twice"):
        read_runs([hood, hood / ".." / hood.name])


def test_runs_of_one_name_are_told_apart(tmp_path, hood):
    shutil.copytree(hood, tmp_path / "again" / hood.name)
    names = [run.name for run in read_runs([hood, tmp_path / "again" / hood.name])]
    assert names[1] == f"again/{hood.name}"
    assert len(set(names)) == 2


def test_runs_of_one_name_in_folders_of_one_name_are_told_apart(tmp_path, hood):
    folders = [tmp_path / above / "runs" / hood.name for above in ("before", "after")]
    for folder in folders:
        shutil.copytree(hood, folder)
    names = [run.name for run in read_runs(folders)]
    assert names == [f"{above}/runs/{hood.name}" for above in ("before", "after")]


def test_the_tables_say_what_the_summary_says(hood):
    run = read(hood)
    tables = {table.key: table for table in tables_of([run], None)}
    outcome = {row[0]: row[2:] for row in tables["outcome"].rows}
    summary = run.summary
    assert outcome["fingertip force, dorsal"] == (
        summary["fingertip_force_N"]["dorsal"],
        summary["unloaded"]["fingertip_force_N"]["dorsal"],
    )
    assert outcome["torque of the hood, PIP"] == tuple(
        state["joint_torque_Nmm"]["hood"]["PIP"] for state in (summary, summary["unloaded"])
    )
    (change,) = (r for r in tables["difference"].rows if r[0] == "fingertip force, dorsal")
    assert change[2] == summary["difference"]["fingertip_force_N"]["dorsal"]
    numbers = {row[0]: row[2] for row in tables["numbers"].rows}
    assert (
        numbers["unloaded.moment_arm_mm.EDC.PIP"]
        == summary["unloaded"]["moment_arm_mm"]["EDC"]["PIP"]
    )
    audit = {row[0]: row[1:] for row in tables["audit_0"].rows}
    assert audit["reciprocity"] == (summary["audit"]["reciprocity"], 1e-3, "kept")


def test_an_audit_that_was_missed_is_shown(hood):
    run = read(hood)
    missed = replace(
        run, summary={**run.summary, "audit_missed": ["reciprocity", "posture_in_range"]}
    )
    (audit,) = (t for t in tables_of([missed], None) if t.key == "audit_0")
    said = {row[0]: row[3] for row in audit.rows}
    assert (said["reciprocity"], said["posture in range"]) == ("missed", "missed")
    assert any("reciprocity" in doubt for doubt in doubts(missed))


def test_a_ledger_closes_in_the_table(hood):
    (table,) = (t for t in tables_of([read(hood)], None) if t.key == "ledger_0")
    sums = {row[0]: row[2:] for row in table.rows if row[1] == "sum"}
    assert set(sums) == {"metacarpal", "proximal", "middle", "distal"}
    for body in sums:
        assert np.abs(np.array(sums[body], dtype=float)).max() < 1e-6
    said = re.search(r"within (\S+) N", closure(read(hood)))
    assert said is not None
    assert float(said[1].replace("−", "-")) < 1e-6
    hood_on_middle = last_ledger(read(hood))["middle"]["hood central_slip"]
    assert hood_on_middle[2] > 0, "the central slip pulls the bent middle phalanx dorsally"


def test_against_another_run_there_are_differences(hood, split):
    run, other = read_runs([hood, split])
    (table,) = (t for t in tables_of([run], other) if t.key == "outcome")
    row = next(row for row in table.rows if row[0] == "fingertip force, distal")
    assert row[4] == pytest.approx(row[2] - row[3], abs=0)
    slip = next(row for row in table.rows if row[0] == "force in the central slip")
    assert slip[4] == pytest.approx(slip[2] - slip[3], abs=0)


def test_against_may_be_one_of_the_runs(hood, split, tmp_path):
    text = write_report([hood, split], None, "json", hood)
    assert text == write_report([hood, split], None, "json", hood.parent / "." / hood.name)
    rows = json.loads(text)
    assert [run["case"] for run in rows["runs"]] == ["isometric_edc", "split_edc"]
    write_report([split], tmp_path / "page.html", "html", split)
    assert (tmp_path / "page.html").is_file()


def test_frames_hold_bones_tendons_and_hood(hood):
    run = read(hood)
    view = view_of(run)
    assert view.frames == ("unloaded", "loaded")
    assert view.sheet is not None
    assert view.sheet.at == (0, 1)
    middle = next(bone for bone in view.bones if bone.name == "middle")
    stored = run.data.position.sel(body="middle").values
    assert middle.position == pytest.approx(stored, abs=1e-12)
    assert view.notes == ()
    carried = run.summary["slip_force_N"]
    assert view.slips[-1]["central slip"] == pytest.approx(carried["central"], rel=1e-6)
    along = view.sheet.fields[0].values[-1]
    assert along == pytest.approx(100 * run.data.strain.values[-1, :, 0])
    by_key = {field.key: field.values[-1] for field in view.sheet.fields}
    for key, name, factor in (
        ("along", "longitudinal_strain", 100),
        ("across", "transverse_strain", 100),
        ("shear", "shear_strain", 100),
        ("stress_along", "fibre_stress", 1e-6),
        ("stress_across", "transverse_stress", 1e-6),
        ("energy_density", "strain_energy_density", 1e-3),
        ("thickness_stretch", "thickness_stretch", 1),
    ):
        assert by_key[key] == pytest.approx(factor * run.hood.cell_data[name])
    assert by_key["pressure"] == pytest.approx(1e-6 * run.hood.point_data["contact_pressure"])


@pytest.mark.slow
def test_a_nine_node_element_is_shown_as_four_quads(tmp_path):
    nine = 'hood.mesh.elements="quadratic"'
    run = read_run(run_into(tmp_path, "isometric_edc", "hood.mesh.quads=120", nine, QUICK))
    sheet = view_of(run).sheet
    assert len(sheet.quads) == 4 * run.data.sizes["quad"] == len(sheet.region)
    along = sheet.fields[0].values[-1]
    assert along == pytest.approx(100 * run.hood.cell_data["longitudinal_strain"])
    assert along[::4] == pytest.approx(100 * run.data.strain.values[-1, :, 0])
    assert all(f.values.shape[1] == len(sheet.quads) for f in sheet.fields if f.on_quads)


def test_a_motion_shows_its_hood_at_its_end_with_the_same_fields(motion, hood):
    moved, still = view_of(read(motion)), view_of(read(hood))
    assert moved.frames == ("0 s", "0.25 s")
    assert moved.sheet is not None
    assert still.sheet is not None
    assert moved.sheet.at == (1,)
    assert "at its end only" in moved.notes[0]
    for one, other in zip(moved.sheet.fields, still.sheet.fields, strict=True):
        assert one.values[-1] == pytest.approx(other.values[-1], abs=1e-12)


def test_a_run_without_a_hood_says_so(split):
    view = view_of(read(split))
    assert view.sheet is None
    assert "no deformable hood" in view.notes[0]
    assert len(view.bones) == 4
    assert limits([view]) == {}


def test_a_case_that_cannot_be_built_again_costs_the_bones_alone(tmp_path, hood):
    shutil.copytree(hood, tmp_path / "run")
    case = tmp_path / "run" / "case.toml"
    case.write_text(case.read_text().replace('kind = "index"', 'kind = "seventh"', 1))
    view = view_of(read_run(tmp_path / "run"))
    assert view.bones == ()
    assert "cannot be built again" in view.notes[0]
    assert view.sheet is not None
    assert json.dumps(pack_views([view], [limits([view])]))


def test_the_box_holds_every_frame_of_a_motion(tmp_path, hood):
    view = view_of(read_run(write_swinging_run(hood, tmp_path / "swing")))
    room = box(view)
    assert room is not None
    low, high = room.T
    for k in range(len(view.frames)):
        shown = [b.vertices @ b.rotation[k].T + b.position[k] for b in view.bones]
        shown += [*view.tendons[k].values(), view.tip[k : k + 1]]
        for points in shown:
            assert np.all((points > low) & (points < high)), view.frames[k]
    reach = np.stack([b.vertices @ b.rotation[1].T + b.position[1] for b in view.bones[-1:]])
    assert reach[..., 0].max() > high[0] - 5e-3, "the second moment reaches farthest"
    without_bones = replace(view, bones=(), tip=np.zeros((0, 3)))
    assert box(without_bones) is not None
    assert box(replace(without_bones, tendons=({},) * len(view.frames), sheet=None)) is None


def test_a_difference_of_fields(hood):
    view = view_of(read(hood))
    assert view.sheet is not None
    doubled = tuple(replace(f, values=2 * f.values) for f in view.sheet.fields)
    gap = difference_view(replace(view, sheet=replace(view.sheet, fields=doubled)), view)
    assert gap is not None
    assert gap.sheet is not None
    assert gap.sheet.fields[0].values == pytest.approx(view.sheet.fields[0].values)
    other_mesh = replace(view.sheet, quads=view.sheet.quads[:-1])
    assert difference_view(view, replace(view, sheet=other_mesh)) is None
    assert difference_view(view, replace(view, frames=("a", "b"))) is None


def test_the_view_packs_what_runs_share_once(hood, motion):
    views = [view_of(read(hood)), view_of(read(motion))]
    content = pack_views(views, [limits(views)] * 2)
    assert len(content["surfaces"]) == 4
    assert content["views"][1]["bones"][2]["surface"] == content["views"][0]["bones"][2]["surface"]


def test_arrows_are_those_of_the_run_and_of_its_data(hood, data):
    from cosim.results.compare import read_targets

    run = read_run(hood, read_targets(data))
    arrows = arrows_of([run])
    assert [arrow.letter for arrow in arrows] == ["A", "B", "C", "D"]
    assert arrows[2].tip == tuple(
        run.summary["difference"]["fingertip_force_N"][a] for a in ("distal", "dorsal")
    )
    assert (arrows[3].tip, arrows[3].sd) == ((0.24, 0.09), (0.05, 0.08))
    (axes,) = sagittal(arrows).axes
    assert {type(patch).__name__ for patch in axes.patches} == {"Ellipse"}
    assert {tuple(patch.center) for patch in axes.patches} == {(0.24, 0.09)}
    letters = [text.get_text() for text in axes.texts if text.get_text()]
    assert letters == ["A", "B", "C", "D"]
    assert plane(arrows).count(" N in the plane") == 4


def test_distal_is_to_the_left_and_dorsal_up():
    picture = sagittal([Arrow("A", "one", (1.0, 2.0), "#000")])
    picture.draw_without_rendering()
    (axes,) = picture.axes
    start, end = axes.transData.transform([(0.0, 0.0), (1.0, 2.0)])
    assert end[0] < start[0]
    assert end[1] > start[1]
    assert (end[1] - start[1]) / (start[0] - end[0]) == pytest.approx(2.0, abs=0.01)
    shafts = [text for text in axes.texts if not text.get_text()]
    assert {text.xy for text in shafts} == {(1.0, 2.0)}
    assert {text.xyann for text in shafts} == {(0, 0)}


def test_sentences(hood, split):
    run, other = read_runs([hood, split])
    assert tendon_pulls(run) == "EDC with 3.469 N"
    assert tendon_pulls(replace(run, case_text="")) == ""
    assert dict(question(run))["Fingertip"] == "held at a point, free to turn"
    assert "central slip carries" in answer(run)
    assert "terminal slip carries 1.81 N" in answer(other)
    told = commands([run], other)
    assert "cosim run isometric_edc.toml --out runs" in told
    assert "--against runs/split_edc" in told


def test_csv_json_and_markdown_hold_the_same(hood, data):
    form = {f: write_report([hood], None, f, None, data) for f in ("json", "csv", "md")}
    tables = json.loads(form["json"])["tables"]
    cells = {
        (row["table"], int(row["row"]), row["column"]): row["value"]
        for row in csv.DictReader(io.StringIO(form["csv"]))
    }
    for key, table in tables.items():
        assert f"## {table['title']}" in form["md"]
        for n, row in enumerate(table["rows"], 1):
            for column, value in list(zip(table["columns"], row, strict=True))[1:]:
                shown = cells[key, n, column]
                assert shown == ("" if value is None else str(value))
    verdicts = [row[9] for row in tables["comparison_0"]["rows"]]
    assert verdicts.count("outside") >= 1
    assert len(verdicts) == 4


def test_the_command(hood, tmp_path, data):
    runner = CliRunner()
    out = tmp_path / "deep" / "report.json"
    done = runner.invoke(app, ["show", str(hood), "-o", str(out)])
    assert done.exit_code == 0, done.output
    assert json.loads(out.read_text(encoding="utf-8"))["runs"][0]["case"] == "isometric_edc"
    assert [path.name for path in out.parent.iterdir()] == ["report.json"]
    page = str(tmp_path / "page.html")
    for wrong in (
        ["show", str(tmp_path), "-o", page],
        ["show", str(hood), "-o", page, "--data", str(tmp_path / "absent.csv")],
        ["show", str(hood), "--format", "md", "-o", str(tmp_path)],
        ["show", str(hood), "-o", page, "--against", str(tmp_path)],
    ):
        refused = runner.invoke(app, wrong)
        assert refused.exit_code == 2
        said = refused.stderr.splitlines()
        assert said[-1].startswith("cosim: ")
        assert len(said) <= 2  # after the stage, where it came so far


def test_rows_for_a_case_of_which_no_run_is_reported_are_counted(hood, tmp_path, data):
    rows = tmp_path / "data.csv"
    rows.write_text(DATA.replace("isometric_edc", "isometric_ecd"), encoding="utf-8")
    words = ["show", str(hood), "--data", str(rows), "--format", "csv"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0
    note = f"note: {rows}: rows for the case isometric_ecd, of which no run is reported: 1\n"
    assert done.stderr.splitlines(keepends=True)[-1] == note
    assert "note" not in done.stdout.splitlines()[0]


def test_rows_of_the_runs_own_file_come_first(tmp_path, hood, data):
    from cosim.results.compare import read_targets, write_json

    run = read_run(hood, read_targets(data))
    shutil.copytree(hood, tmp_path / "run")
    write_json(tmp_path / "run" / "comparison.json", run.comparison[2:3])
    again = read_run(tmp_path / "run", read_targets(data))
    assert again.comparison == (run.comparison[2], *run.comparison)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["isometric_edc", "cable_edc", "motion_edc_fdp"])
def test_a_run_in_memory_is_drawn_as_the_same_run_read(case, tmp_path):
    settings = () if case == "cable_edc" else ("hood.mesh.quads=120",)
    short = ('forward.duration="20 ms"', "output.frames=3") if case == "motion_edc_fdp" else ()
    fresh = run_case(load_case(case, (*settings, *short, QUICK)))
    kept = read_run(fresh.save(tmp_path))
    one, other = (pack_views([v], [limits([v])]) for v in map(view_of, (fresh, kept)))
    assert json_text(one) == json_text(other)


def test_the_sentence_of_the_audit_counts_the_rows_of_its_table(hood):
    run = read(hood)
    (audit,) = (t for t in tables_of([run], None) if t.key == "audit_0")
    assert f"All {len(audit.rows)} checks" in trust(run)


def test_charts_of_a_motion_leave_out_what_is_zero_and_torques_add_up(motion):
    run = read(motion)
    charts = {chart.title: chart for chart in charts_of(run, view_of(run))}
    assert {"Joint angles", "Fingertip force", "Tendons", "Slips"} <= set(charts)
    torques = [[*c.curves.values()] for t, c in charts.items() if t.startswith("Torques")]
    assert len(torques) == 4
    largest = max(np.abs(curves).max() for curves in torques)
    for curves in torques:  # up to what is too small to be drawn
        assert np.abs(np.sum(curves, axis=0)).max() < 0.03 * largest
    slips = charts["Slips"].curves
    told = read_run(motion).arrays.variables["hood_force"].values
    assert max(slips["central slip"]) <= np.linalg.norm(told, axis=-1).max() * 1.001
    free = replace(run, arrays=_without_force(run.arrays))
    assert "Fingertip force" not in {c.title for c in charts_of(free, view_of(free))}


def _without_force(arrays):
    force = arrays.variables["tip_force"]
    silent = force._replace(values=0 * force.values)
    return replace(arrays, variables={**arrays.variables, "tip_force": silent})
