"""Reading XML that nobody vouches for into a small tree, with the line of every tag.

A stream through expat: document type declarations (hence entities of any kind) are refused when
they begin, nothing outside the file is opened, and size, depth, tags, rows and texts are bounded.
Rows of numbers (`<node id="1">0,0,0</node>`) never become tags: they are kept as numbers.
"""

from __future__ import annotations

import os
from array import array
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from cosim.port import InputError

CHUNK = 1 << 16
MOST_BYTES = 1 << 30
MOST_TAGS = 500_000
MOST_ROWS = 20_000_000
MOST_DEPTH = 32
MOST_TEXT = 8 << 20
MOST_MARKUP = 1 << 20
ENCODINGS = ("UTF-8", "UTF-16", "ISO-8859-1", "US-ASCII")
ROWS = frozenset({"node", "elem", "e", "n", "delem", "pt", "point", "face", "quad4", "tri3"})


@dataclass
class Rows:
    """Leaf tags of numbers within one tag: kind, number (the first attribute, else the position),
    line, and the values, row i from start[i] on."""

    kind: list[str] = field(default_factory=list)
    number: array[int] = field(default_factory=lambda: array("q"))
    line: array[int] = field(default_factory=lambda: array("q"))
    start: array[int] = field(default_factory=lambda: array("q", [0]))
    values: array[float] = field(default_factory=lambda: array("d"))


@dataclass(slots=True)
class Tag:
    """A tag with its place; `used` becomes true once something has read it, `tabled` once its
    rows were."""

    name: str
    attributes: dict[str, str]
    file: str
    path: str
    line: int
    text: str = ""
    children: list[Tag] = field(default_factory=list)
    rows: Rows | None = None
    used: bool = False
    tabled: bool = False

    def fault(self, message: str, line: int | None = None) -> InputError:
        """An error that names file, line and place."""
        return InputError(f"{self.file}, line {line or self.line}, <{self.path}>: {message}")

    @contextmanager
    def told(self) -> Iterator[None]:
        """Errors from within are told with this tag's place."""
        try:
            yield
        except InputError as error:
            raise self.fault(str(error)) from error

    def all(self, name: str) -> list[Tag]:
        """The children of that name."""
        found = [c for c in self.children if c.name == name]
        for c in found:
            c.used = True
        return found

    def one(self, name: str) -> Tag | None:
        """The only child of that name, or none.  Raises InputError where there are more."""
        found = self.all(name)
        if len(found) > 1:
            raise found[1].fault(f"<{name}> comes twice; the first is in line {found[0].line}")
        return found[0] if found else None

    def attribute(self, name: str) -> str:
        """Raises InputError where it is missing."""
        if name not in self.attributes:
            raise self.fault(f"the attribute {name!r} is missing")
        return self.attributes[name].strip()

    def numbers(self, count: int | None = None) -> list[float]:
        """The text's numbers, separated by commas or spaces."""
        values = _numbers(self.text)
        if values is None or (count is not None and len(values) != count):
            many = "numbers" if count is None else f"{count} number{'s' * (count != 1)}"
            raise self.fault(f"expected {many}, got {_short(self.text)}")
        return values

    def number(self) -> float:
        """A number that does not change in time or space."""
        for name in ("lc", "type"):
            if self.attributes.get(name, "const") != "const":
                raise self.fault(f"only a constant is read here, not one with {name}=")
        return self.numbers(1)[0]

    def value(self, name: str, default: float) -> float:
        """The number in the child of that name."""
        child = self.one(name)
        return default if child is None else child.number()

    def flag(self, name: str) -> bool:
        """Whether the child of that name is there and not 0."""
        return self.value(name, 0.0) != 0

    def word(self, name: str, default: str) -> str:
        """The text of the child of that name."""
        child = self.one(name)
        return default if child is None else child.text.strip()

    def table(self) -> Rows:
        """The rows of numbers."""
        self.tabled = True
        return self.rows or Rows()

    def pass_over(self) -> None:
        """Count this tag and all below it as read."""
        self.used = self.tabled = True
        for c in self.children:
            c.pass_over()

    def unread(self) -> Iterator[Tag]:
        """Tags below this one that nothing has read, none within another."""
        for c in self.children:
            if not c.used or (c.rows and not c.tabled):
                yield c
            else:
                yield from c.unread()


def _short(text: str) -> str:
    text = " ".join(text.split())
    return repr(text if len(text) <= 40 else text[:37] + "...")


def _numbers(text: str) -> list[float] | None:
    """The finite numbers of a text, or None where something else stands there."""
    try:
        values = [float(v) for v in text.replace(",", " ").split()]
    except ValueError:
        return None
    return values if all(v - v == 0 for v in values) else None


