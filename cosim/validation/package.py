"""A validation as one archive that others can repeat: an RO-Crate 1.1 with what was asked, the
inputs, the versions, and what came out, each file with its sha256."""

from __future__ import annotations

import hashlib
import platform
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    Field,
    StringConstraints,
    ValidationError,
    field_validator,
)

from cosim.content_key import ROOT, sources_key
from cosim.errors import InputError
from cosim.extras import require
from cosim.files import check_file, output_file, temporary_folder
from cosim.json_text import json_text
from cosim.validation.records import Record
from cosim.validation.run import folder_name
from cosim.validation.scoreboard import JudgedBoard
from cosim.validation.uncertainty import FILE
from cosim.version import __version__

METADATA = "ro-crate-metadata.json"
README, REQUEST, VERSIONS = "README.md", "request.json", "versions.json"
BOARD, PAGE = "scoreboard.json", "scoreboard.html"
OUTPUTS = {
    BOARD: "Every compared number with its verdict",
    FILE: "What is known of the numbers' uncertainty",
    PAGE: "The board as a page",
}
OF_RUN = {
    "case.toml": "the case with every default",
    "summary.json": "the numbers of the run",
    "comparison.json": "its rows of the board",
}
"""What is packed of a run's folder, and what it is."""
TYPES = {".json": "application/json", ".toml": "application/toml", ".csv": "text/csv"}
TYPES |= {".md": "text/markdown", ".html": "text/html"}
INPUTS = (".toml", ".csv", ".inp", ".stl")
PROGRAM = ("cosim", "fe_solver", "rigid", "meshes")
"""The folders of the program."""
SETTING = re.compile(
    r"[\w.\-]+ *= *(?:"
    r"\"?[-+]?[\d.]+(?:e[-+]?\d+)? ?[A-Za-z%][A-Za-z0-9%/*^ ]*\"?"  # a number with a unit
    r"|[-+]?[\d.]+(?:e[-+]?\d+)?|\"?[A-Za-z_][\w ]*\"?|\[[-+\d., e]*\])"  # number, word, numbers
)
"""A setting that names no file: nothing of somebody else's package is to open one here."""
FILE_KEYS = ("path", "points_file", "surface", "extends")
"""Keys of a case whose text names a file."""


Text = Annotated[str, StringConstraints(pattern=r"^[^\x00-\x1f\x7f-\x9f]*$", max_length=500)]
"""A line that a terminal may show."""


class Request(Record):
    """What `cosim validate` was asked for."""

    format: Literal["cosim validation package 1"] = "cosim validation package 1"
    only: Text | None = None
    """The group, or what trials' names contain; None: all."""
    settings: tuple[Text, ...] = Field(default=(), max_length=100)
    """Values of every trial that were replaced."""
    meshes: int = Field(default=0, ge=0, le=5)
    samples: int = Field(default=0, ge=0, le=10000)
    forms: bool = False

    @field_validator("settings")
    @classmethod
    def _names_no_file(cls, settings: tuple[str, ...]) -> tuple[str, ...]:
        for text in settings:
            key = text.partition("=")[0].strip().rpartition(".")[2]
            if len(text) > 200 or not SETTING.fullmatch(text) or key in FILE_KEYS:
                raise ValueError(
                    f"the setting {text[:60]!r} is none that a package may have: a number with its "
                    "unit, a word or a list of numbers, and no file"
                )
        return settings


class Versions(Record):
    """What computed the numbers."""

    cosim: Text
    program: Text
    """The sha256 of the program's own files."""
    python: Text
    platform: Text
    packages: dict[Text, Text]
    """Version by name, of all that the program requires and that is installed."""


def request_of(**asked: Any) -> Request:
    """What a package is to have been asked for.  Raises InputError for a setting that names a
    file."""
    try:
        return Request(**asked)
    except ValidationError as error:
        words = str(error.errors()[0]["msg"]).removeprefix("Value error, ")
        raise InputError(f"--package: {words}") from None


def versions_here() -> Versions:
    """The versions of this environment."""
    sources = [p for name in PROGRAM for p in (ROOT / name).rglob("*.py")]
    return Versions(
        cosim=__version__,
        program=sources_key(sources),
        python=platform.python_version(),
        platform=f"{platform.system()} {platform.machine()}",
        packages=dict(sorted(_packages())),
    )


def _packages() -> Iterator[tuple[str, str]]:
    """Name and version of the packages that a run requires, without those of extras."""
    for line in _requirements():
        name = re.split(r"[^\w.-]", line, maxsplit=1)[0]
        try:
            yield name.lower(), version(name)
        except PackageNotFoundError:
            continue


def _requirements() -> list[str]:
    try:
        every = requires("cosim-hand") or []
    except PackageNotFoundError:  # sources that are not installed
        every = ["numpy", "scipy", "mujoco", "numba", "pydantic", "feral-solver"]
    return [line for line in every if "extra ==" not in line]


