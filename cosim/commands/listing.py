"""Finding one's way: `cosim list` and `cosim explain`."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from enum import StrEnum
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.markdown import Markdown
from rich.table import Table

from cosim.case.file import json_schema, packaged_cases
from cosim.commands.door import door
from cosim.commands.options import option, to
from cosim.commands.terminal import console, print_table
from cosim.errors import InputError, nearest_names
from cosim.files import write_text
from cosim.hoods.kinds import KINDS
from cosim.report.measured_page import source_rows, write_measured_page
from cosim.results.compare import unit_of
from cosim.results.quantities import QUANTITIES, STATE
from cosim.schema.json_schema import CASE_SCHEMA, STUDY_SCHEMA
from cosim.study.file import study_schema
from cosim.text_tables import packaged_files, read_toml
from cosim.validation.plan import groups

GLOSSARY = "## Glossary\n"
Schema = Mapping[str, Any]
Rows = Sequence[tuple[str, ...]]


class Things(StrEnum):
    """What there is to list."""

    CASES = "cases"
    STUDIES = "studies"
    TRIALS = "trials"
    FINGERS = "fingers"
    HOODS = "hoods"
    MATERIALS = "materials"
    QUANTITIES = "quantities"
    MEASURED = "measured"


def list_things(
    what: Annotated[Things, typer.Argument(help="What to list.")] = Things.CASES,
    html: Annotated[
        Path | None, option("Of measured: a page with every number and its source.")
    ] = None,
) -> None:
    """The packaged cases and studies, the trials of `cosim validate`, the kinds of finger, hood and
    material, the numbers of a run, and the sources of what was measured, with a line for each."""
    if html is not None:
        if what is not Things.MEASURED:
            raise InputError(f"--html: there is a page of measured, none of {what}")
        write_measured_page(html)
        typer.echo(f"{html}: open it in a browser")
        return
    header, rows = LISTS[what]()
    print_table("", header, rows, of_words=True)


def tell_meaning(word: str = "") -> None:
    """What a key or a word means."""
    entries = {
        name: meaning
        for name, meaning in read_glossary().items()
        if word.casefold() in f"{name} {meaning}".casefold()
    }
    described: Sequence[tuple[str, str, Rows]] = ()
    try:
        described = list(describe_key(json_schema(), word))
    except InputError as error:
        if not entries:
            raise InputError(f"{error}; the glossary has no such word either") from error
    for title, text, rows in described:
        typer.echo(title)
        if text:
            typer.echo(text)
        if rows:
            print_table("", ("key", "what", "default"), rows, of_words=True)
    if not word or not described:
        table = Table("word", "means", box=box.SIMPLE, pad_edge=False)
        for name, meaning in entries.items():
            table.add_row(name, Markdown(meaning))
        console().print(table)


def tell_schema(
    schema: Annotated[
        bool,
        option('The JSON Schema of a case file, or with the word "study" of a study.', "--schema"),
    ],
    word: str = "case",
    out: Annotated[Path | None, to("Write both schemas there instead.", "FOLDER")] = None,
) -> None:
    """Print the schema of a case or of a study file, or write both."""
    texts = {
        kind: json.dumps(whole, indent=2, ensure_ascii=False)
        for kind, whole in (("case", json_schema()), ("study", study_schema()))
    }
    if word not in texts:
        raise InputError(f"{word}: there are schemas of {' and '.join(texts)}; name one of them")
    if out is None:
        typer.echo(texts[word])
        return
    for kind, name in (("case", CASE_SCHEMA), ("study", STUDY_SCHEMA)):
        write_text(out / name, texts[kind] + "\n")
        typer.echo(f"schema of a {kind} file in {out / name}")


@door({"": tell_meaning, "--schema": tell_schema})
def explain(
    word: Annotated[
        str,
        typer.Argument(
            help='Key of a case file, for example "hood.regions", or a word of cases, results and '
            "reports; none: the top of a case file, and the glossary."
        ),
    ] = "",
) -> None:
    """What a key of a case file may hold, its unit, range and default; or what a word means."""


def read_glossary() -> dict[str, str]:
    """The meaning of each word, from the table in this package's README."""
    text = (files("cosim") / "README.md").read_text(encoding="utf-8").partition(GLOSSARY)[2]
    rows = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| ")]
    return dict(rows[1:])


