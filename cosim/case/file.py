"""The case file: how it is found, read, layered and checked, with every fault at once."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from functools import cache
from importlib import resources
from pathlib import Path, PurePath
from typing import Any

from cosim.case.layers import Layer, nested
from cosim.case.schema import Case, CaseFile, as_stated
from cosim.errors import InputError, nearest_names
from cosim.files import relative_path, shown_path
from cosim.schema.json_schema import CASE_SCHEMA, editor_schema, schema_line
from cosim.text_tables import read_toml, toml_text, toml_value

Settings = tuple[str, ...]
"""KEY=VALUE, as --set takes them; a later one has the last word."""

MOST_EXTENDED = 50
"""Files, each of which extends the next."""
NO_FAMILIES = {"base", "studies", "repairs", "data"}  # folders of cases/


def load_case(path_or_name: str | Path, overrides: Sequence[str] = ()) -> Case:
    """The checked case at a path, or of that name among the packaged ones, with `overrides`
    ("hood.mesh.quads=250") on top; of these, extends=FILE lays it over another case than its file
    says, by a path relative to that file.

    >>> load_case("pulley_edc", ["tendons.EDC.tension=5 N"]).tension("EDC")
    5.0

    Raises InputError that lists every fault with its place and what to write instead.
    """
    source, bases = find_case(path_or_name), [text for text in overrides if _is_base(text)]
    base = bases[-1].partition("=")[2].strip() if bases else None
    others = [text for text in overrides if not _is_base(text)]
    return Case.from_layers([*_read_layers(source, (), base), *layers_of(others)], source)


def _is_base(text: str) -> bool:
    return text.partition("=")[0].strip() == "extends"


def case_of(table: Mapping[str, Any], name: str = "case", overrides: Sequence[str] = ()) -> Case:
    """The checked case that a table states, as a file NAME.toml in the working directory would,
    with `overrides` on top.

    Raises InputError that lists every fault with its place and what to write instead."""
    source = Path.cwd() / f"{name}.toml"
    stated = _layers_of(deepcopy(as_stated(table)), "the table", source, ())
    return Case.from_layers([*stated, *layers_of(overrides)], source)


def layers_of(overrides: Sequence[str]) -> list[Layer]:
    """What texts KEY=VALUE say on top of a case.  Raises InputError."""
    return [*map(_override, overrides)]


def packaged_cases() -> dict[str, Path]:
    """The files of the packaged cases by name; each lies in the folder of its family."""
    return dict(_cases_in(_packaged_folder()))


@cache
def _cases_in(folder: Path) -> dict[str, Path]:
    files = sorted(folder.glob("*/*.toml"))
    return {path.stem: path for path in files if path.parent.name not in NO_FAMILIES}


def find_case(path_or_name: str | Path, beside: Path | None = None) -> Path:
    """The file at a path (relative to `beside` or here), or the packaged case of that name.

    A path may also be relative to the folder `cases` ("base/split").  Raises InputError."""
    text, packaged = str(path_or_name), _packaged_folder()
    for place in ((beside or Path.cwd()) / text, packaged / text, packaged / f"{text}.toml"):
        if os.path.isfile(place):
            return Path(os.path.realpath(place))
    cases = _cases_in(packaged)
    if text in cases:
        return Path(os.path.realpath(cases[text]))
    name = PurePath(text).stem
    if text.endswith(".toml") and name in cases:
        raise InputError(f"{text!r}: no such file; for the packaged case write its name: {name}")
    near = nearest_names(name, cases, most=3)
    hint = f"did you mean {' or '.join(near)}? " if near else ""
    raise InputError(
        f"{text!r}: no such file and no packaged case; {hint}`cosim list cases` has their names"
    )


def base_name(source: Path, folder: Path) -> str:
    """How a case file in that folder names the case at `source` that it extends: a packaged one by
    its name, so that the file serves on other machines, any other by its relative path."""
    packaged = Path(os.path.realpath(_packaged_folder()))
    if source.is_relative_to(packaged):
        is_named = source.stem in packaged_cases()
        name = source.stem if is_named else source.relative_to(packaged).as_posix()
        if find_case(name, folder) == source:
            return name
    return relative_path(source, folder)


def _packaged_folder() -> Path:
    return Path(str(resources.files("cases")))


def _read_layers(source: Path, above: tuple[Path, ...], other: str | None = None) -> list[Layer]:
    """The file's values, with those it extends before them, or those of the `other` base."""
    if source in above:
        chain = " -> ".join(shown_path(p) for p in (*above, source))
        raise InputError(f"these files extend each other in a circle: {chain}")
    if len(above) >= MOST_EXTENDED:
        raise InputError(
            f"{shown_path(above[0])}: extends a file that extends one, and so on through more than "
            f"{MOST_EXTENDED} files; put some of them together"
        )
    values = read_toml(source) | ({} if other is None else {"extends": other})
    return _layers_of(values, shown_path(source), source, above)


