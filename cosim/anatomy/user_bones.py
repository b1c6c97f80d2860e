"""A user's bones, lying anywhere: read, their unit found, laid on by the packaged finger's, told
whether they are such bones at all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import cast

import numpy as np

from cosim.anatomy.bones import read_surface
from cosim.anatomy.register import Fit, lay, register
from cosim.case.file import load_case
from cosim.errors import InputError, Progress
from cosim.fingers.common import Extensor
from cosim.fingers.kinds import FINGERS, anatomy_of
from cosim.fingers.own import AnatomicalFingerConfig
from cosim.hoods.shell.table import ENDS
from cosim.port import Array, Triangles
from meshes.imported.checks import UNITS
from meshes.skeleton import BODIES, Skeleton

SIZE = (0.55, 1.6)
"""The range of a bone's length over the packaged one's."""
PROPORTION = 1.5
"""How much longer than another, against the packaged ones', a bone of one finger can be.  Of ten
hands the lengths of a phalanx vary by 6 to 9 % (SD), and their means by up to 14 % from ours."""
ALIKE = 0.011
"""Mean distance over length, after an affine fit, beyond which a bone is no such bone: phalanges
of another hand come to 0.5 to 0.8 %, another phalanx to 1.4 %."""
MIRRORED = 0.6
"""Part of the metacarpal's distance that the mirrored one may have at least."""
NEAR_OURS = 0.003
"""Mean distance over length, of a metacarpal that is its finger's beyond doubt."""
EITHER_WAY = 1.25
"""Over which the other end first fits worse."""
FLAT = 0.6
"""Share of a bone's mean section, the largest flat face at an end beyond which the bone was cut
there: ours have 0.1 to 0.5, cut by a tenth of their length 0.7 and more (a distal's tip less)."""
USUAL_NEAR, MOST_NEAR = 24, 48
"""Triangles beside each over which its normal is a mean: with 12 a face with noise of 0.3 mm is no
longer flat."""
ROUGH = 0.04e-3
"""m, mean distance after the spline from which a surface is rough: 0.01 to 0.03 of smooth ones,
0.05 to 0.08 with noise of 0.3 mm."""
MANY = 30000
"""Triangles of a surface beyond which contact with it takes minutes to prepare."""
HANDS = {"right": "left", "left": "right"}
Sizes = Mapping[str, tuple[float, float]]
"""Length from end to end and greatest width, m, by body."""
Stated = Mapping[tuple[str, str], Array]
"""What landmarks say: m in a bone's file, by body and name."""


@dataclass(frozen=True)
class Template:
    """A packaged finger, that is carried over."""

    kind: str
    base: str
    """Its case with a shell."""
    skeleton: Skeleton
    bones: Mapping[str, Triangles]
    config: AnatomicalFingerConfig


@dataclass(frozen=True)
class LaidBones:
    """A user's bones with the packaged ones laid on them."""

    surfaces: Mapping[str, Triangles]
    """m, each in its file's axes (of a left hand mirrored); of those that are not given the
    packaged one's, scaled."""
    fits: Mapping[str, Fit]
    given: tuple[str, ...]
    stated: Stated
    report: tuple[str, ...]


def kinds_with_a_hood() -> tuple[str, ...]:
    """The kinds of finger that a hood can be laid on."""
    return tuple(k for k in ENDS if issubclass(FINGERS[k].table, AnatomicalFingerConfig))


def template_of(kind: str) -> Template:
    """The packaged finger of a kind.  Raises InputError for one that no hood is laid on."""
    if kind not in kinds_with_a_hood():
        raise InputError(f"--finger-kind {kind}: expected one of {', '.join(kinds_with_a_hood())}")
    base = FINGERS[kind].table.shell_case or "base/index_finger"
    finger = load_case(f"{base}.toml").native_finger()
    anatomy = anatomy_of(finger, Extensor(lies_on_bones=True))
    assert anatomy.skeleton is not None
    config = cast(AnatomicalFingerConfig, finger)
    return Template(kind, f"{base}.toml", anatomy.skeleton, anatomy.bones, config)


