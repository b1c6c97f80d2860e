"""Published figures and tables computed anew by scripts with cells.

A script of `cases/papers/` is a notebook in jupytext's percent format.  Its cells up to the first
study load what all studies need; a study begins with a markdown line `## name: what it is about`
and a figure of it with `### Title`.  A code cell with a name, `# %% name`, ends with `show(...)`;
what that shows is written under the name.  A text may hold numbers that the cells before it
computed, as an f-string does: `{force[-1]:.2f}`.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import pandas as pd

from cosim.errors import InputError
from cosim.report.figures import Figure, FigurePage, FigureStudy, Shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture

MARKER = re.compile(r"# %%(?: (?!\[)(?P<name>\S+))?(?P<text> \[markdown\])?")
STUDY = re.compile(r"^## (\S+): (.*)$", re.MULTILINE)


@dataclass(frozen=True)
class Cell:
    """A part of a script between two lines that begin with `# %%`."""

    name: str
    """The name of the files that are written of what it shows, without an ending; "" where it shows
    nothing."""
    is_text: bool
    source: str
    line: int
    """Where the source begins in its file, from 0."""


class Script:
    """A publication's figures as a script; `values` replace names of its shared cells."""

    def __init__(self, path: Path, values: Mapping[str, object] | None = None) -> None:
        self.path, self.values = path, values or {}
        self.shared: list[Cell] = []
        self.studies: dict[str, tuple[str, list[Cell]]] = {}
        """What each study is about, and its cells."""
        part = self.shared
        for cell in _cells(path.read_text(encoding="utf-8")):
            if cell.is_text and (head := STUDY.search(cell.source)):
                part = []
                self.studies[head[1]] = head[2], part
            part.append(cell)

    def page(self, name: str, command: str = "") -> FigurePage:
        """The page of its figures, whose studies run when they are asked for."""
        texts = list(_paragraphs(self.shared[0].source))
        studies = [
            FigureStudy(study, about, lambda study=study: self.run(study))  # type: ignore[misc]
            for study, (about, _) in self.studies.items()
        ]
        title = texts[0].removeprefix("# ")
        return FigurePage(name, title, tuple(studies), made_by=command, notes=tuple(texts[1:]))

    @cached_property
    def names(self) -> dict[str, Any]:
        """What the shared cells define, with the values in place of theirs.

        Raises KeyError for a value of a name that they do not define."""
        names: dict[str, Any] = {"__name__": f"cases.papers.{self.path.stem}"}
        for cell in self.shared:
            if not cell.is_text:
                self._run(cell, names)
        for name, value in self.values.items():
            names[name]  # KeyError where the script has none
            names[name] = value
        return names

    def run(self, study: str) -> list[Figure]:
        """A study's figures.  Raises what its models raise."""
        return [figure.finish() for figure in self._run_study(study, dict(self.names))]

    def _run_study(self, study: str, names: dict[str, Any]) -> list[_Begun]:
        begun: list[_Begun] = []
        for cell in self.studies[study][1]:
            if not cell.is_text:
                shown = self._run(cell, names)
                if shown is not None:
                    _add(begun, cell.name, shown)
                continue
            for text in _paragraphs(cell.source):
                if text.startswith("### "):
                    begun.append(_Begun(_fill(text[4:], names)))
                elif not text.startswith("#"):
                    begun[-1].texts.append(_fill(text, names))
        return begun

    def _run(self, cell: Cell, names: dict[str, Any]) -> Shown | None:
        """What the last line of a code cell with a name shows; None of one without."""
        tree = ast.increment_lineno(ast.parse(cell.source), cell.line)
        last = cast(ast.Expr, tree.body.pop()).value if cell.name else None
        exec(compile(tree, self.path, "exec"), names)
        if last is None:
            return None
        return cast(Shown, eval(compile(ast.Expression(last), self.path, "eval"), names))


@dataclass
class _Begun:
    """A figure while its cells run."""

    title: str
    texts: list[str] = field(default_factory=list)
    name: str = ""
    picture: Picture | None = None
    tables: dict[str, pd.DataFrame] = field(default_factory=dict)

    def finish(self) -> Figure:
        """The figure, named as its picture or its first table."""
        name = self.name or next(iter(self.tables), re.sub(r"\W+", "_", self.title))
        return Figure(name, self.title, " ".join(self.texts), self.picture, self.tables)


def _add(begun: list[_Begun], name: str, shown: Shown) -> None:
    """Put what a cell shows into the last figure, or into new ones of tables with titles."""
    if shown.picture is not None:
        begun[-1].name, begun[-1].picture = name, shown.picture
    if shown.table is not None:
        begun[-1].tables[name] = shown.table
    for key, table in shown.tables.items():
        if "title" in table.attrs:
            begun.append(_Begun(table.attrs["title"]))
        begun[-1].tables[key] = table


def _fill(text: str, names: dict[str, Any]) -> str:
    """A text of a script with its numbers."""
    return str(eval(f"f{text!r}", names))


def open_paper(name: str, values: Mapping[str, object] | None = None) -> Script:
    """The script of this name in a checkout.  Raises InputError where there is none."""
    path = Path(str(files("cases"))) / "papers" / f"{name}.py"
    if not path.is_file():
        raise InputError(
            "cosim reproduce: the scripts of papers are not in an installation: clone the "
            "repository, and in it pip install -e ."
        )
    return Script(path, values)


def _cells(text: str) -> Iterator[Cell]:
    lines = text.splitlines()
    starts = [k for k, line in enumerate(lines) if line.startswith("# %%")]
    for start, end in zip(starts, [*starts[1:], len(lines)], strict=True):
        head = MARKER.match(lines[start])
        assert head is not None
        body = lines[start + 1 : end]
        if head["text"]:
            body = [line.removeprefix("#").removeprefix(" ") for line in body]
        yield Cell(head["name"] or "", bool(head["text"]), "\n".join(body), start + 1)


def _paragraphs(text: str) -> Iterator[str]:
    """Headings and paragraphs, each on one line."""
    apart = re.sub(r"^(##.*)$", r"\n\1\n", text, flags=re.MULTILINE)
    for part in re.split(r"\n\s*\n", apart.strip()):
        if part.strip():
            yield " ".join(part.split())
