"""What the 3-D view and the strain maps draw, frame by frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cosim.case.schema import Case
from cosim.errors import InputError
from cosim.hoods.kinds import colours_of
from cosim.hoods.lesion import SLIPS
from cosim.hoods.shell.gauges import place_gauges
from cosim.hoods.view import HoodField
from cosim.port import Array, Hand, mirror
from cosim.report.flat import flatten_sheet
from cosim.report.tables import dots_in_words
from cosim.report.templates import floats, integers
from cosim.results.arrays import Arrays
from cosim.results.frames import Frame
from cosim.results.looks import FORCE, INKS, RESTING_TENDON, TENDON, colour_limits, colour_map
from cosim.results.result import Result
from cosim.results.scene import decimate, rebuild_finger
from cosim.results.strokes import LIFT, families_of, stroke_cells, strokes
from meshes.hood_mesh import REGIONS

MOST_TRIANGLES = 1800
"""Triangles of a bone in the view, at most."""
NO_HOOD = "This run has no deformable hood: there is no strain to show."
AT_END = "The hood is shown at its end only: this motion stored no shapes of it."
ARROW, HEAD = 18e-3, 2e-3
"""m, of the largest fingertip force, and how far its head reaches beyond it on any side."""
WITHIN = 3e-3
"""m of a node of the sheet, in which a point is seen on its map and raised over it in space."""
ROOM = 2e-3
"""m, between what a view shows and the sides of its box."""


@dataclass(frozen=True)
class SheetField:
    """Values over the hood for each of its shapes (nf, m): on cells, or on points."""

    key: str
    label: str
    unit: str
    on_quads: bool
    values: Array
    is_signed: bool = False
    """Whether its colours are centred on zero."""


@dataclass(frozen=True)
class Sheet:
    """The hood at `at`, some of a view's frames."""

    quads: np.ndarray
    region: tuple[str, ...]
    """The name of the region of each quad."""
    flat: Array
    """(n, 2) m, laid out."""
    at: tuple[int, ...]
    points: Array
    """(nf, n, 3) m."""
    fields: tuple[SheetField, ...]
    fibres: tuple[Array, ...] = ()
    """The ends (nf, k, 2, 3) m of strokes along each fibre family."""


@dataclass(frozen=True)
class Net:
    """A hood of cables at `at`, some of a view's frames."""

    cells: np.ndarray
    """(m, 2) nodes."""
    names: tuple[str, ...]
    """The name of the cable of each cell."""
    at: tuple[int, ...]
    points: Array
    """(nf, n, 3) m."""
    fields: tuple[SheetField, ...]


@dataclass(frozen=True)
class Dots:
    """The points and gauges of the user's on the hood."""

    names: tuple[str, ...]
    position: Array
    """(nf, k, 3) m in every frame of the view."""
    flat: Array
    """(k, 2) m on the sheet laid out; not a number where the sheet is not near."""
    gauges: Mapping[str, tuple[int, int]]
    """The ends of each gauge, places among `names`."""
    words: Mapping[str, str]
    """What there is to say of each point and gauge, where more than its name."""


@dataclass(frozen=True)
class BoneSurface:
    """A surface in its body's frame, and where it stands in every frame: (nf, 3), (nf, 3, 3)."""

    name: str
    vertices: Array
    faces: np.ndarray
    position: Array
    rotation: Array


