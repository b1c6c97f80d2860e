"""What muscles can bear: areas, greatest forces, and where the numbers are from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cosim.case.schema import Case
from cosim.errors import InputError
from cosim.port import Array

Weights = Literal["pcsa", "F0", "one"]
SPECIFIC_TENSION = 45e4
"""Pa: Holzbaur et al. 2005, as Synek et al. 2019 (PeerJ 7:e7470) take it for hands."""
CM2 = 1e-4


@dataclass(frozen=True)
class Capacity:
    """What every tendon can pull, the hood's first: area (n,) m2, least and greatest force (n,) N,
    and the sources of area and greatest force in words."""

    names: tuple[str, ...]
    area: Array
    least: Array
    most: Array
    sources: tuple[tuple[str, str], ...]

    def weight(self, by: Weights) -> Array:
        """What a tension is divided by in the cost (n,): m2, N or 1."""
        return {"pcsa": self.area, "F0": self.most, "one": np.ones(len(self.names))}[by]


def capacity(
    case: Case,
    names: tuple[str, ...],
    areas: Mapping[str, float] | None = None,
    most: Mapping[str, float] | None = None,
    weights: Weights = "pcsa",
) -> Capacity:
    """Areas (m2) and greatest forces (N) of the tendons `names`: as given here, else of the case
    (max_force) and of the finger's table, else area times SPECIFIC_TENSION.

    Tensions are at least the case's resting tension where the hood is a sheet or a net, which a
    slack tendon would leave without hold, else zero.  With other `weights` than areas an unknown
    area is NaN.  Raises InputError for a tendon that nobody knows."""
    areas, most = dict(areas or {}), dict(most or {})
    for option, given in (("--area", areas), ("--most", most)):
        for name, value in given.items():
            if value < 0 or (value == 0 and given is areas):
                bound = "above 0" if given is areas else "0 or more"
                raise InputError(f"{option} {name}: must be {bound}")
            if name not in names:
                raise InputError(
                    f"{option} {name}: this finger and hood have no such tendon; they have "
                    + ", ".join(names)
                )
    with_sources = _areas(case, names, areas, weights)
    area = np.array([a for a, _ in with_sources])
    limits = [_most(case, name, a, most) for name, a in zip(names, area, strict=True)]
    rest = 0.0 if case.hood.needs_no_tension else case.solve.resting_tension
    least = np.full(len(names), rest)
    force = np.array([m for m, _ in limits])
    sources = tuple((a, m) for (_, a), (_, m) in zip(with_sources, limits, strict=True))
    return Capacity(names, area, np.minimum(least, force), force, sources)


def _areas(
    case: Case, names: tuple[str, ...], areas: Mapping[str, float], weights: Weights
) -> list[tuple[float, str]]:
    """The area (m2) of each muscle and its source.  Raises InputError that names all without."""
    table, source = case.finger.muscle_areas(names)
    out, unknown = list[tuple[float, str]](), list[str]()
    for name in names:
        tendon = case.tendons.get(name)
        if name in areas:
            out.append((areas[name], "given"))
        elif name in table:
            out.append((CM2 * table[name], source))
        elif weights != "pcsa" and tendon is not None and tendon.max_force:
            out.append((float("nan"), "unknown"))
        else:
            unknown.append(name)
    if unknown:
        options = " ".join(f'--area {name}="2 cm**2"' for name in unknown)
        raise InputError(
            f"{', '.join(unknown)}: no area is known of "
            f"{'this muscle' if len(unknown) == 1 else 'these muscles'}; state it, for example "
            f"{options}"
        )
    return out


def _most(case: Case, name: str, area: float, most: Mapping[str, float]) -> tuple[float, str]:
    if name in most:
        return most[name], "given"
    tendon = case.tendons.get(name)
    if tendon is not None and tendon.max_force is not None:
        return tendon.max_force, "case, max_force"
    return SPECIFIC_TENSION * area, "area times 45 N/cm2 (Holzbaur 2005)"
