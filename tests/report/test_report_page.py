"""The page of a report: as text, and opened in a headless Chromium where there is one."""

from __future__ import annotations

import base64
import io
import json
import re
import shutil
import subprocess
import time
from dataclasses import dataclass, field, replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from cosim.errors import InputError
from cosim.report import page as page_module
from cosim.report.page import MOST_BYTES
from cosim.report.write import write_report
from cosim.results.read import read_run
from tests.helpers.report_runs import DATA, run_into, write_swinging_run

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = (
    *("--headless", "--no-sandbox", "--disable-dev-shm-usage", "--no-first-run"),
    *("--disable-extensions", "--disable-background-networking", "--disable-component-update"),
    *("--disable-sync", "--disable-gpu-compositing", "--use-angle=swiftshader"),
    *("--enable-unsafe-swiftshader", "--host-resolver-rules=MAP * ~NOTFOUND"),
    *("--enable-logging=stderr", "--virtual-time-budget=6000", "--window-size=390,844"),
)
PATIENCE = 60
"""s; a Chromium that draws without a graphics card sometimes hangs, and is then asked again."""


@dataclass
class Page(HTMLParser):
    """What is in a page: the cells of its tables, the addresses that it names, its sections."""

    cells: dict[tuple[str, int, int], tuple[str | None, str]] = field(default_factory=dict)
    addresses: list[str] = field(default_factory=list)
    sections: list[str] = field(default_factory=list)
    selftest: Any = None

    def __post_init__(self) -> None:
        super().__init__()
        self._table, self._cell, self._tag, self._depth = "", None, "", 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        have = dict(attrs)
        self.addresses += [v or "" for k, v in attrs if k in ("src", "href", "action", "poster")]
        if tag == "html" and "data-selftest" in have:
            self.selftest = json.loads(have["data-selftest"] or "")
        if tag == "section":
            self.sections.append(have["id"] or "")
        self._table = have.get("data-table") or self._table
        if "data-cell" in have:
            row, column = map(int, (have["data-cell"] or "").split("/"))
            self._cell, self._tag = (self._table, row, column), tag
            self.cells[self._cell] = (have.get("data-value"), "")

    def handle_endtag(self, tag: str) -> None:
        if tag == self._tag:
            self._cell = None

    def handle_data(self, data: str) -> None:
        if self._cell is not None:
            value, text = self.cells[self._cell]
            self.cells[self._cell] = (value, text + data)


def parse(text: str) -> Page:
    page = Page()
    page.feed(text)
    return page


