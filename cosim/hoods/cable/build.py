"""The cable hood of a case: its net, materials and supports, and what it looks like solved."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from cosim.fingers.index import IndexFinger
from cosim.hoods.bone_surfaces import baked_surfaces
from cosim.hoods.cable.table import CableHood
from cosim.hoods.fe_view import Lines, Look, guide_depth, look_at
from cosim.hoods.injury import adhesions, longer
from cosim.hoods.lesion import Lesion
from cosim.port import Array, InputError, Motion, State, Triangles

if TYPE_CHECKING:
    from fe_solver.forces.cables import Cables
    from fe_solver.hood.shell_hood import ShellHood as FeHood
    from meshes.cable_net import CableNet
    from meshes.skeleton import Skeleton

ENDS = {"EDC": "central", "EI": "indicis", "LUM": "radial", "FPI": "ulnar"}
"""The tendons that act through the net and the ends that they pull."""


@dataclass(frozen=True, kw_only=True)
class CableLook(Look):
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


def laid_net(
    hood: CableHood, finger: IndexFinger, skeleton: Skeleton, bones: Mapping[str, Triangles]
) -> CableNet:
    """The net of a cable hood."""
    from meshes.cable_net import lay

    offset = hood.contact.offset
    return lay(
        skeleton,
        baked_surfaces(bones),
        {body: getattr(offset, body) for body in bones},
        hood.mesh.rest_posture.angles(),
        hood.mesh.spacing,
        finger.width_scale,
    )


def cable_hood_of(
    hood: CableHood,
    skeleton: Skeleton,
    bones: Mapping[str, Triangles],
    net: CableNet,
    tolerance: float,
    lesion: Lesion | None = None,
    ends: Mapping[str, str] = ENDS,
) -> FeHood:
    """The net over the bones as a case describes it, behind the port; its own equilibrium to the
    relative `tolerance`; `ends`: those of the net that tendons pull, by tendon.  Raises
    InputError."""
    from fe_solver.hood.build_cable import Net, cable_hood
    from fe_solver.hood.build_shell import ContactLaw, SpringSet, Tendon
    from fe_solver.solver.newton import NewtonOptions
    from meshes.hull import along, carriers
    from meshes.skeleton import BODIES

    if "central_slip" not in hood.springs:
        raise InputError(
            "hood.springs: nothing holds the central slip; give hood.springs a table central_slip"
        )
    contact, offset = hood.contact, hood.contact.offset
    rest = Motion(BODIES, *skeleton.pose(net.rest_posture))
    springs = {
        name: SpringSet(net.springs[name], s.stiffness, s.slack, s.tension_only)
        for name, s in hood.springs.items()
        if name in net.springs
    }
    for name, grown in adhesions(lesion, net, net.points, rest).items():
        springs[name] = SpringSet(grown.held, grown.stiffness, 0.0, tension_only=False)
    return cable_hood(
        Net(net.points, cable_law(hood, net, lesion)),
        rest,
        carriers(skeleton, along(skeleton, net.station)),
        springs,
        net.tied,
        "metacarpal",
        np.array([-1.0, 0.0, 0.0]),
        {tendon: Tendon(net.ends[end], np.ones(1)) for tendon, end in ends.items()},
        ContactLaw(
            contact.stiffness,
            contact.smoothing,
            baked_surfaces(bones),
            {body: getattr(offset, body) for body in BODIES},
            contact.penetration,
            contact.friction,
        ),
        NewtonOptions(tolerance=tolerance),
    )


def cable_law(hood: CableHood, net: CableNet, lesion: Lesion | None = None) -> Cables:
    """The cells' law; a strand that is longer than laid is so in all its cells."""
    from fe_solver.forces.cables import Cables

    tables = [hood.cables[name] for name in net.cable]
    stated = zip(net.strands, (table.extra_length for table in tables), strict=True)
    extra = longer(dict(stated), lesion)
    growth = [1 + extra[name] / length for name, length in net.strand_lengths().items()]
    if min(growth) <= 0:
        i = int(np.argmin(growth))
        raise InputError(
            f"hood.cables.{net.cable[i]}.extra_length: leaves nothing of {net.strands[i]}, laid "
            f"{1e3 * net.strand_lengths()[net.strands[i]]:.1f} mm long"
        )
    of = net.strand
    ones = np.ones(len(of))
    return Cables(
        net.cells,
        net.lengths() * np.array(growth)[of],
        np.array([t.modulus for t in tables])[of],
        np.array([t.section for t in tables])[of],
        hood.toe * ones,
        hood.residual_tension * ones,
    )


def looking_at(hood: FeHood, net: CableNet, skeleton: Skeleton) -> Callable[[State], CableLook]:
    """What there is to see at a state."""
    from meshes.bands import net_bands
    from meshes.glide import net_places
    from meshes.skeleton import JOINTS

    lines = Lines(net_places(net), net_bands(net), skeleton.axis[JOINTS.index("PIP")])
    return partial(_look, hood, net, guide_depth(hood), lines)


def _look(hood: FeHood, net: CableNet, depth: float, lines: Lines, state: State) -> CableLook:
    from fe_solver.hood.build_cable import pulls_in

    seen, pull = look_at(hood, depth, lines, state), pulls_in(hood, state)
    points = state.solution.evaluation.points
    on = points.group < 0
    pressed = np.linalg.norm(points.gradient[on], axis=1)
    return CableLook(
        **vars(seen),
        cells=net.cells,
        strand=net.strand,
        strands=net.strands,
        strain=pull.strain,
        tension=pull.force,
        contact_force=np.bincount(points.node[on], pressed, len(seen.points)).astype(float),
    )


def strand_forces(look: CableLook) -> dict[str, dict[str, float]]:
    """Largest tension (N) and mean strain (per cent) of each strand."""
    out = {}
    for i, name in enumerate(look.strands):
        on = look.strand == i
        out[name] = {
            "tension_N": float(look.tension[on].max()),
            "mean_strain_percent": 100 * float(look.strain[on].mean()),
        }
    return out
