"""Stress resultants of the shell: its materials, integrated through the thickness.

At a Gauss point the in-plane strain is e + z k with z in [-h/2, h/2]; membrane forces, moments and
their tangent are the integrals of the plane stress, its first moment and its tangent.  Linear laws
are integrated in closed form, once; the others by Gauss-Legendre points at every evaluation.  A
tension field, and a tendon whose fascicles slide on each other, act on the mid-surface's strain e,
and bend as their law does at rest: on a head that is round within some thicknesses a solid one
would carry its force in its outer face.
Transverse shear is linear, with the law's initial moduli; a hyperelastic sheet stiffens in it as it
is compressed and as its director leans (`_with_shear`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.port import Array, Ints
from fe_solver.elements import kernels
from fe_solver.materials.crossed_fibres import CrossedLinear
from fe_solver.materials.hyperelastic import Potential, volume_ratio
from fe_solver.materials.kernels import (
    BARRIER,
    LAYER_WEIGHTS,
    LAYERED,
    LAYERS,
    ON_MIDDLE,
    RELAXED,
    RESIDUAL_MODULUS,
    SMOOTHING,
    respond,
)
from fe_solver.materials.law_table import LawRows, LawTable, code_of, law_table
from fe_solver.materials.linear import Isotropic, Law, LinearLaw, Orthotropic
from fe_solver.materials.tension_field import TensionField

SHEAR_CORRECTION = 5.0 / 6.0
LAYER_MOMENTS = LAYER_WEIGHTS * LAYERS ** np.arange(3)[:, None]
"""(3, layers) what makes the integral of a function through the thickness of 2, and its first and
second moment, of its values at the layers."""


class Resultants(NamedTuple):
    """Energy and its derivatives at each Gauss point, per reference area, against the generalized
    strains e11, e22, 2 e12, k11, k22, 2 k12, g13, g23.  An inadmissible strain has infinite energy
    and no force."""

    energy: Array
    """(ne, g) J/m2."""
    force: Array
    """(ne, g, 8) N/m and N."""
    stiffness: Array
    """(ne, g, 8, 8)."""


@dataclass(frozen=True)
class Patch:
    """k elements of one material."""

    elements: Ints
    """(k,) indices."""
    law: Law | TensionField
    """Its parameters have shape (k, 1) or (k, g) where they differ."""
    thickness: Array
    """(k, g) m at the Gauss points."""
    factor: Array = field(default_factory=lambda: np.ones((1, 1)))
    """(k, 1) or (1, 1), of all the law's stresses."""
    bending: Array = field(default_factory=lambda: np.zeros((3, 3)))
    """(3, 3) Pa, moduli of bending besides the law's own."""
    shear_correction: float = SHEAR_CORRECTION
    """The factor of transverse shear."""
    sliding: bool = False
    """Whether its fibres slide on each other as it bends; of a law that is not linear."""

    def __post_init__(self) -> None:
        if self.sliding and self.linear:
            raise ValueError("fibres of a linear law do not slide: it is integrated in closed form")

    @property
    def linear(self) -> bool:
        """Whether its stiffness is the same at every strain."""
        return isinstance(self.law, LinearLaw)

    @property
    def relaxed(self) -> bool:
        """Whether it bears no compression."""
        return isinstance(self.law, TensionField)

    @property
    def on_middle(self) -> bool:
        """Whether its law acts on the mid-surface alone."""
        return self.relaxed or self.sliding

    @property
    def hyperelastic(self) -> bool:
        """Whether its law, or what its tension field relaxes, is a potential."""
        return isinstance(_base(self.law)[0], Potential)


