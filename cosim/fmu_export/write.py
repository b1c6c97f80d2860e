"""A case's hood, finger or coupled finger as an FMU.

The archive holds the whole case, with the contents of the files that it names, and runs in a Python
with this package installed, at the same version and format (`cosim.version.FMU_FORMAT`).  Its
binaries (pythonfmu's) are for Linux and Windows on x86-64.
"""

from __future__ import annotations

import json
import shutil
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from importlib.metadata import distribution
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import indent, tostring

from pydantic import BaseModel

from cosim.case.file import resolved_toml
from cosim.case.schema import Case
from cosim.errors import InputError
from cosim.extras import require
from cosim.files import output_file
from cosim.fmu.archive import ABOUT, LOADED, SCRIPT
from cosim.fmu_export.run import CASE
from cosim.version import FMU_FORMAT, __version__

FILE = "file_"
EPOCH = (1980, 1, 1, 0, 0, 0)
"""The time of every file in the archive, so that it depends on nothing but its contents."""
NEEDS, NEEDED = (
    "needs.txt",
    f"this FMU needs cosim-hand {__version__} with its extra fmu, which runs FMUs of format "
    f"{FMU_FORMAT}; the Python that the simulator loads lacks it",
)
"""A file of the unit, which its script quotes where it cannot start the program."""


def write_fmu(case: Case, part: str, fmi: int, out: Path, *, tangent: bool = True) -> None:
    """Write `part` (hood, finger or coupled) of a case as an FMU of FMI 2 or 3; with `tangent` the
    hood has the derivatives of its load among its outputs, the finger among its inputs.

    Raises InputError for what cannot be put into an FMU or written."""
    tool = {2: "pythonfmu", 3: "pythonfmu3"}[fmi]
    require(f"writing an FMU of FMI {fmi}", tool)
    with tempfile.TemporaryDirectory() as folder:
        resources = Path(folder)
        _lay_out(case, {"part": part, "tangent": tangent}, fmi, resources)
        identifier, description = _describe(fmi, resources)
        with output_file(out) as path, zipfile.ZipFile(path, "w") as archive:
            _add(archive, "modelDescription.xml", description)
            for file in sorted(resources.rglob("*")):
                if file.is_file():
                    name = f"resources/{file.relative_to(resources).as_posix()}"
                    _add(archive, name, file.read_bytes())
            for name, content in _binaries(tool, identifier):
                _add(archive, name, content)


def _lay_out(case: Case, unit: Mapping[str, Any], fmi: int, resources: Path) -> None:
    """All files of the unit's resources: the case, what it names, script and loader's modules."""
    moved = _with_files(case, resources)
    about = {**unit, "format": FMU_FORMAT, "version": __version__, "case": case.name}
    script = Path(__file__).with_name(f"fmi{fmi}.py")
    (resources / NEEDS).write_text(NEEDED, encoding="utf-8")
    tool = _folder("pythonfmu" if fmi == 2 else "pythonfmu3")
    (resources / CASE).write_text(resolved_toml(moved), encoding="utf-8")
    (resources / ABOUT).write_text(json.dumps(about), encoding="utf-8")
    (resources / LOADED).write_text(SCRIPT[fmi], encoding="utf-8")
    shutil.copyfile(script, resources / f"{SCRIPT[fmi]}.py")
    (resources / tool.name).mkdir()
    for module in tool.glob("*.py"):
        shutil.copyfile(module, resources / tool.name / module.name)


def _with_files(table: Any, resources: Path) -> Any:
    """A value of a case with its files copied into `resources` and their paths relative to it."""
    match table:
        case BaseModel():
            fields = {name: getattr(table, name) for name in type(table).model_fields}
            kept = {k: v for k, v in fields.items() if k != "source"}
            return table.model_copy(update={k: _with_files(v, resources) for k, v in kept.items()})
        case dict():
            return {key: _with_files(value, resources) for key, value in table.items()}
        case tuple():
            return tuple([_with_files(value, resources) for value in table])
        case Path():
            return _copy(table, resources)
    return table


def _copy(file: Path, resources: Path) -> Path:
    # No folder: the case in the unit names it alike on every system.
    place = resources / f"{FILE}{len(list(resources.glob(f'{FILE}*')))}{file.suffix}"
    try:
        shutil.copyfile(file, place)
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror})") from error
    return place.relative_to(resources)


def _describe(fmi: int, resources: Path) -> tuple[str, bytes]:
    """The unit's identifier and description, of an instance of it."""
    slave: Any
    if fmi == 2:
        from cosim.fmu_export.fmi2 import CosimFmu2

        slave = CosimFmu2(instance_name="description", resources=str(resources))
    else:
        from cosim.fmu_export.fmi3 import CosimFmu3

        slave = CosimFmu3(instance_name="description", resources=str(resources))
    root = slave.to_xml()
    indent(root)
    return slave.run.name, tostring(root, "UTF-8", xml_declaration=True)


def _binaries(tool: str, identifier: str) -> Iterator[tuple[str, bytes]]:
    """The loader for every platform that the tool has."""
    folder = _folder(tool) / "resources" / "binaries"
    for file in sorted(folder.rglob("*")):
        if file.suffix in (".so", ".dll", ".dylib"):
            place = file.relative_to(folder).parent.as_posix()
            yield f"binaries/{place}/{identifier}{file.suffix}", file.read_bytes()


def _folder(tool: str) -> Path:
    """Where the tool is installed; a unit that was loaded here before has its modules too, and puts
    them first on the path, without binaries."""
    return Path(str(distribution(tool).locate_file(tool)))


def _add(archive: zipfile.ZipFile, name: str, content: bytes) -> None:
    entry = zipfile.ZipInfo(name, EPOCH)
    entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
    archive.writestr(entry, content)
