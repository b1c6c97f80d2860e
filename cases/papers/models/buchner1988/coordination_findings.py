"""Our values of what Buchner, Hines and Hemami 1988 print of their finger's flexion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from cases.papers.models.buchner1988.coordination import (
    ControlLoop,
    CoordinatedMotion,
    Forces,
    crossing,
    flex,
    share_forces,
    share_forces_at,
)
from cosim.errors import ConvergenceError
from rigid.hoods.two_band import MUSCLES, Entry

ED, FDP, FDS, INT, LUM = range(len(MUSCLES))
CHANGE = 0.2
"""Relative change, both ways, of an entry of table 1 that is not certain."""


@dataclass(frozen=True)
class Flexion:
    """A motion and what either programme makes of it."""

    loop: ControlLoop
    motion: CoordinatedMotion
    linear: Forces
    quadratic: Forces


def flexion(loop: ControlLoop | None = None, samples: int = 201) -> Flexion:
    """The loop's motion with both programmes' forces."""
    loop = ControlLoop() if loop is None else loop
    motion = flex(loop, samples)
    return Flexion(
        loop, motion, share_forces(loop, motion, "linear"), share_forces(loop, motion, "quadratic")
    )


def findings(f: Flexion) -> dict[str, float]:
    """Our value of every number that the paper states of this flexion (`buchner1988.csv`)."""
    one, two, end = f.linear.muscles, f.quadratic.muscles, f.quadratic.bands[-1]
    fall, ends = two[0] - two[-1], np.degrees(f.motion.angle[-1])
    lead = f.quadratic.bands[:, 1] - f.quadratic.bands[:, 0]
    found = {
        "PIP at the end": ends[1],
        "DIP at the end": ends[2],
        "linear: FDS gives way to Int": crossing(f.motion.time, one[:, FDS] - one[:, INT]),
        "linear: Lum, most": one[:, LUM].max(),
        "linear: Int at the end": one[-1, INT],
        "linear: FDP at the end": one[-1, FDP],
        "linear: ED at the end": one[-1, ED],
        "linear: middle band at the end": f.linear.bands[-1, 0],
        "quadratic: ED falls by": fall[ED],
        "quadratic: FDP falls by": fall[FDP],
        "quadratic: FDS, Int, Lum, most": two[:, [FDS, INT, LUM]].max(),
        "quadratic: bands cross": crossing(f.motion.time, lead),
        "quadratic: middle band's share": 100 * (end[0] / end.sum()),
        "quadratic: lateral band's share": 100 * (end[1] / end.sum()),
    }
    return {name: float(value) for name, value in found.items()}


def feasible(loop: ControlLoop, motion: CoordinatedMotion) -> float:
    """Part of a motion's samples at which the linear programme finds forces."""
    return float(np.mean([_is_feasible(loop, motion, k) for k in range(len(motion.time))]))


def _is_feasible(loop: ControlLoop, motion: CoordinatedMotion, k: int) -> bool:
    try:
        share_forces_at(loop, motion, k, "linear")
    except ConvergenceError:
        return False
    return True


def table_sensitivity(f: Flexion) -> dict[tuple[str, str], tuple[dict[str, float], ...]]:
    """Findings with each entry of table 1 that is not certain made smaller and larger by CHANGE; by
    muscle and joint.  None of these entries plays a part in the motion."""
    out = {}
    for key, entry in f.loop.table.items():
        if entry.certainty != "certain":
            both = (_scale(entry, 1 - CHANGE), _scale(entry, 1 + CHANGE))
            out[key] = tuple(_with(f, {**f.loop.table, key: changed}) for changed in both)
    return out


def _with(f: Flexion, table: Mapping[tuple[str, str], Entry]) -> dict[str, float]:
    loop = replace(f.loop, table=table)
    one, two = share_forces(loop, f.motion, "linear"), share_forces(loop, f.motion, "quadratic")
    return findings(Flexion(loop, f.motion, one, two))


def _scale(entry: Entry, factor: float) -> Entry:
    return replace(entry, radius=factor * entry.radius, slope=factor * entry.slope)
