"""The legal ends of every key of a case: the least and the largest value that its schema admits."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, get_args

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel

from cosim.case.schema import Case
from cosim.schema import units
from cosim.schema.fields import Text

ENDS = re.compile(r"(above|at least|at most) ([^,]+)")
LITTLE = 1e-6
"""Beyond an end that does not belong to the range, in the unit in which it is stated."""


def ends_of(case: Case) -> Iterator[tuple[str, str | float]]:
    """Dotted keys that a case states, with the value at each end of their range; of tables by name
    (regions, springs, points) the first alone."""
    yield from _ends(case, "", ())


def _ends(value: Any, place: str, annotations: tuple[Any, ...]) -> Iterator[tuple[str, Any]]:
    match value:
        case BaseModel():
            for key, field in type(value).model_fields.items():
                if key not in ("name", "source", "title", "notes"):
                    inner = (*field.metadata, *_metadata(field.annotation))
                    yield from _ends(getattr(value, key), f"{place}.{key}".lstrip("."), inner)
        case dict():
            for key, one in list(value.items())[:1]:
                yield from _ends(one, f"{place}.{key}", annotations)
        case bool():
            yield place, not value
        case int() | float():
            for one in dict.fromkeys(annotations):
                for end in _values(one):
                    yield place, end


def _metadata(annotation: Any) -> Iterator[Any]:
    yield from getattr(annotation, "__metadata__", ())
    for inner in get_args(annotation):
        yield from _metadata(inner)


def _values(annotation: Any) -> Iterator[str | float]:
    match annotation:
        case Text(kind=units.Kind()):
            title = dict(annotation.schema)["title"]
            for word, end in ENDS.findall(title):
                number, unit = end.split(" ", 1)
                yield f"{float(number) + (LITTLE if word == 'above' else 0.0)!r} {unit}"
        case Ge(ge=end) | Le(le=end):
            yield end
        case Gt(gt=end):
            yield end + LITTLE
        case Lt(lt=end):
            yield end - LITTLE
        case _ if inner := getattr(annotation, "metadata", None):  # of pydantic's Field
            for one in inner:
                yield from _values(one)
