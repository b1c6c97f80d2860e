"""A still picture of a run: bones, hood coloured by a field, tendons and fingertip force.

Drawn by the painter's algorithm in two orthographic views, one above the other to one scale:
everything becomes polygons, sorted by depth in one collection, so that what lies behind is hidden.
Needs no display and no OpenGL.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from textwrap import fill, wrap
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cosim.hoods.kinds import colours_of
from cosim.port import Array, Hand
from cosim.results.looks import (
    BONE,
    FORCE,
    INKS,
    PLAIN_HOOD,
    RESTING_TENDON,
    TENDON,
    colour_limits,
    colour_map,
)
from cosim.results.parts import Scene
from cosim.results.picture import as_plain_text
from cosim.results.scene import tension_of
from cosim.results.strokes import families_of, stroke_cells, strokes

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

TENDON_WIDTH, RESTING_WIDTH, CABLE_WIDTH, STROKE_WIDTH = 0.9, 0.45, 0.7, 0.16  # mm
ARROW_LENGTH = 15.0  # mm, of the largest fingertip force
HOOD_LIFT = 1.0  # mm towards the viewer, so that bone triangles larger than quads do not cut in
STROKE_LIFT = 1.2  # mm, of the strokes along fibres, over the quads beside them
ROOM = 2.5  # mm around what is drawn
WIDE, TALLEST = 8.2, 8.0
"""Inches: the width of both views, and the height of both together at most."""
LEFT, RIGHT, ABOVE, BELOW, BETWEEN, ROW = 0.75, 1.15, 0.55, 0.62, 0.35, 0.24
"""Inches around the views, between them, and of a row of the legend."""
LETTER, LINE = 0.085, 0.19
"""Inches: the width of a letter of a label, and the height of a line of labels."""
ENTRY, TITLE_LETTER, TITLE_LINE = 3.0, 0.098, 0.2
"""Inches: the width of an entry of the legend, of a letter of the title, and a line of it."""
COLUMNS, MOST_NAMES = 3, 8
"""Columns of the legend, and points with names: of more the dots alone are drawn."""
SMALL_TEXT = 9
GAUGE = "#000000"
BONE_LINE = "bones"
"""The name of the line through the bodies of a finger in an FMU."""
BEYOND = 1.25
"""Where a bone's name stands, as a part of the way from its joint to its middle."""
PROXIMAL = 1e-3
"""m, of a hood's proximal end: where its tendons are said to pull on it."""


@dataclass(frozen=True)
class PlotView:
    """An orthographic view: the axes (unit, world frame) to the right, up, and to the viewer, and
    the words of what the first two measure, which grow against the arrows where `sign` is -1."""

    title: str
    right: tuple[float, float, float]
    up: tuple[float, float, float]
    label: tuple[str, str]
    sign: tuple[int, int]
    towards: tuple[float, float, float]

    def of(self, hand: Hand) -> PlotView:
        """Return the view of that hand: the left one is seen as in a mirror."""
        if hand == "right":
            return self
        x, y, z = self.right
        title, sign = f"{self.title} of a left hand", (-self.sign[0], self.sign[1])
        return replace(self, title=title, right=(-x, -y, -z), sign=sign)

    def project(self, points: Array) -> Array:
        """Project points (..., 3) m to (..., 3): right, up and height towards the viewer, mm."""
        axes = np.array([self.right, self.up, self.towards])
        return 1e3 * np.asarray(points) @ axes.T

    def place(self, points: Array) -> Array:
        """Return where points (..., 3) m lie on the view's axes (..., 2), mm."""
        return np.asarray(self.project(points)[..., :2] * self.sign)


VIEWS = (
    PlotView(
        *("from the radial side", (-1, 0, 0), (0, 0, 1), ("distal, mm", "dorsal, mm"), (-1, 1)),
        (0, 1, 0),
    ),
    PlotView(
        *("from the dorsal side", (-1, 0, 0), (0, -1, 0), ("distal, mm", "radial, mm"), (-1, -1)),
        (0, 0, 1),
    ),
)


