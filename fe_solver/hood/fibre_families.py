"""The fibre families of a solved sheet, as directions that one can draw."""

from __future__ import annotations

import numpy as np

from cosim.port import Array, Ints
from fe_solver.elements.fibres import leading
from fe_solver.elements.kinds import kind_of
from fe_solver.materials.crossed_fibres import CrossedFibres, CrossedLinear
from fe_solver.materials.fibres import axial
from fe_solver.materials.hyperelastic import Potential
from fe_solver.materials.linear import Law, Orthotropic, Real
from fe_solver.materials.section import Patch
from fe_solver.materials.tension_field import TensionField
from fe_solver.solver.model import Configuration, ShellModel


def family_angles(law: Law | TensionField) -> tuple[Real, ...]:
    """The angle (rad) of each of a law's fibre families from axis 1 in the stress-free sheet; none
    of a law without fibres."""
    match law:
        case TensionField():
            return family_angles(law.base)
        case CrossedLinear():
            return (*family_angles(law.base), law.angle)
        case Orthotropic():
            return (0.0,)
        case Potential():
            angles = [np.arctan2(sc, cc) for cc, _, sc in law.fibres()]
            # two families in one direction are seen as one
            return tuple(
                a for i, a in enumerate(angles) if not any(np.array_equal(a, b) for b in angles[:i])
            )
    return ()


def straight_stretches(law: Law | TensionField) -> tuple[float, ...]:
    """The stretch at which the fibres of each of a law's families are straight: 1 where they have
    no toe; of a law without fibres one number, 1."""
    match law:
        case TensionField():
            return straight_stretches(law.base)
        case CrossedFibres():
            return (*straight_stretches(law.base), _straight(law.second))
    return (_straight(law),) * max(len(family_angles(law)), 1)


def _straight(law: object) -> float:
    return float(np.max(getattr(law, "lam_max", 1.0)))


def family_stretches(law: Law | TensionField, strain: Array) -> Array:
    """The stretch (nf, k) along each of a law's families under the Green-Lagrange strain E11, E22,
    2 E12 (k, 3), along axis 1 of a law without fibres: l^2 = 1 + 2 v . E v."""
    angles = [a if np.ndim(a) < 2 else np.mean(a, axis=1) for a in family_angles(law) or (0.0,)]
    lines = (axial(a) for a in angles)
    squares = [1 + 2 * sum(v * E for v, E in zip(line, strain.T, strict=True)) for line in lines]
    return np.sqrt(np.maximum(squares, 0.0))


def fibre_stretch(model: ShellModel, strain: Array) -> tuple[Array, Array]:
    """The stretch (ne,) of the fibres on each element under its mean strain (ne, 3), and that over
    the stretch at which they are straight; of several families those drawn most beyond straight."""
    out = np.ones((2, len(model.quads)))
    for patch in model.section.patches:
        each = family_stretches(patch.law, strain[patch.elements])
        over = each / np.array(straight_stretches(patch.law))[: len(each), None]
        most = over.argmax(axis=0), np.arange(each.shape[1])
        out[:, patch.elements] = each[most], over[most]
    return out[0], out[1]


def fibre_families(model: ShellModel, c: Configuration) -> Array:
    """The unit directions (nf, ne, 3) of the families at the elements' centres, in the deformed
    sheet; zero on elements without such a family.  nf is the most that a part of the sheet has."""
    patches = [(p, family_angles(p.law)) for p in model.section.patches]
    out = np.zeros((max((len(a) for _, a in patches), default=0), len(model.quads), 3))
    for patch, angles in patches:
        for family, angle in enumerate(angles):
            laid = _direction_in_layout(model, patch, angle)
            quads = model.quads[patch.elements]
            out[family, patch.elements] = convect_directions(quads, model.reference, c.x, laid)
    return out


def _direction_in_layout(model: ShellModel, patch: Patch, angle: Real) -> Array:
    """The directions (k, 3) at an angle in the stress-free sheet, in the sheet as it was laid out:
    mean over each element."""
    frame, grown = model.tables.frame[patch.elements], 1 + model.tables.growth[patch.elements]
    angle = np.broadcast_to(angle, patch.thickness.shape)
    turned = np.stack([np.cos(angle), np.sin(angle)], axis=2) / grown[:, None]
    direction = np.einsum("ega,egai->egi", turned, frame[:, :, :2])
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    return leading(np.einsum("egi,egj->eij", direction, direction))


def convect_directions(quads: Ints, before: Array, after: Array, direction: Array) -> Array:
    """The unit directions (k, 3) at the centres of elements (k, m), that the sheet carries along as
    its nodes move from `before` (n, 3) to `after` (n, 3)."""
    element = kind_of(quads)
    first, last = (element.base_vectors(x[quads], 0.0, 0.0) for x in (before, after))
    share = np.einsum("eka,ek->ea", np.linalg.pinv(first), direction)
    out = np.einsum("ea,eak->ek", share, last)
    return np.asarray(out / np.linalg.norm(out, axis=1, keepdims=True))
