"""The arrays of a run by name, written as netCDF; xarray is imported where someone asks for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    import xarray


class ArrayInfo(NamedTuple):
    """What an array of a run is, at each state or time."""

    dims: tuple[str, ...]
    unit: str
    meaning: str


ARRAYS: Mapping[str, ArrayInfo] = {
    "angle": ArrayInfo(("joint",), "rad", "joint angle"),
    "rate": ArrayInfo(("joint",), "rad/s", "joint rate"),
    "position": ArrayInfo(("body", "axis"), "m", "origin of the body"),
    "rotation": ArrayInfo(("body", "axis", "body_axis"), "1", "body to world"),
    "tension": ArrayInfo(("tendon",), "N", "tension"),
    "own_tension": ArrayInfo(("muscle",), "N", "tension of the finger's tendons"),
    "excursion": ArrayInfo(("tendon",), "m", "excursion, positive proximally"),
    "hood_force": ArrayInfo(("body", "source", "axis"), "N", "force of the hood on the body"),
    "hood_moment": ArrayInfo(
        ("body", "source", "axis"), "N m", "moment of the hood about the body's origin"
    ),
    "total_force": ArrayInfo(("body", "axis"), "N", "force of the hood at the pose"),
    "total_moment": ArrayInfo(("body", "axis"), "N m", "moment of the hood at the pose"),
    "residual": ArrayInfo((), "1", "interface residual"),
    "pull_force": ArrayInfo(("tendon", "axis"), "N", "tendon on the hood"),
    "pull_moment": ArrayInfo(
        ("tendon", "axis"), "N m", "moment of the tendon's pull about the world's origin"
    ),
    "tip_force": ArrayInfo(("axis",), "N", "force of the tip on the world"),
    "tip_moment": ArrayInfo(("axis",), "N m", "moment of the tip on the world about the fingertip"),
    "moment_arm": ArrayInfo(("joint", "tendon"), "m", "d torque / d tension"),
    "torque": ArrayInfo(("torque_source", "joint"), "N m", "joint torque by source"),
    "step": ArrayInfo((), "s", "time step that ended here"),
    "finger_energy": ArrayInfo((), "J", "energy of the finger"),
    "hood_point_position": ArrayInfo(
        ("hood_point", "axis"), "m", "path of the named point of the hood, at the scheme's pose"
    ),
    "tendon_line": ArrayInfo(
        ("line_tendon", "line_point", "axis"),
        "m",
        "tendon of the hood beyond its mesh, at the stored times `frame`",
    ),
    "insertion_tension": ArrayInfo(
        ("muscle",), "N", "tension that friction at guides leaves at the insertion"
    ),
    "event_time": ArrayInfo((), "s", "when a part of the hood gave way or began to act"),
    "guide_loss": ArrayInfo((), "J", "energy lost to friction at tendons' guides since the start"),
    "path_length": ArrayInfo(("muscle",), "m", "length of the finger's tendons"),
    "motor_position": ArrayInfo(("motor",), "m", "how far a motor has drawn its tendon's end"),
    "motor_torque": ArrayInfo(("motor",), "N m", "torque of the motor"),
    "command": ArrayInfo(("cylinder",), "V", "valve voltage commanded"),
    "pressure": ArrayInfo(("cylinder",), "Pa", "pressure above the atmosphere"),
}
"""Every array of a run but those of its hood's view."""


def along(axis: str, values: Mapping[str, Any]) -> dict[str, tuple[Any, ...]]:
    """Arrays of ARRAYS as `Arrays.of` takes them, one value for each place on the load axis."""
    out = {}
    for name, each in values.items():
        dims, unit, meaning = ARRAYS[name]
        out[name] = ((axis, *dims), np.asarray(each), {"units": unit, "long_name": meaning})
    return out


class Variable(NamedTuple):
    """An array with the names of its dimensions and its attributes (unit, long name)."""

    dims: tuple[str, ...]
    values: np.ndarray
    attributes: Mapping[str, str]