@dataclass(frozen=True)
class View:
    """A run to look at, m and N, world frame; what it lacks is said in `notes`."""

    name: str
    frames: tuple[str, ...]
    times: tuple[float, ...]
    """s, of a motion; empty at rest."""
    bones: tuple[BoneSurface, ...]
    tendons: tuple[Mapping[str, Array], ...]
    """For each frame the points (k, 3) of every path."""
    tension: tuple[Mapping[str, float], ...]
    """For each frame N by tendon."""
    slips: tuple[Mapping[str, float], ...]
    """For each frame N by slip, of `slip_forces`."""
    tip: Array
    """(nf, 3); empty where the finger could not be rebuilt."""
    force: Array
    """(nf, 3) of the fingertip on the world."""
    joints: tuple[str, ...]
    angles: Array
    """(nf, nq) rad."""
    sheet: Sheet | None
    net: Net | None
    dots: Dots | None
    notes: tuple[str, ...]
    hand: Hand = "right"

    def in_own_frame(self) -> View:
        """Return the view as it is to be shown in space: of a left hand its mirror image."""
        if self.hand == "right":
            return self
        turn = np.outer(*2 * [mirror(np.ones(3))])
        bones = tuple(
            replace(
                b,
                vertices=mirror(b.vertices),
                faces=b.faces[:, ::-1],
                position=mirror(b.position),
                rotation=turn * b.rotation,
            )
            for b in self.bones
        )
        return replace(
            self,
            bones=bones,
            tendons=tuple({k: mirror(p) for k, p in paths.items()} for paths in self.tendons),
            tip=mirror(self.tip),
            force=mirror(self.force),
            sheet=self.sheet
            and replace(
                self.sheet,
                points=mirror(self.sheet.points),
                fibres=tuple(map(mirror, self.sheet.fibres)),
            ),
            net=self.net and replace(self.net, points=mirror(self.net.points)),
            dots=self.dots and replace(self.dots, position=mirror(self.dots.position)),
            hand="right",
        )

    @property
    def fields(self) -> tuple[SheetField, ...]:
        """What colours its hood."""
        hood = self.sheet or self.net
        return () if hood is None else hood.fields


def view_of(run: Result) -> View:
    """The run in each of its frames, in memory or read.

    Raises InputError where files of a run that was read cannot be."""
    frames = run.frames
    steps = [frame.step for frame in frames]
    sheet, net, notes = _hood(run, frames)
    slips = slip_forces(run.arrays)
    view = View(
        name=run.name,
        frames=tuple(frame.label for frame in frames),
        times=tuple(frame.time for frame in frames if frame.time is not None),
        bones=(),
        tendons=tuple({} if f.hood is None else f.hood.lines for f in frames),
        tension=tuple(_tensions(run, step) for step in steps),
        slips=tuple({n: float(f[k]) for n, f in slips.items()} for k in steps),
        tip=np.zeros((0, 3)),
        force=np.array([frame.force for frame in frames]),
        joints=tuple(map(str, run.arrays.coordinates["joint"].values)),
        angles=np.array([frame.angles for frame in frames]),
        sheet=sheet,
        net=net,
        dots=_dots(run, steps, sheet),
        notes=notes,
        hand=run.hand,
    )
    try:
        return _with_finger(view, run.checked_case())
    except InputError as error:
        note = f"Bones and tendons are not shown: the case cannot be built again here ({error})"
        return replace(view, notes=(*notes, note))


def _tensions(run: Result, step: int) -> dict[str, float]:
    pairs = (("tension", "tendon"), ("own_tension", "muscle"))
    return {
        str(name): float(value)
        for variable, dim in pairs
        if variable in run.arrays.variables
        for name, value in zip(
            run.arrays.coordinates[dim].values,
            run.arrays.variables[variable].values[step],
            strict=True,
        )
    }


def slip_forces(arrays: Arrays) -> dict[str, Array]:
    """The force (n,) N that each slip puts on the bone at its end, with its suture, in every state
    or time; none of a hood without slips."""
    if "hood_force" not in arrays.variables:
        return {}
    sources = [str(name) for name in arrays.coordinates["source"].values]
    force = arrays.variables["hood_force"].values
    by = {s: [i for i, n in enumerate(sources) if n in (s, f"suture_{s}")] for s in SLIPS}
    return {
        name.replace("_", " "): np.linalg.norm(force[:, :, i].sum(axis=2), axis=-1).sum(axis=1)
        for name, i in by.items()
        if i
    }


