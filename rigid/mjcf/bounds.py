"""How large a MuJoCo model becomes, counted from its tags before MuJoCo compiles it.

A few letters ask for gigabytes: a height field of so many rows, bodies that are repeated within
repeated ones, keyframes without end.  MuJoCo obeys, and cannot be interrupted."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import prod
from pathlib import Path

from lxml import etree

from cosim.errors import InputError
from cosim.files import MB, check_file_size

MOST_BYTES, MOST_FILE = 32 * MB, 256 * MB
"""The largest text of a model, and the largest mesh or picture that it names."""
MOST_TAGS = 20_000
"""Tags with what is repeated, of a hand's model some thousands; MuJoCo takes a second for them."""
MOST_COPIES = 3000
"""Copies that `replicate`, `composite` and `flexcomp` make, which cost MuJoCo far more."""
MOST_FILES = 50
"""Files of models, one including the other."""
COPIES = {"replicate": "count", "composite": "count", "flexcomp": "count"}
GRIDS = {"hfield": ("nrow", "ncol"), "texture": ("width", "height")}
MOST_CELLS = 4_000_000
"""The most cells of a height field or texture."""
SIZES = {"size": "*", "numeric": "size", "user": "dim"}
"""Tags whose attributes (`*`: all) say how much room to make."""
MOST_ROOM = 1_000_000
UNITS = {"K": 2**10, "M": 2**20, "G": 2**30, "T": 2**40, "P": 2**50, "E": 2**60}
MOST_MEMORY = 1024 * MB
FOLDERS = ("meshdir", "texturedir", "assetdir")
MODELS = (("include", "file"), ("model", "file"))
"""What takes in the tags of another model."""


@dataclass
class _Count:
    """What has been counted of a model so far."""

    tags: int = 0
    copies: int = 0
    files: list[Path] = field(default_factory=list)
    folders: list[str] = field(default_factory=lambda: [""])
    """Where, beside the model, files that it names may lie."""


def check_bounds(path: Path) -> None:
    """Check that a MuJoCo model, with those that it includes, asks for no more than can be compiled
    in seconds.  What is no XML is left to MuJoCo, which says where.

    Raises InputError, with the line."""
    _count_file(path, 1, _Count())


def _count_file(path: Path, times: int, count: _Count) -> None:
    """Count the tags of a file that is taken in `times` times."""
    check_file_size(path, MOST_BYTES)
    count.files.append(path)
    if len(count.files) > MOST_FILES:
        raise InputError(f"{path}: more than {MOST_FILES} files are included by one another")
    copies = [times]
    try:
        tags = etree.iterparse(
            str(path),
            events=("start", "end"),
            tag="*",  # no comments
            resolve_entities=False,
            no_network=True,
            load_dtd=False,
        )
        for event, tag in tags:
            if event == "start":
                copies.append(copies[-1] * _copies(path, tag))
                _count_tag(path, tag, copies[-1], count)
            else:
                copies.pop()
                tag.clear()
    except etree.XMLSyntaxError:
        return


def _count_tag(path: Path, tag: etree._Element, copies: int, count: _Count) -> None:
    kind = str(tag.tag)
    count.tags += copies
    count.copies = max(count.copies, copies)
    if count.copies > MOST_COPIES:
        raise _fault(path, tag, f"makes {count.copies:.4g} copies, and at most {MOST_COPIES}")
    if count.tags > MOST_TAGS:
        raise _fault(path, tag, f"brings the tags, with all copies, above the {MOST_TAGS} that")
    if kind in GRIDS and (cells := prod(_whole(tag.get(n, "1")) for n in GRIDS[kind])) > MOST_CELLS:
        raise _fault(path, tag, f"has {cells:.4g} cells, and at most {MOST_CELLS:.4g}")
    for name, value in tag.attrib.items():
        if SIZES.get(kind) in ("*", name):
            most = MOST_MEMORY if name == "memory" else MOST_ROOM
            if _whole(str(value)) > most:
                raise _fault(path, tag, f"{name}={str(value)[:40]!r} is above the {most:.4g} that")
        if kind == "compiler" and name in FOLDERS:
            count.folders.append(str(value))
        elif str(name).startswith("file"):
            _count_named(path, (kind, str(name)), str(value), copies, count)


def _count_named(path: Path, place: tuple[str, str], name: str, copies: int, count: _Count) -> None:
    """Count what stands in a file that a tag names, or check its size."""
    for folder in count.folders:
        beside = path.parent / folder / name
        if not beside.is_file():
            continue
        if place in MODELS:
            _count_file(beside, copies, count)
        else:
            check_file_size(beside, MOST_FILE)
        return


def _copies(path: Path, tag: etree._Element) -> int:
    """How often what stands within a tag is made."""
    name = COPIES.get(str(tag.tag))
    return 1 if name is None else max(1, prod(map(_whole, tag.get(name, "1").split()[:3])))


def _whole(text: str) -> int:
    """A count as MuJoCo reads it, with its unit where it is one of memory; 1 of what is none."""
    digits, unit = text.strip()[:30], 1
    if digits[-1:].upper() in UNITS:
        digits, unit = digits[:-1], UNITS[digits[-1].upper()]
    return int(digits) * unit if digits.isascii() and digits.isdecimal() else 1


def _fault(path: Path, tag: etree._Element, what: str) -> InputError:
    return InputError(
        f"{path}, line {tag.sourceline}: <{tag.tag}> {what} are read; a model of a finger is far "
        "smaller"
    )
