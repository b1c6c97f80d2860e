"""From a hood mesh and its materials to a shell behind the port."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from cosim.errors import InputError
from cosim.port import Array, Ints, Motion
from fe_solver.elements.mesh_geometry import node_areas, node_means
from fe_solver.forces.contact import Contact
from fe_solver.forces.contact_points import ElementPoints
from fe_solver.forces.guides import Guides, Ropes, Ties
from fe_solver.forces.springs import Springs
from fe_solver.hood.shell_hood import ShellHood
from fe_solver.materials.in_situ import thickness_as_laid
from fe_solver.sheet import Sheet
from fe_solver.solver.augmented_contact import AugmentOptions
from fe_solver.solver.newton import NewtonOptions
from fe_solver.surfaces.spline_distance import Surface


class Attached(Protocol):
    """Nodes and the points of a body that springs join them to; `shares` (k,) say in what
    proportion these share their set's stiffness, evenly where None."""

    @property
    def body(self) -> str:
        """Name of the body."""
        ...

    @property
    def nodes(self) -> Ints:
        """Indices (k,) of the nodes."""
        ...

    @property
    def anchors(self) -> Array:
        """Points (k, 3) on the body, in its frame, m."""
        ...

    @property
    def shares(self) -> Array | None:
        """Proportions (k,) of the stiffness, or None for even ones."""
        ...


@dataclass(frozen=True)
class SpringGroup:
    """Springs of one name: `stiffness` (N/m) is the set's total; `slack` (m) is added to the
    distance at rest; over the `toe` (m) the force sets in."""

    attached: Attached
    stiffness: float
    slack: float
    tension_only: bool
    toe: float = 0.0


@dataclass(frozen=True)
class TendonEnd:
    """A tendon's end: nodes and their shares of its tension, adding up to one.  They slide along
    the tendon, or where it runs through an `eyelet` (3,) m, in the guiding body's frame, hang on
    ropes to there."""

    nodes: Ints
    share: Array
    eyelet: Array | None = None


STICK = 0.01
"""Stiffness of sticking as a share of the contact's: nodes give way by about a micron before they
slide, and Newton takes a third of the time that it takes with all of it."""
PENETRATION = 1e-6
"""m, where friction asks for augmented contact and nothing else is said."""


@dataclass(frozen=True)
class ContactLaw:
    """Stiffness N/m3, smoothing m, and by body the surface and the offset (m) of the shell's face
    from the bare bone.  With `penetration` (m) contact is augmented until no node penetrates
    further; `friction` is Coulomb's coefficient, and asks for the same."""

    stiffness: float
    smoothing: float
    surfaces: Mapping[str, Surface]
    offset: Mapping[str, float]
    penetration: float | None = None
    friction: float = 0.0

    def augment(self) -> AugmentOptions | None:
        """How the outer loop is to end, where there is one."""
        if self.penetration is None and not self.friction:
            return None
        return AugmentOptions(penetration=self.penetration or PENETRATION)


