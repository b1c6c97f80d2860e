"""A case has one answer, whatever else is solved, in which order, and a little beside its start."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from cosim.array_cache import VARIABLE
from cosim.case.file import load_case
from cosim.case.schema import Case
from cosim.face import run_many
from cosim.models.build import Models
from cosim.pipeline import run_case
from cosim.port import PairState
from cosim.results.compare import numbers_of
from cosim.solve.session import Session
from tests.helpers.shells import COARSE_NET

HOODS = {
    "isometric_edc": ("hood.mesh.quads=120",),
    "cable_edc": (COARSE_NET,),
    "split_edc": (),
}
KINDS = ("fingertip_force_N", "slip_force_N", "joint_torque_Nmm", "posture_deg", "moment_arm_mm")
SAME = 1e-7


@cache
def case_of(name: str) -> Case:
    return load_case(name, HOODS[name])


@cache
def stated(name: str) -> dict[str, Any]:
    """The summary of a case that is run alone."""
    return run_case(case_of(name)).summary


def neighbours(name: str) -> list[Case]:
    return [case_of(name).replace({"tendons.EDC.tension": f"{n} N"}, name=f"{n}") for n in (1, 4)]


def gap(name: str, summary: dict[str, Any]) -> float:
    """The largest difference (N, N mm, deg, mm) from the case that is run alone."""
    a, b = (numbers_of({k: s[k] for k in KINDS if k in s}) for s in (stated(name), summary))
    assert a.keys() == b.keys()
    assert a
    return max(abs(a[path] - b[path]) for path in a)


@pytest.mark.parametrize("name", HOODS)
def test_what_was_solved_before_in_a_session_changes_no_bit(name):
    session = Session()
    for case in neighbours(name):
        run_case(case, session)
    assert gap(name, run_case(case_of(name), session).summary) == 0
    other, found = run_many([neighbours(name)[1], case_of(name)])
    assert gap(name, other.summary) > 0.01
    assert gap(name, found.summary) == 0


@pytest.mark.parametrize("name", HOODS)
def test_a_session_that_starts_nearby_ends_in_the_same_equilibrium(name):
    session = Session(warm=True)
    for case in neighbours(name):
        run_case(case, session)
    assert gap(name, run_case(case_of(name), session).summary) < SAME


@pytest.mark.parametrize("name", HOODS)
def test_the_order_of_tendons_in_a_case_file_is_none(name):
    case = case_of(name)
    turned = case.model_copy(update={"tendons": dict(reversed(case.tendons.items()))})
    assert list(turned.tendons) != list(case.tendons)
    assert gap(name, run_case(turned).summary) < SAME


@pytest.mark.parametrize("name", ["isometric_edc", "cable_edc"])
def test_a_start_a_nanometre_beside_leads_to_the_same(name, monkeypatch):
    monkeypatch.setenv(VARIABLE, "off")
    begin = Models.start

    def start(models: Models) -> PairState:
        at = begin(models)
        c, held = at.hood.configuration, models.hood.model
        beside = 1e-9 * np.random.default_rng(1).standard_normal(c.x.shape)
        beside[np.concatenate([held.ties.node, held.guides.node])] = 0.0
        return at._replace(hood=replace(at.hood, configuration=replace(c, x=c.x + beside)))

    expected = stated(name)
    monkeypatch.setattr(Models, "start", start)
    found = run_case(case_of(name)).summary
    assert found["fingertip_force_N"] != expected["fingertip_force_N"]
    assert gap(name, found) < SAME
