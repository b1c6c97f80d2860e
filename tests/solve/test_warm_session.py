"""A warm session begins at the last equilibrium, and comes to the one that a run finds."""

from __future__ import annotations

from typing import Any

import pytest

import cosim
from cosim.errors import ConvergenceError, quiet
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


STRICT = {"solve.tolerance": 1e-9, "solve.hood_tolerance": 1e-11}
"""As a case that begins near by is solved."""


@pytest.fixture(scope="module")
def nearby() -> cosim.Session:
    """A session in which a case that begins near by was solved."""
    session = cosim.Session()
    cosim.run(CASE.replace({"solve.start": "nearby"}), session)
    return session


@pytest.mark.parametrize(("stated", "solved"), [(1e-10, 1e-11), (1e-12, 1e-12)])
def test_the_hood_of_a_case_that_begins_nearby_is_solved_to_1e_11(nearby, stated, solved):
    case = CASE.replace({"solve.start": "nearby", "solve.hood_tolerance": stated})
    hood: Any = nearby.models(case, quiet).hood
    assert hood.options.tolerance == solved


@pytest.mark.parametrize("every", [1, 10**9])
def test_a_case_that_begins_nearby_has_the_numbers_of_the_stated_way(nearby, monkeypatch, every):
    """To 1e-9 of the pull of 4 N, whether it is one of those solved both ways or not."""
    monkeypatch.setattr(session_module, "EVERY", every)
    change = {"tendons.EDC.tension": "4 N"}
    begun = cosim.run(CASE.replace({**change, "solve.start": "nearby"}), nearby)
    stated = cosim.run(CASE.replace({**change, **STRICT}))
    assert numbers(begun) == pytest.approx(numbers(stated), rel=0, abs=4e-9)
    assert begun.audit.passed
    assert ("second_start_force_N" in begun.summary["audit"]) == (every == 1)
    if every == 1:
        assert begun.summary["audit"]["second_start_force_N"] < 4e-9
        assert begun.tip_force == pytest.approx(stated.tip_force, rel=0, abs=1e-12)


def test_a_case_that_goes_both_ways_takes_no_unloaded_state_from_nearby(nearby, monkeypatch):
    case = CASE.replace({"finger.posture.PIP": "46 deg"})
    monkeypatch.setattr(session_module, "EVERY", 10**9)
    cosim.run(case.replace({"solve.start": "nearby"}), nearby)
    monkeypatch.setattr(session_module, "EVERY", 1)
    change = {"tendons.EDC.tension": "4 N"}
    both = cosim.run(case.replace({**change, "solve.start": "nearby"}), nearby)
    stated = cosim.run(case.replace({**change, **STRICT}))
    assert both.tip_force == pytest.approx(stated.tip_force, rel=0, abs=1e-12)


def test_what_depends_on_its_path_does_not_begin_nearby():
    with pytest.raises(cosim.InputError, match="nearby"):
        CASE.replace({"solve.start": "nearby", "hood.contact.friction": 0.1})
    with pytest.raises(cosim.InputError, match="nearby"):
        CASE.replace({"solve.start": "nearby", "coupling.scheme": "one_way"})


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
