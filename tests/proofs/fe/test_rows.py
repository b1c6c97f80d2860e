"""What the proofs of the shell solver rest on, and that they see what is wrong."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cosim.errors import ConvergenceError
from fe_solver.forces.contact import Status, contact_forces, contact_state
from fe_solver.forces.springs import spring_state
from fe_solver.solver.augmented_contact import solve_augmented
from fe_solver.solver.model import Configuration, ShellModel
from tests.proofs.fe import (
    element_rows,
    febio_rows,
    hood_rows,
    material_points,
    paths,
    tangent_rows,
    thread_rows,
)
from tests.proofs.fe.paths import Loading, error_order, follow, halving_order
from tests.proofs.fe.sheets import clamp, mirror_plane, plate, sheet

FEW = ("trans iso Mooney-Rivlin, incompressible",)
"""Materials of which the default run takes the tangent of each shape of element."""


def test_every_row_on_the_element_passes_with_some_materials(monkeypatch):
    monkeypatch.setattr(element_rows, "LAWS", {name: element_rows.LAWS[name] for name in FEW})
    rows = list(element_rows.rows())
    assert {row.name for row in rows} > {f"element tangent, {s}" for s in element_rows.SHAPES}
    assert not [row for row in rows if not row.passed]


@pytest.mark.parametrize("name", [name for name in element_rows.LAWS if name not in FEW])
def test_the_tangent_of_a_warped_element_is_right_with_every_other_material(name):
    model = element_rows.distort("warped quads", element_rows.LAWS[name], element_rows.THICK / 2)
    assert element_rows.tangent_error(model, 1e-4) < 1e-6


def test_the_rows_on_materials_cover_febio_s_table():
    assert len([r for r in febio_rows.rows() if r.source.startswith("FEBio 4.11")]) == 29


def test_orders_of_convergence():
    assert error_order(4e-2, 1e-2) == pytest.approx(2)
    assert halving_order(1.36, 1.09, 1.0) == pytest.approx(np.log2(3))
    assert halving_order(1.36, 1.0001, 1.0) is None


def test_a_loading_without_equilibrium_says_so(monkeypatch):
    """A sheet that nothing holds, pulled to one side."""
    monkeypatch.setattr(paths, "MOST_HALVINGS", 1)
    X, quads = plate(10.0, 1.0, 4, 1)
    model = sheet(X, quads, 1e6, 0.0, 0.1)
    load = np.outer(X[:, 0] == 10, [1.0, 0, 0])
    with pytest.raises(ConvergenceError):
        follow(Loading(model, load, load[None]), [1.0])


def test_a_mirror_plane_is_half_of_a_sheet():
    """Half a strip held at its mirror plane bends as the whole."""
    X, quads = plate(2.0, 1.0, 8, 2)
    whole = clamp(sheet(X, quads, 1e6, 0.3, 0.1), np.flatnonzero(np.isin(X[:, 0], [0, 2])))
    middle = X[:, 0] == 1
    load = np.outer(middle, [0, 0, 50.0])
    seen = np.stack([np.outer(middle, [0, 0, 1.0])])
    full = follow(Loading(whole, load, seen), [1.0])
    X, quads = plate(1.0, 1.0, 4, 2)
    half = clamp(sheet(X, quads, 1e6, 0.3, 0.1), np.flatnonzero(X[:, 0] == 0))
    middle = X[:, 0] == 1
    half = mirror_plane(half, np.outer(middle, [True, False, False]))
    seen = np.stack([np.outer(middle, [0, 0, 1.0])])
    part = follow(Loading(half, np.outer(middle, [0, 0, 25.0]), seen), [1.0])
    assert part == pytest.approx(full, rel=1e-7)
    assert abs(full[0, 0]) > 0.1


def test_the_tangent_error_sees_a_wrong_tangent(monkeypatch):
    model = element_rows.distort("warped quads")
    right = element_rows.tangent_error(model, 1e-4)
    assemble = type(model.pattern).assemble
    monkeypatch.setattr(type(model.pattern), "assemble", lambda *a: assemble(*a) * (1 + 1e-5))
    assert right < 1e-7
    assert element_rows.tangent_error(model, 1e-4) > 5e-6


def test_what_the_tangents_are_taken_of():
    """A fold has a mitre; springs are slack and taut; nodes press, stick and slide as named."""
    assert element_rows.distort("folded quads").tables.mitre.max() > 1.1
    assert (element_rows.distort("flat quads").tables.mitre == 1).all()
    tapered = element_rows.distort("quads that taper").section.thickness
    assert tapered.max() > 1.5 * tapered.min()
    springs, x = tangent_rows.some_springs("tension-only")
    taut = spring_state(springs, x, *tangent_rows.POSE).taut
    assert 2 <= taut.sum() <= len(taut) - 2
    for surface in tangent_rows.surfaces().values():
        for slip, status in (
            (tangent_rows.STICKS, Status.STICKING),
            (tangent_rows.SLIDES, Status.SLIDING),
        ):
            contact, x = tangent_rows.some_contact(surface, tangent_rows.PRESSURE, slip)
            state = contact_state(contact, x, *tangent_rows.POSE)
            assert (state.status == status).sum() > 8


def test_a_wrong_tangent_of_a_contact_is_seen():
    """Without the surface's curvature."""
    contact, x = tangent_rows.some_contact(tangent_rows.surfaces()["ellipsoid"], 2e5, None)
    right = tangent_rows.forces_error(
        lambda x: contact_forces(contact, x, *tangent_rows.POSE, True), x
    )
    wrong = tangent_rows.forces_error(
        lambda x: contact_forces(contact, x, *tangent_rows.POSE, False), x
    )
    assert right < 1e-6 < 1e-4 < wrong


