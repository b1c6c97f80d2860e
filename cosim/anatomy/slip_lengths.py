"""The central slip's length on bones of a user's own, by what the packaged one was fitted to.

The packaged lengths were fitted so that a straight finger's slips share a pull of EDC as measured
(Lee et al. 2008, J Biomech Eng 130:051014), and that a finger at rest hardly pulls
(`cases/data/hood_fit.toml`).  Only the difference of the two lengths can be told, so the terminal
slip keeps its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cosim.case.file import load_case
from cosim.errors import ConvergenceError, Progress
from cosim.pipeline import run_case

PULL = "11.8 N"
"""EDC's tension in the experiment whose ratio of the slips the packaged hood was fitted to."""
STRAIGHT = (
    'finger.tip.kind="posture"',
    *(f"finger.posture.{joint}=0 deg" for joint in ("MCP", "MCP_abduction", "PIP", "DIP")),
    f"tendons.EDC.tension={PULL}",
    "output.picture=false",
)
MOST_SOLVES = 20
SAME_RATIO = 0.01
"""Relative, of the slips' forces to the packaged hood's."""
RANGE = (-0.5e-3, 1.5e-3)
"""m, in which the packaged length was sought, of a finger of its size."""
STEP = 0.1e-3
AT_REST = {"slip": 0.4, "torque": 3.0}
"""N and N mm: what the packaged hood was asked to have at most, at rest."""


@dataclass(frozen=True)
class SlipLengths:
    """The central slip's extra length, m, and what is said of it."""

    central: float
    is_met: bool
    """Whether the slips share a pull as the packaged hood's do."""
    solves: int
    report: tuple[str, ...]


def find_lengths(
    case: Path, base: str, start: float, size: float, progress: Progress
) -> SlipLengths:
    """Find the central slip's extra length (m) of a case anew, from `start`, so that the straight
    finger's slips share EDC's pull as on the packaged finger `base`; `size`: of the finger over
    that one's.  What cannot be met is said."""
    progress("solving the packaged hood for its slips")
    wanted = _straight(base, None)["slip_ratio"]
    low, high = (size * end for end in RANGE)
    tried: list[tuple[float, float, Mapping[str, Any]]] = []
    length, words = start, ""
    while len(tried) + 1 < MOST_SOLVES:
        try:
            summary = _straight(case, length)
        except ConvergenceError as error:
            words = f"; at {1e3 * length:.3f} mm there is no equilibrium ({error})"
            break
        off = float(np.log(summary["slip_ratio"] / wanted))
        tried.append((length, off, summary))
        progress(f"slips: central {1e3 * length:.3f} mm, ratio {summary['slip_ratio']:.3f}")
        if abs(off) < SAME_RATIO:
            break
        new = _next(tried, size)
        if not low <= new <= high and length in (low, high):
            words = f"; it would lie beyond {1e3 * low:.2f} to {1e3 * high:.2f} mm"
            break
        length = float(np.clip(new, low, high))
    if not tried:
        return SlipLengths(
            start, False, 1, (f"slips: not found{words}; scaled from the packaged hood's",)
        )
    best = min(tried, key=lambda one: abs(one[1]))
    report = [
        f"slips: central {1e3 * best[0]:+.3f} mm beyond its laid-out length (scaled from the "
        f"packaged hood's: {1e3 * start:+.3f}), found in {len(tried) + 1} solves: terminal over "
        f"central {best[2]['slip_ratio']:.3f} under {PULL} of EDC, straight; the packaged hood has "
        f"{wanted:.3f}" + (words if abs(best[1]) >= SAME_RATIO else "")
    ]
    report += _unmet(best[2])
    met = abs(best[1]) < SAME_RATIO
    return SlipLengths(best[0], met, len(tried) + 1, tuple(report))


def _straight(case: str | Path, central: float | None) -> Mapping[str, Any]:
    """The summary of a straight finger, its bones held, under EDC alone."""
    own = [] if central is None else [f"hood.extra_length.central_slip={1e3 * central!r} mm"]
    return run_case(load_case(case, [*STRAIGHT, *own])).summary


def _next(tried: list[tuple[float, float, Mapping[str, Any]]], size: float) -> float:
    """By secants; a longer central slip leaves more to the terminal one."""
    (x, y, _) = tried[-1]
    if len(tried) == 1:
        return x - size * STEP * float(np.sign(y))
    (u, v, _) = tried[-2]
    if abs(y - v) < 1e-6:
        return x
    return x - y * (x - u) / (y - v)


def _unmet(summary: Mapping[str, Any]) -> list[str]:
    """Which of the packaged hood's requirements at rest the straight finger misses."""
    rest = summary["unloaded"]
    slips = {f"{name} slip {n:.2f} N": n for name, n in rest["slip_force_N"].items()}
    torques = {
        f"{joint} {n:.1f} N mm": abs(n) for joint, n in rest["joint_torque_Nmm"]["hood"].items()
    }
    wrong = [words for words, n in slips.items() if n > AT_REST["slip"]]
    wrong += [
        words
        for words, n in torques.items()
        if n > AT_REST["torque"] and not words.startswith("MCP_abduction")
    ]
    limits = f"{AT_REST['slip']} N in a slip, {AT_REST['torque']:g} N mm about a joint"
    if wrong:
        return [f"at rest, straight: not met: {', '.join(wrong)} (at most {limits})"]
    return [f"at rest, straight: met (at most {limits})"]
