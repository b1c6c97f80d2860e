"""A kind of hood in one file, for a copy of the package: an elastic
string from the metacarpal over the PIP to the middle phalanx."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from cosim.hoods.kind import BuiltHood, HoodBuilder, HoodConfig, HoodKind, Site
from cosim.hoods.view import STRAIN, Field
from cosim.port import Array, State
from cosim.schema import units
from cosim.schema.fields import quantity

POINTS = (
    ("metacarpal", (0.0, 0.0, 9e-3)),
    ("proximal", (9e-3, 0.0, 8e-3)),
    ("proximal", (42e-3, 0.0, 5e-3)),
    ("middle", (6e-3, 0.0, 5e-3)),
)
"""m, in the bodies' frames."""


class StringHood(HoodConfig):
    """One elastic string over the PIP."""

    title: ClassVar[str] = "one elastic string over the PIP"
    fits: ClassVar[tuple[str, ...]] = ("index",)
    example: ClassVar[tuple[str, ...]] = ("pulley_edc", 'hood={kind="string"}')
    kind: Literal["string"]
    stiffness: Annotated[float, quantity(units.STIFFNESS, above="0 N/mm", most="1e6 N/mm")] = 5e4

    def tendon_names(self, finger: str) -> tuple[str, ...]:
        return ("EDC",)


@dataclass(frozen=True)
class StringView:
    """A string in the world."""

    points: Array
    tension: float
    strain: float
    iterations: int = 0

    @property
    def plot_cells(self) -> np.ndarray:
        return np.array(list(pairwise(range(len(self.points)))))

    def fields(self) -> tuple[Field, ...]:
        strain = np.full(len(self.plot_cells), self.strain)
        still = np.zeros_like(self.points)
        tension = np.array([self.tension])
        return (
            Field("node", ("point", "axis"), "m", "point of the string", self.points),
            Field("string_tension", ("string",), "N", "tension of the string", tension),
            Field("displacement", ("point", "axis"), "m", "none", still, False, on_mesh=True),
            Field(STRAIN, ("cell",), "1", "strain", strain, False, on_mesh=True),
        )

    def lines(self) -> Mapping[str, Array]:
        return {}

    def coordinates(self) -> Mapping[str, Any]:
        return {"string": ["EDC"]}

    def size(self) -> Mapping[str, int]:
        return {"hood_cells": len(self.plot_cells)}

    def summary(self) -> Mapping[str, Any]:
        return {"string_tension_N": {"EDC": self.tension}}

    def change(self, before: StringView) -> Mapping[str, Any]:
        return {"string_tension_N": {"EDC": self.tension - before.tension}}


def build(hood: StringHood, site: Site) -> BuiltHood:
    from rigid.hoods.pulley import Cable, PulleyHood

    string = Cable(POINTS, compliance=1 / hood.stiffness)
    return BuiltHood(
        PulleyHood({"EDC": string}, site.rest), view=partial(view, hood), slips=slip_forces
    )


def view(hood: StringHood, state: State) -> StringView:
    points = []
    for body, point in POINTS:
        position, rotation = state.motion.of(body)
        points.append(position + rotation @ np.array(point))
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    tension = float(state.tension[0])
    return StringView(np.array(points), tension, tension / hood.stiffness / float(length))


def slip_forces(state: State) -> dict[str, float]:
    return {"central": float(state.tension[0]), "terminal": 0.0}


BUILDER = HoodBuilder(build)
KIND = HoodKind(StringHood, f"{__name__}:BUILDER")
