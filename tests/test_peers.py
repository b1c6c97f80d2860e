"""The hood strip: our half against beam theory and itself, and Kratos' where it is installed."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from importlib.util import find_spec

import numpy as np
import pytest
from shells import linear_response

from cosim.port import CosimError
from fe_solver.verification import peers
from fe_solver.verification.paths import halving_order

ANSWER = peers.Answer(-5e-3, 20, 0.1, "superlu")


def said(text: str) -> list[str]:
    """A command that runs a line of Python."""
    return [sys.executable, "-c", text]


def test_the_strip_is_a_cantilever_of_its_section():
    """Bending of an arc's thin section about its own centroid, which the section's own flattening
    and its shear, left out here, soften by a few per cent."""
    model, load = peers.strip(60, 16)
    u = linear_response(model, load)[0]
    a, R, h = peers.ARC / peers.RADIUS / 2, peers.RADIUS, peers.THICKNESS
    across = a + np.sin(a) * np.cos(a)
    inertia = R**3 * h * (across - 2 * np.sin(a) ** 2 / a) + R * h**3 / 12 * across
    beam = -peers.LOAD * peers.LENGTH**3 / (3 * peers.MODULUS * inertia)
    assert peers.deflection(load, u) == pytest.approx(beam, rel=0.04)
    assert load.sum(axis=0) == pytest.approx([0, 0, -peers.LOAD])


def test_the_deflection_converges_with_the_mesh():
    found = [peers.ours(22 * k, 6 * k).deflection for k in (1, 2, 4)]
    assert halving_order(*found) == pytest.approx(2, abs=0.25)
    assert found[-1] == pytest.approx(found[-2], rel=0.02)


def test_the_deflection_is_the_load_s():
    """The work of the load over the load, whatever does not move along it."""
    load = np.array([[0, 0, -1.0], [0, 0, -3.0], [0, 0, 0]])
    moved = np.array([[5, 6, -1.0], [7, 8, -2.0], [9, 9, 9]])
    assert peers.deflection(load, moved) == pytest.approx(-7 / 4)


def test_a_program_in_a_process_of_its_own_answers_the_same():
    apart, here = peers.solved("ours", 8, 3), peers.ours(8, 3)
    assert apart.deflection == here.deflection
    assert (apart.solves, apart.linear) == (here.solves, here.linear)
    assert apart.solve_s > 0


def test_what_a_program_prints_beside_its_answer_is_left_out():
    answer = json.dumps(asdict(ANSWER))
    text = f"print('hello'); print({answer!r}); print('bye')"
    assert peers.apart(said(text)) == ANSWER


def test_a_program_has_one_thread(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    text = "import os, json; n = int(os.environ['OMP_NUM_THREADS']);"
    text += "print(json.dumps(dict(deflection=0, solves=n, solve_s=0, linear='')))"
    assert peers.apart(said(text)).solves == 1


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("import os; os.abort()", "crashed: SIGABRT"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "crashed: SIGSEGV"),
        ("raise RuntimeError('no such element')", "no such element"),
        ("print('all is well')", "no reason given"),
        (
            "import sys; print('at\\nError: no law\\nor shape\\nin x', file=sys.stderr)",
            "law or shape$",
        ),
    ],
)
def test_a_program_that_fails_says_why(text, reason):
    with pytest.raises(CosimError, match=reason):
        peers.apart(said(text))


def test_a_peer_that_fails_is_a_failed_row(monkeypatch):
    def apart(call):
        if "kratos" in call:
            raise CosimError("crashed: SIGSEGV")
        return ANSWER

    monkeypatch.setattr(peers, "find_spec", lambda name: True)
    monkeypatch.setattr(peers, "apart", apart)
    (row,) = peers.rows(8, 3)
    assert not row.passed
    assert row.source == "kratos crashed: SIGSEGV"


@pytest.mark.parametrize(
    ("deflection", "seconds", "verdicts"),
    [(-5.02e-3, 0.2, [True, True]), (-5.03e-3, 0.2, [False, True]), (-5e-3, 0.09, [True, False])],
)
def test_rows_judge_the_deflection_and_the_time(monkeypatch, deflection, seconds, verdicts):
    peer = peers.Answer(deflection, 20, seconds, "LU")
    monkeypatch.setattr(peers, "find_spec", lambda name: True)
    monkeypatch.setattr(peers, "apart", lambda call: peer if "kratos" in call else ANSWER)
    rows = list(peers.rows())
    assert [row.passed for row in rows] == verdicts
    assert "superlu" in rows[1].quantity
    assert "LU" in rows[1].source


def test_no_rows_without_a_peer(monkeypatch):
    monkeypatch.setattr(peers, "find_spec", lambda name: None)
    assert list(peers.rows()) == []


@pytest.mark.skipif(not find_spec("KratosMultiphysics"), reason="KratosMultiphysics not installed")
def test_kratos_finds_the_same_deflection():
    mine, peer = (peers.solved(who, 60, 16).deflection for who in ("ours", "kratos"))
    assert mine == pytest.approx(peer, rel=0.01)
