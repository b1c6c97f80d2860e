"""Contact of points of a shell with rigid bodies through smooth signed distances.

The points are nodes, or lie within elements.  A point presses on every body that it penetrates (no
owner is chosen, so no force jumps from bone to bone).  The gap is g = distance(x) - offset, and the
pressure is k m(-g + s) with the smoothed ramp m, quadratic within `smoothing` of zero, so that the
energy has a continuous Hessian.  Without a multiplier the shift s is zero: a penalty, which presses
from a gap of `smoothing` on.  With the multiplier p, k m(s) = p: at a gap of zero the pressure is
p, whatever k and the smoothing are.  `fe_solver.solver.augmented_contact` finds the multipliers
whose gaps vanish (augmented Lagrangian), so that neither k nor the smoothing is left in the answer.

In place of the penalty a `fe_solver.forces.layer.Layer` of tissue may press: its pressure is that
of a depth of -g in a layer as thick and as stiff as it is there, and no multiplier is sought.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.port import Array
from fe_solver.forces.contact_points import ElementPoints
from fe_solver.forces.friction import Friction, join_friction
from fe_solver.forces.layer import TOE, Layer, layer_response
from fe_solver.forces.ramp import inverse_ramp, ramp
from fe_solver.forces.springs import COLUMNS, PointForces
from fe_solver.surfaces.shapes import Surface

REACH = 1.5e-3
"""m of gap within which a point is watched for contact, and further where the smoothing is."""

BAKED_END = 1e-9
"""m, of the end of a baked distance."""


def needed_distance(level: float, smoothing: float) -> float:
    """How far from a surface its distance must be right for points that it touches at `level` m
    with a pressure that sets in over `smoothing` m."""
    return max(level, 0.0) + max(REACH, smoothing)


@dataclass(frozen=True)
class Grip:
    """What friction remembers of k points, in the body's frame; limit and normal are of the last
    round of the outer loop."""

    anchor: Array
    """(k, 3) m, where a point would stick without force."""
    normal: Array
    """(k, 3), unit."""
    limit: Array
    """(k,) N, friction coefficient times the normal force."""
    dissipated: Array
    """(k,) J since the first increment."""


@dataclass(frozen=True)
class Contact:
    """Contact of k points with one body's surface.

    Without shares every body acts on every point, and as each force grows from zero with its own
    penetration, nothing jumps: right where a sheet may meet several bones.  Share a point (see
    `partition`) where two surfaces overlap, at a joint, and both would carry the same tendon; a
    point of share zero passes through that body.

    Raises InputError for what is not positive, or out of its range, and for a surface whose
    distance does not reach the offset."""

    body: int
    """The body's number."""
    surface: Surface
    """The body's, by signed distance in its frame."""
    nodes: NDArray[np.intp]
    """(k,), the points themselves, or where these lie `within` elements the nearest to each."""
    offset: Array
    """(k,) m of the mid-surface from the bone's surface at which contact begins (cartilage, capsule
    and half the shell)."""
    area: Array
    """(k,) m2."""
    stiffness: float
    """N/m3, along the normal; with a layer, of sticking alone."""
    smoothing: float
    """m to either side of the contact level within which a penalty sets in smoothly."""
    share: Array | None = None
    """(k,) in [0, 1], times the areas; None is 1."""
    pressure: Array | None = None
    """(k,) Pa, the multiplier; of points within elements, more than their nodes, not every gap can
    be closed."""
    friction: float = 0.0
    """Coulomb's coefficient."""
    shear: float | None = None
    """N/m3, the elastic stiffness of sticking; None takes `stiffness`."""
    grip: Grip | None = None
    """The state of friction."""
    pin: Array | None = None
    """(k,) N/m, in place of the stiffness along the normal where positive, in the tangent alone."""
    within: ElementPoints | None = None
    """The points, where they are not nodes."""
    layer: Layer | None = None
    """What presses in place of the penalty; its fields are in the body's frame."""
    elastic: bool = False
    """Whether the penalty is what the points lie on, and not a way to keep them out."""

    def __post_init__(self) -> None:
        shear = self.stiffness if self.shear is None else self.shear
        for value, what in (
            (self.stiffness, "stiffness (N/m3)"),
            (self.smoothing, "smoothing (m)"),
            (shear, "shear stiffness (N/m3)"),
        ):
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"contact with body {self.body}: {what} must be positive: {value}")
        if not 0 <= self.friction < np.inf:
            raise InputError(
                f"contact with body {self.body}: the friction coefficient must be 0 or a positive "
                f"number, got {self.friction}"
            )
        level = float(np.max(self.offset, initial=0.0))
        needed = needed_distance(level, self.smoothing)
        if self.surface.outside < needed - BAKED_END:
            raise InputError(
                f"contact with body {self.body}: a point touches up to {1e3 * level:.3g} mm over "
                f"the surface, whose distance is known up to {1e3 * self.surface.outside:.3g} mm; "
                f"bake it with a margin of {1e3 * needed:.3g} mm or more"
            )
        if self.share is not None and not ((self.share >= 0) & (self.share <= 1)).all():
            raise InputError(f"contact with body {self.body}: shares must lie between 0 and 1")

    @property
    def gives(self) -> bool:
        """Whether it is pressed in by what it bears, so that no multiplier is sought."""
        return self.elastic or self.layer is not None

    @property
    def weight(self) -> Array:
        """The areas (k,) m2 of the points, as far as they press on this body."""
        return self.area if self.share is None else self.area * self.share

    @property
    def stick(self) -> Array:
        """The elastic stiffness (k,) N/m of sticking."""
        return self.weight * (self.stiffness if self.shear is None else self.shear)

    @property
    def shift(self) -> Array:
        """The depths (k,) m at which the ramp gives the multiplier."""
        if self.pressure is None:
            return np.zeros(len(self.nodes))
        return inverse_ramp(self.pressure / self.stiffness, self.smoothing)

    def at(self, x: Array) -> Array:
        """The points (k, 3) m at node positions x (n, 3)."""
        return x[self.nodes] if self.within is None else self.within.mean(x)

    def local(self, x: Array, position: Array, rotation: Array) -> Array:
        """The points (k, 3) m in the body's frame."""
        return (self.at(x) - position[self.body]) @ rotation[self.body]

    def softened(self, share: float) -> Contact:
        """The contact with a share of the stiffness of what presses, penalty or layer."""
        layer = self.layer and replace(self.layer, share=share * self.layer.share)
        return replace(self, stiffness=share * self.stiffness, layer=layer)

    def gap(self, x: Array, position: Array, rotation: Array) -> Array:
        """The gaps (k,) m of the points, negative where one penetrates."""
        return self.surface.slopes(self.local(x, position, rotation))[0] - self.offset


