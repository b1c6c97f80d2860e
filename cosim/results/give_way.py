"""What gave way in a motion, and what would first in an equilibrium: in numbers and in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from cosim.coupling.events import BEGINS, FAILS, Event
from cosim.port import Array
from cosim.solve.strength import Strength

WORDS = {
    "suture": "the suture of the",
    "graft": "the graft",
    "adhesion": "the adhesion of the",
    "splint": "the splint of the",
}

SPLINT = "splint_"
"""How splints are called, before their joint."""


def strength_block(strength: Strength | None) -> dict[str, Any]:
    """What each part bears over what it can, and which gives way first at what load."""
    if strength is None:
        return {}
    parts: dict[str, Any] = {}
    for unit, *values in zip(strength.units, *strength.bearing, strict=True):
        force, stretch, energy, share, _ = map(float, values)
        if share >= parts.get(unit.part, {"share": 0.0})["share"]:
            now = {"share": share, "force_N": force, "stretch_mm": 1e3 * stretch}
            parts[unit.part] = now | ({} if np.isnan(energy) else {"energy_mJ": 1e3 * energy})
    first: dict[str, Any] = {"part": strength.units[strength.first].part}
    if strength.load is None:
        first["no_load_known"] = strength.reason
    else:
        first["at_times_the_loads"] = strength.load
    return {"strength": parts, "first_to_give_way": first}


def events_block(units: Sequence[Any], events: Array) -> dict[str, Any]:
    """What gave way, and what began to act, in the order of time; the places of a part that peels
    together."""
    out: dict[str, Any] = {}
    for event in (Event(*row) for row in events):
        unit = units[int(event.part)]
        if event.kind == BEGINS:
            out.setdefault("began", {})[unit.part] = {"time_s": event.time}
            continue
        if unit.part.startswith(SPLINT):
            out.setdefault("taken_off", {})[unit.part] = {
                "time_s": event.time,
                "torque_Nmm": 1e3 * event.force,
                "lost_mJ": 1e3 * event.lost,
            }
            continue
        first = {"time_s": event.time, "force_N": 0.0, "stretch_mm": 0.0}
        first |= {"freed_mJ": 0.0, "lost_mJ": 0.0}
        now = out.setdefault("gave_way", {}).setdefault(unit.part, first)
        now["force_N"] = max(now["force_N"], event.force)
        now["stretch_mm"] = max(now["stretch_mm"], 1e3 * event.stretch)
        now["freed_mJ"] += 1e3 * event.freed
        now["lost_mJ"] += 1e3 * event.lost
        if unit.place[1] > 1:
            gone = now.get("places_gone", 0) + 1
            now |= {"places": unit.place[1], "places_gone": gone, "last_time_s": event.time}
        elif event.together:
            now["at_once_with_others"] = int(event.together)
    return out


def event_arrays(units: Sequence[Any], events: Array) -> tuple[list[str], Array]:
    """What happened to which part (n,), in the order of time, and when (s)."""
    did = {FAILS: "gave way", BEGINS: "began"}, {FAILS: "was taken off", BEGINS: "was put on"}
    names = [units[int(row[0])].name for row in events]
    said = zip(names, events[:, 6], strict=True)
    return [f"{in_words(n)} {did[n.startswith(SPLINT)][k]}" for n, k in said], events[:, 1]


def in_words(part: str) -> str:
    """A part as sentences name it."""
    kind, _, rest = part.partition("_")
    words = f"{WORDS[kind]} {rest}" if kind in WORDS else f"the {part}"
    return words.replace("_", " ")


def give_way_sentences(summary: Mapping[str, Any]) -> Iterator[str]:
    """Say what gave way, what began, and what would give way first."""
    events = [
        *((e["time_s"], part, e) for part, e in summary.get("gave_way", {}).items()),
        *((e["time_s"], part, None) for part, e in summary.get("began", {}).items()),
        *((e["time_s"], part, e) for part, e in summary.get("taken_off", {}).items()),
    ]
    for time, part, event in sorted(events, key=lambda row: row[0]):
        name = _sentence_name(part)
        if event is None:
            did = "was put on" if part.startswith(SPLINT) else "began to act"
            yield f"{name} {did} at {time:.4g} s."
        elif "torque_Nmm" in event:
            yield f"{name} was taken off at {time:.4g} s, under {event['torque_Nmm']:.3g} N mm."
        elif "places" in event:
            yield (
                f"{name} peeled off from {time:.4g} to {event['last_time_s']:.4g} s: "
                f"{event['places_gone']} of {event['places']} places, {event['lost_mJ']:.3g} mJ "
                "lost."
            )
        else:
            others = event.get("at_once_with_others", 0)
            order = " (at once with others: nothing tells the order)" if others else ""
            yield (
                f"{name} gave way at {time:.4g} s under {event['force_N']:.3g} N{order}; "
                f"{event['lost_mJ']:.3g} mJ were lost."
            )
    if (first := summary.get("first_to_give_way")) is None:
        return
    share = 100 * summary["strength"].get(first["part"], {}).get("share", np.nan)
    load = first.get("at_times_the_loads")
    then = (
        f"it gives way at {load:.3g} times these loads"
        if load is not None
        else f"the load at which it gives way is not known ({first['no_load_known']})"
    )
    yield (
        f"{_sentence_name(first['part'])} would give way first: it bears {share:.3g} % of what it "
        f"can; {then}."
    )


def _sentence_name(part: str) -> str:
    words = in_words(part)
    return words[0].upper() + words[1:]
