"""The shell hood of a case: its mesh, materials and supports."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial, reduce

import numpy as np

from cosim.errors import InputError
from cosim.fingers.kind import Anatomy
from cosim.hoods.fe_supports import contact_levels, head_arcs, pose_surfaces, supports_of
from cosim.hoods.fe_view import slip_forces, stored_energy, tangent_seconds
from cosim.hoods.kind import BuiltHood, HoodBuilder, Site, skeleton_of
from cosim.hoods.lesion import LesionConfig, apply_lesion_to_mesh, longer
from cosim.hoods.repairs import repairs
from cosim.hoods.shell import table
from cosim.hoods.shell.fibre_table import FibrousConfig
from cosim.hoods.shell.fibres import Fibres, fibres_of
from cosim.hoods.shell.gauges import points_on
from cosim.hoods.shell.region_forces import (
    Crossing,
    crossing_force,
    element_forces,
    middle_crossings,
)
from cosim.hoods.shell.table import ENDS, RetinaculumConfig, ShellHoodConfig
from cosim.hoods.shell.view import view_of
from cosim.hoods.view import TrackedPoints
from cosim.port import Array, State
from cosim.schema.types import RegionConfig
from fe_solver.elements.mesh_geometry import node_directors, node_means
from fe_solver.hood.build import TendonEnd, heights, shell_hood
from fe_solver.hood.shell_hood import TIE
from fe_solver.hood.shell_hood import ShellHood as FeHood
from fe_solver.materials import crossed_fibres, hyperelastic
from fe_solver.materials import fibres as fibre_materials
from fe_solver.materials import linear as materials
from fe_solver.materials.linear import Law, LinearLaw, Real
from fe_solver.materials.tension_field import TensionField
from fe_solver.sheet import Sheet, ShellPart, in_situ_growth, stress_free_thickness
from meshes.coarseness import WORDS, Rows, coarse_rows
from meshes.hood import generate
from meshes.hood_lines import even_shares
from meshes.hood_mesh import REGIONS, HoodMesh, read
from meshes.severed import PLACES, cut_part, nearly_cut
from meshes.skeleton import Skeleton

ROOM = 4e-3
"""m that an end of a sheet lies distal of its tendon's eyelet at least, for it to hang on a rope to
there; one that is laid further proximal slides along the metacarpal."""
INCOMPRESSIBLE = np.array([[4, 2, 0], [2, 4, 0], [0, 0, 1]]) / 3
"""Plane-stress moduli of an incompressible isotropic sheet, over Young's."""
MOST_SHORTENED = 0.5
"""The part of a region's length as laid out that it may be shortened by at most."""
SAME_ANGLE = 1e-9
"""rad, angles between two families that differ by less are one."""


def build(hood: ShellHoodConfig, site: Site) -> BuiltHood:
    """The live sheet of shell elements on a finger. Raises InputError where it cannot be laid out
    on it, and for a point of the case that is not on the sheet."""
    mesh = apply_lesion_to_mesh(generate_mesh(hood, site.anatomy), site.lesion)
    return _built(hood, site, mesh, shell_hood_of(hood, site, mesh))


def _built(hood: ShellHoodConfig, site: Site, mesh: HoodMesh, made: FeHood) -> BuiltHood:
    """What there is to know of the hood on a mesh."""
    gauges = points_on(hood, made.model.reference, mesh.quads)
    return BuiltHood(
        made,
        view_of(made, mesh, site.skeleton, gauges),
        partial(slip_forces, made),
        linear=partial(tangent_seconds, made),
        points=TrackedPoints(gauges.points, lambda s: gauges.positions(s.configuration.x)),
        energy=stored_energy,
        nearby=made.linearised,
        around=partial(_built, hood, site, mesh),
        others=partial(_others, mesh, site.skeleton),
        without=lambda parts: shell_hood_of(hood, site, reduce(_let_go, parts, mesh)),
    )


def _others(mesh: HoodMesh, skeleton: Skeleton) -> dict[str, Callable[[FeHood, State], float]]:
    """The force (N) of the slip that is tied to its bone, and of the regions that can tear."""
    lines = middle_crossings(mesh, skeleton).items()
    out: dict[str, Callable[[FeHood, State], float]]
    out = {} if TIE in mesh.springs else {TIE: _tie_force}
    return out | {name: partial(_region_force, line) for name, line in lines if name in PLACES}


def _tie_force(hood: FeHood, state: State) -> float:
    return float(np.linalg.norm(hood.group_forces(state)[TIE]))


def _region_force(line: Crossing, hood: FeHood, state: State) -> float:
    force = element_forces(hood, state)
    return crossing_force(force, state.configuration.x, hood.model.quads, line)