def read_xml(path: Path, root: str) -> Tag:
    """The tree of an XML file whose root has that name.

    Raises InputError (naming file and line) where the file cannot be read, is not XML, declares a
    document type, or exceeds a limit."""
    reader = _Reader(str(path), root)
    try:
        with open(path, "rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            if size > MOST_BYTES:
                raise InputError(
                    f"{path}: {size / 2**30:.1f} GB is more than the {MOST_BYTES >> 30} GB that "
                    "this reader takes; split the model"
                )
            while chunk := stream.read(CHUNK):
                reader.feed(chunk)
            return reader.finish()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except expat.ExpatError as error:
        what = expat.ErrorString(error.code)
        raise InputError(f"{path}, line {error.lineno}: not well-formed XML: {what}") from error


class _Reader:
    """The tree under construction."""

    def __init__(self, file: str, root: str) -> None:
        self.file, self.root = file, root
        self.stack: list[Tag] = []
        self.done: Tag | None = None
        self.texts: list[str] = []
        self.size = self.tags = self.rows = self.silent = 0
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._characters
        self.parser.CommentHandler = lambda _: self._heard()
        self.parser.StartDoctypeDeclHandler = self._doctype
        self.parser.XmlDeclHandler = self._declared

    def feed(self, chunk: bytes) -> None:
        self.silent += len(chunk)
        self.parser.Parse(chunk, False)
        if self.silent > MOST_MARKUP:
            raise self._fault(f"one tag or comment is longer than {MOST_MARKUP >> 20} MB")

    def finish(self) -> Tag:
        self.parser.Parse(b"", True)
        assert self.done is not None
        return self.done

    def _fault(self, message: str) -> InputError:
        return InputError(f"{self.file}, line {self.parser.CurrentLineNumber}: {message}")

    def _heard(self) -> None:
        self.silent = 0

    def _declared(self, _: str, encoding: str | None, __: int) -> None:
        if encoding is not None and encoding.upper() not in ENCODINGS:
            raise self._fault(f"the encoding {encoding[:40]!r} is not read; save it as UTF-8")

    def _doctype(self, *_: object) -> None:
        raise self._fault(
            "a document type declaration (and with it entities) is refused; remove <!DOCTYPE ...>"
        )

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        self._heard()
        if not self.stack and name != self.root:
            raise self._fault(f"the root is <{name[:40]}>, expected <{self.root}>")
        if len(self.stack) >= MOST_DEPTH:
            raise self._fault(f"tags are nested more than {MOST_DEPTH} deep")
        self._no_stray_text()
        path = f"{self.stack[-1].path}/{name}" if len(self.stack) > 1 else name
        line = self.parser.CurrentLineNumber
        self.stack.append(Tag(name, attributes, self.file, path, line))

    def _characters(self, text: str) -> None:
        self._heard()
        self.size += len(text)
        if self.size > MOST_TEXT:
            raise self._fault(f"a text is longer than {MOST_TEXT >> 20} MB")
        self.texts.append(text)

    def _end(self, name: str) -> None:
        self._heard()
        tag = self.stack.pop()
        if tag.children or tag.rows:
            self._no_stray_text()
        tag.text = "".join(self.texts)
        self.texts, self.size = [], 0
        if not self.stack:
            self.done = tag
        elif name in ROWS and not tag.children and not tag.rows and len(tag.attributes) <= 1:
            self._row(self.stack[-1], tag)
        else:
            self.tags += 1
            if self.tags > MOST_TAGS:
                raise self._fault(f"more than {MOST_TAGS} tags besides rows of numbers")
            self.stack[-1].children.append(tag)

    def _no_stray_text(self) -> None:
        stray = "".join(self.texts)
        self.texts, self.size = [], 0
        if stray.strip():
            raise self._fault(f"text among tags: {_short(stray)}")

    def _row(self, parent: Tag, tag: Tag) -> None:
        self.rows += 1
        if self.rows > MOST_ROWS:
            raise self._fault(f"more than {MOST_ROWS} rows of numbers")
        values = _numbers(tag.text)
        if values is None:
            raise tag.fault(f"expected numbers, got {_short(tag.text)}")
        rows = parent.rows = parent.rows or Rows()
        number = next(iter(tag.attributes.values()), str(len(rows.kind) + 1)).strip()
        if not (number.isascii() and number.isdecimal() and len(number) < 10):
            raise tag.fault(f"expected a whole number as its id, got {_short(number)}")
        rows.kind.append(tag.name)
        rows.number.append(int(number))
        rows.line.append(tag.line)
        rows.values.extend(values)
        rows.start.append(len(rows.values))
