"""Commands of several functions: which is called, what is refused; the names that there were."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Annotated

import pytest
import typer
from typer.main import get_command
from typer.testing import CliRunner, Result

from cosim.cli import COMMANDS, MOVED, app
from cosim.commands.door import door
from cosim.commands.terminal import exit_on_error
from tests.helpers.folders import ROOT

Place = Annotated[Path | None, typer.Option("--out", "-o", help="Where.")]
Size = Annotated[int, typer.Option(min=1, help="How large.")]


def picture(names: list[str], out: Path, width: Size = 7) -> None:
    typer.echo(f"picture {names} {out} {width}")


def table(names: list[str], out: Path, digits: Annotated[str, typer.Option(help="Of.")]) -> None:
    typer.echo(f"table {names} {out} {digits}")


def window(names: list[str]) -> None:
    typer.echo(f"window {names}")


def undone(undo: Annotated[bool, typer.Option("--undo", help="Undo.")], width: Size = 3) -> None:
    typer.echo(f"undone {width}")


@door({"": window, ".png": picture, ".svg": picture, ".csv": table, "--undo": undone})
def command(
    names: Annotated[list[str] | None, typer.Argument(metavar="NAME", help="Of what.")] = None,
    out: Place = None,
) -> None:
    """What it does."""


def called(*words: str) -> Result:
    alone = typer.Typer()
    alone.command()(exit_on_error()(command))
    return CliRunner().invoke(alone, words, prog_name="it")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("a b", "window ['a', 'b']"),
        ("a -o p.PNG", "picture ['a'] p.PNG 7"),
        ("a -o p.svg --width 7", "picture ['a'] p.svg 7"),
        ("a -o t.csv --digits 2", "table ['a'] t.csv 2"),
        ("--undo", "undone 3"),
        ("--undo --width 5", "undone 5"),
    ],
)
def test_an_ending_or_an_option_says_which_function_is_called(words: str, said: str) -> None:
    done = called(*words.split())
    assert (done.exit_code, done.output) == (0, f"{said}\n")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("", "NAME is missing; see it -h"),
        ("a -o t.txt", "t.txt: is of no known kind; name a file ending in one of .png, .svg, .csv"),
        ("a -o t.csv", "--digits is missing; see it -h"),
        ("a -o p.png --digits 2", "--digits: does not go with .png, only with .csv; leave it out"),
        ("a --digits 2", "--digits: does nothing here, only with .csv; leave it out"),
        ("a --width 7", "--width: does nothing here, only with .png, .svg, --undo; leave it out"),
        ("a --undo", "NAME: does not go with --undo, only with .png, .svg, .csv; leave it out"),
    ],
)
def test_what_a_function_does_not_take_is_refused_in_one_message(words: str, said: str) -> None:
    done = called(*words.split())
    assert (done.exit_code, done.stderr, done.stdout) == (2, f"cosim: {said}\n", "")


def test_the_help_says_whose_an_option_is() -> None:
    told = " ".join(called("--help").output.replace("│", " ").split())
    assert ".csv: Of." in told
    assert ".png, .svg, --undo: How large." in told
    assert "--undo: Undo" not in told


def test_two_options_of_one_name_are_an_error_of_the_program() -> None:
    def other(width: Annotated[int, typer.Option("--wide")] = 1) -> None: ...

    with pytest.raises(TypeError, match="--undo has another option called width"):
        door({"": other, "--undo": undone})(window)


def test_a_name_that_there_was_says_what_is_typed_now() -> None:
    for name, line in MOVED.items():
        done = CliRunner().invoke(app, [name, "split_edc"])
        assert done.exit_code == 2
        assert f"No such command {name!r}. It is now: cosim {line}" in done.stderr


def test_the_changelog_has_a_line_for_every_name_that_there_was() -> None:
    log = (ROOT / ".github" / "CHANGELOG.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `cosim ([^`]+)` \| `cosim ([^`]+)`", log, re.MULTILINE)
    assert {old.split()[0] for old, _ in rows} == set(MOVED)
    commands, outer = {n for named in COMMANDS.values() for n in named}, get_command(app)
    for _, new in rows:
        name, *words = shlex.split(new.replace("...", ""))
        assert name in commands
        with outer.make_context("cosim", [name]) as context:
            inner = outer.get_command(context, name)
        inner.make_context(name, words)
