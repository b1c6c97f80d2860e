"""The documentation: every README is in it, and each link of the built pages leads somewhere."""

from __future__ import annotations

import re
import subprocess
import sys
from functools import cache
from pathlib import Path
from urllib.parse import unquote, urldefrag

import pytest
from lxml import html
from typer.main import get_command

import cosim
from cases.docs import PLACES, build, lay_pages
from cases.reference import reference_pages
from cosim.cli import app
from cosim.errors import InputError
from cosim.extras import EXTRAS
from tests.helpers.folders import ROOT

LOADED = {
    "script": "src",
    "link": "href",
    "img": "src",
    "iframe": "src",
    "source": "src",
    "object": "data",
}
"""By element the attribute whose file a browser fetches to show a page."""
UNLISTED = {".github/PULL_REQUEST_TEMPLATE.md", ".paper/paper.md"}
"""Texts that are no page."""


def test_every_text_of_the_repository_has_a_place():
    texts = {
        path.relative_to(ROOT).as_posix()
        for folder in (".", ".docs", ".github", ".paper", "cosim", "fe_solver", "rigid", "meshes")
        for path in (ROOT / folder).glob("*.md" if folder == "." else "**/*.md")
    }
    texts |= {path.relative_to(ROOT).as_posix() for path in ROOT.glob("cases/**/*.md")}
    texts.add("tests/README.md")
    assert texts - UNLISTED == set(PLACES)
    assert len(set(PLACES.values())) == len(PLACES)


def test_links_are_rewritten_to_the_places(tmp_path: Path):
    lay_pages(tmp_path)
    contributing = (tmp_path / "contributing.md").read_text(encoding="utf-8")
    assert "](index.md#set-up)" in contributing
    assert "](developers.md)" in contributing
    program = (tmp_path / "cosim" / "index.md").read_text(encoding="utf-8")
    assert "](../trust.md)" in program
    assert (tmp_path / "cases" / "isometric" / "picture.png").is_file()


def test_a_link_that_leads_nowhere_is_a_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "README.md").write_text("See [it](gone.md).", encoding="utf-8")
    monkeypatch.setattr("cases.docs.ROOT", tmp_path)
    with pytest.raises(InputError, match=r"README.md: the link to gone.md"):
        lay_pages(tmp_path / "stage")


def test_what_is_absent_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Sphinx, or the checkout that a wheel is not."""
    monkeypatch.setattr("cases.docs.require", lambda *_: None)
    monkeypatch.setattr("cases.docs.ROOT", tmp_path)
    with pytest.raises(InputError, match=r"built in a checkout; .* has no \.docs"):
        build(tmp_path / "site")
    monkeypatch.undo()
    monkeypatch.setitem(sys.modules, "sphinx", None)
    with pytest.raises(InputError, match=r"needs sphinx, .*: pip install '\.\[docs\]'"):
        build(tmp_path / "site")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    for library in EXTRAS["docs"]:
        pytest.importorskip(library)
    folder = tmp_path_factory.mktemp("docs") / "site"
    command = [sys.executable, "-m", "cases.docs", str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


@cache
def tree(page: Path) -> html.HtmlElement:
    return html.fromstring(page.read_bytes())


@cache
def anchors(page: Path) -> set[str]:
    return set(tree(page).xpath("//@id | //@name"))


@pytest.mark.slow
def test_every_link_inside_the_site_leads_somewhere(site: Path):
    followed = 0
    for page in site.rglob("*.html"):
        for link in tree(page).xpath("//@href | //@src"):
            if re.match(r"\w+:", link) or not link.strip("#"):
                continue
            path, anchor = urldefrag(re.sub(r"\?[^#]*", "", unquote(link)))
            target = (page.parent / path).resolve() if path else page
            assert target.is_file(), f"{page.relative_to(site)}: {link}"
            if anchor and target.suffix == ".html":
                assert anchor in anchors(target), f"{page.relative_to(site)}: {link}"
            followed += 1
    assert followed > 500


@pytest.mark.slow
def test_no_page_fetches_anything_from_the_net(site: Path):
    for page in site.rglob("*.html"):
        for element, attribute in LOADED.items():
            for address in tree(page).xpath(f"//{element}/@{attribute}"):
                assert not re.match(r"(https?:)?//", address), (
                    f"{page.relative_to(site)}: {address}"
                )
    for sheet in (*site.rglob("*.css"), *site.rglob("*.html")):
        text = sheet.read_text(encoding="utf-8")
        assert not re.search(r"url\(\s*['\"]?(https?:)?//|@import", text), sheet


@pytest.mark.slow
def test_the_python_pages_show_the_public_face(site: Path):
    page = tree(site / "api" / "cosim.html")
    shown = set(page.xpath("//dt/@id"))
    assert {f"cosim.{name}" for name in cosim.__all__ if name != "__version__"} <= shown


def test_the_python_pages_ask_for_every_public_name():
    asked = (ROOT / ".docs" / "api" / "cosim.md").read_text(encoding="utf-8")
    names = set(re.findall(r":: (\w+)$", asked, re.M))
    assert set(cosim.__all__) - {"__version__"} <= names


def test_the_reference_has_every_command_key_and_number():
    commands, keys, numbers = reference_pages().values()
    for name in get_command(app).commands:
        assert f"## cosim {name}\n" in commands
        assert f"Usage: cosim {name} " in commands
    for key in ("hood.contact.layer", "tendons", "solve", "lesion", "finger.limit"):
        assert f"\n## {key}" in keys
    assert "`cut_partly`" in keys
    assert "| `slip_force_N." in numbers
