"""From a sheet or a net of cables and what holds it to a hood behind the port."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Ints, Motion
from fe_solver.elements.mesh_geometry import node_areas, node_means
from fe_solver.elements.shell import shell_tables
from fe_solver.forces.cables import CableResponse, Cables, cable_state
from fe_solver.forces.contact import Contact
from fe_solver.forces.contact_points import ElementPoints
from fe_solver.forces.guides import Guides, Ropes
from fe_solver.forces.layer import Layer
from fe_solver.hood.shell_hood import HoodState, ShellHood
from fe_solver.materials.section import Section
from fe_solver.sheet import Sheet, thickness_as_laid
from fe_solver.solver.augmented_contact import AugmentOptions
from fe_solver.solver.model import ShellModel
from fe_solver.solver.newton import NewtonOptions
from fe_solver.supports import SpringSet, Tied, links_of, springs_of, ties_of
from fe_solver.surfaces.spline_distance import Surface

STICK = 0.01
"""Stiffness of sticking as a share of the contact's: nodes give way by about a micron before they
slide, and Newton takes a third of the time that it takes with all of it."""
SOFTER = 0.01
"""Share of the contact's stiffness on which a net's large change of pose is solved first: with it a
net needs as many iterations as a shell, without it two to three times as many."""
PENETRATION = 1e-6
"""m, where friction asks for augmented contact and nothing else is said."""


@dataclass(frozen=True)
class TendonEnd:
    """A tendon's end in a hood."""

    nodes: Ints
    """Those (k,) that slide along the tendon, or hang on ropes to its eyelet."""
    share: Array
    """(k,) of its tension in each node, adding up to one."""
    eyelet: Array | None = None
    """(3,) m in the guiding body's frame, where it runs through one."""


@dataclass(frozen=True)
class ContactLaw:
    """How a hood touches the bodies."""

    stiffness: float
    """N/m3, along the normal; with layers, of sticking."""
    smoothing: float
    """m of depth within which a penalty's pressure sets in."""
    surfaces: Mapping[str, Surface]
    """By body."""
    offset: Mapping[str, float]
    """m by body, of the hood's face (of a net, of the cables' centre lines) from the bare bone."""
    penetration: float | None = None
    """m; contact is augmented until no node penetrates further."""
    friction: float = 0.0
    """Coulomb's coefficient; its limits are found round by round, as multipliers are."""
    layers: Mapping[str, Layer] = field(default_factory=dict)
    """What presses in place of a penalty, by body."""

    def augment(self) -> AugmentOptions | None:
        """How the outer loop is to end, where there is one."""
        if self.penetration is None and not self.friction:
            return None
        return AugmentOptions(penetration=self.penetration or PENETRATION)


@dataclass(frozen=True)
class HoodSupports:
    """What holds, carries, touches and pulls a hood."""

    rest: Motion
    """The pose in which it is laid out."""
    carriers: Array
    """(n, nb) how much of each node's motion each body carries in a large change of pose."""
    springs: Sequence[SpringSet]
    ties: Sequence[Tied]
    guide_body: str
    """Along which the tendons slide."""
    pull: Array
    """(3,) their direction in its frame."""
    tendons: Mapping[str, TendonEnd]
    contact: ContactLaw
    options: NewtonOptions


@dataclass(frozen=True)
class Net:
    """Cables through points (n, 3) m in the hood's rest pose."""

    points: Array
    cables: Cables

    def model(self, **more: Any) -> ShellModel:
        """Return the solver's model of the cables alone, with `more` of `ShellModel`'s fields."""
        directors = np.tile([0.0, 0.0, 1.0], (len(self.points), 1))  # no quads turn them
        quads, none = np.zeros((0, 4), dtype=np.intp), np.zeros((0, 4, 3))
        tables = shell_tables(none, none, none, np.zeros(0))
        section = Section(())
        return ShellModel(
            quads, self.points, directors, tables, section, cables=self.cables, **more
        )


