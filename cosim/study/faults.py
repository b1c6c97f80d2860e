"""The faults of a study file in plain words, as those of a case file."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from cosim.case.faults import at, unknown, value_text


def faults_of(
    error: ValidationError, values: Any, above: tuple[str, ...], model: type[BaseModel]
) -> Iterator[str]:
    """A line for each of a model's faults: the place below `above`, what stands there, what to
    write."""
    for item in error.errors(include_url=False, include_input=False):
        place = tuple(item["loc"])
        value = values
        for part in place:
            value = at(value, part)
        shown = value_text(value)
        where = place_text((*above, *place)) + (f" = {shown}" if shown else "")
        yield f"{where}: {_message(item, place, values, model)}"


def place_text(place: tuple[str | int, ...]) -> str:
    """A place as people write it."""
    parts = [
        str(p)[:60] if isinstance(p, int) or re.fullmatch(r"[\w-]+", p) else repr(p[:60])
        for p in place
    ]
    return ".".join(parts) or "the study"


def _message(item: Any, place: tuple[str | int, ...], values: Any, model: type[BaseModel]) -> str:
    kind, context = item["type"], item.get("ctx", {})
    if kind == "extra_forbidden":
        table, inside = _keys(model, place[:-1]), values
        for part in place[:-1]:
            inside = at(inside, part)
        return unknown("key", str(place[-1]), table, inside)
    if kind == "missing":
        return "is missing"
    if kind == "literal_error":
        return f"write {context['expected'].replace(', ', ' or ')}"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        return "must be a table"
    if kind == "too_short":
        return f"needs at least {context['min_length']}"
    return str(item["msg"]).replace("Input should", "must")


def _keys(model: type[BaseModel], place: tuple[str | int, ...]) -> tuple[str, ...]:
    """The keys of the table at a place, as files name them."""
    for part in place:
        stated = model.model_fields[str(part)].annotation
        tables = [t for t in (stated, *get_args(stated)) if isinstance(t, type)]
        model = next(t for t in tables if issubclass(t, BaseModel))
    return tuple(field.alias or name for name, field in model.model_fields.items())
