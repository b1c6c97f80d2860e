"""The faults of a case in plain words: key, value found, where it is stated, what to write."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from cosim.case.layers import ALL
from cosim.errors import Fault, nearest_names
from cosim.schema.fields import Text

Place = tuple[str | int, ...]
Model = type[BaseModel]

MOST_DESCRIBED, MOST_SHOWN = 40, 20
"""Faults that are put into words, and that a message lists: beyond these their cause is one."""
_ABSENT = ("missing", "union_tag_not_found")


def describe(
    error: ValidationError,
    model: Model,
    values: Mapping[str, Any],
    layers: Sequence[tuple[str, Mapping]],
) -> tuple[list[Fault], int]:
    """The faults of a `model` made of values, each with its key, its value, the file that states it
    and what to write; of very many the first ones, and how many there are in all."""
    faults, items = [], error.errors(include_url=False, include_input=False)
    if len(items) > MOST_DESCRIBED:
        items.sort(key=lambda item: tuple(map(str, item["loc"])))
    for item in items[:MOST_DESCRIBED]:
        loc = item["loc"][:-1] if item["type"] == "unknown_name" else item["loc"]  # less "[key]"
        place = _place(loc, model, values)
        if item["type"].startswith("union_tag"):
            place = (*place, "kind")
        shown = _stated_place(place, layers, missing=item["type"] in _ABSENT)
        key = re.sub(r"\.\[", "[", ".".join(_display_key(part) for part in shown)) or "the case"
        message = _message(item, place, model, values)
        stated = "" if item["type"] in _ABSENT else _stating_layer(layers, shown)
        faults.append(Fault(key, value_text(_lookup(values, place)), stated, message))
    found = sorted(dict.fromkeys(faults), key=str)
    return found, len(items) if len(items) > MOST_DESCRIBED else len(found)


def listing(where: str, faults: Sequence[str], count: int) -> str:
    """The faults of a file as one message: the first ones, and how many there are."""
    lines = [f"{where}: {count} fault" + ("s" if count > 1 else ""), *faults[:MOST_SHOWN]]
    if count > MOST_SHOWN:
        lines.append(f"... and {count - MOST_SHOWN} more; mend these first")
    return "\n  ".join(lines)


def _stated_place(place: Place, layers: Sequence[tuple[str, Mapping]], missing: bool) -> Place:
    """Where a value of a region stands: with the region, or in `hood.regions.all`; of what is
    missing, where the last word on the region's kind stands."""
    if place[:2] != ("hood", "regions") or len(place) < 4:
        return place
    every = (*place[:2], ALL, *place[3:])
    for _, values in reversed(layers):
        for candidate in (place, every):
            if _lookup(values, (*candidate[:-1], "kind") if missing else candidate) is not None:
                return candidate
    return place


def _display_key(part: str | int) -> str:
    if isinstance(part, int):
        return f"[{part}]"
    return part[:60] if re.fullmatch(r"[\w-]+", part) else repr(part[:60])


def _place(loc: Sequence[str | int], model: Model, values: Any) -> Place:
    """pydantic's location without the tags of its unions."""
    place: Place = ()
    tag = None
    for part in loc:
        if tag is not None and part == tag:
            tag = None
            continue
        place = (*place, part)
        tagged = any(_kind(t) for t in _types(place, model, values))
        tag = at(_lookup(values, place), "kind") if tagged else None
    return place


def at(values: Any, part: str | int) -> Any:
    """What a table or a list holds under a key or a number; None if nothing."""
    if isinstance(values, dict):
        return values.get(part)
    if isinstance(values, list) and isinstance(part, int) and part < len(values):
        return values[part]
    return None


def _lookup(values: Any, place: Place) -> Any:
    for part in place:
        values = at(values, part)
    return values


def value_text(value: Any) -> str:
    """The value that stands at a fault, cut short; empty of a table or of nothing."""
    if value is None or isinstance(value, dict):
        return ""
    try:
        text = repr(value)
    except ValueError:  # an integer of thousands of digits
        text = "a huge number"
    return text if len(text) <= 60 else text[:57] + "..."


def _stating_layer(layers: Sequence[tuple[str, Mapping]], place: Place) -> str:
    """The last layer that states the value."""
    for name, values in reversed(layers):
        if place and _lookup(values, place) is not None:
            return name
    return ""


