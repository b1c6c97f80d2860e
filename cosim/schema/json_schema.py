"""JSON Schema of a file that users write, for their editors."""

from __future__ import annotations

import json
from typing import Any

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import SchemaSerializer

Node = dict[str, Any]
CASE_SCHEMA, STUDY_SCHEMA = "case.schema.json", "study.schema.json"
"""The files that `cosim explain --schema --out FOLDER` writes."""


def schema_line(name: str) -> str:
    """The first line of a case or study, by which editors (taplo, Even Better TOML) find the schema
    at a path relative to the file.

    >>> schema_line(CASE_SCHEMA)
    '#:schema case.schema.json'
    """
    return f"#:schema {name}"


def with_schema(text: str, name: str) -> str:
    """The text of a case or study with its schema in the first line, in place of one named there.

    >>> with_schema("#:schema old.json\\ntitle = 'mine'", CASE_SCHEMA)
    "#:schema case.schema.json\\ntitle = 'mine'"
    """
    first, _, rest = text.partition("\n")
    return f"{schema_line(name)}\n{rest if first.startswith('#:schema') else text}"


class _Generator(GenerateJsonSchema):
    def field_title_should_be_set(self, schema: Any) -> bool:
        return False  # a key needs no second name

    def default_schema(self, schema: Any) -> Node:
        """With the default as a file would state it."""
        generated = super().default_schema(schema)
        if schema["schema"]["type"] in ("function-plain", "tuple"):
            generated["default"] = SchemaSerializer(schema["schema"]).to_python(
                schema["default"], mode="json"
            )
        return generated


def editor_schema(table: Any, partial: bool = False) -> Node:
    """The JSON Schema of a table (or of a union of tables): each key with a description, each
    quantity with a pattern of its texts, and of a union the alternative alone that its word chooses
    is checked.  With `partial` no key is required."""
    schema: Node = TypeAdapter(table).json_schema(schema_generator=_Generator)
    if partial:
        schema = _without_required(schema)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **_finish(schema, schema.get("$defs", {})),
    }


def choose(tests: list[tuple[Node, Node]], alternatives: list[Node]) -> Node:
    """The schema that checks against the one whose test (the first of a pair) a value passes.

    Editors complete from `anyOf`, whose `True` lets every value pass.  A plain `oneOf` would report
    the faults of all alternatives, or of a wrong one (taplo's issue 857)."""
    rules = [{"if": test, "then": then} for test, then in tests]
    return {"type": "object", "anyOf": [*alternatives, True], "allOf": rules}


def has(key: str, value: str | None = None) -> Node:
    """The test that a table has a key, or a value at it."""
    test: Node = {"required": [key]}
    return test if value is None else {"properties": {key: {"const": value}}, **test}


def _without_required(node: Any) -> Any:
    match node:
        case list():
            return [_without_required(item) for item in node]
        case dict():
            return {k: _without_required(v) for k, v in node.items() if k != "required"}
    return node


def _finish(node: Any, defs: Node) -> Any:
    match node:
        case list() | tuple():
            return [_finish(item, defs) for item in node]
        case dict():
            finished = _without_null({key: _finish(value, defs) for key, value in node.items()})
            return _with_form(_by_word(finished, defs) if "discriminator" in finished else finished)
    return node


def _without_null(node: Node) -> Node:
    """TOML has no null: a key that may be left out is left out."""
    match node:
        case {"anyOf": [*choices]} if {"type": "null"} in choices:
            kept = [choice for choice in choices if choice != {"type": "null"}]
            rest = {k: v for k, v in node.items() if k != "anyOf" and (k, v) != ("default", None)}
            return {**kept[0], **rest} if len(kept) == 1 else {"anyOf": kept, **rest}
    return node


def _by_word(node: Node, defs: Node) -> Node:
    """A union that a word chooses from.  A table without the word, which the file that it extends
    may state, is checked key by key."""
    key, mapping = node["discriminator"]["propertyName"], node["discriminator"]["mapping"]
    alternatives = [{"$ref": ref} for ref in dict.fromkeys(mapping.values())]
    tests = [(has(key, word), {"$ref": ref}) for word, ref in mapping.items()]
    tests += [({"not": has(key)}, _any_of_them(list(dict.fromkeys(mapping.values())), defs))]
    words = {key: {"enum": list(mapping), "description": "The word that chooses the table."}}
    rest = {k: v for k, v in node.items() if k != "oneOf"}
    return {**rest, **choose(tests, alternatives), "properties": words}


def _any_of_them(refs: list[str], defs: Node) -> Node:
    """A table whose keys are each as in one of several."""
    keys: dict[str, dict[str, Node]] = {}
    for ref in refs:
        for key, node in defs[ref.rpartition("/")[2]]["properties"].items():
            keys.setdefault(key, {}).setdefault(
                json.dumps(node), {"$ref": f"{ref}/properties/{key}"}
            )
    forms = {key: list(nodes.values()) for key, nodes in keys.items()}
    either = {key: of[0] if len(of) == 1 else {"anyOf": of} for key, of in forms.items()}
    return {"properties": either, "additionalProperties": False}


def _with_form(node: Node) -> Node:
    """With the form of a text (its title) at the end of its description."""
    match node:
        case {"const": str(), **rest} if "description" not in rest:
            return {**node, "description": "The word that chooses this table."}
        case {"title": str(form), "type": "string" | ["string", "array"], **rest}:
            text = str(rest.get("description", "")).removesuffix(".")
            return {**node, "description": f"{text}: {form}" if text else form}
    return node
