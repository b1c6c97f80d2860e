"""The plot of a ledger: the forces on each bone as arrows that close, with their components, and of
a motion their size over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from string import ascii_uppercase
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.port import AXES, Array
from cosim.results.conventions import source_words
from cosim.results.looks import BONE, Look, look
from cosim.results.parts import LedgerRow, Scene
from cosim.results.picture import new_picture
from cosim.results.scene_plot import VIEWS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FEW_STATES = 3
"""States of which the last is drawn as arrows; more are times."""
TELLING = 0.02
"""Share of a body's largest force, and of its largest moment: sources below both are one row."""
BLOCK, PICTURE, ROW = (7.0, 0.75), 2.5, 0.165
"""Inches: width of a body's block and height of its title, height of its pictures, and of a row of
its table."""
ARROW = 0.45
"""Length of the largest force on a bone, of the longer side of the bone."""
POINTS = 8
"""Along the edges of a bone's triangles, of which a few of a capsule run along all of it."""
NEAR_LINE = 0.03
"""The part of that side within which points of the bone are on a line of action."""
SQUARE = 2.1
"""Inches, the sides of the polygon of forces."""
SIDE = VIEWS[0]
SMALL, CELL = 8, 9
"""Size of letters, points, and how many a number of the table takes."""


@dataclass(frozen=True)
class Acting:
    """One source on one body."""

    letter: str
    words: str
    force: Array
    """(3,) N."""
    moment: Array
    """(3,) N m about the body's origin."""
    colour: str


def draw_ledger(rows: Sequence[LedgerRow], title: str, scene: Scene | None = None) -> Figure:
    """Return, of few states, a block for each body at the last one: the forces on its lines of
    action on the bone, head to tail, and a table of components; of a motion the size of the forces
    on each body against time.  `scene` is that of the last state; without it no bones are drawn."""
    states = list(dict.fromkeys(row.state for row in rows))
    if len(states) > FEW_STATES:
        return _over_time(rows, title)
    last = [row for row in rows if row.state == states[-1]]
    return _at_rest(last, f"{title}: forces and moments on each bone, {states[-1]}", scene)


