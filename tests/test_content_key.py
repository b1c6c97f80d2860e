"""Keys of values by their content: equal for equal values, and for no others."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np
import pytest

from cosim.content_key import UnknownContentError, content_key, machine

HERE = (__name__,)


@dataclass(frozen=True)
class Law:
    modulus: float
    axes: tuple[str, ...] = ()


@dataclass(frozen=True)
class OtherLaw:
    modulus: float
    axes: tuple[str, ...] = ()


class Pair(NamedTuple):
    a: float
    b: float


def scaled(by, value):
    return by * value


X = np.arange(6.0).reshape(2, 3)
VALUES = (
    *(None, 0, False, 0.0, -0.0, 1e-300, "", "0", b"0", (), [], {}, (0,), ((0,),), (0, 0), "0 0"),
    *(Pair(0, 0), {"a": 1, "b": 2}, {"b": 2, "a": 1}, ("a", ("b",)), (("a",), "b"), ("a", "b")),
    *(X, X.T, np.asfortranarray(X), X.reshape(3, 2), X.astype("f4"), X.astype(">f8"), X.ravel()),
    *(X + np.spacing(X), np.float64(0.0), np.int64(0), np.zeros(0), np.zeros((0, 3))),
    *(Law(1.0), Law(1), OtherLaw(1.0), Law(1.0, ("x",)), Law(float("nan"))),
    *(partial(scaled), partial(scaled, 1), partial(scaled, by=1), partial(scaled, X)),
)


def test_no_two_values_share_a_key():
    keys = [content_key(value, HERE) for value in VALUES]
    shared = [
        (VALUES[i], VALUES[j]) for i, j in combinations(range(len(keys)), 2) if keys[i] == keys[j]
    ]
    assert shared == []


def test_equal_values_do():
    law = Law(1.0, ("x",))
    assert content_key(law, HERE) == content_key(replace(law), HERE)
    assert content_key(partial(scaled, X), HERE) == content_key(partial(scaled, X.copy()), HERE)
    assert content_key(X) == content_key(X.copy())
    assert content_key(X[:, ::2]) == content_key(X[:, ::2].copy())


@pytest.mark.parametrize(
    "value",
    [
        lambda: 0,
        partial(scaled),
        np.array([{}], dtype=object),
        {1},
        Law(1.0),
        Pair(0, 0),
        [Law(1.0)],
        Law,
    ],
    ids=[
        "function",
        "a user's call",
        "objects",
        "set",
        "a user's",
        "named tuple",
        "in a list",
        "class",
    ],
)
def test_what_is_not_known_has_none(value):
    with pytest.raises(UnknownContentError):
        content_key(value)
    with pytest.raises(UnknownContentError):
        content_key(partial(lambda: 0), HERE)


def test_a_setting_of_the_kernels_or_of_numpy_is_part_of_the_machine(monkeypatch):
    as_is = machine()
    monkeypatch.setenv("NUMBA_OPT", "1")
    assert machine() != as_is
    monkeypatch.delenv("NUMBA_OPT")
    monkeypatch.setenv("FE_SOLVER_THREADS", "7")
    assert machine() == as_is
