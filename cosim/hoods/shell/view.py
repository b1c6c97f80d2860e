"""What a shell hood looks like solved, and its strains in numbers: by region and direction, from
free of stress and from unloaded.

Longitudinal is along the mesh's lines along the finger (in sagittal bands: round it), whichever way
the fibres run.  The sheet's own strain over the central region is read by gauges at the markers.  A
cadaver experiment sees how markers on the hood move from the unloaded to the loaded state; the
sheet's own Green-Lagrange strain counts from where it is free of stress.  With l1 and l0 the
lengths of a material line in the two states, e = l1 / l0 - 1 is what markers show (engineering
strain), and (l1^2 / l0^2 - 1) / 2 the Green-Lagrange strain from the unloaded state.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from cosim.hoods.fe_view import FeView, Lines, guide_depth, view_at
from cosim.hoods.shell.fibres import at_gauss_points
from cosim.hoods.shell.gauges import STRAIN_COMPONENTS, Gauges, neighbour_strains, strain_between
from cosim.hoods.shell.region_forces import (
    Crossing,
    JointStrips,
    all_strip_arms,
    element_forces,
    joint_strips,
    middle_crossings,
    region_forces,
)
from cosim.hoods.view import FAMILIES, STRAIN, Field
from cosim.port import Array, State
from fe_solver.elements.fibres import angle_between
from fe_solver.hood.fibre_families import fibre_families, fibre_stretch
from fe_solver.hood.shell_hood import ShellHood as FeHood
from fe_solver.solver.fields import contact_pressure, energy_fields, fields
from meshes.bands import OVER_MCP, sheet_bands
from meshes.glide import sheet_edges, sheet_places, tendon_over_mcp
from meshes.hood_mesh import REGIONS, HoodMesh, display_quads
from meshes.markers import Markers
from meshes.skeleton import JOINTS, Skeleton

PERCENTILES = (0.05, 0.95)
"""The parts of a region's area by which a strain is summed up beside its mean."""
SAME_LINE = 1e-9
"""rad, fibres and mesh lines nearer than that are one."""
Range = dict[str, float]
DIRECTIONS = ("longitudinal", "lateral")
TENSION_STATES = ("taut", "wrinkled", "slack")
GAUGE = 2e-3
"""m, the standard deviation of the bell over which a gauge at a marker reads the sheet (what lies
within 2.4 mm weighs by half and more); an assumption.  What single elements bear says nothing: at
the corners of what holds the sheet it grows without bound as they get smaller."""
CENTRAL = ("extensor_tendon_distal", "central_band", "central_slip")