def _at_rest(rows: Sequence[LedgerRow], title: str, scene: Scene | None) -> Figure:
    from matplotlib.figure import Figure

    bodies = list(dict.fromkeys(row.body for row in rows))
    acting = {body: acting_on([row for row in rows if row.body == body]) for body in bodies}
    columns = min(2, max(len(bodies), 1))
    lines = max((len(each) for each in acting.values()), default=0) + 3
    wide, tall = BLOCK[0], BLOCK[1] + PICTURE + ROW * lines
    across, down = columns * wide, -(-len(bodies) // columns) * tall + 0.65
    figure = Figure(figsize=(across, down))
    for i, body in enumerate(bodies):
        left, top = (i % columns) * wide, down - 0.4 - (i // columns) * tall

        def panel(x: float, y: float, w: float, h: float, at: Any = (left, top)) -> Axes:
            place = (at[0] + x, at[1] - y - h, w, h)
            return figure.add_axes(tuple(np.array(place) / [across, down, across, down]))

        name = body.replace("_", " ")
        figure.text((left + 0.25) / across, (top - 0.12) / down, name, weight="bold", va="top")
        _draw_bone(panel(0.25, 0.42, 2.2, PICTURE), body, acting[body], scene)
        _draw_polygon(panel(3.0, 0.42, SQUARE, SQUARE), acting[body])
        _draw_moments(panel(5.45, 0.42, 1.3, SQUARE), acting[body])
        _write_table(figure, (left + 0.25, top - 0.55 - PICTURE), acting[body])
    text = (
        "Left: each force on its line of action in the sagittal plane, seen from the radial side. "
        "Middle and right: the same forces, and the moments about the radial axis, head to tail: "
        "they end where they begin, as their sum is zero. Moments are about the bone's origin "
        "(the cross), flexion is positive."
    )
    note = "\n".join(wrap(text, int(across / 0.068)))
    figure.text(0.25 / across, 0.1 / down, note, fontsize=SMALL)
    figure.text(0.25 / across, 1 - 0.1 / down, title, va="top", fontsize=12)
    return figure


def acting_on(rows: Sequence[LedgerRow]) -> list[Acting]:
    """Return what acts on a body, the strongest source first; those that are little beside the
    largest are summed up in the last, so that all add up to what the rows do."""
    size = np.array([[np.linalg.norm(row.force), np.linalg.norm(row.moment)] for row in rows])
    share = (size / np.maximum(size.max(axis=0), 1e-300)).max(axis=1)
    order = np.argsort(-share.round(6), kind="stable")
    shown = [k for k in order if share[k] >= TELLING]
    little = [k for k in order if share[k] < TELLING]
    out = []
    for i, k in enumerate(shown):
        row = rows[k]
        letter, colour = ascii_uppercase[i % 26], look(i).colour
        out.append(Acting(letter, source_words(row.source), row.force, row.moment, colour))
    if little:
        force, moment = (
            np.sum([getattr(rows[k], part) for k in little], axis=0) for part in ("force", "moment")
        )
        words = f"{len(little)} more, each under {100 * TELLING:.0f} %"
        out.append(Acting("", words, force, moment, "0.5"))
    return out


def _draw_bone(ax: Axes, body: str, acting: Sequence[Acting], scene: Scene | None) -> None:
    """The bone from the radial side with the forces on their lines of action, and the moments of
    what exerts no force."""
    from matplotlib.collections import PolyCollection

    ax.set_axis_off()
    ax.set_aspect("equal")
    surfaces = {} if scene is None else {name: rest for name, *rest in scene.bones}
    if scene is None or body not in surfaces or body not in scene.origins:
        ax.text(0.5, 0.5, "no surface of this bone", ha="center", fontsize=SMALL, color="0.4")
        return
    vertices, faces = surfaces[body]
    flat = SIDE.place(vertices)
    share = np.linspace(0, 1, POINTS)[:, None, None, None]
    corners = flat[faces]
    edges = ((1 - share) * corners + share * np.roll(corners, 1, axis=1)).reshape(-1, 2)
    shapes: Any = flat[faces]
    ax.add_collection(PolyCollection(shapes, facecolor=BONE, edgecolor=BONE, lw=0.4), autolim=False)
    origin = SIDE.place(scene.origins[body])
    low, high = flat.min(axis=0), flat.max(axis=0)
    reach = float((high - low).max())
    ax.plot(*origin, "+", color="black", ms=7, mew=1.3, zorder=4)
    largest = max((_size(a) for a in acting), default=0.0) or 1.0
    ends = [low, high, origin]
    for a in acting:
        plane = a.force[[0, 2]]
        if _size(a) < TELLING * largest:
            continue
        along = ARROW * reach * plane / largest
        through = origin + _place(plane, 1e3 * a.moment[1], edges - origin)
        tail, head = through - along / 2, through + along / 2
        _draw_arrow(ax, tail, head, a.colour)
        _write_letter(ax, a, tuple(head), along)
        ends += [tail, head]
    room = 0.06 * reach
    low, high = np.min(ends, axis=0) - room, np.max(ends, axis=0) + room
    ax.set(xlim=(high[0], low[0]), ylim=(low[1], high[1]))


def _size(acting: Acting) -> float:
    """The force's length in the sagittal plane, N."""
    return float(np.hypot(acting.force[0], acting.force[2]))


def _place(force: Array, moment: float, bone: Array) -> Array:
    """Return where (2,) mm from a body's origin, distal and dorsal, a force (2,) N with that moment
    about the radial axis (N mm) is drawn: on its line of action, where that meets the bone's points
    (n, 2) or is nearest to them."""
    normal = np.array([-force[1], force[0]]) / np.linalg.norm(force)
    apart = moment / np.linalg.norm(force) - bone @ normal
    near = np.abs(apart) <= max(np.abs(apart).min(), NEAR_LINE * np.ptp(bone, axis=0).max())
    return np.asarray((bone[near] + apart[near, None] * normal).mean(axis=0))


def _draw_polygon(ax: Axes, acting: Sequence[Acting]) -> None:
    """The forces head to tail in the sagittal plane: distal to the left, dorsal up."""
    corners = polygon(acting)
    for a, tail, head in zip(acting, corners, corners[1:], strict=False):
        _draw_arrow(ax, tail, head, a.colour)
        if a.letter and np.linalg.norm(head - tail) > TELLING * np.ptp(corners, axis=0).max():
            _write_letter(ax, a, tuple((tail + head) / 2), head - tail)
    ax.plot(*corners[0], "o", color="black", ms=3.5, zorder=4)
    low, high = corners.min(axis=0), corners.max(axis=0)
    half = 0.62 * max(float((high - low).max()), 1e-9)
    x, y = (low + high) / 2
    ax.set(xlim=(x + half, x - half), ylim=(y - half, y + half))
    ax.locator_params(nbins=5)
    ax.set_xlabel("distal, N", fontsize=SMALL, labelpad=1)
    ax.set_ylabel("dorsal, N", fontsize=SMALL, labelpad=1)
    ax.tick_params(labelsize=SMALL - 1)
    ax.grid(alpha=0.25)


def _draw_moments(ax: Axes, acting: Sequence[Acting]) -> None:
    """The moments about the radial axis head to tail, one below the other."""
    ends = np.concatenate([[0.0], np.cumsum([1e3 * a.moment[1] for a in acting])])
    for i, (a, tail, head) in enumerate(zip(acting, ends, ends[1:], strict=False)):
        _draw_arrow(ax, np.array([tail, i]), np.array([head, i]), a.colour)
        ax.plot([head, head], [i, i + 1], color="0.6", lw=0.7, zorder=2)
    ax.axvline(0, color="black", lw=0.8, zorder=1)
    low, high = ends.min(), ends.max()
    room = 0.1 * max(high - low, 1e-9)
    ax.set(xlim=(low - room, high + room), ylim=(len(acting), -0.8))
    ax.set_yticks(range(len(acting)), [a.letter or "…" for a in acting])
    for label, a in zip(ax.get_yticklabels(), acting, strict=True):
        label.set(color=a.colour, weight="bold")
    ax.set_xlabel("moment (radial), N mm", fontsize=SMALL, labelpad=1)
    ax.tick_params(labelsize=SMALL - 1)
    ax.locator_params(axis="x", nbins=4)
    ax.grid(alpha=0.25)


def polygon(acting: Sequence[Acting]) -> Array:
    """Return the corners (n + 1, 2) N, distal and dorsal, of the forces head to tail from zero."""
    forces = np.array([a.force[[0, 2]] for a in acting]).reshape(-1, 2)
    return np.vstack([np.zeros(2), np.cumsum(forces, axis=0)])


def _draw_arrow(ax: Axes, tail: Array, head: Array, colour: str) -> None:
    style = {"arrowstyle": "-|>", "lw": 1.8, "color": colour, "shrinkA": 0, "shrinkB": 0}
    style |= {"mutation_scale": 11}
    ax.annotate("", tuple(head), tuple(tail), arrowprops=style, zorder=3)


def _write_letter(ax: Axes, acting: Acting, at: tuple[float, ...], along: Array) -> None:
    """The letter of a force beside a place on its arrow."""
    unit = along / max(float(np.linalg.norm(along)), 1e-12)
    side: Any = {"xytext": (8 * unit[1], 8 * unit[0]), "textcoords": "offset points"}
    looks: Any = {"ha": "center", "va": "center", "fontsize": SMALL + 1, "weight": "bold"}
    ax.annotate(acting.letter, (at[0], at[1]), **side, **looks, color=acting.colour, zorder=5)


def _write_table(figure: Figure, place: tuple[float, float], acting: Sequence[Acting]) -> None:
    """Letter, source and components of each force and moment, and their sums, at inches from the
    left and from below; the numbers of a row are one text, which is drawn faster than its cells."""
    from matplotlib.lines import Line2D

    (left, top), (across, down) = place, figure.get_size_inches()
    right = left + BLOCK[0] - 0.45

    def write(x: float, row: int, words: str, **looks: Any) -> None:
        looks = {"va": "center", "fontsize": SMALL, **looks}
        figure.text(x / across, (top - (row + 0.5) * ROW) / down, words, **looks)

    def write_row(row: int, words: str, cells: Sequence[str], **looks: Any) -> None:
        write(left + 0.22, row, words, **looks)
        numbers = "".join(f"{cell:>{CELL}}" for cell in cells)
        write(right, row, numbers, ha="right", family="monospace", **looks)

    total = [sum((getattr(a, part) for a in acting), np.zeros(3)) for part in ("force", "moment")]
    titles = "".join(f"{title:^{3 * CELL}}" for title in ("force, N", "moment, N mm"))
    write(right, 0, titles, ha="right", family="monospace", color="0.3")
    write_row(1, "on the bone from", [*AXES, *AXES], color="0.3")
    for i, a in enumerate(acting):
        write(left, i + 2, a.letter, weight="bold", color=a.colour)
        write_row(i + 2, a.words, [*map(_number, a.force), *map(_number, 1e3 * a.moment)])
    sums = [*map(_number, total[0]), *map(_number, 1e3 * total[1])]
    write_row(len(acting) + 2, "sum", sums, weight="bold")
    for row in (2, len(acting) + 2):
        ends, y = [left / across, right / across], (top - row * ROW) / down
        figure.add_artist(Line2D(ends, [y, y], color="0.5", lw=0.8))


def _number(value: float) -> str:
    text = f"{value:.3f}" if abs(value) < 10 else f"{value:.2f}"
    return (text.removeprefix("-") if float(text) == 0 else text).replace("-", "\u2212")


def _over_time(rows: Sequence[LedgerRow], title: str) -> Figure:
    """A panel for each body: the size of the force of each source, N, against time.  A source that
    nowhere reaches TELLING of the largest force is left out."""
    sized = [(row, float(np.linalg.norm(row.force))) for row in rows]
    largest: dict[str, float] = {}
    for row, size in sized:
        largest[row.source] = max(size, largest.get(row.source, 0.0))
    least = TELLING * max(largest.values(), default=0.0)
    sized = [(row, size) for row, size in sized if largest[row.source] >= least]
    states = list(dict.fromkeys(row.state for row, _ in sized))
    bodies = list(dict.fromkeys(row.body for row, _ in sized))
    sources = list(dict.fromkeys(row.source for row, _ in sized))
    looks = {source: look(i) for i, source in enumerate(sources)}
    columns = min(2, max(len(bodies), 1))
    down = -(-len(bodies) // columns)
    figure = new_picture(4.2 * columns + 2.6, 2.6 * down + 0.6)
    panels = figure.subplots(down, columns, sharex=True, sharey=True, squeeze=False)
    for axes, body in zip(panels.ravel(), bodies, strict=False):
        of_body = {(r.state, r.source): size for r, size in sized if r.body == body}
        _lines(axes, of_body, states, looks)
        axes.set_title(body.replace("_", " "), fontsize=10)
        axes.grid(alpha=0.3)
    for axes in panels.ravel()[len(bodies) :]:
        axes.set_visible(False)
    for axes in panels[:, 0]:
        axes.set_ylabel("force on the bone, N")
    for axes in panels[-1]:
        axes.set_xlabel("time, s")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right center", fontsize=SMALL, handlelength=3)
    figure.suptitle(f"{title}: forces by source", fontsize=11)
    return figure


def _lines(
    axes: Axes,
    force: Mapping[tuple[str, str], float],
    states: Sequence[str],
    looks: Mapping[str, Look],
) -> None:
    """The force (N) by state and source.  All sources, those that do not act too, so that each
    panel's legend is the figure's."""
    acting = {state for state, _ in force}
    at = {float(s.removesuffix(" s")): s for s in states if s in acting}
    times = sorted(at)
    for source, one in looks.items():
        over_time = [force.get((at[time], source), 0.0) for time in times]
        axes.plot(times, over_time, lw=1.0, label=source_words(source), **one.line)
