"""A package of a validation from somebody else, read as untrusted input, and what differs from it.

Nothing of the archive is unpacked or run: its files are read in memory, held to their sha256 and to
schemas.  The trials are those of the program here, by name."""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cosim.case.faults import listing
from cosim.errors import InputError
from cosim.file_size import MB, check_file_size
from cosim.results.compare import number
from cosim.validation.package import (
    BOARD,
    METADATA,
    README,
    REQUEST,
    VERSIONS,
    Request,
    Text,
    Versions,
    inputs_here,
    versions_here,
)
from cosim.validation.records import Model, check_record
from cosim.validation.versions import Key
from cosim.zip_file import UNREADABLE, archive_fault

MOST_PACKED, MOST_BYTES, MOST_JSON, MOST_FILES = 256 * MB, 1024 * MB, 64 * MB, 10_000
CRATE = "https://w3id.org/ro/crate/1.1"
SAME, LEAST = 1e-3, 1e-2
"""Numbers are the same that differ by less of themselves, or of this much of their unit."""
SAME_UNCERTAINTY = 0.05
"""The same of a part of the uncertainty."""


class Row(BaseModel):
    """A row of a scoreboard, as far as it is compared."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)
    case: Text
    name: Text
    quantity: Text
    unit: Text
    model: float | None
    verdict: Text
    u_num: float | None = None
    u_input: float | None = None


class Rows(BaseModel):
    """The rows of a scoreboard by group."""

    model_config = ConfigDict(frozen=True, extra="ignore")
    groups: dict[Text, list[Row]]

    def by_key(self) -> dict[Key, Row]:
        """The rows by group, case, name and quantity."""
        return {(g, r.case, r.name, r.quantity): r for g, rows in self.groups.items() for r in rows}


class Reference(BaseModel):
    """What names an entity of a crate."""

    id: str = Field(alias="@id")


class Entity(BaseModel):
    """An entity of a crate's metadata, as far as it is held to."""

    model_config = ConfigDict(extra="ignore")
    id: str = Field(alias="@id")
    sha256: str | None = None
    conforms_to: Any = Field(default=None, alias="conformsTo")
    parts: list[Reference] = Field(default=[], alias="hasPart")


class Metadata(BaseModel):
    """The metadata of a crate."""

    model_config = ConfigDict(extra="ignore")
    graph: list[Entity] = Field(alias="@graph")


class Package(NamedTuple):
    """What a package says."""

    request: Request
    versions: Versions
    rows: Rows
    inputs: Mapping[str, str]
    """The sha256 of each input by its place."""


class Differences(NamedTuple):
    """What differs from a package, a line each."""

    numbers: list[str]
    versions: list[str]
    inputs: list[str]
    compared: int
    """How many numbers were compared."""


def read_package(path: Path) -> Package:
    """A package, all of it held to its hashes.  Raises InputError for anything that is not whole,
    or not harmless."""
    try:
        check_file_size(path, MOST_PACKED)
        with zipfile.ZipFile(path) as archive:
            if fault := archive_fault(archive.infolist(), MOST_FILES, MOST_BYTES):
                raise InputError(f"{path}: refused: {fault}")
            return _read(path, archive)
    except UNREADABLE as error:
        raise InputError(
            f"{path}: cannot be read as a package of a validation ({error})"
        ) from error


def _read(path: Path, archive: zipfile.ZipFile) -> Package:
    there = {e.filename for e in archive.infolist() if not e.is_dir()}
    missing = [name for name in (METADATA, README, REQUEST, VERSIONS, BOARD) if name not in there]
    if missing:
        raise InputError(
            f"{path}: is no whole package of `cosim validate --package`: it has no {missing[0]}"
        )
    hashes, faults = _hashes(_json(path, archive, METADATA))
    absent = [name for name in hashes if name not in there]
    more = sorted(there - {*hashes, METADATA})
    faults += [f"{name!a:.200}: stands in {METADATA} and is not there" for name in absent]
    faults += [f"{name!a:.200}: is there and not in {METADATA}" for name in more]
    for name, stated in hashes.items():
        if name in there and _sha256(archive, name) != stated:
            faults.append(f"{name!a:.200}: was changed: its sha256 is not the one of {METADATA}")
    if faults:
        raise InputError(listing(str(path), faults, len(faults)))
    return Package(
        _model(path, archive, REQUEST, Request),
        _model(path, archive, VERSIONS, Versions),
        _model(path, archive, BOARD, Rows),
        {name: sha for name, sha in hashes.items() if name.startswith("inputs/")},
    )


def _json(path: Path, archive: zipfile.ZipFile, name: str) -> Any:
    if archive.getinfo(name).file_size > MOST_JSON:
        raise InputError(f"{path}: refused: its {name} is above {MOST_JSON / MB:.0f} MiB")
    try:
        return json.loads(archive.read(name))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: its {name} is not valid JSON ({error})") from error