def _layers_of(
    values: dict[str, Any], where: str, source: Path, above: tuple[Path, ...]
) -> list[Layer]:
    base = values.pop("extends", None)
    layer: Layer = (where, _anchor_paths(values, source.parent))
    if base is None:
        return [layer]
    if not isinstance(base, str):
        raise InputError(f"{where}: extends = {base!r}: write the path of a case file")
    try:
        base_file = find_case(base, source.parent)
    except InputError as error:
        raise InputError(f"{where}: extends {error}") from None
    return [*_read_layers(base_file, (*above, source)), layer]


def _anchor_paths(values: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Paths stated in a file made relative to that file."""
    for table, key in _paths(values):
        table[key] = str(folder / table[key])
    return values


def _paths(values: dict[str, Any]) -> Iterator[tuple[dict[str, Any], str]]:
    """The tables of a case that state paths, and the keys of these."""
    mesh = _table(values, "hood", "mesh")
    hood, finger = _table(values, "hood"), _table(values, "finger")
    tables = [(mesh, "path"), (hood, "path"), (hood, "points_file"), (finger, "path")]
    tables += [(_table(t, "signal"), "path") for t in _table(values, "tendons").values()]
    tables += [(bone, "surface") for bone in _table(values, "finger", "bones").values()]
    for table, key in tables:
        if isinstance(table, dict) and isinstance(table.get(key), str):
            yield table, key


def _table(values: Any, *keys: str) -> dict[str, Any]:
    for key in keys:
        values = values.get(key) if isinstance(values, dict) else None
    return values if isinstance(values, dict) else {}


def _override(text: str) -> Layer:
    """One `a.b.c=value`: the value as TOML, or as plain text where it is none."""
    key, equals, value = text.partition("=")
    names = [name.strip() for name in key.split(".")]
    if not equals or not all(names):
        raise InputError(f"{text!r}: write key=value, for example hood.mesh.quads=250")
    if any("\ud800" <= c <= "\udfff" for c in text):
        raise InputError(f"{text!a}: is not text in UTF-8")
    table = nested(".".join(names), toml_value(value.strip()))
    return f"setting {key.strip()}", _anchor_paths(table, Path.cwd())


def resolved_toml(case: Case) -> str:
    """The whole case as one TOML file, which loads to the same case again; its schema lies in the
    folder above, beside those of other runs."""
    return _whole_toml(case.model_dump(mode="json", exclude={"name", "source"}, exclude_none=True))


def moved_toml(text: str, folder: Path) -> str:
    """The text of a whole case as it lies in a folder: paths are relative to it, so that no path of
    a machine stands there and the folders can be moved together."""
    values = tomllib.loads(text)
    for table, key in (paths := [*_paths(values)]):
        table[key] = relative_path(Path(table[key]), folder)
    return _whole_toml(values) if paths else text


def _whole_toml(values: Mapping[str, Any]) -> str:
    return f"{schema_line(f'../{CASE_SCHEMA}')}\n{toml_text(values)}"


def json_schema() -> dict[str, Any]:
    """JSON Schema of a case file, for editors.

    >>> sorted(json_schema()["properties"])[:3]
    ['coupling', 'extends', 'finger']

    Since a file may leave to the one it extends what it does not say itself, nothing is required.
    """
    schema = editor_schema(CaseFile, partial=True)
    schema["properties"]["extends"] = {
        "type": "string",
        "description": "Case file whose values these come on top of; relative to this file.",
    }
    return schema
