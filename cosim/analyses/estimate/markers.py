"""Joint angles over time from markers that cameras saw on a finger."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cosim.analyses.estimate.joint_motion import JointMotion, as_motion, read_motion
from cosim.errors import ConvergenceError, InputError, Progress, ReadingWarning, nearest_names
from cosim.hoods.shell.point_table import read_points
from cosim.port import Array, Finger
from cosim.text_tables import read_csv
from rigid.chain.pose import BodyMarkers, estimate
from rigid.chain.statics import ChainFinger
from rigid.opensim.sto import MarkerMotion, read_trc

ON_BASE = 3
"""Markers that place the body that carries the finger."""
FLAT = 1e-2
"""Least spread of those to the side of their line, of that along it."""
FAR = 0.02
"""m, root of the mean square: markers that are farther off are not on this finger; soft tissue
moves them by a few mm."""
UNSEEN = 1e-4
"""m per rad; angles that move no marker by more are not to be seen from them."""


@dataclass(frozen=True)
class SeenMotion:
    """Angles (nt, nq) rad at times (nt,) s, and by how far the markers miss the finger's, m: root
    of the mean square in each frame (nt,)."""

    time: Array
    angle: Array
    miss: Array


def read_seen_motion(
    path: Path, markers: Path, finger: Finger, posture: Mapping[str, float]
) -> SeenMotion:
    """The joint angles that a .trc shows, of markers that a table places on the finger.

    `markers` is a .csv with columns name, body, and distal, radial and dorsal with a unit: places
    on the straight finger (all angles zero), in the world's axes from the MCP joint's centre.  In
    each frame the markers of the first body place the finger in the laboratory; the angles are
    those that bring the others nearest.  A joint that no marker shows stays at its angle of
    `posture` (rad).  Raises InputError, and ConvergenceError where a pose is not found."""
    if not isinstance(finger, ChainFinger):
        raise InputError(f"{path}: markers need a finger with bodies; an FMU's has none")
    seen = read_trc(path)
    glued, columns = _glued(markers, finger, seen)
    angle = np.array([posture.get(joint, 0.0) for joint in finger.joints])
    free = _shown(glued, finger, angle)
    angles, misses = [], []
    for time, frame in zip(seen.time, seen.place[:, columns], strict=True):
        there = np.isfinite(frame).all(axis=1)
        base = there & (glued.body == 0)
        turn, shift = _place_base(glued.place[base], frame[base], f"{path}, {time:g} s")
        moving = there & (glued.body > 0)
        part = BodyMarkers(glued.body[moving], glued.place[moving])
        if (told := _told_apart(part, finger, angle)) < free.sum():
            raise InputError(
                f"{path}, {time:g} s: the {moving.sum()} markers that are seen beyond the first "
                f"body tell {told} of {free.sum()} angles apart; fill the gaps of the capture, or "
                "put more markers on the finger"
            )
        try:
            fit = estimate(finger, part, (frame[moving] - shift) @ turn, angle)
        except ConvergenceError as error:
            raise ConvergenceError(f"{path}, {time:g} s: {error}") from error
        angle = np.where(free, fit.angle, angle)
        angles.append(angle)
        misses.append(fit.residual)
    return SeenMotion(seen.time, np.array(angles), np.array(misses))


def read_any_motion(
    path: Path,
    markers: Path | None,
    finger: Finger,
    posture: Mapping[str, float],
    samples: int | None,
    cutoff: float | None,
    progress: Progress,
) -> JointMotion:
    """A motion as `read_motion` takes it, of angles, or with `markers` of a .trc as
    `read_seen_motion` does, by how much the markers miss the finger told.

    Raises InputError and ConvergenceError."""
    if (markers is None) == (path.suffix.lower() == ".trc"):
        raise InputError(f"{path}: markers on the finger belong to a .trc, and that to them")
    if markers is None:
        return read_motion(path, finger.joints, posture, samples, cutoff)
    progress("finding the angles that the markers show")
    seen = read_seen_motion(path, markers, finger, posture)
    k = int(np.argmax(seen.miss))
    miss = float(np.sqrt(np.mean(seen.miss**2)))
    progress(
        f"the markers are {1e3 * miss:.2g} mm off the finger's in the mean, "
        f"{1e3 * seen.miss[k]:.2g} mm at most, at {seen.time[k]:g} s"
    )
    if miss > FAR:
        raise InputError(
            f"{path}: its markers are {1e3 * miss:.3g} mm off those of {markers} in the mean, where"
            " the finger comes nearest to them. Is the unit of both right (Units in line 3 of the "
            ".trc), do the names mean the same places, is the finger as long (finger.length_scale)?"
        )
    motion = as_motion(path, seen.time, seen.angle, samples, cutoff)
    return replace(motion, markers_miss=miss)


def _glued(table: Path, finger: ChainFinger, seen: MarkerMotion) -> tuple[BodyMarkers, list[int]]:
    """The markers that the table places and the trial has, and their columns in the trial."""
    places = read_points(table, ("body",))
    rows = read_csv(table, "name,body,distal_mm,radial_mm,dorsal_mm").rows
    body_of = {row.cells["name"]: (row.place, row.cells.get("body", "")) for row in rows}
    for place, said in body_of.values():
        if said not in finger.bodies:
            raise InputError(
                f"{place}: body is {said!r}; expected one of {', '.join(finger.bodies)}"
            )
    names = [name for name in places if name in seen.names]
    if not names:
        near = nearest_names(next(iter(places)), seen.names, 3) or seen.names[:6]
        raise InputError(f"{table}: the trial has none of its markers; it has {', '.join(near)}")
    if lacking := [name for name in places if name not in names]:
        warnings.warn(
            f"{table}: the trial has no marker {', '.join(lacking)}", ReadingWarning, stacklevel=3
        )
    body = np.array([finger.bodies.index(body_of[name][1]) for name in names])
    motion = finger.chain(np.zeros(len(finger.joints))).motion
    away = np.array([places[name] for name in names]) - motion.position[body]
    inside = np.einsum("mji,mj->mi", motion.rotation[body], away)
    return BodyMarkers(body, inside), [seen.names.index(name) for name in names]


def _told_apart(glued: BodyMarkers, finger: ChainFinger, angle: Array) -> int:
    """How many combinations of the angles move the markers."""
    jacobian = glued.at(finger, angle)[1].reshape(-1, len(angle))
    return int(np.linalg.matrix_rank(jacobian, UNSEEN)) if len(jacobian) else 0


def _shown(glued: BodyMarkers, finger: ChainFinger, angle: Array) -> Array:
    """Whether each joint moves a marker."""
    jacobian = glued.at(finger, angle)[1]
    shown: Array = np.abs(jacobian).max(axis=(0, 1), initial=0.0) > UNSEEN
    return shown


def _place_base(model: Array, seen: Array, place: str) -> tuple[Array, Array]:
    """Rotation and shift from the finger's world to the laboratory that bring markers nearest
    (Kabsch 1976, Acta Cryst A32:922).  Raises InputError for fewer than three, or in a line."""
    if len(model) >= ON_BASE:
        middle, seen_middle = model.mean(axis=0), seen.mean(axis=0)
        left, size, right = np.linalg.svd((seen - seen_middle).T @ (model - middle))
        if size[1] > FLAT**2 * size[0]:
            mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
            turn = left @ mirror @ right
            return turn, seen_middle - turn @ middle
    raise InputError(
        f"{place}: {len(model)} markers of the first body are seen; at least {ON_BASE} that are "
        "not in a line place the finger in the laboratory"
    )
