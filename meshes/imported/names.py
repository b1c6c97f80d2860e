"""What the sets of a user's hood are called, which are missing, and the nearest names."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cosim.errors import InputError
from cosim.port import Ints
from meshes.hood_mesh import ENDS, REGIONS, SPRINGS
from meshes.imported.raw import RawMesh
from meshes.skeleton import BODIES

END, TIED, SPRING = "end_", "tied_", "spring_"
NODE_SETS = (
    *(END + name for name in ENDS),
    *(TIED + name for name in BODIES),
    *(SPRING + name for name in SPRINGS),
)
NAMES = (*REGIONS, *NODE_SETS)
"""All that a hood's set may be called."""
MEANING = {
    "end_central": "nodes across the proximal end of the extensor tendon, which EDC and EI pull",
    "end_radial": "nodes across the proximal end of the radial lateral band, which LUM pulls",
    "end_ulnar": "nodes across the proximal end of the ulnar lateral band, which FPI pulls",
    "tied_distal": "nodes of the terminal slip's insertion, fixed to the distal phalanx",
    "spring_central_slip": (
        "nodes of the central slip's insertion, held by springs to the middle phalanx (or "
        "tied_middle: fixed to it)"
    ),
}
JOIN = "+"
"""Between several of the file's sets that are one of ours."""
SHOWN = 40


@dataclass(frozen=True)
class Named:
    """The sets of a raw mesh under our names."""

    cells: Mapping[str, Ints]
    nodes: Mapping[str, Ints]
    lines: Mapping[str, Ints]
    unused: tuple[str, ...]
    """The file's sets that are none of ours."""


def map_names(raw: RawMesh, mapping: Mapping[str, str]) -> Named:
    """`mapping`: from our name to the file's, or several joined by "+".

    Raises InputError for a name that is not known on either side."""
    check_names(mapping)
    known = {_plain(name): name for name in (*raw.cells, *raw.nodes)}
    cells, nodes, lines, used = {}, {}, {}, set()
    for ours in NAMES:
        of_file = raw.cells if ours in REGIONS else raw.nodes
        parts = _parts(mapping[ours], of_file) if ours in mapping else [known.get(_plain(ours), "")]
        if ours in mapping:
            _check_there(ours, parts, of_file)
        parts = [part for part in parts if part in of_file]
        if not parts:
            continue
        used.update(parts)
        found = np.unique(np.concatenate([of_file[part] for part in parts]))
        if ours in REGIONS:
            cells[ours] = found
            continue
        nodes[ours] = found
        pairs = [raw.lines[part] for part in parts if part in raw.lines]
        if len(pairs) == len(parts):
            lines[ours] = np.concatenate(pairs)
    unused = [name for name in dict.fromkeys((*raw.cells, *raw.nodes)) if name not in used]
    return Named(cells, nodes, lines, tuple(unused))


def check_names(mapping: Mapping[str, str], more: Sequence[str] = ()) -> None:
    """Check the names of a mapping.  Raises InputError for one of our names that is none; `more`
    are allowed too."""
    for ours in mapping:
        if ours not in NAMES and ours not in more:
            near = difflib.get_close_matches(ours, (*NAMES, *more), n=3, cutoff=0.4)
            hint = f"did you mean {' or '.join(near)}? " if near else ""
            raise InputError(
                f"--set-name {ours}={mapping[ours]}: {ours} is none of our names; {hint}known are "
                f"{', '.join((*NAMES, *more))}"
            )


def _parts(text: str, sets: Mapping[str, Ints]) -> list[str]:
    return [text] if text in sets else [part.strip() for part in text.split(JOIN)]


def _check_there(ours: str, parts: Iterable[str], sets: Mapping[str, Ints]) -> None:
    what = "quads" if ours in REGIONS else "nodes"
    for part in parts:
        if part not in sets:
            near = difflib.get_close_matches(part, list(sets), n=3, cutoff=0.4)
            hint = f"; the nearest are {', '.join(near)}" if near else ""
            raise InputError(
                f"--set-name {ours}={part}: the mesh has no set of {what} called {part!r}{hint}; "
                f"it has {list_names(sets)}"
            )


def _plain(name: str) -> str:
    return re.sub(r"[\s\-.]+", "_", name.strip()).casefold()


def list_names(names: Iterable[str]) -> str:
    """Names in a row, not too many."""
    every = list(names)
    more = f" and {len(every) - SHOWN} more" if len(every) > SHOWN else ""
    return (", ".join(every[:SHOWN]) or "none") + more


def missing_sets_fault(raw: RawMesh, sets: Named) -> list[str]:
    """A fault for the sets that a hood cannot do without, with what was found; none if complete."""
    faults = []
    lost = np.setdiff1d(np.arange(len(raw.quads)), np.unique(_join(sets.cells)))
    if len(lost):
        inside = [n for n, cells in raw.cells.items() if n in sets.unused and lost[0] in cells]
        where = f" (it is in {list_names(inside)})" if inside else ""
        faults.append(
            f"{len(lost)} of {len(raw.quads)} quads are in no region, the first is quad {lost[0]}"
            f"{where}. Regions are called {', '.join(REGIONS)}"
        )
    needed = [END + end for end in ENDS] + [TIED + "distal"]
    if TIED + "middle" not in sets.nodes:
        needed.append(SPRING + "central_slip")
    faults += [_lack(name, sets) for name in needed if name not in sets.nodes]
    twice, counts = np.unique(_join(sets.cells), return_counts=True)
    if len(twice) and counts.max() > 1:
        i = twice[np.argmax(counts > 1)]
        both = [name for name, cells in sets.cells.items() if i in cells]
        faults.append(
            f"{(counts > 1).sum()} quads are in two regions: quad {i} in {list_names(both)}"
        )
    if faults:
        faults.append(
            f"the mesh has the sets of quads: {list_names(raw.cells)}; of nodes: "
            f"{list_names(raw.nodes)}; of lines: {list_names(raw.lines)}. Rename them, or say "
            "which is which: --set-name end_central=NAME, several as A+B"
        )
    return faults


def _lack(name: str, sets: Named) -> str:
    near = difflib.get_close_matches(name, sets.unused, n=3, cutoff=0.4)
    hint = f"; the nearest names in the mesh are {', '.join(near)}" if near else ""
    return f"there is no set {name}: {MEANING[name]}{hint}"


def absent_sets(sets: Named) -> list[str]:
    """Sets without which a hood runs, but lacks something."""
    lacking = [SPRING + name for name in SPRINGS[1:] if SPRING + name not in sets.nodes]
    regions = [name for name in REGIONS if name not in sets.cells]
    out = []
    if lacking:
        out.append(f"not in the mesh, so not in the model: {', '.join(lacking)}")
    if regions:
        out.append(f"the mesh has no region {', '.join(regions)}")
    return out


def _join(sets: Mapping[str, Ints]) -> Ints:
    return np.concatenate([np.zeros(0, dtype=np.intp), *sets.values()])
