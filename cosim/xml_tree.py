"""Read untrusted XML into a small tree, with the line of every tag.

A stream through expat: document type declarations (hence entities of any kind) are refused when
they begin, nothing outside the file is opened, and size, depth, tags, rows and texts are bounded.
Rows of numbers (`<node id="1">0,0,0</node>`) never become tags: they are kept as numbers.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Generic, Self, TypeVar
from xml.parsers import expat

from cosim.errors import InputError
from cosim.number_text import RANGE, read_numbers

CHUNK = 1 << 16
MOST_NAME = 100
MOST_ATTRIBUTES = 30
MOST_VALUE = 4096
MOST_TEXT = 4 << 20
MOST_TEXTS = 32 << 20
MOST_IN_ROW = 4096
MOST_MARKUP = 1 << 20


@dataclass(frozen=True)
class Limits:
    """The most that is read of a file; `rows`: of numbers."""

    bytes: int
    tags: int
    depth: int
    rows: int = 0
    encodings: tuple[str, ...] = ("UTF-8",)


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

    SEPARATORS: ClassVar[str] = ""
    """Characters between numbers, beside white space."""
    ROWS: ClassVar[frozenset[str]] = frozenset()
    """Kinds of leaf tags that are rows of numbers."""

    kind: str
    attributes: dict[str, str]
    file: str
    parent: Self | None = field(repr=False, compare=False)
    line: int
    text: str = ""
    """The text of a tag without others within."""
    children: list[Self] = field(default_factory=list)
    rows: Rows | None = None
    used: bool = False
    tabled: bool = False

    @property
    def place(self) -> str:
        """Where the tag is, as a person would say it."""
        raise NotImplementedError

    def fault(self, message: str, line: int | None = None) -> InputError:
        """An error that names file, line and place."""
        return InputError(f"{self.file}, line {line or self.line}, {self.place}: {message}")

    def all(self, kind: str) -> list[Self]:
        """The children of that kind."""
        tags = [c for c in self.children if c.kind == kind]
        for c in tags:
            c.used = True
        return tags

    def one(self, kind: str) -> Self | None:
        """The only child of that kind, or none.  Raises InputError where there are more."""
        tags = self.all(kind)
        if len(tags) > 1:
            raise tags[1].fault(f"<{kind}> comes twice; the first is in line {tags[0].line}")
        return tags[0] if tags else None

    def numbers(self, count: int | None = None) -> list[float]:
        """The text's finite numbers.  Raises InputError where it holds anything else."""
        values = self.split(self.text)
        if values is None or (count is not None and len(values) != count):
            many = "numbers" if count is None else f"{count} number{'s' * (count != 1)}"
            raise self.fault(f"expected {many} ({RANGE}), got {short(self.text)}")
        return values

    def split(self, text: str) -> list[float] | None:
        """The numbers of a text; None where something else stands there than
        `read_numbers` takes."""
        for separator in self.SEPARATORS:
            text = text.replace(separator, " ")
        return read_numbers(text)

    def word(self, kind: str, default: str) -> str:
        """The text of the child of that kind, or else `default`.  Raises InputError where there
        are more."""
        child = self.one(kind)
        return default if child is None else child.text.strip()

    def pass_over(self) -> None:
        """Count this tag and all below it as read."""
        self.used = self.tabled = True
        for c in self.children:
            c.pass_over()

    def unread(self) -> Iterator[Self]:
        """Tags below this one that nothing has read, none within another."""
        for c in self.children:
            if not c.used or (c.rows and not c.tabled):
                yield c
            else:
                yield from c.unread()


T = TypeVar("T", bound=Tag)


def short(text: str) -> str:
    """A text in a line of at most 40 letters, in quotes.

    >>> short("one  two\\nthree")
    "'one two three'"
    """
    text = " ".join(text.split())
    return repr(text if len(text) <= 40 else text[:37] + "...")


def read_tree(path: Path, root: str, tag: type[T], limits: Limits) -> T:
    """The tree of an XML file whose root tag is named `root`.  Its tags are of the class `tag`,
    which says how numbers are separated and which leaf tags are rows of numbers.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "small.xml"
    ...     _ = path.write_text("<model><mass>1.5 kg</mass></model>")
    ...     tree = read_tree(path, "model", Tag, Limits(bytes=1000, tags=10, depth=3))
    >>> tree.word("mass", "none")
    '1.5 kg'

    Raises InputError (naming file and line) where the file cannot be read, is not XML, declares a
    document type, or exceeds a limit."""
    try:
        with open(path, "rb") as stream:
            return parse_tree(iter(lambda: stream.read(CHUNK), b""), str(path), root, tag, limits)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error


def parse_tree(chunks: Iterable[bytes], file: str, root: str, tag: type[T], limits: Limits) -> T:
    """The tree of an XML text in pieces, as `read_tree` does; `file` is named in errors."""
    reader = _Reader(file, root, tag, limits)
    try:
        for chunk in chunks:
            reader.feed(chunk)
        return reader.finish()
    except expat.ExpatError as error:
        what = expat.ErrorString(error.code)
        raise InputError(f"{file}, line {error.lineno}: not well-formed XML: {what}") from error


