"""The thesis' one-way pass beside the two-way equilibrium, and beside what a tendon can do."""

from __future__ import annotations

from collections.abc import Iterator

from cases.papers.models.printed import printed_values
from cosim.case.file import load_case
from cosim.solve.one_way import finger_pass, hood_pass
from cosim.solve.session import Session
from cosim.solve.solvers import solve
from tests.helpers.rows import Row
from tests.proofs.coupling.tip_bound import force_and_bound

THESIS = "Jadelis, thesis, section 3.4: excess over Qiu's experiment, whose spread was not seen"
MESH: tuple[str, ...] = ()
"""The mesh of the shipped cases."""
MUSCLES = ("EDC", "EI", "LUM", "FPI")
BEYOND = ("EDC", "EI", "LUM")
"""Whose excess alone is more than a finger's tip force can be; FPI's lay within the experiment's
spread."""
ONCE = 'coupling.one_way.joint_contact="none"'
SETTINGS = ((), (ONCE,), (ONCE, 'coupling.one_way.lumping="bodies"'))
TIE = 1e-6
"""N: where one joint resists alone the bound is met."""
BOUND = "J^T F = tau + p, springs and limits oppose the motion left: |F| <= max |F_j|"


def thesis_rows() -> Iterator[Row]:
    """For each muscle the pass as the thesis made it, its excess by cause, and both bounds."""
    printed = printed_values("jadelis", "other")
    for muscle in MUSCLES:
        yield from muscle_rows(muscle, printed[f"excess.{muscle}"][0])


def muscle_rows(muscle: str, excess: float) -> Iterator[Row]:
    """The rows of one muscle's pass; `excess`: N, the thesis' own."""
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
    hood = hood_pass(cases[0], Session(), silent)
    return [force_and_bound(*finger_pass(case, hood, silent)) for case in cases]


def silent(text: str) -> None:
    """No progress is shown."""
