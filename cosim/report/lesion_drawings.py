"""Drawings of a finger before and after a lesion, as SVG: postures over each other, strain maps
beside each other on one scale of colours."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from html import escape

import numpy as np

from cosim.port import Array
from cosim.report.views import Bone, Field, Sheet, View

SLICES = 28
"""Of a bone along its axis, for its outline."""
WIDE, MARGIN = 760.0, 14.0
BEFORE, AFTER, MARK = "#8a949c", "#00446b", "#c2410c"
SAME_PLACE = 1e-7
"""m."""
Place = Callable[[Array], Array]


def outline(bone: Bone, frame: int) -> Array:
    """(k, 2) m distal and dorsal: the bone's contour in its own sagittal plane, where it stands."""
    v = bone.vertices
    edges = np.linspace(v[:, 0].min(), v[:, 0].max(), SLICES + 1)
    which = np.clip(np.searchsorted(edges, v[:, 0], side="right") - 1, 0, SLICES - 1)
    upper, lower = [], []
    for i in range(SLICES):
        here = v[which == i]
        if len(here):
            upper.append(here[here[:, 2].argmax()])
            lower.append(here[here[:, 2].argmin()])
    ends = v[v[:, 0].argmax()], v[v[:, 0].argmin()]
    local = np.array([*upper, ends[0], *reversed(lower), ends[1]]) * [1.0, 0.0, 1.0]
    placed = local @ bone.rotation[frame].T + bone.position[frame]
    return placed[:, [0, 2]]


def postures(before: View, after: View) -> str:
    """Both fingers in their last frames, seen from the radial side: distal to the left, dorsal up;
    before in grey, dashed, and after in blue with its hood."""
    shapes = [[outline(bone, -1) for bone in view.bones] for view in (before, after)]
    drawn = [p for shape in shapes for p in shape]
    drawn += [line for view in (before, after) for line in _hood(view)]
    at, tall = _fitted(np.concatenate(drawn), WIDE)
    parts = []
    for view, shape, ink, dash in zip(
        (before, after), shapes, (BEFORE, AFTER), (' stroke-dasharray="5 3"', ""), strict=True
    ):
        fill = "#eef1f3" if dash else "#cfe0ea"
        parts += [
            f'<path d="{_path(at(p))}" fill="{fill}" fill-opacity=".55" stroke="{ink}" '
            f'stroke-width="1.4"{dash}/>'
            for p in shape
        ]
        parts += _lines(view, at, ink, dash)
    label = f"Postures: {before.name} dashed, {after.name} full"
    return _svg(parts, WIDE, tall, label)


def _hood(view: View) -> list[Array]:
    """(k, 2) m each, distal and dorsal: the quads of the hood, or its cables and the tendons."""
    if view.sheet is not None:
        return list(view.sheet.points[-1][view.sheet.quads][..., [0, 2]])
    return [np.asarray(path)[:, [0, 2]] for path in view.tendons[-1].values()]


def _lines(view: View, at: Place, ink: str, dash: str) -> list[str]:
    """The hood from the side."""
    closed = view.sheet is not None
    path = "".join(_path(at(line), close=closed) for line in _hood(view))
    fill = f'fill="{ink}" fill-opacity=".10"' if closed else 'fill="none"'
    faint, width = (".28", ".4") if closed else (".6", "1")
    dash = "" if closed else dash
    return [
        f'<path d="{path}" {fill} stroke="{ink}" stroke-opacity="{faint}" '
        f'stroke-width="{width}"{dash}/>'
    ]


def _fitted(points: Array, width: float) -> tuple[Place, float]:
    """From (k, 2) m, distal and up, to pixels, distal to the left; and the drawing's height."""
    low, high = points.min(axis=0), points.max(axis=0)
    unit = (width - 2 * MARGIN) / float(high[0] - low[0])

    def at(p: Array) -> Array:
        return np.stack(
            [MARGIN + (high[0] - p[:, 0]) * unit, MARGIN + (high[1] - p[:, 1]) * unit], axis=1
        )

    return at, float(high[1] - low[1]) * unit + 2 * MARGIN