class Polygons(NamedTuple):
    """Polygons in a view: corners (n, 4, 3) mm, face and edge colours (n, 4)."""

    corners: Array
    face: Array
    edge: Array


@dataclass(frozen=True)
class Stage:
    """What all pictures of one film share."""

    box: Array
    """(2, 3) m, the least and the greatest coordinates of all that is drawn."""
    limits: tuple[float, float] | None
    """The ends of the colour scale; None of a hood without a field."""
    whole: Scene
    """The last of the scenes, with the largest tension of each tendon and the largest force of the
    fingertip: what there is room for, and what the legend names."""
    is_film: bool
    newtons: float
    """The largest force of the fingertip, N: its arrow is ARROW_LENGTH long."""
    longest: int
    """Letters of the longest name of a tendon that pulls, with its tension."""
    views: tuple[PlotView, ...] = VIEWS
    """One above the other."""
    width: float | None = None
    """Inches of the whole figure; None: as wide as VIEWS take."""


def stage_of(scenes: Sequence[Scene]) -> Stage:
    """Return what pictures of these scenes have in common: bounds, colour scale and the scale of
    the force."""
    largest = max(scenes, key=newtons_of)
    names = dict.fromkeys(name for s in scenes for name in s.pulled)
    pulled = {name: max(s.pulled.get(name, 0.0) for s in scenes) for name in names}
    whole = replace(scenes[-1], pulled=pulled, tip=largest.tip)
    every = [part for s in scenes for part in _drawn_points(s, newtons_of(largest))]
    parts = [np.reshape(part, (-1, 3)) for part in every]
    points = np.concatenate(parts) if parts else np.zeros((1, 3))
    hoods = [s.hood for s in scenes if s.hood is not None]
    limits = None
    if hoods and (shown := colours_of(hoods[-1])):
        values = [shown[0].values(hood) for hood in hoods]
        limits = colour_limits(np.concatenate(values), shown[0].is_signed)
    box = np.stack([points.min(axis=0), points.max(axis=0)])
    longest = max((len(_pull(*pull)) for pull in pulled.items()), default=0)
    views = tuple(view.of(whole.hand) for view in VIEWS)
    return Stage(box, limits, whole, len(scenes) > 1, newtons_of(largest), longest, views)


def newtons_of(scene: Scene) -> float:
    return 0.0 if scene.tip is None else float(np.linalg.norm(scene.tip[1]))


def _drawn_points(scene: Scene, newtons: float) -> Iterator[Array]:
    """The points (..., 3) m of all that a scene draws."""
    yield from (vertices for _, vertices, _ in scene.bones)
    yield from (points for _, points in scene.tendons)
    if scene.hood is not None:
        yield scene.hood.points
    if (arrow := arrow_of(scene, newtons)) is not None:
        yield arrow


def arrow_of(scene: Scene, newtons: float) -> Array | None:
    """Tail and head (2, 3) m of the fingertip's force; None where there is none."""
    if scene.tip is None or not np.any(scene.tip[1]):
        return None
    point, force = scene.tip
    return np.stack([point, point + 1e-3 * ARROW_LENGTH / newtons * np.asarray(force)])


def draw(scene: Scene, title: str, stage: Stage | None = None, moment: str = "") -> Figure:
    """Return the two views, one above the other, with a legend of all that is drawn; `moment` says
    when.  The pictures of a film share a `stage`."""
    stage = stage_of([scene]) if stage is None else stage
    figure = _lay_out(title, stage)
    _fill(figure, scene, stage, moment)
    return figure