def friction_of(contact: Contact, grip: Grip, local: Array) -> Friction:
    """The friction of points at places (k, 3), body frame, with the limits of the last round."""
    return Friction.of(local - grip.anchor, grip.normal, contact.stick, grip.limit)


def contact_forces(
    contact: Contact, x: Array, position: Array, rotation: Array, curvature: bool
) -> PointForces:
    """Return the contact's energy and forces at node positions x (n, 3) m, with the bodies at
    `position` (nb, 3) m and `rotation` (nb, 3, 3); `curvature` keeps the (negative) term of the
    Hessian that the surface's curvature makes.

    >>> import numpy as np
    >>> from fe_solver.forces.contact import Contact, contact_forces
    >>> from fe_solver.surfaces.shapes import Sphere
    >>> ball = Sphere(np.zeros(3), 0.01)
    >>> one, point = np.array([0]), np.array([[0.0, 0.0, 0.009]])  # m: 1 mm inside
    >>> contact = Contact(0, ball, one, np.zeros(1), np.array([1e-6]), 1e9, 1e-6)
    >>> found = contact_forces(contact, point, np.zeros((1, 3)), np.eye(3)[None], True)
    >>> f"{-found.gradient[0, 2]:.3f} N"  # on the point: stiffness times area times depth
    '1.000 N'
    """
    # gaps: only points near the surface, or gripped, are worked on
    p, R = position[contact.body], rotation[contact.body]
    at = contact.at(x)
    local = (at - p) @ R
    value, gradient = contact.surface.slopes(local)
    depth = contact.offset - value + contact.shift
    watched = depth > -max(REACH, contact.smoothing)
    if contact.grip is not None:
        watched |= contact.grip.limit > 0
    near = np.flatnonzero(watched)
    # what acts on them, in the body's frame
    place, normal, depth = local.take(near, axis=0), gradient.take(near, axis=0), depth[near]
    if contact.layer is None:
        made = _press_penalty(contact, near, depth, normal)
    else:
        made = _press_layer(contact, near, depth, normal, place)
    friction = None
    if contact.grip is not None:
        friction = friction_of(contact, contact.grip, local).take(near)
        made = made.rubbed(friction)
        friction = friction.turned(R)
    # the forces by node: points within elements act through their shape functions
    k, one = contact.within, np.ones(len(near))
    cell, point = (0, 0) if k is None else np.divmod(near, len(k.shape))
    return PointForces(
        contact.nodes[near][:, None] if k is None else k.quads.take(cell, axis=0),
        one[:, None] if k is None else k.shape.take(point, axis=0),
        np.full(len(near), -1, dtype=np.intp) if k is None else k.cells[cell],
        np.full(len(near), contact.body, dtype=np.intp),
        made.energy,
        made.gradient @ R.T,
        made.force,
        partial(_hessian, made, R, normal, (contact.surface, place) if curvature else None),
        at.take(near, axis=0) - p,
        one > 0,
        np.full(len(near), -1, dtype=np.intp),
        made.depth,
        normal @ -R.T,
        made.stiffness,
        made.ramp,
        np.inf * one,
        friction,
    )


