"""The thesis, computed anew: its rows, what they are judge_rows by, and its page."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from cosim.case.file import load_case
from cosim.cli import app
from cosim.papers import thesis, thesis_models, thesis_published
from cosim.papers.thesis import studies
from cosim.papers.thesis_models import (
    EXCESS,
    INTEGRATED,
    MODULI,
    MUSCLES,
    OVER_ALONE,
    input_numbers,
)
from cosim.papers.thesis_rows import (
    STATES,
    TITLES,
    Relation,
    ThesisRow,
    count_results,
    judge_rows,
    printed_numbers,
    row_figures,
    rows,
    state,
)
from cosim.papers.thesis_unprinted import CASE, variants
from fe_solver.febio.published_hood import PublishedHood, regions_at
from tests.helpers.folders import ROOT

COARSE = ("hood.mesh.quads=120",)


def row(relation: Relation, *values: float) -> ThesisRow:
    return ThesisRow("Table 1", "item", "printed", "N", values, relation, "ours", "")


@pytest.mark.parametrize(
    ("relation", "printed", "ours", "found"),
    [
        ("number", (-2.0,), (-2.19,), "reproduced"),
        ("number", (-2.0,), (-2.21,), "differs"),
        ("number", (-2.0,), (2.0,), "differs"),
        ("number", (1.0, 2.0), (1.0, 2.5), "differs"),
        ("number", (2.0,), (np.nan,), "differs"),
        ("input", (0.1, 2.0), (0.1 + 1e-12, 2.0), "input"),
        ("input", (0.1,), (0.1001,), "differs"),
        ("input", (0.0,), (0.0,), "input"),
        ("at_most", (0.02,), (0.02,), "reproduced"),
        ("at_most", (0.02,), (0.021,), "differs"),
        ("between", (-0.34, -0.32), (-0.32,), "reproduced"),
        ("between", (-0.34, -0.32), (1.62,), "differs"),
        ("between", (4.16, 5.22), (4.15,), "differs"),
        ("other", (4.69,), (4.69,), "set apart"),
        ("text", (), (), "no number printed"),
    ],
)
def test_what_is_called_reproduced(relation, printed, ours, found):
    assert state(row(relation, *printed), ours) == found


def test_every_row_of_the_tables_is_there_with_its_reason():
    count = pd.Series([r.place for r in rows()]).value_counts()
    assert set(count.index) == set(TITLES)
    tables = [f"Table {i}" for i in range(1, 8)]
    assert [count[t] for t in tables] == [3, 8, 9, 7, 10, 8, 5]
    for r in rows():
        assert r.relation in get_args(Relation)
        assert bool(r.ours) == bool(r.values), r
        assert bool(r.values) or r.relation in ("text", "other"), r
        assert r.why or r.relation not in ("number", "other"), r


def _excesses() -> list[str]:
    return [f"{m}: over experiment (figure 3.6)" for m in INTEGRATED]


def test_the_numbers_are_those_that_the_validation_has():
    of = {r.item: r.values for r in rows()}
    assert [of[item][0] for item in _excesses()] == [EXCESS[m] for m in INTEGRATED]
    for m in INTEGRATED:
        assert of[f"{m}: less the dynamic model alone (3.4 with 3.2)"] == pytest.approx(
            OVER_ALONE[m]
        )
    printed = printed_numbers()
    assert printed["strain.soft.longitudinal.mean"] == 1.81


def test_what_the_cases_take_from_the_thesis_is_what_it_prints():
    numbers = input_numbers()
    of_inputs = [r for r in rows() if r.relation == "input"]
    assert [r.item for r in of_inputs if state(r, numbers[r.ours]) != "input"] == []


def test_the_mesh_of_the_thesis_has_columns_of_its_own_and_is_counted_apart():
    ours = {r.ours: tuple(x + 1e3 for x in r.values) for r in rows() if r.ours}
    soft = {"strain.soft.longitudinal.mean": (1.80,), "strain.soft.longitudinal.min": (-2.34,)}
    table = judge_rows(ours, soft).set_index("row")
    found = table.loc[["soft: mean longitudinal strain", "soft: least longitudinal strain"]]
    assert found["state on its mesh"].tolist() == ["reproduced", "differs"]
    assert found["on its mesh"].tolist() == ["1.8", "-2.34"]
    counted = int(table.state.isin(["reproduced", "differs"]).sum())
    assert count_results(judge_rows(ours)) == f"0 of {counted}"
    assert f"; 1 of {counted} with strains of the mesh" in count_results(table)
    assert "(1 of these 2, " in count_results(table)
    shown = {f.name: next(iter(f.tables.values())) for f in row_figures(ours, soft)}
    assert "on its mesh" in shown["table_5"]
    assert "on its mesh" not in shown["table_2"]


def test_the_sheets_differ_by_their_moduli_alone():
    soft, average, stiff = (load_case(f"thesis_strain_{k}") for k in MODULI)
    for case in (soft, stiff):
        same = case.hood.model_copy(update={"regions": average.hood.regions})
        assert same == average.hood
        assert (case.finger, case.tendons) == (average.finger, average.tendons)
    assert all(load_case(CASE, settings) for settings in variants().values())


def test_a_row_that_differs_for_no_known_reason_says_so():
    numbers = {r.ours: tuple(x + 1e3 for x in r.values) for r in rows() if r.ours}
    table = judge_rows(numbers)
    assert (table.state[table.row == "FDP"] == "differs").all()
    assert (table["why, or what is ours"][table.row == "FDP"] == "not looked into").all()
    with pytest.raises(KeyError):
        judge_rows({})


@pytest.mark.slow
def test_the_devices_are_compared_for_every_muscle():
    from cosim.papers.thesis_forces import device_figures

    (figure,) = device_figures()
    table = figure.tables["figure_3_1_devices"]
    assert tuple(table.muscle) == MUSCLES
    assert (table.apart_N < 0.05).all()
    assert (table.turned_deg < 5).all()


@pytest.fixture
def coarse(monkeypatch):
    monkeypatch.setattr(thesis_models, "MESH", COARSE)
    thesis_models.run_once.cache_clear()
    yield
    thesis_models.run_once.cache_clear()


def write_pages(folder: Path, *studies: str) -> str:
    only = [word for study in studies for word in ("--only", study)]
    done = CliRunner().invoke(app, ["reproduce", "thesis", *only, "-o", str(folder)])
    assert done.exit_code == 0, done.output
    return (folder / "index.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_page_on_coarse_meshes(coarse, monkeypatch, tmp_path):
    faked = {r.ours: r.values for r in rows() if r.ours}
    monkeypatch.setattr(thesis, "all_numbers", lambda: faked)
    page = write_pages(tmp_path / "out", "rows", "published", "strains", "slips", "ledger")
    assert "Not run: no mesh was given." in page
    assert "cosim reproduce thesis --mi29 FILE" in page
    assert "://" not in page
    assert all(f'id="{name}"' in page for name in ("states", "table_1", "table_7", "figures"))
    assert len(list((tmp_path / "out").glob("*.png"))) == 5
    sources = pd.read_csv(tmp_path / "out/table_7_sources.csv")
    doubled = sources.source == "hood joint_contact"
    assert set(sources.model[doubled]) == {"one way"}
    strains = pd.read_csv(tmp_path / "out/figure_3_4_strains_table.csv")
    assert strains["thesis, soft"].tolist() == [-2.99, 1.81, 6.95, -2.56, -0.78, 1.48]
    softer = strains[["ours, soft", "ours, average", "ours, stiff"]].iloc[1]
    assert (np.diff(softer) < 0).all()  # longitudinal means


@pytest.mark.slow
def test_the_page_as_it_ships(tmp_path):
    page = write_pages(tmp_path / "out")
    assert all(f'id="{name}"' in page for name in ("states", "unprinted", "section_3_1_times"))
    table = pd.read_csv(tmp_path / "out/rows.csv")
    assert len(table) == len(rows())
    assert set(table.state) == set(STATES)
    forces = pd.read_csv(tmp_path / "out/figure_3_6_forces.csv")
    assert np.allclose(forces.excess_ours_N, forces.one_way_N - forces.two_way_sheet_N)
    readme = (ROOT / "cosim" / "papers" / "README.md").read_text(encoding="utf-8")
    alone = pd.read_csv(tmp_path / "out/one_way_less_dynamic_model.csv")
    assert "| ours | " + " | ".join(f"{x:.3f}" for x in alone.ours_N) + " |" in readme
    for row in forces.itertuples():
        sizes = f"| {row.muscle} | {row.one_way_N:.2f} / {row.two_way_sheet_N:.2f} |"
        assert f"{sizes} {row.excess_ours_N:+.2f} / {row.excess_thesis_N:+.2f} |" in readme


def test_every_study_has_a_name_of_its_own():
    names = [study.name for study in studies()]
    assert len(set(names)) == len(names)


def test_the_mesh_of_the_thesis_is_the_users_file(tmp_path):
    file = tmp_path / "other.feb"
    file.write_text("<febio_spec version='4.0'/>", encoding="utf-8")
    for paper, said in (("thesis", "other.feb, line 1"), ("robot", "is a mesh of")):
        words = ["reproduce", paper, "--mi29", str(file), "-o", str(tmp_path / paper)]
        only = ["--only", "published"] if paper == "thesis" else []
        done = CliRunner().invoke(app, [*words, *only])
        assert done.exit_code == 2, done.output
        assert said in " ".join(done.output.split())


def test_strains_on_that_mesh_by_region_and_moduli(monkeypatch, tmp_path):
    """A made-up hood of six cells: on the tendon, beside it, on the central slip, distal of it,
    where the bands have met, and outside."""
    cells = np.array([[0, 0], [6, 0], [0, 20], [0, 30], [0, 50], [9, 0]], dtype=float)
    middles = np.column_stack([-59 + cells[:, 0], np.zeros(6), cells[:, 1]]) * 1e-3
    percent = np.array([4.0, -2.0, 1.0, 1.0, 7.0, 90.0])

    def made_up(path, moduli, pull):
        assert pull == 11.8
        strain = 1e-2 * np.outer(percent, (1, -0.5, 0)) * (1e8 / moduli.central_slip)
        return PublishedHood(strain, np.ones(6), regions_at(middles), {}, (0.0, 0.0))

    monkeypatch.setattr(thesis_published, "solve_published_hood", made_up)
    thesis_published.published_hood.cache_clear()
    path = tmp_path / "hood.feb"
    numbers = thesis_published.published_numbers(path)
    thesis_published.published_hood.cache_clear()
    scale = 100 / (100.76 - 46.77)
    found = [numbers[f"strain.soft.longitudinal.{s}"][0] for s in ("min", "mean", "max")]
    assert found == pytest.approx([-2 * scale, scale, 4 * scale])
    assert numbers["strain.soft.lateral.min"][0] == pytest.approx(-2 * scale)
    softer = numbers["slip.terminal.stiff_less_soft"][0]
    assert softer == pytest.approx(7 * (100 / (100.76 + 46.77) - scale))
    known = {r.ours for r in rows()}
    assert set(numbers) - known <= {
        *(f"strain.{m}.lateral.{s}" for m in MODULI for s in ("min", "mean", "max")),
        *(f"strain.{m}.longitudinal.max" for m in MODULI),
        *(f"slip.{s}.soft_less_soft" for s in ("central", "terminal")),
    }
