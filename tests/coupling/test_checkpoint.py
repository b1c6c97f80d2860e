"""What a checkpoint keeps of the frames of a motion."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from cosim.coupling.checkpoint import _stack_frames, _unstack_frames
from cosim.coupling.motion import MotionFrame


def test_every_quantity_of_a_frame_comes_back_as_it_was():
    """Each of numbers of its own, so that none may stand in another's place."""
    random, shapes = np.random.default_rng(3), {"wrench": (2, 3, 6), "total": (2, 6)}
    numbers = ("time", "residual", "energy")

    def a_frame() -> MotionFrame:
        facts = {f.name: random.normal(size=shapes.get(f.name, 3)) for f in fields(MotionFrame)}
        facts |= {name: float(random.normal()) for name in numbers}
        facts["imbalance"] = (float(random.random()), float(random.random()))
        return MotionFrame(**facts)

    frames, tips = [a_frame() for _ in range(2)], [random.normal(size=6) for _ in range(2)]
    back, tips_back = _unstack_frames(_stack_frames(frames, tips))
    for before, after in zip(frames, back, strict=True):
        for f in fields(MotionFrame):
            assert np.array_equal(getattr(before, f.name), getattr(after, f.name)), f.name
            assert type(getattr(before, f.name)) is type(getattr(after, f.name))
    assert np.array_equal(tips, tips_back)
