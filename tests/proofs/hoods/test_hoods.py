"""Hoods in lumped form and of cables against closed forms and their papers."""

from __future__ import annotations

import pytest

from tests.helpers.rows import Row
from tests.proofs.hoods import (
    cable_rows,
    contact_rows,
    hood_rows,
    network_study_rows,
    reduction_rows,
    sharing_rows,
)


def test_network(judge):
    judge(hood_rows.network_rows())


def test_two_bands(judge):
    judge(hood_rows.two_band_rows())


@pytest.mark.slow
def test_point_contact(judge):
    judge(contact_rows.rows())


@pytest.mark.slow
def test_force_sharing(judge):
    judge(sharing_rows.rows())


def test_switch(judge):
    judge(network_study_rows.switch_rows())


def test_identification(judge):
    judge(network_study_rows.identification_rows())


def test_inverse_prediction(judge):
    judge(network_study_rows.inverse_rows())


@pytest.mark.slow
def test_virtual_testbed(judge):
    judge(network_study_rows.testbed_rows())


def test_tangents_of_cables(judge):
    judge(cable_rows.tangent_rows())


def test_cables_in_closed_form(judge):
    judge(cable_rows.closed_form_rows())


def test_net_of_cables(judge):
    judge(cable_rows.net_rows())


@pytest.mark.slow
def test_a_hood_reduced_from_a_network(judge):
    judge(reduction_rows.network_rows())


@pytest.fixture(scope="module")
def reduced() -> list[Row]:
    """An hour of one core."""
    return list(reduction_rows.shell_rows())


def is_worst_tip_force(row: Row) -> bool:
    return row.quantity.startswith("tip force") and ", most," in row.quantity


@pytest.mark.slow
def test_a_hood_reduced_from_the_shell(judge, reduced):
    judge(row for row in reduced if not is_worst_tip_force(row))


@pytest.mark.slow
@pytest.mark.xfail(
    strict=True,
    reason="polynomials of degree 4 do not follow the shell everywhere: where they are worst, of "
    "the states held out, the tip force is 10 % off, and 16 % of its mean, for a mark of 5",
)
def test_the_worst_tip_force_of_a_hood_reduced_from_the_shell(judge, reduced):
    judge(filter(is_worst_tip_force, reduced))
