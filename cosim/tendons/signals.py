"""The signal of a tension or an activation over time, as a function.

One of the files that know the solvers by name, for the tables that OpenSim writes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cosim.errors import InputError
from cosim.port import Array
from cosim.tendons.table import FileSignalConfig, PointsSignalConfig, SineSignalConfig
from cosim.text_tables import read_csv


@dataclass(frozen=True)
class LiveSignal:
    """A signal that is set while the motion goes on (`cosim.Loop`); no case file states it."""

    factor: Callable[[float], float]
    """The factor at a time in s."""


def factor_of(
    signal: PointsSignalConfig | SineSignalConfig | FileSignalConfig | LiveSignal | None,
) -> Callable[[float], float]:
    """The factor at a time in s; one at all times without a signal.

    Raises InputError for a file that holds no such column, or values that are not factors."""
    match signal:
        case None:
            return lambda time: 1.0
        case LiveSignal():
            return signal.factor
        case SineSignalConfig():
            rate, mean, most, phase = (
                *(2 * np.pi * signal.frequency, signal.mean),
                *(signal.amplitude, signal.phase),
            )
            return lambda t: max(mean + most * float(np.sin(rate * t + phase)), 0.0)
        case PointsSignalConfig():
            times, factors = np.array(signal.at).T
        case FileSignalConfig():
            times, factors = _recorded_signal(signal.path, signal.column)
    return lambda t: float(np.interp(t, times, factors))


def _recorded_signal(path: Path, column: str) -> tuple[Array, Array]:
    times, values = (_csv if path.suffix.lower() == ".csv" else _sto)(path, column)
    ordered = len(times) > 0 and bool((np.diff(times) > 0).all())
    if not (ordered and np.isfinite(values).all() and (values >= 0).all()):
        raise InputError(
            f"{path}, column {column!r}: expected times that rise and values that are finite and "
            "not negative"
        )
    return times, values


def _sto(path: Path, column: str) -> tuple[Array, Array]:
    from rigid.opensim.sto import read_sto

    table = read_sto(path, ())
    if column not in table.columns:
        raise InputError(f"{path}: has no column {column!r}; it has {', '.join(table.columns)}")
    return table.time, table.values[:, table.columns.index(column)]


def _csv(path: Path, column: str) -> tuple[Array, Array]:
    table = read_csv(path, f"time,{column}")
    return table.numbers("time"), table.numbers(column)
