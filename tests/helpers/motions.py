"""Settings of short motions, a motion that is interrupted, and whether two are the same."""

from __future__ import annotations

from collections.abc import Mapping

from cosim.results.result import Result

PLAIN = "output.picture=false"
FREE = (
    "finger.tip={kind='free'}",
    "finger.limit={half_range='40 deg',stiffness='20 N*m/deg',transition='5 deg',"
    "damping='0.01 N*m*s/deg'}",
    'tendons.EDC.signal={kind="points",at=[["0 s",0.02],["0.05 s",1.0]]}',
)
HELD = tuple(
    f'finger.passive.{joint}={{stiffness="0.0391 N*m/rad",rest="posture",'
    'damping="0.001 N*m*s/rad"}'
    for joint in ("MCP", "MCP_abduction", "PIP", "DIP")
)

RAMP = """
extends = "pulley_edc"
title = "EDC ramps"
output.picture = false

[finger.tip]
kind = "free"

[tendons.EDC.signal]
kind = "points"
at = [["0 s", 0.02], ["0.1 s", 1.0]]

[forward]
duration = "0.3 s"
must_rest = false
checkpoint = 7
"""
"""The case of a motion that keeps checkpoints."""


class Stopper:
    """Progress that interrupts a motion in its n-th word, as Ctrl-C does."""

    def __init__(self, words: int) -> None:
        self.left = words

    def __call__(self, text: str) -> None:
        self.left -= text.startswith("t = ")
        if not self.left:
            raise KeyboardInterrupt


def identical(a: Result, b: Result) -> bool:
    return all(
        a.data[name].values.tobytes() == b.data[name].values.tobytes()
        for name in (*a.data.data_vars, "time")
    )


DONE = ("tendons", "own_tendons", "gravity")


def work_done(energy: Mapping[str, float]) -> float:
    """mJ, by tendons and gravity."""
    return sum(energy.get(name, 0.0) for name in DONE)


def work_kept(energy: Mapping[str, float]) -> float:
    """mJ: stored, dissipated, or taken by the method."""
    return sum(value for name, value in energy.items() if name not in DONE)