def _model(path: Path, archive: zipfile.ZipFile, name: str, model: type[Model]) -> Model:
    return check_record(model, _json(path, archive, name), f"{path}: {name}")


def _sha256(archive: zipfile.ZipFile, name: str) -> str:
    return hashlib.sha256(archive.read(name)).hexdigest()


def _hashes(metadata: Any) -> tuple[dict[str, str], list[str]]:
    """The sha256 of each file by its place, and what is wrong with the metadata."""
    try:
        by_id = {e.id: e for e in Metadata.model_validate(metadata).graph}
    except ValidationError:
        return {}, [f"{METADATA}: is no metadata of an RO-Crate"]
    conforms = [e.conforms_to for name, e in by_id.items() if name == METADATA]
    places = [part.id for name, e in by_id.items() if name == "./" for part in e.parts]
    faults = []
    if conforms != [{"@id": CRATE}]:
        faults.append(f"{METADATA}: does not conform to {CRATE}")
    if not places:
        faults.append(f"{METADATA}: its root has no parts")
    hashes = {}
    for place in places:
        if place in by_id and by_id[place].sha256 is not None:
            hashes[place] = by_id[place].sha256 or ""
        else:
            faults.append(f"{METADATA}: {place!a:.80} has no sha256")
    return hashes, faults


def differences(package: Package, scoreboard: str) -> Differences:
    """What differs between a package and the text of a scoreboard that was found here."""
    theirs, ours = package.rows.by_key(), Rows.model_validate_json(scoreboard).by_key()
    here = versions_here()
    inputs = {k: hashlib.sha256(p.read_bytes()).hexdigest() for k, p in inputs_here().items()}
    return Differences(
        [*_missing(theirs, ours), *_numbers(theirs, ours, package.request)],
        [*_versions(package.versions, here)],
        [*_unlike(package.inputs, inputs)],
        len(theirs.keys() & ours.keys()),
    )


def _missing(theirs: Mapping[Key, Row], ours: Mapping[Key, Row]) -> Iterator[str]:
    for where, keys in (("in the package", theirs.keys() - ours), ("here", ours.keys() - theirs)):
        for group, _, name, _ in sorted(keys):
            yield f"{group}: {name}: there is such a number {where} alone"


def _numbers(theirs: Mapping[Key, Row], ours: Mapping[Key, Row], asked: Request) -> Iterator[str]:
    """The numbers that differ; parts of the uncertainty as far as they were found anew."""
    parts = (("u_num", asked.meshes > 0), ("u_input", asked.samples > 0))
    for key in (k for k in theirs if k in ours):
        a, b = theirs[key], ours[key]
        words = [_unlike_number("", a.model, b.model, SAME, LEAST)]
        if a.verdict != b.verdict:
            words.append(f"{a.verdict} in the package, {b.verdict} here")
        for part, is_anew in parts:
            if is_anew:
                pair = getattr(a, part), getattr(b, part)
                words.append(_unlike_number(f"{part} ", *pair, SAME_UNCERTAINTY, LEAST))
        if said := "; ".join(filter(None, words)):
            yield f"{key[0]}: {a.name}, {a.unit}: {said}"


def _unlike_number(
    what: str, theirs: float | None, ours: float | None, same: float, least: float
) -> str:
    """How two numbers differ; empty where they do not."""
    if theirs is None or ours is None:
        is_same = theirs is ours
    else:
        is_same = abs(theirs - ours) <= same * max(abs(theirs), least)
    return "" if is_same else f"{what}{number(theirs, 6)} in the package, {number(ours, 6)} here"


def _versions(theirs: Versions, ours: Versions) -> Iterator[str]:
    for field, word in (("cosim", "cosim"), ("python", "Python"), ("platform", "platform")):
        a, b = getattr(theirs, field), getattr(ours, field)
        if a != b:
            yield f"{word}: {a:.80} in the package, {b} here"
    if theirs.program != ours.program:
        yield "cosim: the program's own files differ"
    for name in sorted({*theirs.packages, *ours.packages}):
        a, b = theirs.packages.get(name, "none"), ours.packages.get(name, "none")
        if a != b:
            yield f"{name:.80}: {a:.40} in the package, {b} here"


def _unlike(theirs: Mapping[str, str], ours: Mapping[str, str]) -> Iterator[str]:
    for place in sorted({*theirs, *ours}):
        a, b = theirs.get(place), ours.get(place)
        if a != b:
            words = "is here alone" if a is None else "is not here" if b is None else "differs"
            yield f"{place!a:.200}: {words}"


def sentences(found: Differences) -> Sequence[str]:
    """What differs, in lines."""
    lines = [f"{found.compared} numbers compared"]
    for title in ("numbers", "versions", "inputs"):
        differ: list[str] = getattr(found, title)
        count = len(differ)
        words = "none differs" if not count else f"{count} differ{'s' if count == 1 else ''}"
        lines += [f"{title}: {words}"]
        lines += [f"  {line}" for line in differ]
    return lines
