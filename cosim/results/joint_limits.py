"""What bears what muscles and hood leave over: limits at which joints stand, and ties."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from cosim.case.schema import Case
from cosim.port import Array

AT_LIMIT = float(np.radians(0.1))
"""A joint nearer than that to a limit, or beyond it, stands at it."""
BEYOND = float(np.radians(10.0))
"""A joint further beyond its range of motion than this stands where no finger can."""
HYPEREXTENDED = dict.fromkeys(("PIP", "DIP"), float(np.radians(25.0)))
"""The same below a joint's range: a boutonniere finger's DIP stands 15 deg in hyperextension, and
so does a swan neck's PIP."""
Limits = Mapping[str, Sequence[tuple[float, float]]]
"""rad by joint, the lower and the upper end of each kind of limit."""


def limits_of(case: Case, ranges: Mapping[str, tuple[float, float]]) -> Limits:
    """The limits of a case's joints: the coordinate limit or a splint, which makes a torque, then
    the range of motion (rad), which makes none.  None of joints that the case holds, and of a
    finger in an FMU."""
    if not case.finger.is_native:
        return {}
    finger = case.native_finger()
    if finger.tip.kind == "posture":
        return {}
    posture, limit = finger.posture.angles(), finger.limit
    half = None if limit is None else limit.half_range
    about = {} if half is None else {j: (q - half, q + half) for j, q in posture.items()}
    worn = {j: s.range or (posture[j],) * 2 for j, s in finger.splint.items() if not s.has_times}
    about |= worn
    return {j: [about[j], r] if j in about else [r] for j, r in ranges.items()}


def is_in_range(
    joints: Sequence[str], angles: Array, ranges: Mapping[str, tuple[float, float]]
) -> bool:
    """Whether no joint stands further beyond its range of motion (rad) than a limit lets it, in a
    posture (nq,) rad or in any of several (n, nq)."""
    by_joint = dict(zip(joints, np.atleast_2d(angles).T, strict=True))
    return all(
        by_joint[joint].min() >= low - HYPEREXTENDED.get(joint, BEYOND)
        and by_joint[joint].max() <= high + BEYOND
        for joint, (low, high) in ranges.items()
    )


def limit_at(angle: float, limits: Sequence[tuple[float, float]]) -> tuple[float, float] | None:
    """The first of a joint's limits (rad) at which the angle (rad) stands, and how far beyond it
    that is; None where it stands at none."""
    for low, high in limits:
        for end, beyond in ((low, low - angle), (high, angle - high)):
            if beyond >= -AT_LIMIT:
                return end, beyond
    return None


def joints_at_limit(
    limits: Limits, angles: Mapping[str, float], torque: Mapping[str, float]
) -> dict[str, dict[str, float]]:
    """The block `joints_at_limit` of an equilibrium, empty where no joint stands at a limit: by
    joint the limit, the angle, and the torque of the limit on it; angles rad, torques N m."""
    met = {j: limit_at(angles[j], ends) for j, ends in limits.items() if j in angles}
    return {
        joint: _entry(at[0], angles[joint], torque.get(joint, 0.0))
        for joint, at in met.items()
        if at is not None
    }


def joints_ever_at_limit(
    limits: Limits,
    joints: Sequence[str],
    times: Sequence[float],
    angles: Array,
    torque: Callable[[int], Array],
) -> dict[str, dict[str, float]]:
    """The block `joints_at_limit` of a motion with angles (nt, nq) rad at times (nt,) s: of each
    joint that came to a limit as in an equilibrium, where it was farthest beyond the first that it
    came to; and when it came there.  `torque` gives the limits' (nq,) N m on the joints at the time
    of an index."""
    out = {}
    for j, joint in enumerate(joints):
        at = [limit_at(angle, limits.get(joint, ())) for angle in angles[:, j].tolist()]
        reached = [(i, *at_limit) for i, at_limit in enumerate(at) if at_limit is not None]
        if reached:
            first, limit, _ = reached[0]
            _, far = max((beyond, i) for i, end, beyond in reached if end == limit)
            entry = _entry(limit, float(angles[far, j]), float(torque(far)[j]))
            out[joint] = {**entry, "first_s": float(times[first])}
    return out


def _entry(end: float, angle: float, torque: float) -> dict[str, float]:
    return {
        "limit_deg": float(np.degrees(end)),
        "angle_deg": float(np.degrees(angle)),
        "limit_torque_Nmm": 1e3 * float(torque),
    }


def tie_block(finger: Any, angles: Array) -> dict[str, dict[str, float]]:
    """The block `tie_force_N` of a finger at joint angles (nq,) rad, empty of one without ties."""
    ties = getattr(finger, "ties", None)
    if ties is None:
        return {}
    tension = ties.pull(finger.chain(angles)).tension
    return {"tie_force_N": dict(zip(ties.names, tension.tolist(), strict=True))}


def describe_limits(summary: Mapping[str, Any]) -> Iterator[str]:
    """A sentence for each joint that stands at a limit, or in a motion came to one."""
    for joint, at in summary.get("joints_at_limit", {}).items():
        name, limit = joint.replace("_", " "), f"{at['limit_deg'] + 0.0:.4g} deg"
        angle, torque = f"{at['angle_deg'] + 0.0:.4g} deg", abs(at["limit_torque_Nmm"])
        end = f"its limit of {limit}" if torque else f"the end of its range of motion, {limit}"
        borne = f"; the limit bears {torque:.3g} N mm there" if torque else ""
        if "first_s" in at:
            yield f"{name} comes to {end}, at {at['first_s']:.4g} s, and at most to {angle}{borne}"
        else:
            yield f"{name} stands at {angle}, at {end}{borne}"
