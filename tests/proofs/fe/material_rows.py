"""The laws of `materials` against closed forms, differences and FEBio, as rows of the table."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product

import numpy as np

from fe_solver.materials.fibres import HolzapfelGasserOgden, TransIsoMooneyRivlin
from fe_solver.materials.hyperelastic import NeoHookean, Potential
from fe_solver.materials.linear import Isotropic, Law, Orthotropic
from fe_solver.materials.tension_field import TensionField
from tests.helpers.rows import Row
from tests.proofs.fe import febio_rows
from tests.proofs.fe.material_points import (
    axes,
    cauchy,
    differences,
    fibre_tension,
    least_energy,
    least_wrinkled_energy,
    pull_uniaxially,
    relaxed_energy,
    rotate,
    strains,
    strip_stress,
    uniaxial,
)

MPA = 1e6
SMOOTH = 1e-2
"""Strain by which tension fields are smoothed for differences over 1e-6 to be exact."""
ROUNDED = 1e-4
"""Relative tolerance against a tension field without smoothing."""
CLOSED = 1e-9
"""Relative tolerance against a closed form: the in-plane solve and rounding."""
ISOTROPIC = Isotropic(100 * MPA, 0.4)
ORTHOTROPIC = Orthotropic(150 * MPA, 20 * MPA, 0.3, 8 * MPA, 8 * MPA, 5 * MPA)
ACROSS = Orthotropic.transversely_isotropic(150 * MPA, 20 * MPA, 0.3, 8 * MPA, 0.4)
RUBBER = NeoHookean(100 * MPA, 0.4)
TENDON = TransIsoMooneyRivlin(2 * MPA, 0.7 * MPA, 0.5 * MPA, 60.0, 900 * MPA, 1.03)
SOFT_TENDON = TransIsoMooneyRivlin(2 * MPA, 0.7 * MPA, 0.5 * MPA, 60.0, 900 * MPA, 1.03, 200 * MPA)
ARTERY = HolzapfelGasserOgden(0.08 * MPA, 0.9 * MPA, 5.0, 0.1, 0.6)
SOFT_ARTERY = HolzapfelGasserOgden(0.08 * MPA, 0.9 * MPA, 5.0, 0.1, 0.6, 10 * MPA)
LAWS: dict[str, Law] = {
    "isotropic": ISOTROPIC,
    "orthotropic": ORTHOTROPIC,
    "transversely isotropic": ACROSS,
    "neo-Hookean": RUBBER,
    "trans iso Mooney-Rivlin, incompressible": TENDON,
    "trans iso Mooney-Rivlin, k = 200 MPa": SOFT_TENDON,
    "Holzapfel-Gasser-Ogden, incompressible": ARTERY,
    "Holzapfel-Gasser-Ogden, k = 10 MPa": SOFT_ARTERY,
    "tension field, isotropic": TensionField(ISOTROPIC, SMOOTH),
    "tension field, orthotropic": TensionField(ORTHOTROPIC, SMOOTH),
    "tension field, neo-Hookean": TensionField(RUBBER, SMOOTH),
    "tension field, trans iso Mooney-Rivlin": TensionField(TENDON, SMOOTH),
    "tension field, Holzapfel-Gasser-Ogden": TensionField(ARTERY, SMOOTH),
}


def _consistency() -> Iterator[Row]:
    points = strains(200)
    for name, law in LAWS.items():
        tangent, stress = differences(law, points)
        source = "central differences, 200 strains"
        yield Row(name, "tangent vs differences", 1e-6, tangent, 0.0, source, "bound")
        yield Row(name, "stress vs differences of energy", 1e-6, stress, 0.0, source, "bound")
    for solid in (RUBBER, SOFT_TENDON, SOFT_ARTERY):
        ours = solid.response(points[:20]).energy
        least = np.array([least_energy(solid, e) for e in points[:20]])
        error = float(np.abs(ours - least).max() / least.max())
        source = "least of the three-dimensional energy over the thickness stretch, 20 strains"
        name = next(n for n, law in LAWS.items() if law is solid)
        yield Row(name, "energy at S33 = 0", 1e-9, error, 0.0, source, "bound")


def _closed_form(name: str, quantity: str, target: float, computed: float, source: str) -> Row:
    return Row(name, quantity, target, float(computed), CLOSED, source)


def _linear() -> Iterator[Row]:
    e = 0.1
    for name, law in (("orthotropic", ORTHOTROPIC), ("transversely isotropic", ACROSS)):
        E1, E2, nu, G = (float(x) for x in (law.E1, law.E2, law.nu12, law.G12))
        yield _closed_form(
            name, "S11, strip along, Pa", E1 * e, pull_uniaxially(law, e)[1][0], "E1 E11"
        )
        across = pull_uniaxially(law, e, math.pi / 2)[1][0]
        yield _closed_form(name, "S11, strip across, Pa", E2 * e, across, "E2 E11")
        E45 = 4 / (1 / E1 + 1 / E2 + 1 / G - 2 * nu / E1)
        source = "4 / E45 = 1/E1 + 1/E2 + 1/G12 - 2 nu12/E1 (rotated compliance)"
        yield _closed_form(
            name,
            "S11, strip at 45 deg, Pa",
            E45 * e,
            pull_uniaxially(law, e, math.pi / 4)[1][0],
            source,
        )
        S = law.response(np.array([e, 0.0, 0.0])).stress
        source = "E1 E11 / (1 - nu12 nu21)"
        yield _closed_form(
            name, "S11, strip-biaxial, Pa", E1 * e / (1 - nu**2 * E2 / E1), S[0], source
        )
        S = law.response(np.array([0.0, 0.0, e])).stress
        yield _closed_form(name, "S12, shear, Pa", G * e, S[2], "G12 2 E12")
    E, nu, name = float(ISOTROPIC.E), float(ISOTROPIC.nu), "isotropic"
    for degrees in (0, 45):
        S = pull_uniaxially(ISOTROPIC, e, math.radians(degrees))[1]
        yield _closed_form(name, f"S11, uniaxial, axes at {degrees} deg, Pa", E * e, S[0], "E E11")
    S = ISOTROPIC.response(np.array([e, 0.0, e])).stress
    yield _closed_form(
        name, "S11, strip-biaxial, Pa", E * e / (1 - nu**2), S[0], "E E11 / (1 - nu^2)"
    )
    yield _closed_form(name, "S12, shear, Pa", E * e / (2 + 2 * nu), S[2], "E 2 E12 / 2 (1 + nu)")


def _rubber() -> Iterator[Row]:
    lam, mu = (float(x) for x in RUBBER.lame())
    name, thin = "neo-Hookean", 0.97
    J = math.exp(mu * (1 - thin**2) / lam)
    source = "sigma = (mu (lambda^2 - 1) + lambda_L ln J) / J, with 0 across: J from the thinning"
    stretch = J / thin**2
    target = (mu * (stretch**2 - 1) + lam * math.log(J)) / J
    for degrees in (0, 45, 90):
        stress, volume, lateral = uniaxial(RUBBER, stretch, math.radians(degrees))
        yield _closed_form(
            name, f"Cauchy, uniaxial, axes at {degrees} deg, Pa", target, stress, source
        )
    yield _closed_form(name, "J, uniaxial", J, volume, source)
    yield _closed_form(name, "stretch across, uniaxial", thin, lateral, source)
    stretch = J / thin
    sigma = cauchy(RUBBER, np.diag([stretch, 1.0]), 0.3)
    target = (mu * (stretch**2 - 1) + lam * math.log(J)) / J
    yield _closed_form(name, "Cauchy along, strip-biaxial, Pa", target, sigma[0, 0], source)
    held = lam * math.log(J) / J
    yield _closed_form(name, "Cauchy across, strip-biaxial, Pa", held, sigma[1, 1], source)
    sigma = cauchy(RUBBER, np.array([[1.0, 0.3], [0.0, 1.0]]), 0.3)
    yield _closed_form(
        name, "Cauchy shear, simple shear 0.3, Pa", mu * 0.3, sigma[0, 1], "mu (b - 1)"
    )
    yield _closed_form(
        name, "Cauchy along, simple shear 0.3, Pa", mu * 0.09, sigma[0, 0], "mu (b - 1)"
    )


def _tendon() -> Iterator[Row]:
    law, name = TENDON, "trans iso Mooney-Rivlin, incompressible"
    c1, c2 = float(law.c1), float(law.c2)
    source = "sigma = 2 (s^2 - 1/s) (c1 + c2/s) + s dF/ds (Weiss et al. 1996)"
    for s in (0.9, 1.02, 1.06):
        target = 2 * (s**2 - 1 / s) * (c1 + c2 / s) + fibre_tension(law, s)
        yield _closed_form(
            name, f"Cauchy, along, stretch {s}, Pa", target, uniaxial(law, s)[0], source
        )
    source = "sigma = 2 (s^2 - 1/s) (c1 + c2/s): a fibre that is shortened bears nothing"
    for s in (1.02, 1.06):
        target = 2 * (s**2 - 1 / s) * (c1 + c2 / s)
        across = uniaxial(law, s, math.pi / 2)[0]
        yield _closed_form(name, f"Cauchy, strip across, stretch {s}, Pa", target, across, source)
    source = "2 (c1 + c2) (s^2 - s^-2) + l dF/dl m1^2, m the fibre's direction"
    for s, degrees in product((1.02, 1.06), (0, 45, 90)):
        angle = math.radians(degrees)
        F = np.diag([s, 1.0])
        m = F @ np.array([math.cos(angle), math.sin(angle)])
        fibre = fibre_tension(law, math.hypot(*m)) * np.outer(m, m) / (m @ m)
        sigma = cauchy(law, F, angle)
        along = 2 * (c1 + c2) * (s**2 - s**-2) + fibre[0, 0]
        across = 2 * (c1 + c2 * s**2) * (1 - s**-2) + fibre[1, 1]
        where = f"strip-biaxial {s}, fibre at {degrees} deg, Pa"
        yield _closed_form(name, f"Cauchy along, {where}", along, sigma[0, 0], source)
        yield _closed_form(name, f"Cauchy across, {where}", across, sigma[1, 1], source)
    g, source = 0.3, "2 (c1 + c2) g (+ l dF/dl m1 m2 where the fibre is stretched)"
    sigma = cauchy(law, np.array([[1.0, g], [0.0, 1.0]]))
    yield _closed_form(
        name, "Cauchy, shear along the fibre, Pa", 2 * (c1 + c2) * g, sigma[0, 1], source
    )
    sigma = cauchy(law, np.array([[1.0, 0.0], [g, 1.0]]))
    target = 2 * (c1 + c2) * g + fibre_tension(law, math.hypot(1, g)) * g / (1 + g * g)
    yield _closed_form(name, "Cauchy, shear across the fibre, Pa", target, sigma[0, 1], source)


STRIPS: dict[str, Potential] = {
    "trans iso Mooney-Rivlin, k = 200 MPa": SOFT_TENDON,
    "Holzapfel-Gasser-Ogden, k = 10 MPa": SOFT_ARTERY,
}


def _strips() -> Iterator[Row]:
    """Free strips at any angle to the fibre, those without a closed form too."""
    source = "dW/dE of the least three-dimensional energy W(E) of a strip free across and in shear"
    for (name, law), degrees in product(STRIPS.items(), (0, 45, 90)):
        angle, strain = math.radians(degrees), (1.05**2 - 1) / 2
        target = strip_stress(law, strain, angle)
        what = f"S11, strip at {degrees} deg, stretch 1.05, Pa"
        yield Row(
            name, what, target, float(pull_uniaxially(law, strain, angle)[1][0]), 1e-6, source
        )


def _artery() -> Iterator[Row]:
    law, name = ARTERY, "Holzapfel-Gasser-Ogden, incompressible"
    c, k1, k2, kappa = (float(x) for x in (law.c, law.k1, law.k2, law.kappa))
    cos, sin = math.cos(float(law.gamma)), math.sin(float(law.gamma))

    def pull(E: float) -> float:
        return 0.0 if E < 0 else k1 * E * math.exp(k2 * E * E)

    source = "dW/ds of W(I1(s), I4(s)) (Gasser, Ogden and Holzapfel 2006)"
    s = 1.15
    E = kappa * (s**2 + s**-2 - 2) + (1 - 3 * kappa) * (s * s * cos * cos + sin * sin - 1)
    by_s = kappa * 2 * (s - s**-3) + (1 - 3 * kappa) * 2 * s * cos * cos
    target = s * (c * (s - s**-3) + 2 * pull(E) * by_s)
    sigma = cauchy(law, np.diag([s, 1.0]))[0, 0]
    yield _closed_form(name, f"Cauchy along, strip-biaxial {s}, Pa", target, sigma, source)
    g, target = 0.3, 0.0
    for sc in (sin * cos, -sin * cos):
        E = kappa * g * g + (1 - 3 * kappa) * (2 * sc * g + sin * sin * g * g)
        target += pull(E) * (kappa * 2 * g + (1 - 3 * kappa) * (2 * sc + 2 * sin * sin * g))
    sigma = cauchy(law, np.array([[1.0, g], [0.0, 1.0]]))[0, 1]
    yield _closed_form(name, "Cauchy, simple shear 0.3, Pa", target + c * g, sigma, source)
    aligned = HolzapfelGasserOgden(c, k1, k2, kappa, 0.0)
    E = kappa * (s**2 + 2 / s - 3) + (1 - 3 * kappa) * (s * s - 1)
    by_s = kappa * 2 * (s - s**-2) + (1 - 3 * kappa) * 2 * s
    target = s * (c * (s - s**-2) + 2 * pull(E) * by_s)
    sigma = uniaxial(aligned, s)[0]
    yield _closed_form(name, f"Cauchy along aligned fibres, stretch {s}, Pa", target, sigma, source)
    # Both families shortened and undispersed: across them only the matrix bears.
    matrix = HolzapfelGasserOgden(c, k1, k2, 0.0, 0.0)
    sigma, target = uniaxial(matrix, s, math.pi / 2)[0], c * (s**2 - 1 / s)
    yield _closed_form(name, f"Cauchy across, stretch {s}, Pa", target, sigma, "c (s^2 - 1/s)")


def _relax() -> Iterator[Row]:
    name, E, nu = "tension field, isotropic", float(ISOTROPIC.E), float(ISOTROPIC.nu)
    law = TensionField(ISOTROPIC)
    R = axes(0.4)
    for state, e2, along, across in (
        ("wrinkled", -0.3, E * 0.1, 0.0),
        ("taut", 0.05, E * (0.1 + nu * 0.05) / (1 - nu**2), E * (0.05 + nu * 0.1) / (1 - nu**2)),
    ):
        S = rotate(law, np.array([0.1, e2, 0.0]), R)[0]
        source = "Pipkin 1986: E e1 where e2 < -nu e1, else the full law"
        yield Row(name, f"S11, {state}, Pa", along, float(S[0]), ROUNDED, source)
        yield Row(name, f"S22 / E, {state}", across / E, S[1] / E, ROUNDED, source, "absolute")
    slack = float(law.response(np.array([-0.1, -0.02, 0.03])).energy) / E
    yield Row(name, "energy / E, slack", 0.0, slack, 1e-8, "Pipkin 1986", "absolute")
    points = strains(60, 0.2) * [1.0, 3.0, 3.0] - [0.0, 0.1, 0.1]
    ours = TensionField(ORTHOTROPIC).response(points).energy
    brute = np.array([relaxed_energy(ORTHOTROPIC, e) for e in points])
    error = float(np.abs(ours - brute).max() / brute.max())
    source = "best of 20 001 directions, 60 strains"
    yield Row("tension field, orthotropic", "energy", 1e-6, error, 0.0, source, "bound")
    for name, base in (("neo-Hookean", RUBBER), ("Mooney-Rivlin", TENDON), ("Gasser", ARTERY)):
        ours = TensionField(base).response(points[:5]).energy
        least = np.array([least_wrinkled_energy(base, e) for e in points[:5]])
        error = float(np.abs(ours - least).max() / least.max())
        source = "least of W(E + P) over P >= 0 by Nelder and Mead, 5 strains"
        yield Row(f"tension field, {name}", "energy", 1e-6, error, 0.0, source, "bound")


def rows() -> Iterator[Row]:
    """Rows on the material laws."""
    yield from _consistency()
    yield from _linear()
    yield from _rubber()
    yield from _tendon()
    yield from _artery()
    yield from _strips()
    yield from _relax()
    yield from febio_rows.rows()