def inputs_here() -> dict[str, Path]:
    """The cases, their bases, studies and tables, by their place in a package."""
    cases = Path(str(resources.files("cases")))
    files = (p for p in sorted(cases.rglob("*")) if p.suffix in INPUTS)
    return {f"inputs/cases/{p.relative_to(cases).as_posix()}": p for p in files}


def check_package(path: Path) -> None:
    """Check that a package can be written, before the trials are run.  Raises InputError."""
    require("a package of a validation", "rocrate")
    if path.suffix != ".zip":
        raise InputError(f"{path}: a package is a .zip; name it so")
    check_file(path)


def write_package(
    path: Path, request: Request, folder: Path, boards: Sequence[JudgedBoard]
) -> None:
    """Write what `cosim validate` left in `folder` as an RO-Crate.  Raises InputError where it
    cannot be written."""
    with temporary_folder("package") as name:
        stage = Path(name)
        files = dict(_staged(stage, request, folder, boards))
        crate = _crate(stage, files, request)
        with output_file(path) as part:
            crate.write_zip(part)


def _staged(
    stage: Path, request: Request, folder: Path, boards: Sequence[JudgedBoard]
) -> Iterator[tuple[str, str]]:
    """The files of the package laid into an empty folder: what each is, by its place."""

    def copy(source: Path, place: str) -> None:
        (stage / place).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, stage / place)

    for place, path in inputs_here().items():
        copy(path, place)
        yield place, "an input of the program"
    for place, words in OUTPUTS.items():
        copy(folder / place, place)
        yield place, words
    failed = {name for b in boards for name in b.board.failures}
    every = dict.fromkeys(row.target.case for b in boards for row in b.board.rows)
    trials = [name for name in every if name not in failed]  # whose folder is of an earlier run
    for trial in trials:
        for file, words in OF_RUN.items():
            run = folder / folder_name(trial) / file
            if run.is_file():
                place = f"runs/{folder_name(trial)}/{file}"
                copy(run, place)
                yield place, f"{trial}: {words}"
    texts = {
        REQUEST: ("What was asked for", json_text(request.model_dump(mode="json"))),
        VERSIONS: ("What computed it", json_text(versions_here().model_dump(mode="json"))),
        README: ("What this is, and how to repeat it", readme(request, boards)),
    }
    for place, (words, text) in texts.items():
        (stage / place).write_text(text + "\n", encoding="utf-8")
        yield place, words


def _crate(stage: Path, files: Mapping[str, str], request: Request) -> Any:
    from rocrate.model.contextentity import ContextEntity
    from rocrate.rocrate import ROCrate

    crate = ROCrate(version="1.1")
    crate.metadata.extra_terms["sha256"] = "https://schema.org/sha256"
    crate.name = f"cosim validate{'' if request.only is None else f' --only {request.only}'}"
    crate.description = (
        "A hand model beside measurements: inputs, versions and every compared number"
    )
    crate.license = "https://spdx.org/licenses/Apache-2.0"
    entities = {}
    for place, words in files.items():
        path = stage / place
        about = {
            "name": words,
            "encodingFormat": TYPES.get(path.suffix, "application/octet-stream"),
            "contentSize": str(path.stat().st_size),
            "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        }
        entities[place] = crate.add_file(path, place, properties=about)
    about = {"@type": "SoftwareApplication", "name": "cosim-hand", "softwareVersion": __version__}
    program = crate.add(ContextEntity(crate, "#cosim", properties=about))
    about = {"@type": "CreateAction", "name": command(request)}
    action = crate.add(ContextEntity(crate, "#validate", properties=about))
    action["instrument"] = program
    is_input = {place: place.startswith("inputs/") or place == REQUEST for place in entities}
    action["object"] = [e for place, e in entities.items() if is_input[place]]
    action["result"] = [e for place, e in entities.items() if not is_input[place]]
    crate.root_dataset["mentions"] = [action]
    return crate


def command(request: Request) -> str:
    """The command that was typed."""
    words = ["cosim validate"]
    words += [] if request.only is None else [f'--only "{request.only}"']
    words += [f"--set '{text}'" for text in request.settings]
    words += [f"--meshes {request.meshes}"] if request.meshes else []
    words += [f"--samples {request.samples}"] if request.samples else []
    return " ".join([*words, *(["--forms"] if request.forms else [])])


def readme(request: Request, boards: Sequence[JudgedBoard]) -> str:
    """The page for people in a package."""
    rows = [row for b in boards for row in b.board.rows]
    groups = "\n".join(f"* {b.board.group}: {b.board.headline}" for b in boards)
    here = versions_here()
    text = (
        resources.files("cosim.validation")
        .joinpath("package_readme.txt")
        .read_text(encoding="utf-8")
    )
    return text.format(
        **{"rows": len(rows), "boards": len(boards), "groups": groups, "command": command(request)},
        **{"cosim": here.cosim, "python": here.python, "platform": here.platform},
        **{"BOARD": BOARD, "PAGE": PAGE, "FILE": FILE, "REQUEST": REQUEST, "VERSIONS": VERSIONS},
        METADATA=METADATA,
    )
