"""A foreign FMU: opened only after everything in it has been checked.

Paths, sizes and the description are checked before anything of it lies on disk.  None of its code
runs here; where it is loaded later, it runs with the user's rights, as every FMU's does.
"""

from __future__ import annotations

import json
import stat
import struct
import warnings
import zipfile
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from lzma import LZMAError
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any
from xml.parsers import expat
from zlib import error as ZlibError

from lxml import etree

from cosim.errors import InputError, ReadingWarning
from cosim.fmu.description import lenient_description
from cosim.version import FMU_FORMAT, __version__

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription


UNREADABLE = (
    *(zipfile.BadZipFile, ZlibError, LZMAError, struct.error),
    *(EOFError, NotImplementedError, RuntimeError, OSError, ValueError),
)
"""What zipfile raises over archives that are damaged, encrypted or packed in unknown ways."""
MOST_FILES, MOST_BYTES, MOST_XML = 20_000, 2**30, 2**26
"""Limits of an unpacked archive, and of the description in it (bytes)."""
MOST_TAGS, MOST_MARKUP, CHUNK = 1_000_000, 2**20, 2**16
"""Tags and attributes of a description, bytes of one tag, and bytes parsed at once."""
MOST_SHOWN = 3
DESCRIPTION = "modelDescription.xml"


@dataclass(frozen=True)
class UnpackedFmu:
    """An unpacked FMU that this machine can load."""

    path: Path
    """The archive's file, for messages."""
    folder: Path
    description: ModelDescription
    rolls_back: bool
    """Whether its state can be got and set."""
    differentiates: bool
    """Whether it gives directional derivatives."""
    serialises: bool = False
    """Whether its state can be written as bytes."""


def unpack_fmu(path: Path, folder: Path, strict: bool = False) -> UnpackedFmu:
    """The FMU at `path` unpacked into the empty `folder`.  A description that breaks the standard
    and can be read all the same is read with a ReadingWarning; `strict` refuses it.

    Raises InputError for anything that is not a whole and harmless co-simulation FMU of FMI 2 or 3
    with binaries for this machine."""
    try:
        with zipfile.ZipFile(path) as archive:
            _refuse_if(path, archive_fault(archive.infolist(), MOST_FILES, MOST_BYTES))
            able = _capabilities(_parse_xml(path, _description(path, archive)))
            archive.extractall(folder)
    except UNREADABLE as error:
        raise InputError(f"{path}: cannot be read as an FMU ({error})") from error
    described = _read_description(path, folder, strict)
    _refuse_if(path, _unfit(described, folder))
    return UnpackedFmu(path, folder, described, *able)


def _refuse_if(path: Path, fault: str) -> None:
    if fault:
        raise InputError(f"{path}: refused: {fault}")


def _description(path: Path, archive: zipfile.ZipFile) -> bytes:
    if DESCRIPTION not in archive.namelist():
        raise InputError(f"{path}: is no FMU: it has no {DESCRIPTION}")
    if archive.getinfo(DESCRIPTION).file_size > MOST_XML:
        raise InputError(f"{path}: refused: its {DESCRIPTION} is above {MOST_XML / 2**20:.0f} MiB")
    return archive.read(DESCRIPTION)


def _parse_xml(path: Path, text: bytes) -> etree._Element:
    """The root, of few enough tags, with no document type: there are no entities to expand or
    fetch."""
    try:
        _check_size(path, text)
        parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False)
        root = etree.fromstring(text, parser)
    except (etree.XMLSyntaxError, expat.ExpatError, LookupError, ValueError) as error:
        raise InputError(f"{path}: {DESCRIPTION} is not well-formed XML ({error})") from error
    version = root.get("fmiVersion", "")
    if root.tag != "fmiModelDescription" or not (version == "2.0" or version.startswith("3.0")):
        raise InputError(
            f"{path}: its {DESCRIPTION} is a <{root.tag}> of fmiVersion {version!r}, expected an "
            "fmiModelDescription of 2.0 or 3.0"
        )
    return root


def _check_size(path: Path, text: bytes) -> None:
    """Check the number of tags and their sizes, before a tree is made of them."""
    tags = silent = 0

    def count(_: str, attributes: dict[str, str]) -> None:
        nonlocal tags, silent
        tags, silent = tags + 1 + len(attributes), 0
        if tags > MOST_TAGS:
            most = f"{MOST_TAGS:,} tags and attributes"
            raise InputError(f"{path}: refused: its {DESCRIPTION} has more than {most}")

    def hear(_: str) -> None:
        nonlocal silent
        silent = 0

    def refuse(*_: object) -> None:
        raise InputError(f"{path}: refused: its {DESCRIPTION} declares a document type or entities")

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.StartDoctypeDeclHandler = count, refuse
    parser.CharacterDataHandler = parser.CommentHandler = hear
    for start in range(0, len(text), CHUNK):
        silent += CHUNK
        parser.Parse(text[start : start + CHUNK], False)
        if silent > MOST_MARKUP:
            raise InputError(
                f"{path}: refused: a tag of its {DESCRIPTION} is longer than "
                f"{MOST_MARKUP / 2**20:.0f} MiB"
            )
    parser.Parse(b"", True)


def _capabilities(root: etree._Element) -> tuple[bool, bool, bool]:
    """Whether its state can be got and set, it gives directional derivatives, and its state can be
    written."""
    rolls_back = _is_able(root, "canGetAndSetFMUstate")
    derives = _is_able(root, "providesDirectionalDerivative")
    return rolls_back, derives, rolls_back and _is_able(root, "canSerializeFMUstate")