def _let_go(mesh: HoodMesh, part: str) -> HoodMesh:
    return cut_part(mesh, part) if part == TIE else nearly_cut(mesh, part)


def generate_mesh(hood: ShellHoodConfig, anatomy: Anatomy) -> HoodMesh:
    """The mesh of a shell hood, read or generated, before any lesion.  Raises InputError."""
    return _generate(_MeshInput(f"{hood.mesh_key()} {anatomy.key}", hood, anatomy))


@dataclass(frozen=True)
class _MeshInput:
    """A hood and a finger as far as the mesh is laid out by them."""

    key: str
    hood: ShellHoodConfig = field(compare=False)
    anatomy: Anatomy = field(compare=False)


@lru_cache(maxsize=8)
def _generate(laying: _MeshInput) -> HoodMesh:
    hood, anatomy = laying.hood, laying.anatomy
    skeleton = skeleton_of(anatomy)
    if hood.mesh.kind == "file":
        mesh, reach = read(hood.mesh.path), float(skeleton.length[1])
        if not np.isclose(mesh.reach, reach, rtol=1e-3):
            raise InputError(
                f"hood.mesh.path: {hood.mesh.path.name} was laid on a finger of "
                f"{mesh.reach * 1e3:.2f} mm from MCP to PIP, this one has {reach * 1e3:.2f} mm. "
                'Lay a hood on it (hood.mesh.kind = "generated") or set finger.length_scale'
            )
        return mesh
    return generate(
        skeleton,
        *contact_levels(hood.contact, anatomy.bones, skeleton, hood.thickness / 2),
        hood.thickness,
        hood.mesh.rest_posture.angles(),
        hood.mesh.quads,
        width=anatomy.width,
        intrinsic=_sides(anatomy),
        quadratic=hood.mesh.elements == "quadratic",
        one_sheet=hood.mesh.layout == "one_sheet",
    )


def mesh_warnings(hood: ShellHoodConfig, anatomy: Anatomy) -> list[str]:
    """Where the rows of a user's mesh are too coarse for the heads that they slide over.  Raises
    InputError."""
    return [str(rows) for rows in _coarse(hood, anatomy)] if hood.mesh.kind == "file" else []


def mesh_advice(hood: ShellHoodConfig, anatomy: Anatomy) -> str:
    """What to do about a mesh of ours that is too coarse for the heads that it slides over; nothing
    where it is not.  Raises InputError."""
    coarse = [] if hood.mesh.kind == "file" else _coarse(hood, anatomy)
    if not coarse:
        return ""
    (setting,) = hood.mesh_values((hood.mesh_fineness or 0) + 1).items()
    heads = ", ".join(
        f"{WORDS[rows.arc.body]} {1e3 * rows.spacing:.1f} mm ({1e3 * rows.arc.spacing:.1f})"
        for rows in coarse
    )
    return (
        "The mesh is too coarse for the heads of the bones: between its rows are, and at most may "
        f"be, over the {heads}; write {setting[0]} = {setting[1]} or more"
    )


def _coarse(hood: ShellHoodConfig, anatomy: Anatomy) -> list[Rows]:
    mesh, skeleton = generate_mesh(hood, anatomy), skeleton_of(anatomy)
    over = head_arcs(hood.contact, anatomy.bones, skeleton, hood.thickness / 2)
    return coarse_rows(mesh, skeleton, over)


def shell_hood_of(hood: ShellHoodConfig, site: Site, mesh: HoodMesh) -> FeHood:
    """The hood over the bones as a case describes it, behind the port.  Raises InputError."""
    missing = [REGIONS[i] for i in np.unique(mesh.region) if REGIONS[i] not in hood.regions]
    if missing:
        raise InputError(f"hood.regions: the mesh also has {', '.join(missing)}; name them")
    thickness, skeleton = thickness_of(hood, mesh), site.skeleton
    points = _leave_face(mesh, thickness)
    fibres = fibres_of(mesh, points, hood.regions, skeleton)
    growth = growth_of(hood, mesh, site.lesion)
    present, part = np.unique(mesh.region, return_inverse=True)
    sheet = Sheet(
        points,
        mesh.quads,
        tuple(_part(hood, mesh, i, thickness, fibres, growth) for i in present),
        part,
        thickness,
        fibres.first,
        growth=growth,
        lift=0.0 if mesh.lift is None else mesh.lift,
        left=mesh.left,
    )
    tendons, highest = _tendons(mesh, site.anatomy, hood.retinaculum), float(heights(sheet).max())
    supports = supports_of(hood, site, mesh, points, tendons, highest)
    if site.lesion is not None and (site.lesion.suture or site.lesion.graft):
        joined = repairs(
            site.lesion, mesh, points, supports.rest, pose_surfaces(site.anatomy.bones)
        )
        supports = replace(supports, springs=[*supports.springs, *joined])
    if not any(s.name == "central_slip" for s in supports.springs) and not any(
        len(nodes) for nodes in mesh.tied.values()
    ):
        raise InputError(
            "hood: no insertion holds the hood: its mesh ties no nodes to a bone, and there are no "
            "springs of the central slip. Give hood.springs.central_slip, or a mesh that is tied"
        )
    return shell_hood(sheet, supports)


