"""Published experiments on lengths and cuts beside the net of cables and the network: comparisons,
which never fail for a model that misses.  The shell is beside them among the validations."""

from __future__ import annotations

from collections.abc import Iterator

from cosim.analyses.length_experiments import EXPERIMENT_MODELS, experiments
from cosim.checks import Row


def rows(what: str, hood: str) -> Iterator[Row]:
    """The rows of an experiment of EXPERIMENT_MODELS and a hood of HOODS."""
    for name, where, value, shown in EXPERIMENT_MODELS[what].values(hood, ()):
        model = ", ".join(filter(None, (hood, where))) + shown
        yield experiments()[name].row(model, value)