def _with_finger(view: View, case: Case) -> View:
    """Bones, tendons and fingertip, from the joint angles.  Raises InputError."""
    rebuilt = rebuild_finger(case, view.angles)
    bones = []
    for body, surface in rebuilt.bones.items():
        vertices, faces = decimate(*surface, most=MOST_TRIANGLES)
        poses = [motion.of(body) for motion in rebuilt.motions]
        position, rotation = (np.stack(part) for part in zip(*poses, strict=True))
        bones.append(BoneSurface(body, vertices, faces, position, rotation))
    pairs = zip(view.tendons, rebuilt.tendons, strict=True)
    paths = tuple({**drawn, **lines} for drawn, lines in pairs)
    return replace(view, bones=tuple(bones), tendons=paths, tip=np.array(rebuilt.tips))


def _hood(run: Result, frames: Sequence[Frame]) -> tuple[Sheet | None, Net | None, tuple[str, ...]]:
    """The hood in every frame where the run stored it, as a sheet or a net, and what to note."""
    shapes = [(k, frame.hood) for k, frame in enumerate(frames) if frame.hood is not None]
    if not shapes:
        return None, None, (NO_HOOD,)
    at, hoods = tuple(k for k, _ in shapes), [hood for _, hood in shapes]
    first, points = hoods[0], np.array([hood.points for hood in hoods])
    fields = tuple(_fields(hoods))
    notes = (AT_END,) if len(at) < len(frames) else ()
    if first.quads.shape[1] == 2:
        return None, Net(first.quads, _cables(run, first), at, points, fields), notes
    stated = first.cell_data.get("region")
    region = (
        ("hood",) * len(first.quads) if stated is None else tuple(REGIONS[int(i)] for i in stated)
    )
    flat = flatten_sheet(first.points - first.point_data["displacement"], first.quads)
    sheet = Sheet(first.quads, region, flat, at, points, fields, _fibres(hoods))
    return sheet, None, notes


def _fields(hoods: Sequence[HoodField]) -> Sequence[SheetField]:
    """What can colour the hood in all of its shapes."""
    return [
        SheetField(
            colour.key,
            colour.label,
            colour.unit,
            colour.on_mesh in hoods[0].cell_data,
            np.array([colour.values(hood) for hood in hoods]),
            colour.is_signed,
        )
        for colour in colours_of(hoods[-1])
        if all(colour in colours_of(hood) for hood in hoods)
    ]


def _cables(run: Result, hood: HoodField) -> tuple[str, ...]:
    """The name of the cable of each cell."""
    named = run.arrays.coordinates.get("strand")
    if named is not None:
        return tuple(str(name).replace("_", " ") for name in named.values)
    strand = hood.cell_data.get("strand", np.arange(len(hood.quads)))
    return tuple(f"cable {int(i) + 1}" for i in strand)


def _fibres(hoods: Sequence[HoodField]) -> tuple[Array, ...]:
    """Strokes along the fibre families of a hood in its shapes (nf, n, 3) m."""
    families = [families_of(hood.cell_data) for hood in hoods]
    if not families[0]:
        return ()
    quads = hoods[0].quads
    cells = stroke_cells(hoods[-1].points, quads)
    return tuple(
        np.stack(
            [
                strokes(hood.points, quads[cells], by_family[i][cells])
                for hood, by_family in zip(hoods, families, strict=True)
            ]
        )
        for i in range(len(families[0]))
    )


def _dots(run: Result, steps: Sequence[int], sheet: Sheet | None) -> Dots | None:
    """The user's points where the run has them."""
    stored = run.arrays.variables.get("hood_point_position")
    if stored is None:
        return None
    names = tuple(map(str, run.arrays.coordinates["hood_point"].values))
    position = np.asarray(stored.values)[list(steps)]
    flat = np.full((len(names), 2), np.nan)
    if sheet is not None:
        corners = sheet.quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
        shape, there = sheet.points[0], position[sheet.at[0]]
        gap = np.linalg.norm(there[:, None] - shape, axis=2).min(axis=1)
        near = np.flatnonzero(gap < WITHIN)
        placed = place_gauges({names[i]: there[i] for i in near}, {}, shape, corners)
        flat[near] = np.einsum("kc,kcj->kj", placed.weights, sheet.flat[placed.nodes])
        for k, points in zip(sheet.at, sheet.points, strict=True):
            first, second, third = points[placed.nodes].swapaxes(0, 1)
            normal = np.cross(second - first, third - first)
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
            position[k, near] += 2 * LIFT * normal
    stated = run.case_table.get("hood", {}).get("gauges", {})
    gauges = {
        name: (names.index(a), names.index(b))
        for name, (a, b) in stated.items()
        if a in names and b in names
    }
    return Dots(names, position, flat, gauges, dots_in_words(run))


