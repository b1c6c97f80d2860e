"""Forces that a coupling would count twice: handed over by the hood, and made by the finger too.

A load names its sources, and so does a finger's ledger.  A force that the finger computes itself (a
joint's reaction above all) must not be in the load as well, and a tendon must not pull once over
the hood and once on the bones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from cosim.case.schema import Case
from cosim.coupling.one_way import JOINT_CONTACT
from cosim.errors import InputError
from cosim.port import Finger, Hood, MovingFinger

OF_FINGER = (
    "joint",
    "muscle",
    "passive",
    "limit",
    "tie",
    "damping",
    "gravity",
    "inertia",
    "fingertip",
)
"""What `cosim.port.Finger.ledger` and that of a motion book, besides tendons by name."""


@dataclass(frozen=True)
class DoubleCount:
    """One force under its two names."""

    hood: str
    finger: str

    def __str__(self) -> str:
        return f"hood {self.hood} and {self.finger}"


def double_counted_pairs(
    sources: Sequence[str], hood_tendons: Sequence[str], finger_tendons: Sequence[str]
) -> tuple[DoubleCount, ...]:
    """The pairs among the sources and tendons of a hood and what a finger with these tendons makes
    itself.  A source is taken by its first word: "joint_contact", "joint reaction" are "joint"."""
    counted = []
    for source in sources:
        first = source.replace("_", " ").split(" ")[0]
        native = first if first in finger_tendons else first.lower()
        if native in OF_FINGER or native in finger_tendons:
            counted.append(DoubleCount(source, native))
    both = [f"tendon {name}" for name in hood_tendons if name in finger_tendons]
    return (*counted, *(DoubleCount(name, name) for name in both))


def pairs_of_case(case: Case, finger_tendons: Sequence[str]) -> tuple[DoubleCount, ...]:
    """What the case alone shows, before anything is built; our own hoods' sources and the shell's
    tendons are never a finger's."""
    sources, tendons = case.hood.source_names(), case.hood.tendon_names(case.finger.kind) or ()
    return double_counted_pairs((*sources, *added_sources(case)), tendons, finger_tendons)


def added_sources(case: Case) -> tuple[str, ...]:
    """What a one-way pass adds to the hood's own sources and the finger makes too."""
    return () if case.coupling.one_way.joint_contact == "none" else (JOINT_CONTACT,)


def pairs(case: Case, hood: Hood, finger: Finger | MovingFinger) -> tuple[DoubleCount, ...]:
    """What the live models show."""
    sources = dict.fromkeys((*hood.sources, *added_sources(case)))
    return double_counted_pairs(tuple(sources), hood.tendons, finger.tendons)


def refuse(case: Case, counted: Sequence[DoubleCount]) -> None:
    """Refuse pairs that count a force twice, unless the case says that it means them.  Raises
    InputError that names them."""
    if not counted or case.coupling.allow_double_counting:
        return
    each = "; ".join(f'"hood {p.hood}" and the finger\'s own "{p.finger}"' for p in counted)
    ways = ", ".join(dict.fromkeys(_remedy(case, p) for p in counted))
    raise InputError(
        f"coupling: a force would be counted twice: {each}. Either {ways}, or, to see what that "
        "does, write coupling.allow_double_counting = true"
    )


def _remedy(case: Case, pair: DoubleCount) -> str:
    if pair.hood in added_sources(case):
        return 'write coupling.one_way.joint_contact = "none"'
    what = pair.hood if pair.hood.startswith("tendon ") else f'the source "{pair.hood}"'
    return f"leave {what} out of the hood"