def draw_pixels(
    shown: Iterable[tuple[Scene, str]], title: str, stage: Stage, width: int
) -> Iterator[np.ndarray]:
    """Yield the picture of each scene and moment as pixels (rows, `width`, 3); what is the same in
    all of them is drawn once."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = _lay_out(title, stage)
    figure.set_dpi(width / figure.get_figwidth())
    canvas = FigureCanvasAgg(as_plain_text(figure))
    canvas.draw()
    ground = canvas.copy_from_bbox(figure.bbox)
    for scene, moment in shown:
        canvas.restore_region(ground)
        added = _fill(figure, scene, stage, moment)
        for artist in sorted(added, key=lambda artist: artist.get_zorder()):
            artist.draw(canvas.get_renderer())
        yield np.array(canvas.buffer_rgba())[..., :3]
        for artist in added:
            artist.remove()


def _lay_out(title: str, stage: Stage) -> Figure:
    """The views without what moves, with legend, colour bar and title."""
    from matplotlib.figure import Figure

    legend, columns, hood = _legend(stage), COLUMNS, stage.whole.hood
    if stage.width is not None:
        columns = max(1, min(COLUMNS, int((stage.width - LEFT) / ENTRY)))
    rows = -(-len(legend) // columns)
    low, high = 1e3 * stage.box[0] - ROOM, 1e3 * stage.box[1] + ROOM
    axes = [int(np.flatnonzero(view.up)[0]) for view in stage.views]
    across, heights = (high - low)[0], (high - low)[axes]
    beside = LETTER * stage.longest + 0.2 if stage.longest else 0.0
    below, colours = BELOW + rows * ROW, _colours(stage)
    gaps = BETWEEN * (len(stage.views) - 1)

    def fitted(aside: float) -> float:
        """Inches in a mm."""
        if stage.width is not None:
            return float((stage.width - LEFT - aside - beside) / across)
        return float(min((WIDE - beside) / across, TALLEST / heights.sum()))

    aside = 0.3 if stage.limits is None else RIGHT
    scale, label = fitted(aside), ""
    if hood is not None and colours is not None:  # a short bar has more lines beside it
        inches = scale * heights.sum() + gaps
        label = fill(colours_of(hood)[0].words, max(int(inches / LETTER), 12))
        aside += TITLE_LINE * max(label.count("\n") - 1, 0)
        scale = fitted(aside)
    views = scale * heights
    width = LEFT + scale * across + beside + aside
    head = wrap(title, max(int((width - LEFT) / TITLE_LETTER), 12)) or [""]
    above = ABOVE + 0.2 * stage.is_film + TITLE_LINE * (len(head) - 1)
    both = views.sum() + gaps
    height = above + both + below
    figure = Figure(figsize=(width, height))
    floors = height - above - np.cumsum(views) - BETWEEN * np.arange(len(views))
    for view, floor, tall, axis in zip(stage.views, floors, views, axes, strict=True):
        panel = (LEFT / width, floor / height, (scale * across + beside) / width, tall / height)
        ax = figure.add_axes(panel)
        ends = (low[axis], high[axis])[:: view.sign[1]]
        across_ends = (high[0], low[0] - beside / scale)[:: -view.sign[0]]
        ax.set(xlim=across_ends, ylim=ends, ylabel=view.label[1])
        looks: Any = {"va": "bottom", "fontsize": SMALL_TEXT, "color": "0.35"}
        ax.text(0, 1.0, view.title, transform=ax.transAxes, **looks)
        ax.tick_params(labelsize=SMALL_TEXT)
        ax.spines[["top", "right"]].set_visible(False)
    *upper, last = figure.axes
    for ax in upper:
        ax.tick_params(labelbottom=False)
    last.set_xlabel(stage.views[-1].label[0])
    if colours is not None:
        place = ((width - aside + 0.15) / width, below / height, 0.16 / width, both / height)
        bar = figure.colorbar(colours, cax=figure.add_axes(place), extend="both")
        bar.set_label(label, fontsize=SMALL_TEXT)
        bar.ax.tick_params(labelsize=SMALL_TEXT)
    figure.legend(
        handles=legend,
        loc="lower left",
        bbox_to_anchor=(LEFT / width, 0.04 / height),
        ncols=columns,
        fontsize=SMALL_TEXT,
        frameon=False,
        borderaxespad=0.0,
        columnspacing=1.4,
    )
    figure.text(LEFT / width, 1 - 0.1 / height, "\n".join(head), va="top", fontsize=12)
    return figure


def _fill(figure: Figure, scene: Scene, stage: Stage, moment: str) -> list[Artist]:
    """Add to the views what moves; return it."""
    panels = figure.axes[: len(stage.views)]
    before = {artist for axes in panels for artist in axes.get_children()}
    colours, first = _colours(stage), panels[0]
    for axes, view in zip(panels, stage.views, strict=True):
        _draw_view(axes, scene, view, colours, stage)
    inches = first.get_position().height * figure.get_figheight()
    _write_names(first, scene, stage.views[0], LINE * np.ptp(first.get_ylim()) / inches)
    added = [a for axes in panels for a in axes.get_children() if a not in before]
    if moment:
        height = figure.get_figheight()
        place = first.get_position().x0, 1 - 0.32 / height
        added.append(figure.text(*place, moment, va="top", fontsize=11))
    from matplotlib.text import Text

    for text in (text for artist in added for text in artist.findobj(Text)):
        text.set_parse_math(False)
    return added


def _pull(name: str, tension: float) -> str:
    return f"{name} {tension:.2f} N"


def _legend(stage: Stage) -> list[Artist]:
    """An entry for each kind of thing that the views draw."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    out: list[Artist] = []
    scene = stage.whole
    if scene.bones:
        out.append(Patch(fc=BONE, ec="0.6", label="bones"))
    kinds = {tension_of(scene, name) > 0 for name, _ in scene.tendons if name != BONE_LINE}
    if any(_pulled_end(scene, name) is not None for name in scene.pulled):
        out.append(Line2D([], [], color=TENDON, lw=3, label="tendons that pull, with tension"))
    if False in kinds:
        words = "tendons at rest" if scene.pulled else "tendons"
        out.append(Line2D([], [], color=RESTING_TENDON, lw=1.6, label=words))
    for pull in scene.pulled.items():
        if _pulled_end(scene, pull[0]) is None:
            words = f"{_pull(*pull)} (the tendon has no line to draw)"
            out.append(Line2D([], [], ls="", label=words))
    if scene.hood is not None:
        words = "hood: a net of cables" if scene.hood.quads.shape[1] == 2 else "hood: a sheet"
        face = PLAIN_HOOD
        if colours_of(scene.hood):
            words, face = f"{words}, coloured by the scale", "#dddddd"
        out.append(Patch(fc=face, ec="0.5", label=words))
        families = ["fibres of the hood", "its second fibre family", "its third fibre family"]
        count = len(families_of(scene.hood.cell_data))
        families[0] += " (first family)" * (count > 1)
        for ink, words in zip(INKS[:count], families, strict=False):
            out.append(Line2D([], [], color=ink, lw=1.4, ls=(0, (4, 2)), label=words))
    if scene.gauges:
        out.append(Line2D([], [], color=GAUGE, lw=1.6, label="gauges between two points"))
    if scene.points:
        dot: Any = {"ls": "", "marker": "o", "mfc": "white", "mec": GAUGE, "ms": 4.5}
        out.append(Line2D([], [], label="points of the experiment on the hood", **dot))
    if scene.joints:
        dot = {"ls": "", "marker": "+", "mec": "black", "ms": 7, "mew": 1.4}
        out.append(Line2D([], [], label="centres of the joints", **dot))
    if size := newtons_of(scene):
        dot = {"ls": "-", "lw": 2, "marker": "<", "markevery": [0], "color": FORCE, "ms": 6}
        words = f"force of the fingertip on the world, {'up to ' * stage.is_film}{size:.2f} N"
        out.append(Line2D([0, 1], [0, 0], label=words, **dot))
    return out


