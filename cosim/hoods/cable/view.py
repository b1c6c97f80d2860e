"""What a cable hood looks like solved."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from cosim.hoods.fe_view import FeView, Lines, guide_depth, view_at
from cosim.hoods.view import STRAIN, Field
from cosim.port import Array, State
from fe_solver.hood.build import pulls_in
from fe_solver.hood.shell_hood import ShellHood as FeHood
from meshes.bands import net_bands
from meshes.cable_net import CableNet
from meshes.glide import net_places
from meshes.skeleton import JOINTS, Skeleton


@dataclass(frozen=True, kw_only=True)
class CableView(FeView):
    """What there is to see of a solved cable hood."""

    cells: np.ndarray
    """(k, 2)."""
    strand: np.ndarray
    """(k,) index into `strands`."""
    strands: tuple[str, ...]
    strain: Array
    """(k,) engineering strain."""
    tension: Array
    """(k,) N."""
    contact_force: Array
    """(n,) N of the bones on the nodes, sum of magnitudes."""

    @property
    def plot_cells(self) -> np.ndarray:
        return self.cells

    def fields(self) -> tuple[Field, ...]:
        cell, point = ("cell",), ("point",)

        def mesh(name: str, unit: str, what: str, values: Array) -> Field:
            return Field(name, cell, unit, what, values, in_results=False, on_mesh=True)

        taut = np.maximum(self.strain, 0.0)  # a slack cable has none
        force = self.contact_force
        return (
            *super().fields(),
            Field("cable_strain", cell, "1", "strain", self.strain),
            Field("cable_tension", cell, "N", "tension", self.tension),
            Field("contact_force", point, "N", "force of the bones", force, on_mesh=True),
            mesh(STRAIN, "1", "strain of taut cables", taut),
            mesh("end_to_end_strain", "1", "strain from end to end", self.strain),
            mesh("tension", "N", "tension", self.tension),
            mesh("strand", "", "index of the strand", self.strand),
        )

    def coordinates(self) -> Mapping[str, Any]:
        names = [self.strands[i] for i in self.strand]
        ends = (("cell", "end"), self.cells)
        return {"strand": ("cell", names), "cell_node": ends, **super().coordinates()}

    def size(self) -> Mapping[str, int]:
        return {"hood_cells": len(self.cells)}

    def own_summary(self) -> Mapping[str, Any]:
        """Largest tension (N) and mean strain (per cent) of each strand."""
        out = {}
        for i, name in enumerate(self.strands):
            on = self.strand == i
            out[name] = {
                "tension_N": float(self.tension[on].max()),
                "mean_strain_percent": 100 * float(self.strain[on].mean()),
            }
        return {"cable": out}


def view_of(hood: FeHood, net: CableNet, skeleton: Skeleton) -> Callable[[State], CableView]:
    """What there is to see at a state."""
    lines = Lines(net_places(net), net_bands(net), skeleton.axis[JOINTS.index("PIP")])
    return partial(_view, hood, net, guide_depth(hood), lines)


def _view(hood: FeHood, net: CableNet, depth: float, lines: Lines, state: State) -> CableView:
    seen, pull = view_at(hood, depth, lines, state), pulls_in(hood, state)
    points = state.solution.evaluation.points
    on = points.group < 0
    pressed = np.linalg.norm(points.gradient[on], axis=1)
    return CableView(
        **vars(seen),
        cells=net.cells,
        strand=net.strand,
        strands=net.strands,
        strain=pull.strain,
        tension=pull.force,
        contact_force=np.bincount(points.node[on], pressed, len(seen.points)).astype(float),
    )