@dataclass(frozen=True)
class Section:
    """The materials of all elements; every element belongs to one patch."""

    patches: tuple[Patch, ...]

    @cached_property
    def count(self) -> int:
        """Number of elements."""
        return sum(len(p.elements) for p in self.patches)

    @cached_property
    def points(self) -> int:
        """Gauss points of an element; four where there is none."""
        return self.patches[0].thickness.shape[1] if self.patches else 4

    @cached_property
    def thickness(self) -> Array:
        """The thickness (ne, g) m at the Gauss points."""
        out = np.empty((self.count, self.points))
        for p in self.patches:
            out[p.elements] = p.thickness
        return out

    @cached_property
    def linear(self) -> Array:
        """The constant stiffness (ne, g, 8, 8): all of it where the law is linear; of a tension
        field bending and transverse shear as its base law has them at rest, of another law the
        patch's own bending, and transverse shear unless it is hyperelastic."""
        out = np.zeros((self.count, self.points, 8, 8))
        for p in self.patches:
            out[p.elements] = p.factor[..., None, None] * _constant(p)
        return out

    @cached_property
    def nonlinear(self) -> tuple[Patch, ...]:
        """Those of a kind as one, so that an evaluation is few and large operations."""
        kinds: dict[tuple[object, ...], list[Patch]] = {}
        for i, p in enumerate(self.patches):
            if not p.linear:
                kinds.setdefault(_kind(p) or (i,), []).append(p)
        return tuple(map(_as_one, kinds.values()))

    @cached_property
    def smoothing(self) -> float | None:
        """The least strain by which its tension fields are smoothed; None without one."""
        each = (_base(p.law)[1] for p in self.patches)
        return min((smoothing for smoothing in each if smoothing is not None), default=None)

    def with_smoothing(self, least: float) -> Section:
        """The section whose tension fields are smoothed by at least that strain."""

        def smoother(law: Law | TensionField) -> Law | TensionField:
            if not isinstance(law, TensionField):
                return law
            return replace(law, smoothing=max(law.smoothing, least))

        return replace(self, patches=tuple(replace(p, law=smoother(p.law)) for p in self.patches))

    def relaxed(self, factor: float, held: Array) -> RelaxedSection:
        """The section in a step of its relaxation: its law times `factor`, and resultants that are
        `held` (ne, g, 8)."""
        made = RelaxedSection(self.patches, factor, held)
        for name in ("linear", "nonlinear", "thickness", "_coded"):
            vars(made)[name] = getattr(self, name)
        return made

    def response(self, strain: Array) -> Resultants:
        """Energy, force and stiffness at generalized strains (ne, g, 8)."""
        if not (kernels.COMPILED and self.nonlinear):
            return self.respond_in_numpy(strain)
        table, uncoded = self._coded
        return _add(uncoded, strain, Resultants(*respond(*table, self.linear, strain)))

    def strain_energy(self, strain: Array) -> Array:
        """What the law stores (ne, g) J/m2 at generalized strains (ne, g, 8); of a section that
        relaxed what it would store at once."""
        return Section.response(self, strain).energy

    def respond_in_numpy(self, strain: Array) -> Resultants:
        """`response` without the compiled kernel: what that is held to."""
        force = np.einsum("ngij,ngj->ngi", self.linear, strain)
        energy = np.einsum("ngi,ngi->ng", force, strain) / 2
        if not self.nonlinear:
            return Resultants(energy, force, self.linear)
        return _add(self.nonlinear, strain, Resultants(energy, force, self.linear.copy()))

    @cached_property
    def _coded(self) -> tuple[LawTable, tuple[Patch, ...]]:
        """The laws as the kernel takes them, and the patches whose law it does not know."""
        rows = [(p, _rows(p)) for p in self.nonlinear]
        known = [row for _, row in rows if row is not None]
        uncoded = tuple(p for p, row in rows if row is None)
        return law_table(known, self.count, self.points), uncoded

    def tension_state(self, strain: Array) -> NDArray[np.int8]:
        """The `tension_field.State` (ne,), the rounded mean of the Gauss points' at strains (ne, g,
        8); -1 where there is no tension field and the sheet bears compression."""
        out = np.full(len(strain), -1, dtype=np.int8)
        for p in self.patches:
            if isinstance(p.law, TensionField):
                states = p.law.state(strain[p.elements, :, :3])
                out[p.elements] = np.rint(states.mean(axis=1))
        return out

    def thickness_stretch(self, strain: Array) -> Array:
        """Current over stress-free thickness (ne, g) by the mid-surface's strains (ne, g, 8)."""
        out = np.empty(strain.shape[:2])
        for p in self.patches:
            out[p.elements] = thickness_stretch(p.law, strain[p.elements, :, :3])
        return out

    def stress(self, strain: Array, z: float = 0.0) -> Array:
        """The second Piola-Kirchhoff stress S11, S22, S12 (ne, g, 3) Pa at the height z, in halves
        of the thickness."""
        out = np.empty((*strain.shape[:2], 3))
        for p in (*self.nonlinear, *(p for p in self.patches if p.linear)):
            e = strain[p.elements]
            here = 0.0 if p.sliding else z
            plane = e[..., :3] + here * p.thickness[..., None] / 2 * e[..., 3:6]
            out[p.elements] = p.factor[..., None] * p.law.response(plane).stress
        return out