def shell_hood(sheet: Sheet, supports: HoodSupports) -> ShellHood:
    """Return the hood of a sheet.  Raises InputError where nothing holds it."""
    law, bodies = supports.contact, supports.rest.bodies
    hood = _hood(sheet.model(bodies=bodies), supports, partial(_contacts, sheet, bodies, law))
    return replace(hood, sheet=sheet)


def cable_hood(net: Net, supports: HoodSupports) -> ShellHood:
    """Return the hood of a net, whose model has no quads.

    Raises InputError where nothing holds the hood, or a node is of no cable."""
    loose = np.setdiff1d(np.arange(len(net.points)), net.cables.nodes)
    if loose.size:
        raise InputError(f"hood: node {loose[0]} is of no cable; remove it from the net")
    area, bodies = contact_areas(net), supports.rest.bodies

    def contacts(nodes: Ints) -> tuple[Contact, ...]:
        return contacts_of(bodies, supports.contact, nodes, np.zeros(len(nodes)), area[nodes])

    hood = _hood(net.model(bodies=bodies), supports, contacts)
    # a net bears no compression, and softer contact leads it over any leap
    return replace(hood, softer=SOFTER, leap=np.inf)


def _hood(
    bare: ShellModel, s: HoodSupports, contacts: Callable[[Ints], tuple[Contact, ...]]
) -> ShellHood:
    """The hood of a model that nothing holds yet; `contacts` of the nodes that may touch."""
    if not s.springs and not any(len(t.nodes) for t in s.ties):
        raise InputError(
            "hood: no insertion holds the hood: it has neither a tied node set nor a spring set. "
            "Give hood.springs a set, or a mesh whose terminal slip is tied to a bone."
        )
    X, rest = bare.reference, s.rest
    ties = ties_of(s.ties, X, bare.directors, rest.position, rest.rotation)
    guided, share = shares_of(s.tendons)
    held = [spring_set for spring_set in s.springs if len(spring_set.nodes)]
    model = replace(
        bare,
        springs=springs_of(held),
        links=links_of(held),
        ties=ties,
        guides=guides_of(X, rest, s.guide_body, s.pull, guided),
        share=share,
        contacts=contacts(np.setdiff1d(np.arange(len(X)), np.concatenate([ties.node, guided]))),
        groups=tuple(springs.name for springs in held),
        ropes=ropes_of(X, rest, s.guide_body, s.pull, s.tendons),
    )
    tendons, augment = tuple(s.tendons), s.contact.augment()
    return ShellHood(model, tendons, rest, s.carriers, s.options, augment, springs=tuple(held))


def shares_of(tendons: Mapping[str, TendonEnd]) -> tuple[Ints, Array]:
    """The guided nodes (k,), ascending, and the tendons' shares (nt, k) of them."""
    sliding = [t.nodes for t in tendons.values() if t.eyelet is None]
    guided = np.unique(np.concatenate([np.zeros(0, dtype=np.intp), *sliding]))
    share = np.zeros((len(tendons), len(guided)))
    for row, tendon in zip(share, tendons.values(), strict=True):
        if tendon.eyelet is None:
            np.add.at(row, np.searchsorted(guided, tendon.nodes), tendon.share)
    return guided, share


def ropes_of(
    X: Array, rest: Motion, body: str, pull: Array, tendons: Mapping[str, TendonEnd]
) -> Ropes:
    """Ropes of the tendons that run through eyelets of `body`, from nodes at points X (n, 3) in the
    pose `rest`, and on along `pull` (3,) in its frame."""
    parts = [(i, t, t.eyelet) for i, t in enumerate(tendons.values()) if t.eyelet is not None]
    if not parts:
        return Ropes.none(len(tendons))
    node = np.concatenate([t.nodes for _, t, _ in parts])
    eyelet = np.concatenate([np.tile(point, (len(t.nodes), 1)) for _, t, point in parts])
    share, first = np.zeros((len(tendons), len(node))), 0
    for i, t, _ in parts:
        share[i, first : first + len(t.nodes)] = t.share
        first += len(t.nodes)
    unit = np.tile(np.asarray(pull) / np.linalg.norm(pull), (len(node), 1))
    index = np.full(len(node), rest.bodies.index(body))
    length = np.linalg.norm(_local(rest, body, X[node]) - eyelet, axis=1)
    return Ropes(node, index, eyelet, unit, length, share, tuple(tendons))


