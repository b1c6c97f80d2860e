"""Forces that a coupling would count twice: handed over by the hood, and made by the finger too.

A load names its sources, and a finger's ledger its own.  What a finger makes of whatever else acts
on it (a joint's reaction above all) must not come in from outside as well; nor must a tendon pull
once over the hood and once on the bones.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from cosim.case_schema import Case, FmuHood, PulleyHood
from cosim.port import Finger, Hood, InputError, MovingFinger

OF_FINGER = ("joint", "muscle", "passive", "limit", "damping", "gravity", "inertia", "fingertip")
"""What `cosim.port.Finger.ledger` and that of a motion book, besides tendons by name."""
JOINT_CONTACT = "joint_contact"
"""The source under which a one-way pass hands over the joints' forces."""


@dataclass(frozen=True)
class Pair:
    """One force under its two names."""

    hood: str
    finger: str
    remedy: str

    def __str__(self) -> str:
        return f"hood {self.hood} and {self.finger}"


def counted_twice(
    sources: Sequence[str], hood_tendons: Sequence[str], finger_tendons: Sequence[str]
) -> tuple[Pair, ...]:
    """The pairs among the sources and tendons of a hood and what a finger with these tendons makes
    itself.  A source is taken by its first word: "joint_contact", "joint reaction" are "joint"."""
    return (*_sources(sources, finger_tendons), *_tendons(hood_tendons, finger_tendons))


def _sources(sources: Sequence[str], tendons: Sequence[str]) -> Iterator[Pair]:
    for source in sources:
        own = source if source in tendons else source.replace("_", " ").split(" ")[0].lower()
        if own in OF_FINGER or own in tendons:
            way = "leave that source out of the hood's load"
            if source == JOINT_CONTACT:
                way = 'write coupling.one_way.joint_contact = "none"'
            yield Pair(source, own, way)


def _tendons(hood: Sequence[str], finger: Sequence[str]) -> Iterator[Pair]:
    for name in hood:
        if name in finger:
            yield Pair(f"tendon {name}", f"tendon {name}", "leave the tendon out of the hood")


def stated_pairs(case: Case, finger_tendons: Sequence[str]) -> tuple[Pair, ...]:
    """What the case alone shows, before anything is built; of a mesh file see `pairs`."""
    sources = case.hood.sources if isinstance(case.hood, FmuHood) else ()
    tendons: Sequence[str] = ()
    if isinstance(case.hood, FmuHood):
        tendons = case.hood.tendons
    elif isinstance(case.hood, PulleyHood):
        tendons = tuple(case.hood.paths)
    return counted_twice((*sources, *handed_over(case)), tendons, finger_tendons)


def handed_over(case: Case) -> tuple[str, ...]:
    """What a one-way pass adds to the hood's own sources and the finger makes too."""
    return () if case.coupling.one_way.joint_contact == "none" else (JOINT_CONTACT,)


def pairs(case: Case, hood: Hood, finger: Finger | MovingFinger) -> tuple[Pair, ...]:
    """What the live models show."""
    return counted_twice((*hood.sources, *handed_over(case)), hood.tendons, finger.tendons)


def refuse(case: Case, found: Sequence[Pair]) -> None:
    """Raises InputError that names the pairs, unless the case says that it means them."""
    if not found or case.coupling.allow_double_counting:
        return
    each = "; ".join(f'"hood {p.hood}" and the finger\'s own "{p.finger}"' for p in found)
    ways = ", ".join(dict.fromkeys(p.remedy for p in found))
    raise InputError(
        f"coupling: a force would be counted twice: {each}. Either {ways}, or, to see what that "
        "does, write coupling.allow_double_counting = true"
    )
