"""Strips with two fibre families, and with fibres stretched in situ, against closed forms.

A netting strip has two families of equal fibres at +-theta from its length, in a matrix too soft to
matter.  Pulled along it to the stretch s, free across, it narrows to the stretch w at which the
fibres keep their length:

    s^2 cos^2 theta + w^2 sin^2 theta = 1.

Held to its width instead, its fibres are stretched by l, l^2 = s^2 cos^2 theta + sin^2 theta, and
with the energy F(l) of a family the first Piola-Kirchhoff stresses along and across are

    P1 = 2 F'(l) s cos^2 theta / l,    P2 = 2 F'(l) sin^2 theta / l.

A strip whose fibres lie along it and are stretched in situ by s bears, free across and before
anything moves, the uniaxial tension at s over the section as laid.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from fe_solver.forces.guides import Guides
from fe_solver.materials.crossed_fibres import CrossedFibres, CrossedLinear
from fe_solver.materials.fibres import (
    DispersedFamily,
    ExponentialFamily,
    HolzapfelGasserOgden,
    TransIsoMooneyRivlin,
)
from fe_solver.materials.linear import Law, Orthotropic
from fe_solver.sheet import even_sheet
from fe_solver.solver.model import ShellModel
from fe_solver.solver.newton import NewtonOptions, Solution, solve
from tests.helpers.rows import Row
from tests.proofs.fe.material_points import fibre_tension, uniaxial
from tests.proofs.fe.sheets import NO_TENSION, at_rest, plate

MPA = 1e6
LENGTH, WIDTH, THICKNESS = 3.0, 1.0, 0.01
THETA, STRETCH, IN_SITU = np.radians(35.0), 1.05, 1.02
NETTING = 0.01
"""Relative tolerance: what the matrix adds."""
CLOSED = 1e-6
TAUT = 0.95
"""Share of the netting strip's narrowing from which its solution is sought."""
TIGHT = NewtonOptions(tolerance=1e-7, max_iterations=100)
SOFT = 1e-3 * MPA
FIBRE = ExponentialFamily(2 * MPA, 40.0, 400 * MPA, 1.03)
LINEAR, K1, K2 = 100 * MPA, 10 * MPA, 3.0
TENDON = TransIsoMooneyRivlin(0.7 * MPA, 0.0, 0.5 * MPA, 60.0, 90 * MPA, 1.015)
STRAIGHT = Orthotropic.transversely_isotropic(100 * MPA, 2 * MPA, 0.4, 1 * MPA, 0.4)


def netting_laws() -> dict[str, tuple[Law, Callable[[float], float]]]:
    """By name, laws with two equal families 2 THETA apart, and F'(l) of one of them, Pa."""
    matrix = Orthotropic.transversely_isotropic(LINEAR, SOFT, 0.0, SOFT, 0.0)
    tendon = TransIsoMooneyRivlin(SOFT, 0.0, FIBRE.c3, FIBRE.c4, FIBRE.c5, FIBRE.lam_max)
    artery = HolzapfelGasserOgden(2 * SOFT, K1 / 2, K2, 0.0, 0.0)
    family = DispersedFamily(K1, K2, 0.0)

    def fibre_stress(x: float) -> float:
        return float(K1 * (x * x - 1) * np.exp(K2 * (x * x - 1) ** 2) * 2 * x)

    return {
        "linear": (
            CrossedLinear(matrix, LINEAR, 2 * THETA),
            lambda x: LINEAR * (x * x - 1) / 2 * x,
        ),
        "trans iso Mooney-Rivlin": (
            CrossedFibres(tendon, FIBRE, 2 * THETA),
            lambda x: fibre_tension(tendon, x) / x,
        ),
        "Holzapfel-Gasser-Ogden": (CrossedFibres(artery, family, 2 * THETA), fibre_stress),
    }


