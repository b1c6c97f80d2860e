"""The published hood among the validations: from a trial to its summary."""

from __future__ import annotations

from typing import Any

from cosim.validation.plan import MODULI
from cosim.validation.trial import Trial

PULL = 11.8
"""N."""
MEAN_SD = {
    "tendon_proximal": (76.22, 24.53),
    "tendon_distal": (53.16, 21.24),
    "central_band": (100.61, 50.82),
    "central_slip": (100.76, 46.77),
    "lateral_band": (105.38, 85.06),
    "terminal_slip": (89.67, 48.29),
    "sheet": (54.68, 14.13),
}
"""MPa: Qian et al. 2014, as in the thesis's table 4."""


def published_summary(trial: Trial) -> dict[str, Any]:
    """What the hood in the trial's file says.  Raises InputError and ConvergenceError."""
    from fe_solver.febio.published_hood import Moduli, solve_published_hood

    off = MODULI[trial.name.split()[-1]]
    moduli = {name: 1e6 * (mean + off * sd) for name, (mean, sd) in MEAN_SD.items()}
    return solve_published_hood(trial.case, Moduli(**moduli), PULL).summary()
