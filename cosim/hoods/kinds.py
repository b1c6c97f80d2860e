"""The kinds of hood, from coarse to fine: one line in KINDS and one in the union for each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from cosim.errors import nearest_names
from cosim.hoods import fmu, pulley, split
from cosim.hoods.cable import table as cable
from cosim.hoods.kind import HoodConfig, HoodKind
from cosim.hoods.lesion import LesionConfig
from cosim.hoods.lumped import table as lumped
from cosim.hoods.shell import variation as shell
from cosim.hoods.view import Colour, HoodField

KINDS: Mapping[str, HoodKind[Any]] = {
    kind.name: kind
    for kind in (
        split.KIND,
        lumped.TWO_BANDS,
        lumped.NETWORK,
        cable.KIND,
        shell.KIND,
        pulley.KIND,
        fmu.KIND,
    )
}
COLOURS = tuple(dict.fromkeys(colour for kind in KINDS.values() for colour in kind.colours))
"""What pictures, films and reports colour a hood by."""
AnyHood = (
    shell.ShellHoodConfig
    | pulley.PulleyHoodConfig
    | split.SplitHoodConfig
    | lumped.NetworkHoodConfig
    | lumped.TwoBandHoodConfig
    | cable.CableHoodConfig
    | fmu.FmuHoodConfig
)


def colours_of(hood: HoodField) -> tuple[Colour, ...]:
    """What a hood can be coloured by; a still picture and a film show the first."""
    on_lines, data = hood.quads.shape[1] == 2, {**hood.point_data, **hood.cell_data}
    return tuple(c for c in COLOURS if c.on_lines == on_lines and c.on_mesh in data)


def fitting_kinds(finger: str) -> tuple[str, ...]:
    """The kinds that go on a kind of finger."""
    return tuple(name for name, kind in KINDS.items() if finger in kind.table.fits)


def rungs() -> dict[str, str]:
    """The ladder, from the coarsest to the finest, with the packaged case that states each hood."""
    return {rung: case for kind in KINDS.values() for rung, case in kind.table.rungs.items()}


def unfit_lesion(hood: HoodConfig, kind: str, lesion: LesionConfig) -> str:
    """Why a hood of that kind cannot have a lesion; empty where it can."""
    parts = hood.parts()
    if parts is None:
        able = ", ".join(name for name, of in KINDS.items() if of.table.can_be_injured)
        none = f'a hood of kind "{kind}" has no parts to injure'
        return f"lesion: {hood.cannot_be_injured(lesion) or none}; {able} have"
    for key, names in lesion.names().items():
        of = {"shorten": "lengths", "lengthen": "lengths", "suture": "joined", "graft": "joined"}
        allowed: tuple[str, ...] = getattr(parts, of.get(key, key))
        for name in names:
            if name not in allowed:
                return f"lesion.{key}: {_unknown(name, key, kind, allowed)}"
    return hood.cannot_be_injured(lesion)


def _unknown(name: str, key: str, kind: str, allowed: Sequence[str]) -> str:
    if not allowed and key == "cut_partly":
        return f'a hood of kind "{kind}" is cut whole or not at all; "shell" can be cut in part'
    if not allowed and key in ("suture", "graft"):
        return f'a hood of kind "{kind}" takes no {key}; "shell" does'
    if not allowed:
        on_bones = [f'"{name}"' for name, of in KINDS.items() if of.table.lies_on_bones]
        return f'a hood of kind "{kind}" lies on no bone; {" and ".join(on_bones)} do'
    near = nearest_names(name, allowed)
    hint = f"did you mean {near[0]}? " if near else ""
    return f'no part {name[:60]!r} of a hood of kind "{kind}"; {hint}known: {", ".join(allowed)}'
