"""The page of a report: as text, and opened in a headless Chromium where there is one."""

from __future__ import annotations

import base64
import gzip
import io
import json
import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from cosim.errors import InputError
from cosim.report import page as page_module
from cosim.report.page import MOST_BYTES, write_report
from cosim.report.templates import OF_MARKUP, floats, integers
from cosim.results.read import read_run
from tests.helpers.browser import Browser, Seen, check_look, look_at, open_browser
from tests.helpers.report_runs import DATA, run_into, write_swinging_run


@dataclass
class Page(HTMLParser):
    """What is in a page: the cells of its tables, the addresses that it names, its sections."""

    cells: dict[tuple[str, int, int], tuple[str | None, str]] = field(default_factory=dict)
    addresses: list[str] = field(default_factory=list)
    sections: list[str] = field(default_factory=list)
    tables: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()
        self._table, self._cell, self._tag, self._place = "", None, "", (-1, -1)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        have = dict(attrs)
        self.addresses += [v or "" for k, v in attrs if k in ("src", "href", "action", "poster")]
        if tag == "section":
            self.sections.append(have["id"] or "")
        if tag == "table":
            self._table, self._place = have.get("data-table") or "", (-2, -1)
            self._is_grid = "numbers" in (have.get("class") or "")
            self.tables.append(self._table)
        row, column = self._place
        if tag == "tr":
            self._place = (row + 1, -1)
        if tag == "td":
            self._place = (row, column + 1)
        if "data-cell" in have:
            self._begin(tag, tuple(map(int, (have["data-cell"] or "").split("/"))), have)
        elif tag == "td" and self._table and self._is_grid:
            self._begin(tag, self._place, have)

    def _begin(self, tag: str, place: tuple[int, int], have: dict[str, str | None]) -> None:
        self._cell, self._tag = (self._table, *place), tag
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


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with open_browser() as opened:
        yield opened


@pytest.fixture(scope="module")
def seen(report, browser) -> Seen:
    return look_at(browser, report, 390)


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
        *("answer", "question", "outcome", "picture", "space", "time", "maps", "force", "ledger"),
        *("data", "trust", "all", "again"),
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
    assert "a<script>b" not in text
    assert unpack(text, "views")["views"][0]["name"] == "a<script>b"


def unpack(text: str, name: str) -> Any:
    """What a page carries under an id, as page.js reads it."""
    found = re.search(rf'<script type="text/plain" id="{name}">([^<&]*)</script>', text)
    assert found
    digits = found[1].translate({new: old for old, new in OF_MARKUP.items()})
    return json.loads(gzip.decompress(base64.b85decode(digits)))


def test_a_page_of_one_run_is_small(runs, tmp_path):
    out = tmp_path / "report.html"
    write_report(runs[:1], out, "html")
    assert out.stat().st_size < 2_430_000  # of 120 quads; 2.5 MB with the default mesh


def test_numbers_come_back_from_the_page_to_four_digits():
    values = np.random.default_rng(1).normal(size=(50, 3)) * 10.0 ** np.arange(-3, 3, 2)
    back = np.frombuffer(base64.b64decode(floats(values)["b"]), "<f4").reshape(50, 3)
    assert back == pytest.approx(values, rel=6.2e-5)
    assert integers(np.array([[0, 65535]]))["i"] == 2
    assert integers(np.array([[0, 65536]]))["i"] == 4


def test_nothing_is_named_by_its_key(report):
    own = re.sub(r"<(code|pre|script|style)\b.*?</\1>", "", report.read_text(), flags=re.DOTALL)
    words = re.sub(r"<[^>]*>", " ", own)
    keys = {w for w in re.findall(r"\b[A-Za-z]+_\w+", words) if not w.startswith("isometric_edc")}
    assert keys == set()


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


def test_everything_is_drawn_whole_named_and_used(seen):
    check_look(seen)
    assert seen.look["canvases"] == 1
    for moment in seen.look["seen"]:
        assert moment["colours"] > 500


def test_every_table_and_picture_is_saved(seen):
    saved = [name for name, _ in seen.used["saved"]]
    assert len(set(saved)) == len(saved)
    assert {name.rpartition(".")[2] for name in saved} == {"csv", "png", "svg"}
    tables = len(parse(seen.html).tables)
    assert sum(name.endswith(".csv") for name in saved) == tables + len(seen.look["charts"])


def test_the_slider_moves_what_is_seen(seen):
    last, first = seen.look["seen"]
    assert (last["frame"], first["frame"]) == ("loaded", "unloaded")
    assert last["sum"] != first["sum"]
    assert last["readout"] != first["readout"]
    assert len(last["maps"]) == 4
    assert last["maps"][:2] != first["maps"][:2]
    assert last["maps"][2:] == first["maps"][2:], "a motion's map has its end alone"


def test_arrow_keys_move_the_slider_and_turn_the_view(seen, browser):
    browser.ask("document.getElementById('slider').focus()")
    before = browser.ask("cosimPage.now.frame")
    browser.press("ArrowRight" if before == 0 else "ArrowLeft")
    assert browser.ask("cosimPage.now.frame") != before
    eye = browser.ask("document.querySelector('.scene').focus(), cosimPage.camera.eye.x")
    browser.press("ArrowLeft")
    assert browser.ask("cosimPage.camera.eye.x") != eye


def test_the_values_beside_the_slider_are_the_runs(seen, tables):
    outcome = {row[0]: row[2] for row in tables["outcome"]["rows"]}
    said = seen.look["seen"][0]["readout"]
    assert f"{outcome['fingertip force, magnitude']:.3g} N" in said
    assert f"{outcome['PIP angle']:.2f}°" in said


def test_chromium_shows_the_numbers_of_the_json(seen, tables):
    check_cells(parse(seen.html), tables)


def test_a_browser_that_cannot_unpack_is_told_which_can(report, browser, tmp_path):
    old = tmp_path / "old.html"
    text = report.read_text(encoding="utf-8")
    old.write_text(text.replace("<head>", "<head><script>delete DecompressionStream</script>", 1))
    browser.open(old, 800)
    assert "newer browser" in browser.ask("document.getElementById('stuck').innerText")
    assert browser.ask("testErrors") == []
