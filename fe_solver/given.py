"""What a user gives to a sheet or a job: lists and arrays become arrays of the right kind in one
place, and what cannot is an InputError that says what was expected."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError, unexpected
from cosim.port import Array, Ints

T = TypeVar("T", bound=np.generic)


def indices(place: str, given: object) -> Ints:
    """Whole numbers (k,) from 0 on, of one number, a list, a range or an array.

    >>> indices("nodes", [3, 1]), indices("nodes", 2)
    (array([3, 1]), array([2]))

    Raises InputError."""
    out = integers(place, given)
    if out.ndim > 1 or (out < 0).any():
        raise unexpected(place, "a list of indices from 0 on", given)
    return np.atleast_1d(out)


def integers(place: str, given: object) -> Ints:
    """Whole numbers in an array of any shape.  Raises InputError."""
    if isinstance(given, np.ndarray) and given.dtype == np.intp:
        return given
    out = _array(given)
    if out is not None and out.size == 0:
        return out.astype(np.intp)
    if out is not None and out.dtype == bool:
        raise InputError(
            f"{place}: a mask of {out.size} truths; give the indices: numpy.flatnonzero(mask)"
        )
    if out is None or out.dtype.kind not in "iuf" or (out != np.rint(out)).any():
        raise unexpected(place, "whole numbers", given)
    return out.astype(np.intp)


def numbers(place: str, given: object, *shape: int | None) -> Array:
    """Numbers in an array whose axes have the lengths of `shape`, None for any; without a shape
    there may be any axes.

    >>> numbers("force", [0, 0, 1], 3)
    array([0., 0., 1.])

    Raises InputError."""
    out = given if isinstance(given, np.ndarray) else _array(given)
    if out is None or out.dtype.kind not in "iuf":
        raise unexpected(place, "numbers", given)
    fits = len(shape) == out.ndim and all(
        n is None or n == m for n, m in zip(shape, out.shape, strict=True)
    )
    if shape and not fits:
        wanted = ", ".join("any" if n is None else str(n) for n in shape)
        raise InputError(f"{place}: expected an array of shape ({wanted}), got {out.shape}")
    return np.asarray(out, dtype=float)


def spread(place: str, values: NDArray[T], count: int) -> NDArray[T]:
    """Values (count,), one for each or one for all.  Raises InputError."""
    if values.shape not in ((), (count,)):
        raise InputError(f"{place}: expected {count} values or one for all, got {values.shape}")
    return np.array(np.broadcast_to(values, count)) if values.ndim == 0 else values


def _array(given: object) -> np.ndarray[Any, Any] | None:
    """An array; None of what is none, such as rows of several lengths."""
    try:
        return np.asarray([*given] if isinstance(given, range) else given)
    except ValueError:
        return None


def listed(given: object) -> tuple[Any, ...] | None:
    """The members of a list; None of what has none."""
    return tuple(given) if isinstance(given, Iterable) else None


def several(place: str, given: object, kind: type, example: str) -> tuple[Any, ...]:
    """The members of a list, which are all of one kind.  Raises InputError."""
    members = listed(given)
    if members is None or not all(isinstance(m, kind) for m in members):
        raise unexpected(place, f"a list of {kind.__name__}, such as [{example}]", given)
    return members


def fill(owner: object, **values: object) -> None:
    """Set fields of a frozen dataclass while it is made."""
    for name, value in values.items():
        object.__setattr__(owner, name, value)