def _colours(stage: Stage) -> ScalarMappable | None:
    """The scale of what colours the hood; None of a hood without a field."""
    hood = stage.whole.hood
    if hood is None or stage.limits is None:
        return None
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    colours = ListedColormap(colour_map(colours_of(hood)[0].is_signed))
    return ScalarMappable(Normalize(*stage.limits), colours)


def _draw_view(
    ax: Axes,
    scene: Scene,
    view: PlotView,
    colours: ScalarMappable | None,
    stage: Stage,
) -> None:
    from matplotlib.collections import PolyCollection

    parts = [_bone(view, vertices, faces) for _, vertices, faces in scene.bones]
    parts += [_ribbon(view, points, *_tendon(scene, name)) for name, points in scene.tendons]
    if scene.hood is not None:
        parts.append(_hood(view, scene, colours))
        parts += _fibres(view, scene)
    if parts:
        corners, face, edge = (np.concatenate(c) for c in zip(*parts, strict=True))
        order = np.argsort(corners[..., 2].mean(axis=1), kind="stable")
        # arrays: of lists matplotlib makes its shapes one by one
        shapes: Any = corners[order][..., :2] * view.sign
        inks: tuple[Any, Any] = face[order], edge[order]
        polygons = PolyCollection(shapes, linewidths=0.3)
        polygons.set_rasterized(True)  # as vectors they would make files of many megabytes
        polygons.set_facecolor(inks[0])
        polygons.set_edgecolor(inks[1])
        ax.add_collection(polygons, autolim=False)
    _draw_points(ax, scene, view, view is stage.views[-1])
    if (arrow := arrow_of(scene, stage.newtons)) is not None:
        tail, head = view.place(arrow)
        style = {"arrowstyle": "-|>", "lw": 2.2, "color": FORCE, "shrinkA": 0, "shrinkB": 0}
        ax.annotate("", tuple(head), tuple(tail), arrowprops=style, zorder=5)


