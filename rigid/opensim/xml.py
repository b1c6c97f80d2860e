"""Reading an .osim that nobody vouches for into a small tree, with the line of every tag.

lxml with everything off that leaves the file: document type declarations (hence entities) are
refused before it sees them; bytes, tags and depth are bounded.  OpenSim writes C++ names such as
`HuntCrossleyForce::ContactParametersSet`, which lxml refuses: `::` is `__` while it reads.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from lxml import etree

from cosim.port import InputError

MOST_BYTES = 32 << 20
MOST_MARKS = 600_000
"""Of the character `<`: tags, their ends and comments.  OpenSim's full-body models have 50 000."""
MOST_DEPTH = 64
MOST_NUMBER = 1e30
"""A magnitude beyond which squares and their products leave the range of floating point."""
LISTS = ("OpenSimDocument", "Model", "objects", "components", "coordinates", "frames")
SCOPE = re.compile(r"(</?[A-Za-z_][\w.\-]*)::([A-Za-z_][\w.\-]*)")
ENCODING = re.compile(r"\s*<\?xml[^>]*?encoding\s*=\s*[\"']([^\"']*)[\"']")


@dataclass(slots=True)
class Tag:
    """A tag with its place; `used` becomes true once something has read it."""

    kind: str
    name: str
    """The attribute `name`, or an empty text."""
    attributes: dict[str, str]
    file: str
    line: int
    text: str = ""
    parent: Tag | None = field(default=None, repr=False, compare=False)
    children: list[Tag] = field(default_factory=list)
    used: bool = False

    @property
    def place(self) -> str:
        """Kinds and names on the way to this tag, without the lists that hold others."""
        own = f'{self.kind} "{self.name}"' if self.name else self.kind
        above = self.parent
        while above is not None and (above.kind in LISTS or above.kind.endswith("Set")):
            above = above.parent
        return own if above is None else f"{above.place} > {own}"

    def fault(self, message: str) -> InputError:
        """An error that names file, line and place."""
        return InputError(f"{self.file}, line {self.line}, {self.place}: {message}")

    def all(self, kind: str) -> list[Tag]:
        """The children of that kind."""
        found = [c for c in self.children if c.kind == kind]
        for c in found:
            c.used = True
        return found

    def one(self, kind: str) -> Tag | None:
        """The only child of that kind, or none.  Raises InputError where there are more."""
        found = self.all(kind)
        if len(found) > 1:
            raise found[1].fault(f"<{kind}> comes twice; the first is in line {found[0].line}")
        return found[0] if found else None

    def within(self, *kinds: str) -> list[Tag]:
        """The children of the tag at the end of that way down; none where it ends early."""
        here: Tag | None = self
        for kind in kinds:
            here = None if here is None else here.one(kind)
        for c in here.children if here else ():
            c.used = True
        return here.children if here else []

    def numbers(self, count: int | None = None) -> list[float]:
        """The text's finite numbers.  Raises InputError where it holds anything else."""
        values = _numbers(self.text)
        if values is None or (count is not None and len(values) != count):
            many = "numbers" if count is None else f"{count} number{'s' * (count != 1)}"
            raise self.fault(
                f"expected {many} (finite, at most {MOST_NUMBER:g}), got {_short(self.text)}"
            )
        return values

    def values(self, kind: str, default: tuple[float, ...] | None) -> list[float]:
        """The numbers in the child of that kind, as many as the default has.

        Raises InputError where it is missing and there is no default (then one is expected)."""
        child = self.one(kind)
        if child is not None:
            return child.numbers(1 if default is None else len(default))
        if default is None:
            raise self.fault(f"<{kind}> is missing; expected a number")
        return list(default)

    def value(self, kind: str, default: float | None = None) -> float:
        """The one number in the child of that kind, as in `values`."""
        return self.values(kind, None if default is None else (default,))[0]

    def flag(self, kind: str, default: bool) -> bool:
        """true or false in the child of that kind."""
        word = self.word(kind, str(default)).lower()
        if word not in ("true", "false"):
            raise self.fault(f"<{kind}>: expected true or false, got {_short(word)}")
        return word == "true"

    def word(self, kind: str, default: str) -> str:
        """The text of the child of that kind."""
        child = self.one(kind)
        return default if child is None else child.text.strip()

    def pass_over(self) -> None:
        """Count this tag and all below it as read."""
        self.used = True
        for c in self.children:
            c.pass_over()

    def unread(self) -> Iterator[Tag]:
        """Tags below this one that nothing has read, none within another."""
        for c in self.children:
            if c.used:
                yield from c.unread()
            else:
                yield c


def _short(text: str) -> str:
    text = " ".join(text.split())
    return repr(text if len(text) <= 40 else text[:37] + "...")


def _numbers(text: str) -> list[float] | None:
    if "_" in text:
        return None
    try:
        values = [float(v) for v in text.split()]
    except ValueError:
        return None
    return values if all(-MOST_NUMBER <= v <= MOST_NUMBER for v in values) else None


def read_xml(path: Path) -> Tag:
    """The tree of an OpenSimDocument.

    Raises InputError (naming file and line) where the file cannot be read, is not XML or not
    OpenSim's, declares a document type, or exceeds a limit."""
    text = SCOPE.sub(r"\1__\2", _text(path))
    parser = etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        huge_tree=False,
        remove_comments=True,
        remove_pis=True,
        encoding="utf-8",
    )
    try:
        root = etree.fromstring(text.encode(), parser)
    except etree.XMLSyntaxError as error:
        line, what = error.lineno or 1, str(error.msg).removesuffix(f", line {error.lineno}")
        raise InputError(f"{path}, line {line}: not well-formed XML: {what}") from error
    if root.tag != "OpenSimDocument":
        raise InputError(
            f"{path}, line {root.sourceline}: the root is <{str(root.tag)[:40]}>, expected "
            "<OpenSimDocument>; this is not an OpenSim file"
        )
    return _tag(root, str(path), None, 0)


def _text(path: Path) -> str:
    try:
        with open(path, "rb") as stream:
            raw = stream.read(MOST_BYTES + 1)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    if len(raw) > MOST_BYTES:
        raise InputError(f"{path}: longer than {MOST_BYTES >> 20} MB, the most that is read")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = 1 + raw.count(b"\n", 0, error.start)
        raise InputError(
            f"{path}, line {line}: not UTF-8; save the model with OpenSim 4"
        ) from error
    declared = ENCODING.match(text)
    if declared and declared[1].upper() not in ("UTF-8", "US-ASCII"):
        raise InputError(
            f"{path}, line 1: the encoding {declared[1][:40]!r} is not read; use UTF-8"
        )
    if (at := text.find("<!DOCTYPE")) >= 0:
        raise InputError(
            f"{path}, line {1 + text.count(chr(10), 0, at)}: a document type declaration (and with "
            "it entities) is refused; remove <!DOCTYPE ...>"
        )
    if text.count("<") > MOST_MARKS:
        raise InputError(f"{path}: more than {MOST_MARKS} tags, ends of tags and comments")
    return text


def _tag(element: etree._Element, file: str, parent: Tag | None, depth: int) -> Tag:
    attributes = {str(k): str(v) for k, v in element.attrib.items()}
    name, line = attributes.get("name", ""), element.sourceline or 0
    kind = str(element.tag).replace("__", "::")
    tag = Tag(kind, name, attributes, file, line, element.text or "", parent)
    if depth > MOST_DEPTH:
        raise InputError(f"{file}, line {line}: tags are nested more than {MOST_DEPTH} deep")
    tag.children = [_tag(child, file, tag, depth + 1) for child in element]
    return tag
