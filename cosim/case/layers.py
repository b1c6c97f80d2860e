"""Layers of a case, one on top of the other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

from cosim.hoods.shell.table import FIBRE_KEYS, region_keys

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
    "section": {"thickness"},
    "thickness": {"section"},
    "tissue": {"weights", "times", "spectrum", "shortest", "longest"},
    "weights": {"tissue", "spectrum", "shortest", "longest"},
    "spectrum": {"tissue", "weights", "times"},
    "held": {"cycles"},
    "cycles": {"held"},
}


def merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """`base` with `over` on top, table by table; a table of another `kind` replaces the old one,
    but a region of a hood keeps what is not its law's."""
    if "kind" in over and "kind" in base and over["kind"] != base["kind"]:
        base = _kept(base, over)
    replaced = {old for key in over for old in _ALTERNATIVES.get(key, ())}
    merged = {key: value for key, value in base.items() if key not in replaced}
    for key, value in over.items():
        old = merged.get(key)
        if isinstance(old, dict) and isinstance(value, dict):
            value = merge(old, value)
        merged[key] = value
    return merged


def _kept(region: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """What a region keeps under a law of another kind; nothing of a table that is no region.  The
    directions of two families belong together: they stay where the new law has two, else both
    go."""
    kept = {key: region[key] for key in region_keys(over["kind"]) if key in region}
    if second := _table(region, "second"):
        if not _table(over, "second"):
            kept.pop("direction", None)
        elif "direction" in second:
            kept["second"] = {"direction": second["direction"]}
    return kept


ALL = "all"
"""The key of `hood.regions` for what every region has that does not say otherwise."""


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


def dropped_keys(steps: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """A sentence where regions lost keys of their fibres, since a layer gave them another law;
    `steps`: what the layers make, from the first one alone to all of them.

    >>> def case(slip): return {"hood": {"regions": {"central_slip": slip}}}
    >>> fibres = {"kind": "transversely_isotropic", "direction": {"angle": "5 deg"}}
    >>> print(*dropped_keys([case(fibres), case({"kind": "isotropic"})]))
    hood.regions: another law drops direction of central_slip
    """
    regions = [_table(_table(step, "hood"), "regions") for step in steps]
    lost: dict[str, list[str]] = {}
    for name in regions[-1] if regions else ():
        each = [_table(step, name) for step in regions]
        changes = [(old, new) for old, new in pairwise(each) if old.get("kind") != new.get("kind")]
        gone = {k for old, new in changes for k in FIBRE_KEYS if k in old and k not in new}
        if keys := ", ".join(key for key in FIBRE_KEYS if key in gone - {*each[-1]}):
            lost.setdefault(keys, []).append(name)
    if lost:
        parts = "; ".join(f"{keys} of {', '.join(names)}" for keys, names in lost.items())
        yield f"hood.regions: another law drops {parts}"


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