def shell_hood(
    sheet: Sheet,
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
    """Assemble a ShellHood; `pull` (3,) is the tendons' direction in the frame of `guide_body`.

    Raises InputError where nothing holds the hood."""
    check_supports(springs, tied)
    bodies, X = rest.bodies, sheet.points
    ties = ties_of(X, sheet.directors, rest, tied)
    guided, share = shares_of(tendons)
    held = {name: s for name, s in springs.items() if len(s.attached.nodes)}
    touching = np.setdiff1d(np.arange(len(X)), np.concatenate([ties.node, guided]))
    model = sheet.model(
        springs=springs_of(X, rest, held),
        ties=ties,
        guides=guides_of(X, rest, guide_body, pull, guided),
        share=share,
        contacts=_contacts(sheet, bodies, contact, touching),
        bodies=bodies,
        groups=tuple(held),
        ropes=ropes_of(X, rest, guide_body, pull, tendons),
    )
    return ShellHood(
        model,
        tuple(tendons),
        rest,
        carriers,
        tuple(held),
        options,
        contact.augment(),
        lift=sheet.lift,
        stretched=bool((sheet.stretch != 1.0).any()),
    )


def check_supports(springs: Mapping[str, SpringGroup], tied: Mapping[str, Ints]) -> None:
    """Raises InputError where nothing holds the hood."""
    if not springs and not any(len(n) for n in tied.values()):
        raise InputError(
            "hood: no insertion holds the hood: it has neither a tied node set nor a spring set. "
            "Give hood.springs a set, or a mesh whose terminal slip is tied to a bone."
        )


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


def ties_of(X: Array, D: Array, rest: Motion, tied: Mapping[str, Ints]) -> Ties:
    """Nodes tied by body, at points X (n, 3) with directors D (n, 3) in the pose `rest`."""
    parts = [(rest.bodies.index(b), b, n) for b, n in tied.items()]
    none = np.zeros((0, 3))
    return Ties(
        np.concatenate([np.zeros(0, dtype=np.intp), *[n for _, _, n in parts]]),
        np.concatenate([np.zeros(0, dtype=np.intp), *[np.full(len(n), i) for i, _, n in parts]]),
        np.vstack([none, *[_local(rest, b, X[n]) for _, b, n in parts]]),
        np.vstack([none, *[D[n] @ rest.of(b)[1] for _, b, n in parts]]),
    )


def guides_of(X: Array, rest: Motion, body: str, pull: Array, nodes: Ints) -> Guides:
    """Nodes that slide along `pull` (3,), in the frame of `body`."""
    unit = np.asarray(pull) / np.linalg.norm(pull)
    index = np.full(len(nodes), rest.bodies.index(body))
    return Guides.along(nodes, index, _local(rest, body, X[nodes]), np.tile(unit, (len(nodes), 1)))


def springs_of(X: Array, rest: Motion, sets: Mapping[str, SpringGroup]) -> Springs:
    """Springs whose slack length is their distance at points X (n, 3) in the pose `rest`, and their
    set's slack."""
    if not sets:
        return Springs.none()
    columns: list[tuple[Array | Ints, ...]] = []
    for group, s in enumerate(sets.values()):
        nodes, anchors = s.attached.nodes, s.attached.anchors
        position, rotation = rest.of(s.attached.body)
        length = np.linalg.norm(X[nodes] - position - anchors @ rotation.T, axis=1) + s.slack
        ones = np.ones(len(nodes))
        body = ones * rest.bodies.index(s.attached.body)
        shares = ones if s.attached.shares is None else s.attached.shares
        k = s.stiffness * shares / shares.sum()
        only = ones * s.tension_only
        columns.append((nodes, body, anchors, k, length, only, ones * group, ones * s.toe))
    node, body, anchor, k, length, only, group_of, toe = (
        np.concatenate(c) for c in zip(*columns, strict=True)
    )
    whole = lambda a: a.astype(np.intp)  # noqa: E731
    return Springs(whole(node), whole(body), anchor, k, length, only > 0, whole(group_of), toe=toe)


def heights(sheet: Sheet) -> Array:
    """(n,) m, how far over its face towards the bones a node of the sheet touches them."""
    laid = thickness_as_laid(sheet.section.thickness.mean(axis=1), sheet.stress_free_growth)
    out: Array = node_means(laid, sheet.quads, len(sheet.points)) / 2 + sheet.lift
    return out


def _contacts(
    sheet: Sheet, bodies: tuple[str, ...], law: ContactLaw, nodes: Ints
) -> tuple[Contact, ...]:
    """Contacts of the nodes with every body, or of the points within quadratic elements of such
    nodes.

    Augmented contact is the nodes' in any element: a sheet cannot lie on its level in more points
    than it has nodes."""
    height, X = heights(sheet), sheet.points
    if sheet.quads.shape[1] == 4 or law.augment() is not None:
        return contacts_of(bodies, law, nodes, height[nodes], node_areas(X, sheet.quads)[nodes])
    points = ElementPoints.of(sheet.quads, np.flatnonzero(np.isin(sheet.quads, nodes).any(axis=1)))
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
            shear=STICK * law.stiffness,
            within=within,
        )
        for body, surface in law.surfaces.items()
    )
