"""A still picture of a run: bones, hood coloured by strain, tendons and fingertip force.

Drawn by the painter's algorithm in two orthographic views: everything becomes polygons, sorted by
depth in one collection, so that what lies behind is hidden.  Needs no display and no OpenGL.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cosim.hoods.kinds import colours_of
from cosim.port import Array
from cosim.results.looks import INKS, colour_limits, colour_map
from cosim.results.parts import Scene
from cosim.results.strokes import families_of, stroke_cells, strokes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

MOST_TRIANGLES = 2500
BONE = np.array([0.93, 0.89, 0.80])
TENDON = np.array([0.16, 0.36, 0.30])
PLAIN_HOOD = np.array([0.55, 0.68, 0.80])
TENDON_WIDTH, CABLE_WIDTH, STROKE_WIDTH = 0.9, 0.7, 0.16  # mm
ARROW_LENGTH = 15.0  # mm, of the fingertip force
HOOD_LIFT = 1.0  # mm towards the viewer, so that bone triangles larger than quads do not cut in
MARGINS = {"left": 0.05, "right": 0.915, "bottom": 0.09, "top": 0.9, "wspace": 0.14}
BAR = (0.928, 0.19, 0.013, 0.61)
"""Places of the views and of the colour bar, shares of the figure: to let matplotlib find them
(its constrained layout) takes longer than to draw."""
STROKE_LIFT = 1.2  # mm, of the strokes along fibres, over the quads beside them


@dataclass(frozen=True)
class PlotView:
    """An orthographic view: the axes (unit, world frame) to the right, up, and to the viewer."""

    title: str
    right: tuple[float, float, float]
    up: tuple[float, float, float]
    label: tuple[str, str]

    def project(self, points: Array) -> Array:
        """Project points (..., 3) m to (..., 3): right, up and height towards the viewer, mm."""
        axes = np.array([self.right, self.up, np.cross(self.right, self.up)])
        return 1e3 * np.asarray(points) @ axes.T


VIEWS = (
    PlotView("from the radial side", (-1, 0, 0), (0, 0, 1), ("proximal, mm", "dorsal, mm")),
    PlotView("from the dorsal side", (-1, 0, 0), (0, -1, 0), ("proximal, mm", "ulnar, mm")),
)


class Polygons(NamedTuple):
    """Polygons in a view: corners (n, 4, 3) mm, face and edge colours (n, 4)."""

    corners: Array
    face: Array
    edge: Array


def draw(scene: Scene, title: str) -> Figure:
    """The two views side by side; the colour bar is the hood's longitudinal strain, per cent."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 5.6))
    axes = figure.subplots(1, len(VIEWS), gridspec_kw=MARGINS)
    colours = _strain_colours(scene)
    bones = [decimate(vertices, faces) for _, vertices, faces in scene.bones]
    for ax, view in zip(axes, VIEWS, strict=True):
        _draw_view(ax, scene, bones, view, colours)
    if colours is not None and scene.hood is not None:
        bar = figure.colorbar(colours, cax=figure.add_axes(BAR), extend="both")
        bar.set_label(colours_of(scene.hood)[0].words)
    if scene.hood is not None and families_of(scene.hood.cell_data):
        note = "strokes: the hood's fibres"
        if len(families_of(scene.hood.cell_data)) > 1:
            note += "; violet: the second family"
        axes[0].text(0.98, 0.95, note, ha="right", transform=axes[0].transAxes, fontsize=10)
    figure.suptitle(title)
    return figure


def _strain_colours(scene: Scene) -> ScalarMappable | None:
    if scene.hood is None or not (shown := colours_of(scene.hood)):
        return None
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    limits = colour_limits(shown[0].values(scene.hood), shown[0].is_signed)
    return ScalarMappable(Normalize(*limits), ListedColormap(colour_map(shown[0].is_signed)))


def _draw_view(
    ax: Axes,
    scene: Scene,
    bones: Sequence[tuple[Array, np.ndarray]],
    view: PlotView,
    colours: ScalarMappable | None,
) -> None:
    from matplotlib.collections import PolyCollection

    parts = [_bone(view, vertices, faces) for vertices, faces in bones]
    parts += [_ribbon(view, points) for _, points in scene.tendons]
    if scene.hood is not None:
        parts.append(_hood(view, scene, colours))
        parts += _fibres(view, scene)
    if parts:
        corners, face, edge = (np.concatenate(c) for c in zip(*parts, strict=True))
        order = np.argsort(corners[..., 2].mean(axis=1), kind="stable")
        # arrays: of lists matplotlib makes its shapes one by one
        shapes: Any = corners[order][..., :2]
        inks: tuple[Any, Any] = face[order], edge[order]
        polygons = PolyCollection(shapes, linewidths=0.3)
        polygons.set_rasterized(True)  # as vectors they would make files of many megabytes
        polygons.set_facecolor(inks[0])
        polygons.set_edgecolor(inks[1])
        ax.add_collection(polygons)
    if scene.tip is not None:
        _draw_force(ax, view, *scene.tip)
    ax.set_title(view.title, fontsize=11)
    ax.set(xlabel=view.label[0], ylabel=view.label[1])
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.04)
    ax.autoscale_view()
    ax.spines[["top", "right"]].set_visible(False)


def _bone(view: PlotView, vertices: Array, faces: np.ndarray) -> Polygons:
    """The triangles that face the viewer: the others lie behind them."""
    triangles = view.project(vertices)[faces]
    edges = triangles[:, 1:, :2] - triangles[:, :1, :2]
    facing = edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0] > 0
    corners = triangles[facing][:, [0, 1, 2, 2]]
    face = _shade(BONE, corners, 0.55)
    return Polygons(corners, face, face)