@dataclass(frozen=True, kw_only=True)
class ShellView(FeView):
    """What there is to see of a solved shell hood; means over each quad, local axes 1 along the
    (first) fibre, 2 across it."""

    quads: np.ndarray
    region: np.ndarray
    """(ne,) index into REGIONS."""
    strain: Array
    """(ne, 3) Green-Lagrange E11, E22, 2 E12 of the mid-surface."""
    line_strain: Array
    """(ne, 3) the same along and across the mesh's own lines: along the finger, in sagittal bands
    round it.  Fibres whose direction a case gives lie at an angle to them."""
    fibre_stretch: Array
    """(ne,) along the fibres, of two families along the more strained one."""
    beyond_straight: Array
    """(ne,) the same over the stretch at which the fibres are straight."""
    faces: Array
    """(ne, 2) E11 at the two faces."""
    stress: Array
    """(ne, 3) second Piola-Kirchhoff S11, S22, S12, Pa."""
    energy_density: Array
    """(ne,) J/m3 of strain energy per stress-free volume."""
    volume: Array
    """(ne,) m3, stress-free."""
    thickness_stretch: Array
    """(ne,) current over stress-free thickness."""
    tension: np.ndarray
    """(ne,) 0 taut, 1 wrinkled, 2 slack; -1 where the sheet bears compression."""
    area: Array
    """(ne,) m2."""
    central: np.ndarray
    """(ne,) bool, the region over which strains are summed up: extensor tendon distal to the MCP,
    central band and central slip."""
    pressure: Array
    """(n,) Pa of the bones on the nodes."""
    fibres: Array
    """(nf, ne, 3) unit directions of the fibre families, zero on quads without; nf may be 0."""
    markers: Markers
    """Over the central region, along and across the finger."""
    gauges: Gauges
    """Points and gauges of the user's, of which the names are results."""
    region_force: Mapping[str, float]
    """N by region, of `cosim.hoods.shell.region_forces`."""
    strip_arm: Mapping[str, float]
    """m by strip over PIP and DIP, of the same."""

    @property
    def plot_cells(self) -> np.ndarray:
        return display_quads(self.quads)

    def fields(self) -> tuple[Field, ...]:
        quad, point, component = ("quad",), ("point",), ("quad", "strain_component")

        def mesh(name: str, unit: str, what: str, values: Array) -> Field:
            dimensions = quad if values.ndim == 1 else ("quad", "axis")
            return Field(name, dimensions, unit, what, values, in_results=False, on_mesh=True)

        def both(name: str, unit: str, what: str, values: Array) -> Field:
            what = f"{name.replace('_', ' ')}, {what}"
            return Field(name, quad, unit, what, values, on_mesh=True)

        def contact(name: str, in_results: bool) -> Field:
            on_mesh = not in_results
            return Field(name, point, "Pa", "contact pressure", self.pressure, in_results, on_mesh)

        bears = bool((self.tension >= 0).any())
        state = "0 taut, 1 wrinkled, 2 slack, -1 bears compression"
        return (
            *super().fields(),
            Field("strain", component, "1", "Green-Lagrange strain", self.strain),
            Field("stress", component, "Pa", "2nd Piola-Kirchhoff", self.stress),
            Field("stress_free_volume", quad, "m3", "stress-free volume of the quad", self.volume),
            both("strain_energy_density", "J m-3", "per stress-free volume", self.energy_density),
            both("thickness_stretch", "1", "over the stress-free one", self.thickness_stretch),
            contact("pressure", in_results=True),
            contact("contact_pressure", in_results=False),
            mesh(STRAIN, "1", "strain along the fibres", self.strain[:, 0]),
            mesh("transverse_strain", "1", "strain across", self.strain[:, 1]),
            mesh("shear_strain", "1", "E12", self.strain[:, 2] / 2),
            mesh("inner_face_strain", "1", "along the fibres, at the inner face", self.faces[:, 0]),
            mesh("outer_face_strain", "1", "along the fibres, at the outer face", self.faces[:, 1]),
            mesh("fibre_stress", "Pa", "stress along the fibres", self.stress[:, 0]),
            mesh("transverse_stress", "Pa", "stress across", self.stress[:, 1]),
            mesh("region", "", "index of the region", self.region),
            *(
                mesh(name, "1", "direction of a fibre family", fibres)
                for name, fibres in zip(FAMILIES, self.fibres, strict=False)
            ),
            *([Field("tension_state", quad, "1", state, self.tension, on_mesh=True)] * bears),
            *self._point_fields(),
        )

    def _point_fields(self) -> tuple[Field, ...]:
        """Where the points of the user's are, and the surface strain tensor there."""
        if not self.gauges.points:
            return ()
        position = self.gauges.positions(self.points)
        strain = self.point_strain()
        component = ("hood_point", "surface_component")
        where = "named point of the hood"
        return (
            Field("hood_point_position", ("hood_point", "axis"), "m", where, position),
            Field("hood_point_strain", component, "1", "Green-Lagrange strain tensor", strain),
        )

    def point_strain(self, before: ShellView | None = None) -> Array:
        """Green-Lagrange E11, E22, E12 (k, 3) at the user's points, along the finger, across it and
        shear, from free of stress or from another state."""
        strain = self.line_strain[self.gauges.quads]
        first = np.zeros_like(strain) if before is None else before.line_strain[self.gauges.quads]
        return strain_between(first, strain)

    def coordinates(self) -> Mapping[str, Any]:
        return {
            "strain_component": ["along", "across", "shear"],
            "quad_node": (("quad", "corner"), self.quads),
            "region": ("quad", [REGIONS[i] for i in self.region]),
            **({"hood_point": list(names)} if (names := self.gauges.points) else {}),
            **({"surface_component": list(STRAIN_COMPONENTS)} if names else {}),
            **super().coordinates(),
        }

    def size(self) -> Mapping[str, int]:
        return {"hood_quads": len(self.quads)}

    def own_summary(self) -> Mapping[str, Any]:
        return {**strain_summary(self), **_gauge_summary(self, None)}

    def change(self, before: ShellView) -> Mapping[str, Any]:
        return {**strain_change(before, self), **_gauge_summary(self, before)}