class _Pressing(NamedTuple):
    """What acts on k points, in the body's frame."""

    energy: float
    gradient: Array
    """(k, 3) N."""
    force: Array
    """(k,) N along the normal."""
    along: Array
    """(k,) N/m, its slope by the depth."""
    depth: Array
    """(k,) m, beyond which the force has set in; `ramp` to either side."""
    ramp: Array
    stiffness: Array
    """(k,) N/m."""
    bend: Callable[[], tuple[NDArray[np.intp], Array]] | None = None
    """Some of the points, and what the fields of a layer add to their Hessian, (j, 3, 3) N/m."""
    rub: Array | None = None
    """What friction adds, (k, 3, 3) N/m."""

    def rubbed(self, friction: Friction) -> _Pressing:
        """With friction."""
        drag, slope = friction.linear(friction.sliding())
        energy = self.energy + float(friction.energy().sum())
        return self._replace(energy=energy, gradient=self.gradient + drag, rub=slope)


def _press_penalty(
    contact: Contact, near: NDArray[np.intp], depth: Array, normal: Array
) -> _Pressing:
    """What a penalty does to the points `near` (k,) at `depth` (k,) m, with the surface's gradient
    `normal` (k, 3)."""
    scale = contact.stiffness * contact.weight[near]
    smoothing = np.full(len(near), contact.smoothing)
    work, force, slope = ramp(depth, smoothing)
    force, along = scale * force, scale * slope
    if contact.pin is not None:  # it stands for the slope in the tangent
        pin = contact.pin[near]
        along = np.where(pin > 0, pin, along)
    pull = -force[:, None] * normal
    return _Pressing(float(scale @ work), pull, force, along, depth, smoothing, scale)


def _press_layer(
    contact: Contact, near: NDArray[np.intp], depth: Array, normal: Array, local: Array
) -> _Pressing:
    """What a layer does, as `_press_penalty`; its fields are looked up at the places `local` (k, 3)
    of what touches it."""
    layer, k, on = contact.layer, len(depth), np.flatnonzero(depth > 0)
    assert layer is not None
    weight = layer.share * contact.weight[near]
    gradient, force, along = np.zeros((k, 3)), np.zeros(k), np.zeros(k)
    place, fields = local.take(on, axis=0), (layer.thickness, layer.modulus)
    (h, by_h), (modulus, by_modulus) = (field.slopes(place) for field in fields)
    made = layer_response(depth[on], h, modulus)
    slopes, second = weight[on, None] * made.slopes, weight[on, None, None] * made.second
    by = np.stack([-normal.take(on, axis=0), by_h, by_modulus], axis=1)
    gradient[on] = np.einsum("ka,kai->ki", slopes, by)
    force[on], along[on] = slopes[:, 0], second[:, 0, 0]

    def bend() -> tuple[NDArray[np.intp], Array]:
        beside = second.copy()
        beside[:, 0, 0] = 0.0  # it is along the normal
        out = np.swapaxes(by, 1, 2) @ beside @ by
        for slope, field in zip(slopes.T[1:], fields, strict=True):
            out += slope[:, None, None] * field.distance(place).hessian
        return on, out

    toe, stiffness = np.full(k, layer.usual[0]), weight * (layer.usual[1] / layer.usual[0])
    toe[on], stiffness[on] = h, weight[on] * modulus / h
    toe *= TOE / 4  # a ramp of this width about this depth sets in as the layer does
    energy = float(weight[on] @ made.energy)
    return _Pressing(energy, gradient, force, along, depth - toe, toe, stiffness, bend)


