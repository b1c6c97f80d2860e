"""What the 3-D view and the strain maps draw, frame by frame."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.case.file import case_of, load_case
from cosim.case.schema import Case
from cosim.errors import InputError
from cosim.hoods.kinds import COLOURS
from cosim.hoods.view import Colour, HoodField
from cosim.port import Array
from cosim.report.flat import flatten_sheet
from cosim.results.looks import INKS, colour_limits
from cosim.results.result import Result
from cosim.results.scene import rebuild_finger
from cosim.results.scene_plot import decimate
from cosim.results.strokes import carry, families_of, stroke_cells, strokes
from meshes.hood_mesh import REGIONS

if TYPE_CHECKING:
    import xarray

MOST_FRAMES = 41
MOST_TRIANGLES = 2200
"""Triangles of a bone in the view, at most."""
NO_SHEET = "The hood is a net of cables, drawn as lines: it has no sheet to colour."
ARROW, HEAD = 18e-3, 2e-3
"""m, of the largest fingertip force, and how far its head reaches beyond it on any side."""
ROOM = 2e-3
"""m, between what a view shows and the sides of its box."""


@dataclass(frozen=True)
class SheetField:
    """Values over the hood for each of its shapes (nf, m): on quads, or on points."""

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
    bones: tuple[BoneSurface, ...]
    tendons: tuple[Mapping[str, Array], ...]
    """For each frame the points (k, 3) of every path."""
    tip: Array
    """(nf, 3); empty where the finger could not be rebuilt."""
    force: Array
    """(nf, 3) of the fingertip on the world."""
    joints: tuple[str, ...]
    angles: Array
    """(nf, nq) rad."""
    sheet: Sheet | None
    notes: tuple[str, ...]


def view_of(run: Result) -> View:
    """The run's frames: every state of a load axis, some of the times of a motion."""
    data, axis = run.data, run.axis
    chosen = _choose(data.sizes[axis])
    angles = data.angle.transpose(axis, "joint").values[chosen]
    force = data.tip_force.transpose(axis, "axis").values[chosen]
    net = _net(run, chosen)
    sheet, notes = (None, (NO_SHEET,)) if net else _sheet(run, chosen)
    view = View(
        run.name,
        _labels(run, chosen),
        (),
        net or ({},) * len(chosen),
        np.zeros((0, 3)),
        force,
        tuple(map(str, data.joint.values)),
        angles,
        sheet,
        notes,
    )
    try:
        return _with_finger(view, _case_of(run))
    except InputError as error:
        note = f"Bones and tendons are not shown: the case cannot be built again here ({error})"
        return replace(view, notes=(*notes, note))


def _case_of(run: Result) -> Case:
    """The case of a run, in memory or read.  Raises InputError."""
    if run.folder is not None:
        return load_case(run.folder / "case.toml")
    return case_of(run.case_table, run.case)


def _choose(count: int) -> np.ndarray:
    return np.unique(np.linspace(0, count - 1, min(count, MOST_FRAMES)).round().astype(int))


def _labels(run: Result, chosen: np.ndarray) -> tuple[str, ...]:
    values = run.data[run.axis].values[chosen]
    return tuple(f"{v:.4g} s" for v in values) if run.axis == "time" else tuple(map(str, values))


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


def _net(run: Result, chosen: np.ndarray) -> tuple[Mapping[str, Array], ...]:
    """For each frame the lines (k, 3) m of a hood of cables, which it has at its end where the run
    stored it there alone; none of another hood."""
    hood = run.hood
    if hood is None or hood.quads.shape[1] != 2:
        return ()
    cells = hood.quads
    strand = hood.cell_data.get("strand", np.zeros(len(cells), dtype=np.intp))
    breaks = np.flatnonzero((cells[1:, 0] != cells[:-1, 1]) | np.diff(strand).astype(bool)) + 1
    lines = [np.append(part[:, 0], part[-1, 1]) for part in np.split(cells, breaks)]
    if "node" not in run.data:
        bare: tuple[Mapping[str, Array], ...] = ({},) * (len(chosen) - 1)
        return (*bare, _with_names(lines, hood.points))
    frames = run.data.node.isel({run.axis: chosen}).transpose(run.axis, ...).values
    return tuple(_with_names(lines, points) for points in frames)


def _with_names(lines: Sequence[np.ndarray], points: Array) -> dict[str, Array]:
    return {f"cable {i + 1}": points[line] for i, line in enumerate(lines)}


