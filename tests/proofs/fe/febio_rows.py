"""FEBio's transversely isotropic law against the stresses of FEBio itself."""

from __future__ import annotations

import math
from collections.abc import Iterator

from fe_solver.materials.fibres import TransIsoMooneyRivlin
from tests.helpers.rows import Row
from tests.proofs.fe.material_points import fibre_tension, uniaxial

MPA = 1e6
FEBIO_STRESS: dict[float, dict[float, tuple[float, float, float]]] = {
    200: {
        1.01: (0.5116101, 1.00085378, -0.00453813),
        1.03: (2.5967993, 1.00435631, -0.01252685),
        1.06: (19.0775802, 1.03340386, -0.01262504),
    },
    2000: {
        1.01: (0.5290391, 1.00008818, -0.00491894),
        1.03: (2.8521239, 1.00047569, -0.01443639),
        1.06: (28.5681412, 1.00479565, -0.02638795),
    },
    20000: {
        1.01: (0.5308601, 1.00000885, -0.00495841),
        1.03: (2.8816009, 1.00004803, -0.01464707),
        1.06: (30.0689933, 1.00050153, -0.02847061),
    },
}
"""Bulk modulus (MPa), stretch: Cauchy stress (MPa), J and lateral displacement of a unit square."""
FEBIO_ACROSS = {200: 0.7148882, 2000: 0.7202179}
"""Bulk modulus (MPa): Cauchy stress (MPa) across the fibre at a stretch of 1.06."""
FEBIO_LIMIT = ((1.01, 0.531, 5e-4), (1.03, 2.885, 5e-4), (1.06, 30.25, 5e-3))
"""Stretch; Cauchy stress (MPa) of the incompressible law as given beside FEBio's figures; half of
its last digit."""


def febio_law(k: float) -> TransIsoMooneyRivlin:
    """The one of FEBio's figures; k in MPa."""
    return TransIsoMooneyRivlin(2 * MPA, 0.0, 0.5 * MPA, 60.0, 900 * MPA, 1.03, k * MPA)


def _incompressible() -> Iterator[Row]:
    stiff, law = febio_law(math.inf), "FEBio's law, incompressible"
    c1, across = float(stiff.c1), uniaxial(stiff, 1.06, math.pi / 2)[0] / MPA
    exact = "2 c1 (s^2 - 1/s) + s dF/ds (Weiss et al. 1996)"
    given = "the closed form as given beside FEBio's figures, to its three to five digits"
    for s, rounded, digit in FEBIO_LIMIT:
        sigma, what = uniaxial(stiff, s)[0] / MPA, f"Cauchy stress, stretch {s}, MPa"
        target = (2 * c1 * (s**2 - 1 / s) + fibre_tension(stiff, s)) / MPA
        yield Row(law, what, target, sigma, 1e-6, exact)
        yield Row(law, f"{what}, as given", rounded, sigma, digit, given, "absolute")
    what, target = "Cauchy stress across, stretch 1.06, MPa", 2 * c1 * (1.06**2 - 1 / 1.06) / MPA
    yield Row(law, what, target, across, 1e-6, exact)
    yield Row(law, f"{what}, as given", 0.72081, across, 1e-5, given, "absolute")


def rows() -> Iterator[Row]:
    """Yield the rows of one element, by bulk modulus and stretch, and of the incompressible
    sheet."""
    source = "FEBio 4.11, one shell element, `trans iso Mooney-Rivlin`"
    for k, table in FEBIO_STRESS.items():
        for stretch, (stress, volume, lateral) in table.items():
            sigma, J, across = uniaxial(febio_law(k), stretch)
            name = f"FEBio's law, K = {k:g} MPa, stretch {stretch}"
            yield Row(name, "Cauchy stress, MPa", stress, sigma / MPA, 1e-6, source)
            yield Row(name, "J", volume, J, 1e-6, source)
            yield Row(name, "lateral displacement", lateral, across - 1, 1e-6, source)
    for k, stress in FEBIO_ACROSS.items():
        sigma = uniaxial(febio_law(k), 1.06, math.pi / 2)[0]
        name = f"FEBio's law, K = {k:g} MPa, stretch 1.06"
        yield Row(name, "Cauchy stress across, MPa", stress, sigma / MPA, 1e-6, source)
    yield from _incompressible()