def _part(
    hood: ShellHoodConfig, mesh: HoodMesh, i: int, laid: Array, fibres: Fibres, growth: Array
) -> ShellPart:
    """The material of a region (its number), with the hood's own bending; `laid` (ne,) m thick,
    `growth` (ne, 2) where no fibre is stretched in situ."""
    region, cells = hood.regions[REGIONS[i]], np.flatnonzero(mesh.region == i)
    stretch = 1.0 if region.fibrous is None else region.fibrous.in_situ_stretch
    each = np.full(len(cells), stretch)
    grown = growth[cells] if stretch == 1.0 else in_situ_growth(each)
    thickness = stress_free_thickness(laid[cells], each)
    law = _law(REGIONS[i], region, _law_angle(fibres.angle.get(i), grown))
    bending = 12 * hood.bending_stiffness / thickness[0] ** 3 * INCOMPRESSIBLE
    return ShellPart(REGIONS[i], law, stretch, bending, region.slides)


def _law_angle(laid: Array | None, growth: Array) -> Real:
    """The angle (rad) from the first to the second family in the stress-free sheet, from that as
    laid out (k, g): one number, or (k, g) where it varies; `growth` (k, 2)."""
    if laid is None:
        return 0.0
    along, across = (1 + growth.T)[..., None]
    angle = np.arctan2(across * np.sin(laid), along * np.cos(laid))
    if np.ptp(angle) < SAME_ANGLE:
        return float(angle.mean())
    return np.asarray(angle)


def _law(name: str, region: RegionConfig, angle: Real) -> Law | TensionField:
    """A region's material, its second family at `angle` (rad) from the first.

    Raises InputError, with its name, for one that is none."""
    law = _bare_law(name, region, angle)
    return TensionField(law) if region.tension_field else law


def _bare_law(name: str, region: RegionConfig, angle: Real) -> Law:

    def bulk(modulus: float | None) -> float:
        return np.inf if modulus is None else modulus

    try:
        match region:
            case table.IsotropicConfig() as r:
                linear: LinearLaw = materials.Isotropic(r.modulus, r.poisson)
                return linear
            case table.TransverselyIsotropicConfig() as r:
                linear = materials.Orthotropic.transversely_isotropic(
                    r.modulus_along, r.modulus_across, r.poisson, r.shear_modulus, r.poisson_across
                )
                if r.second is not None:
                    return crossed_fibres.CrossedLinear(linear, r.second.modulus, angle)
                return linear
            case table.NeoHookeanConfig() as r:
                return hyperelastic.NeoHookean(r.modulus, r.poisson)
            case table.FibreMooneyRivlinConfig() as r:
                one = fibre_materials.TransIsoMooneyRivlin(
                    r.c1, r.c2, r.c3, r.c4, r.c5, r.lam_max, bulk(r.bulk_modulus)
                )
                if (f := r.second) is None:
                    return one
                toe = fibre_materials.ExponentialFamily(f.c3, f.c4, f.c5, f.lam_max)
                return crossed_fibres.CrossedFibres(one, toe, angle)
            case table.FibreGasserConfig(second=None) as r:
                assert r.angle is not None  # checked by the schema
                return fibre_materials.HolzapfelGasserOgden(
                    r.c, r.k1, r.k2, r.dispersion, r.angle, bulk(r.bulk_modulus)
                )
            case table.FibreGasserConfig(second=table.SecondGasserConfig() as f) as r:
                # two equal families in one direction are one of twice k1
                gasser = fibre_materials.HolzapfelGasserOgden(
                    r.c, r.k1 / 2, r.k2, r.dispersion, 0.0, bulk(r.bulk_modulus)
                )
                dispersed = fibre_materials.DispersedFamily(f.k1, f.k2, f.dispersion)
                return crossed_fibres.CrossedFibres(gasser, dispersed, angle)
        raise AssertionError(f"no law for {type(region).__name__}")
    except InputError as error:
        raise InputError(f"hood.regions.{name}: {error}") from error