def _hessian(
    made: _Pressing,
    R: Array,
    normal: Array,
    touched: tuple[Surface, Array] | None,
    pushed: Array,
) -> Array:
    """The stiffness (k, 3, 3), world frame, of what presses along the normals (k, 3), and, with the
    surface and the places (k, 3) where it is `touched`, of forces `pushed` (k,) N on its
    curvature."""
    out = np.zeros((len(normal), 3, 3))
    on = np.flatnonzero((made.along != 0) | (pushed != 0) | (made.rub is not None))
    n = normal.take(on, axis=0)
    out[on] = made.along[on, None, None] * n[:, :, None] * n[:, None, :]
    if touched is not None:
        surface, place = touched
        out[on] -= pushed[on, None, None] * surface.distance(place.take(on, axis=0)).hessian
        if made.bend is not None:
            which, bent = made.bend()
            out[which] += bent
    if made.rub is not None:
        out += made.rub
    half = np.swapaxes((out[on].reshape(-1, 3) @ R.T).reshape(-1, 3, 3), 1, 2)
    out[on] = (half.reshape(-1, 3) @ R.T).reshape(-1, 3, 3)
    return out


def join_point_forces(parts: list[PointForces]) -> PointForces:
    """All point forces as one."""
    parts, friction = _as_wide(parts), None
    if any(p.friction is not None for p in parts):
        friction = join_friction([p.friction or Friction.none(len(p.force)) for p in parts])
    columns = {n: np.concatenate([getattr(p, n) for p in parts]) for n in COLUMNS}
    energy = sum(p.energy for p in parts)
    return PointForces(energy=energy, bend=partial(_hessians, parts), friction=friction, **columns)


def _as_wide(parts: list[PointForces]) -> list[PointForces]:
    """The point forces with as many nodes for each point, those more than it has without weight."""
    width = max(p.nodes.shape[1] for p in parts)
    return [p if p.nodes.shape[1] == width else p.widened(width) for p in parts]


def _hessians(parts: list[PointForces], force: Array) -> Array:
    ends = np.cumsum([len(p.force) for p in parts])[:-1]
    each = zip(parts, np.split(force, ends), strict=True)
    return np.concatenate([p.bend(f) for p, f in each])


class Status(IntEnum):
    """What a point does against a body; without friction what presses slides."""

    OPEN = 0
    SLIDING = 1
    STICKING = 2


class ContactState(NamedTuple):
    """A contact at some configuration, by its points (k,)."""

    gap: Array
    """Gap (k,) in m, negative where a point penetrates."""
    pressure: Array
    """Pa, normal force over the point's whole area."""
    drag: Array
    """(k, 3) N, friction on the point, world frame."""
    status: NDArray[np.int8]
    """Values of `Status`."""


def normal_pressure(contact: Contact, local: Array, depth: Array) -> Array:
    """Return the pressure (k,) Pa on points at places `local` (k, 3), body frame, at `depth` (k,)
    m."""
    if contact.layer is None:
        return np.asarray(contact.stiffness * ramp(depth, contact.smoothing)[1])
    h, modulus = (f.slopes(local)[0] for f in (contact.layer.thickness, contact.layer.modulus))
    return np.asarray(contact.layer.share * layer_response(depth, h, modulus).slopes[:, 0])


def compression(contact: Contact, x: Array, position: Array, rotation: Array) -> Array:
    """Return the share (k,) of its thickness by which the layer is compressed at each point; of a
    penalty there is none."""
    if contact.layer is None:
        return np.zeros(len(contact.nodes))
    local = contact.local(x, position, rotation)
    depth = contact.offset - contact.surface.slopes(local)[0]
    return np.asarray(np.maximum(depth, 0.0) / contact.layer.thickness.slopes(local)[0])


