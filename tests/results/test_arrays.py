"""The arrays of a run: as xarray takes, writes and reads them."""

from __future__ import annotations

from pathlib import Path

import h5netcdf
import numpy as np
import xarray

from cosim.results.arrays import Arrays

VARIABLES = {
    "angle": (("time", "joint"), np.arange(6.0).reshape(3, 2), {"units": "rad"}),
    "strain": (("time", "quad"), np.zeros((3, 2)), {"units": "1", "long_name": "strain"}),
    "step": (("time",), [0, 1, 1]),
}
COORDINATES = {
    "time": ("time", [0.0, 0.1, 0.2], {"units": "s"}),
    "joint": ["MCP", "PIP"],
    "region": ("quad", ["hood", "slip"]),
    "quad_node": (("quad", "corner"), np.arange(8).reshape(2, 4)),
    "muscle": [],
}


def test_the_file_is_the_one_that_xarray_writes(tmp_path: Path):
    arrays = Arrays.of(VARIABLES, COORDINATES, title="a", frame="world")
    ours, theirs = tmp_path / "ours.nc", tmp_path / "theirs.nc"
    arrays.write(ours)
    arrays.to_dataset().to_netcdf(theirs, engine="h5netcdf")
    with h5netcdf.File(ours) as a, h5netcdf.File(theirs) as b:
        assert dict(a.attrs) == dict(b.attrs)
        assert list(a.variables) == list(b.variables)
        for name in b.variables:
            assert a[name].dtype == b[name].dtype, name
            assert a[name].dimensions == b[name].dimensions, name
            np.testing.assert_array_equal(a[name][...], b[name][...], err_msg=name)
            assert {k: str(v) for k, v in a[name].attrs.items()} == {
                k: str(v) for k, v in b[name].attrs.items()
            }, name


def test_what_was_written_is_read_back(tmp_path: Path):
    arrays = Arrays.of(VARIABLES, COORDINATES, title="a", frame="world")
    arrays.write(file := tmp_path / "results.nc")
    read = Arrays.read(file)
    assert read.attributes == arrays.attributes
    assert read.coordinates.keys() == COORDINATES.keys()
    xarray.testing.assert_identical(read.to_dataset(), xarray.load_dataset(file, engine="h5netcdf"))


def test_arrays_are_those_of_the_data_set():
    arrays = Arrays.of(VARIABLES, COORDINATES, title="a")
    data = xarray.Dataset(VARIABLES, COORDINATES, {"title": "a"})
    xarray.testing.assert_identical(arrays.to_dataset(), data)
    assert arrays.dims == set(map(str, data.dims))