def _sheet(run: Result, chosen: np.ndarray) -> tuple[Sheet | None, tuple[str, ...]]:
    """The hood in every frame where the run stored that, else as it was at the end."""
    hood = run.hood
    if hood is None:
        return None, ("This run has no deformable hood: there is no strain to show.",)
    reference = hood.points - hood.point_data["displacement"]
    stated = hood.cell_data.get("region")
    region = (
        ("hood",) * len(hood.quads) if stated is None else tuple(REGIONS[int(i)] for i in stated)
    )
    flat, last = flatten_sheet(reference, hood.quads), len(chosen) - 1
    if "node" in run.data:
        data = run.data.isel({run.axis: chosen}).transpose(run.axis, ...)
        shown = (_field_over_frames(data, run.axis, hood, colour) for colour in COLOURS)
        every, points = tuple(range(len(chosen))), data.node.values
        fields = tuple(field for field in shown if field is not None)
        return Sheet(hood.quads, region, flat, every, points, fields, _fibres(hood, points)), ()
    ended = (_field_at_end(hood, colour) for colour in COLOURS)
    fields = tuple(field for field in ended if field is not None)
    note = (
        "This page shows the hood of a motion at its end only. hood.pvd in the run's folder has it "
        "over time, for ParaView."
    )
    points = hood.points[None]
    fibres = _fibres(hood, points)
    return Sheet(hood.quads, region, flat, (last,), points, fields, fibres), (note,)


def _field_over_frames(
    data: xarray.Dataset, axis: str, hood: HoodField, colour: Colour
) -> SheetField | None:
    """A field in every frame; None of a run without."""
    name, component = colour.in_results
    if name not in data:
        return None
    stored = data[name].transpose(axis, ...)
    values = stored.values if component is None else stored.values[..., component]
    on_quads = "point" not in stored.dims
    if on_quads:
        values = np.repeat(values, len(hood.quads) // values.shape[1], axis=1)
    return _field_of(colour, on_quads, colour.factor * values)


def _field_at_end(hood: HoodField, colour: Colour) -> SheetField | None:
    """A field at the end of a run; None of a run without."""
    on_quads = colour.on_mesh in hood.cell_data
    stored = (hood.cell_data if on_quads else hood.point_data).get(colour.on_mesh)
    if stored is None:
        return None
    return _field_of(colour, on_quads, colour.mesh_factor * np.asarray(stored)[None])


def _field_of(colour: Colour, on_quads: bool, values: Array) -> SheetField:
    is_signed = colour.unit == "%"
    return SheetField(colour.key, colour.label, colour.unit, on_quads, values, is_signed)


def _fibres(hood: HoodField, points: Array) -> tuple[Array, ...]:
    """Strokes along the fibre families of a hood in shapes (nf, n, 3) m."""
    families = families_of(hood.cell_data)
    cells = stroke_cells(hood.points, hood.quads) if families else np.zeros(0, dtype=np.intp)
    quads = hood.quads[cells]
    return tuple(
        np.stack(
            [strokes(p, quads, carry(quads, hood.points, p, direction[cells])) for p in points]
        )
        for direction in families
    )


def difference_view(one: View, other: View) -> View | None:
    """`one` coloured by its fields less those of `other`, in the frames whose names both have;
    None where the two hoods are not the same mesh or no frame is shared."""
    a, b = one.sheet, other.sheet
    if a is None or b is None or not np.array_equal(a.quads, b.quads):
        return None
    theirs = {other.frames[at]: k for k, at in enumerate(b.at)}
    pairs = [(k, theirs[one.frames[at]]) for k, at in enumerate(a.at) if one.frames[at] in theirs]
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
        *(view.tip, ends - HEAD, ends + HEAD),
    ]
    points = np.concatenate([np.reshape(part, (-1, 3)) for part in shown])
    if not len(points):
        return None
    return np.stack([points.min(axis=0) - ROOM, points.max(axis=0) + ROOM], axis=1)


def limits(views: Sequence[View]) -> dict[str, tuple[float, float]]:
    """A colour scale for each field that all views share; a few extreme quads do not set it."""
    by_field: dict[str, list[Array]] = {}
    signed = set()
    for field in (f for view in views if view.sheet is not None for f in view.sheet.fields):
        by_field.setdefault(field.key, []).append(field.values.ravel())
