"""Contact of a hood by penalties alone, as near as these come to layers of tissue and to heads that
are covered by less than their bone's back.

A layer's push has the slope of its energy W: along the bone, too, where the layer's thickness or
modulus changes.  So the hood slides on a rigid surface of equal energy: each point of it lies where
pressing the tissue down to there takes the mean energy (by force) of the hood's equilibrium.  In
that equilibrium each element is pressed by a force F, its faces lying s over this surface.  A
penalty k = dp/ds over a gap g with the sum of k (g - s) over the element's points equal to F
presses it alike, and follows alike to first order.  Elements of about the same k and g are one
contact.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator
from dataclasses import dataclass, fields, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cosim.array_cache import user_cache
from cosim.port import Array, Ints, Triangles
from fe_solver.forces.contact import Contact, needed_distance, normal_pressure
from fe_solver.forces.contact_points import ElementPoints
from fe_solver.forces.layer import TOE, layer_response, pressure_law
from fe_solver.hood.build import heights
from fe_solver.hood.shell_hood import HoodState, ShellHood
from fe_solver.sheet import Sheet
from fe_solver.surfaces.shapes import Surface
from fe_solver.surfaces.spline_distance import SplineDistance

STIFFER, APART = 2.0, 0.1e-3
"""Ratio of stiffnesses, and m between gaps, within which elements are one contact."""
AROUND = 2e-3
"""m beyond the hood, as laid out and as it lies, to which the surface is made."""
NEAR_LEVEL = 3e-3
"""m over a bone's contact level within which a node counts for that."""
SMOOTHING = 1e-6
"""m within which the penalties set in."""
STEP = 1e-5
"""m of the differences by which a surface's vertices are put on it."""
HALVINGS = 50
SHARES = np.concatenate([[0.0], np.geomspace(1e-4, 4.0, 4000)])
"""Compressions of the table that energies are looked up in."""


def linear_contact(
    hood: ShellHood,
    state: HoodState,
    heads: Collection[str],
    written: Sheet,
    spacing: float = 0.25e-3,
) -> tuple[tuple[Contact, ...], dict[str, Triangles]]:
    """The contacts of a hood with penalties in place of layers, and of what covers the bodies
    `heads`, as its solved `state` has them; and the surfaces by body, in its frame, that these are
    with: vertices (nv, 3) m, triangles (nt, 3), distances baked at `spacing` m.  Gaps are those of
    the `written` sheet's faces, about the same mid-surface."""
    contacts: list[Contact] = []
    surfaces: dict[str, Triangles] = {}
    assert hood.sheet is not None
    half, faces = (heights(sheet) - sheet.lift for sheet in (hood.sheet, written))
    for contact in hood.model.contacts:
        body = hood.bodies[contact.body]
        if not _needs_linear(hood, contact, heads):
            contacts.append(contact)
            continue
        contact = _within_elements(hood, contact)
        surfaces[body] = made = _equal_energy(hood, state, contact, half)
        reach = needed_distance(float(faces.max()) + NEAR_LEVEL, SMOOTHING)
        baked = SplineDistance.bake(*made, spacing, reach, user_cache())
        contacts += _penalties(hood, state, contact, faces, baked)
    return tuple(contacts), surfaces


def needs_linear(hood: ShellHood, heads: Collection[str]) -> bool:
    """Whether a contact of the hood is one that a gap and a penalty of its own do not say."""
    return any(_needs_linear(hood, contact, heads) for contact in hood.model.contacts)


def _needs_linear(hood: ShellHood, contact: Contact, heads: Collection[str]) -> bool:
    return contact.layer is not None or hood.bodies[contact.body] in heads


def _within_elements(hood: ShellHood, contact: Contact) -> Contact:
    """The contact of points within elements in place of their nodes."""
    if contact.within is not None:
        return contact
    quads, X = hood.model.quads, hood.model.reference
    cells = np.flatnonzero(np.isin(quads, contact.nodes).all(axis=1))
    points, offset = ElementPoints.of(quads, cells), np.zeros(len(X))
    offset[contact.nodes] = contact.offset - hood.lift[contact.nodes]
    return replace(
        contact,
        nodes=points.nearest,
        offset=points.mean(offset),
        area=points.areas(X),
        within=points,
    )


