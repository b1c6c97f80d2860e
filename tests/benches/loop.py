"""What a step of a loop of one's own costs, hood by hood."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from cosim.commands.terminal import console
from cosim.loop import Loop
from cosim.port import AffineLoad

HOODS = {
    "split": "split_edc",
    "pulleys": "pulley_edc",
    "network": "network_edc",
    "two bands": "two_band_edc",
    "reduced": "reduced_edc",
}
"""By the words for a hood, the case that has it."""
STEPS, ROUNDS = 200, 3


def bench_loop() -> dict[str, float]:
    """Print steps a second of CPU time in steps of 2 ms, and return each hood's step over one of
    the finger alone, under the same tensions and the load of the start, held.

    Raises CosimError."""
    from rich.table import Table

    table = Table("hood", "steps a second", "finger alone", "ratio")
    ratios = {}
    for hood, case in HOODS.items():
        loop = Loop(case)
        loop.reset()
        loop.step()  # compiles
        alone = _finger_alone(loop)
        step, floor = (min(_seconds(of) for _ in range(ROUNDS)) for of in (loop.step, alone))
        table.add_row(hood, f"{1 / step:.0f}", f"{1 / floor:.0f}", f"{step / floor:.1f}")
        ratios[f"step over finger alone, {hood}"] = step / floor
    console().print(table)
    return ratios


def _finger_alone(loop: Loop) -> Callable[[], object]:
    """A step of the finger, from where the loop stands."""
    finger, c = loop.models.finger, loop.state.motion.coupled
    n = 6 * len(finger.bodies)
    held = AffineLoad(c.answer.motion, c.answer.response.load.total(), np.zeros((n, n)))
    state = c.finger

    def step() -> object:
        nonlocal state
        state = finger.step(state, held, c.tension[1], loop.dt)
        return state

    return step


def _seconds(step: Callable[[], object]) -> float:
    """s of CPU time of one step, the mean of STEPS."""
    begun = time.process_time()
    for _ in range(STEPS):
        step()
    return (time.process_time() - begun) / STEPS