def strip(
    law: Law, fibre: float, stretch: float, *, held_across: bool = False, in_situ: float = 1.0
) -> tuple[float, float, float]:
    """Force along and across (N) and stretch across of a flat strip between grips that slide
    across, pulled to a stretch of its length; its first fibres at the angle `fibre` (rad) from the
    length.  Raises ConvergenceError."""
    X, quads = plate(LENGTH, WIDTH, 6, 2)
    laid = even_sheet(X, quads, law, THICKNESS, fibre=(np.cos(fibre), np.sin(fibre), 0.0))
    laid = replace(laid, parts=(replace(laid.parts[0], in_situ_stretch=in_situ),))
    model = laid.model(bodies=("ground", "grip"))
    low, side = np.isclose(X[:, 1], 0), np.isclose(X[:, 1], WIDTH)
    start, end = np.isclose(X[:, 0], 0), np.isclose(X[:, 0], LENGTH)
    held = np.column_stack([start | end, low | (side & held_across), np.ones(len(X), dtype=bool)])
    body, nodes = end.astype(np.intp), np.arange(len(X))
    model = replace(
        model, guides=Guides.on_body_axes(nodes, body, X, held), share=np.zeros((0, len(nodes)))
    )
    solution = _pull(model, stretch)
    force = solution.evaluation.gradient_x
    across = float(np.ptp(solution.configuration.x[end, 1])) / WIDTH
    return float(force[end, 0].sum()), float(force[side, 1].sum()), across


def _pull(model: ShellModel, stretch: float) -> Solution:
    """Equilibrium, sought from an even stretch with fibres a little longer than they are."""
    c = at_rest(model)
    across = 1 - TAUT * (1 - narrow(stretch))
    start = replace(c, x=c.x * [stretch, across, 1.0])
    position = np.array([[0.0, 0, 0], [(stretch - 1) * LENGTH, 0, 0]])
    return solve(model, model.move_bodies(start, position, c.rotation), NO_TENSION, TIGHT)


def narrow(stretch: float) -> float:
    """The netting strip's stretch across, its fibres as long as at rest."""
    return float(np.sqrt(1 - (stretch * np.cos(THETA)) ** 2) / np.sin(THETA))


def _netting() -> Iterator[Row]:
    cos, sin = np.cos(THETA), np.sin(THETA)
    fibre = float(np.hypot(STRETCH * cos, sin))
    for kind, (law, tension) in netting_laws().items():
        name = f"netting strip at +-35 deg, {kind}"
        across = strip(law, -THETA, STRETCH)[2]
        source = "fibres keep their length: s^2 cos^2 + w^2 sin^2 = 1"
        yield Row(name, f"stretch across at {STRETCH}", narrow(STRETCH), across, NETTING, source)
        along, wide, _ = strip(law, -THETA, STRETCH, held_across=True)
        source = "netting, held to its width: 2 F'(l) {} / l"
        for quantity, force, area, share, term in (
            ("along", along, WIDTH, STRETCH * cos**2, "s cos^2"),
            ("across", wide, LENGTH, sin**2, "sin^2"),
        ):
            target = 2 * tension(fibre) * share / fibre * area * THICKNESS
            what = f"force {quantity} at {STRETCH}, N"
            yield Row(name, what, float(target), force, NETTING, source.format(term))


def _in_situ() -> Iterator[Row]:
    s, section = IN_SITU, WIDTH * THICKNESS
    stretched = f"strip stretched in situ by {s}"
    source = "uniaxial Cauchy stress at s times the section as laid"
    along, _, across = strip(TENDON, 0.0, 1.0, in_situ=s)
    name = f"{stretched}, trans iso Mooney-Rivlin"
    target = uniaxial(TENDON, s)[0] * section
    yield Row(name, "force before anything moves, N", target, along, CLOSED, source)
    source = "isochoric: it is as wide as it was laid out"
    yield Row(name, "stretch across", 1.0, across, CLOSED, source)
    along, _, _ = strip(STRAIGHT, 0.0, 1.0, in_situ=s)
    target = s * float(STRAIGHT.E1) * (s * s - 1) / 2 * section * s
    source = "s E1 (s^2 - 1)/2 over the stress-free section, s times that as laid"
    yield Row(
        f"{stretched}, linear", "force before anything moves, N", target, along, CLOSED, source
    )


def rows() -> Iterator[Row]:
    """Rows on two fibre families and on fibres stretched in situ."""
    yield from _netting()
    yield from _in_situ()
