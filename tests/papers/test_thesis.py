"""The thesis, computed anew: its rows, what they are judged by, and its page."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from cases.papers.models.printed import Printed, Relation, State, printed_values, read_printed
from cosim.case.file import load_case
from cosim.cli import app
from cosim.report import gallery
from cosim.report.gallery import open_paper
from fe_solver.febio.published_hood import PublishedHood, regions_at
from tests.helpers.folders import ROOT

COARSE = ("hood.mesh.quads=120",)
SCRIPT = open_paper("jadelis")


def row(relation: Relation, *values: float) -> Printed:
    return Printed("Table 1", "item", "printed", "N", values, relation, "ours", "")


def rows() -> list[Printed]:
    return read_printed("jadelis")


def of_script(name: str):
    return SCRIPT.names[name]


def muscles() -> list[str]:
    return list(of_script("EXCESS"))


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
    assert row(relation, *printed).state(ours) == found


def test_every_row_of_the_tables_is_there_with_its_reason():
    count = pd.Series([r.place for r in rows()]).value_counts()
    assert set(count.index) == set(of_script("TITLES"))
    tables = [f"Table {i}" for i in range(1, 8)]
    assert [count[t] for t in tables] == [3, 8, 9, 7, 10, 8, 5]
    for r in rows():
        assert r.relation in get_args(Relation)
        assert bool(r.ours) == bool(r.values), r
        assert bool(r.values) or r.relation in ("text", "other"), r
        assert r.why or r.relation not in ("number", "other"), r


def test_excesses_and_intervals_belong_together():
    excess, between = of_script("EXCESS"), printed_values("jadelis", "between")
    assert excess == {"EDC": 4.69, "EI": 4.66, "LUM": 1.76, "FPI": 0.19}
    for muscle in muscles():
        least = excess[muscle] - 0.53
        most = excess[muscle] + (0.53 if muscle != "FPI" else -0.51)
        assert between[f"over_alone.{muscle}"] == pytest.approx((least, most))
    assert printed_values("jadelis")["strain.soft.longitudinal.mean"] == (1.81,)


def test_what_the_cases_take_from_the_thesis_is_what_it_prints():
    numbers = of_script("input_numbers")()
    of_inputs = [r for r in rows() if r.relation == "input"]
    assert [r.item for r in of_inputs if r.state(numbers[r.ours]) != "input"] == []


def test_the_mesh_of_the_thesis_has_columns_of_its_own_and_is_counted_apart():
    judge_rows, count_results = of_script("judge_rows"), of_script("count_results")
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
    shown = dict(of_script("place_tables")(judge_rows(ours, soft)))
    assert "on its mesh" in shown["table_5"]
    assert "on its mesh" not in shown["table_2"]


def test_the_sheets_differ_by_their_moduli_alone():
    soft, average, stiff = (load_case(f"thesis_strain_{k}") for k in of_script("MODULI"))
    for case in (soft, stiff):
        same = case.hood.model_copy(update={"regions": average.hood.regions})
        assert same == average.hood
        assert (case.finger, case.tendons) == (average.finger, average.tendons)
    assert all(load_case("thesis_strain_soft", more) for more in of_script("variants")().values())


def test_a_row_that_differs_for_no_known_reason_says_so():
    numbers = {r.ours: tuple(x + 1e3 for x in r.values) for r in rows() if r.ours}
    table = of_script("judge_rows")(numbers)
    assert (table.state[table.row == "FDP"] == "differs").all()
    assert (table["why, or what is ours"][table.row == "FDP"] == "not looked into").all()
    with pytest.raises(KeyError):
        of_script("judge_rows")({})


@pytest.mark.slow
def test_the_devices_are_compared_for_every_muscle():
    (figure,) = SCRIPT.run("devices")
    table = figure.tables["figure_3_1_devices"]
    assert tuple(table.muscle) == of_script("MUSCLES")
    assert (table.apart_N < 0.05).all()
    assert (table.turned_deg < 5).all()


def write_pages(folder: Path, *studies: str) -> str:
    only = [word for study in studies for word in ("--only", study)]
    done = CliRunner().invoke(app, ["reproduce", "thesis", *only, "-o", str(folder)])
    assert done.exit_code == 0, done.output
    return (folder / "index.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_page_on_coarse_meshes(monkeypatch, tmp_path):
    faked = {r.ours: r.values for r in rows() if r.ours}
    values = {"MESH": COARSE, "all_numbers": lambda: faked}
    monkeypatch.setattr(gallery, "open_paper", lambda name, given: open_paper(name, values))
    page = write_pages(tmp_path / "out", "rows", "published", "strains", "slips", "ledger")
    assert "Not run: no mesh was given." in page
    assert "cosim reproduce thesis --mi29 FILE" in page
    assert "://" not in page.replace("http://www.w3.org/", "")  # a name of SVG is no address
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
    assert set(table.state) == set(get_args(State))
    forces = pd.read_csv(tmp_path / "out/figure_3_6_forces.csv")
    assert np.allclose(forces.excess_ours_N, forces.one_way_N - forces.two_way_sheet_N)
    readme = (ROOT / "cases" / "papers" / "README.md").read_text(encoding="utf-8")
    alone = pd.read_csv(tmp_path / "out/one_way_less_dynamic_model.csv")
    assert "| ours | " + " | ".join(f"{x:.3f}" for x in alone.ours_N) + " |" in readme
    for row in forces.itertuples():
        sizes = f"| {row.muscle} | {row.one_way_N:.2f} / {row.two_way_sheet_N:.2f} |"
        assert f"{sizes} {row.excess_ours_N:+.2f} / {row.excess_thesis_N:+.2f} |" in readme


def test_the_mesh_of_the_thesis_is_the_users_file(tmp_path):
    file = tmp_path / "other.feb"
    file.write_text("<febio_spec version='4.0'/>", encoding="utf-8")
    for paper, said in (("thesis", "other.feb, line 1"), ("robot", "is a mesh of")):
        words = ["reproduce", paper, "--mi29", str(file), "-o", str(tmp_path / paper)]
        only = ["--only", "published"] if paper == "thesis" else []
        done = CliRunner().invoke(app, [*words, *only])
        assert done.exit_code == 2, done.output
        assert said in " ".join(done.output.split())


def test_strains_on_that_mesh_by_region_and_moduli(tmp_path):
    """A made-up hood of six cells: on the tendon, beside it, on the central slip, distal of it,
    where the bands have met, and outside."""
    cells = np.array([[0, 0], [6, 0], [0, 20], [0, 30], [0, 50], [9, 0]], dtype=float)
    middles = np.column_stack([-59 + cells[:, 0], np.zeros(6), cells[:, 1]]) * 1e-3
    percent = np.array([4.0, -2.0, 1.0, 1.0, 7.0, 90.0])

    def made_up(path, moduli, pull):
        assert pull == 11.8
        strain = 1e-2 * np.outer(percent, (1, -0.5, 0)) * (1e8 / moduli.central_slip)
        return PublishedHood(strain, np.ones(6), regions_at(middles), {}, (0.0, 0.0))

    given = {"MI29": tmp_path / "hood.feb", "solve_published_hood": made_up}
    numbers = open_paper("jadelis", given).names["mesh_numbers"]()
    scale = 100 / (100.76 - 46.77)
    found = [numbers[f"strain.soft.longitudinal.{s}"][0] for s in ("min", "mean", "max")]
    assert found == pytest.approx([-2 * scale, scale, 4 * scale])
    assert numbers["strain.soft.lateral.min"][0] == pytest.approx(-2 * scale)
    softer = numbers["slip.terminal.stiff_less_soft"][0]
    assert softer == pytest.approx(7 * (100 / (100.76 + 46.77) - scale))
    known = {r.ours for r in rows()}
    moduli = ("soft", "average", "stiff")
    assert set(numbers) - known <= {
        *(f"strain.{m}.lateral.{s}" for m in moduli for s in ("min", "mean", "max")),
        *(f"strain.{m}.longitudinal.max" for m in moduli),
        *(f"slip.{s}.soft_less_soft" for s in ("central", "terminal")),
    }