def _tendon(scene: Scene, name: str) -> tuple[float, str]:
    """Width, mm, and colour of a line."""
    if name == BONE_LINE:
        return TENDON_WIDTH, BONE
    return (TENDON_WIDTH, TENDON) if tension_of(scene, name) else (RESTING_WIDTH, RESTING_TENDON)


def _draw_points(ax: Axes, scene: Scene, view: PlotView, is_named: bool) -> None:
    """The user's points and gauges, over all else."""
    for pair in scene.gauges.values():
        ends = view.place(np.array([scene.points[name] for name in pair]))
        ax.plot(*ends.T, color=GAUGE, lw=1.4, zorder=4)
    if scene.points:
        at = view.place(np.array(list(scene.points.values())))
        ax.plot(*at.T, "o", mfc="white", mec=GAUGE, mew=0.9, ms=3.6, zorder=4.5)
        if len(scene.points) <= MOST_NAMES and is_named:
            for name, place in zip(scene.points, at, strict=True):
                offset: Any = {"xytext": (3, 3), "textcoords": "offset points"}
                ax.annotate(name.replace("_", " "), tuple(place), **offset, **_halo(7.5), zorder=6)


def _halo(size: float) -> dict[str, Any]:
    """Keywords of a text that is read on any ground."""
    from matplotlib.patheffects import withStroke

    return {"fontsize": size, "path_effects": [withStroke(linewidth=2.2, foreground="white")]}