@dataclass(frozen=True)
class RelaxedSection(Section):
    """A section in a step of its relaxation (`materials.prony`)."""

    factor: float
    """By which the law is multiplied."""
    held: Array
    """(ne, g, 8) N/m and N, of the steps before."""

    def response(self, strain: Array) -> Resultants:
        """As of `Section`; the energy is that of the step's incremental potential."""
        energy, force, stiffness = super().response(strain)
        more = np.einsum("ngi,ngi->ng", self.held, strain)
        return Resultants(
            self.factor * energy + more, self.factor * force + self.held, self.factor * stiffness
        )

    def stress(self, strain: Array, z: float = 0.0) -> Array:
        """As of `Section`; what is held runs straight through the thickness."""
        h = self.thickness[..., None]
        held = self.held[..., :3] / h + z * 6 * self.held[..., 3:6] / h**2
        return self.factor * super().stress(strain, z) + held


def one_law(law: Law | TensionField, thickness: Array) -> Section:
    """Return the section of elements of one law, with thickness (ne,) m at four Gauss points, or
    (ne, g).

    >>> import numpy as np
    >>> from fe_solver.materials.linear import Isotropic
    >>> from fe_solver.materials.section import one_law
    >>> section = one_law(Isotropic(100e6, 0.0), np.array([0.5e-3]))
    >>> strain = np.zeros((1, 4, 8))
    >>> strain[..., 0] = 0.01  # 1 % along the fibre
    >>> section.response(strain).force[0, 0, :3]  # N/m
    array([500.,   0.,   0.])
    """
    thickness = np.asarray(thickness, dtype=float)
    if thickness.ndim == 1:
        thickness = np.tile(thickness[:, None], (1, 4))
    return Section((Patch(np.arange(len(thickness)), law, thickness),))


def join_sections(patches: Sequence[Patch]) -> Section:
    """The section of all patches.  Raises ValueError where elements lie in no patch or in two."""
    elements = np.concatenate([p.elements for p in patches])
    if not np.array_equal(np.sort(elements), np.arange(len(elements))):
        raise ValueError("every element must lie in exactly one patch")
    return Section(tuple(patches))


def _kind(p: Patch) -> tuple[object, ...]:
    """What patches share whose laws differ in nothing but numbers; empty of one that is alone."""
    law, smoothing = _base(p.law)
    if not all(isinstance(v, float) for v in vars(law).values()):
        return ()
    fibres = (law.incompressible(), law.fibres()) if isinstance(law, Potential) else ()
    return type(law), smoothing, fibres, p.shear_correction, p.sliding


def _base(law: Law | TensionField) -> tuple[Law, float | None]:
    """The law that a tension field relaxes, with its smoothing; any other law is its own."""
    return (law.base, law.smoothing) if isinstance(law, TensionField) else (law, None)


def _as_one(patches: Sequence[Patch]) -> Patch:
    """Patches of one kind, for their law and its shear: each element with the numbers of its own;
    what is linear in a patch stays with the patch."""
    if len(patches) == 1:
        return patches[0]
    bases: list[Any] = [_base(p.law)[0] for p in patches]
    sizes, numbers = [len(p.elements) for p in patches], {}
    for name in vars(bases[0]):
        values = [getattr(law, name) for law in bases]
        if len(set(values)) > 1:
            numbers[name] = np.repeat(values, sizes)[:, None]
    law, first = replace(bases[0], **numbers), patches[0].law
    return Patch(
        np.concatenate([p.elements for p in patches]),
        replace(first, base=law) if isinstance(first, TensionField) else law,
        np.concatenate([p.thickness for p in patches]),
        np.concatenate([np.broadcast_to(p.factor, (len(p.elements), 1)) for p in patches]),
        shear_correction=patches[0].shear_correction,
        sliding=patches[0].sliding,
    )


def _rows(p: Patch) -> LawRows | None:
    """What the kernel takes of a patch; None where it does not know the law."""
    base, smoothing = _base(p.law)
    code = code_of(base)
    if code is None:
        return None
    acts, more = ON_MIDDLE if p.sliding else LAYERED, {}
    if isinstance(p.law, TensionField):
        cost = p.law.cost(p.thickness.shape)
        acts = RELAXED
        more = {
            BARRIER: cost.barrier,
            RESIDUAL_MODULUS: cost.residual,
            SMOOTHING: np.asarray(smoothing),
        }
    shear = _half_shear(p) if p.hyperelastic else np.full((1, 1), -1.0)
    return LawRows(p.elements, acts, code, more, p.thickness, shear, p.factor)


