"""Values that a FEBio 4 file gives to its elements: `ElementData`, maps, formulas of the place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cosim.port import Array, Ints
from fe_solver.elements.kinds import kind_of
from fe_solver.febio.mesh import FebMesh, rows_of
from fe_solver.febio.xml import FebTag
from fe_solver.materials.linear import Real

PLACE = ("X", "Y", "Z")


@dataclass(frozen=True)
class ElementData:
    """An `ElementData` tag: values of the elements of a set, a part or a list of parts."""

    tag: FebTag
    elements: Ints
    """(k,) numbers in the set's order, which the rows' `lid` counts from 1."""

    def at(self, ids: Ints, widths: tuple[int, ...]) -> tuple[Array, NDArray[np.bool_]]:
        """The values (n, w) of elements with numbers (n,), w one of the widths, and which (n,) of
        them have one.  Raises InputError for a row that is none of the set's."""
        self.tag.used = True
        if self.tag.rows is None:
            values = np.array(self.tag.numbers())
            self._check_width(len(values), widths)
            return np.tile(values, (len(ids), 1)), np.isin(ids, self.elements)
        number, line, values = rows_of(self.tag)
        self._check_width(values.shape[1], widths)
        row, has = self._rows(number, line, ids)
        return values[row], has

    def _check_width(self, width: int, widths: tuple[int, ...]) -> None:
        if width not in widths:
            many = " or ".join(map(str, widths))
            raise self.tag.fault(f"expected {many} numbers for each element, got {width}")

    def _rows(self, number: Ints, line: Ints | None, ids: Ints) -> tuple[Ints, NDArray[np.bool_]]:
        """The row (n,) of each element and whether (n,) it has one, by the rows' numbers (k,)."""
        k = len(self.elements)
        wrong = np.flatnonzero((number < 1) | (number > k))
        if len(wrong):
            where = None if line is None else int(line[wrong[0]])
            raise self.tag.fault(f"the set has elements 1 to {k}, not {number[wrong[0]]}", where)
        given = self.elements[number - 1]
        order = np.argsort(given, kind="stable")
        at = np.searchsorted(given[order], ids, side="right") - 1
        row = order[np.maximum(at, 0)] if len(order) else np.zeros(len(ids), dtype=np.intp)
        return row, (at >= 0) & (given[row] == ids) if len(order) else np.zeros(
            len(ids), dtype=bool
        )

    def all_at(self, ids: Ints, widths: tuple[int, ...]) -> Array:
        """The values (n, w) of elements with numbers (n,).  Raises InputError where one has
        none."""
        values, has = self.at(ids, widths)
        self._check_all(ids, has)
        return values

    def tags_at(self, ids: Ints) -> list[FebTag]:
        """The tag of each element, where rows hold tags and not numbers.  Raises InputError where
        one has none."""
        self.tag.used = True
        tags = [c for c in self.tag.children if c.name in ("e", "elem")]
        number = np.array([int(c.attributes.get("lid", i)) for i, c in enumerate(tags, 1)])
        row, has = self._rows(number.astype(np.intp), None, ids)
        self._check_all(ids, has)
        for c in tags:
            c.used = True
        return [tags[i] for i in row]

    def _check_all(self, ids: Ints, has: NDArray[np.bool_]) -> None:
        if not has.all():
            raise self.tag.fault(f"the element {ids[~has][0]} has no value here")


class Values(Protocol):
    """Reads parameters of a material."""

    def value(self, tag: FebTag | None, default: float) -> Real:
        """The number in a tag, or (k, 1) or (k, g) of elements or their Gauss points; `default`
        where there is none."""
        ...


@dataclass(frozen=True)
class Place:
    """The elements that a part's material is in."""

    ids: Ints
    """(k,) numbers in the file."""
    points: Array
    """(k, g, 3) of their Gauss points, in the file's units."""
    maps: dict[str, ElementData]
    """By name."""

    @classmethod
    def of(cls, mesh: FebMesh, ids: Ints, nodes: Ints, maps: dict[str, ElementData]) -> Place:
        """That of elements with numbers (k,) and mesh nodes (k, m), in the solver's order."""
        element, X = kind_of(nodes), mesh.points[nodes]
        shape = np.stack([element.shape(r, s)[0] for r, s in element.gauss])
        return cls(ids, np.einsum("ga,kai->kgi", shape, X), maps)

    def value(self, tag: FebTag | None, default: float) -> Real:
        """See `Values`; a formula may name X, Y, Z and maps.  What does not vary is one number."""
        if tag is None:
            return default
        if tag.attributes.get("type") == "map":
            return _level(self._map(tag, tag.text.strip()))
        if tag.attributes.get("lc", "0").strip() not in ("", "0"):
            raise tag.fault("a material that changes with time (lc=) is not read")
        (formula,) = tag.formulas(1, (*PLACE, *(m for m in self.maps if m.isidentifier())))
        values = {name: self.points[..., i] for i, name in enumerate(PLACE)}
        values |= {n: self._map(tag, n) for n in formula.used if n not in PLACE}
        with tag.naming_place():
            return _level(np.asarray(formula.value(values)))

    def _map(self, tag: FebTag, name: str) -> Array:
        """The values (k, 1) of a map.  Raises InputError where there is none of that name."""
        if name not in self.maps:
            known = ", ".join(map(repr, self.maps)) or "none"
            raise tag.fault(f"there is no ElementData called {name!r}; the file has {known}")
        return self.maps[name].all_at(self.ids, (1,))


def _level(values: Array) -> Real:
    """One number where all are equal."""
    first = float(values.flat[0])
    return first if (values == first).all() else values
