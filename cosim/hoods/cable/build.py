"""The cable hood of a case: its net, materials and supports."""

from __future__ import annotations

from functools import partial

import numpy as np

from cosim.errors import InputError
from cosim.fingers.kind import Anatomy
from cosim.hoods.cable.table import ENDS, CableHoodConfig
from cosim.hoods.cable.view import view_of
from cosim.hoods.fe_supports import contact_levels, supports_of
from cosim.hoods.fe_view import slip_forces, stored_energy, tangent_seconds
from cosim.hoods.kind import BuiltHood, HoodBuilder, Site, skeleton_of
from cosim.hoods.lesion import LesionConfig, apply_lesion_to_net, longer
from fe_solver.forces.cables import Cables
from fe_solver.hood.build import Net, TendonEnd, cable_hood
from fe_solver.hood.shell_hood import ShellHood as FeHood
from meshes.cable_net import CableNet, lay
from meshes.robot_net import keep_extensor


def build(hood: CableHoodConfig, site: Site) -> BuiltHood:
    """The live net of cables on a finger. Raises InputError where it cannot be laid out on it."""
    net = apply_lesion_to_net(build_net(hood, site.anatomy), site.lesion)
    return _built(hood, site, net, cable_hood_of(hood, site, net))


def _built(hood: CableHoodConfig, site: Site, net: CableNet, made: FeHood) -> BuiltHood:
    """What there is to know of the hood of a net."""
    return BuiltHood(
        made,
        view_of(made, net, site.skeleton),
        partial(slip_forces, made),
        linear=partial(tangent_seconds, made),
        energy=stored_energy,
        nearby=made.linearised,
        around=partial(_built, hood, site, net),
    )


def build_net(hood: CableHoodConfig, anatomy: Anatomy) -> CableNet:
    """The net of a cable hood; where the extensor alone pulls without the other tendons' ends."""
    net = lay(
        skeleton_of(anatomy),
        *contact_levels(hood.contact, anatomy.bones, skeleton_of(anatomy)),
        hood.mesh.rest_posture.angles(),
        hood.mesh.spacing,
        anatomy.width,
    )
    ends = ENDS[anatomy.finger].values()
    return keep_extensor(net) if set(ends) == {"central"} else net


def cable_hood_of(hood: CableHoodConfig, site: Site, net: CableNet) -> FeHood:
    """The net over the bones as a case describes it, behind the port.  Raises InputError."""
    if "central_slip" not in hood.springs:
        raise InputError(
            "hood.springs: nothing holds the central slip; give hood.springs a table central_slip"
        )
    ends = ENDS[site.anatomy.finger]
    tendons = {tendon: TendonEnd(net.ends[end], np.ones(1)) for tendon, end in ends.items()}
    laid = Net(net.points, cable_law(hood, net, site.lesion))
    return cable_hood(laid, supports_of(hood, site, net, net.points, tendons))


def cable_law(hood: CableHoodConfig, net: CableNet, lesion: LesionConfig | None = None) -> Cables:
    """The cells' law; a strand that is longer than laid is so in all its cells."""
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


BUILDER = HoodBuilder(build)
