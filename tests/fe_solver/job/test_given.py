"""What is given from Python: lists and plain numbers are as good as arrays and drives, and what
cannot be right is one InputError that says what was expected."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from cosim.errors import InputError
from fe_solver.job.curves import Drive, LoadCurve
from fe_solver.job.job import (
    BodyForce,
    HeldDirector,
    Job,
    NodalForce,
    PrescribedDisplacement,
    Pressure,
    Step,
)
from fe_solver.job.solve import solve_job
from fe_solver.materials.linear import Isotropic
from fe_solver.sheet import even_sheet, plate
from fe_solver.supports import WALL, Body, ContactPair, SpringLaw, SpringSet, Tied
from fe_solver.surfaces.shapes import Sphere
from tests.helpers.jobs import PLAIN

LAW = Isotropic(100e6, 0.0)
SHEET = plate(20e-3, 5e-3, 4, 2, LAW, thickness=0.5e-3)
FIRST, END = (SHEET.edge(e).tolist() for e in ("x0", "x1"))
FLOOR = [[0, 0, -3e-3], [20e-3, 0, -3e-3], [20e-3, 5e-3, -3e-3], [0, 5e-3, -3e-3]]
HALVES = [[0, 1, 2], [0, 2, 3]]


def array(given):
    """The same with arrays in the place of lists, and no range or number."""
    return np.array([*given] if isinstance(given, range) else given)


def job(**more) -> Job:
    return Job(SHEET, **{"ties": [Tied(FIRST, WALL)], **more})


def forced(of) -> Job:
    return job(forces=[NodalForce(of(END), of([0, 0, 1e-3]))])


def displaced(of) -> Job:
    moved = 1e-4 if of is list else Drive(1e-4)
    return job(held=[PrescribedDisplacement(of(END), 2, moved)])


def mirrored(of) -> Job:
    held = [PrescribedDisplacement(of(FIRST), c) for c in range(3)]
    still = [HeldDirector(of(FIRST), 0)]
    return Job(SHEET, held=held, held_directors=still, forces=[NodalForce(of(END), (0, 0, 1e-3))])


def pressed(of) -> Job:
    size, sign = (10.0, 1) if of is list else (Drive(10.0), np.array([1, 1]))
    return job(pressures=[Pressure(of([0, 1]), sign, size)])


def weighed(of) -> Job:
    pull = (0, 0, -9.81) if of is list else (Drive(), Drive(), Drive(-9.81))
    density = 1e3 if of is list else np.array([1e3, 1e3])
    return job(body_forces=[BodyForce(of([0, 1]), density, pull)])


def sprung(of) -> Job:
    law, k = SpringLaw(of([10.0] * len(END))), len(END)
    anchor = of([[20e-3, 0, 5e-3]] * k)
    return job(bodies=[Body("b")], springs=[SpringSet.to_body("s", law, of(END), 0, anchor, 4e-3)])


def lying(of) -> Job:
    side = -1 if of is list else -np.ones(8, dtype=int)
    pair = ContactPair("c", of(range(8)), side, 0, of(HALVES))
    body = Body("floor", of([0, 0, 0]), of(FLOOR), of(HALVES), (0, 0, 2.9e-3))
    return job(bodies=[body], contacts=[pair])


def curved(of) -> Job:
    curve = LoadCurve([0, 1], [0, 1]) if of is list else LoadCurve((0.0, 1.0), (0.0, 1.0))
    return job(held=[PrescribedDisplacement(of(END), 2, Drive(1e-4, curve))])


def laid(of) -> Job:
    sheet = even_sheet(of(SHEET.points.tolist()), of(SHEET.quads.tolist()), LAW, of([5e-4] * 15))
    return Job(sheet, [Tied(of(FIRST), WALL)], forces=[NodalForce(of(END), (0, 0, 1e-3))])


@pytest.mark.parametrize(
    "make", [forced, displaced, mirrored, pressed, weighed, sprung, lying, curved, laid]
)
def test_lists_and_numbers_are_as_good_as_arrays(make: Callable[..., Job]) -> None:
    found = [solve_job(make(of), options=PLAIN).states[-1] for of in (list, array)]
    assert np.array_equal(found[0].configuration.x, found[1].configuration.x)
    assert np.abs(found[0].configuration.x - SHEET.points).max() > 0


BALL = Body("ball", surface=Sphere([10e-3, 2.5e-3, -3e-3], 2e-3))
WRONG: dict[str, tuple[Callable[[], object], str]] = {
    "node beyond": (
        lambda: job(forces=[NodalForce([99], (0, 0, 1))]),
        "node index 99, .* 15, from",
    ),
    "half a node": (
        lambda: NodalForce([1.5], (0, 0, 1)),
        r"nodes: expected whole numbers, not \[1.5",
    ),
    "node below": (lambda: Tied([-2], WALL), "nodes: expected a list of indices from 0 on"),
    "nodes by mask": (lambda: Tied(SHEET.points[:, 0] == 0, WALL), "a mask of 15 .*flatnonzero"),
    "nodes by name": (lambda: Tied("x0", WALL), "nodes: expected whole numbers, not 'x0'"),
    "ragged": (lambda: NodalForce([[1], [2, 3]], (0, 0, 1)), "nodes: expected whole numbers"),
    "force of two": (lambda: NodalForce(END, (0, 1)), r"force .* shape \(3\), got \(2,\)"),
    "force in words": (lambda: NodalForce(END, "up"), "expected numbers, not 'up'"),
    "force nan": (lambda: NodalForce(END, (0, 0, np.nan)), "expected finite numbers"),
    "function": (lambda: NodalForce(END, (0, 0, 1), lambda t: t), "curve: expected a LoadCurve"),
    "component": (lambda: PrescribedDisplacement(END, "z"), "component: expected 0, 1 or 2"),
    "displacement": (lambda: PrescribedDisplacement(END, 2, "1 mm"), "displacement .* not '1 mm'"),
    "two signs": (lambda: Pressure([0, 1, 2], [1, 1], 1.0), "sign: expected 3 values or one"),
    "element beyond": (lambda: job(pressures=[Pressure([8], 1, 1.0)]), "element index 8"),
    "no such body": (lambda: job(ties=[Tied(FIRST, 3)]), "body index 3, and there are 0"),
    "contact's body": (
        lambda: job(contacts=[ContactPair("c", [0], 1, 5)]),
        "body index 5, and there are 1",
    ),
    "spring's body": (
        lambda: job(springs=[SpringSet.to_body("s", SpringLaw(1.0), [0], 4, [[0, 0, 1]], 1.0)]),
        "body index 4",
    ),
    "no list": (lambda: Job(SHEET, ties=Tied(FIRST, WALL)), "ties: expected a list of Tied"),
    "other things": (lambda: job(forces=[Tied(END, WALL)]), "forces: expected a list of NodalFor"),
    "step": (lambda: Step("a", 1.0, 0), "increments: expected a whole number from 1 to 1000000"),
    "step's end": (lambda: Step("a", -1.0, 1), "end .*: expected a time above 0"),
    "thickness": (
        lambda: even_sheet(SHEET.points, SHEET.quads, LAW, [5e-4] * 8),
        "thickness .* expected 15 values or one for all",
    ),
    "flat points": (
        lambda: even_sheet(SHEET.points[:, :2], SHEET.quads, LAW, 5e-4),
        r"points .* shape \(any, 3\), got \(15, 2\)",
    ),
    "modulus": (lambda: Isotropic("100 MPa", 0.0), "Isotropic: E: expected numbers, not '100 MPa'"),
    "curve": (lambda: LoadCurve([0, "a"], [0, 1]), "times: expected numbers"),
    "anchor": (
        lambda: SpringSet.to_body("s", SpringLaw(1.0), [0, 1], 0, [[0, 0, 1]], 1.0),
        r"anchor .* shape \(2, 3\), got \(1, 3\)",
    ),
    "one corner": (lambda: job(bodies=[Body("b", [0, 0])]), "origin .* shape"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_cannot_be_right_is_told_in_one_error(name: str) -> None:
    make, words = WRONG[name]
    with pytest.raises(InputError, match=words):
        solve_job(make(), options=PLAIN)


def test_times_are_a_list() -> None:
    with pytest.raises(InputError, match=r"times \(s\): expected an array of shape \(any\)"):
        solve_job(forced(list), times=1.0)


def test_a_law_takes_lists_too() -> None:
    law = Isotropic([[1e8], [2e8]], 0.3)
    assert law.response(np.zeros((2, 4, 3))).tangent.shape == (2, 4, 3, 3)