class _Reader(Generic[T]):
    """The tree under construction."""

    def __init__(self, file: str, root: str, tag: type[T], limits: Limits) -> None:
        self.file, self.root, self.tag, self.limits = file, root, tag, limits
        self.stack: list[T] = []
        self.done: T | None = None
        self.texts: list[str] = []
        self.size = self.sizes = self.bytes = self.tags = self.rows = self.silent = 0
        only = limits.encodings[0] if len(limits.encodings) == 1 else None
        self.parser = expat.ParserCreate(only)
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._characters
        self.parser.CommentHandler = lambda _: self._reset_silence()
        self.parser.StartDoctypeDeclHandler = self._doctype
        self.parser.XmlDeclHandler = self._check_encoding

    def feed(self, chunk: bytes) -> None:
        self.silent += len(chunk)
        self.bytes += len(chunk)
        if self.bytes > self.limits.bytes:
            most = f"{self.limits.bytes:.3g} bytes"
            raise self._fault(f"the file is longer than {most}, the most that is read")
        self.parser.Parse(chunk, False)
        if self.silent > MOST_MARKUP:
            raise self._fault(f"one tag or comment is longer than {MOST_MARKUP >> 20} MB")

    def finish(self) -> T:
        self.parser.Parse(b"", True)
        assert self.done is not None
        return self.done

    def _fault(self, message: str) -> InputError:
        return InputError(f"{self.file}, line {self.parser.CurrentLineNumber}: {message}")

    def _reset_silence(self) -> None:
        self.silent = 0

    def _check_encoding(self, _: str, encoding: str | None, __: int) -> None:
        if encoding is not None and encoding.upper() not in (*self.limits.encodings, "US-ASCII"):
            raise self._fault(f"the encoding {encoding[:40]!r} is not read; save it as UTF-8")

    def _doctype(self, *_: object) -> None:
        raise self._fault(
            "a document type declaration (and with it entities) is refused; remove <!DOCTYPE ...>"
        )

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        self._reset_silence()
        if not self.stack and name != self.root:
            raise self._fault(f"the root is <{name[:40]}>, expected <{self.root}>")
        if len(self.stack) >= self.limits.depth:
            raise self._fault(f"tags are nested more than {self.limits.depth} deep")
        self._no_stray_text()
        parent = self.stack[-1] if self.stack else None
        line = self.parser.CurrentLineNumber
        self.stack.append(self.tag(name, attributes, self.file, parent, line))

    def _count(self, tag: T, size: int) -> None:
        """Whether a tag with a text of that size can still be kept."""
        name, values = tag.kind, sum(map(len, tag.attributes.values()))
        if len(tag.attributes) > MOST_ATTRIBUTES:
            raise self._fault(f"<{name[:40]}> has more than {MOST_ATTRIBUTES} attributes")
        if max(map(len, (name, *tag.attributes))) > MOST_NAME:
            raise self._fault(f"<{name[:40]}>: a name is longer than {MOST_NAME} letters")
        if values > MOST_VALUE:
            raise self._fault(f"the attributes of <{name}> are longer than {MOST_VALUE} letters")
        self.tags += 1 + len(tag.attributes)
        self.sizes += size + values
        if self.tags > self.limits.tags:
            most = f"{self.limits.tags} tags and attributes"
            raise self._fault(f"more than {most} besides rows of numbers")
        if self.sizes > MOST_TEXTS:
            raise self._fault(f"the texts are longer than {MOST_TEXTS >> 20} MB in all")

    def _characters(self, text: str) -> None:
        self._reset_silence()
        self.size += len(text)
        if self.size > MOST_TEXT:
            raise self._fault(f"a text is longer than {MOST_TEXT >> 20} MB")
        self.texts.append(text)

    def _end(self, name: str) -> None:
        self._reset_silence()
        tag = self.stack.pop()
        if tag.children or tag.rows:
            self._no_stray_text()
        else:
            tag.text = "".join(self.texts)
        size, self.texts, self.size = self.size, [], 0
        if not self.stack:
            self.done = tag
        elif name in tag.ROWS and not tag.children and not tag.rows and len(tag.attributes) <= 1:
            self._row(self.stack[-1], tag)
        else:
            self._count(tag, size)
            self.stack[-1].children.append(tag)

    def _no_stray_text(self) -> None:
        stray = "".join(self.texts)
        self.texts, self.size = [], 0
        if stray.strip():
            raise self._fault(f"text among tags: {short(stray)}")

    def _row(self, parent: T, tag: T) -> None:
        self.rows += 1
        if self.rows > self.limits.rows:
            raise self._fault(f"more than {self.limits.rows} rows of numbers")
        if len(tag.text) > MOST_IN_ROW:
            raise tag.fault(f"a row of numbers is longer than {MOST_IN_ROW} letters")
        values = tag.split(tag.text)
        if values is None:
            raise tag.fault(f"expected numbers ({RANGE}), got {short(tag.text)}")
        rows = parent.rows = parent.rows or Rows()
        number = next(iter(tag.attributes.values()), str(len(rows.kind) + 1)).strip()
        if not (number.isascii() and number.isdecimal() and len(number) < 10):
            raise tag.fault(f"expected a whole number as its id, got {short(number)}")
        rows.kind.append(tag.kind)
        rows.number.append(int(number))
        rows.line.append(tag.line)
        rows.values.extend(values)
        rows.start.append(len(rows.values))
