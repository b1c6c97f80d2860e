"""The controls of a case, made of its tables: which values can be moved, and how far."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import floor, log10
from typing import Any, Literal, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel

from cosim.analyses.ladder import rungs_of
from cosim.case.file import layers_of, packaged_cases
from cosim.case.schema import Case
from cosim.errors import InputError
from cosim.fingers.kinds import native_tendons
from cosim.hoods.kinds import KINDS
from cosim.number_text import read_number
from cosim.schema import units
from cosim.schema.fields import Text
from cosim.text_tables import read_toml

Form = Literal["slider", "switch", "choice", "text"]
POSTURE, TENDONS, HOOD, LESION = "Posture", "Tendons", "Hood", "Lesion or repair"
FINGER = "Finger"
OF_FINGER = (
    "lengths", "masses", "arms", "extensor_share", "guides", "pulleys", "passive", "limit",
)  # fmt: skip
"""Keys of a finger's table that have controls, besides its posture."""
MATERIAL, SUPPORTS = "Material, by region", "Springs and contact"
MODULI = "moduli"
"""The key of the factor on all moduli, which is no key of a case."""
CUT, ADHERE, LENGTH = "lesion.cut", "lesion.adhere", "lesion.length"
CUT_PARTLY = "lesion.cut_partly"
"""Keys of a lesion's controls, followed by the part."""
SPAN = 5.0
"""How many times a value its slider goes up and down, where the schema's range says nothing."""
WIDE, NARROW = 250.0, 8.0
"""A slider has the schema's range where that is at most so wide, or so many times the value."""
MOST_SHARE = 0.95
"""The largest part of its width that is cut of a part."""
MOST_CHANGE = 5.0
"""mm by which a part is shortened or lengthened at most."""
LIMIT = f"(length with its unit: at most {MOST_CHANGE:g} mm)"
CUT_SAYS = "A slip comes off its bone, a band lets go, any other part is cut across its fibres."
LEAST_PULL = 20.0
"""N, to which a tension's slider goes at least."""
STEPS = 200
WORDS = {
    "MCP": "MCP flexion",
    "PIP": "PIP flexion",
    "DIP": "DIP flexion",
    "MCP_abduction": "MCP abduction",
    "c1": "matrix, c1",
    "c2": "matrix, c2",
    "c3": "toe of the fibres, c3",
    "c4": "toe of the fibres, c4",
    "c5": "fibre modulus, c5",
    "lam_max": "fibres straight at stretch",
    "quads": "elements of the mesh",
    "arms": "moment arm of",
    "limit": "joint limit",
    "passive": "torque of the joint",
    "pulleys": "radius of the pulley of",
}
"""Keys whose words are others."""


@dataclass(frozen=True)
class Control:
    """A value of a case that can be moved."""

    key: str
    """Dotted, as --set takes it."""
    group: str
    part: str
    """What in the group it belongs to; empty of one that stands alone."""
    label: str
    meaning: str
    """What the schema says of it, as `cosim explain` gives it."""
    form: Form
    text: str
    """What the case states, as --set takes it."""
    unit: str = ""
    low: float | None = None
    """The slider's ends, in the unit; it may be written beyond them."""
    high: float | None = None
    step: float = 0.0
    is_log: bool = False
    """The slider moves by factors."""
    choices: tuple[str, ...] = ()

    def words(self, text: str) -> str:
        """A value of this control in words."""
        name = f"{self.part}, {self.label}" if self.part else self.label
        if self.form == "switch":
            return name if text == "true" else f"not {name}"
        return f"{name} {text}"


def controls_of(case: Case) -> tuple[Control, ...]:
    """The controls of a case, in the order of the page."""
    posture = getattr(case.finger, "posture", None)
    of_hood = sorted(map(_in_group, _hood(case)), key=lambda c: bool(c.part))
    return (
        *(() if posture is None else _walk(posture, "finger.posture", POSTURE)),
        *_tendons(case),
        *_moduli(case),
        *(c for c in of_hood if c.group == HOOD),
        *_lesion(case),
        *_walk(case.finger, "finger", FINGER, only=OF_FINGER),
        *(c for c in of_hood if c.group == MATERIAL),
        *(c for c in of_hood if c.group == SUPPORTS),
    )


def _hood(case: Case) -> Iterator[Control]:
    """The controls of the hood's table; one that several parts share says which follow it."""
    shared = case.hood.followers()
    for control in _walk(case.hood, "hood", HOOD):
        more = f" It {shared[control.key]}." if control.key in shared else ""
        yield replace(control, meaning=control.meaning + more)