def _gauge_summary(view: ShellView, before: ShellView | None) -> dict[str, Any]:
    """Displacements and strains of the user's points and gauges from where the sheet was laid, or
    from another state."""
    x = view.reference if before is None else before.points
    strains = 100 * view.point_strain(before)
    numbers = {
        "point_displacement_mm": view.gauges.displacements(view.points, x),
        "point_strain_percent": {
            name: dict(zip(STRAIN_COMPONENTS, strain.tolist(), strict=True))
            for name, strain in zip(view.gauges.points, strains, strict=True)
        },
        "gauge_strain_percent": view.gauges.strain(view.points, x),
        "grid_strain_percent": {
            name: {
                direction: _range(strain.ravel(), np.ones(strain.size))
                for direction, strain in zip(DIRECTIONS, strains, strict=True)
            }
            for name, strains in view.gauges.grid_strains(view.points, x).items()
        },
    }
    return {key: value for key, value in numbers.items() if value}


def view_of(
    hood: FeHood, mesh: HoodMesh, skeleton: Skeleton, gauges: Gauges
) -> Callable[[State], ShellView]:
    """What there is to see at a state; the mesh lies on a finger of that skeleton."""
    from meshes.markers import markers

    turn = _line_angle(hood, mesh)
    over_mcp = tendon_over_mcp(mesh.station, sheet_edges(mesh, OVER_MCP))
    axis = skeleton.axis[JOINTS.index("PIP")]
    lines = Lines(sheet_places(mesh), sheet_bands(mesh), axis, over_mcp)
    cuts = middle_crossings(mesh, skeleton), joint_strips(mesh, skeleton)
    depth, placed = guide_depth(hood), markers(mesh, CENTRAL)
    return partial(_view, hood, mesh, depth, lines, placed, turn, cuts, gauges)


def _line_angle(hood: FeHood, mesh: HoodMesh) -> Array:
    """The angle (ne,) rad from the fibre to the mesh's own line in each element, 0 where they are
    one."""
    fibre, lines = hood.model.tables.frame[:, :, 0], at_gauss_points(mesh, mesh.fibre)
    angle = angle_between(hood.model.reference, mesh.quads, fibre, lines)
    twice = np.stack([np.cos(2 * angle), np.sin(2 * angle)]).mean(axis=2)
    mean = np.arctan2(twice[1], twice[0]) / 2
    return np.where(np.abs(mean) < SAME_LINE, 0.0, mean)


def _rotate_strains(strain: Array, angle: Array) -> Array:
    """Strains E11, E22, 2 E12 (ne, 3) on axes turned by angle (ne,), rad."""
    c, s = np.cos(angle), np.sin(angle)
    e1, e2, shear = strain.T
    along = c * c * e1 + s * s * e2 + s * c * shear
    across = s * s * e1 + c * c * e2 - s * c * shear
    return np.stack([along, across, 2 * s * c * (e2 - e1) + (c * c - s * s) * shear], axis=1)


def _view(
    hood: FeHood,
    mesh: HoodMesh,
    depth: float,
    lines: Lines,
    placed: Markers,
    turn: Array,
    cuts: tuple[Mapping[str, Crossing], tuple[JointStrips, ...]],
    gauges: Gauges,
    state: State,
) -> ShellView:
    field = fields(hood.model, state.configuration)
    energy = energy_fields(hood.model, state.configuration)
    x, quads, force = state.configuration.x, hood.model.quads, element_forces(hood, state)
    middles, strips = cuts
    stretch, beyond = fibre_stretch(hood.model, field.strain)
    return ShellView(
        **vars(view_at(hood, depth, lines, state)),
        quads=hood.model.quads,
        region=mesh.region,
        strain=field.strain,
        line_strain=_rotate_strains(field.strain, turn),
        fibre_stretch=stretch,
        beyond_straight=beyond,
        faces=field.faces,
        stress=field.stress,
        energy_density=energy.density,
        volume=energy.volume,
        thickness_stretch=energy.stretch,
        tension=field.tension,
        area=hood.model.tables.weight.sum(axis=1),
        central=mesh.cells(*CENTRAL),
        pressure=contact_pressure(hood.model, state.configuration),
        fibres=fibre_families(hood.model, state.configuration),
        markers=placed,
        gauges=gauges,
        region_force=region_forces(force, x, quads, middles),
        strip_arm=all_strip_arms(hood, state, force, strips),
    )


