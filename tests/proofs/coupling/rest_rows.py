"""The same equilibrium by three schemes: Newton's method, a fixed point, a motion run to rest."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cosim.case.file import load_case
from cosim.coupling.motion import motion_states
from cosim.errors import quiet
from cosim.models.motion import moving_models
from cosim.port import Array
from cosim.solve.solvers import solve
from tests.helpers.rows import Row

COARSE = "hood.mesh.quads=120"
AGREE = 1e-4
"""N."""
EVERY = ("edc", "ei", "lum", "fpi", "fdp", "fds", "fdi")
FIRST = ("edc", "fdp")
"""One muscle of the hood, one of the bones."""
STEP, DURATION = 0.1, 1.2
"""s; backward Euler forgets by 1 / (1 + h k / c) a step, below 1/3 with the damper below."""
DAMPING = '"1e-3 N*m*s/rad"'
JOINTS = ("MCP", "MCP_abduction", "PIP", "DIP")
SOURCE = "isometric, newton: one equilibrium, whatever the way there"


def first_rows() -> Iterator[Row]:
    """The rows of two muscles."""
    for muscle in FIRST:
        yield from rows_of(muscle)


def other_rows() -> Iterator[Row]:
    """The rows of the other five muscles."""
    for muscle in EVERY:
        if muscle not in FIRST:
            yield from rows_of(muscle)


def rows_of(muscle: str) -> Iterator[Row]:
    """The fingertip force (N) by each scheme less that by Newton's method."""
    newton = at_rest(muscle, "newton")
    for scheme, force in (
        ("implicit", at_rest(muscle, "implicit")),
        ("linear, run to rest", run_to_rest(muscle)),
    ):
        apart = float(np.linalg.norm(force - newton))
        name = f"{muscle.upper()}, {scheme}"
        yield Row(name, "fingertip force apart N", 0.0, apart, AGREE, SOURCE, "absolute")


def at_rest(muscle: str, scheme: str) -> Array:
    """The fingertip force (3,) N by a scheme for equilibria."""
    case = load_case(f"isometric_{muscle}", [COARSE, f'coupling.scheme="{scheme}"'])
    return solve(case)[1].loaded.known_balance.tip_force


def run_to_rest(muscle: str) -> Array:
    """The fingertip force (3,) N at the end of a damped motion."""
    motion = [f'forward.step="{STEP} s"', f'forward.duration="{DURATION} s"']
    damped = [f"finger.passive.{joint}.damping={DAMPING}" for joint in JOINTS]
    case = load_case(f"isometric_{muscle}", [COARSE, *motion, *damped])
    assert case.forward is not None  # stated above
    both = moving_models(case, case.forward)
    start = both.moves.begin(both.finger.begin(both.posture))
    *_, end = motion_states(both.moves, start, round(DURATION / STEP), quiet)
    return both.finger.tip_wrench(end.coupled.finger)[:3]