def _cases() -> tuple[tuple[str, ...], Rows]:
    rows = [(name, path.parent.name, _title(path)) for name, path in packaged_cases().items()]
    return ("case", "family", ""), sorted(rows, key=lambda row: (row[1], row[0]))


def _studies() -> tuple[tuple[str, ...], Rows]:
    return ("study", ""), [(path.stem, _title(path)) for path in packaged_files("studies")]


def _title(path: Path) -> str:
    return str(read_toml(path).get("title", ""))


def _trials() -> tuple[tuple[str, ...], Rows]:
    group_names: dict[tuple[str, str], list[str]] = {}
    for group in groups():
        for trial in group.trials:
            group_names.setdefault((trial.name, trial.case), []).append(group.name)
    return ("trial", "case", "groups"), [(*key, ", ".join(of)) for key, of in group_names.items()]


def _fingers() -> tuple[tuple[str, ...], Rows]:
    from cosim.fingers.kinds import FINGERS

    return ("finger.kind", ""), [(name, kind.table.title) for name, kind in FINGERS.items()]


def _hoods() -> tuple[tuple[str, ...], Rows]:
    return ("hood.kind", ""), [(name, kind.table.title) for name, kind in KINDS.items()]


def _materials() -> tuple[tuple[str, ...], Rows]:
    whole = json_schema()
    materials = dict(_alternatives(whole, _at(whole, "hood.regions.central_slip")))
    rows = [
        (_kind(one).partition('"')[2].rstrip('"'), " ".join(str(one["description"]).split()))
        for one in materials.values()
    ]
    return ("hood.regions.NAME.kind", ""), rows


def _quantities() -> tuple[tuple[str, ...], Rows]:
    rows = [
        (q.path, unit_of(q.path), f"{q.meaning}{' (also unloaded.)' if q in STATE else ''}")
        for q in QUANTITIES
        if not q.path.startswith("unloaded.")
    ]
    return ("path in summary.json", "unit", ""), rows


LISTS: Mapping[Things, Callable[[], tuple[tuple[str, ...], Rows]]] = {
    Things.CASES: _cases,
    Things.STUDIES: _studies,
    Things.TRIALS: _trials,
    Things.FINGERS: _fingers,
    Things.HOODS: _hoods,
    Things.MATERIALS: _materials,
    Things.QUANTITIES: _quantities,
    Things.MEASURED: source_rows,
}


def describe_key(whole: Schema, key: str) -> Iterator[tuple[str, str, Rows]]:
    """For each form that a key of a case file may have: its heading, its text, and the keys in it
    with what each holds and its default.  Raises InputError for a key that is not there."""
    nodes = _nodes(whole, key)
    forms = [(of, *form) for node, of in nodes for form in _alternatives(whole, node)]
    for of, name, one in forms:
        whose = f"of {' or '.join(of)}" if of and len(nodes) > 1 else ""
        heading = ", ".join(filter(None, (key or "a case file", whose, name)))
        text = "" if one is whole else str(one.get("description", "")) or _leaf(whole, one)
        if "properties" in one:
            yield heading, text, [_row(whole, k, v) for k, v in one["properties"].items()]
        elif named := _named(one):
            names = one.get("propertyNames", {}).get("enum", ["NAME"])
            rows = [_row(whole, "NAME", named)]
            what = str(one.get("description", "tables"))
            yield heading, f"{what.removesuffix('.')}, by name: {', '.join(names)}", rows
        else:
            yield heading, text, []