def _message(item: Any, place: Place, model: Model, values: Any) -> str:
    kind, context = item["type"], item.get("ctx", {})
    if kind == "extra_forbidden":
        return unknown(
            "key", str(place[-1]), _keys(place[:-1], model, values), _lookup(values, place[:-1])
        )
    if kind == "unknown_name":
        siblings = _lookup(values, place[:-1])
        return unknown(context["what"], str(place[-1]), context["names"], siblings)
    if kind in _ABSENT:
        return f"is missing; {_advice(place, model, values)}{_meant(place, values)}"
    if kind in ("literal_error", "union_tag_invalid"):
        words = context.get("expected") or context["expected_tags"]
        return f"write {words.replace(', ', ' or ')}"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        return f"must be a table, [{'.'.join(map(str, place))}]"
    if kind == "too_short":
        return f"needs at least {context['min_length']} items"
    return str(item["msg"]).replace("Input should", "must").replace("Tuple should", "must")


RENAMED = {"course": "signal"}
"""Keys of earlier versions, and what they are called now."""


def unknown(what: str, name: str, known: Sequence[str], siblings: Any) -> str:
    """What to say of a name that is not known, with the nearest that is."""
    twin = next((k for k in known if k.casefold() == name.casefold()), None)
    if twin and isinstance(siblings, dict) and twin in siblings:
        return f"this {what} is named twice, in other letters; keep {twin}"
    if RENAMED.get(name) in known:
        return f"is now called {RENAMED[name]}"
    near = nearest_names(name, known)
    hint = f"did you mean {near[0]}? " if near else ""
    return f"unknown {what}; {hint}known: {', '.join(known)}"


def _keys(place: Place, model: Model, values: Any) -> tuple[str, ...]:
    models = [t for t in _types(place, model, values) if _is_model(t)]
    return tuple(dict.fromkeys(key for each in models for key in each.model_fields))


def _advice(place: Place, model: Model, values: Any) -> str:
    """What to write at a place where something is missing."""
    types = _types(place, model, values)
    if isinstance(place[-1], int):
        return "the list is too short"
    words = [repr(word) for t in types if get_origin(t) is Literal for word in get_args(t)]
    if words:
        return f"write {' or '.join(words)}"
    for facts in _texts(place, model, values):
        if "enum" in facts:
            return f"write one of {', '.join(facts['enum'])}"
        example = facts["examples"][0] if "examples" in facts else "..."
        return f'write: {facts["title"]}, for example "{example}"'
    if float in types or int in types:
        return "write a number"
    if str in types:
        return "write a text in quotes"
    if any(get_origin(t) is tuple for t in types):
        return "write a list in square brackets"
    keys = _keys(place, model, values)
    return f"write the table [{'.'.join(map(str, place))}]" + (
        f" with {', '.join(keys)}" if keys else ""
    )


def _meant(place: Place, values: Any) -> str:
    """The table beside that of what is missing, with nearly its name, that has it."""
    if len(place) < 2:
        return ""
    beside = _lookup(values, place[:-2])
    keys: Iterable[str] = getattr(beside, "keys", tuple)()
    whole = [key for key in keys if _lookup(beside, (key, place[-1])) is not None]
    near = nearest_names(str(place[-2]), whole)
    return f"; or did you mean {near[0]}?" if near else ""


def _texts(place: Place, model: Model, values: Any) -> Iterator[dict[str, Any]]:
    """What the schema says of the quantity or path that belongs at a place."""
    for table in _types(place[:-1], model, values):
        field = table.model_fields.get(str(place[-1])) if _is_model(table) else None
        for item in field.metadata if field else ():
            if isinstance(item, Text):
                yield dict(item.schema)


def _types(place: Place, model: Model, values: Any) -> list[Any]:
    """The types that may stand at a place of the case, those of another `kind` left out."""
    types: list[Any] = [model]
    for part in place:
        values = at(values, part)
        types = [inner for outer in types for inner in _inner(outer, part)]
        kind = values.get("kind") if isinstance(values, dict) else None
        types = [t for t in types if kind is None or _kind(t) in (None, kind)]
    return types


def _inner(outer: Any, part: str | int) -> list[Any]:
    """The types of a table's or list's item."""
    if _is_model(outer):
        field = outer.model_fields.get(str(part))
        return _members(field.annotation) if field else []
    if get_origin(outer) is dict:
        return _members(get_args(outer)[1])
    return _members(get_args(outer)[0]) if get_origin(outer) is tuple else []


def _members(annotation: Any) -> list[Any]:
    """A type, or those of a union."""
    if get_origin(annotation) is Annotated:
        return _members(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType):
        return [t for part in get_args(annotation) for t in _members(part)]
    return [annotation]


def _is_model(candidate: Any) -> bool:
    return isinstance(candidate, type) and issubclass(candidate, BaseModel)


def _kind(candidate: Any) -> str | None:
    """The word in a model's `kind`, if it has one."""
    field = candidate.model_fields.get("kind") if _is_model(candidate) else None
    return get_args(field.annotation)[0] if field else None
