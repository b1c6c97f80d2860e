"""The fibre directions of a shell hood's regions, as its mesh and its case have them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cosim.errors import InputError
from cosim.hoods.shell.fibre_table import DirectionConfig
from cosim.port import Array
from cosim.schema.types import RegionConfig
from fe_solver.elements.fibres import (
    angle_between,
    follow_mesh,
    gauss_points,
    normals,
    smooth_fibres,
    turn_in_sheet,
)
from meshes.hood_mesh import REGIONS, HoodMesh, has_lateral_fibres
from meshes.region_places import Turns, region_places, side_of, turns
from meshes.skeleton import Skeleton


@dataclass(frozen=True)
class Fibres:
    """Directions at the Gauss points of a hood as laid out: those of the first family (ne, g, 3) in
    every region, and by region those of a second one (k, g, 3) on its elements, with the angle
    from the first to the second (k, g), rad, counter-clockwise about the normal."""

    first: Array
    second: Mapping[int, Array]
    angle: Mapping[int, Array]


def fibres_of(
    mesh: HoodMesh, points: Array, regions: Mapping[str, RegionConfig], skeleton: Skeleton
) -> Fibres:
    """The directions of a case's regions on a mesh whose mid-surface is at points (n, 3).

    Raises InputError for a field that the mesh does not have."""
    laid = _FibreMesh(mesh, points, skeleton)
    first, second, angle = laid.own.copy(), {}, {}
    for i in np.unique(mesh.region):
        region, cells = regions[REGIONS[i]].fibrous, mesh.region == i
        if region is None:
            continue
        if region.direction is not None:
            first[cells] = laid.directions(i, region.direction, "direction")
        if region.second is not None:
            stated = region.second.direction
            second[i] = laid.directions(i, stated, "second.direction")
            angle[i] = angle_between(points, mesh.quads[cells], first[cells], second[i])
    return Fibres(first, second, angle)


def at_gauss_points(mesh: HoodMesh, fibre: Array) -> Array:
    """Directions at the Gauss points (ne, g, 3) of directions (ne, 3).  Those of quadratic elements
    follow the mesh's lines; one an element, smoothed, is of first order at a region's edge, where a
    soft matrix is drawn aside by the width of a column."""
    if mesh.quadratic:
        return follow_mesh(mesh.points, mesh.quads, fibre)
    return smooth_fibres(mesh.quads, fibre, mesh.region)


class _FibreMesh:
    """A mesh whose directions are asked for; what it takes to tell sides is made when it is."""

    def __init__(self, mesh: HoodMesh, points: Array, skeleton: Skeleton) -> None:
        self.mesh, self.points, self.skeleton = mesh, points, skeleton
        self.own = at_gauss_points(mesh, mesh.fibre)
        self._turns: Turns | None = None

    def directions(self, region: int, stated: DirectionConfig, key: str) -> Array:
        """Unit directions (k, g, 3) on a region's elements."""
        cells = self.mesh.region == region
        if stated.field is not None:
            return at_gauss_points(self.mesh, self._field(region, stated.field, key))[cells]

        return turn_in_sheet(
            self.points, self.mesh.quads[cells], self.own[cells], self._angles(region, stated)
        )

    def _field(self, region: int, name: str, key: str) -> Array:
        if name not in self.mesh.fields:
            known = ", ".join(self.mesh.fields) or "none"
            raise InputError(
                f"hood.regions.{REGIONS[region]}.{key}.field: the hood's mesh has no field "
                f"{name!r} of directions; it has {known}"
            )
        return self.mesh.fields[name]

    def _angles(self, region: int, stated: DirectionConfig) -> Array:
        """Angles (k, g) rad from the mesh's own direction, counter-clockwise about the normal."""
        laid = self._turns = self._turns or turns(self.mesh, self.skeleton)
        quads = self.mesh.quads[self.mesh.region == region]
        turn, station, outward = (
            gauss_points(values, quads) for values in (laid.turn, self.mesh.station, laid.outward)
        )
        places = region_places(self.mesh, region, laid.turn, station, turn)
        angle = side_of(region, turn) * angles_at(stated, *places)
        # a normal that points away from the finger has radial to the left of distal
        angle = angle * np.sign(np.vdot(normals(self.points, quads), outward))
        return np.asarray(angle + (np.pi / 2 if has_lateral_fibres(REGIONS[region]) else 0.0))


def angles_at(stated: DirectionConfig, along: Array, across: Array) -> Array:
    """The angles (...) rad of the spline through a direction's angles at places (...) of a region;
    of a cubic one where there are four places or more.  Beyond its first and last place it is
    level."""
    from scipy.interpolate import RectBivariateSpline, make_interp_spline

    grid = np.asarray(stated.angle, dtype=float)
    if stated.along is None:
        return np.full(along.shape, float(grid))
    x = np.clip(along, stated.along[0], stated.along[-1])
    if stated.across is None:
        return np.asarray(make_interp_spline(stated.along, grid, min(3, len(grid) - 1))(x))
    y = np.clip(across, stated.across[0], stated.across[-1])
    kx, ky = (min(3, n - 1) for n in grid.shape)
    return np.asarray(RectBivariateSpline(stated.along, stated.across, grid, kx=kx, ky=ky).ev(x, y))