def _write_names(ax: Axes, scene: Scene, view: PlotView, line: float) -> None:
    """Names of bones and joints at their places, and of the tendons that pull in a column beside
    the finger, with lines to where they are pulled; `line`: mm that a line of text takes."""
    middle: Any = {"ha": "center", "va": "center"}
    for k, (name, vertices, _) in enumerate(scene.bones):
        at = view.place(vertices)
        _, _, axes = np.linalg.svd(at - at.mean(axis=0), full_matrices=False)
        along = axes[0] * view.sign
        turn = (np.degrees(np.arctan2(along[1], along[0])) + 90) % 180 - 90
        place = (at.min(axis=0) + at.max(axis=0)) / 2
        if k and len(scene.joints) == len(scene.bones) - 1:  # beside the name of its joint
            joint = view.place(scene.joints[k - 1][1])
            place = joint + BEYOND * (place - joint)
        words = name.replace("_", " ")
        looks = {**middle, **_halo(SMALL_TEXT), "rotation": turn, "style": "italic"}
        ax.text(place[0], place[1], words, zorder=6, **looks)
    for name, centre in scene.joints:
        at = view.place(centre)
        ax.plot(*at, "+", color="black", ms=7, mew=1.4, zorder=6)
        offset: Any = {
            "xytext": (2, -6),
            "textcoords": "offset points",
            "va": "top",
            "ha": "center",
        }
        ax.annotate(name.replace("_", " "), tuple(at), **offset, **_halo(SMALL_TEXT), zorder=6)
    ends = {}
    for name, tension in scene.pulled.items():
        if (end := _pulled_end(scene, name)) is not None:
            ends[_pull(name, tension)] = view.place(end)
    order = sorted(ends, key=lambda words: ends[words][1])
    low, high = ax.get_ylim()
    heights = _spread(np.array([ends[words][1] for words in order]), line, low, high)
    room = LETTER / LINE * line * max(map(len, order), default=0)
    first, last = ax.get_xlim()
    left = last + room if view.sign[0] < 0 else first + line / 4
    style = {"arrowstyle": "-", "lw": 1.0, "color": TENDON, "shrinkA": 1, "shrinkB": 0}
    style["relpos"] = (float(view.sign[0] > 0), 0.5)  # the label's edge that faces the finger
    for words, height in zip(order, heights, strict=True):
        ax.annotate(
            words,
            tuple(ends[words]),
            (left, height),
            va="center",
            fontsize=SMALL_TEXT,
            color=TENDON,
            arrowprops=style,
            zorder=6,
        )


def _pulled_end(scene: Scene, tendon: str) -> Array | None:
    """The proximal end (3,) m of a tendon's line, or of the hood where it pulls on that; None where
    neither is drawn."""
    for name, points in scene.tendons:
        if name == tendon or name.rpartition(" ")[0] == tendon:
            return np.asarray(points[np.argmin(points[:, 0])])
    if scene.hood is None:
        return None
    x = scene.hood.points
    return np.asarray(x[x[:, 0] < x[:, 0].min() + PROXIMAL].mean(axis=0))


def _spread(heights: Array, apart: float, low: float, high: float) -> Array:
    """Return ascending heights moved as little as it takes to be `apart` from each other and within
    low and high."""
    out = np.array(heights, dtype=float)
    for i in range(1, len(out)):
        out[i] = max(out[i], out[i - 1] + apart)
    if len(out):
        out[-1] = min(out[-1], high - apart / 2)
    for i in range(len(out) - 2, -1, -1):
        out[i] = min(out[i], out[i + 1] - apart)
    return np.maximum(out, low + apart / 2 + apart * np.arange(len(out)))


def _bone(view: PlotView, vertices: Array, faces: np.ndarray) -> Polygons:
    """The triangles that face the viewer: the others lie behind them."""
    triangles = view.project(vertices)[faces]
    edges = triangles[:, 1:, :2] - triangles[:, :1, :2]
    facing = edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0] > 0
    corners = triangles[facing][:, [0, 1, 2, 2]]
    face = _shade(_rgb(BONE), corners, 0.55)
    return Polygons(corners, face, face)


def _hood(view: PlotView, scene: Scene, colours: ScalarMappable | None) -> Polygons:
    assert scene.hood is not None
    corners = _corners(view.project(scene.hood.points)[scene.hood.quads])
    colour = np.broadcast_to(_rgb(PLAIN_HOOD), (len(corners), 3))
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


def _rgb(colour: str) -> Array:
    return np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])


def _ribbon(view: PlotView, points: Array, width: float, ink: str) -> Polygons:
    """A tendon as a band, `width` mm wide, that faces the viewer, in pieces short enough to be
    sorted."""
    line = view.project(_resample(points))
    along = np.gradient(line[:, :2], axis=0)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    side = np.hstack([0.5 * width * across, np.zeros((len(line), 1))])
    left, right = line - side, line + side
    corners = np.stack([left[:-1], left[1:], right[1:], right[:-1]], axis=1)
    corners[..., 2] += width  # of two along one line the wider, which pulls, is seen
    colour = np.tile([*_rgb(ink), 1.0], (len(corners), 1))
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
