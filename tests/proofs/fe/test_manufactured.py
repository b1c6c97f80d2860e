"""Manufactured solutions of the shell: the load by the exact motion, the orders, and that a wrong
term of an element is seen by them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cosim.port import rotation_matrix
from fe_solver.materials.linear import Isotropic
from fe_solver.sheet import Sheet
from tests.proofs.fe import manufactured_rows
from tests.proofs.fe.manufactured import (
    THICKNESS,
    Motion,
    Surface,
    solve_motion,
    vectors,
    virtual_work,
)
from tests.proofs.fe.manufactured_rows import (
    CURVED,
    FLAT,
    FOUR,
    KINDS,
    MOTIONS,
    NINE,
    convergence,
    solid_rows,
    upright,
)
from tests.proofs.fe.material_rows import ISOTROPIC, RUBBER

GREW = "curved sheet that grew"


def orders(kind, motion, law=ISOTROPIC, **more):
    return list(convergence("", kind, lambda mesh: solve_motion(motion, mesh, law, **more)))


def test_the_strains_of_a_stretch_and_a_turn_are_exact():
    """Twice as long along x, turned: only the stretch strains."""
    turn = rotation_matrix(np.array([0.4, -0.8, 0.3])).T
    moved = Surface(lambda u, v: vectors(2 * u, v, 0 * u) @ turn, lambda u, v: upright(u, v) @ turn)
    uv = np.random.default_rng(0).uniform(size=(5, 2))
    strain, _, area = Motion(FLAT, moved).strains(uv)
    c, s = np.array([1.0, 0.4]) / np.hypot(1, 0.4)
    exact = 1.5 * np.array([c * c, s * s, -2 * c * s, 0, 0, 0, 0, 0])
    assert strain == pytest.approx(np.tile(exact, (5, 1)), abs=1e-14)
    assert area == pytest.approx(1)


def test_the_load_of_a_stretched_sheet_is_the_tension_of_its_edges():
    """An even stretch asks for forces on the edges alone, P = (1 + e) S h with S = E e' by Saint
    Venant and Kirchhoff, and for no moments."""
    e, law, mesh = 0.1, Isotropic(3.0, 0.0), FOUR.mesh(4)
    moved = Surface(lambda u, v: vectors((1 + e) * u, v, 0 * u), upright)
    force, couple = virtual_work(Motion(FLAT, moved), mesh, law, THICKNESS)
    u = mesh.uv[:, 0]
    pull = (1 + e) * 3.0 * (e + e * e / 2) * THICKNESS
    assert force[u > 1 - 1e-9].sum(axis=0) == pytest.approx([pull, 0, 0], abs=1e-10)
    assert force[(u > 1e-9) & (u < 1 - 1e-9)] == pytest.approx(0, abs=1e-10)
    assert couple == pytest.approx(0, abs=1e-10)


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        (NINE, "rolled up by 150 degrees"),
        (FOUR, GREW),
        pytest.param(FOUR, "rolled up by 150 degrees", marks=pytest.mark.slow),
        pytest.param(NINE, GREW, marks=pytest.mark.slow),
    ],
    ids=lambda x: getattr(x, "name", x),
)
def test_the_orders_are_those_of_theory(kind, name):
    for row, theory in zip(orders(kind, MOTIONS[name]), kind.orders, strict=True):
        assert row.passed
        assert row.order > theory - 0.15


@pytest.mark.slow
def test_nodes_on_a_face_and_a_rubber_keep_the_orders():
    assert all(row.passed for row in orders(NINE, CURVED, RUBBER, height=THICKNESS / 2))


def test_the_solid_shell_has_its_orders():
    rows = list(solid_rows("isotropic"))
    assert len(rows) == 2
    assert all(row.passed for row in rows)


@pytest.mark.parametrize(
    ("name", "part", "factor"),
    [
        ("bending", "bending", [1.0, 1.0, 0.95]),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in (
                ("membrane", "membrane", [1.0, 1.0, 0.98]),
                ("shear", "shear", [0.98, 1.0]),
                (GREW, "membrane", [1.02, 1.0, 1.0]),
                (GREW, "bending", [1.0, 0.9, 1.0]),
                (GREW, "shear", [1.0, 0.9]),
            )
        ),
    ],
)
def test_a_wrong_strain_of_an_element_is_seen(monkeypatch, name, part, factor):
    """One component a few per cent off, in the element alone."""
    whole = Sheet.model

    def wrong(sheet, **more):
        model = whole(sheet, **more)
        tables = model.tables
        scaled = getattr(tables, part) * np.array(factor)[:, None]
        changed = replace(tables, **{part: scaled})
        rest = np.concatenate([model.reference, model.directors], axis=1)[model.quads]
        y = np.concatenate([rest[..., :3], rest[..., 3:]], axis=1)
        return replace(model, tables=replace(changed, offset=changed.offset + changed.strain(y)))

    assert all(row.passed for row in orders(NINE, MOTIONS[name]))
    monkeypatch.setattr(Sheet, "model", wrong)
    assert not all(row.passed for row in orders(NINE, MOTIONS[name]))


def test_every_motion_and_every_kind_has_its_rows(monkeypatch):
    solved = []

    def halving(motion, mesh, law, thickness=THICKNESS, height=0.0):
        solved.append(len(mesh.quads))
        size = len(mesh.quads) ** -0.5
        return manufactured_rows.Errors(size**3, size**2)

    monkeypatch.setattr(manufactured_rows, "solve_motion", halving)
    monkeypatch.setattr(manufactured_rows, "SOLIDS", {})
    rows = list(manufactured_rows.element_rows())
    assert len(rows) == 2 * len(KINDS) * len(MOTIONS)
    assert len(solved) == 3 * len(KINDS) * len(MOTIONS)
    assert {row.passed for row in rows} == {True}
    assert rows[0].order == pytest.approx(3)
