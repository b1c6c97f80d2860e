"""The tags of OpenSim's files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from cosim import xml_tree
from cosim.errors import InputError
from cosim.xml_tree import Limits, parse_tree, read_tree, short

LIMITS = Limits(bytes=32 << 20, tags=600_000, depth=64)
"""OpenSim's full-body models have 25 000 tags."""
LISTS = ("OpenSimDocument", "Model", "objects", "components", "coordinates", "frames")


class OsimTag(xml_tree.Tag):
    """A tag of OpenSim's."""

    __slots__ = ()

    @property
    def name(self) -> str:
        """The attribute `name`, or an empty text."""
        return self.attributes.get("name", "")

    @property
    def place(self) -> str:
        """Kinds and names on the way to this tag, without the lists that hold others."""
        own = f'{self.kind} "{self.name}"' if self.name else self.kind
        above = self.parent
        while above is not None and (above.kind in LISTS or above.kind.endswith("Set")):
            above = above.parent
        return own if above is None else f"{above.place} > {own}"

    def within(self, *kinds: str) -> list[OsimTag]:
        """The children of the tag at the end of that way down; none where it ends early."""
        here: OsimTag | None = self
        for kind in kinds:
            here = None if here is None else here.one(kind)
        for c in here.children if here else ():
            c.used = True
        return here.children if here else []

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
            raise self.fault(f"<{kind}>: expected true or false, got {short(word)}")
        return word == "true"


def read_xml(path: Path) -> OsimTag:
    """The tree of an OpenSimDocument.  Two hyphens in a comment, which XML forbids, are read, as
    OpenSim does.

    Raises InputError as `read_tree` does, and where the file is not UTF-8."""
    try:
        return read_tree(path, "OpenSimDocument", OsimTag, LIMITS)
    except InputError as error:
        if not path.is_file() or path.stat().st_size > LIMITS.bytes:
            raise
        raw = path.read_bytes()
        _check_utf8(raw, path)
        if "not well-formed" not in str(error):
            raise
        return parse_tree(_without_comments(raw), str(path), "OpenSimDocument", OsimTag, LIMITS)


def _check_utf8(raw: bytes, path: Path) -> None:
    """Check that the file is UTF-8.  Raises InputError with the line where a text in another
    encoding begins."""
    try:
        raw.decode("utf-8")
    except UnicodeDecodeError as error:
        line = 1 + raw.count(b"\n", 0, error.start)
        message = f"{path}, line {line}: not UTF-8; save the model with OpenSim 4"
        raise InputError(message) from error


def _without_comments(raw: bytes) -> Iterator[bytes]:
    """The text between comments, and the ends of their lines."""
    at = 0
    while (start := raw.find(b"<!--", at)) >= 0 and (end := raw.find(b"-->", start + 4)) >= 0:
        yield raw[at:start] + b"\n" * raw.count(b"\n", start, end)
        at = end + 3
    yield raw[at:]