def _is_able(root: etree._Element, capability: str) -> bool:
    """A capability in FMI 2's spelling, or in FMI 3's, of which FMPy knows not all."""
    interface = root.find("CoSimulation")
    spellings = (capability, capability.replace("FMUstate", "FMUState"), f"{capability}s")
    values = [] if interface is None else [interface.get(word) for word in spellings]
    return "true" in values or "1" in values


def _read_description(path: Path, folder: Path, strict: bool) -> ModelDescription:
    from fmpy import read_model_description
    from fmpy.model_description import ValidationError

    file = str(folder / DESCRIPTION)
    try:
        description: ModelDescription = read_model_description(file, validate=True)
    except ValidationError as error:
        faults = [" ".join(str(fault).split())[:200] for fault in error.problems]
        more = f"; and {len(faults) - MOST_SHOWN} more" if len(faults) > MOST_SHOWN else ""
        shown = "; ".join(faults[:MOST_SHOWN]) + more
    except Exception as error:  # FMPy raises Exception itself for what it does not understand
        shown = " ".join(str(error).split())[:300]
    else:
        return description
    lenient = None if strict else lenient_description(file)
    if lenient is None:
        advice = "; leave out strict = true to have read what can be" if strict else ""
        raise InputError(f"{path}: {DESCRIPTION} is not valid: {shown}{advice}")
    warnings.warn(
        f"{path}: its {DESCRIPTION} breaks the standard and is read all the same (strict = true "
        f"refuses it): {shown}",
        ReadingWarning,
        stacklevel=4,
    )
    return lenient


def _unfit(described: Any, folder: Path) -> str:
    """Why this machine cannot load it; its identifier becomes part of a path."""
    if described.coSimulation is None:
        return "is not for co-simulation, expected a CoSimulation interface"
    identifier = described.coSimulation.modelIdentifier
    if not (identifier or "").isidentifier():
        return f"modelIdentifier {identifier!r} is no name in the sense of C"
    import fmpy

    platform = fmpy.platform if described.fmiVersion == "2.0" else fmpy.platform_tuple
    binary = folder / "binaries" / platform / f"{identifier}{fmpy.sharedLibraryExtension}"
    if binary.is_file():
        return ""
    platforms = sorted(p.name for p in (folder / "binaries").glob("*")) or ["none"]
    return f"has no binary for this machine, {platform}; it has {', '.join(platforms)}"


ABOUT, LOADED = "about.json", "slavemodule.txt"
"""Files of a unit's resources: which part of the case it is, by which version and in which format;
the name of the script that its loader runs."""
SCRIPT = {2: "cosim_fmu2", 3: "cosim_fmu3"}
"""By version of FMI, the name of the script in the units that we write."""


def read_about(resources: Path) -> Mapping[str, Any]:
    """The unit's own account in its folder `resources`.  Raises InputError for a unit of another
    format or version than this program runs."""
    try:
        about: Mapping[str, Any] = json.loads((resources / ABOUT).read_text(encoding="utf-8"))
        version, unit_format = str(about["version"]), about.get("format", 1)
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise InputError(
            f"this FMU's {ABOUT} does not describe a unit of cosim-hand ({error!r}); write the FMU "
            "anew with `cosim export`"
        ) from error
    if (unit_format, version) != (FMU_FORMAT, __version__):
        raise InputError(
            f"this FMU was written by cosim-hand {version} in format {unit_format}, and this Python"
            f" has cosim-hand {__version__}, which runs format {FMU_FORMAT}; write the FMU anew "
            "with `cosim export`, or install the cosim-hand that wrote it"
        )
    return about


def check_if_ours(resources: Path) -> bool:
    """Whether cosim-hand wrote a unit, which then has this format and version.
    Raises InputError."""
    try:
        script = (resources / LOADED).read_text(encoding="utf-8").strip()
    except (OSError, ValueError):
        return False
    if script in SCRIPT.values():
        read_about(resources)
        return True
    return False


def archive_fault(entries: Sequence[zipfile.ZipInfo], most_files: int, most_bytes: int) -> str:
    """What is wrong with an archive of these entries; empty where nothing is.  The sizes are those
    that zipfile holds it to."""
    return next(filter(None, (_crowd(entries, most_files, most_bytes), *map(_fault, entries))), "")


def _crowd(entries: Sequence[zipfile.ZipInfo], most_files: int, most_bytes: int) -> str:
    """What is wrong with the archive as a whole."""
    size, names = sum(e.file_size for e in entries), Counter(e.filename.lower() for e in entries)
    if len(entries) > most_files or size > most_bytes:
        return (
            f"unpacks to {len(entries)} files of {size / 2**20:.0f} MiB, expected at most "
            f"{most_files} of {most_bytes / 2**20:.0f} MiB"
        )
    twice = [name for name, times in names.items() if times > 1]
    if not twice:
        return ""
    return f"holds {twice[0]!r} more than once (upper and lower case are the same on some systems)"


def _fault(entry: zipfile.ZipInfo) -> str:
    """What is wrong with one file of the archive."""
    name, parts = entry.orig_filename, PurePosixPath(entry.orig_filename).parts
    if "\\" in name or ":" in name or "\0" in name or name.startswith("/") or ".." in parts:
        return f"the file {name!r} would lie outside of its folder"
    kind = stat.S_IFMT(entry.external_attr >> 16)
    if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
        return f"{name!r} is a link or a device, expected files and folders"
    return f"{name!r} is encrypted" if entry.flag_bits & 1 else ""
