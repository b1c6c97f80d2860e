"""Lesions and their signs, and published experiments on lengths and cuts."""

from __future__ import annotations

import pytest

from cosim.analyses.length_experiments import EXPERIMENT_MODELS
from tests.proofs.studies import length_rows, lesion_rows


@pytest.mark.slow
def test_signs_of_lesions(judge):
    judge(lesion_rows.sign_rows())


@pytest.mark.slow
def test_repairs(judge):
    judge(lesion_rows.repair_rows())


@pytest.mark.slow
def test_what_a_lesion_does_not_show(judge):
    judge(lesion_rows.doubtful_rows())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "hood"), [(w, h) for w, study in EXPERIMENT_MODELS.items() for h in study.hoods]
)
def test_lengths_and_cuts(judge, what, hood):
    judge(length_rows.rows(what, hood))