def _local(rest: Motion, body: str, points: Array) -> Array:
    position, rotation = rest.of(body)
    return (points - position) @ rotation


def guides_of(X: Array, rest: Motion, body: str, pull: Array, nodes: Ints) -> Guides:
    """Nodes that slide along `pull` (3,), in the frame of `body`."""
    unit = np.asarray(pull) / np.linalg.norm(pull)
    index = np.full(len(nodes), rest.bodies.index(body))
    return Guides.along(nodes, index, _local(rest, body, X[nodes]), np.tile(unit, (len(nodes), 1)))


def heights(sheet: Sheet) -> Array:
    """Return how far over its face towards the bones each node of a sheet touches them, (n,) m."""
    laid = thickness_as_laid(sheet.section.thickness.mean(axis=1), sheet.stress_free_growth)
    out: Array = node_means(laid, sheet.quads, len(sheet.points)) / 2 + sheet.lift
    return out


def _contacts(
    sheet: Sheet, bodies: tuple[str, ...], law: ContactLaw, nodes: Ints
) -> tuple[Contact, ...]:
    """Contacts with every body: through a layer of the points within the elements of such nodes
    alone (tie and contact would pinch one that is tied), which feel where on a chord the sheet
    touches, so that the answer does not follow the nodes as they slide over a head; by a penalty of
    the nodes, or of the points within quadratic elements.

    Augmented contact is the nodes' in any element: a sheet cannot lie on its level in more points
    than it has nodes."""
    height, X = heights(sheet), sheet.points
    at_nodes = sheet.quads.shape[1] == 4 or law.augment() is not None
    if at_nodes and not law.layers:
        return contacts_of(bodies, law, nodes, height[nodes], node_areas(X, sheet.quads)[nodes])
    height = height - sheet.lift
    points = ElementPoints.of(sheet.quads, np.flatnonzero(np.isin(sheet.quads, nodes).all(axis=1)))
    return contacts_of(bodies, law, points.nearest, points.mean(height), points.areas(X), points)


def contacts_of(
    bodies: tuple[str, ...],
    law: ContactLaw,
    nodes: Ints,
    height: Array,
    area: Array,
    within: ElementPoints | None = None,
) -> tuple[Contact, ...]:
    """Contact of `nodes` (k,), or of the points `within` elements that these are nearest to, with
    every body that has a surface; by point (k,) the height (m) over the face and the area (m2)."""
    return tuple(
        Contact(
            bodies.index(body),
            surface,
            nodes,
            law.offset[body] + height,
            area,
            law.stiffness,
            law.smoothing,
            friction=law.friction,
            shear=law.stiffness if law.layers else STICK * law.stiffness,
            within=within,
            layer=law.layers.get(body),
        )
        for body, surface in law.surfaces.items()
    )


def contact_areas(net: Net) -> Array:
    """Return each node's area of contact, (n,) m2: half of each cell at either end, as wide as a
    round cable of its section."""
    cables = net.cables
    area = cables.length * np.sqrt(4 * cables.section / np.pi)
    return np.bincount(cables.nodes.ravel(), np.repeat(area / 2, 2), len(net.points)).astype(float)


def pulls_in(hood: ShellHood, state: HoodState) -> CableResponse:
    """Tension and strain of every cell of a hood's cables."""
    return cable_state(hood.model.cables, state.configuration.x)
