"""Published experiments on lengths and cuts beside the net of cables and the network: comparisons,
which never fail for a model that misses.  The shell is beside them among the validations."""

from __future__ import annotations

from collections.abc import Iterator

from cosim.analyses.length_experiments import EXPERIMENT_MODELS, Experiment, experiments
from tests.helpers.rows import Row


def rows(what: str, hood: str) -> Iterator[Row]:
    """The rows of an experiment of EXPERIMENT_MODELS and a hood of HOODS."""
    for name, where, value, shown in EXPERIMENT_MODELS[what].values(hood, ()):
        model = ", ".join(filter(None, (hood, where))) + shown
        yield row_of(experiments()[name], model, value)


def row_of(e: Experiment, model: str, computed: float) -> Row:
    """An experiment beside what a model, which is named, computes."""
    source, quantity = f"{e.source}; n {e.n}; {e.read}", f"{e.measured}, {e.unit}"
    if e.at_least is not None:
        text, more = f"{quantity}: at least", max(computed - e.at_least, 0.0)
        return Row(model, text, e.at_least, computed, more, source, "comparison")
    assert e.mean is not None  # it has no bound
    kind = "shown" if e.sd is None else "comparison"
    return Row(model, quantity, e.mean, computed, e.sd or 0.0, source, kind)