def _path(points: Array, close: bool = True) -> str:
    text = "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
    return f"M{text}{'Z' if close else ''}"


def _svg(parts: Sequence[str], wide: float, tall: float, label: str) -> str:
    return (
        f'<svg class="plane" viewBox="0 0 {wide:.0f} {tall:.0f}" role="img" '
        f'aria-label="{escape(label)}">{"".join(parts)}</svg>'
    )


def same_layout(sheet: Sheet, reference: Array, other: Sheet, theirs: Array) -> Array:
    """(n, 2) m: the flat places of `sheet`, whose nodes lie at `reference` (n, 3) as laid, taken
    from a sheet of which it is a part, with nodes `theirs`; its own where it is no part of it."""
    from scipy.spatial import cKDTree

    far, which = cKDTree(theirs).query(reference)
    return other.flat[which] if far.max() < SAME_PLACE else sheet.flat


def strain_map(
    sheet: Sheet,
    flat: Array,
    field: Field,
    scale: tuple[float, float],
    colours: Sequence[str],
    marked: Collection[str],
) -> str:
    """The sheet laid out flat at `flat` (n, 2) m, distal to the left and radial up, each quad in
    the colour of the field's last values; the regions `marked` are framed."""
    values = field.values[-1]
    share = np.clip((values - scale[0]) / (scale[1] - scale[0]), 0, 1)
    index = np.round(share * (len(colours) - 1)).astype(int)
    at, tall = _fitted(flat, WIDE / 2)
    cells = [at(corners) for corners in flat[sheet.quads]]
    parts = [
        f'<path d="{_path(cell)}" fill="{colours[i]}" stroke="{colours[i]}" stroke-width=".3">'
        f"<title>{escape(name.replace('_', ' '))}: {value:.2f} {escape(field.unit)}</title></path>"
        for cell, i, name, value in zip(cells, index, sheet.region, values, strict=True)
    ]
    edges = _rim(sheet, marked)
    frame = "".join(_path(at(flat[edge]), close=False) for edge in edges)
    if frame:
        parts.append(f'<path d="{frame}" fill="none" stroke="{MARK}" stroke-width="1.8"/>')
    return _svg(parts, WIDE / 2, tall, f"{field.label}, {field.unit}")


def _rim(sheet: Sheet, marked: Collection[str]) -> np.ndarray:
    """(k, 2) edges that only one of the marked quads has."""
    quads = sheet.quads[np.isin(sheet.region, list(marked))]
    edges = np.sort(np.concatenate([quads[:, [a, (a + 1) % 4]] for a in range(4)]), axis=1)
    found, count = np.unique(edges.reshape(-1, 2), axis=0, return_counts=True)
    return found[count == 1]


def colour_bar(field: Field, scale: tuple[float, float], colours: Sequence[str]) -> str:
    """The scale of colours with its ends and middle, below the maps."""
    n, wide = len(colours), 320.0
    step = wide / n
    parts = [
        f'<rect x="{20 + i * step:.2f}" y="4" width="{step + 0.3:.2f}" height="12" '
        f'fill="{colour}"/>'
        for i, colour in enumerate(colours)
    ]
    for share in (0.0, 0.5, 1.0):
        value = scale[0] + share * (scale[1] - scale[0])
        parts.append(
            f'<text x="{20 + share * wide:.1f}" y="31" text-anchor="middle">{value:.2f}</text>'
        )
    parts.append(
        f'<text x="{20 + wide / 2:.1f}" y="48" text-anchor="middle" class="what">'
        f"{escape(field.label)}, {escape(field.unit)}</text>"
    )
    return f'<svg class="bar" viewBox="0 0 360 54" aria-hidden="true">{"".join(parts)}</svg>'
