"""The hood strip: our half against beam theory and itself, and Kratos' where it is installed; and
work in processes of its own."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict

import numpy as np
import pytest

from cosim.errors import CosimError
from tests.proofs.fe import json_command, peers
from tests.proofs.fe.paths import halving_order, limit
from tests.proofs.fe.sheets import linear_response

NEEDS_SIGNALS = pytest.mark.skipif(sys.platform == "win32", reason="ends by a signal")
ANSWER = peers.Answer(-5e-3, 20, 0.1, "superlu")


def python_command(text: str) -> list[str]:
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


def deflections() -> list[float]:
    return [peers.ours(22 * k, 6 * k).deflection for k in (1, 2, 4)]


def test_the_deflection_converges_with_the_mesh():
    coarse, middle, fine = deflections()
    assert halving_order(coarse, middle, fine) > 1.75
    assert coarse == pytest.approx(fine, rel=0.005)
    assert middle == pytest.approx(fine, rel=0.001)


def test_the_deflection_is_the_load_s():
    """The work of the load over the load, whatever does not move along it."""
    load = np.array([[0, 0, -1.0], [0, 0, -3.0], [0, 0, 0]])
    moved = np.array([[5, 6, -1.0], [7, 8, -2.0], [9, 9, 9]])
    assert peers.deflection(load, moved) == pytest.approx(-7 / 4)


def test_a_program_in_a_process_of_its_own_answers_the_same():
    there, here = peers.solve_with_peer("ours", 8, 3), peers.ours(8, 3)
    assert there.deflection == pytest.approx(here.deflection, rel=1e-12)
    assert (there.solves, there.linear) == (here.solves, here.linear)
    assert there.solve_s > 0


def test_what_a_program_prints_beside_its_answer_is_left_out():
    answer = json.dumps(asdict(ANSWER))
    text = f"print('hello'); print({answer!r}); print('bye')"
    assert json_command.run_json_command(python_command(text), {}) == asdict(ANSWER)


def test_settings_stand_over_the_environment(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    names = ("FE_SOLVER_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
    text = f"import os, json; print(json.dumps({{n: os.environ[n] for n in {names}}}))"
    found = json_command.run_json_command(python_command(text), json_command.threads(3, 2))
    assert list(found.values()) == ["3", "2", "2"]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        pytest.param("import os; os.abort()", "crashed: SIGABRT", marks=NEEDS_SIGNALS),
        pytest.param(
            "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)",
            "crashed: SIGSEGV",
            marks=NEEDS_SIGNALS,
        ),
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
        json_command.run_json_command(python_command(text), {})


def test_a_peer_that_fails_is_a_failed_row(monkeypatch):
    def answer(call, settings):
        if "kratos" in call:
            raise CosimError("crashed: SIGSEGV")
        return asdict(ANSWER)

    monkeypatch.setattr(peers, "is_installed", lambda: True)
    monkeypatch.setattr(peers, "run_json_command", answer)
    (row,) = peers.rows([(8, 3)])
    assert not row.passed
    assert row.source == "kratos crashed: SIGSEGV"


OURS = [-4.70e-3, -4.93e-3, -5.0e-3]
"""m, on three meshes; they tend to -5.0233e-3."""


@pytest.mark.parametrize(
    ("theirs", "seconds", "verdicts"),
    [
        ([-5e-3, -5e-3, -5.02e-3], 0.2, [True, True, True, True, True]),
        ([-5e-3, -5e-3, -5.02e-3], 0.09, [True, True, True, True, False]),
        ([-5e-3, -5.02e-3, -5.03e-3], 0.2, [True, True, False, True, True]),
        ([-5.12e-3, -5.04e-3, -5.02e-3], 0.2, [False, False, True, True, True]),
        ([-4.71e-3, -4.90e-3, -5.02e-3], 0.2, [True, True, True, False, True]),
    ],
)
def test_rows_judge_the_deflection_and_the_time(monkeypatch, theirs, seconds, verdicts):
    def solve_with_peer(program, along, across):
        k = [mesh[0] for mesh in peers.MESHES].index(along)
        if program == "kratos":
            return peers.Answer(theirs[k], 20, seconds, "LU")
        return peers.Answer(OURS[k], 20, 0.1, "superlu")

    monkeypatch.setattr(peers, "is_installed", lambda: True)
    monkeypatch.setattr(peers, "solve_with_peer", solve_with_peer)
    rows = list(peers.rows())
    assert [row.passed for row in rows] == verdicts
    assert "superlu" in rows[-1].quantity
    assert "LU" in rows[-1].source
    differences = np.abs(np.subtract(OURS, theirs))
    assert rows[2].order == pytest.approx(np.log2(differences[1] / differences[2]))


def test_the_limit_of_two_meshes():
    exact, c = 2.0, 0.3
    assert limit(exact + 4 * c, exact + c) == pytest.approx(exact)


def test_without_a_peer_there_are_no_rows(monkeypatch):
    monkeypatch.setitem(sys.modules, "KratosMultiphysics", None)
    assert list(peers.rows()) == []


@pytest.mark.skipif(not peers.is_installed(), reason="KratosMultiphysics not installed")
def test_kratos_finds_the_same_deflection():
    mine, peer = (peers.solve_with_peer(who, 60, 16).deflection for who in ("ours", "kratos"))
    assert mine == pytest.approx(peer, rel=0.01)
