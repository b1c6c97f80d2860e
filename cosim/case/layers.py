"""Layers of a case, one on top of the other."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

Layer = tuple[str, dict[str, Any]]
"""Where values are stated (for messages) and the values."""

# A later layer's word replaces an earlier layer's other way of saying the same.
_ALTERNATIVES = {
    "activation": {"tension", "excursion", "actuation"},
    "tension": {"activation", "muscle", "excursion", "actuation"},
    "muscle": {"tension", "excursion", "actuation"},
    "excursion": {"tension", "activation", "muscle", "actuation"},
    "actuation": {"tension", "activation", "muscle", "excursion"},
    "voltage": {"pressure"},
    "pressure": {"voltage"},
    "curve": {"stiffness", "rest"},
    "stiffness": {"curve", "layer"},
    "layer": {"stiffness", "smoothing", "penetration"},
    "smoothing": {"layer"},
    "penetration": {"layer"},
    "rest": {"curve"},
    "angle": {"along", "across", "field", "second"},
    "field": {"angle", "along", "across"},
    "second": {"angle"},
}


def merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """`base` with `over` on top, table by table; a table of another `kind` replaces the old one."""
    if "kind" in over and "kind" in base and over["kind"] != base["kind"]:
        return dict(over)
    replaced = {old for key in over for old in _ALTERNATIVES.get(key, ())}
    merged = {key: value for key, value in base.items() if key not in replaced}
    for key, value in over.items():
        old = merged.get(key)
        if isinstance(old, dict) and isinstance(value, dict):
            value = merge(old, value)
        merged[key] = value
    return merged


ALL = "all"
"""Of `hood.regions`: what every region has that does not say otherwise."""


def add_layer(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """`merge`, with `hood.regions.all` of `over` on top of the regions of `base` and below those
    that `over` names."""
    old, new = _table(_table(base, "hood"), "regions"), _table(_table(over, "hood"), "regions")
    every = _table(new, ALL)
    if not new or not (every or ALL in old):
        return merge(base, over)
    spread = dict(new)
    for name in {*old, *new} - {ALL}:
        match new.get(name, {}):
            case dict(stated):
                below = every if name in old else merge(_table(old, ALL), every)
                spread[name] = merge(below, stated)
    return merge(base, {**over, "hood": {**over["hood"], "regions": spread}})


def _table(values: Mapping[str, Any], key: str) -> dict[str, Any]:
    match values.get(key):
        case dict(found):
            return found
    return {}


def nested(key: str, value: Any) -> dict[str, Any]:
    """The tables that a dotted key names, the value innermost."""
    for name in reversed(key.split(".")):
        value = {name: value}
    tables: dict[str, Any] = value
    return tables