def _equal_energy(hood: ShellHood, state: HoodState, contact: Contact, half: Array) -> Triangles:
    """The surface of equal energy about the hood; without a layer that of the contact level."""
    surface = cast(SplineDistance, contact.surface)  # which a hood of a case lies on
    c, b, points = state.configuration, contact.body, contact.within
    assert points is not None
    level, layer = float((contact.offset - points.mean(half)).mean()), contact.layer
    energy = _mean_energy(contact, c.x, c.position, c.rotation)

    def over(x: Array) -> Array:
        depth: Array | float = 0.0
        if layer is not None and energy:
            h, modulus = (f.slopes(x)[0] for f in (layer.thickness, layer.modulus))
            depth = h * np.interp(energy / (modulus * h), pressure_law(SHARES)[0], SHARES)
        return np.asarray(surface.slopes(x)[0] + depth - level)

    laid = (hood.model.reference - hood.rest.position[b]) @ hood.rest.rotation[b]
    there = np.concatenate([laid, (c.x - c.position[b]) @ c.rotation[b]])
    near = there[surface.slopes(there)[0] < level + NEAR_LEVEL]
    if not len(near):
        near = there
    step, last = surface.spacing, np.array(surface.coefficients.shape) - 3
    first = np.clip((near.min(axis=0) - AROUND - surface.origin) // step, 0, last)
    end = np.clip((near.max(axis=0) + AROUND - surface.origin) // step + 1, 0, last)
    count = (end - first + 1).astype(int)
    places = np.stack(np.meshgrid(*map(np.arange, count), indexing="ij"), axis=-1)
    origin = surface.origin + step * first
    values = over((origin + step * places).reshape(-1, 3)).reshape(count)
    for axis in range(3):
        border = np.moveaxis(values, axis, 0)[[0, -1]]
        np.moveaxis(values, axis, 0)[[0, -1]] = np.maximum(border, step)
    x, triangles = level_surface(values, origin, step)
    for _ in range(3):
        rise = [(over(x + e) - over(x - e)) / (2 * STEP) for e in STEP * np.eye(3)]
        slope = np.stack(rise, axis=1)
        size = np.maximum(np.einsum("ki,ki->k", slope, slope), 0.1)
        x = x - np.clip(over(x) / size, -step, step)[:, None] * slope
    return x, triangles


def _mean_energy(contact: Contact, x: Array, position: Array, rotation: Array) -> float:
    """The mean, by force, of the energy (J/m2) that the points of a layer have; 0 without."""
    layer = contact.layer
    if layer is None:
        return 0.0
    local = contact.local(x, position, rotation)
    depth = np.maximum(contact.offset - contact.surface.slopes(local)[0], 0.0)
    h, modulus = (f.slopes(local)[0] for f in (layer.thickness, layer.modulus))
    made = layer_response(depth, h, modulus)
    force = contact.weight * made.slopes[:, 0]
    return float(force @ made.energy / force.sum()) if force.any() else 0.0


@dataclass(frozen=True)
class _Pressed:
    """What c elements of p points bear on a bone, each (c, p)."""

    area: Array
    """m2."""
    over: Array
    """m, of the hood's face over the rigid surface."""
    force: Array
    """N along that surface's normal."""
    slope: Array
    """N/m, by which it grows towards the surface."""
    free: Array
    """m over the surface, where the point begins to bear."""
    usual: Array
    """N/m3 of the tissue, pressed or not."""

    def take(self, some: Ints) -> _Pressed:
        """Some of the elements as one."""
        return _Pressed(*(getattr(self, f.name)[some].reshape(1, -1) for f in fields(self)))

    @property
    def stiffness(self) -> Array:
        """(c,) N/m3, of a penalty on the points that bear something."""
        area = np.where(self.force > 0, self.area, 0.0).sum(axis=1)
        pressed = self.slope.sum(axis=1) / np.where(area > 0, area, 1.0)
        return np.where(pressed > 0, pressed, self.usual.mean(axis=1))

    @property
    def gap(self) -> Array:
        """(c,) m over which this penalty makes the force; where there is none, from which on it
        would bear something."""
        force, k = self.force.sum(axis=1), self.stiffness
        low, high = self.over.min(axis=1), self.over.max(axis=1)
        none = np.minimum(self.free.mean(axis=1), low)
        high = high + force / (k * self.area.sum(axis=1))
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            depth = np.maximum(middle[:, None] - self.over, 0.0)
            less = k * np.einsum("cp,cp->c", self.area, depth) < force
            low, high = np.where(less, middle, low), np.where(less, high, middle)
        return np.where(force > 0, high, none)


def _penalties(
    hood: ShellHood, state: HoodState, contact: Contact, half: Array, surface: Surface
) -> Iterator[Contact]:
    """The contact with penalties on a surface, element by element of about the same."""
    pressed, points = _pressed(state, contact, half, surface), contact.within
    assert points is not None
    kind = [np.log(pressed.stiffness) / np.log(STIFFER), pressed.gap / APART]
    _, group = np.unique(np.round(kind), axis=1, return_inverse=True)
    for g in range(group.max(initial=-1) + 1):
        some = np.flatnonzero(group.reshape(-1) == g)
        one, own = pressed.take(some), ElementPoints.of(hood.model.quads, points.cells[some])
        stiffness = float(one.stiffness[0])
        yield replace(
            contact,
            surface=surface,
            nodes=own.nearest,
            offset=one.gap[0] + own.mean(half),
            area=own.areas(hood.model.reference),
            stiffness=stiffness,
            smoothing=SMOOTHING,
            shear=contact.stiffness if contact.shear is None else contact.shear,
            within=own,
            layer=None,
            elastic=True,
        )


def _pressed(state: HoodState, contact: Contact, half: Array, surface: Surface) -> _Pressed:
    c, points, layer = state.configuration, contact.within, contact.layer
    assert points is not None
    local = contact.local(c.x, c.position, c.rotation)
    value, gradient, _ = contact.surface.distance(local)
    over, normal, _ = surface.distance(local)
    depth, slant = contact.offset - value, np.einsum("ki,ki->k", gradient, normal)
    usual, begins = np.full(len(depth), contact.stiffness), depth
    slope = usual * (depth > 0)
    if layer is not None:
        h, modulus = (f.slopes(local)[0] for f in (layer.thickness, layer.modulus))
        slope = layer_response(np.maximum(depth, 0.0), h, modulus).second[:, 0, 0] * (depth > 0)
        usual, begins = modulus / h, depth - TOE * h
    known = (value < contact.surface.outside) & (over < surface.outside)
    if layer is not None:
        usual = np.where(known, usual, layer.usual[1] / layer.usual[0])
    over = over - points.mean(half)
    each = (
        contact.weight,
        over,
        contact.weight * normal_pressure(contact, local, depth) * slant,
        contact.weight * slope * slant**2,
        np.where(known, over + begins, 0.0),
        usual,
    )
    return _Pressed(*(v.reshape(len(points.cells), -1) for v in each))


CORNERS = np.array(list(itertools.product((0, 1), repeat=3)))
EDGES = [(a, b) for a, b in itertools.combinations(CORNERS, 2) if np.abs(a - b).sum() == 1]


def level_surface(values: Array, origin: Array, spacing: float) -> tuple[Array, Ints]:
    """Vertices (nv, 3) m and triangles (nt, 3), wound outwards, of where values (nx, ny, nz) at the
    nodes of a grid pass zero: positive outside, as they are all over the grid's border.  By surface
    nets (Gibson 1998, MICCAI, LNCS 1496:888): a vertex in each cell that the level passes, four
    joined round each edge that it cuts.

    >>> import numpy as np
    >>> from fe_solver.surfaces.closing import volume
    >>> from fe_solver.hood.linear_contact import level_surface
    >>> x = np.arange(-12, 13) / 10
    >>> ball = np.linalg.norm(np.stack(np.meshgrid(x, x, x)), axis=0) - 1
    >>> inside = volume(*level_surface(ball, x[[0, 0, 0]], 0.1))
    >>> bool(abs(inside / (4 / 3 * np.pi) - 1) < 0.02)
    True
    """
    cells = np.array(values.shape) - 1
    corner = {tuple(c): _from(values, c, cells) for c in CORNERS}
    place, cuts = np.zeros((*cells, 3)), np.zeros(cells)
    for a, b in EDGES:
        low, high = corner[tuple(a)], corner[tuple(b)]
        cut = (low < 0) != (high < 0)
        share = low / np.where(cut, low - high, 1.0)
        place += cut[..., None] * (a + share[..., None] * (b - a))
        cuts += cut
    number = np.full(cells, -1)
    number[cuts > 0] = np.arange((cuts > 0).sum())
    at = np.argwhere(cuts > 0) + place[cuts > 0] / cuts[cuts > 0][:, None]
    quads = [_around(values < 0, number, axis) for axis in range(3)]
    a, b, c, d = np.concatenate(quads).T
    return origin + spacing * at, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def _from(values: NDArray[Any], first: Ints, count: Ints) -> NDArray[Any]:
    return values[tuple(slice(i, i + n) for i, n in zip(first, count, strict=True))]


def _around(inside: NDArray[np.bool_], number: Ints, axis: int) -> Ints:
    """The cells' numbers (k, 4) round each cut edge along an axis, right-handed about the way
    out."""
    step = np.eye(3, dtype=int)
    one, two = step[(axis + 1) % 3], step[(axis + 2) % 3]
    count = np.array(number.shape) - one - two
    ring = [_from(number, first, count) for first in (0 * one, one, one + two, two)]
    begin = _from(inside, one + two, count)
    end = _from(inside, one + two + step[axis], count)
    quads = np.stack(ring, axis=-1)
    return np.concatenate([quads[begin & ~end], quads[end & ~begin][:, ::-1]])
