"""Reading XML that nobody vouches for into a small tree, with the line of every tag.

A stream through expat: document type declarations (hence entities of any kind) are refused when
they begin, nothing outside the file is opened, and size, depth, tags, rows and texts are bounded.
Rows of numbers (`<node id="1">0,0,0</node>`) never become tags: they are kept as numbers.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from cosim.port import InputError

CHUNK = 1 << 16
MOST_BYTES = 1 << 30
MOST_TAGS = 200_000
MOST_ROWS = 3_000_000
MOST_DEPTH = 32
MOST_NAME = 100
MOST_ATTRIBUTES = 30
MOST_VALUE = 4096
MOST_TEXT = 4 << 20
MOST_TEXTS = 32 << 20
MOST_IN_ROW = 4096
MOST_NUMBER = 1e30
"""A magnitude beyond which squares and their products leave the range of floating point."""
RANGE = f"finite, at most {MOST_NUMBER:g}"
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
    parent: Tag | None = field(repr=False, compare=False)
    line: int
    text: str = ""
    children: list[Tag] = field(default_factory=list)
    rows: Rows | None = None
    used: bool = False
    tabled: bool = False

    @property
    def path(self) -> str:
        """Names of the tags from below the root to this one."""
        above = self.parent
        return self.name if above is None or above.parent is None else f"{above.path}/{self.name}"

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
            raise self.fault(f"expected {many} ({RANGE}), got {_short(self.text)}")
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
        """The rows of numbers.  Raises InputError where anything else stands among them."""
        self.tabled = True
        for other in self.children:
            raise other.fault("expected a row of numbers with at most one attribute, its id")
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
    """The finite numbers of a text, or None where something else stands there, numbers beyond
    MOST_NUMBER included."""
    if "_" in text:
        return None
    try:
        values = [float(v) for v in text.replace(",", " ").split()]
    except ValueError:
        return None
    return values if all(-MOST_NUMBER <= v <= MOST_NUMBER for v in values) else None


def read_xml(path: Path, root: str) -> Tag:
    """The tree of an XML file whose root has that name.

    Raises InputError (naming file and line) where the file cannot be read, is not XML, declares a
    document type, or exceeds a limit."""
    reader = _Reader(str(path), root)
    try:
        with open(path, "rb") as stream:
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
        self.size = self.sizes = self.bytes = self.tags = self.rows = self.silent = 0
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
        self.bytes += len(chunk)
        if self.bytes > MOST_BYTES:
            raise self._fault(f"the file is longer than {MOST_BYTES:.3g} bytes; split the model")
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
        parent = self.stack[-1] if self.stack else None
        line = self.parser.CurrentLineNumber
        self.stack.append(Tag(name, attributes, self.file, parent, line))

    def _count(self, tag: Tag, size: int) -> None:
        """Whether a tag with a text of that size can still be kept."""
        name, values = tag.name, sum(map(len, tag.attributes.values()))
        if len(tag.attributes) > MOST_ATTRIBUTES:
            raise self._fault(f"<{name[:40]}> has more than {MOST_ATTRIBUTES} attributes")
        if max(map(len, (name, *tag.attributes))) > MOST_NAME:
            raise self._fault(f"<{name[:40]}>: a name is longer than {MOST_NAME} letters")
        if values > MOST_VALUE:
            raise self._fault(f"the attributes of <{name}> are longer than {MOST_VALUE} letters")
        self.tags += 1 + len(tag.attributes)
        self.sizes += size + values
        if self.tags > MOST_TAGS:
            raise self._fault(f"more than {MOST_TAGS} tags and attributes besides rows of numbers")
        if self.sizes > MOST_TEXTS:
            raise self._fault(f"the texts are longer than {MOST_TEXTS >> 20} MB in all")

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
        size, self.texts, self.size = self.size, [], 0
        if not self.stack:
            self.done = tag
        elif name in ROWS and not tag.children and not tag.rows and len(tag.attributes) <= 1:
            self._row(self.stack[-1], tag)
        else:
            self._count(tag, size)
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
        if len(tag.text) > MOST_IN_ROW:
            raise tag.fault(f"a row of numbers is longer than {MOST_IN_ROW} letters")
        values = _numbers(tag.text)
        if values is None:
            raise tag.fault(f"expected numbers ({RANGE}), got {_short(tag.text)}")
        rows = parent.rows = parent.rows or Rows()
        number = next(iter(tag.attributes.values()), str(len(rows.kind) + 1)).strip()
        if not (number.isascii() and number.isdecimal() and len(number) < 10):
            raise tag.fault(f"expected a whole number as its id, got {_short(number)}")
        rows.kind.append(tag.name)
        rows.number.append(int(number))
        rows.line.append(tag.line)
        rows.values.extend(values)
        rows.start.append(len(rows.values))