def contact_state(contact: Contact, x: Array, position: Array, rotation: Array) -> ContactState:
    """Gap, pressure, friction and status at node positions x (n, 3) and body poses."""
    gap = contact.gap(x, position, rotation)
    share = 1.0 if contact.share is None else contact.share
    local = contact.local(x, position, rotation)
    pressure = share * normal_pressure(contact, local, contact.shift - gap)
    status = np.where(pressure > 0, Status.SLIDING, Status.OPEN).astype(np.int8)
    drag = np.zeros((len(gap), 3))
    if contact.grip is not None:
        friction = friction_of(contact, contact.grip, local)
        drag = -friction.linear(friction.sliding())[0] @ rotation[contact.body].T
        holds = np.linalg.norm(drag, axis=1) < (1 - 1e-9) * contact.grip.limit
        status[(pressure > 0) & holds] = Status.STICKING
    return ContactState(gap, pressure, drag, status)


class CoulombDefects(NamedTuple):
    """How far a contact is from what Coulomb's law asks of its points."""

    excess: float
    """N, the most by which the friction on a point exceeds the coefficient times its normal
    force."""
    limit: float
    """N, the largest of these products."""
    made: float
    """J, the work that friction has done on the points, not negative."""
    work: float
    """J, that of friction's forces over the slips since the anchors, without signs."""


def coulomb_defects(contact: Contact, x: Array, position: Array, rotation: Array) -> CoulombDefects:
    """The defects of a contact at node positions x (n, 3) and body poses; all zero of one without
    friction.  The plastic slip is what a force -drag/stick leaves of the slip since the anchor."""
    if contact.grip is None:
        return CoulombDefects(0.0, 0.0, 0.0, 0.0)
    state = contact_state(contact, x, position, rotation)
    limit, size = contact.friction * state.pressure * contact.area, _length(state.drag)
    local = contact.local(x, position, rotation)
    slip = friction_of(contact, contact.grip, local).slip @ rotation[contact.body].T
    elastic = np.divide(
        state.drag,
        contact.stick[:, None],
        out=np.zeros_like(slip),
        where=contact.stick[:, None] > 0,
    )
    done = np.einsum("ki,ki->k", state.drag, slip + elastic)
    return CoulombDefects(
        float((size - limit).max(initial=0.0)),
        float(limit.max(initial=0.0)),
        float(np.maximum(done, 0.0).sum()),
        float((size * _length(slip)).sum()),
    )


def _length(vectors: Array) -> Array:
    return np.asarray(np.linalg.norm(vectors, axis=-1))


class ContactFields(NamedTuple):
    """All contacts by node and body, (n, nb); a node stands for the points it is nearest to."""

    gap: Array
    """The smallest gap, m; inf where a node meets no surface of the body."""
    pressure: Array
    """Pa, force over area."""
    status: NDArray[np.int8]
    """The largest `Status` of the points."""


def contact_fields(
    contacts: Sequence[Contact], x: Array, position: Array, rotation: Array
) -> ContactFields:
    """Gap, pressure and status of every node against every body, for x (n, 3) and nb poses."""
    shape = (len(x), len(position))
    gap, pressure = np.full(shape, np.inf), np.zeros(shape)
    status = np.zeros(shape, dtype=np.int8)
    for contact in contacts:
        state, body = contact_state(contact, x, position, rotation), contact.body
        np.minimum.at(gap[:, body], contact.nodes, state.gap)
        np.maximum.at(status[:, body], contact.nodes, state.status)
        force, area = (
            np.bincount(contact.nodes, weights, len(x))
            for weights in (state.pressure * contact.area, contact.area)
        )
        pressure[:, body] += np.divide(force, area, out=0 * force, where=area > 0)
    return ContactFields(gap, pressure, status)


def partition(distances: Array, blend: float) -> Array:
    """The shares (k, nb) of nb bodies in k nodes from their signed distances (k, nb) m at rest:
    smooth (C1) in the distances, each row adding up to one.

    A body has all of a node that is nearer to it by `blend` (m) or more than to any other, nothing
    of one that is as much nearer to another, half where two are equally near.  Raises InputError
    where `blend` is not positive."""
    if not blend > 0:
        raise InputError(f"the blending length must be positive (m), got {blend}")
    nearer = (distances[:, None, :] - distances[:, :, None]) / blend
    t = np.clip((nearer + 1) / 2, 0, 1)
    step = t * t * (3 - 2 * t)
    bodies = np.arange(distances.shape[1])
    step[:, bodies, bodies] = 1.0
    weight = step.prod(axis=2)
    return weight / weight.sum(axis=1, keepdims=True)
