"""The thesis' one-way pass beside the two-way equilibrium, and beside what a tendon can do."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cosim.build.models import Models
from cosim.case.file import load_case
from cosim.checks import Row, Study
from cosim.papers.thesis_models import EXCESS
from cosim.port import Array, Finger, State
from cosim.solve.one_way import finger_pass, hood_pass
from cosim.solve.states import States
from cosim.solve.static import solve

THESIS = "Jadelis, thesis, section 3.4: excess over Qiu's experiment, whose spread was not seen"
MESH: tuple[str, ...] = ()
"""As the cases ship."""
BEYOND = ("EDC", "EI", "LUM")
"""Whose excess alone is more than a finger's tip force can be; FPI's lay within the experiment's
spread."""
ONCE = 'coupling.one_way.joint_contact="none"'
SETTINGS = ((), (ONCE,), (ONCE, 'coupling.one_way.lumping="bodies"'))
TIE = 1e-6
"""N: where one joint resists alone the bound is met."""
BOUND = "J^T F = tau + p, springs and limits oppose the motion left: |F| <= max |F_j|"
RESISTING = ("passive", "limit", "fingertip")
DIFFERENCE = 1e-6
"""rad."""


def greatest_tip_force(finger: Finger, at: State, torque: Array) -> float:
    """N, what a fingertip held at a point can bear at most under joint torques tau (nq,) N m.

    With J the tip's Jacobian (3, nq) and F the force on the world, J^T F = tau + p, where springs
    and limits that are at rest in the posture make p.  The tip leaves one motion n, J n = 0, along
    which each of them opposes its joint's turn: p_j = -c_j n_j s with c_j >= 0, whatever its law.
    So n . (tau + p) = 0 makes F = sum_j w_j F_j with w_j = c_j n_j^2 / sum_k c_k n_k^2, F_j being
    the force while joint j alone resists: a mean of the F_j, no larger than the largest of them.
    """
    n = len(torque)
    tip = np.zeros((3, n))
    for j in range(n):
        step = np.zeros(len(finger.unknowns(at)))
        step[j] = DIFFERENCE
        ahead, behind = (finger.tip(finger.displaced(at, s)) for s in (step, -step))
        tip[:, j] = (ahead - behind) / (2 * DIFFERENCE)
    alone = [np.linalg.solve(np.column_stack([tip.T, e]), torque)[:3] for e in np.eye(n)]
    return float(np.linalg.norm(alone, axis=1).max())


def thesis_rows() -> Iterator[Row]:
    """For each muscle the pass as the thesis made it, its excess by cause, and both bounds."""
    for muscle, excess in EXCESS.items():
        yield from muscle_rows(muscle, excess)


def muscle_rows(muscle: str, excess: float) -> Iterator[Row]:
    """Of the muscle's pass; `excess`: N, the thesis' own."""
    (as_thesis, bound), (single, _), (plain, plain_bound) = passes(muscle)
    ours, our_bound = force_and_bound(*solve(load_case(f"isometric_{muscle.lower()}", MESH)))
    why = f"joint_contact {as_thesis - single:+.2f}, lumping {single - plain:+.2f}"
    name, over = f"{muscle}, one way as the thesis", as_thesis - ours
    what = f"tip force over the two-way one N ({why})"
    yield Row(name, what, excess, over, 0.0, THESIS, "comparison")
    if muscle in BEYOND:
        what = f"bound N, below its tip force of {as_thesis:.2f}"
        yield Row(name, what, as_thesis, bound, 0.0, BOUND, "bound")
    else:
        what = "tip force N, over the bound though the thesis' was not"
        yield Row(name, what, bound, as_thesis, 0.0, BOUND, "comparison")
    name = f"{muscle}, one way, each force once"
    yield Row(name, "tip force N", plain_bound, plain, TIE, BOUND, "bound")
    yield Row(f"{muscle}, two-way", "tip force N", our_bound, ours, TIE, BOUND, "bound")


def passes(muscle: str) -> list[tuple[float, float]]:
    """N: tip forces of the one-way pass and their bounds, as the thesis, without the joints'
    forces, and without lumping either."""
    cases = [load_case(f"thesis_one_way_{muscle.lower()}", [*MESH, *s]) for s in SETTINGS]
    hood = hood_pass(cases[0], silent)
    return [force_and_bound(*finger_pass(case, hood, silent)) for case in cases]


def force_and_bound(models: Models, states: States) -> tuple[float, float]:
    """N: the loaded tip force, and the largest that what pulls in that pose could make: tendons on
    bones, and of the hood its own torque, without what a pass adds."""
    loaded = states.loaded
    torque = {s: t for s, t in loaded.balance.torque.items() if s not in RESISTING}
    if states.passed is not None:
        torque["hood"] = states.passed.torque["hood"]
    pull = np.sum(list(torque.values()), axis=0)
    bound = greatest_tip_force(models.finger, loaded.finger_state, pull)
    return float(np.linalg.norm(loaded.balance.tip_force)), bound


def silent(text: str) -> None:
    """No progress is shown."""


STUDIES = (Study("one-way pass of the thesis", thesis_rows),)
