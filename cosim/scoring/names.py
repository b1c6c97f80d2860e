"""Which of a model's joints, sites and tendons are those of a finger here, found by their names."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from typing import Literal

from cosim.errors import InputError, nearest_names
from cosim.schema.types import MUSCLES
from cosim.text_tables import read_toml
from meshes.skeleton import BODIES, JOINTS
from rigid.mjcf.read import PartNames

FingerName = Literal["index", "middle", "ring", "little"]
FINGERS: tuple[FingerName, ...] = ("index", "middle", "ring", "little")
SHIPPED = ("myohand", "opensim")
"""The mappings of `cases/data/names_*.toml`, which are of the index finger."""
TIP = "tip"
SIDE = re.compile(r"(_r|_right|_tendon|_muscle|_tendon_r|_muscle_r)$")


@dataclass(frozen=True)
class Matched:
    """Names of a finger's parts, from ours to the model's (with a minus before a joint that turns
    the other way), and by ours how each was found."""

    names: Mapping[str, str]
    how: Mapping[str, str]

    @property
    def tendons(self) -> dict[str, str]:
        """The muscles' names, from ours to the model's."""
        return {ours: theirs for ours, theirs in self.names.items() if ours in MUSCLES}


@cache
def shipped_names(which: str) -> dict[str, str]:
    """A shipped mapping, from our names to a model's."""
    return read_names(Path(str(files("cases"))) / "data" / f"names_{which}.toml")


def read_names(path: Path) -> dict[str, str]:
    """A mapping of the user's: a TOML file of lines `EDC = "EDCI"`.  Raises InputError."""
    return check_names(read_toml(path), str(path))


def check_names(values: Mapping[str, object], place: str) -> dict[str, str]:
    """A mapping of the user's, checked.  Raises InputError."""
    known = (*BODIES, *JOINTS, TIP, *MUSCLES)
    checked = {}
    for ours, theirs in values.items():
        match theirs:
            case str() if ours in known:
                checked[ours] = theirs
            case _:
                raise InputError(
                    f'{place}: {ours}: write lines like EDC = "EDCI"; our names are '
                    f"{', '.join(known)}"
                )
    return checked


def check_present(parts: PartNames, given: Mapping[str, str], model: Path, source: Path) -> None:
    """Check that a model has the parts that a mapping of the file `source` names; an empty name is
    of a part that it lacks.  Raises InputError."""
    for ours, theirs in given.items():
        kind, there = _candidates(parts)[ours]
        if theirs and not any(name.removeprefix("-") in there for name in theirs.split("|")):
            near = nearest_names(theirs.removeprefix("-"), there)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise InputError(
                f'{source}: {ours} = "{theirs}": {model} has no {kind} of that name{hint}'
            )


def _candidates(parts: PartNames) -> dict[str, tuple[str, tuple[str, ...]]]:
    """By each name of ours what it is in a model, and the model's parts of this kind."""
    return {
        **dict.fromkeys(JOINTS, ("joint", tuple(parts.joints))),
        TIP: ("site", parts.sites),
        **dict.fromkeys(MUSCLES, ("tendon", parts.tendons)),
        **dict.fromkeys(BODIES, ("body", parts.bodies)),
    }


@cache
def _patterns() -> Mapping[str, Mapping[str, str]]:
    return read_toml(Path(str(files("cases"))) / "data" / "names_fingers.toml")


def match_names(
    parts: PartNames, finger: FingerName, given: Mapping[str, str] | None = None
) -> Matched:
    """The parts of a finger among those of a model: as `given`, as a shipped mapping says, else by
    their usual names.  A joint whose range lies on its negative side turns the other way.  Raises
    InputError for a part that is given twice."""
    names: dict[str, str] = {}
    how: dict[str, str] = {}
    stated, taken = given or {}, dict[tuple[str, str], str]()
    every = _candidates(parts)
    for ours in sorted(every, key=lambda name: name not in stated):
        kind, candidates = every[ours]
        if kind == "body":
            found = (stated[ours], "given") if ours in stated else None
        else:
            found = _find(ours, candidates, finger, stated)
        if found is None:
            continue
        part = kind, found[0].removeprefix("-")
        if not part[1] or part not in taken:
            names[ours], how[ours], taken[part] = *found, ours
        elif found[1] == "given":
            raise InputError(
                f'names: {taken[part]} and {ours} are both given as "{part[1]}"; a {kind} is one '
                "part of a finger: give each its own"
            )
    names = {ours: names[ours] for ours in every if ours in names}
    joints = {ours: names[ours] for ours in JOINTS if ours in names}
    for ours, theirs in joints.items():
        low, high = parts.joints[theirs.removeprefix("-")].range
        turned = ours != "MCP_abduction" and -low > high
        if turned and how[ours] != "given":
            names[ours], how[ours] = f"-{theirs}", f"{how[ours]}; its range is of the other way"
    plain = [name.removeprefix("-") for name in joints.values()]
    for ours, theirs in _bodies(parts, plain, joints).items():
        names.setdefault(ours, theirs)
        how.setdefault(ours, "by its joint")
    return Matched(names, how)


def _find(
    ours: str, theirs: Sequence[str], finger: FingerName, given: Mapping[str, str]
) -> tuple[str, str] | None:
    """The model's name of our `ours` among `theirs`, and how it was found."""
    for name in given.get(ours, "").split("|"):
        if name.removeprefix("-") in theirs:
            return name, "given"
    if ours in given:
        return None
    for which in SHIPPED if finger == "index" else ():
        for name in shipped_names(which).get(ours, "").split("|"):
            if name in theirs:
                return name, f"shipped names of {which}"
    short = {name: _short(name) for name in theirs}
    for pattern in _patterns()[finger].get(ours, "").split("|"):
        for name, text in short.items():
            if pattern and re.fullmatch(pattern, text):
                return name, "by its name"
    return None


def _short(name: str) -> str:
    """A name in small letters and digits alone, without an ending of side or kind."""
    lower = name.lower()
    while (cut := SIDE.sub("", lower)) != lower:
        lower = cut
    return re.sub(r"[^a-z0-9]", "", lower)


def _bodies(parts: PartNames, plain: Sequence[str], joints: Mapping[str, str]) -> dict[str, str]:
    """The bodies that the joints turn, and the metacarpal that carries the proximal phalanx; those
    without a name are left out."""
    if len(joints) < len(JOINTS):
        return {}
    of = {ours: parts.joints[name] for ours, name in zip(joints, plain, strict=True)}
    first, second = of["MCP"], of["MCP_abduction"]
    deeper = second if second.parent == first.body else first
    above = first if deeper is second else second
    metacarpal = above.parent if deeper.parent == above.body else deeper.parent
    bodies = (metacarpal, deeper.body, of["PIP"].body, of["DIP"].body)
    named = {ours: theirs for ours, theirs in zip(BODIES, bodies, strict=True) if theirs}
    return named if all(a != b for a, b in pairwise(bodies)) else {}
