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


OF_FORMAT = {
    *("CLASS", "NAME", "REFERENCE_LIST", "DIMENSION_LIST", "_Netcdf4Dimid", "_Netcdf4Coordinates"),
    *("_FillValue", "_NCProperties", "coordinates"),
}
"""Attributes of a netCDF file that are of the format or say what `Arrays` has elsewhere."""
BARE_AXIS = "This is a netCDF dimension but not a netCDF variable"
CLASHING = "_nc4_non_coord_"
"""In a file, before the name of an array that an axis has which the array does not lie along."""


def _names(attributes: Mapping[str, Any]) -> list[str]:
    return str(attributes.get("coordinates", "")).split()


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
    def from_dataset(cls, data: xarray.Dataset) -> Arrays:
        """The same arrays."""

        def bare(given: Mapping[Any, xarray.DataArray]) -> dict[str, Variable]:
            return {
                str(k): Variable(tuple(map(str, v.dims)), v.values, v.attrs)
                for k, v in given.items()
            }

        return cls(bare(data.data_vars), bare(data.coords), data.attrs)

    @classmethod
    def read(cls, path: Path) -> Arrays:
        """The arrays that `write` wrote to a file, without xarray, which takes far longer.  Raises
        ValueError where an axis has two lengths, and what HDF5 raises of a spoilt file."""
        import h5py

        found: dict[str, Variable] = {}
        sizes: dict[str, int] = {}
        with h5py.File(path, "r") as file:
            beside = {*_names(file.attrs)}
            for key, stored in file.items():
                if BARE_AXIS in str(stored.attrs.get("NAME")):
                    continue
                name = key.removeprefix(CLASHING)
                dims = (name,) * stored.ndim
                if (axes := stored.attrs.get("DIMENSION_LIST")) is not None:
                    dims = tuple(h5py.h5r.get_name(a[0], file.id).decode()[1:] for a in axes)
                for dim, size in zip(dims, stored.shape, strict=True):
                    if sizes.setdefault(dim, size) != size:
                        raise ValueError(f"its axis {dim} has two lengths")
                values = np.asarray(stored[()])
                if h5py.check_string_dtype(stored.dtype) is not None:
                    values = np.asarray(stored.asstr()[()], dtype=str)
                stated = {k: v for k, v in stored.attrs.items() if k not in OF_FORMAT}
                beside |= {*_names(stored.attrs), *({name} & {*dims})}
                found[name] = Variable(dims, values, stated)
            whole = {k: v for k, v in file.attrs.items() if k not in OF_FORMAT}
        return cls(
            {k: v for k, v in found.items() if k not in beside},
            {k: v for k, v in found.items() if k in beside},
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
        xarray, pandas and dask, and without h5netcdf, which looks each axis up again and again.

        It is made in memory: HDF5 crashes on a full disk."""
        import h5py

        every = {**self.variables, **self.coordinates}
        sizes = {d: n for v in every.values() for d, n in zip(v.dims, v.values.shape, strict=True)}
        number = {dim: np.int32(k) for k, dim in enumerate(sizes)}
        beside = {k: set(v.dims) for k, v in self.coordinates.items() if k not in v.dims}
        named: set[str] = set()
        attached: list[tuple[h5py.Dataset, tuple[str, ...]]] = []
        content = BytesIO()
        with h5py.File(content, "w", track_order=True) as file:
            for dim, size in sizes.items():
                if dim not in every or every[dim].dims != (dim,):
                    scale = file.create_dataset(
                        dim, (size,), ">f4", maxshape=(size or None,), track_order=True
                    )
                    scale.make_scale(f"{BARE_AXIS}.{size:10d}")
                    scale.attrs["_Netcdf4Dimid"] = number[dim]
            for name, (dims, values, attributes) in every.items():
                is_scale = dims == (name,)
                key = f"{CLASHING}{name}" if name in sizes and not is_scale else name
                fill = np.nan if values.dtype.kind == "f" else None
                is_text = values.dtype.kind == "U"
                stored = file.create_dataset(
                    key,
                    values.shape,
                    h5py.string_dtype() if is_text else values.dtype,
                    values.astype(object) if is_text else values,
                    fillvalue=fill,
                    track_order=True,
                    maxshape=tuple(n or None for n in values.shape) if 0 in values.shape else None,
                )
                if is_scale:
                    stored.make_scale(name)
                elif dims:
                    attached.append((stored, dims))
                if dims:
                    stored.attrs["_Netcdf4Coordinates"] = np.array([number[d] for d in dims])
                    stored.attrs["_Netcdf4Dimid"] = number[dims[0]]
                if fill is not None:
                    stored.attrs["_FillValue"] = np.array([fill], values.dtype)
                of_this = sorted(k for k, along in beside.items() if along <= set(dims))
                if name in self.variables and of_this:
                    attributes = {**attributes, "coordinates": " ".join(of_this)}
                    named.update(of_this)
                stored.attrs.update(attributes)
            for stored, dims in attached:
                for k, dim in enumerate(dims):
                    stored.dims[k].attach_scale(file[dim])
            rest = " ".join(sorted(beside.keys() - named))
            file.attrs.update({**self.attributes, **({"coordinates": rest} if rest else {})})
            made = f"version=2,h5py={h5py.__version__},hdf5={h5py.version.hdf5_version}"
            file.attrs["_NCProperties"] = np.bytes_(made)
        return content.getvalue()
