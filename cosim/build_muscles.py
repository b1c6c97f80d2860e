"""From the muscles of a case to live ones.  One of the files that know the solvers by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cosim.case_schema import Case
from cosim.port import Array, InputError


@dataclass(frozen=True)
class Pull:
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
    pull: Callable[[Array], Pull]
    """Of the shortening (n,) of their paths since the unloaded state, m."""


def live_muscles(case: Case) -> CaseMuscles:
    """The muscles that the case activates and gives a fibre.

    Raises InputError for a fibre length that is shorter than its muscle can be."""
    stated = {
        name: (tendon, tendon.muscle)
        for name, tendon in case.tendons.items()
        if tendon.muscle is not None and tendon.activation is not None
    }
    names = tuple(stated)
    if not names:
        return CaseMuscles((), lambda shortening: Pull(*np.zeros((3, 0))))
    groups = [
        (rigid, tuple(n for n, (_, m) in stated.items() if (m.tendon == "rigid") == rigid))
        for rigid in (False, True)
    ]
    parts = [_group(case, group, rigid) for rigid, group in groups if group]
    where = [np.array([names.index(n) for n in group]) for _, group in groups if group]

    def pull(shortening: Array) -> Pull:
        out = np.zeros((3, len(names)))
        for part, index in zip(parts, where, strict=True):
            out[:, index] = part(shortening[index])
        return Pull(*out)

    return CaseMuscles(names, pull)


def _group(case: Case, names: tuple[str, ...], rigid: bool) -> Callable[[Array], Array]:
    """(3, n) tension, normalised length and pennation by shortening, of muscles whose tendons are
    all elastic or all rigid."""
    from rigid.muscle.millard import equilibrium, path_length
    from rigid.muscle.parameters import Muscles

    tendons = [case.tendons[n] for n in names]
    fibres = [t.muscle for t in tendons if t.muscle is not None]
    muscles = Muscles(
        names,
        np.array([t.max_force for t in tendons]),
        np.array([m.optimal_fibre_length for m in fibres]),
        np.array([m.tendon_slack_length for m in fibres]),
        np.array([m.pennation for m in fibres]),
        rigid_tendon=rigid,
    )
    activation = np.array([t.activation for t in tendons], dtype=float)
    try:
        home = path_length(muscles, np.array([m.fibre_length for m in fibres]), activation)
    except InputError as error:
        raise InputError(f"tendons: {error}; raise fibre_length") from None

    def pull(shortening: Array) -> Array:
        at = equilibrium(muscles, activation, home - shortening)
        return np.stack([at.force, at.normalised_length, at.pennation])

    return pull