def lay_bones(
    files: Mapping[str, Path],
    template: Template,
    unit: str | None,
    hand: str,
    stated: Stated,
    progress: Progress,
    sizes: Sizes = MappingProxyType({}),
) -> LaidBones:
    """Lay the packaged bones on a user's, by body.  `stated`: landmarks in the files' unit;
    `sizes`: of bones that no file holds.

    Raises InputError that lists all faults."""
    faults: list[str] = []
    report: list[str] = []
    raw = {}
    for body, path in files.items():
        surface = read_surface(path, f"{body} ({path.name})", faults, report)
        if len(surface[1]):
            raw[body] = surface
    report = [f"bones: {line}" for line in report]
    _refuse(faults)
    unit = _unit(raw, template, unit, report) if raw else "m"
    turn = np.array([1.0, 1.0, -1.0 if hand == "left" else 1.0])
    if hand == "left":
        report.append(
            "side: left, stated: solved as its mirror image; files and pictures are the left hand's"
        )
    else:
        hint = "" if stated or not raw else "; no single bone tells it"
        report.append("side: right, stated" + hint)
    surfaces = {
        body: (points * UNITS[unit] * turn, faces[:, ::-1] if hand == "left" else faces)
        for body, (points, faces) in raw.items()
    }
    landmarks = {(body, name): value * UNITS[unit] * turn for (body, name), value in stated.items()}
    fits = {}
    for body, surface in surfaces.items():
        if cut := _cut_faults(body, surface, files[body]):
            faults += cut
            continue
        progress(f"laying our {body} on yours")
        fits[body] = register(template.bones[body], surface)
        report.append(_fit_words(body, fits[body]))
        told = []
        if body == "metacarpal":
            told = _metacarpal_faults(surface, fits[body], template, hand)
        faults += told or _shape_faults(body, surface, fits[body], files[body])
    faults += _side_faults(fits, landmarks, hand)
    _refuse(faults)
    for body, fit in fits.items():
        rough, count = fit.distance["spline"][0] > ROUGH, len(surfaces[body][1])
        if rough or count > MANY:
            why = "its surface is rough (or unlike ours)" if rough else f"has {count} triangles"
            points, faces = template.bones[body]
            surfaces[body] = fit.carry(points), faces
            report.append(
                f"{body}: {why}; the hood lies on ours as the spline bends it, with the distance "
                "told above"
            )
    ours = template.bones
    ratios = {b: (x / span(ours[b]), y / width_of(ours[b])) for b, (x, y) in sizes.items()}
    stretch = np.array(
        [*(fit.stretch for fit in fits.values()), *([x, y, y] for x, y in ratios.values())]
    )
    along, across = float(stretch[:, 0].mean()), float(stretch[:, 1:].mean())
    for body in BODIES:
        if body not in surfaces:
            points, faces = ours[body]
            longer, wider = ratios.get(body, (along, across))
            surfaces[body] = points * (scale := np.array([longer, wider, wider])), faces
            some = points[:: max(1, len(points) // 300)]
            fits[body] = Fit(np.diag(scale), np.zeros(3), {}, np.inf, points, some, some * scale)
            how = "as stated" if body in sizes else "not given"
            report.append(f"{body}: {how}; ours, {longer:.3f} as long and {wider:.3f} as wide")
    return LaidBones(surfaces, fits, tuple(files), landmarks, tuple(report))


def _refuse(faults: list[str]) -> None:
    if faults:
        count = f"{len(faults)} fault" + ("s" if len(faults) > 1 else "")
        raise InputError("\n  ".join([f"the bones have {count}", *faults]))


def width_of(surface: Triangles) -> float:
    """The greatest width of a packaged bone from side to side, in its unit."""
    return float(np.ptp(surface[0][:, 1]))


def span(surface: Triangles) -> float:
    """The length of a bone along its longest principal axis, in its unit."""
    points = surface[0]
    axis = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][0]
    return float(np.ptp(points @ axis))


def flat_end(surface: Triangles) -> float:
    """The largest flat face at an end of a bone, over its mean section; normals are means over
    neighbours that face alike, so that the cut of a rough bone is flat."""
    from scipy.spatial import cKDTree

    points = surface[0] - surface[0].mean(axis=0)
    a, b, c = points[surface[1]].transpose(1, 0, 2)
    middle, normal = (a + b + c) / 3, np.cross(b - a, c - a)
    area, tree = np.maximum(np.linalg.norm(normal, axis=1) / 2, 1e-30), cKDTree(middle)
    reach = np.sqrt(USUAL_NEAR * area.sum() / np.pi / max(6000, len(area)))
    away, near = tree.query(middle, np.arange(1, MOST_NEAR + 1), distance_upper_bound=reach)
    near = np.minimum(near, len(area) - 1)  # what stands for those beyond reach weighs nothing
    at = normal[near]
    alike = np.maximum(np.einsum("nk,nmk->nm", normal, at), 0) / area[near]
    normal = np.einsum("nm,nmk->nk", np.maximum(1 - (away / reach) ** 2, 0) * alike, at)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    ends = np.flatnonzero(np.abs(normal @ np.linalg.svd(points, full_matrices=False)[2][0]) > 0.7)
    ends = ends[np.linalg.norm(middle[ends], axis=1).argsort()]  # in no file's order
    section, most = abs(np.einsum("nk,nk->", a, np.cross(b, c))) / 6 / span(surface), 0.0
    for k in ends[:: max(1, len(ends) // 300)]:
        off = np.abs((middle - middle[k]) @ normal[k])
        most = max(most, area[(normal @ normal[k] > 0.99) & (off < 0.2e-3)].sum())
    return float(most / section)


def _unit(
    raw: Mapping[str, Triangles], template: Template, stated: str | None, report: list[str]
) -> str:
    """The unit of the files.  Raises InputError where the lengths fit none, or another than is
    stated."""
    spans = {body: span(surface) for body, surface in raw.items()}
    ratio = np.array([spans[body] / span(template.bones[body]) for body in spans])
    words = ", ".join(f"{body} {length:.4g}" for body, length in spans.items())
    ours = ", ".join(f"{1e3 * span(template.bones[body]):.1f}" for body in spans)
    order = [spans[body] for body in BODIES if body in spans]
    if order != sorted(order, reverse=True):
        raise InputError(
            f"--bones: they are {words} long; each bone of a finger is shorter than the one before "
            "it. Are they in order, from the metacarpal to the distal phalanx?"
        )
    if ratio.max() > PROPORTION * ratio.min():
        raise InputError(
            f"--bones: they are {words} long, where those of our {template.kind} finger are {ours} "
            "mm: these do not belong to one finger. Is each bone whole, and of this finger?"
        )
    fitting = [u for u, m in UNITS.items() if SIZE[0] < np.median(ratio) * m < SIZE[1]]
    fitting.sort(key=lambda u: abs(np.log(np.median(ratio) * UNITS[u])))
    if not fitting or (stated is not None and stated not in fitting):
        hint = f"they would fit in {fitting[0]}: --bone-unit {fitting[0]}" if fitting else ""
        raise InputError(
            f"--bones: they are {words} long{f' as {stated}' if stated else ''}, where those of "
            f"our {template.kind} finger are {ours} mm; {hint or 'check the files and their unit'}"
        )
    unit = stated or fitting[0]
    how = "stated" if stated else "from the lengths"
    mm = ", ".join(f"{b} {1e3 * UNITS[unit] * length:.1f}" for b, length in spans.items())
    report.append(f"unit: {unit}, {how}: {mm} mm long")
    return unit


def _fit_words(body: str, fit: Fit) -> str:
    steps = ", ".join(
        f"{name} {1e3 * mean:.3f} (95 %: {1e3 * most:.3f})"
        for name, (mean, most) in fit.distance.items()
    )
    x, y, z = fit.stretch
    return (
        f"{body}: distance of our bone from yours, mm: {steps}; yours is {x:.3f} as long, {y:.3f} "
        f"as wide, {z:.3f} as deep; the other end first fits {fit.flipped:.1f} times worse"
    )


def _cut_faults(body: str, surface: Triangles, path: Path) -> list[str]:
    flat = flat_end(surface)
    if flat < FLAT:
        return []
    return [
        f"{body} ({path.name}): ends in a flat face ({100 * flat:.0f} % of its mean section), as "
        "if the scan had cut its end off; give the whole bone, or leave it out (--bone for the "
        "others): ours is then scaled in its place"
    ]


def _shape_faults(body: str, surface: Triangles, fit: Fit, path: Path) -> list[str]:
    length = span(surface)
    mean, most = fit.distance["affine"]
    if mean > ALIKE * length:
        return [
            f"{body} ({path.name}): is like no such bone: our {body}, stretched to fit, is "
            f"{1e3 * mean:.2f} mm off in the mean (95 %: {1e3 * most:.2f}). Is it this bone, whole "
            "and alone, with both its ends?"
        ]
    if fit.flipped < EITHER_WAY:
        return [
            f"{body} ({path.name}): which end is distal cannot be told (the other way round fits "
            f"{fit.flipped:.2f} times worse). Is it a {body}, with both its ends?"
        ]
    return []


def _metacarpal_faults(surface: Triangles, fit: Fit, template: Template, hand: str) -> list[str]:
    """The metacarpal's base tells the side and, where ours differ, the finger."""
    mean = fit.distance["affine"][0]
    if mean < NEAR_OURS * span(surface):
        return []
    points, faces = surface
    mirrored = lay(template.bones["metacarpal"], (points * [1, 1, -1], faces[:, ::-1]))
    if mirrored < MIRRORED * mean:
        return [
            f"metacarpal: is one of a {HANDS[hand]} hand ({1e3 * mirrored:.2f} mm off ours "
            f"mirrored, {1e3 * mean:.2f} mm off ours in the mean, for a {hand} hand as stated); "
            f"state --hand {HANDS[hand]}, or mirror the bones back: were all four mirrored?"
        ]
    for kind in kinds_with_a_hood():
        if kind == template.kind:
            continue
        other = lay(template_of(kind).bones["metacarpal"], surface)
        if other < MIRRORED * mean:
            return [
                f"metacarpal: is one of a {kind} finger ({1e3 * other:.2f} mm off that finger's, "
                f"{1e3 * mean:.2f} mm off the {template.kind} finger's in the mean); state "
                f"--finger-kind {kind}, or give this finger's bones"
            ]
    return []


def _side_faults(fits: Mapping[str, Fit], stated: Stated, hand: str) -> list[str]:
    """Whether two landmarks of a bone, dorsal and radial, lie as a right hand's do."""
    out = []
    for body, fit in fits.items():
        if (body, "dorsal") not in stated or (body, "radial") not in stated:
            continue
        middle = fit.carry(fit.template.mean(axis=0))[0]
        dorsal = (stated[body, "dorsal"] - middle) @ fit.rotation[:, 2]
        radial = (stated[body, "radial"] - middle) @ fit.rotation[:, 1]
        if dorsal < 0:
            out.append(
                f"{body}: the landmark dorsal lies on the side that our bone has palmar; check the "
                "landmarks"
            )
        elif radial < 0:
            out.append(
                f"{body}: by the landmarks dorsal and radial it is of a {HANDS[hand]} hand, stated "
                f"is {hand}: state --hand {HANDS[hand]}, or mirror this bone back"
            )
    return out
