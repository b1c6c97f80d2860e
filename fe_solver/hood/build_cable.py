"""From a net of cables to a hood behind the port: the shell's Newton, contact, springs and guides,
its cells lines in place of quads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Ints, Motion
from fe_solver.elements.shell import ShellTables, shell_tables
from fe_solver.forces.cables import CableResponse, Cables, cable_state
from fe_solver.hood.build_shell import (
    ContactLaw,
    SpringGroup,
    TendonEnd,
    check_supports,
    contacts_of,
    guides_of,
    shares_of,
    springs_of,
    ties_of,
)
from fe_solver.hood.shell_hood import HoodState, ShellHood
from fe_solver.materials.section import Section
from fe_solver.solver.model import ShellModel
from fe_solver.solver.newton import NewtonOptions

SOFTER = 0.01
"""Share of the contact's stiffness on which a large change of pose is solved first: with it a net
needs as many iterations as a shell, without it two to three times as many."""
NO_QUADS = np.zeros((0, 4), dtype=np.intp)


@dataclass(frozen=True)
class Net:
    """Cables through points (n, 3) m in the hood's rest pose."""

    points: Array
    cables: Cables


def no_tables() -> ShellTables:
    """Those of a model without shells."""
    none = np.zeros((0, 4, 3))
    return shell_tables(none, none, none, np.zeros(0))


def contact_areas(net: Net) -> Array:
    """(n,) m2: half of each cell at either end, as wide as a round cable of its section."""
    cables = net.cables
    area = cables.length * np.sqrt(4 * cables.section / np.pi)
    return np.bincount(cables.nodes.ravel(), np.repeat(area / 2, 2), len(net.points)).astype(float)


def cable_hood(
    net: Net,
    rest: Motion,
    carriers: Array,
    springs: Mapping[str, SpringGroup],
    tied: Mapping[str, Ints],
    guide_body: str,
    pull: Array,
    tendons: Mapping[str, TendonEnd],
    contact: ContactLaw,
    options: NewtonOptions,
) -> ShellHood:
    """A hood whose model has no quads; as `build_shell.shell_hood` otherwise, but that the
    contact's offsets are heights of the cables' centre lines over the bare bones.

    Raises InputError where nothing holds the hood, or a node is of no cable."""
    check_supports(springs, tied)
    X, bodies = net.points, rest.bodies
    loose = np.setdiff1d(np.arange(len(X)), net.cables.nodes)
    if loose.size:
        raise InputError(f"hood: node {loose[0]} is of no cable; remove it from the net")
    D = np.tile([0.0, 0.0, 1.0], (len(X), 1))  # of no node: without quads none is turned
    ties = ties_of(X, D, rest, tied)
    guided, share = shares_of(tendons)
    held = {name: s for name, s in springs.items() if len(s.attached.nodes)}
    touching = np.setdiff1d(np.arange(len(X)), np.concatenate([ties.node, guided]))
    model = ShellModel(
        NO_QUADS,
        X,
        D,
        no_tables(),
        Section(()),
        springs_of(X, rest, held),
        ties,
        guides_of(X, rest, guide_body, pull, guided),
        share,
        contacts_of(
            bodies, contact, touching, np.zeros(len(touching)), contact_areas(net)[touching]
        ),
        bodies,
        groups=tuple(held),
        cables=net.cables,
    )
    augment = contact.augment()
    # A net bears no compression, and softer contact leads it over any leap.
    return ShellHood(
        model, tuple(tendons), rest, carriers, tuple(held), options, augment, SOFTER, leap=np.inf
    )


def pulls_in(hood: ShellHood, state: HoodState) -> CableResponse:
    """Tension and strain of every cell of a hood's cables."""
    return cable_state(hood.model.cables, state.configuration.x)