def strain_summary(view: ShellView) -> dict[str, object]:
    """Percent, Green-Lagrange from free of stress: over the central region, and by region; N that
    each region passes on along its fibres; and of the area of the regions that are tension fields
    how much is taut, wrinkled and slack."""
    out: dict[str, object] = {
        "strain_percent": _over_central(view.line_strain, view),
        "region_strain_percent": _by_region(view.line_strain, view),
        "fibre_strain_percent": _fibre_strains(view),
        "region_force_N": dict(view.region_force),
        "strip_arm_mm": {name: 1e3 * arm for name, arm in view.strip_arm.items()},
    }
    whole = view.area[view.tension >= 0].sum()
    if whole > 0:
        parts = (view.area[view.tension == i].sum() for i in range(len(TENSION_STATES)))
        shares = (100 * float(part / whole) for part in parts)
        out["tension_field_area_percent"] = dict(zip(TENSION_STATES, shares, strict=True))
    return out


def strain_change(before: ShellView, now: ShellView) -> dict[str, object]:
    """Percent, from the unloaded state `before`: Green-Lagrange and engineering over the central
    region, engineering by region and between the markers."""
    ratio = np.sqrt((1 + 2 * now.line_strain[:, :2]) / (1 + 2 * before.line_strain[:, :2]))
    return {
        "strain_percent": _over_central((ratio**2 - 1) / 2, now),
        "engineering_strain_percent": _over_central(ratio - 1, now),
        "region_engineering_strain_percent": _by_region(ratio - 1, now),
        "marker_strain_percent": {
            name: _range(strain.ravel(), np.ones(strain.size))
            for name, strain in zip(DIRECTIONS, marker_strains(before, now), strict=True)
        },
    }


def marker_strains(before: ShellView, now: ShellView) -> tuple[Array, Array]:
    """Longitudinal (rows - 1, columns) and lateral (rows, columns - 1) engineering strains between
    neighbours of the marker grid, from `before` to `now`."""
    return neighbour_strains(now.markers.at(before.points), now.markers.at(now.points))


def gauge_strains(strain: Array, view: ShellView) -> Array:
    """What gauges at the m markers read (m, 2) of strains (ne, 2 or 3) of the central region."""
    on = view.central
    middle = view.reference[view.quads[on]].mean(axis=1)
    place = view.markers.at(view.reference).reshape(-1, 1, 3)
    weight = view.area[on] * np.exp(-(((place - middle) / GAUGE) ** 2).sum(axis=2) / 2)
    return np.asarray(weight @ strain[on, :2] / weight.sum(axis=1, keepdims=True))


def _over_central(strain: Array, view: ShellView) -> dict[str, Range]:
    """Mean and percentiles over the area, extremes of what the gauges read."""
    out = _by_direction(strain, view.area, view.central)
    for name, read in zip(DIRECTIONS, gauge_strains(strain, view).T, strict=True):
        out[name] |= {"min": 100 * float(read.min()), "max": 100 * float(read.max())}
    return out


def _by_region(strain: Array, view: ShellView) -> dict[str, Mapping[str, Range]]:
    present = (i for i in range(len(REGIONS)) if (view.region == i).any())
    return {REGIONS[i]: _by_direction(strain, view.area, view.region == i) for i in present}


def _fibre_strains(view: ShellView) -> dict[str, Range]:
    """Engineering strain along the fibres by region from free of stress, and the 95th percentile of
    what it is beyond that at which they are straight."""
    out = {}
    for i in np.unique(view.region):
        cells = view.region == i
        strain, beyond = (
            _spread(stretch[cells] - 1, view.area[cells])
            for stretch in (view.fibre_stretch, view.beyond_straight)
        )
        out[REGIONS[i]] = strain | {"beyond_straight": beyond["p95"]}
    return out


def _by_direction(strain: Array, area: Array, cells: np.ndarray) -> dict[str, Range]:
    return dict(_ranges(strain[cells], area[cells]))


def _ranges(strain: Array, area: Array) -> Iterator[tuple[str, Range]]:
    for name, column in zip(DIRECTIONS, strain.T[:2], strict=True):
        yield name, _spread(column, area)


def _spread(values: Array, weight: Array) -> Range:
    """Mean and percentiles over the area.  Unlike extremes, which a finer mesh takes nearer to what
    holds the sheet, they converge."""
    order = np.argsort(values)
    share = (np.cumsum(weight[order]) - weight[order] / 2) / weight.sum()
    low, high = np.interp(PERCENTILES, share, values[order])
    mean = values @ weight / weight.sum()
    return {
        "p5": 100 * float(low),
        "mean": 100 * float(mean),
        "p95": 100 * float(high),
    }


def _range(values: Array, weight: Array) -> Range:
    return {
        "min": 100 * float(values.min()),
        "mean": 100 * float(values @ weight / weight.sum()),
        "max": 100 * float(values.max()),
    }
