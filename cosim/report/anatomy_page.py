"""The page of a finger of a user's own bones: what was found, carried over and assumed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cosim.port import Array, Triangles
from cosim.report.figures import legend_below, style_axes
from cosim.results.picture import new_picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INKS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#333333", "#8800ff")
VIEWS = (("from radial", 0, 2, 1, "dorsal, mm"), ("from dorsal", 0, 1, 2, "radial, mm"))
"""Title, axes shown, the axis that one looks along, and the label of the second."""
SHADE = ("#f1e6cf", "#a5916c")
"""Shades of a bone, towards the eye and across it."""
REACH = 11e-3
"""m, of a joint's axis to either side in the picture."""


@dataclass(frozen=True)
class Drawn:
    """The straight finger, world frame, m."""

    bones: Mapping[str, Triangles]
    points: Mapping[str, Array]
    """(n, 3) that each tendon passes."""
    eyelets: Mapping[str, Array]
    """(3,) by tendon."""
    axes: Mapping[str, tuple[Array, Array]]
    """A point (3,) and a direction (3,), by joint."""
    hood: Array
    """(m, 4, 3) corners of its quads."""


def draw_anatomy(drawn: Drawn) -> Figure:
    """The straight finger from radial and from dorsal: bones, tendons' points, axes, hood."""
    picture = new_picture(10.0, 5.4)
    panels = picture.subplots(2, 1)
    for axes, (title, i, k, depth, y) in zip(panels, VIEWS, strict=True):
        for points, faces in drawn.bones.values():
            _draw_bone(axes, points, faces, i, k, depth)
        for quad in drawn.hood:
            axes.fill(*(1e3 * quad[:, [i, k]].T), fc="none", ec="0.35", lw=0.35, zorder=3)
        for n, (tendon, points) in enumerate(drawn.points.items()):
            ink, mark = INKS[n % len(INKS)], "osD^v<>P*X"[n % 10]
            axes.plot(*(1e3 * points[:, [i, k]].T), mark, ms=3.5, color=ink, zorder=4, label=tendon)
        for tendon, at in drawn.eyelets.items():
            axes.plot(1e3 * at[i], 1e3 * at[k], "o", ms=7, mfc="none", mec="k", zorder=5)
            axes.annotate(tendon, 1e3 * at[[i, k]], (4, 4), textcoords="offset points", fontsize=8)
        for joint, (centre, way) in drawn.axes.items():
            ends = 1e3 * np.array([centre - REACH * way, centre + REACH * way])
            axes.plot(*ends[:, [i, k]].T, "-", color="#b00020", lw=1.2, zorder=6)
            axes.plot(1e3 * centre[i], 1e3 * centre[k], "+", color="#b00020", ms=7, zorder=6)
            if k == 1 and not joint.endswith("abduction"):
                axes.annotate(joint, ends[1][[i, k]], (3, 2), textcoords="offset points")
        style_axes(axes, "distal, mm", y)
        axes.set_aspect("equal")
        axes.set_title(title, fontsize=10, loc="left")
    legend_below(picture, 11, panels[0])
    return picture


def _draw_bone(axes: Axes, points: Array, faces: np.ndarray, i: int, k: int, depth: int) -> None:
    """The triangles that face the eye, the nearest last, lighter as they face it."""
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgb

    corners = points[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1)
    towards = normal[:, depth] / np.where(size > 0, size, 1.0)
    seen = np.flatnonzero(towards > 0)
    seen = seen[np.argsort(corners[seen][:, :, depth].mean(axis=1))]
    light, dark = (np.array(to_rgb(ink)) for ink in SHADE)
    colours = dark + towards[seen, None] * (light - dark)
    shown = 1e3 * corners[seen][:, :, [i, k]]
    axes.add_collection(PolyCollection(shown, facecolors=colours, edgecolors=colours, lw=0.3))
    axes.autoscale_view()
