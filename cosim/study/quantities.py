"""What a study looks at in a run's summary."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from cosim.errors import InputError, nearest_names
from cosim.results.compare import value_of
from cosim.schema.fields import is_number

NEAREST = 3


def check_outputs(outputs: Mapping[str, str], summary: Mapping[str, Any]) -> None:
    """Raises InputError, with the nearest that there are, for paths where a run has no number; a
    ratio whose divisor is zero in this run is let pass."""
    known = list(paths(summary))
    faults = []
    for name, quantity in outputs.items():
        for path in quantity.partition("/")[::2]:
            if path and value_of(summary, path) is None:
                near = nearest_names(path, known, NEAREST)
                hint = f"; nearest: {', '.join(near)}" if near else ""
                faults.append(f"outputs.{name}: the run has no number at {path}{hint}")
    if faults:
        raise InputError("\n  ".join(["what the study looks at is not there", *faults]))


def paths(summary: Mapping[str, Any], above: str = "") -> Iterator[str]:
    """The path of every number in a summary, as outputs name them."""
    for key, value in summary.items():
        if isinstance(value, Mapping):
            yield from paths(value, f"{above}{key}.")
        elif is_number(value):
            yield f"{above}{key}"
