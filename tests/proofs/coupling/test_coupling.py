"""The schemes that couple in time and at rest."""

from __future__ import annotations

import pytest

from tests.proofs.coupling import fmu_rows, rest_rows, scheme_rows, thesis_rows


def test_partitioned_is_monolithic(judge):
    judge(scheme_rows.monolithic_rows())


@pytest.mark.slow
def test_orders_of_the_schemes(judge):
    judge(scheme_rows.order_rows())


@pytest.mark.slow
def test_stiff_pair(judge):
    judge(scheme_rows.stiff_rows())


@pytest.mark.slow
def test_hood_solves(judge):
    judge(scheme_rows.solves_rows())


@pytest.mark.slow
def test_one_equilibrium_by_three_schemes(judge):
    judge(rest_rows.first_rows())


@pytest.mark.slow
def test_one_equilibrium_by_three_schemes_with_all_muscles(judge):
    judge(rest_rows.other_rows())


@pytest.mark.slow
def test_one_way_pass_of_the_thesis(judge):
    judge(thesis_rows.thesis_rows())


@pytest.mark.slow
@pytest.mark.fmu
def test_an_fmu_of_cables(judge):
    judge(fmu_rows.rows("pulley_edc", ()))


@pytest.mark.slow
@pytest.mark.fmu
def test_an_fmu_of_the_shell(judge):
    judge(fmu_rows.rows("isometric_edc", fmu_rows.SLOW))


@pytest.mark.slow
@pytest.mark.fmu
def test_fmus_in_motion(judge):
    judge(fmu_rows.motion_rows())