def _at(whole: Schema, key: str) -> Schema:
    """The schema of a key, its parts joined by dots, of all forms that it has in the kinds of its
    table.  Raises InputError."""
    nodes = [node for node, _ in _nodes(whole, key)]
    return nodes[0] if len(nodes) == 1 else {"anyOf": nodes}


def _nodes(whole: Schema, key: str) -> list[tuple[Schema, list[str]]]:
    """The schemas that a key has in the kinds of its table, each with these kinds in words.  Raises
    InputError."""
    nodes: list[tuple[Schema, list[str]]] = [(whole, [])]
    for place, part in enumerate(parts := key.split(".") if key else []):
        above = ".".join(parts[:place])
        children: list[tuple[Schema, list[str]]] = []
        known: list[str] = []
        for node, of in nodes:
            for kind, one in _alternatives(whole, node):
                holders = [f"{above}.{kind}"] if kind else of
                names = one.get("propertyNames", {}).get("enum")
                known += [*one.get("properties", ()), *(names or ())]
                child = one.get("properties", {}).get(part)
                if child is None and (names is None or part in (*names, "NAME")):
                    child = _named(one)
                if not child:
                    continue
                same = next((kinds for there, kinds in children if there == child), None)
                if same is None:
                    children.append((child, list(holders)))
                else:
                    same += [kind for kind in holders if kind not in same]
        if not children:
            near = nearest_names(part, known)
            hint = f"; did you mean {'.'.join([*parts[:place], near[0]])}?" if near else "."
            listed = ", ".join(dict.fromkeys(known)) or "nothing"
            raise InputError(
                f"{key}: no key {part!r} in {above or 'a case file'}{hint} There are {listed}"
            )
        nodes = children
    return nodes


def _alternatives(whole: Schema, node: Schema) -> Iterator[tuple[str, Schema]]:
    """What a value may be, references followed: its kind, empty where it has none, and schema."""
    if "$ref" in node:
        node = whole["$defs"][node["$ref"].rpartition("/")[2]]
    choices = node.get("anyOf", node.get("oneOf"))
    if choices is None:
        yield _kind(node), node
        return
    for choice in choices:
        if choice is not True:  # of a union, see `cosim.schema.json_schema.choose`
            yield from _alternatives(whole, choice)


def _named(one: Schema) -> Schema | None:
    """What a table holds under every name, be its names stated by a pattern or not."""
    stated: Schema | None = one.get("additionalProperties")
    return stated or next(iter(one.get("patternProperties", {}).values()), None)


def _kind(one: Schema) -> str:
    kind = one.get("properties", {}).get("kind", {}).get("const", "")
    return f'kind = "{kind}"' if kind else ""


def _row(whole: Schema, key: str, node: Schema) -> tuple[str, str, str]:
    forms = [_leaf(whole, one) for _, one in _alternatives(whole, node)]
    has_default = node.get("default") is not None and forms != ["a table"]
    shown = str(node["default"]) if has_default else ""
    form, meaning = " or ".join(forms), str(node.get("description", ""))
    whole_text = meaning if form in meaning else f"{form}. {meaning}".strip(". ")
    return key, " ".join(whole_text.split()), shown


def _leaf(whole: Schema, one: Schema) -> str:
    """What a value is, in a few words."""
    if "const" in one:
        return f'"{one["const"]}"'
    if "enum" in one:
        return ", ".join(f'"{word}"' for word in one["enum"])
    if "properties" in one:
        return _kind(one) or "a table"
    if _named(one):
        return str(one.get("title", "a table"))
    text = str(one.get("title") or one.get("type", "a value"))
    bounds = {"exclusiveMinimum": "above", "minimum": "at least", "exclusiveMaximum": "below"}
    bounds["maximum"] = "at most"
    limits = [f"{word} {one[name]:g}" for name, word in bounds.items() if name in one]
    if one.get("type") == "array" and "items" in one:
        items = [_leaf(whole, item) for _, item in _alternatives(whole, one["items"])]
        text = f"a list: {' or '.join(items)}"
    return ", ".join([text, *limits])
