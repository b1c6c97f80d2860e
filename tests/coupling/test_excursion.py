"""Tendons whose ends are displaced instead of loaded."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.case.file import load_case
from cosim.errors import ConvergenceError, InputError
from cosim.pipeline import run_case

PLAIN = "output.picture=false"


FREE = "finger.tip={kind='free'}"


def summary(name: str, *settings: str) -> dict:
    return run_case(load_case(name, [PLAIN, *settings])).summary


@pytest.mark.parametrize(
    ("name", "tendon", "setting"),
    [
        ("pulley_edc", "EDC", FREE),
        ("isometric_edc_transversely_isotropic", "EDC", "hood.mesh.quads=120"),
    ],
)
def test_an_excursion_takes_the_tension_that_makes_it(name: str, tendon: str, setting: str) -> None:
    pulled = summary(name, f"tendons.{tendon}.tension=2 N", setting)
    way = float(pulled["excursion_mm"][tendon] - pulled["unloaded"]["excursion_mm"][tendon])
    drawn = summary(name, f"tendons.{tendon}.excursion={way!r} mm", setting)
    assert drawn["tension_N"][tendon] == pytest.approx(2.0, abs=2e-3)
    assert drawn["fingertip_force_N"] == pytest.approx(pulled["fingertip_force_N"], abs=1e-3)


def test_two_tendons_at_once_and_one_of_the_finger_s_own() -> None:
    both = ["tendons.EDC.tension=2 N", "tendons.FDP.tension=3 N"]
    pulled = summary("pulley_edc", FREE, *both)
    way = float(pulled["excursion_mm"]["EDC"] - pulled["unloaded"]["excursion_mm"]["EDC"])
    mixed = summary("pulley_edc", FREE, f"tendons.EDC.excursion={way!r} mm", both[1])
    assert mixed["tension_N"]["EDC"] == pytest.approx(2.0, abs=1e-3)
    assert mixed["tension_N"]["FDP"] == 3.0
    alone = summary("split_fdp", FREE, "tendons.FDP.excursion=0.5 mm")
    force = float(alone["tension_N"]["FDP"])
    assert force > 0.06  # more than at rest
    pulled = summary("split_fdp", FREE, f"tendons.FDP.tension={force!r} N")
    assert pulled["posture_deg"] == pytest.approx(alone["posture_deg"], abs=1e-4)


def test_a_tendon_that_would_have_to_push_is_said_to() -> None:
    with pytest.raises(ConvergenceError, match=r"tendons\.EDC\.excursion: -5 mm would slacken"):
        summary("pulley_edc", FREE, "tendons.EDC.excursion=-5 mm")


def test_an_excursion_stands_alone() -> None:
    with pytest.raises(InputError, match="gives an excursion and a tension"):
        load_case("split_edc", ['tendons={EDC={excursion="1 mm",tension="1 N"}}'])
    with pytest.raises(InputError, match="a motion begins with the tendon's end undisplaced"):
        summary("split_edc", "tendons.EDC.excursion=1 mm", "forward={}")
    assert np.isfinite(load_case("split_edc", ["tendons.EDC.excursion=1 mm"]).tension("EDC"))
