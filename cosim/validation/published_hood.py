"""The published hood among the validations: from a trial to its summary."""

from __future__ import annotations

from typing import Any

from cosim.validation.plan import MODULI
from cosim.validation.trial import Trial
from fe_solver.febio.published_hood import qian_moduli, solve_published_hood

PULL = 11.8
"""N."""


def published_summary(trial: Trial) -> dict[str, Any]:
    """What the hood in the trial's file says.  Raises InputError and ConvergenceError."""
    moduli = qian_moduli(MODULI[trial.published])
    return solve_published_hood(trial.case, moduli, PULL).summary()
