"""The tags of FEBio's files, read and made."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar, Self, TypeAlias

import numpy as np
from lxml import etree

from cosim import xml_tree
from cosim.errors import InputError
from cosim.xml_tree import Limits, Rows, read_tree, short
from fe_solver.job.expressions import Expression, split_formulas

LIMITS = Limits(
    bytes=1 << 30,
    tags=200_000,
    depth=32,
    rows=3_000_000,
    encodings=("UTF-8", "UTF-16", "ISO-8859-1"),
)


class FebTag(xml_tree.Tag):
    """A tag of FEBio's."""

    __slots__ = ()
    SEPARATORS: ClassVar[str] = ","
    ROWS: ClassVar[frozenset[str]] = frozenset(
        ("node elem e n delem pt point face quad4 tri3 tri6 quad8 quad9 line2 line3 edge").split()
    )

    @property
    def name(self) -> str:
        """As the file calls it."""
        return self.kind

    @property
    def path(self) -> str:
        """Names of the tags from below the root to this one."""
        above = self.parent
        return self.kind if above is None or above.parent is None else f"{above.path}/{self.kind}"

    @property
    def place(self) -> str:
        """The path in brackets."""
        return f"<{self.path}>"

    @contextmanager
    def naming_place(self) -> Iterator[None]:
        """Errors from within are told with this tag's place."""
        try:
            yield
        except InputError as error:
            raise self.fault(str(error)) from error

    def attribute(self, name: str) -> str:
        """The attribute of this name.  Raises InputError where it is missing."""
        if name not in self.attributes:
            raise self.fault(f"the attribute {name!r} is missing")
        return self.attributes[name].strip()

    def known(self, what: str, kind: str, known: Collection[str]) -> str:
        """`kind`, which must be one of those known.  Raises InputError."""
        if kind not in known:
            raise self.fault(f"the {what} {kind!r} is not read; known: {', '.join(known)}")
        return kind

    def kind_of(self, what: str, known: Collection[str]) -> str:
        """The attribute `type`, which must be one of those known.  Raises InputError."""
        return self.known(what, self.attribute("type"), known)

    def needed(self, name: str, words: str = "") -> Self:
        """The child of that name.  Raises InputError, with `words` for what it holds, where there
        is none."""
        child = self.one(name)
        if child is None:
            raise self.fault(f"<{name}> is missing" + (f": {words}" if words else ""))
        return child

    def number(self) -> float:
        """A number, or a formula of numbers: neither changes in time or space."""
        if self.attributes.get("lc", "0").strip() not in ("", "0"):
            raise self.fault("only a constant is read here, not one with lc=")
        (formula,) = self.formulas(1, ())
        return float(formula.value({}))

    def formulas(self, count: int, variables: tuple[str, ...]) -> list[Expression]:
        """So many formulas of some variables: FEBio's math parameters, or plain numbers.

        Raises InputError where they are neither, and for a parameter of another type."""
        kind = self.attributes.get("type", "const")
        if kind not in ("const", "math"):
            raise self.fault(f"a value of type {kind!r} is not read here")
        values = self.split(self.text)
        if kind == "const" and values is not None:
            return [Expression(repr(v), ()) for v in self.numbers(count)]
        texts = split_formulas(self.text)
        if len(texts) != count:
            many = f"{count} numbers or formulas" if count > 1 else "a number or a formula"
            raise self.fault(f"expected {many}, got {short(self.text)}")
        with self.naming_place():
            return [Expression(t, variables) for t in texts]

    def value(self, name: str, default: float) -> float:
        """The number in the child of that name."""
        child = self.one(name)
        return default if child is None else child.number()

    def flag(self, name: str) -> bool:
        """Whether the child of that name is there and not 0."""
        return self.value(name, 0.0) != 0

    def table(self) -> Rows:
        """The rows of numbers.  Raises InputError where anything else stands among them."""
        self.tabled = True
        for other in self.children:
            raise other.fault("expected a row of numbers with at most one attribute, its id")
        return self.rows or Rows()


def read_xml(path: Path, root: str) -> FebTag:
    """The tree of a file of FEBio's whose root has that name.  Raises InputError."""
    return read_tree(path, root, FebTag, LIMITS)


Element: TypeAlias = Any
"""A tag of lxml's, which has no types."""


def tag(kind: str, *content: object, **attributes: object) -> Element:
    """A tag that holds other tags, or a text: numbers as `text` says.

    Raises InputError for a text with characters that XML has no place for."""
    out = etree.Element(kind)
    try:
        for name, value in attributes.items():
            out.set(name, text(value))
        for part in content:
            if etree.iselement(part):
                out.append(part)
            else:
                out.text = text(part)
    except ValueError as error:
        raise InputError(f"<{kind}> cannot be written: {error}") from error
    return out


def comment(words: str) -> Element:
    """A remark that nobody reads but people; a comment ends at two hyphens."""
    return etree.Comment(f" {words.replace('--', '- -')} ")


def text(value: Any) -> str:
    """A text as it is, a number with all of its digits (a truth as 1 or 0), several with commas
    between."""
    if isinstance(value, str):
        return value
    return ",".join(map(repr, (np.ravel(value) * 1).tolist()))


def write_xml(path: Path, root: Element) -> None:
    """Write a tree as a file of FEBio's."""
    etree.ElementTree(root).write(path, encoding="UTF-8", xml_declaration=True, pretty_print=True)