def thickness_of(hood: ShellHoodConfig, mesh: HoodMesh) -> Array:
    """The thickness (ne,) m of each element."""
    out = np.full(len(mesh.quads), hood.thickness)
    for i in np.unique(mesh.region):
        region, cells = hood.regions[REGIONS[i]], mesh.region == i
        if region.section is not None:
            _, width = mesh.extent(REGIONS[i])
            out[cells] = region.section / width
        elif region.thickness is not None:
            out[cells] = region.thickness
    return out


def _leave_face(mesh: HoodMesh, thickness: Array) -> Array:
    """Mid-surface points (n, 3) that leave the face towards the bones where the sheet that the mesh
    was laid for has it."""
    rise = (node_means(thickness, mesh.quads, len(mesh.points)) - mesh.thickness) / 2
    if np.abs(rise).max() < 1e-12:
        return mesh.points
    return mesh.points + rise[:, None] * node_directors(mesh.points, mesh.quads)


def growth_of(hood: ShellHoodConfig, mesh: HoodMesh, lesion: LesionConfig | None) -> Array:
    """The growth (ne, 2) along and across the fibres that makes a region longer than laid out by
    its extra length.

    Raises InputError for a length that the mesh or the fibres cannot have."""
    out = np.zeros((len(mesh.quads), 2))
    for name, extra in longer(hood.extra_length.model_dump(), lesion).items():
        if not extra:
            continue
        key = "hood.extra_length"
        if lesion and name in lesion.length_changes():
            key = "lesion.shorten" if name in lesion.shorten else "lesion.lengthen"
        cells = mesh.cells(name)
        if not cells.any():
            raise InputError(f"{key}.{name}: the mesh has no region {name}")
        region = hood.regions[name]
        if region.fibrous is not None:
            _check_one_rest(f"{key}.{name}", name, region.fibrous)
        length, _ = mesh.extent(name)
        if extra <= -MOST_SHORTENED * length:
            raise InputError(
                f"{key}.{name}: {-1e3 * extra:.2f} mm shorter in all, of {1e3 * length:.2f} mm; "
                "at most half of it can be taken"
            )
        out[cells, 0] = extra / length
    return out


def _check_one_rest(key: str, name: str, region: FibrousConfig) -> None:
    """Check that a region's extra length goes with its fibres.  Raises InputError."""
    own = f"hood.regions.{name}"
    if region.direction is not None:
        raise InputError(
            f"{key}: is along the finger, but {own}.direction turns the fibres that would be "
            f"longer or shorter; leave one of them out, or write {own}.in_situ_stretch"
        )
    if region.in_situ_stretch != 1.0:
        raise InputError(
            f"{key}: says how long the fibres are at rest, and so does {own}.in_situ_stretch; "
            "leave one of them out"
        )


def _sides(anatomy: Anatomy) -> dict[str, tuple[float, ...]]:
    """By side, where its tendons run to the sheet from: m distal of the MCP, dorsal, radial."""
    points: dict[str, list[tuple[float, float, float]]] = {}
    for tendon, (end, _) in ENDS[anatomy.finger].items():
        if tendon in anatomy.eyelets:
            points.setdefault(end, []).append(anatomy.eyelets[tendon])
    return {side: tuple(np.mean(each, axis=0).tolist()) for side, each in points.items()}


def _tendons(
    mesh: HoodMesh, anatomy: Anatomy, retinaculum: RetinaculumConfig | None = None
) -> dict[str, TendonEnd]:
    """Each tendon's end nodes, their shares of a pull that is even over them, or over half, and its
    eyelet where the end lies distal of it, or it runs under a retinaculum."""
    out = {}
    for tendon, (end, side) in ENDS[anatomy.finger].items():
        nodes = mesh.ends[end]
        place = np.arange(len(nodes), dtype=float)
        first, last = float(place[0]), float(place[-1])
        if any(side):
            middle, height = (first + last) / 2, mesh.points[nodes] @ side
            first, last = (middle, last) if height[-1] > height[0] else (first, middle)
        share = even_shares(place, (first, last), mesh.quadratic)
        eyelet = None
        if end == "central" and retinaculum is not None:
            high = mesh.points[nodes, 2].mean()
            eyelet = np.array([-retinaculum.proximal, -retinaculum.ulnar, high])
        elif tendon in anatomy.eyelets:
            distal, dorsal, radial = anatomy.eyelets[tendon]
            if (mesh.points[nodes, 0] >= distal + ROOM).all():
                eyelet = np.array([distal, radial, dorsal])
        out[tendon] = TendonEnd(nodes, share / share.sum(), eyelet)
    return out


BUILDER = HoodBuilder(build, generate_mesh, mesh_warnings=mesh_warnings, mesh_advice=mesh_advice)
