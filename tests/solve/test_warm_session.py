"""A warm session begins at the last equilibrium, and comes to the one that a run finds."""

from __future__ import annotations

import pytest

import cosim
from cosim.errors import ConvergenceError
from cosim.solve import session as session_module

CASE = cosim.load("isometric_edc").replace({"hood.mesh.quads": 120})
CHANGES = (
    {"finger.posture.PIP": "48 deg", "hood.regions.central_slip.c5": "120 MPa"},
    *(
        pytest.param(change, marks=pytest.mark.slow)
        for change in ({"tendons.EDC.tension": "5 N"}, {"hood.thickness": "0.17 mm"})
    ),
)


def numbers(result: cosim.Result) -> dict[str, float]:
    return {**result.tip_force, **result.slips, **result.excursions}


@pytest.fixture(scope="module")
def warm() -> cosim.Session:
    session = cosim.Session(warm=True)
    cosim.run(CASE, session)
    return session


@pytest.mark.parametrize("change", CHANGES)
def test_a_warm_answer_is_that_of_a_run(warm, change):
    case = CASE.replace(change)
    near = cosim.run(case, warm)
    alone = cosim.run(case)
    assert numbers(near) == pytest.approx(numbers(alone), rel=1e-5, abs=1e-6)
    assert near.audit.passed


@pytest.mark.slow
def test_a_mesh_of_another_size_begins_as_laid(warm):
    case = CASE.replace({"hood.mesh.quads": 400})
    assert numbers(cosim.run(case, warm)) == numbers(cosim.run(case))


def test_where_there_is_no_way_from_the_last_one_it_begins_as_laid(warm, monkeypatch):
    cosim.run(CASE, warm)
    case = CASE.replace({"finger.posture.PIP": "52 deg"})
    solve = session_module.solve_equilibrium
    tried = []

    def fail_at_first(*args, **kwargs):
        tried.append(args)
        if len(tried) == 1:
            raise ConvergenceError("no way")
        return solve(*args, **kwargs)

    monkeypatch.setattr(session_module, "solve_equilibrium", fail_at_first)
    assert cosim.run(case, warm).audit.passed
    assert len(tried) == 2