def _stated(attributes: Mapping[str, Any]) -> dict[str, Any]:
    return {k: v for k, v in attributes.items() if k not in ("_FillValue", "coordinates")}


@dataclass(frozen=True)
class Arrays:
    """What `xarray.Dataset` takes: variables and coordinates by name, and attributes."""

    variables: Mapping[str, Variable]
    coordinates: Mapping[str, Variable]
    attributes: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(
        cls, variables: Mapping[str, Any], coordinates: Mapping[str, Any], **attributes: str
    ) -> Arrays:
        """Make arrays of tuples (dims, values, attributes), where the last may lack; a coordinate
        may be the values along the dimension of its name."""

        def whole(name: str, given: Any) -> Variable:
            if type(given) is not tuple:
                given = (name, given)
            dims, values, *rest = given
            dims = (dims,) if type(dims) is str else tuple(dims)
            return Variable(dims, np.asarray(values), rest[0] if rest else {})

        return cls(
            {name: whole(name, given) for name, given in variables.items()},
            {name: whole(name, given) for name, given in coordinates.items()},
            attributes,
        )

    @classmethod
    def read(cls, path: Path) -> Arrays:
        """The arrays that `write` wrote, without the imports of xarray.  Raises what HDF5 raises of
        a spoilt file."""
        import h5netcdf

        def plain(values: np.ndarray) -> np.ndarray:
            return values.astype(str) if values.dtype.kind == "O" else values

        with h5netcdf.File(path, "r") as file:
            places = [file.attrs, *(v.attrs for v in file.variables.values())]
            beside = {name for at in places for name in str(at.get("coordinates", "")).split()}
            beside |= {name for name, v in file.variables.items() if name in v.dimensions}
            every = {
                name: Variable(v.dimensions, plain(np.asarray(v[...])), _stated(v.attrs))
                for name, v in file.variables.items()
            }
            whole = _stated(file.attrs)
        return cls(
            {name: v for name, v in every.items() if name not in beside},
            {name: v for name, v in every.items() if name in beside},
            whole,
        )

    @property
    def dims(self) -> set[str]:
        """The names of all dimensions."""
        every = (*self.variables.values(), *self.coordinates.values())
        return {dim for variable in every for dim in variable.dims}

    def to_dataset(self) -> xarray.Dataset:
        """The same as an xarray.Dataset."""
        import xarray

        return xarray.Dataset(dict(self.variables), dict(self.coordinates), self.attributes)

    def write(self, path: Path) -> None:
        """Write `content()`.  Raises OSError."""
        path.write_bytes(self.content())

    def content(self) -> bytes:
        """The netCDF-4 file that `to_dataset().to_netcdf(path)` would, without the imports of
        xarray: pandas and, where it is installed, the whole of dask.

        It is made in memory: HDF5 crashes on a full disk."""
        import h5netcdf
        import h5py

        beside = {k: set(v.dims) for k, v in self.coordinates.items() if k not in v.dims}
        named: set[str] = set()
        content = BytesIO()
        with h5netcdf.File(content, "w") as file:
            for variable in (*self.variables.values(), *self.coordinates.values()):
                for dim, size in zip(variable.dims, variable.values.shape, strict=True):
                    if dim not in file.dimensions:
                        file.dimensions[dim] = size
            for name, (dims, values, attributes) in {**self.variables, **self.coordinates}.items():
                if values.dtype.kind == "U":
                    written = file.create_variable(name, dims, h5py.string_dtype())
                    values = values.astype(object)
                else:
                    fill = np.nan if values.dtype.kind == "f" else None
                    written = file.create_variable(name, dims, values.dtype, fillvalue=fill)
                written[...] = values
                of_this = sorted(k for k, along in beside.items() if along <= set(dims))
                if name in self.variables and of_this:
                    attributes = {**attributes, "coordinates": " ".join(of_this)}
                    named.update(of_this)
                written.attrs.update(attributes)
            rest = " ".join(sorted(beside.keys() - named))
            file.attrs.update({**self.attributes, **({"coordinates": rest} if rest else {})})
        return content.getvalue()