def without_scripts(text: str) -> str:
    return re.sub(r"<(script|style)\b.*?</\1>", "", text, flags=re.DOTALL)


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> list[Path]:
    folder = tmp_path_factory.mktemp("runs")
    hood = run_into(folder, "isometric_edc", "hood.mesh.quads=120")
    return [hood, write_swinging_run(hood, folder / "moved")]


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("data") / "data.csv"
    path.write_text(DATA, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def report(runs, data, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("page") / "report.html"
    write_report(runs, out, "html", None, data)
    return out


@pytest.fixture(scope="module")
def tables(runs, data) -> dict[str, Any]:
    return json.loads(write_report(runs, None, "json", None, data))["tables"]


@dataclass(frozen=True)
class Seen:
    page: Page
    console: list[str]


def open_page(report: Path, tmp_path_factory) -> Seen:
    """The page as Chromium has it once its own test of itself has run."""
    if CHROMIUM is None:
        pytest.skip("there is no chromium here (Debian: apt-get install chromium)")
    for _ in range(3):
        profile = f"--user-data-dir={tmp_path_factory.mktemp('profile')}"
        command = [CHROMIUM, *FLAGS, profile, "--dump-dom", f"{report.as_uri()}#selftest"]
        try:
            done = subprocess.run(command, capture_output=True, timeout=PATIENCE, check=True)
        except subprocess.TimeoutExpired:
            time.sleep(1)
            continue
        console = [x for x in done.stderr.decode(errors="replace").splitlines() if ":CONSOLE" in x]
        return Seen(parse(done.stdout.decode("utf-8")), console)
    raise AssertionError("chromium did not answer three times")


@pytest.fixture(scope="module")
def seen(report, tmp_path_factory) -> Seen:
    return open_page(report, tmp_path_factory)


def test_the_page_stands_alone(report):
    text = report.read_text(encoding="utf-8")
    assert len(text.encode("utf-8")) < MOST_BYTES
    for address in parse(text).addresses:
        assert address.startswith(("data:", "#")), address
    own = without_scripts(text)
    assert not re.search(r"https?:", own)  # the letters alone occur in a picture by chance
    styles = "".join(re.findall(r"<style>.*?</style>", text, flags=re.DOTALL))
    assert "url(" not in styles
    assert "@import" not in styles
    assert "@media print" in styles


def test_the_page_has_everything_in_order(report):
    page = parse(without_scripts(report.read_text(encoding="utf-8")))
    assert page.sections == [
        *("question", "answer", "picture", "space", "maps", "force", "ledger", "data", "trust"),
        *("all", "again"),
    ]


def test_what_users_write_is_shown_and_not_run(report):
    own = without_scripts(report.read_text(encoding="utf-8"))
    assert "&lt;b&gt;held&lt;/b&gt;" in own
    assert "<b>held</b>" not in own


def test_a_folder_called_like_a_script_stays_a_name(runs, tmp_path):
    named = tmp_path / "a<script>b"
    shutil.copytree(runs[0], named)
    out = tmp_path / "report.html"
    write_report([named], out, "html")
    text = out.read_text(encoding="utf-8")
    start = text.index('id="views">') + len('id="views">')
    assert "a\\u003cscript>b" in text[start:]
    assert "<" not in text[start : text.index("</script>", start)]
    assert "a<script>b" not in text


def same(cell: tuple[str | None, str], value: Any) -> bool:
    """Whether a cell shows a value of the JSON, and a number to four digits of it."""
    stated, text = cell[0], " ".join(cell[1].split())
    if value is None:
        return stated is None and text == "–"
    if isinstance(value, str):
        return stated is None and value in text
    shown = float(text.split()[0].replace("−", "-"))
    return stated is not None and float(stated) == value and shown == float(f"{value:.4g}")


def check_cells(page: Page, tables: dict[str, Any]) -> None:
    for (key, row, column), cell in page.cells.items():
        assert same(cell, tables[key]["rows"][row][column]), (key, row, column, cell)
    for key, table in tables.items():
        for r, row in enumerate(table["rows"]):
            for c, value in enumerate(row):
                if isinstance(value, float):
                    assert (key, r, c) in page.cells, (key, r, c)


def test_every_number_of_the_tables_is_that_of_the_json(report, tables):
    page = parse(report.read_text(encoding="utf-8"))
    assert {key for key, _, _ in page.cells} == set(tables)
    assert len(page.cells) > 500
    check_cells(page, tables)


def test_a_cell_that_is_not_the_jsons_would_be_found():
    assert same(("0.21739", "−0.2174"), 0.21739) is False
    assert same(("0.21739", "0.2174"), 0.21738) is False
    assert same(("0.21739", "0.2175 N"), 0.21739) is False
    assert same(("0.21739", "0.2174 N"), 0.21739)
    assert same((None, "–"), None)


def test_verdicts_are_words_and_shapes(report, tables):
    page = parse(report.read_text(encoding="utf-8"))
    shapes = {"inside 1 SD": "●", "inside the band": "◆", "outside": "▲", "no value": "–"}
    rows = [
        (key, n, row)
        for key in ("comparison_0", "comparison_1")
        for n, row in enumerate(tables[key]["rows"])
    ]
    assert {row[9] for _, _, row in rows} >= {"inside 1 SD", "outside", "no value"}
    for key, n, row in rows:
        assert page.cells[key, n, 9][1].split()[0] == shapes[row[9]]


def test_the_same_bytes_twice(runs, data, report):
    again = report.with_name("again.html")
    write_report(runs, again, "html", None, data)
    assert again.read_bytes() == report.read_bytes()


def test_a_page_too_large_to_send_is_refused(runs, monkeypatch, tmp_path):
    monkeypatch.setattr(page_module, "MOST_BYTES", 1_000_000)
    with pytest.raises(InputError, match="report fewer runs at a time"):
        write_report(runs[1:], tmp_path / "report.html", "html")
    assert list(tmp_path.iterdir()) == []


def test_a_run_against_another_has_a_view_of_the_difference(runs, tmp_path):
    out = tmp_path / "report.html"
    write_report(runs[1:], out, "html", runs[0])
    text = out.read_text(encoding="utf-8")
    assert "differences are a run less isometric_edc" in text
    assert '<th scope="col">moved less isometric_edc</th>' in text


def pixels(content: bytes) -> np.ndarray:
    """(rows, columns, 3) from 0 to 255."""
    return np.array(Image.open(io.BytesIO(content)).convert("RGB"))


def embedded_pixels(address: str | None) -> np.ndarray:
    assert address is not None
    return pixels(base64.b64decode(address.partition("base64,")[2]))


def test_the_still_picture_has_the_colours_of_the_run_s_colour_bar(runs, report):
    page = parse(report.read_text(encoding="utf-8"))
    address = next(a for a in page.addresses if a.startswith("data:image/"))
    original, shown = pixels((runs[0] / "picture.png").read_bytes()), embedded_pixels(address)
    scale = shown.shape[1] / original.shape[1]
    counts = np.array([len(np.unique(column, axis=0)) for column in original.swapaxes(0, 1)])
    right = np.arange(len(counts)) > 0.9 * len(counts)
    bar = int(np.median(np.flatnonzero(right & (counts > 200))))
    rows = np.arange(len(original) // 4, 3 * len(original) // 4)
    there = shown[(rows * scale).astype(int), int(bar * scale)].astype(int)
    assert np.abs(there - original[rows, bar]).max() <= 6


def test_a_picture_keeps_all_its_colours(runs, tmp_path):
    along, up = np.meshgrid(np.arange(300) % 256, np.arange(200), indexing="xy")
    gradient = np.stack([along, up, (along + up) % 256], axis=-1).astype(np.uint8)
    Image.fromarray(gradient).save(tmp_path / "picture.png")
    run = replace(read_run(runs[0]), folder=tmp_path)
    np.testing.assert_array_equal(embedded_pixels(page_module._picture(run, "picture")), gradient)


def test_no_error_is_on_the_console_and_nothing_is_asked_for(seen):
    assert seen.page.selftest["errors"] == []
    assert seen.page.selftest["requests"] == []
    wrong = [x for x in seen.console if re.search(r"rror|ncaught|ailed|efused|arning", x)]
    assert wrong == []


def test_nothing_is_cut_in_any_frame(seen):
    assert seen.page.selftest["cut"] == []


def test_the_view_in_space_is_drawn(seen):
    assert seen.page.selftest["canvases"] >= 1
    for moment in seen.page.selftest["seen"]:
        assert moment["colours"] > 500


def test_the_slider_moves_what_is_seen(seen):
    loaded, unloaded = seen.page.selftest["seen"]
    assert (loaded["frame"], unloaded["frame"]) == ("loaded", "unloaded")
    assert loaded["sum"] != unloaded["sum"]
    assert loaded["readout"] != unloaded["readout"]
    assert len(loaded["maps"]) == 4
    assert loaded["maps"][:2] != unloaded["maps"][:2]
    assert loaded["maps"][2:] == unloaded["maps"][2:], "a motion's map has its end alone"


def test_the_values_beside_the_slider_are_the_runs(seen, tables):
    outcome = {row[0]: row[2] for row in tables["outcome"]["rows"]}
    said = seen.page.selftest["seen"][0]["readout"]
    assert f"{outcome['fingertip force, magnitude']:.3g} N" in said
    assert f"{outcome['PIP angle']:.2f}°" in said


def test_a_phone_shows_the_page_without_scrolling_sideways(seen):
    assert seen.page.selftest["fits"] is True


def test_chromium_shows_the_numbers_of_the_json(seen, tables):
    check_cells(seen.page, tables)
