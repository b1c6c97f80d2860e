"""What `cosim reproduce` writes."""

from __future__ import annotations

import ast
import builtins
from typing import get_args

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from cases.papers.models.printed import read_printed
from cosim.cli import app
from cosim.commands.reproduce import BY_SUBJECT, PaperName
from cosim.errors import ConvergenceError, InputError
from cosim.files import output_folder
from cosim.report import gallery
from cosim.report.figures import (
    Figure,
    FigurePage,
    FigureStudy,
    choose_studies,
    write_figures,
)
from cosim.report.gallery import Script, open_paper
from cosim.results.picture import new_picture
from tests.helpers.folders import ROOT


def figure(name="figure_1", rows=3):
    data = pd.DataFrame({"what": ["<b>"] * rows, "force, N": np.linspace(0.0, 1.0, rows)})
    picture = new_picture()
    picture.subplots().plot([0.0, 1.0], [0.0, 1.0])
    return Figure(name, "Figure 1: a <line>", "Said & seen.", picture, {f"{name}_table": data})


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
    assert "<td>&lt;b&gt;</td>" in page
    assert page.count("<table>") == 1  # the one that is small
    assert "figure_2_table.csv" in page
    assert "Said &amp; seen." in page
    assert "://" not in page.replace("http://www.w3.org/2000/svg", "")  # a name, not an address
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


@pytest.mark.parametrize(
    "study",
    [
        "coupling",
        "linear",
        *(pytest.param(s, marks=pytest.mark.slow) for s in ("quadratic", "excursions")),
    ],
)
def test_the_studies_hold_every_number_that_they_draw(study):
    for made in open_paper("buchner1988").run(study):
        assert made.tables
        table = pd.concat(made.tables.values()).select_dtypes("number").to_numpy()
        for line in made.picture.axes[0].lines[:1]:
            assert np.isin(np.asarray(line.get_ydata(), dtype=float), table).all()


SCRIPT = """\
# ---
# jupyter:
# ---

# %% [markdown]
# # A paper of
# two lines
#
# What holds for
# all.

# %%
import pandas as pd

from cosim.report.figures import show
from cosim.results.picture import new_picture

MOST = 2.0

# %% [markdown]
# ## one: what it is about
# ### Figure 1: a line

# %% figure_1
picture = new_picture()
twice = 2 * MOST
parts = pd.DataFrame({"x": [1.0]})
parts.attrs["title"] = "Table 2: apart"
show(picture, pd.DataFrame({"x": [MOST]}), table_2=parts)

# %% [markdown]
# ## two: a fault
# ### Figure 2

# %% two
show(None, pd.DataFrame({"x": [twice]}))
"""


@pytest.fixture
def script_file(tmp_path):
    caption = '\n# %% [markdown]\n# The `most` is {MOST:.1f}\n# and {twice:g}, it\'s "said".\n'
    path = tmp_path / "mine.py"
    path.write_text(SCRIPT.replace("table_2=parts)\n", "table_2=parts)\n" + caption))
    return path


def test_a_script_with_cells_makes_figures(script_file):
    script = Script(script_file, {"MOST": 3.0})
    page = script.page("mine")
    assert (page.title, page.notes) == ("A paper of two lines", ("What holds for all.",))
    assert [(s.name, s.about) for s in page.studies] == [
        ("one", "what it is about"),
        ("two", "a fault"),
    ]
    first, second = page.studies[0].figures()
    assert (first.name, first.title, list(first.tables)) == (
        "figure_1",
        "Figure 1: a line",
        ["figure_1"],
    )
    assert first.tables["figure_1"].x.tolist() == [3.0]
    assert (second.name, second.title) == ("table_2", "Table 2: apart")
    assert second.caption == 'The `most` is 3.0 and 6, it\'s "said".'


def test_a_study_sees_nothing_of_another_and_a_fault_names_its_line(script_file):
    script = Script(script_file)
    script.run("one")
    with pytest.raises(NameError, match="twice") as caught:
        script.run("two")
    place = caught.traceback[-1]
    line = script_file.read_text().splitlines().index('show(None, pd.DataFrame({"x": [twice]}))')
    assert (str(place.path), place.lineno) == (str(script_file), line)
    with pytest.raises(KeyError, match="LEAST"):
        Script(script_file, {"LEAST": 1.0}).names  # noqa: B018


def test_a_notebook_shows_what_a_cell_shows(script_file):
    from cosim.report.figures import show

    html = show(new_picture(), rows=pd.DataFrame({"x": [1.5]}))._repr_html_()
    assert html.count("<img") == 1
    assert '<td class="n" data-value="1.5">1.5</td>' in html


def defined_names(node):
    if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
        yield node.id
    elif isinstance(node, ast.Import | ast.ImportFrom):
        yield from (alias.asname or alias.name for alias in node.names)
    elif isinstance(node, ast.FunctionDef):
        yield node.name


PAPERS = sorted((ROOT / "cases" / "papers").glob("*.py"))


@pytest.mark.parametrize("path", [pytest.param(path, id=path.stem) for path in PAPERS])
def test_every_script_has_a_command_its_numbers_and_a_line_in_the_guide(path):
    assert path.stem in {BY_SUBJECT.get(name, name) for name in get_args(PaperName)}
    guide = (ROOT / "cases" / "papers" / "README.md").read_text(encoding="utf-8")
    assert f"({path.name})" in guide
    script = open_paper(path.stem)
    assert script.page(path.stem).title
    assert script.studies
    names = set(dir(builtins))
    texts = []
    for cell in [*script.shared, *(c for _, cells in script.studies.values() for c in cells)]:
        if cell.is_text:
            texts.append(" ".join(cell.source.split()))
        else:
            names |= {n for node in ast.walk(ast.parse(cell.source)) for n in defined_names(node)}
    used = [node for text in texts for node in ast.walk(ast.parse(f"f{text!r}"))]
    assert {n.id for n in used if isinstance(n, ast.Name)} <= names
    assert read_printed(path.stem)


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


def test_an_installation_is_told_to_clone(monkeypatch, tmp_path):
    """A wheel holds no script of a paper."""
    monkeypatch.setattr(gallery, "files", lambda package: tmp_path)
    done = CliRunner().invoke(app, ["reproduce", "networks", "--out", str(tmp_path / "out")])
    assert done.exit_code == 2
    assert "clone the repository" in done.stderr
    assert not (tmp_path / "out").exists()
