"""Arguments and options that several commands share, and how their texts are read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from cosim.errors import InputError
from cosim.number_text import read_numbers
from cosim.schema import units

CaseName = Annotated[str, typer.Argument(metavar="CASE", help="Case file, or a packaged case.")]
Cases = Annotated[
    list[str], typer.Argument(metavar="CASE", help="Case files, or names of packaged cases.")
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Replace a value of the case; repeatable."),
]
Workers = Annotated[int, typer.Option(min=1, max=256, help="Processes that solve side by side.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Say only what is wrong.")]
AsJsonLines = Annotated[
    bool, typer.Option("--json", help="Print stages and results as lines of JSON, for machines.")
]


def option(what: str, *names: str, **more: Any) -> Any:
    """An option whose help is `what`, with its names and more where they are not as Typer has
    them."""
    return typer.Option(*names, help=what, **more)


def to(what: str, metavar: str | None = None) -> Any:
    """The option --out, of a file or folder."""
    return option(what, "--out", "-o", metavar=metavar)


def one_of(paths: Sequence[Path], what: str) -> Path:
    """The only path.  Raises InputError for several."""
    if len(paths) > 1:
        raise InputError(f"{what}: of one file or folder, not of {len(paths)}; name one")
    return paths[0]


def pairs_of(option: str, texts: Sequence[str] | None, example: str) -> list[tuple[str, str]]:
    """Both sides of each text `A=B` of an option.  Raises InputError for other texts."""
    pairs = [(a.strip(), b.strip()) for a, _, b in (text.partition("=") for text in texts or ())]
    for text, (left, right) in zip(texts or (), pairs, strict=True):
        if not left or not right:
            raise InputError(f"{option} {text!r}: write, for example, {option} {example}")
    return pairs


def three_numbers(option: str, text: str, example: str) -> list[float]:
    """The three numbers of an option.  Raises InputError for another text."""
    numbers = read_numbers(text)
    if numbers is not None and len(numbers) == 3:
        return numbers
    raise InputError(f'{option} {text!r}: write three numbers, for example "{example}"')


def quantity(option: str, text: str, kind: units.Kind) -> float:
    """The SI value of an option's text with its unit.  Raises InputError."""
    try:
        return units.parse(text.strip('"'), kind)
    except ValueError as error:
        raise InputError(f'{option} "{text}": {error}') from error


def quantities(option: str, texts: Sequence[str] | None, kind: units.Kind) -> dict[str, float]:
    """The SI values of an option's texts NAME=QUANTITY.  Raises InputError."""
    pairs = pairs_of(option, texts, f"NAME={kind.example}")
    return {name: quantity(f"{option} {name}", text, kind) for name, text in pairs}
