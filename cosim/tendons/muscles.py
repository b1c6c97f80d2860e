"""The live muscles of a case.  One of the files that know the solvers by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cosim.errors import InputError
from cosim.port import Array
from cosim.tendons.table import TendonConfig

if TYPE_CHECKING:
    from rigid.muscle.parameters import Muscles


@dataclass(frozen=True)
class MusclePull:
    """Muscles at rest, (n,) each."""

    tension: Array
    """N."""
    normalised_length: Array
    """Fibre length over its optimum."""
    pennation: Array
    """rad."""


@dataclass(frozen=True)
class CaseMuscles:
    """The muscles of a case that have a fibre; the others' tensions are stated."""

    names: tuple[str, ...]
    pull: Callable[[Array], MusclePull]
    """The muscles' pull at shortenings (n,) m of their paths since the unloaded state."""


def live_muscles(tendons: Mapping[str, TendonConfig]) -> CaseMuscles:
    """The muscles that a case activates and gives a fibre.

    Raises InputError for a fibre length that is shorter than its muscle can be."""
    groups = fibres(tendons)
    names = tuple(name for muscles, _, _ in groups for name in muscles.names)

    def pull(shortening: Array) -> MusclePull:
        from rigid.muscle.millard import equilibrium

        out, first = np.zeros((3, len(names))), 0
        for muscles, activation, home in groups:
            span = slice(first, first + len(home))
            at = equilibrium(muscles, activation, home - shortening[span])
            out[:, span] = at.force, at.normalised_length, at.pennation
            first += len(home)
        return MusclePull(*out)

    return CaseMuscles(names, pull)


def fibres(tendons: Mapping[str, TendonConfig]) -> list[tuple[Muscles, Array, Array]]:
    """Muscles with elastic tendons and those with rigid ones, where the case has any: with their
    activations and their paths' lengths (m) at the fibre lengths that the case assumes.

    Raises InputError as `live_muscles`."""
    names: dict[str, list[str]] = {"elastic": [], "rigid": []}
    for name, tendon in tendons.items():
        if tendon.muscle is not None and tendon.activation is not None:
            names[tendon.muscle.tendon].append(name)
    return [
        _group(group, [tendons[name] for name in group], kind == "rigid")
        for kind, group in names.items()
        if group
    ]


def _group(
    names: Sequence[str], tendons: Sequence[TendonConfig], rigid: bool
) -> tuple[Muscles, Array, Array]:
    from rigid.muscle.millard import path_length
    from rigid.muscle.parameters import Muscles

    stated = [t.muscle for t in tendons if t.muscle is not None]
    muscles = Muscles(
        tuple(names),
        np.array([t.max_force for t in tendons]),
        np.array([m.optimal_fibre_length for m in stated]),
        np.array([m.tendon_slack_length for m in stated]),
        np.array([m.pennation for m in stated]),
        rigid_tendon=rigid,
    )
    activation = np.array([t.activation for t in tendons], dtype=float)
    try:
        home = path_length(muscles, np.array([m.fibre_length for m in stated]), activation)
    except InputError as error:
        raise InputError(f"tendons: {error}; raise fibre_length") from None
    return muscles, activation, home