def difference_view(one: View, other: View) -> View | None:
    """`one` coloured by its fields less those of `other`, in the frames whose names, but for what
    gave way, both have; None where the two hoods are not the same mesh or no frame is shared."""
    a, b = one.sheet, other.sheet
    if a is None or b is None or not np.array_equal(a.quads, b.quads):
        return None
    ours, others = ([f.partition(" (")[0] for f in view.frames] for view in (one, other))
    theirs = {others[at]: k for k, at in enumerate(b.at)}
    pairs = [(k, theirs[ours[at]]) for k, at in enumerate(a.at) if ours[at] in theirs]
    if not pairs:
        return None
    mine, its = (np.array(part) for part in zip(*pairs, strict=True))
    theirs_by_key = {g.key: g for g in b.fields}
    fields = tuple(
        replace(
            f,
            label=f"{f.label}, difference",
            is_signed=True,
            values=f.values[mine] - theirs_by_key[f.key].values[its],
        )
        for f in a.fields
        if f.key in theirs_by_key
    )
    sheet = replace(a, at=tuple(a.at[k] for k in mine), points=a.points[mine], fields=fields)
    name = f"{one.name} less {other.name}"
    note = f"Shape and bones are those of {one.name}; colours are {name}."
    return replace(one, name=name, sheet=sheet, notes=(note,))


def arrow_ends(view: View) -> Array:
    """Where the arrow of the fingertip force ends (nf, 3) m; empty as `View.tip` is."""
    if not len(view.tip):
        return view.tip
    most = float(np.linalg.norm(view.force, axis=1).max())
    return view.tip + ARROW * view.force / (most or 1.0)


def box(view: View) -> Array | None:
    """The least and the greatest coordinate (3, 2) m of all that the view shows in any frame, and
    some room; None where it shows nothing."""
    ends = arrow_ends(view)
    shown = [
        *(b.vertices @ b.rotation.swapaxes(1, 2) + b.position[:, None] for b in view.bones),
        *(path for paths in view.tendons for path in paths.values()),
        *([] if view.sheet is None else [view.sheet.points, *view.sheet.fibres]),
        *([] if view.net is None else [view.net.points]),
        *([] if view.dots is None else [view.dots.position]),
        *(view.tip, ends - HEAD, ends + HEAD),
    ]
    points = np.concatenate([np.reshape(part, (-1, 3)) for part in shown])
    if not len(points):
        return None
    return np.stack([points.min(axis=0) - ROOM, points.max(axis=0) + ROOM], axis=1)


def limits(views: Sequence[View]) -> dict[str, tuple[float, float]]:
    """A colour scale for each field that all views share; a few extreme cells do not set it."""
    by_field: dict[str, list[SheetField]] = {}
    for field in (f for view in views for f in view.fields):
        by_field.setdefault(field.key, []).append(field)
    return {
        key: colour_limits(np.concatenate([f.values.ravel() for f in every]), every[0].is_signed)
        for key, every in by_field.items()
    }


def pack_views(views: Sequence[View], scales: Sequence[Mapping[str, tuple[float, float]]]) -> Any:
    """The views for scene.js: mm, N, degrees; surfaces that views share are sent once."""
    surfaces: dict[str, Any] = {}
    shown = [_pack_view(view, scale, surfaces) for view, scale in zip(views, scales, strict=True)]
    return {
        "views": shown,
        "surfaces": list(surfaces.values()),
        "maps": {"signed": colour_map(True), "plain": colour_map(False)},
        "inks": {"tendon": TENDON, "resting": RESTING_TENDON, "force": FORCE},
    }


