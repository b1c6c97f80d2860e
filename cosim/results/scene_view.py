"""A run in space, in a window of pyvista."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.hoods.view import STRAIN
from cosim.results.parts import Scene

if TYPE_CHECKING:
    from pyvista import Plotter, PolyData

BONE, TENDON, PLAIN, FORCE = "#ede3cc", "#29574c", "#8caecb", "#b3202a"
METRES_PER_NEWTON = 0.015
"""Length of the arrow of the fingertip's force."""


def plotter_of(scene: Scene, title: str) -> Plotter:
    """A plotter with all there is to see, seen from the radial side with distal to the left."""
    import pyvista

    plotter: Any = pyvista.Plotter(title=title, off_screen=pyvista.OFF_SCREEN)
    for _, vertices, triangles in scene.bones:
        plotter.add_mesh(_surface(vertices, triangles), color=BONE, smooth_shading=True)
    for _, points in scene.tendons:
        plotter.add_mesh(pyvista.MultipleLines(points), color=TENDON, line_width=3)
    if scene.hood is not None:
        _add_hood(plotter, scene)
    if scene.tip is not None and np.linalg.norm(scene.tip[1]) > 0:
        point, force = scene.tip
        size = METRES_PER_NEWTON * float(np.linalg.norm(force))
        plotter.add_mesh(pyvista.Arrow(start=point, direction=force, scale=size), color=FORCE)
    plotter.add_axes(xlabel="distal", ylabel="radial", zlabel="dorsal")
    plotter.view_vector((0.0, 1.0, 0.0), viewup=(0.0, 0.0, 1.0))
    return plotter


def _surface(points: Any, cells: Any) -> PolyData:
    import pyvista

    sized = np.column_stack([np.full(len(cells), cells.shape[1]), cells])
    return pyvista.PolyData(points, faces=sized.ravel())


def _add_hood(plotter: Any, scene: Scene) -> None:
    import pyvista

    hood = scene.hood
    assert hood is not None
    if hood.quads.shape[1] == 2:
        lines = np.column_stack([np.full(len(hood.quads), 2), hood.quads])
        mesh = pyvista.PolyData(hood.points, lines=lines.ravel())
    else:
        mesh = _surface(hood.points, hood.quads)
    if STRAIN not in hood.cell_data:
        plotter.add_mesh(mesh, color=PLAIN, show_edges=True)
        return
    percent = 100 * np.asarray(hood.cell_data[STRAIN])
    most = max(float(np.percentile(np.abs(percent), 98)), 1e-3)
    bar: Any = {"title": "longitudinal strain, %"}
    look: Any = {"cmap": "RdBu_r", "clim": (-most, most), "scalar_bar_args": bar}
    if hood.quads.shape[1] == 2:
        plotter.add_mesh(mesh, scalars=percent, line_width=4, **look)
    else:
        plotter.add_mesh(mesh, scalars=percent, show_edges=True, **look)
