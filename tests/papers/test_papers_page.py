"""What `cosim reproduce` writes."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from cosim.cli import app
from cosim.errors import ConvergenceError, InputError
from cosim.files import output_folder
from cosim.report.figures import Figure, FigurePage, FigureStudy, choose_studies, write_figures


def draw_line(sheet):
    sheet.subplots().plot([0.0, 1.0], [0.0, 1.0])


def figure(name="figure_1", rows=3):
    data = pd.DataFrame({"what": ["<b>"] * rows, "force, N": np.linspace(0.0, 1.0, rows)})
    return Figure(name, "Figure 1: a <line>", "Said & seen.", draw_line, {f"{name}_table": data})


def paper(*figures, fails=False):
    def fail():
        raise ConvergenceError("did not converge")

    studies = (
        FigureStudy("one", "the first", lambda: list(figures)),
        FigureStudy("two", "fails", fail),
    )
    return FigurePage("mine", "A paper", studies[: 2 if fails else 1])


def test_pictures_tables_and_a_page_that_needs_nothing_else(tmp_path):
    found = paper(figure(), figure("figure_2", rows=100))
    said = []
    count = write_figures(found, choose_studies(found, ()), tmp_path / "out", said.append)
    assert count == 2
    assert said == ["1/1 one: the first"]
    page = (tmp_path / "out/index.html").read_text(encoding="utf-8")
    assert "Figure 1: a &lt;line&gt;" in page
    assert page.count("data:image/png;base64,") == 2
    assert "<td >&lt;b&gt;</td>" in page
    assert page.count("<table>") == 1  # the one that is small
    assert "figure_2_table.csv" in page
    assert "://" not in page
    assert "cosim reproduce mine --only one" in page
    assert len(pd.read_csv(tmp_path / "out/figure_2_table.csv")) == 100
    assert (tmp_path / "out/figure_1.png").read_bytes().startswith(b"\x89PNG")


def test_nothing_is_left_of_a_study_that_fails(tmp_path):
    found = paper(figure(), fails=True)
    write_figures(found, choose_studies(found, ["one"]), tmp_path / "out", lambda text: None)
    before = sorted(p.name for p in (tmp_path / "out").iterdir())
    with pytest.raises(ConvergenceError):
        write_figures(found, choose_studies(found, ()), tmp_path / "out", lambda text: None)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == before
    assert [p.name for p in tmp_path.iterdir()] == ["out"]
    assert "Left out: two (fails)" in (tmp_path / "out/index.html").read_text(encoding="utf-8")


def test_what_others_wrote_is_not_replaced(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis.tex").write_text("years of work")
    with (
        pytest.raises(InputError, match="in the way"),
        output_folder(tmp_path / "mine", "index.html"),
    ):
        pass
    assert (tmp_path / "mine/thesis.tex").exists()


def test_the_command_writes_a_study_of_its_own(tmp_path):
    done = CliRunner().invoke(
        app, ["reproduce", "coordination", "--only", "table", "-o", str(tmp_path / "out")]
    )
    assert done.exit_code == 0, done.output
    rows = pd.read_csv(tmp_path / "out/table_1_entries.csv")
    assert set(rows.certainty) == {"certain", "likely", "uncertain"}
    assert "1 figure in" in done.output


@pytest.mark.parametrize("study", ["coupling", "linear", "quadratic", "excursions"])
def test_the_studies_hold_every_number_that_they_draw(study):
    from matplotlib.figure import Figure as Sheet

    from cosim.papers.coordination import STUDIES

    (found,) = [s for s in STUDIES if s.name == study]
    for made in found.figures():
        assert made.tables
        sheet = Sheet(figsize=made.size)
        made.draw(sheet)
        table = pd.concat(made.tables.values()).select_dtypes("number").to_numpy()
        for line in sheet.axes[0].lines[:1]:
            assert np.isin(np.asarray(line.get_ydata(), dtype=float), table).all()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["coordination", "--only", "nope"], "no such study; it has table"),
        (["elsewhere"], "elsewhere"),
    ],
)
def test_an_unknown_name_is_refused(words, said, tmp_path):
    done = CliRunner().invoke(app, ["reproduce", *words, "-o", str(tmp_path / "out")])
    assert done.exit_code == 2
    assert said in done.output
    assert not (tmp_path / "out").exists()
