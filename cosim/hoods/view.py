"""What a solved hood shows: its shape and the fields over it, which results, mesh files, pictures
and reports loop over."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from cosim.port import Array, Hand, State, mirror

STRAIN = "longitudinal_strain"
"""The cell data of every hood with a shape: strain along fibres or cables, dimensionless."""
FAMILIES = ("fibre_1", "fibre_2", "fibre_3")
"""The cell data that hold the unit direction of a fibre family; zero where there is none."""


@dataclass(frozen=True)
class Field:
    """Values over a hood: in the results, on its mesh file, or in both."""

    name: str
    dimensions: tuple[str, ...]
    """The first is "point", or a cell, or another thing of which there are many."""
    unit: str
    long_name: str
    values: Array
    in_results: bool = True
    on_mesh: bool = False


@dataclass(frozen=True)
class Colour:
    """What pictures, films and reports colour a hood by: `factor` times a field's component."""

    key: str
    label: str
    unit: str
    in_results: tuple[str, int | None]
    factor: float
    on_mesh: str
    mesh_factor: float
    is_signed: bool = False
    """Whether its scale is symmetric about zero, of the diverging map (`results.looks`)."""
    on_lines: bool = False
    """Whether it is of a net of cables, not of a sheet."""

    @property
    def words(self) -> str:
        """The label with the unit."""
        return f"{self.label}, {self.unit}" if self.unit else self.label

    def values(self, hood: HoodField) -> Array:
        """Return the values (m,) on a hood's cells, or (n,) on its points, in `unit`."""
        data = hood.cell_data if self.on_mesh in hood.cell_data else hood.point_data
        return self.mesh_factor * np.asarray(data[self.on_mesh], dtype=float)


@dataclass(frozen=True)
class TrackedPoints:
    """The points of the user's on a hood, by name."""

    names: tuple[str, ...] = ()
    positions: Callable[[State], Array] = lambda state: np.zeros((0, 3))
    """(k, 3) m, world axes, in a state of the hood."""


NO_POINTS = TrackedPoints()


@dataclass(frozen=True)
class HoodField:
    """The deformed hood with its fields, of which `hoods.kinds.colours_of` says what is shown."""

    points: Array
    """(n, 3) deformed positions, m, world frame."""
    quads: np.ndarray
    """(m, 4) node numbers; of a hood of cables (m, 2)."""
    point_data: Mapping[str, Array]
    """(n,) or (n, 3) each."""
    cell_data: Mapping[str, Array]
    """(m,) or (m, 3) each."""
    lines: Mapping[str, Array] = field(default_factory=dict)
    """(k, 3) m by name, of its tendons beyond the mesh."""

    def of(self, hand: Hand) -> HoodField:
        """Return the hood of a right hand as that of another, and the other way round: with its
        directions, and each cell turning the other way."""
        if hand == "right":
            return self

        def other(data: Mapping[str, Array]) -> dict[str, Array]:
            vectors = {name for name, values in data.items() if np.shape(values)[-1:] == (3,)}
            return {k: mirror(v) if k in vectors else v for k, v in data.items()}

        return HoodField(
            mirror(self.points),
            self.quads[:, ::-1],
            other(self.point_data),
            other(self.cell_data),
            other(self.lines),
        )


class HoodView(Protocol):
    """What there is to see of a hood at a state."""

    @property
    def points(self) -> Array:
        """The points (n, 3) m, deformed."""
        ...

    @property
    def plot_cells(self) -> np.ndarray:
        """The nodes of lines or quads (m, 2 or 4); as many for each cell."""
        ...

    @property
    def iterations(self) -> int:
        """Iterations of the hood's solver that led to this state."""
        ...

    def fields(self) -> tuple[Field, ...]:
        """The values over the hood, for results, mesh file and pictures."""
        ...

    def lines(self) -> Mapping[str, Array]:
        """What pictures draw of it as lines beside its mesh, (k, 3) m by name."""
        ...

    def coordinates(self) -> Mapping[str, Any]:
        """Names along the fields' dimensions, for the results."""
        ...

    def size(self) -> Mapping[str, int]:
        """How many cells it has, for the summary."""
        ...

    def summary(self) -> Mapping[str, Any]:
        """Numbers of this state; every key ends in its unit."""
        ...

    def audit(self) -> Mapping[str, float]:
        """Those numbers of the summary that have a bound."""
        ...

    def change(self, before: Any) -> Mapping[str, Any]:
        """Numbers of this state less an earlier one of the same hood."""
        ...


def hood_field(view: HoodView) -> HoodField:
    """The hood as pictures and mesh files show it."""
    point_data, cell_data = {}, {}
    for shown in view.fields():
        if not shown.on_mesh:
            continue
        if shown.dimensions[0] == "point":
            point_data[shown.name] = shown.values
        else:
            each = len(view.plot_cells) // len(shown.values)
            cell_data[shown.name] = np.repeat(shown.values, each, axis=0)
    return HoodField(view.points, view.plot_cells, point_data, cell_data, view.lines())


def arrays_of(hood: HoodField) -> dict[str, Array]:
    """A hood's shape, fields and lines as arrays by name, without its cells."""
    parts = {"point": hood.point_data, "cell": hood.cell_data, "line": hood.lines}
    return {
        "points": hood.points,
        **{f"{p} {name}": np.asarray(v) for p, data in parts.items() for name, v in data.items()},
    }


def audit_arrays(view: HoodView) -> dict[str, Array]:
    """A hood's audit as arrays by name."""
    return {f"audit {name}": np.array(value) for name, value in view.audit().items()}


def audit_of(arrays: Mapping[str, Array]) -> dict[str, float]:
    """The audit that `audit_arrays` made the arrays of."""
    return {k: float(v) for k, v in _under(arrays, "audit ").items()}


def field_of(arrays: Mapping[str, Array], quads: np.ndarray) -> HoodField:
    """The hood that `arrays_of` made the arrays of, with its cells."""
    data = (_under(arrays, f"{part} ") for part in ("point", "cell", "line"))
    return HoodField(arrays["points"], quads, *data)


def _under(arrays: Mapping[str, Array], start: str) -> dict[str, Array]:
    return {k.removeprefix(start): v for k, v in arrays.items() if k.startswith(start)}
