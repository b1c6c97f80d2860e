"""States as plain arrays and back: what a checkpoint holds.

A state is a tree of dataclasses, named tuples, tuples and dicts with numbers, texts and arrays at
its leaves.  It is written as arrays by path, and read into a state of the same kind that was begun
anew: nothing in a checkpoint says what to build, so that none can build anything else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np

from cosim.errors import InputError

Arrays = dict[str, Any]
Special = Mapping[type, tuple[Callable[[Any], Arrays], Callable[[Any, Arrays], Any]]]
"""How states that hold more than arrays are written and read: by type, (to arrays, from a state
of the type and arrays)."""
NONE = "none"


def flatten(value: Any, special: Special | None = None) -> Arrays:
    """All leaves by path.  Raises TypeError for what is no state."""
    return dict(_leaves(value, "state", special or {}))


def rebuild(template: Any, arrays: Arrays, special: Special | None = None) -> Any:
    """The state that `flatten` made the arrays of; `template` is one of its kind.

    Raises InputError where they do not belong together."""
    left = dict(arrays)
    value = _build(template, left, "state", special or {})
    if left:
        raise InputError(f"a checkpoint of something else: it also holds {sorted(left)[0]}")
    return value


def _leaves(value: Any, path: str, special: Special) -> Iterator[tuple[str, Any]]:
    if type(value) in special:
        for name, leaf in special[type(value)][0](value).items():
            yield f"{path}/{name}", leaf
    elif is_dataclass(value) and not isinstance(value, type):
        for field in fields(value):
            yield from _leaves(getattr(value, field.name), f"{path}/{field.name}", special)
    else:
        yield from _plain_leaves(value, path, special)


def _plain_leaves(value: Any, path: str, special: Special) -> Iterator[tuple[str, Any]]:
    match value:
        case dict():
            for key, item in value.items():
                yield from _leaves(item, f"{path}/{key}", special)
        case tuple() | list():
            yield f"{path}/length", np.array(len(value))
            for i, item in enumerate(value):
                yield from _leaves(item, f"{path}/{i}", special)
        case None:
            yield path, np.array(NONE)
        case np.ndarray() | np.generic() | bool() | int() | float() | str():
            yield path, np.asarray(value)
        case _:
            raise TypeError(f"{path}: a {type(value).__name__} is no part of a state")


def _build(template: Any, arrays: Arrays, path: str, special: Special) -> Any:
    if type(template) in special:
        start = f"{path}/"
        inner = {k[len(start) :]: arrays.pop(k) for k in list(arrays) if k.startswith(start)}
        return special[type(template)][1](template, inner)
    if path in arrays and arrays[path].shape == () and str(arrays[path]) == NONE:
        arrays.pop(path)
        return None
    if is_dataclass(template) and not isinstance(template, type):
        changed = {
            f.name: _build(getattr(template, f.name), arrays, f"{path}/{f.name}", special)
            for f in fields(template)
            if f.init
        }
        return replace(template, **changed)
    match template:
        case dict():
            return {k: _build(v, arrays, f"{path}/{k}", special) for k, v in template.items()}
        case tuple() | list():
            return _sequence(template, arrays, path, special)
        case None | np.ndarray():
            return _take(arrays, path)
    return type(template)(_take(arrays, path).item())


def _sequence(template: Any, arrays: Arrays, path: str, special: Special) -> Any:
    """The items that were written; those beyond the template's are like its last, or arrays."""
    length = int(_take(arrays, f"{path}/length"))
    like = list(template) + [template[-1] if template else None] * (length - len(template))
    items = [_build(like[i], arrays, f"{path}/{i}", special) for i in range(length)]
    if isinstance(template, tuple) and type(template) is not tuple:  # a named one
        return type(template)(*items)
    return type(template)(items)


def _take(arrays: Arrays, path: str) -> Any:
    if path not in arrays:
        raise InputError(f"a checkpoint of something else: it lacks {path}")
    return arrays.pop(path)
