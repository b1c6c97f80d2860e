"""Values of a case that are far from usual for a finger: mostly a wrong unit."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any, get_args

from pydantic import BaseModel

from cosim.case.schema import Case
from cosim.schema import units
from cosim.schema.fields import Text


def unusual_values(case: Case) -> Iterator[str]:
    """A sentence for each quantity of a case, but zero, that lies outside its kind's usual range.

    >>> from cosim.case.file import load_case
    >>> soft = load_case("base/one_sheet.toml", ['hood.thickness="0.4 um"'])
    >>> print(*unusual_values(soft))
    hood.thickness = 0.0004 mm is unusual for a length (0.001 mm to 500 mm): is the unit meant?
    """
    for name, value, kind in _quantities(case, "", ()):
        low, high = (units.parse(end, kind) for end in kind.usual)
        if value and not low <= abs(value) <= high:
            yield (
                f"{name} = {units.spell(value, kind)} is unusual for a {kind.name} "
                f"({' to '.join(kind.usual)}): is the unit meant?"
            )


def _quantities(
    value: Any, place: str, kinds: tuple[units.Kind, ...]
) -> Iterator[tuple[str, float, units.Kind]]:
    match value:
        case BaseModel():
            for key, of_field in _fields(type(value)).items():
                yield from _quantities(getattr(value, key), f"{place}.{key}".lstrip("."), of_field)
        case dict():
            for key, one in value.items():
                yield from _quantities(one, f"{place}.{key}", kinds)
        case tuple():
            for i, one in enumerate(value):
                yield from _quantities(one, f"{place}.{i}", kinds)
        case float():
            yield from ((place, value, kind) for kind in kinds if kind.usual)


@cache
def _fields(table: type[BaseModel]) -> dict[str, tuple[units.Kind, ...]]:
    """The kinds of quantities that each key of a table holds."""
    fields = table.model_fields.items()
    return {
        key: tuple(dict.fromkeys(_kinds([*field.metadata, field.annotation])))
        for key, field in fields
    }


def _kinds(annotations: Any) -> Iterator[units.Kind]:
    for one in annotations:
        match one:
            case Text(kind=units.Kind() as kind):
                yield kind
            case _:
                yield from _kinds(getattr(one, "__metadata__", ()))
                yield from _kinds(get_args(one))