def _hood(view: PlotView, scene: Scene, colours: ScalarMappable | None) -> Polygons:
    assert scene.hood is not None
    corners = _corners(view.project(scene.hood.points)[scene.hood.quads])
    colour = np.broadcast_to(PLAIN_HOOD, (len(corners), 3))
    if colours is not None:
        colour = colours.to_rgba(colours_of(scene.hood)[0].values(scene.hood))[:, :3]
    face = _shade(colour, corners, 0.85)
    edge = np.hstack([0.72 * face[:, :3], np.full((len(face), 1), 0.8)])
    return Polygons(corners + np.array([0, 0, HOOD_LIFT]), face, edge)


def _fibres(view: PlotView, scene: Scene) -> list[Polygons]:
    """Short strokes along each fibre family of the hood."""
    assert scene.hood is not None
    families = families_of(scene.hood.cell_data)
    if not families:
        return []
    from matplotlib.colors import to_rgba

    points, cells = scene.hood.points, stroke_cells(scene.hood.points, scene.hood.quads)
    out = []
    for direction, ink in zip(families, INKS, strict=False):
        ends = view.project(strokes(points, scene.hood.quads[cells], direction[cells]))
        colour = np.tile(to_rgba(ink), (len(ends), 1))
        corners = _bands(ends, STROKE_WIDTH) + np.array([0, 0, STROKE_LIFT])
        out.append(Polygons(corners, colour, colour))
    return out


def _corners(cells: Array) -> Array:
    """The corners (n, 4, 3) of quads, and of line cells (n, 2, 3) those of bands that face the
    viewer."""
    return cells if cells.shape[1] == 4 else _bands(cells, CABLE_WIDTH)


def _bands(cells: Array, width: float) -> Array:
    """The corners (n, 4, 3) of bands, `width` mm wide, along lines (n, 2, 3) that face the
    viewer."""
    along = cells[:, 1, :2] - cells[:, 0, :2]
    across = np.stack([-along[:, 1], along[:, 0], 0 * along[:, 0]], axis=1)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    first, last = cells[:, 0], cells[:, 1]
    side = 0.5 * width * across
    return np.stack([first + side, last + side, last - side, first - side], axis=1)


def _ribbon(view: PlotView, points: Array) -> Polygons:
    """A tendon as a band that faces the viewer, in pieces short enough to be sorted."""
    line = view.project(_resample(points))
    along = np.gradient(line[:, :2], axis=0)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    side = np.hstack([0.5 * TENDON_WIDTH * across, np.zeros((len(line), 1))])
    left, right = line - side, line + side
    corners = np.stack([left[:-1], left[1:], right[1:], right[:-1]], axis=1)
    colour = np.tile([*TENDON, 1.0], (len(corners), 1))
    return Polygons(corners, colour, colour)


def _resample(points: Array, step: float = 1e-3) -> Array:
    """The polyline with points about every `step` m, its own among them."""
    pieces = [np.asarray(points[:1], dtype=float)]
    for start, end in itertools.pairwise(np.asarray(points, dtype=float)):
        count = max(1, int(np.ceil(np.linalg.norm(end - start) / step)))
        pieces.append(start + np.linspace(0, 1, count + 1)[1:, None] * (end - start))
    return np.concatenate(pieces)


def _shade(colour: Array, corners: Array, ambient: float) -> Array:
    """Colours (n, 4), darker where a polygon turns away from a light at the viewer's upper left."""
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = np.where(np.linalg.norm(normal, axis=1, keepdims=True) > 0, normal, flat)
    length = np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    light = np.array([-0.3, 0.5, 0.81])
    bright = ambient + (1 - ambient) * np.abs(normal / length @ light)
    return np.hstack([colour * bright[:, None], np.ones((len(corners), 1))])


def decimate(vertices: Array, faces: np.ndarray, most: int = MOST_TRIANGLES) -> tuple:
    """A coarser surface of `most` triangles or fewer: vertices within a cell become one.

    vertices (n, 3), faces (m, 3) -> the same of fewer."""
    vertices, faces = np.asarray(vertices, dtype=float), np.asarray(faces)
    edges = vertices[faces[:, 1:]] - vertices[faces[:, :1]]
    area = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum()
    size = np.sqrt(2.5 * area / most)  # a surface meets some 1.25 area/size**2 cells
    while len(faces) > most:
        cell = np.round((vertices - vertices.min(axis=0)) / size).astype(np.int64)
        number = np.ravel_multi_index(tuple(cell.T), tuple(cell.max(axis=0) + 1))
        _, owner, count = np.unique(number, return_inverse=True, return_counts=True)
        vertices = np.stack([np.bincount(owner, x) / count for x in vertices.T], axis=1)
        faces, size = owner[faces], 1.15 * size
        faces = faces[(np.diff(np.sort(faces, axis=1), axis=1) > 0).all(axis=1)]
    return vertices, faces


def _draw_force(ax: Axes, view: PlotView, point: Array, force: Array) -> None:
    """The fingertip's force, as long as it is seen from here, with its magnitude."""
    magnitude = float(np.linalg.norm(force))
    if magnitude == 0.0:
        return
    tail = view.project(point)[:2]
    head = tail + 1e-3 * ARROW_LENGTH * view.project(np.asarray(force) / magnitude)[:2]
    style = {"arrowstyle": "-|>", "lw": 2.2, "color": "black", "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", tuple(head), tuple(tail), arrowprops=style, zorder=5)
    text = f"arrow: fingertip force {magnitude:.2f} N"
    ax.text(0.98, 0.9, text, ha="right", transform=ax.transAxes, fontsize=10)
    ax.update_datalim([head])
