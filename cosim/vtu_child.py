"""Reading a file of VTK's (.vtu, .vtp, legacy .vtk) with VTK, for a process of its own
(`processes`), since some broken files crash VTK."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkDataArray, vtkOutputWindow, vtkStringOutputWindow
from vtkmodules.vtkFiltersCore import vtkAppendFilter
from vtkmodules.vtkIOLegacy import vtkGenericDataObjectReader
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLUnstructuredGridReader

XML = {
    ".vtu": (vtkXMLUnstructuredGridReader, "UnstructuredGrid"),
    ".vtp": (vtkXMLPolyDataReader, "PolyData"),
}
MESHES = ("vtkUnstructuredGrid", "vtkPolyData")


def read_arrays(source: str) -> dict[str, Any]:
    """The mesh of a file: points (n, 3), of the cells VTK's types (ne,), the ends (ne,) of their
    nodes in `nodes`, and the arrays of points and cells by `point/NAME` and `cell/NAME`.

    Raises SystemExit with VTK's reason where it cannot be read."""
    messages = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(messages)
    reader = _reader(source)
    reader.SetFileName(source)
    reader.Update()
    if reader.GetErrorCode() or messages.GetOutput():
        sys.exit(_reason(messages.GetOutput()))
    grid = _grid(reader.GetOutput())
    arrays: dict[str, Any] = {"points": np.zeros((0, 3)), "nodes": [], "types": [], "ends": []}
    if grid.GetNumberOfPoints():
        arrays["points"] = vtk_to_numpy(grid.GetPoints().GetData())
    if grid.GetNumberOfCells():
        cells = grid.GetCells()
        arrays["nodes"] = vtk_to_numpy(cells.GetConnectivityArray())
        arrays["ends"] = vtk_to_numpy(cells.GetOffsetsArray())[1:]
        arrays["types"] = vtk_to_numpy(grid.GetCellTypesArray())
    arrays |= {f"point/{name}": values for name, values in _data(grid.GetPointData())}
    arrays |= {f"cell/{name}": values for name, values in _data(grid.GetCellData())}
    return {name: np.array(values) for name, values in arrays.items()}


def _reader(source: str) -> Any:
    ending = source[source.rfind(".") :].lower()
    if ending not in XML:
        legacy = vtkGenericDataObjectReader()
        legacy.ReadAllScalarsOn()
        legacy.ReadAllVectorsOn()
        legacy.ReadAllFieldsOn()
        return legacy
    make, kind = XML[ending]
    reader = make()
    if not reader.CanReadFile(source):
        sys.exit(f"it is no XML file of VTK's type {kind}")
    return reader


def _grid(data: Any) -> Any:
    """The data as an unstructured grid."""
    if data is None or data.GetClassName() not in MESHES:
        sys.exit(f"it holds {'nothing' if data is None else data.GetClassName()}, which is no mesh")
    if data.GetClassName() == MESHES[0]:
        return data
    grid = vtkAppendFilter()
    grid.SetInputData(data)
    grid.Update()
    return grid.GetOutput()


def _reason(text: str) -> str:
    """The first complaint of VTK without the place in its own source."""
    lines = [line.rpartition("): ")[2].strip() for line in text.splitlines()]
    return next((line for line in lines if line and not line.startswith("ERROR")), "it is broken")


def _data(attributes: Any) -> Iterator[tuple[str, Any]]:
    for i in range(attributes.GetNumberOfArrays()):
        array = attributes.GetAbstractArray(i)
        if not isinstance(array, vtkDataArray):
            sys.exit(f"its array {array.GetName()!r} holds no numbers; leave it out")
        yield array.GetName() or f"array {i}", vtk_to_numpy(array)