<<<<<<< HEAD
        signed |= {field.key} if field.is_signed else set()
    return {key: _limits(np.concatenate(v), key in signed) for key, v in by_field.items()}


def _limits(values: Array, is_signed: bool) -> tuple[float, float]:
    low, high = (float(v) for v in np.percentile(values, SPREAD))
    if is_signed:
        most = max(-low, high, 1e-9)
        return -most, most
    return (low, high) if high > low else (low - 0.5, low + 0.5)
=======
    signed = {colour.key for colour in COLOURS if colour.is_signed}
    return {k: colour_limits(np.concatenate(v), k in signed) for k, v in by_field.items()}
>>>>>>> main


def pack_views(views: Sequence[View], scales: Sequence[Mapping[str, tuple[float, float]]]) -> Any:
    """The views for scene.js: mm, N, degrees; surfaces that views share are sent once."""
    surfaces: dict[str, Any] = {}
    shown = [_pack_view(view, scale, surfaces) for view, scale in zip(views, scales, strict=True)]
    return {"views": shown, "surfaces": list(surfaces.values()), "maps": _colour_maps()}


def _colour_maps() -> dict[str, list[str]]:
    """The colours of what has a sign and of what has none, from the least to the greatest."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    maps = {"signed": "RdBu_r", "plain": "viridis"}
    return {
        key: [to_hex(colour) for colour in colormaps[name](np.linspace(0, 1, 256))]
        for key, name in maps.items()
    }


def _pack_view(
    view: View, scale: Mapping[str, tuple[float, float]], surfaces: dict[str, Any]
) -> Any:
    bones = []
    for bone in view.bones:
        surface = {"v": floats(1e3 * bone.vertices), "f": integers(bone.faces)}
        surfaces.setdefault(surface["v"]["b"] + surface["f"]["b"], surface)
        which = list(surfaces).index(surface["v"]["b"] + surface["f"]["b"])
        pose = np.concatenate([1e3 * bone.position[..., None], bone.rotation], axis=2)
        label = f"{bone.name} {'phalanx' if bone.name != 'metacarpal' else ''}".strip()
        bones.append({"name": bone.name, "label": label, "surface": which, "pose": floats(pose)})
    lines = [np.concatenate([*paths.values()]) for paths in view.tendons if paths]
    counts = [[len(points) for points in paths.values()] for paths in view.tendons]
    room = box(view)
    return {
        "name": view.name,
        "frames": view.frames,
        "bones": bones,
        "tendons": {
            "points": floats(1e3 * np.concatenate(lines)) if lines else None,
            "counts": counts,
            "names": [list(paths) for paths in view.tendons],
        },
        "box": None if room is None else (1e3 * room).tolist(),
        "tip": floats(1e3 * view.tip),
        "arrow": floats(1e3 * arrow_ends(view)),
        "force": view.force.tolist(),
        "notes": view.notes,
        "joints": view.joints,
        "angles": np.rad2deg(view.angles).tolist(),
        "sheet": None if view.sheet is None else _pack_sheet(view.sheet, scale),
    }


def _pack_sheet(sheet: Sheet, scale: Mapping[str, tuple[float, float]]) -> Any:
    names = sorted(set(sheet.region))
    fields = [
        {
            "key": field.key,
            "label": field.label,
            "unit": field.unit,
            "onQuads": field.on_quads,
            "limits": scale[field.key],
            "map": "signed" if scale[field.key][0] == -scale[field.key][1] else "plain",
            "values": floats(field.values),
        }
        for field in sheet.fields
    ]
    return {
        "quads": integers(sheet.quads),
        "regions": names,
        "region": [names.index(name) for name in sheet.region],
        "flat": floats(1e3 * sheet.flat),
        "at": sheet.at,
        "points": floats(1e3 * sheet.points),
        "fields": fields,
        "fibres": [
            {"ink": ink, "ends": floats(1e3 * ends)}
            for ink, ends in zip(INKS, sheet.fibres, strict=False)
        ],
    }


def floats(values: Array) -> dict[str, Any]:
    """Single precision, little endian, in base64, with the shape."""
    return {"s": np.shape(values), "b": _base64(np.asarray(values, dtype="<f4"))}


def integers(values: np.ndarray) -> dict[str, Any]:
    """32 bits without sign, as `floats`."""
    return {"s": np.shape(values), "i": 1, "b": _base64(np.asarray(values, dtype="<u4"))}


def _base64(values: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")
