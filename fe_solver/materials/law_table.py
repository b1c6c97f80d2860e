"""The laws of a section as codes and numbers, as the compiled kernel takes them.

A law that is not one of ours has none; it answers by its own `response`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import expi

from cosim.port import Array, Ints
from fe_solver.materials import kernels
from fe_solver.materials.crossed_fibres import CrossedFibres, CrossedLinear
from fe_solver.materials.fibres import (
    DispersedFamily,
    ExponentialFamily,
    Family,
    HolzapfelGasserOgden,
    TransIsoMooneyRivlin,
)
from fe_solver.materials.hyperelastic import NeoHookean
from fe_solver.materials.linear import Isotropic, LinearLaw, Orthotropic, Real


class LawCode(NamedTuple):
    """A law as the kernel takes it."""

    matrix: int
    volume: int
    families: tuple[int, ...]
    numbers: dict[int, Real]
    """By their column."""


KNOWN = (
    Isotropic,
    Orthotropic,
    CrossedLinear,
    NeoHookean,
    TransIsoMooneyRivlin,
    HolzapfelGasserOgden,
    CrossedFibres,
)


def code_of(law: object) -> LawCode | None:
    """The code of a law that acts in the sheet; None for one that the kernel does not know, of a
    class derived from ours too, which may answer otherwise."""
    if type(law) not in KNOWN:
        return None
    match law:
        case CrossedLinear() if code_of(law.base) is None:
            return None
        case LinearLaw():
            return _linear(law)
        case NeoHookean():
            lam, mu = law.lame()
            numbers = {0: mu, kernels.BULK: lam}
            return LawCode(kernels.NEO_HOOKEAN, kernels.BY_LOGARITHM, (), numbers)
        case TransIsoMooneyRivlin():
            volume = kernels.INCOMPRESSIBLE if law.incompressible() else kernels.BY_LOGARITHM
            numbers = {0: law.c1, 1: law.c2, kernels.BULK: law.k}
            plain = LawCode(kernels.MOONEY_RIVLIN, volume, (), numbers)
            family = ExponentialFamily(law.c3, law.c4, law.c5, law.lam_max)
            return _with_family(plain, family, law.fibres()[0])
        case HolzapfelGasserOgden():
            volume = kernels.INCOMPRESSIBLE if law.incompressible() else kernels.BY_SQUARE
            numbers = {0: np.asarray(law.c) / 2, 1: 0.0, kernels.BULK: law.k}
            out = LawCode(kernels.MOONEY_RIVLIN, volume, (), numbers)
            for direction in law.fibres():
                out = _with_family(out, DispersedFamily(law.k1, law.k2, law.kappa), direction)
            return out
        case CrossedFibres(second=second):
            base = code_of(law.base)
            if base is not None and type(second) in (ExponentialFamily, DispersedFamily):
                return _with_family(base, second, law.fibres()[-1])
    return None


def _linear(law: LinearLaw) -> LawCode:
    Q = law.plane()
    places = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    numbers: dict[int, Real] = {column: Q[..., i, k] for column, (i, k) in enumerate(places)}
    return LawCode(kernels.LINEAR, kernels.INCOMPRESSIBLE, (), numbers)


def _with_family(law: LawCode, family: Family, direction: tuple[Real, Real, Real]) -> LawCode:
    """The code with one more fibre family."""
    match family:
        case ExponentialFamily():
            straight, kind = np.asarray(family.lam_max), kernels.EXPONENTIAL
            toe = family.tension(straight)[0], family.fibre_energy(straight)
            own = (*vars(family).values(), _scaled_expi(family.c4), *toe)
        case DispersedFamily():
            kind, own = kernels.DISPERSED, tuple(vars(family).values())
    first = kernels.FIBRES + kernels.PER_FAMILY * len(law.families)
    numbers = dict(enumerate((*direction, *own), first))
    return law._replace(families=(*law.families, kind), numbers=law.numbers | numbers)


def _scaled_expi(x: Real) -> Array:
    """The exponential integral Ei(x) of x > 0, times exp(-x)."""
    return np.asarray(np.exp(-np.asarray(x)) * expi(x))


class LawRows(NamedTuple):
    """Elements of one law and all that the kernel takes of it."""

    elements: Ints
    """(k,)."""
    acts: int
    """`kernels.LAYERED`, `kernels.RELAXED` or `kernels.ON_MIDDLE`."""
    code: LawCode
    more: dict[int, Array]
    """More numbers, by their column."""
    thickness: Array
    """(k, g) m."""
    shear: Array
    """(k, g) or such as broadcast: half the shear stiffness, negative without one."""
    factor: Array
    """(k, 1) or (1, 1)."""


class LawTable(NamedTuple):
    """See `kernels.respond`."""

    codes: Ints
    numbers: Array
    sheet: Array


def law_table(rows: Sequence[LawRows], count: int, points: int) -> LawTable:
    """The table of `count` elements with so many Gauss points; those of no row have the constant
    stiffness alone."""
    given = [v for row in rows for v in (*row.code.numbers.values(), *row.more.values())]
    each = points if any(np.ndim(v) and np.shape(v)[-1] > 1 for v in given) else 1
    codes = np.zeros((count, kernels.CODES), dtype=np.int64)
    numbers = np.zeros((count, each, kernels.NUMBERS))
    sheet = np.zeros((count, points, 3))
    for row in rows:
        families = row.code.families
        code = (row.acts, row.code.matrix, row.code.volume, *families)
        codes[row.elements, : len(code)] = code
        for column, value in (row.code.numbers | row.more).items():
            numbers[row.elements, :, column] = value
        for column, value in enumerate((row.thickness, row.shear, row.factor)):
            sheet[row.elements, :, column] = value
    return LawTable(codes, numbers, sheet)