def _half_shear(p: Patch) -> Array:
    """Half the stiffness (k, g) N/m of a hyperelastic sheet in transverse shear at rest."""
    return np.asarray(p.shear_correction * p.thickness * p.law.shear()[0] / 2)


def _add(patches: Sequence[Patch], strain: Array, total: Resultants) -> Resultants:
    """The resultants with those of patches, as numpy computes them, at all elements' strain."""
    for p in patches:
        more = (_membrane if p.on_middle else _integrate)(p, strain[p.elements])
        if p.hyperelastic:
            more = _with_shear(p, strain[p.elements], more)
        for whole, part in zip(total, more, strict=True):
            part *= p.factor.reshape(p.factor.shape + (1,) * (part.ndim - 2))
            whole[p.elements] += part
    return total


def _constant(p: Patch) -> Array:
    """The part (k, g, 8, 8) of one patch: shear that is linear, the bending of what acts on the
    middle, and of a linear law membrane and bending."""
    h = p.thickness
    out = np.zeros((*h.shape, 8, 8))
    out[..., 3:6, 3:6] = p.bending * (h**3 / 12)[..., None, None]
    law = _base(p.law)[0]
    if not p.hyperelastic:
        for i, modulus in zip((6, 7), law.shear(), strict=True):
            out[..., i, i] = p.shear_correction * h * modulus
    if not (p.linear or p.on_middle):
        return out
    plane = law.response(np.zeros((*h.shape, 3))).tangent
    out[..., 3:6, 3:6] += plane * (h**3 / 12)[..., None, None]
    if p.linear:
        out[..., :3, :3] = plane * h[..., None, None]
    return out


def _membrane(p: Patch, strain: Array) -> Resultants:
    """A law that acts on the mid-surface's strain alone."""
    h = p.thickness
    answer = p.law.response(strain[..., :3])
    out = _nothing(strain)
    out.energy[:] = answer.energy * h
    out.force[..., :3] = answer.stress * h[..., None]
    out.stiffness[..., :3, :3] = answer.tangent * h[..., None, None]
    return out


def _integrate(p: Patch, strain: Array) -> Resultants:
    """A law at points through the thickness."""
    half = p.thickness / 2
    z = LAYERS[:, None, None] * half  # (layers, k, g)
    answer = p.law.response(strain[..., :3] + z[..., None] * strain[..., 3:6])
    stress = np.tensordot(LAYER_MOMENTS[:2], answer.stress, 1)
    tangent = np.tensordot(LAYER_MOMENTS, answer.tangent, 1)
    out, (membrane, bending) = _nothing(strain), (slice(3), slice(3, 6))
    out.energy[:] = half * np.tensordot(LAYER_WEIGHTS, answer.energy, 1)
    lever = np.stack([half, half**2, half**3])[..., None]
    out.force[..., membrane], out.force[..., bending] = lever[:2] * stress
    tangent *= lever[..., None]
    out.stiffness[..., membrane, membrane] = tangent[0]
    out.stiffness[..., membrane, bending] = out.stiffness[..., bending, membrane] = tangent[1]
    out.stiffness[..., bending, bending] = tangent[2]
    return out