@cache
def bend_hood(nine: bool = False) -> tuple[ShellModel, Configuration]:
    return hood_rows.bend_hood(nine)


def test_a_hood_has_its_moment_whatever_the_penalty():
    model, c = bend_hood()
    solutions = {}
    for name in ("1e11", "1e10", "1e9"):
        contacts = tuple(replace(k, stiffness=float(name)) for k in model.contacts)
        changed = model.with_changes(contacts=contacts)
        solutions[name] = solve_augmented(changed, c, hood_rows.TENSION, hood_rows.NEWTON)
    rows = list(hood_rows.moment_rows(solutions))
    assert len(rows) == 5
    assert all(row.passed for row in rows)


@pytest.mark.parametrize(
    ("nine", "solver"), [(True, hood_rows.by_penalty), (False, hood_rows.augment)]
)
def test_the_condensed_tangent_is_right_along_some_motion(nine, solver):
    """Of nine-node elements and of augmented contact, of all bodies at once."""
    model, c = bend_hood(nine)
    if nine:
        model = hood_rows.add_wall(model, c)
    here = solver(model, c, hood_rows.TENSION)
    exact = hood_rows.jacobian(here)
    scales, step = hood_rows.SCALES, hood_rows.STEP
    way = np.random.default_rng(1).choice([-1.0, 1.0], 12) / np.sqrt(12)
    ahead, behind = (hood_rows.displace(here, solver, s * step * scales * way) for s in (1, -1))
    found = (hood_rows.total_wrench(ahead) - hood_rows.total_wrench(behind)) * scales / (2 * step)
    scaled = exact.load_motion * np.outer(scales, scales)
    assert (np.abs(scaled @ way - found) < 1e-5 * np.abs(scaled).max(axis=1)).all()
    arms = exact.load_tension[:, 0] * scales - hood_rows.own_pull(here)
    assert arms == pytest.approx(
        exact.excursion_motion[0] * scales, rel=0, abs=1e-8 * np.abs(arms).max()
    )


def test_a_wrong_condensed_tangent_is_seen(monkeypatch):
    model, c = bend_hood()
    solution = hood_rows.by_penalty(hood_rows.add_wall(model, c), c, hood_rows.TENSION)
    right = hood_rows.jacobian(solution)
    wrong = replace(
        right,
        load_motion=right.load_motion + 1e-4 * np.eye(12) * np.abs(right.load_motion).max(axis=1),
        load_tension=right.load_tension * (1 + 1e-7),
    )
    monkeypatch.setattr(hood_rows, "jacobian", lambda s: wrong)
    rows = list(hood_rows.tangent_rows(solution))
    assert [row.passed for row in rows[:12]] == [False] * 12
    assert not rows[12].passed
    monkeypatch.setattr(hood_rows, "jacobian", lambda s: right)
    assert all(row.passed for row in hood_rows.tangent_rows(solution))


def test_other_bytes_of_other_threads_are_seen(monkeypatch):
    def answer(call, settings):
        n = int(settings["FE_SOLVER_THREADS"])
        return {"threads": n, "sha256": f"{n}{settings['FE_SOLVER_LINEAR']}"}

    monkeypatch.setattr(thread_rows, "run_json_command", answer)
    assert [row.computed for row in thread_rows.rows()] == [1] * len(list(thread_rows.rows()))
    assert not any(row.passed for row in thread_rows.rows())


def test_the_stress_of_a_strip_from_its_energy():
    """Against Mooney and Rivlin's closed form, where the bulk modulus hardly gives way."""
    law = febio_rows.febio_law(2e5)
    s = 1.05
    S11 = material_points.strip_stress(law, (s**2 - 1) / 2, np.pi / 2)
    assert S11 * s**2 == pytest.approx(2 * law.c1 * (s**2 - 1 / s), rel=1e-4)