def _in_group(control: Control) -> Control:
    """A control of the hood in the group of its own that its table has."""
    table, _, rest = control.part.partition(": ")
    match table:
        case "regions":
            return replace(control, group=MATERIAL, part=rest)
        case "springs":
            return replace(control, group=SUPPORTS, part=rest)
        case "contact":
            return replace(control, group=SUPPORTS)
    return control


def changed_case(case: Case, changes: Mapping[str, str]) -> Case:
    """The case with texts by the keys of its controls in place of what it states.

    Raises InputError that lists every fault with its place."""
    layers = layers_of(_plain_settings(case, changes))
    if lesion := _lesion_table({**_lesion_texts(case), **changes}):
        layers.append(("the page", {"lesion": lesion}))
    return case.model_copy(update={"lesion": None}).with_layers(layers)


def settings_of(case: Case, changes: Mapping[str, str]) -> list[str] | None:
    """The changes as texts KEY=VALUE, as --set takes them; None where such texts cannot say them: a
    lesion of the case that is another one or gone."""
    lesion = _lesion_table({**_lesion_texts(case), **changes})
    if not any(key.startswith("lesion.") for key in changes):
        return _plain_settings(case, changes)
    if case.lesion is not None:
        return None
    said = []
    for key, of in lesion.items():
        match of:
            case list():
                said.append(f"lesion.{key}={json.dumps(of)}")
            case dict():
                said += [f"lesion.{key}.{part}={amount}" for part, amount in of.items()]
    return [*_plain_settings(case, changes), *said]


def _plain_settings(case: Case, changes: Mapping[str, str]) -> list[str]:
    """Texts KEY=VALUE of all changes but those of the lesion."""
    stated = [
        f"{key}={text}"
        for key, text in changes.items()
        if not (key == MODULI or key.startswith("lesion."))
    ]
    return [*_scaled(case, changes[MODULI]), *stated] if MODULI in changes else stated


def control_at_fault(place: str, controls: Sequence[Control]) -> str:
    """The key of the control to which a place of a fault belongs; empty where it has none."""
    keys = [control.key for control in controls]
    if place in keys:
        return place
    for changed in ("lesion.shorten.", "lesion.lengthen."):
        if place.startswith(changed):
            return f"{LENGTH}.{place.removeprefix(changed)}"
    above = (key for key in keys if place.startswith(f"{key}."))
    below = (key for key in keys if place and key.startswith(f"{place}."))
    return next(above, next(below, ""))


def _scaled(case: Case, text: str) -> Sequence[str]:
    factor = read_number(text)
    if factor is None or factor <= 0:
        raise InputError(f"{MODULI}: write a factor above 0, for example 1.5, not {text[:30]!r}")
    return KINDS[case.hood.kind].scaled_moduli(case.hood, factor) if factor != 1.0 else ()


def _words(key: str) -> str:
    return WORDS.get(key, key.replace("_", " "))


def _walk(
    table: BaseModel, place: str, group: str, part: str = "", only: Collection[str] = ()
) -> Iterator[Control]:
    """A control for each value of a table and of those below it that a slider, switch or choice
    can say; values that the case does not state are left out.  `only`: the table's keys that have
    controls, where not all do."""
    for name, field in type(table).model_fields.items():
        if only and name not in only:
            continue
        value, key = getattr(table, name), f"{place}.{name}"
        meaning = " ".join((field.description or "").split())
        below = part or _words(name)
        beneath = f"{part}: {_words(name)}" if part else below
        match value:
            case BaseModel():
                yield from _walk(value, key, group, beneath)
            case dict():
                for inner_name, inner in value.items():
                    at, named = f"{key}.{inner_name}", f"{below}: {_words(inner_name)}"
                    match inner:
                        case BaseModel():
                            yield from _walk(inner, at, group, named)
                        case _:
                            inside = get_args(field.annotation)[-1]
                            yield from _leaf(at, inner_name, inner, [inside], meaning, group, below)
            case _:
                hints = [*field.metadata, field.annotation]
                yield from _leaf(key, name, value, hints, meaning, group, part)


def _leaf(
    key: str, name: str, value: Any, hints: Sequence[Any], meaning: str, group: str, part: str
) -> Iterator[Control]:
    label = _words(name)
    match value:
        case bool():
            text = "true" if value else "false"
            yield Control(key, group, part, label, meaning, "switch", text)
        case int() | float():
            stated: Text | None = next(_find(hints, Text), None)
            if stated is None:
                yield _plain(key, group, part, label, meaning, value, hints)
            elif stated.kind is not None:  # else it may be a list too
                yield _quantity(key, group, part, label, meaning, value, stated)
        case str():
            words = next((get_args(h) for h in _literals(hints)), ())
            if len(words) > 1 and name != "kind":
                choices = tuple(map(str, words))
                yield Control(key, group, part, label, meaning, "choice", value, choices=choices)