def _pack_view(
    view: View, scale: Mapping[str, tuple[float, float]], surfaces: dict[str, Any]
) -> Any:
    hand, force, view = view.hand, view.force, view.in_own_frame()
    bones = []
    for bone in view.bones:
        surface = {"v": floats(1e3 * bone.vertices), "f": integers(bone.faces)}
        surfaces.setdefault(surface["v"]["b"] + surface["f"]["b"], surface)
        which = list(surfaces).index(surface["v"]["b"] + surface["f"]["b"])
        pose = np.concatenate([1e3 * bone.position[..., None], bone.rotation], axis=2)
        label = bone.name if bone.name == "metacarpal" else f"{bone.name} phalanx"
        bones.append({"label": label, "surface": which, "pose": floats(pose)})
    lines = [np.concatenate([*paths.values()]) for paths in view.tendons if paths]
    counts = [[len(points) for points in paths.values()] for paths in view.tendons]
    room = box(view)
    return {
        "name": view.name,
        "frames": view.frames,
        "times": view.times,
        "bones": bones,
        "tendons": {
            "points": floats(1e3 * np.concatenate(lines)) if lines else None,
            "counts": counts,
            "names": [[name.replace("_", " ") for name in paths] for paths in view.tendons],
            "tension": view.tension,
        },
        "box": None if room is None else (1e3 * room).tolist(),
        "tip": floats(1e3 * view.tip),
        "arrow": floats(1e3 * arrow_ends(view)),
        "force": force.tolist(),
        "hand": hand,
        "slips": view.slips,
        "notes": view.notes,
        "joints": [joint.replace("_", " ") for joint in view.joints],
        "angles": np.rad2deg(view.angles).tolist(),
        "sheet": None if view.sheet is None else _pack_sheet(view.sheet, scale),
        "net": None if view.net is None else _pack_net(view.net, scale),
        "dots": None if view.dots is None else _pack_dots(view.dots),
    }


def _pack_sheet(sheet: Sheet, scale: Mapping[str, tuple[float, float]]) -> Any:
    names = sorted(set(sheet.region))
    return {
        "quads": integers(sheet.quads),
        "regions": [name.replace("_", " ") for name in names],
        "region": [names.index(name) for name in sheet.region],
        "flat": floats(1e3 * sheet.flat),
        "at": sheet.at,
        "points": floats(1e3 * sheet.points),
        "fields": _pack_fields(sheet.fields, scale),
        "fibres": [
            {"ink": ink, "ends": floats(1e3 * ends)}
            for ink, ends in zip(INKS, sheet.fibres, strict=False)
        ],
    }


def _pack_net(net: Net, scale: Mapping[str, tuple[float, float]]) -> Any:
    return {
        "cells": integers(net.cells),
        "names": net.names,
        "at": net.at,
        "points": floats(1e3 * net.points),
        "fields": _pack_fields(net.fields, scale),
    }


def _pack_fields(
    fields: Sequence[SheetField], scale: Mapping[str, tuple[float, float]]
) -> list[Any]:
    return [
        {
            "key": field.key,
            "label": field.label,
            "unit": field.unit,
            "onQuads": field.on_quads,
            "limits": scale[field.key],
            "map": "signed" if field.is_signed else "plain",
            "values": floats(field.values),
        }
        for field in fields
    ]


def _pack_dots(dots: Dots) -> Any:
    flat = 1e3 * dots.flat
    return {
        "names": [name.replace("_", " ") for name in dots.names],
        "words": [dots.words.get(name, name.replace("_", " ")) for name in dots.names],
        "position": floats(1e3 * dots.position),
        "flat": [[float(x), float(y)] if np.isfinite(x) else None for x, y in flat],
        "gauges": [
            {"name": name.replace("_", " "), "ends": ends, "words": dots.words.get(name, "")}
            for name, ends in dots.gauges.items()
        ],
    }