def _with_shear(p: Patch, strain: Array, plane: Resultants) -> Resultants:
    """The resultants with the energy of transverse shear, s mu h (1 / r - 1 / D) / 2: shear
    correction s, D = det C of the plane, r that of C in space with a director of unit length.

    With s = 1 it is an incompressible neo-Hookean solid's, F = (a1, a2, l d) and l = 1 / sqrt(r):
    a director that leans (r = D cos^2) is resisted without bound, and the more the smaller the
    sheet's area is."""
    e, (g1, g2) = strain[..., :3], np.moveaxis(strain[..., 6:], -1, 0)
    c11, c22, c12 = 1 + 2 * e[..., 0], 1 + 2 * e[..., 1], e[..., 2]
    D = c11 * c22 - c12 * c12
    r = D - (c22 * g1 * g1 - 2 * c12 * g1 * g2 + c11 * g2 * g2)
    fine = (c11 > 0) & (D > 0) & (r > 0)
    D, r = np.where(fine, D, 1.0), np.where(fine, r, 1.0)
    k = np.where(fine, _half_shear(p), 0.0)
    by_D = 2 * np.stack([c22, c11, -c12, 0 * D, 0 * D])  # rows and columns first
    lean = np.stack([g2 * g2, g1 * g1, -g1 * g2, c22 * g1 - c12 * g2, c11 * g2 - c12 * g1])
    by_r = by_D - 2 * lean
    curved, plain = k / r**2, k / D**2
    second = np.zeros((5, 5, *D.shape))  # what D and r themselves bend
    second[0, 1], second[2, 2] = 4 * (plain - curved), 2 * (curved - plain)
    second[0, 4], second[1, 3] = 4 * curved * g2, 4 * curved * g1
    second[2, 3], second[2, 4] = -2 * curved * g2, -2 * curved * g1
    second[3, 3], second[4, 4] = 2 * curved * c22, 2 * curved * c11
    second[3, 4] = -2 * curved * c12
    for i, j in ((0, 1), (0, 4), (1, 3), (2, 3), (2, 4), (3, 4)):
        second[j, i] = second[i, j]
    second += (2 * curved / r * by_r)[:, None] * by_r
    second[:3, :3] -= (2 * plain / D * by_D[:3])[:, None] * by_D[:3]
    at = np.array([0, 1, 2, 6, 7])
    plane.energy[:] = np.where(fine, plane.energy + k / r - k / D, np.inf)
    plane.force[..., at] += np.moveaxis(plain * by_D - curved * by_r, 0, -1)
    plane.stiffness[..., at[:, None], at] += np.moveaxis(second, (0, 1), (-2, -1))
    return plane


def _nothing(strain: Array) -> Resultants:
    shape = strain.shape
    return Resultants(np.zeros(shape[:-1]), np.zeros(shape), np.zeros((*shape, 8)))


def thickness_stretch(law: Law | TensionField, strain: Array) -> Array:
    """The current over the stress-free thickness (...) at the strain (..., 3), E11, E22, 2 E12.

    Hyperelastic: J / sqrt(det C) with C the plane's, where J = 1 of an incompressible law and
    follows from S33 = 0 else.  Linear: sqrt(1 + 2 E33) with E33 = -(nu13/E1 S11 + nu23/E2 S22); of
    an orthotropic law that says nothing of the thickness (nu23 = nu31 = 0), isotropic around the
    fibre is assumed: nu13 = nu12 and nu23 = E2 / (2 G23) - 1.  Of a tension field its base law's,
    without the wrinkles.  NaN where the law has no answer.

    >>> import numpy as np
    >>> from fe_solver.materials.linear import Isotropic
    >>> from fe_solver.materials.section import thickness_stretch
    >>> pulled = np.array([0.02, -0.3 * 0.02, 0.0])  # free to contract across
    >>> float(thickness_stretch(Isotropic(1e6, 0.3), pulled).round(6))
    0.993982
    """
    strain = np.asarray(strain, dtype=float)
    match law:
        case TensionField():
            return thickness_stretch(law.base, law.elastic_strain(strain))
        case CrossedLinear():  # fibres in the plane leave S33 to the base
            return thickness_stretch(law.base, strain)
        case Isotropic():
            along = across = law.nu / np.asarray(law.E)
        case Orthotropic():
            along, across = _contraction(law)
        case Potential():
            plane = (1 + 2 * strain[..., 0]) * (1 + 2 * strain[..., 1]) - strain[..., 2] ** 2
            with np.errstate(divide="ignore", invalid="ignore"):
                return np.asarray(volume_ratio(law, strain) / np.sqrt(plane))
        case _:
            raise TypeError(f"no thickness of a {type(law).__name__}")
    stress = law.response(strain).stress
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(1 - 2 * (along * stress[..., 0] + across * stress[..., 1])))


def _contraction(law: Orthotropic) -> tuple[Array, Array]:
    """nu13/E1 and nu23/E2, 1/Pa."""
    E1, E2 = np.asarray(law.E1), np.asarray(law.E2)
    if np.any(law.nu23) or np.any(law.nu31):
        E3 = E2 if law.E3 is None else np.asarray(law.E3)
        return law.nu31 / E3, law.nu23 / E2
    return law.nu12 / E1, 1 / (2 * np.asarray(law.G23)) - 1 / E2