def _find(hints: Any, kind: type[Any]) -> Iterator[Any]:
    for one in hints:
        if isinstance(one, kind):
            yield one
        else:
            yield from _find(getattr(one, "__metadata__", ()), kind)
            if get_origin(one) is not Literal:
                yield from _find(get_args(one), kind)


def _literals(hints: Any) -> Iterator[Any]:
    for one in hints:
        if get_origin(one) is Literal:
            yield one
        else:
            yield from _literals(get_args(one))


def _quantity(
    key: str, group: str, part: str, label: str, meaning: str, value: float, text: Text
) -> Control:
    kind = text.kind
    assert kind is not None
    ends = [
        units.in_unit(units.parse(end, kind), kind) if end else None
        for end in (text.least, text.most)
    ]
    says = f"{meaning} ({dict(text.schema)['title']})"
    low, high, step, is_log = _range(units.in_unit(value, kind), ends[0], ends[1])
    spelled = units.spell(value, kind)
    return Control(
        key, group, part, label, says, "slider", spelled, kind.unit, low, high, step, is_log
    )


def _plain(
    key: str, group: str, part: str, label: str, meaning: str, value: float, hints: Sequence[Any]
) -> Control:
    low = next((float(h.ge) for h in _find(hints, Ge)), None)
    low = next((float(h.gt) for h in _find(hints, Gt)), low)
    high = next((float(h.le) for h in _find(hints, Le)), None)
    high = next((float(h.lt) for h in _find(hints, Lt)), high)
    words = [f"{w} {v:g}" for w, v in (("at least", low), ("at most", high)) if v is not None]
    says = f"{meaning} (a number{': ' if words else ''}{', '.join(words)})"
    low, high, step, is_log = _range(float(value), low, high)
    match value:
        case int():
            step = float(max(1, round(step)))
    return Control(
        key, group, part, label, says, "slider", f"{value!r}", "", low, high, step, is_log
    )


def _range(
    value: float, least: float | None, most: float | None
) -> tuple[float, float, float, bool]:
    """A slider's ends, its step, and whether it moves by factors, about a value whose schema gives
    these ends."""
    if least is not None and most is not None:
        span = most - least
        if span <= (WIDE if least < 0 or value <= 0 else NARROW * value):
            return least, most, _step(span), False
    if value > 0:
        low, high = value / SPAN, value * SPAN
        low = low if least is None else max(low, least)
        return low, high if most is None else min(high, most), 0.0, True
    low = min(value, 0.0) if least is None else max(least, 2 * value if value < 0 else -10.0)
    high = 10.0 if most is None else min(10.0, most)
    return low, high, _step(high - low), False


def _step(span: float) -> float:
    """A round step, of which about STEPS make the span."""
    rough = span / STEPS
    ten = 10.0 ** floor(log10(rough)) if rough > 0 else 1.0
    return float(f"{min((m for m in (1, 2, 5, 10) if m * ten >= rough), default=10) * ten:.6g}")


def _tendons(case: Case) -> Iterator[Control]:
    """A control for each tendon: what the case states of it, else its tension."""
    hood = case.hood.tendon_names(case.finger.kind) or ()
    own = native_tendons(case.finger, case.hood.left_to_finger)
    for name in dict.fromkeys((*hood, *own, *case.tendons)):
        stated, key = case.tendons.get(name), f"tendons.{name}"
        if stated is not None and stated.actuation is not None:
            yield from _walk(stated.actuation, f"{key}.actuation", TENDONS, _words(name))
            continue
        over_time = " Over time it is multiplied by the case's signal." * bool(
            stated is not None and stated.signal is not None
        )
        if stated is not None and stated.activation is not None:
            most = units.spell(stated.max_force or 0.0, units.FORCE)
            says = f"Activation, 0 to 1, of a muscle that pulls with {most} at most.{over_time}"
            text = f"{stated.activation:g}"
            yield Control(
                f"{key}.activation", TENDONS, "", f"{_words(name)}, activation", says, "slider",
                text, "", 0.0, 1.0, 0.01,
            )  # fmt: skip
        elif stated is not None and stated.excursion is not None:
            says = f"How far the tendon's end is drawn proximally; its tension is found.{over_time}"
            yield Control(
                f"{key}.excursion", TENDONS, "", f"{_words(name)}, excursion", says, "slider",
                units.spell(stated.excursion, units.LENGTH), "mm", -15.0, 15.0, 0.1,
            )  # fmt: skip
        else:
            force = case.tension(name)
            high = max(LEAST_PULL, 3 * force)
            says = (
                f"Tension of {name} (force with its unit: at least 0 N, at most 1000 N); the "
                f"resting tension is {units.spell(case.solve.resting_tension, units.FORCE)}."
                f"{over_time}"
            )
            yield Control(
                f"{key}.tension", TENDONS, "", f"{_words(name)}, tension", says, "slider",
                units.spell(force, units.FORCE), "N", 0.0, high, _step(high),
            )  # fmt: skip


