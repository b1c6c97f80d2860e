"""Every page in a headless Chromium, from the width of a phone to that of a large screen."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from cosim.cli import app
from cosim.report.figures import Figure, FigurePage, FigureStudy, write_figures
from cosim.report.page import write_report
from cosim.results.picture import new_picture
from tests.helpers.browser import Browser, check_look, look_at, open_browser
from tests.helpers.fixed_posture import HELD
from tests.helpers.report_runs import run_into

pytestmark = pytest.mark.slow
WIDTHS = (390, 700, 1000, 1600)
COARSE = ("hood.mesh.quads=120",)
SHORT = ('forward.duration="0.2 s"', "output.frames=10")
DOTS = (
    'hood.points.dot_1=["20 mm", "0 mm", "9 mm"]',
    'hood.points.dot_2=["28 mm", "0 mm", "8 mm"]',
    'hood.gauges.middle=["dot_1", "dot_2"]',
)
MEASURED = """name,quantity,unit,reference,sd,source
Gauge,difference.gauge_strain_percent.middle,%,1.4,0.4,T
"""
STUDY = """
case = "held.toml"
[parameters.PIP]
values = ["20 deg", "30 deg", "40 deg", "50 deg"]
settings = ["finger.posture.PIP={value}"]
[outputs]
torque = "joint_torque_Nmm.passive.PIP"
"""

PAGES = ("one", "two", "motion", "lesion", "study", "validate", "gallery", "measured")


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with open_browser() as opened:
        yield opened


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> Callable[[str], Path]:
    """The page of a name, made once."""
    folder = tmp_path_factory.mktemp("pages")

    def report_of(name: str, *cases: tuple[str, ...], data: str = "") -> Path:
        runs = [run_into(folder / name, case, *settings) for case, *settings in cases]
        out, table = folder / f"{name}.html", folder / f"{name}.csv"
        table.write_text(data, encoding="utf-8")
        write_report(runs, out, "html", None, table if data else None)
        return out

    def command(out: str, *words: str) -> Path:
        done = CliRunner().invoke(app, [*words])
        assert done.exit_code == 0, done.output
        return folder / out

    def study() -> Path:
        (folder / "held.toml").write_text(HELD, encoding="utf-8")
        (folder / "pip.toml").write_text(STUDY, encoding="utf-8")
        out = ("--out", str(folder / "studies"), "--workers", "0")
        return command("studies/pip/index.html", "study", str(folder / "pip.toml"), *out)

    def gallery() -> Path:
        picture = new_picture()
        picture.subplots().plot([0.0, 1.0], [0.0, 1.0])
        data = pd.DataFrame({"what": ["a"] * 3, "force, N": np.linspace(0.0, 1.0, 3)})
        figure = Figure("figure_1", "Figure 1: a line", "A line.", picture, {"table": data})
        studies = (FigureStudy("one", "the first", lambda: [figure]),)
        write_figures(FigurePage("mine", "A paper", studies), studies, folder / "g", lambda _: None)
        return folder / "g/index.html"

    lesion = "isometric_edc_transversely_isotropic"
    cut = ("--set", 'lesion.cut=["lateral_band_ulnar"]', "--set", *COARSE, "--workers", "1")
    out = ("--page", str(folder / "lesion.html"), "--out", str(folder / "lesion"))
    split = ("--only", "force split E", "--out", str(folder / "validate"), "--workers", "1")
    makers = {
        "one": lambda: report_of("one", ("isometric_edc", *COARSE, *DOTS), data=MEASURED),
        "two": lambda: report_of("two", ("isometric_edc", *COARSE), ("cable_edc",)),
        "motion": lambda: report_of("motion", ("motion_edc_fdp", *COARSE, *SHORT)),
        "lesion": lambda: command("lesion.html", "lesion", lesion, *cut, *out),
        "study": study,
        "validate": lambda: command("validate/scoreboard.html", "validate", *split),
        "gallery": gallery,
        "measured": lambda: command(
            "measured.html", "list", "measured", "--html", str(folder / "measured.html")
        ),
    }
    return cache(lambda name: makers[name]())


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize(
    "name", ["one", "two", "motion", "lesion", "study", "validate", "gallery", "measured"]
)
def test_a_page_is_whole_at_every_width(name, width, pages, browser):
    seen = look_at(browser, pages(name), width)
    check_look(seen)
    assert browser.pdf().startswith(b"%PDF")


def test_two_runs_have_one_camera_and_one_scale(pages, browser):
    seen = look_at(browser, pages("two"), 1400)
    one, other = seen.look["eyes"]
    assert one == other
    ranges = browser.ask(
        "cosimPage.panels.map(({stage: {layout: {scene: s}}}) => "
        "[s.xaxis.range, s.yaxis.range, s.zaxis.range, s.aspectratio])"
    )
    assert ranges[0] == ranges[1]


def test_a_motion_plays_to_its_end(pages, browser):
    browser.open(pages("motion"), 1000)
    last = browser.ask("cosimReady.then(() => cosimPage.data.views[0].frames.length - 1)")
    assert last >= 9
    ended = browser.ask(
        "cosimPage.go(0).then(() => new Promise((done) => {"
        "const seen = new Set(), play = document.getElementById('play');"
        "document.getElementById('speed').value = '0.1'; play.click();"
        "const wait = () => { seen.add(cosimPage.now.frame); "
        "if (play.getAttribute('aria-pressed') === 'true') setTimeout(wait, 5);"
        "else done([cosimPage.now.frame, seen.size]); }; wait(); }))"
    )
    assert ended[0] == last
    assert ended[1] >= 3


def test_the_numbers_of_the_collection_are_chosen_by_what_they_are_of(pages, browser):
    look_at(browser, pages("measured"), WIDTHS[-1])
    shown = browser.ask(
        """(() => {
          const form = document.getElementById("choose");
          form.elements.muscle.value = "EDC";
          form.elements.joint.value = "PIP";
          form.elements.joint.dispatchEvent(new Event("change"));
          const rows = [...document.querySelectorAll("#rows tr:not([hidden])")];
          const said = Number(document.getElementById("shown").value);
          return [said, rows.length, rows.every((row) => row.innerText.includes("EDC, PIP"))];
        })()"""
    )
    assert shown[0] == shown[1] > 5
    assert shown[2]
