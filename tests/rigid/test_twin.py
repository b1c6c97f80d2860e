"""One finger in two engines, and how fast the finger alone is."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.proofs.fingers import dynamics_rows
from tests.proofs.fingers.thesis_twin import LENGTHS, POSTURE, TENSIONS, twin_law, twin_model


def test_the_twin_is_the_thesis_s_finger() -> None:
    model, law = twin_model(), twin_law()
    assert tuple(s.length for s in model.segments[1:]) == LENGTHS
    assert model.muscles == tuple(m for m in model.muscles if m in TENSIONS)
    assert set(model.muscles) == set(TENSIONS)
    assert np.degrees(law.upper - law.lower) == pytest.approx(10.0)
    assert law.limit_stiffness == pytest.approx(np.degrees(20.0))
    assert not law.stiffness.any()
    for tendon in model.tendons:
        assert sum(s.share for s in tendon.strands) == pytest.approx(1.0)
        assert len(tendon.strands) == {"EDC": 3, "EI": 3, "LUM": 2, "FPI": 2}.get(tendon.name, 1)
    assert set(POSTURE) == set(law.joints)


def test_committed_figures_of_opensim() -> None:
    figures = json.loads(dynamics_rows.FIGURES.read_text(encoding="utf-8"))
    only = {m: figures["muscles"][m] for m in ("EDC", "FDS")}
    rows = list(dynamics_rows.twin_rows({**figures, "muscles": only}))
    assert len(rows) == 8
    assert "OpenSim 4.6" in rows[0].source
    for row in rows:
        assert row.passed, row


def test_contact_and_rest_rows() -> None:
    rows = [*dynamics_rows.contact_rows(), *dynamics_rows.rest_rows()]
    assert len(rows) == 9
    for row in rows:
        assert row.passed, row


@pytest.mark.slow
def test_device_sensitivity() -> None:
    rows = list(dynamics_rows.sensitivity_rows())
    bounds = [row for row in rows if row.measure == "bound"]
    assert len(bounds) >= 5
    for row in bounds:
        assert row.passed, row
        assert row.computed > 0
    assert sum("index finger" in row.name for row in rows) == 14


@pytest.mark.opensim
@pytest.mark.parametrize(
    "muscles", [("EDC",), pytest.param(tuple(TENSIONS), marks=pytest.mark.slow)]
)
def test_live_opensim(monkeypatch: pytest.MonkeyPatch, muscles: tuple[str, ...]) -> None:
    pytest.importorskip("opensim")
    monkeypatch.setattr(dynamics_rows, "TENSIONS", {m: TENSIONS[m] for m in muscles})
    rows = list(dynamics_rows.live_rows())
    assert len(rows) == 2 * len(muscles)
    for row in rows:
        assert row.passed, row
