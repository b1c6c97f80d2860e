"""What Buchner, Hines and Hemami 1988 found in their finger's flexion, and what is found here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from cosim.errors import ConvergenceError
from rigid.hoods.two_band import MUSCLES, Entry
from rigid.papers.buchner1988.coordination import (
    ControlLoop,
    CoordinatedMotion,
    Forces,
    crossing,
    flex,
    share_forces,
    share_forces_at,
)

ED, FDP, FDS, INT, LUM = range(len(MUSCLES))
CHANGE = 0.2
"""Relative change, both ways, of an entry of table 1 that is not certain."""


class Finding(NamedTuple):
    """A number of the paper's beside ours; `about`: the paper says "about", or it is read off."""

    what: str
    unit: str
    paper: float
    ours: float
    about: bool
    where: str


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


def findings(f: Flexion) -> tuple[Finding, ...]:
    """Every number that the paper states of this flexion."""
    one, two, end = f.linear.muscles, f.quadratic.muscles, f.quadratic.bands[-1]
    fall, ends = two[0] - two[-1], np.degrees(f.motion.angle[-1])
    swap = one[:, FDS] - one[:, INT]
    lead = f.quadratic.bands[:, 1] - f.quadratic.bands[:, 0]
    rest = two[:, [FDS, INT, LUM]].max()
    return (
        Finding("PIP at the end", "deg", 110.0, float(ends[1]), True, "5"),
        Finding("DIP at the end", "deg", 73.0, float(ends[2]), True, "5"),
        Finding(
            "linear: FDS gives way to Int", "s", 0.22, crossing(f.motion.time, swap), True, "8"
        ),
        Finding("linear: Lum, most", "N", 0.0, float(one[:, LUM].max()), False, "8"),
        Finding("linear: Int at the end", "N", 18.0, float(one[-1, INT]), True, "8"),
        Finding("linear: FDP at the end", "N", 9.5, float(one[-1, FDP]), True, "8"),
        Finding("linear: ED at the end", "N", 26.4, float(one[-1, ED]), False, "9"),
        Finding(
            "linear: middle band at the end", "N", 13.2, float(f.linear.bands[-1, 0]), False, "9"
        ),
        Finding("quadratic: ED falls by", "N", 7.5, float(fall[ED]), True, "11"),
        Finding("quadratic: FDP falls by", "N", 3.5, float(fall[FDP]), True, "11"),
        Finding("quadratic: FDS, Int, Lum, most", "N", 0.0, float(rest), False, "text"),
        Finding("quadratic: bands cross", "s", 0.22, crossing(f.motion.time, lead), True, "12"),
        Finding(
            "quadratic: middle band's share",
            "%",
            72.0,
            100 * float(end[0] / end.sum()),
            False,
            "14",
        ),
        Finding(
            "quadratic: lateral band's share",
            "%",
            28.0,
            100 * float(end[1] / end.sum()),
            True,
            "14",
        ),
    )


def feasible(loop: ControlLoop, motion: CoordinatedMotion) -> float:
    """Part of a motion's samples at which the linear programme finds forces."""
    return float(np.mean([_is_feasible(loop, motion, k) for k in range(len(motion.time))]))


def _is_feasible(loop: ControlLoop, motion: CoordinatedMotion, k: int) -> bool:
    try:
        share_forces_at(loop, motion, k, "linear")
    except ConvergenceError:
        return False
    return True


def table_sensitivity(f: Flexion) -> dict[tuple[str, str], tuple[tuple[Finding, ...], ...]]:
    """Findings with each entry of table 1 that is not certain made smaller and larger by CHANGE; by
    muscle and joint.  None of these entries plays a part in the motion."""
    out = {}
    for key, entry in f.loop.table.items():
        if entry.certainty != "certain":
            both = (_scale(entry, 1 - CHANGE), _scale(entry, 1 + CHANGE))
            out[key] = tuple(_with(f, {**f.loop.table, key: changed}) for changed in both)
    return out


def _with(f: Flexion, table: Mapping[tuple[str, str], Entry]) -> tuple[Finding, ...]:
    loop = replace(f.loop, table=table)
    one, two = share_forces(loop, f.motion, "linear"), share_forces(loop, f.motion, "quadratic")
    return findings(Flexion(loop, f.motion, one, two))


def _scale(entry: Entry, factor: float) -> Entry:
    return replace(entry, radius=factor * entry.radius, slope=factor * entry.slope)