def _moduli(case: Case) -> Iterator[Control]:
    if KINDS[case.hood.kind].scaled_moduli(case.hood, 2.0):
        says = "A factor on every modulus of the hood; those below can be set one by one."
        yield Control(
            MODULI, HOOD, "", "all moduli, factor", says, "slider", "1", "", 0.2, 5.0, 0.0, True
        )


def _lesion(case: Case) -> Iterator[Control]:
    parts, texts = case.hood.parts(), _lesion_texts(case)
    if parts is None:
        return
    kinds = (
        (CUT, "Cut", parts.cut, CUT_SAYS),
        (ADHERE, "Grown onto the bone", parts.adhere, "The part is held where it was laid."),
    )  # fmt: skip
    for kind, title, names, says in kinds:
        for name in names:
            key = f"{kind}.{name}"
            yield Control(key, LESION, title, _words(name), says, "switch", texts.get(key, "false"))
    for name in parts.cut_partly:
        says = "The share of its width that is cut across its fibres, from the radial side."
        yield Control(
            f"{CUT_PARTLY}.{name}", LESION, "Cut in part", _words(name), says, "slider",
            texts.get(f"{CUT_PARTLY}.{name}", "0"), "", 0.0, MOST_SHARE, 0.05,
        )  # fmt: skip
    for name in parts.lengths:
        key = f"{LENGTH}.{name}"
        says = f"How much longer the part is than the case lays it; below zero shorter. {LIMIT}"
        yield Control(
            key, LESION, "Longer or shorter", _words(name), says, "slider",
            texts.get(key, "0 mm"), "mm", -MOST_CHANGE, MOST_CHANGE, 0.1,
        )  # fmt: skip


def _lesion_texts(case: Case) -> dict[str, str]:
    """What a case states of its lesion, by the keys of the controls."""
    if case.lesion is None:
        return {}
    longer = case.lesion.lengthen
    shorter = {name: -change for name, change in case.lesion.shorten.items()}
    return {
        **{f"{CUT}.{name}": "true" for name in case.lesion.cut},
        **{f"{ADHERE}.{name}": "true" for name in case.lesion.adhere},
        **{f"{CUT_PARTLY}.{name}": f"{share:g}" for name, share in case.lesion.cut_partly.items()},
        **{
            f"{LENGTH}.{name}": units.spell(change, units.LENGTH)
            for name, change in (*longer.items(), *shorter.items())
        },
    }


def _lesion_table(texts: Mapping[str, str]) -> dict[str, Any]:
    """The table of a case that the controls of a lesion make; empty of an intact hood."""
    table: dict[str, Any] = {}
    for key, text in texts.items():
        _, _, kind_and_part = key.partition(".")
        kind, _, part = kind_and_part.partition(".")
        if not key.startswith("lesion.") or not part:
            continue
        if kind in ("cut", "adhere") and text == "true":
            table.setdefault(kind, []).append(part)
        elif kind == "cut_partly" and _number(text) != 0.0:
            table.setdefault(kind, {})[part] = _number(text)
        elif kind == "length":
            shorter = text.lstrip().startswith("-")
            amount = text.strip().removeprefix("-")
            if _number(amount) != 0.0:
                table.setdefault("shorten" if shorter else "lengthen", {})[part] = amount
    return table


def _number(text: str) -> float | None:
    return read_number(text.split(" ")[0])


def rungs_in_words(case: Case) -> list[dict[str, str]]:
    """The hoods that can be put on the case's finger: rung and words."""
    if not case.finger.is_native:
        return [{"name": case.hood.rung(), "label": case.hood.title}]
    rungs = [
        rung
        for rung in rungs_of(case)
        if rung == case.hood.rung() or case.finger.kind in _kind_on(rung).fits
    ]
    return [{"name": rung, "label": _rung_label(case, rung)} for rung in rungs]


def _kind_on(rung: str) -> Any:
    return next(kind.table for kind in KINDS.values() if rung in kind.table.rungs)


def _rung_label(case: Case, rung: str) -> str:
    own = rung == case.hood.rung()
    return (
        f"{rung}: {case.hood.title} (the case's own)" if own else f"{rung}: {_kind_on(rung).title}"
    )


def shipped() -> Sequence[Mapping[str, str]]:
    """The packaged cases: name, family and title."""
    rows = [
        {"name": n, "family": p.parent.name, "title": str(read_toml(p).get("title", ""))}
        for n, p in packaged_cases().items()
    ]
    return sorted(rows, key=lambda row: (row["family"], row["name"]))
