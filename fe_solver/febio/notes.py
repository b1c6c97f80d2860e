"""What a FEBio file holds beside what was read: a note of each, or an error where it may change the
answer."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby

from fe_solver.febio.xml import FebTag

SETTINGS = (
    "laugon tolerance gaptol update_penalty two_pass knmult ktmult search_tol search_radius seg_up "
    "symmetric_stiffness minaug maxaug node_reloc smooth_aug fric_tol fric_penalty"
).split()
"""Settings of a contact that say how FEBio finds the answer, not which."""
CRITICAL = (
    "Boundary",
    "Rigid",
    "Loads",
    "Discrete",
    "Material",
    "MeshDomains",
    "MeshData/Element",
    "LoadData",
    "Contact",
)
REASONS = {
    "Output": "what is written is chosen by the caller",
    "Globals": "constants that a static shell does not use",
    "Control": "FEBio's own solver and step settings",
    "Contact": "FEBio's own search, penalty and augmentation settings",
    "Mesh": "nothing that is read uses it",
}
ATTRIBUTES = frozenset(
    (
        "id name type lc mat lid version node_set surface elem_set surface_pair discrete_set dmat "
        "var data_type"
    ).split()
)
"""That this reader uses, or that say nothing more than it knows."""


def collect_notes(root: FebTag, notes: list[str]) -> tuple[str, ...]:
    """The notes and one more for everything that nothing read.

    Raises InputError where it may change the answer."""
    left = []
    for t in root.unread():
        if _critical(t) and not _harmless(t):
            raise t.fault("is not known to this reader and may change the answer")
        left.append((_place(t), t))
    out = [*notes, *_unknown_attributes(root)]
    for (parent, why), group in groupby(left, key=lambda x: _reason(x[0])):
        tags = [t for _, t in group]
        names = ", ".join(dict.fromkeys(_label(t) for t in tags))
        lines = sorted({t.line for t in tags})
        where = f"line {lines[0]}" if len(lines) == 1 else f"lines {lines[0]}-{lines[-1]}"
        out.append(f"{parent or 'file'} ({where}): {names}: {why}")
    return tuple(dict.fromkeys(out))


def _place(t: FebTag) -> str:
    return t.path.removeprefix("Step/step/")


def _critical(t: FebTag) -> bool:
    return _place(t).startswith(CRITICAL)


def _harmless(t: FebTag) -> bool:
    """Whether a setting of contact, which may change the answer, has a value that does not."""
    return t.name in SETTINGS and t.parent is not None and t.parent.name == "contact"


def _unknown_attributes(tag: FebTag) -> Iterator[str]:
    """Attributes that nothing read, of the tags that were read."""
    for name in tag.attributes.keys() - ATTRIBUTES:
        if _critical(tag):
            raise tag.fault(f"the attribute {name!r} is not known and may change the answer")
        yield f"{_place(tag)} (line {tag.line}): the attribute {name!r} is not known to this reader"
    for t in tag.children:
        if t.used:
            yield from _unknown_attributes(t)


def _label(t: FebTag) -> str:
    return f"{t.name} {t.attributes['name']!r}" if "name" in t.attributes else t.name


def _reason(path: str) -> tuple[str, str]:
    top = path.split("/")[0]
    return path.rpartition("/")[0], REASONS.get(top, "not known to this reader")
