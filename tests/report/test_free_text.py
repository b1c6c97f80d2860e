"""What a user writes into a case, a study or a table is text in every page, never a part of it."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from typer.testing import CliRunner

import cosim
from cosim.cli import app
from cosim.results.compare import compare_with_targets, read_targets
from cosim.study import page as study_page
from cosim.validation.page import write_page
from cosim.validation.run import Board
from cosim.validation.scoreboard import join_uncertainty
from tests.helpers.fixed_posture import HELD
from tests.helpers.folders import forget_digest
from tests.helpers.report_runs import run_into

TAG = "x-evil"
END = f"<{TAG} onload=alert(1)>{{{{7*7}}}}&lt;"
"""Without a slash or a quote, for a file's name."""
EVIL = f"\"'></script></style></title></textarea>--><!--]]>{END}"
"""It would end whatever it stands in, and begin a tag of its own."""
AS_TOML = json.dumps(EVIL)


class Texts(HTMLParser):
    """The texts of a page as a browser has them, with those of attributes, and its tags."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.texts: list[str] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.texts += [value or "" for _, value in attrs]
        assert not any(name == "onload" for name, _ in attrs)

    def handle_data(self, data: str) -> None:
        self.texts.append(data)

    def handle_comment(self, data: str) -> None:
        assert TAG not in data


def check(page: str, least: int) -> None:
    """The text stands in the page so often at least, and nothing of it is a tag."""
    found = Texts(page)
    assert TAG not in found.tags
    every = "\0".join(found.texts)
    assert every.count(EVIL) + every.count(EVIL.replace("--><!--", "-->\n<!--")) >= least
    assert not re.search(rf"<{TAG}\b", page)  # in no script, style or attribute either


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run with such a text wherever its files hold one."""
    made = run_into(tmp_path, "network_edc", "output.picture=false")
    folder = made.rename(made.with_name(END))
    text = (folder / "case.toml").read_text(encoding="utf-8")
    text = re.sub(
        r"^title = .*$", lambda _: f"title = {AS_TOML}\nnotes = {AS_TOML}", text, flags=re.M
    )
    (folder / "case.toml").write_text(text, encoding="utf-8")
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    (folder / "summary.json").write_text(json.dumps(spoilt(summary)), encoding="utf-8")
    forget_digest(folder)
    ledger = (folder / "ledger.csv").read_text(encoding="utf-8").splitlines()
    quoted = EVIL.replace('"', '""')
    rows = [re.sub("(FDP|network)", lambda m: f'"{m[0]}{quoted}"', row) for row in ledger]
    (folder / "ledger.csv").write_text("\n".join(rows), encoding="utf-8")
    return folder


def spoilt(summary: dict) -> dict:
    """Texts and the names of tendons and sources are others."""
    for key in ("tension_N", "excursion_mm", "moment_arm_mm", "joint_torque_Nmm", "slip_force_N"):
        for table in (summary, summary["unloaded"]):
            if key in table:
                table[key] |= {name + EVIL: value for name, value in table[key].items()}
    summary["warnings"] = [EVIL]
    summary["audit_missed"] = [EVIL]
    summary["version"] = EVIL
    return summary


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """Measured values with such texts."""
    quoted = '"' + EVIL.replace('"', '""') + '"'
    path = tmp_path / "measured.csv"
    path.write_text(
        "name,quantity,unit,reference,source,kind,geometry,note\n"
        f"{quoted},fingertip_force_N.distal,N,0.3,{quoted},experiment,{quoted},{quoted}\n"
        f"{quoted},fingertip_force_N.dorsal,N,0.3,{quoted},inferred,{quoted},{quoted}\n",
        encoding="utf-8",
    )
    return path


def test_in_the_page_of_a_run(run: Path, table: Path, tmp_path: Path) -> None:
    page = cosim.write_report(run, out=tmp_path / "page.html", data=table)
    check(page.read_text(encoding="utf-8"), 10)


def test_in_the_page_of_several_runs(run: Path, table: Path, tmp_path: Path) -> None:
    other = run_into(tmp_path / "other", "network_edc", "output.picture=false")
    page = cosim.write_report(run, other, out=tmp_path / "page.html", data=table)
    check(page.read_text(encoding="utf-8"), 8)


def test_in_a_notebook(run: Path) -> None:
    check(cosim.open_run(run)._repr_html_(), 2)


def test_in_the_page_of_a_lesion(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = f"extends = 'network_edc'\ntitle = {AS_TOML}\nnotes = {AS_TOML}\n"
    Path("mine.toml").write_text(f"{text}lesion.cut = ['central_slip']\noutput.picture = false\n")
    words = ["lesion", "mine.toml", "--page", "page.html", "--workers", "1"]
    done = CliRunner().invoke(app, words, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    check(Path("page.html").read_text(encoding="utf-8"), 2)


STUDY = f"""
title = {AS_TOML}
notes = {AS_TOML}
case = "held.toml"
data = "measured.csv"
[parameters.PIP]
label = {AS_TOML}
values = ["20 deg", "30 deg"]
settings = ["finger.posture.PIP={{value}}"]
[parameters.word]
label = {AS_TOML}
values = [{AS_TOML}]
settings = ["title={{value}}"]
[outputs]
{AS_TOML} = "joint_torque_Nmm.passive.PIP"
"""


def test_in_the_page_of_a_study(tmp_path: Path, table: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(study_page, "picture_address", lambda *_: "")
    Path("held.toml").write_text(f"notes = {AS_TOML}\n{HELD}", encoding="utf-8")
    Path("study.toml").write_text(STUDY, encoding="utf-8")
    cosim.run_study("study.toml")
    check(Path("studies/study/index.html").read_text(encoding="utf-8"), 6)


def test_in_the_page_of_the_validation(tmp_path: Path, table: Path) -> None:
    rows = tuple(compare_with_targets(read_targets(table), {"fingertip_force_N": FORCE}, ""))
    boards = [Board(EVIL, rows, {EVIL: EVIL}, {EVIL: [EVIL]}, kind=kind) for kind in KINDS]
    write_page(tmp_path / "page.html", join_uncertainty(boards, {}))
    check((tmp_path / "page.html").read_text(encoding="utf-8"), 10)


FORCE = {"distal": 0.2, "radial": 0.0, "dorsal": 0.3}
KINDS = ("experiment", "inferred")
