"""An Abaqus input file (.inp) as a mesh: nodes and elements of parts, placed by their instances,
with the sets of both and the thickness of shell sections.

What is read is a subset of the keywords (Abaqus 2017, Keywords Reference): *NODE, *ELEMENT, *NSET,
*ELSET (GENERATE, sets of sets, INSTANCE=), *PART, *INSTANCE, *INCLUDE of a file beside,
*SHELL SECTION and *MEMBRANE SECTION.  Other cards are counted, and those that would make, move or
number nodes are refused.  Names are the same in any case of letters.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.files import MB, read_bytes
from cosim.number_text import RANGE, read_number, read_whole_number

if TYPE_CHECKING:
    from meshio import Mesh

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
TYPES = {
    "quad": "S4 S4R S4R5 S4RS S4RSW S4T S4RT R3D4 M3D4 M3D4R DS4 CPS4 CPS4R CPS4I CPE4 CPE4R "
    "SFM3D4 SFM3D4R",
    "triangle": "S3 S3R S3RS S3T S3RT STRI3 R3D3 M3D3 DS3 CPS3 CPE3 SFM3D3",
    "quad8": "S8R S8R5 S8RT M3D8 M3D8R CPS8 CPS8R CPE8 CPE8R SFM3D8",
    "quad9": "S9R5 M3D9 M3D9R",
    "triangle6": "STRI65 M3D6 CPS6 CPE6 SFM3D6",
    "line": "T3D2 T3D2H T2D2 B31 B31H B31OS B33 B21 PIPE31 FRAME3D SPRINGA SPRING2 DASHPOTA "
    "CONN3D2 CONN2D2 GAPUNI AXIALGAP R2D2",
    "line3": "T3D3 B32 B32H B32OS B22 PIPE32",
    "vertex": "MASS ROTARYI SPRING1 DASHPOT1 HEATCAP",
}
"""Types of elements by the shape that they have, as meshio calls it; others are left out."""
KINDS = {name: kind for kind, names in TYPES.items() for name in names.split()}
LINES, SHELLS = {"vertex": 1, "line": 2, "line3": 3}, {"triangle": 3, "triangle6": 6, "quad": 4}
SHELLS |= {"quad8": 8, "quad9": 9}
CORNERS = LINES | SHELLS
"""Nodes of an element of each kind."""
READ = {
    *("NODE", "ELEMENT", "NSET", "ELSET", "HEADING", "PART", "END PART", "ASSEMBLY", "INCLUDE"),
    *("END ASSEMBLY", "INSTANCE", "END INSTANCE", "PREPRINT"),
}
"""Cards that are read, or say nothing of a mesh."""
TURNED = ("B3", "PIPE3", "FRAME3D")
"""How types begin whose elements may name a node more, which turns their section."""
SECTIONS = ("SHELL SECTION", "MEMBRANE SECTION")
MAKERS = {
    *("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM", "PARAMETER"),
    *("SUBSTRUCTURE PROPERTY", "SYMMETRIC MODEL GENERATION"),
}
"""Cards without whose work nodes or elements would lie elsewhere, or be missing."""
MOST_BYTES = 64 * MB
"""The largest file, which takes some ten times as much in memory."""
MOST_INCLUDES = 20
"""Files, one within the other."""
MOST_FILES, MOST_SETS = 1000, 100
"""Files in all, and sets one within the other."""


class Card(NamedTuple):
    """A keyword with its parameters (names in capitals) and its lines of data."""

    word: str
    options: Mapping[str, str]
    lines: list[tuple[str, str]]
    """Where each stands, and its text."""
    place: str


class Section(NamedTuple):
    """The thickness that a section gives to the elements of a set."""

    name: str
    thickness: float


@dataclass
class _Scope:
    """The nodes, elements and sets of a part, of an instance, or of what stands in neither."""

    name: str = ""
    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    elements: dict[int, tuple[str, tuple[str, ...], str]] = field(default_factory=dict)
    """By number: the kind, the nodes as they are named, and where it stands."""
    sets: dict[tuple[str, str], list[_Entry]] = field(default_factory=dict)
    """By kind (NSET, ELSET) and name."""
    sections: list[Section] = field(default_factory=list)


class _Entry(NamedTuple):
    """What a line of a set names: numbers or sets, of another instance where one is said; or of a
    line of GENERATE the first, the last and the step."""

    names: tuple[str, ...]
    steps: tuple[int, int, int] | None
    instance: str
    place: str


class _Instance(NamedTuple):
    scope: _Scope
    part: str
    shift: Array
    turn: Array
    about: Array


@dataclass
class _Model:
    """What the cards of a file have said so far."""

    parts: dict[str, _Scope] = field(default_factory=dict)
    instances: dict[str, _Instance] = field(default_factory=dict)
    top: _Scope = field(default_factory=_Scope)
    other: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)


def read_inp(path: Path) -> Mesh:
    """Return the mesh of an input file: points (n, 3) in the file's unit, blocks of cells, sets of
    nodes and cells, for quads with one the `thickness`; in `info["dropped"]` what is not read.

    A set that several instances have is named INSTANCE.SET.  Raises InputError, with the line."""
    model = _Model()
    scope = model.top
    for card in _cards(path, (), []):
        if card.word in MAKERS:
            raise InputError(
                f"{card.place}: *{card.word} makes or moves nodes, and is not read; write the mesh "
                "out with plain *NODE and *ELEMENT cards (in Abaqus/CAE: Job, Write Input)"
            )
        scope = _enter(card, model, scope)
        take = TAKES.get(card.word)
        if take is not None:
            take(card, scope, model)
        elif card.word not in READ:
            model.other[card.word] += 1
    return _Flat(path, model).mesh()


def _cards(path: Path, within: tuple[Path, ...], read: list[Path]) -> Iterator[Card]:
    """The cards of a file and of those that it includes, in their order; `read`: the files so far.
    Raises InputError."""
    card: Card | None = None
    text, going_on = "", False
    for number, line in enumerate(_lines(path), 1):
        line = line.strip()
        if line.startswith("**") or (not line and card is None):
            continue
        place = f"{path.name}: line {number}"
        if line.startswith("*") or going_on:
            text = f"{text}{line}" if going_on else line
            going_on = text.endswith(",")
            if going_on:
                continue
            if card is not None:
                yield card
            card = _card(text, place)
            if card.word == "INCLUDE":
                yield from _included(card, path, within, read)
                card = None
        elif card is None:
            raise InputError(f"{place}: {line[:40]!r} stands before any keyword, as *NODE is one")
        else:
            card.lines.append((place, line))
    if card is not None:
        yield card


def _lines(path: Path) -> list[str]:
    try:
        return read_bytes(path, MOST_BYTES).decode("utf-8-sig", errors="replace").splitlines()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error


def _card(text: str, place: str) -> Card:
    word, *options = text[1:].split(",")
    pairs = (option.partition("=") for option in options if option.strip())
    named = {key.strip().upper(): value.strip(" \t\"'") for key, _, value in pairs}
    return Card(" ".join(word.upper().split()), named, [], place)


def _included(card: Card, path: Path, within: tuple[Path, ...], read: list[Path]) -> Iterator[Card]:
    name = card.options.get("INPUT", "")
    beside = (path.parent / name).resolve()
    if not name or not beside.is_relative_to(path.parent.resolve()):
        raise InputError(f"{card.place}: *INCLUDE, INPUT={name}: name a file beside {path.name}")
    if beside in within or len(within) >= MOST_INCLUDES:
        raise InputError(f"{card.place}: {name} includes itself, or too many files each other")
    if not beside.is_file():
        raise InputError(f"{card.place}: there is no file {name} beside {path.name}")
    read.append(beside)
    if len(read) > MOST_FILES:
        raise InputError(f"{card.place}: more than {MOST_FILES} files are included; join some")
    return _cards(beside, (*within, path.resolve()), read)


def _enter(card: Card, model: _Model, scope: _Scope) -> _Scope:
    """The scope in which a card stands, and those after it."""
    name = card.options.get("NAME", "")
    if card.word == "PART":
        return model.parts.setdefault(_key(name), _Scope(name))
    if card.word == "INSTANCE":
        if "PART" not in card.options:
            raise InputError(f"{card.place}: *INSTANCE without PART= is of another analysis")
        inner = _Scope(name)
        place = _placing(card)
        model.instances[_key(name)] = _Instance(inner, card.options["PART"], *place)
        return inner
    return model.top if card.word in ("END PART", "END INSTANCE", "ASSEMBLY") else scope


def _key(name: str) -> str:
    return name.casefold()


def _placing(card: Card) -> tuple[Array, Array, Array]:
    """How an instance lies: its first line, which may be blank, shifts it, the second then turns it
    about an axis.  Shift (3,), rotation (3, 3) and a point (3,) on the axis."""
    from scipy.spatial.transform import Rotation

    shift, axis = np.zeros(3), np.array([0.0, 0, 0, 1, 0, 0, 0])
    for i, (place, line) in enumerate(card.lines):
        row = _numbers(place, line) if line.strip(" ,") else []
        if row and i > 1:
            raise InputError(f"{place}: *INSTANCE has two lines, its shift and its turn")
        if i == 0 and len(row) > 3:
            raise InputError(
                f"{place}: the first line of *INSTANCE is its shift, three numbers, found "
                f"{len(row)}; where it is turned alone, write 0, 0, 0 before"
            )
        if i == 1 and row and len(row) != 7:
            raise InputError(f"{place}: expected two points of an axis and an angle")
        if i == 0:
            shift[: len(row)] = row
        elif row:
            axis = np.array(row)
    along = axis[3:6] - axis[:3]
    if not np.linalg.norm(along):
        raise InputError(f"{card.place}: the two points of the axis of *INSTANCE are one")
    turn = Rotation.from_rotvec(np.radians(axis[6]) * along / np.linalg.norm(along))
    return shift, np.asarray(turn.as_matrix()), axis[:3]


def _fields(line: str) -> list[str]:
    return [text.strip(" \t\"'") for text in line.rstrip(" ,").split(",")]


def _numbers(place: str, line: str) -> list[float]:
    values = []
    for text in _fields(line):
        value = read_number(text.upper().replace("D", "E")) if text else 0.0
        if value is None:
            raise InputError(f"{place}: expected numbers ({RANGE}), found {line[:40]!r}")
        values.append(value)
    return values


def _index(text: str) -> int:
    """The number of a node or an element, -1 where a text is a name."""
    number = read_whole_number(text)
    return -1 if number is None else number


def _whole_numbers(place: str, line: str) -> list[int]:
    found = [read_whole_number(text) for text in _fields(line)]
    if None in found:
        raise InputError(f"{place}: expected whole numbers, found {line[:40]!r}")
    return [number for number in found if number is not None]


def _take_nodes(card: Card, scope: _Scope, model: _Model) -> None:
    if card.options.get("SYSTEM", "R").upper() != "R" or "INPUT" in card.options:
        raise InputError(
            f"{card.place}: *NODE with SYSTEM= or INPUT= is not read; state x, y and z in this file"
        )
    numbers = []
    for place, line in card.lines:
        if not line:
            continue
        first, _, rest = line.partition(",")
        number, values = read_whole_number(first.strip()), _numbers(place, rest)
        if number is None:
            raise InputError(f"{place}: expected the node's number, found {first[:40]!r}")
        if len(values) > 6:
            raise InputError(f"{place}: a node has at most 6 numbers, found {len(values)}")
        three = (*values[:3], 0.0, 0.0, 0.0)
        x = (three[0], three[1], three[2])
        if scope.nodes.setdefault(number, x) != x:
            raise InputError(f"{place}: node {number} is stated twice, at different places")
        numbers.append(str(number))
    _add_to_set("NSET", card, numbers, scope)


def _take_elements(card: Card, scope: _Scope, model: _Model) -> None:
    stated = card.options.get("TYPE", "").upper()
    kind = KINDS.get(stated, "")
    if "INPUT" in card.options:
        raise InputError(f"{card.place}: *ELEMENT with INPUT= is not read; state them in this file")
    if not kind:
        model.notes.append(
            f"{len(card.lines)} elements of type {stated or 'that is not said'}, which are no "
            "shells, lines or points that are known"
        )
        return
    numbers: list[str] = []
    waiting: list[str] = []
    needed = 1 + CORNERS[kind]
    most = needed + stated.startswith(TURNED)
    lines = [(place, line) for place, line in card.lines if line]
    for i, (place, line) in enumerate(lines, 1):
        waiting += _fields(line)
        if len(waiting) < needed and line.endswith(",") and i < len(lines):
            continue
        if not needed <= len(waiting) <= most:
            raise InputError(
                f"{place}: an element of type {stated} has {CORNERS[kind]} nodes, found "
                f"{len(waiting) - 1}"
            )
        nodes = tuple(waiting[1:needed])
        if read_whole_number(waiting[0]) is None:
            raise InputError(f"{place}: expected the element's number, found {waiting[0][:40]!r}")
        if scope.elements.setdefault(int(waiting[0]), (kind, nodes, place))[:2] != (kind, nodes):
            raise InputError(f"{place}: element {waiting[0]} is stated twice, with other nodes")
        numbers.append(waiting[0])
        waiting = []
    _add_to_set("ELSET", card, numbers, scope)


def _add_to_set(kind: str, card: Card, numbers: Sequence[str], scope: _Scope) -> None:
    """The nodes or elements of a card into the set that it names."""
    if name := card.options.get(kind):
        entry = _Entry(tuple(numbers), None, "", card.place)
        scope.sets.setdefault((kind, name), []).append(entry)


def _take_set(card: Card, scope: _Scope, model: _Model) -> None:
    name, instance = card.options.get(card.word, ""), card.options.get("INSTANCE", "")
    if not name:
        raise InputError(f"{card.place}: *{card.word} without a name, {card.word}=NAME")
    entries = scope.sets.setdefault((card.word, name), [])
    for place, line in card.lines:
        if not line:
            continue
        steps = None
        if "GENERATE" in card.options:
            numbers = _whole_numbers(place, line)
            if not 2 <= len(numbers) <= 3:
                raise InputError(f"{place}: GENERATE takes a first, a last and a step")
            steps = (numbers[0], numbers[1], (*numbers, 0)[2] or 1)
        entries.append(_Entry(() if steps else tuple(_fields(line)), steps, instance, place))


def _take_section(card: Card, scope: _Scope, model: _Model) -> None:
    name = card.options.get("ELSET", "")
    unread = {"OFFSET", "COMPOSITE", "NODAL THICKNESS", "SHELL THICKNESS"} & set(card.options)
    if unread or not card.lines:
        model.notes.append(f"the thickness of *{card.word} of {name}: {', '.join(unread)}")
        return
    place, line = card.lines[0]
    thickness = _numbers(place, line.split(",")[0])[0]
    if thickness <= 0:
        raise InputError(f"{place}: *{card.word} states a thickness of {thickness:g}")
    scope.sections.append(Section(name, thickness))


TAKES: dict[str, Callable[[Card, _Scope, _Model], None]] = {
    "NODE": _take_nodes,
    "ELEMENT": _take_elements,
    "NSET": _take_set,
    "ELSET": _take_set,
    **dict.fromkeys(SECTIONS, _take_section),
}


class _Flat:
    """All instances beside each other: their nodes and elements numbered from 0 on."""

    def __init__(self, path: Path, model: _Model) -> None:
        self.path, self.model = path, model
        self.points: list[Array] = []
        self.node: dict[tuple[str, int], int] = {}
        """By instance and number."""
        self.element: dict[tuple[str, int], int] = {}
        self.cells: list[tuple[str, list[int]]] = []
        self.scopes: dict[str, tuple[_Scope, ...]] = {}
        """By instance its own scope and its part's; "" for what stands in none."""
        self.members: dict[tuple[str, str, str], Ints] = {}
        """Each set that was asked for, by kind, instance and name."""

    def mesh(self) -> Mesh:
        """The mesh of all instances; of parts that none places each as it is."""
        for key, instance in self._instances().items():
            part = self.model.parts.get(_key(instance.part))
            if part is None:
                raise InputError(
                    f"{self.path}: *INSTANCE names the part {instance.part}, not there"
                )
            self._place(key, (instance.scope, part), instance)
        placed = {_key(instance.part) for instance in self._instances().values()}
        self.model.notes += [
            f"the part {part.name}, which no instance places"
            for key, part in self.model.parts.items()
            if key not in placed
        ]
        self._place("", (self.model.top,), None)
        for key, scopes in self.scopes.items():
            for scope in scopes:
                self._connect(key, scope)
        return self._whole()

    def _instances(self) -> Mapping[str, _Instance]:
        if self.model.instances or not self.model.parts:
            return self.model.instances
        at_home = (np.zeros(3), np.eye(3), np.zeros(3))
        return {
            key: _Instance(_Scope(part.name), part.name, *at_home)
            for key, part in self.model.parts.items()
        }

    def _place(self, key: str, scopes: tuple[_Scope, ...], placed: _Instance | None) -> None:
        self.scopes[key] = scopes
        for scope in scopes:
            points = np.array(list(scope.nodes.values()), dtype=float).reshape(-1, 3)
            if placed is not None:
                points = (points + placed.shift - placed.about) @ placed.turn.T + placed.about
            first = sum(map(len, self.points))
            self.node |= {(key, n): first + i for i, n in enumerate(scope.nodes)}
            self.points.append(points)

    def _connect(self, key: str, scope: _Scope) -> None:
        for number, (kind, nodes, place) in scope.elements.items():
            self.element[key, number] = len(self.cells)
            self.cells.append((kind, [self._node(key, name, place) for name in nodes]))

    def _node(self, key: str, name: str, place: str) -> int:
        instance, dot, number = name.rpartition(".")
        where = (_key(instance) if dot else key, _index(number))
        if where not in self.node:
            raise InputError(f"{place}: names node {name}, which is not there")
        return self.node[where]

    def _whole(self) -> Mesh:
        import meshio

        sets = {kind: self._sets(kind) for kind in ("NSET", "ELSET")}
        thickness = self._thickness()
        kept = self._kept(sets["ELSET"])
        kinds = [self.cells[i][0] for i in kept]
        starts = [i for i, kind in enumerate(kinds) if not i or kind != kinds[i - 1]]
        pieces = np.split(kept, starts[1:]) if starts else []
        blocks = [
            (kinds[i], np.array([self.cells[j][1] for j in piece], dtype=np.int64))
            for i, piece in zip(starts, pieces, strict=True)
        ]
        mesh = meshio.Mesh(
            np.concatenate([*self.points, np.zeros((0, 3))]),
            blocks,
            point_sets=sets["NSET"],
            cell_sets={
                name: [np.flatnonzero(np.isin(piece, chosen)) for piece in pieces]
                for name, chosen in sets["ELSET"].items()
            },
            cell_data={"thickness": [thickness[p] for p in pieces]} if thickness.any() else {},
        )
        counts = sorted(self.model.other.items())
        mesh.info = {"dropped": [*self.model.notes, *(f"{n} x *{word}" for word, n in counts)]}
        return mesh

    def _thickness(self) -> Array:
        """By element, 0 where no section says it."""
        out = np.zeros(len(self.cells))
        for key, scopes in self.scopes.items():
            for section in (section for scope in scopes for section in scope.sections):
                out[self._members("ELSET", key, section.name, ())] = section.thickness
        return out

    def _kept(self, sets: Mapping[str, Ints]) -> Ints:
        """The elements without those of instances whose shells are in no set, where others' are: a
        bone beside a hood.  They are told."""
        in_sets = np.zeros(len(self.cells), dtype=bool)
        in_sets[np.concatenate([np.zeros(0, dtype=np.int64), *sets.values()])] = True
        shell = np.array([kind in SHELLS for kind, _ in self.cells], dtype=bool)
        kept = np.ones(len(self.cells), dtype=bool)
        for key in self.scopes:
            chosen = [i for (instance, _), i in self.element.items() if instance == key]
            mine = np.array([i for i in chosen if shell[i]], dtype=np.int64)
            if len(mine) and not in_sets[mine].any() and (in_sets & shell).any():
                kept[mine] = False
                name = next((scope.name for scope in self.scopes[key] if scope.name), "the file")
                self.model.notes.append(f"{len(mine)} shells of {name}, which are in no set")
        return np.flatnonzero(kept)

    def _sets(self, kind: str) -> dict[str, Ints]:
        """All sets of a kind by their name, with the instance's before it where several have it."""
        found: dict[str, dict[str, Ints]] = {}
        spelt: dict[str, str] = {}
        for key, scopes in self.scopes.items():
            for name in (n for scope in scopes for k, n in scope.sets if k == kind):
                spelt.setdefault(_key(name), name)
                found.setdefault(_key(name), {})[key] = self._members(kind, key, name, ())
        return {
            spelt[name]
            if len(by) == 1 or not key
            else f"{self.scopes[key][0].name}.{spelt[name]}": m
            for name, by in found.items()
            for key, m in by.items()
        }

    def _members(self, kind: str, key: str, name: str, within: tuple[str, ...]) -> Ints:
        """The nodes or elements of a set of an instance.  Raises InputError for a set that is not
        there, or holds itself."""
        if (known := self.members.get((kind, key, _key(name)))) is not None:
            return known
        entries = self._entries.get((kind, key, _key(name)), [])
        if len(within) > MOST_SETS:
            raise InputError(f"{self.path}: more than {MOST_SETS} sets lie one within the other")
        if not entries or _key(name) in within:
            raise InputError(f"{self.path}: *{kind} names the set {name}, which is not there")
        parts = [self._of_entry(kind, key, entry, (*within, _key(name))) for entry in entries]
        members = self.members[kind, key, _key(name)] = np.unique(np.concatenate(parts))
        return members

    @cached_property
    def _entries(self) -> Mapping[tuple[str, str, str], list[_Entry]]:
        """The lines of each set, by kind, instance and name."""
        found: dict[tuple[str, str, str], list[_Entry]] = {}
        for key, scopes in self.scopes.items():
            for (kind, name), lines in (pair for scope in scopes for pair in scope.sets.items()):
                found.setdefault((kind, key, _key(name)), []).extend(lines)
        return found

    def _of_entry(self, kind: str, key: str, entry: _Entry, within: tuple[str, ...]) -> Ints:
        known = self.node if kind == "NSET" else self.element
        home = _key(entry.instance) or key
        if entry.steps is not None:
            first, last, step = entry.steps
            if step > 0 and (last - first) // step < len(known):
                numbers = range(first, last + 1, step)
                named = [known[home, n] for n in numbers if (home, n) in known]
                return np.array(named, dtype=np.int64)
            return np.array(
                [
                    i
                    for (instance, n), i in known.items()
                    if instance == home and first <= n <= last and (n - first) % step == 0
                ],
                dtype=np.int64,
            )
        out: list[Ints] = [np.zeros(0, dtype=np.int64)]
        absent = 0
        for name in filter(None, entry.names):
            instance, dot, number = name.rpartition(".")
            where = (_key(instance) if dot else home, _index(number))
            if where in known:
                out.append(np.array([known[where]], dtype=np.int64))
            elif where[1] >= 0:
                absent += 1
            else:
                out.append(self._members(kind, where[0], number if dot else name, within))
        if absent:
            what = "nodes" if kind == "NSET" else "elements of a kind that is read"
            self.model.notes.append(f"{absent} numbers of a set ({entry.place}) that are no {what}")
        return np.concatenate(out)
