"""JSON: one way to write numbers that may be numpy's, or none."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np


def json_text(content: Any, indent: int | None = 1, **options: Any) -> str:
    """The JSON text of mappings, lists, texts and numbers, numpy's too; null in place of what is
    not finite, which JSON has no number for.

    >>> json_text({"a": np.float64("nan"), "b": np.arange(2)}, indent=None)
    '{"a": null, "b": [0, 1]}'

    Raises TypeError for what is neither."""
    lost: list[tuple[str | int, ...]] = []
    options = {"ensure_ascii": False, **options}
    return json.dumps(plain(content, lost), indent=indent, allow_nan=False, **options)


def plain(value: Any, lost: list[tuple[str | int, ...]], *keys: str | int) -> Any:
    """The value in Python's own types, None in place of numbers that are not finite; their keys and
    the number as text are added to `lost`."""
    match value:
        case Mapping():
            return {k: plain(v, lost, *keys, str(k)) for k, v in value.items()}
        case list() | tuple():
            return [plain(v, lost, *keys, i) for i, v in enumerate(value)]
        case np.generic() | np.ndarray():
            return plain(value.tolist(), lost, *keys)
        case float() if not math.isfinite(value):
            lost.append((*keys, str(value)))
            return None
    return value
