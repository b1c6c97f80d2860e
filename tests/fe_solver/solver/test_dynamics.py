"""Motion of the shell against closed forms: bars, beams, free flight, decay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cosim.errors import InputError
from fe_solver.materials.linear import Isotropic
from fe_solver.materials.section import one_law
from fe_solver.materials.tension_field import TensionField
from fe_solver.solver import dynamics
from fe_solver.solver.dynamics import Substance, Viscous, advance, kinetic_energy, masses
from fe_solver.solver.model import ShellModel
from fe_solver.solver.newton import NewtonOptions
from tests.helpers import shells
from tests.proofs.fe.sheets import NO_TENSION, at_rest, clamp, plate, sheet

MODULUS, THICKNESS, LENGTH = 1e6, 0.01, 1.0
STUFF = Substance(density=1000.0)
OPTIONS = NewtonOptions(tolerance=1e-9, max_step=1.0)


def strip(elements: int = 16) -> ShellModel:
    X, quads = plate(LENGTH, 0.1, elements, 1)
    return clamp(sheet(X, quads, MODULUS, 0.0, THICKNESS), np.flatnonzero(X[:, 0] == 0))


def swing(model, shape, axis, dt, steps, stuff=STUFF, damping=0.0) -> np.ndarray:
    """Tip displacement of a strip that starts displaced by `shape` (n,) along an axis."""
    c = at_rest(model)
    state = dynamics.at_rest(replace(c, x=c.x + np.outer(shape, np.eye(3)[axis])))
    force = -model.evaluate(state.configuration, NO_TENSION, False).gradient_x
    a = force / masses(model, stuff)[0][:, None]
    a[model.ties.node] = 0
    state = replace(state, acceleration=a)
    tip, out = np.argmax(model.reference[:, 0]), []
    for _ in range(steps):
        out.append(state.configuration.x[tip, axis] - model.reference[tip, axis])
        state = advance(model, state, NO_TENSION, dt, stuff, OPTIONS, damping)[0]
    return np.array(out)


def period(tip: np.ndarray, dt: float) -> float:
    """From the first two crossings of zero."""
    at = np.flatnonzero(np.diff(np.sign(tip)))[:2]
    cross = at + tip[at] / (tip[at] - tip[at + 1])
    return 2 * (cross[1] - cross[0]) * dt


def test_a_bar_rings_at_its_frequency():
    """Fixed and free: 4 L / c, c the bar's wave speed."""
    model = strip()
    exact = 4 * LENGTH / np.sqrt(MODULUS / STUFF.density)
    start = 1e-4 * np.sin(np.pi / 2 * model.reference[:, 0] / LENGTH)
    tip = swing(model, start, 0, exact / 80, 70)
    assert period(tip, exact / 80) == pytest.approx(exact, rel=2e-3)


def test_a_cantilever_swings_at_its_frequency():
    """Euler and Bernoulli: 3.516 sqrt(E I / (rho A L^4)) rad/s, by an initial parabola's quarter
    periods; shear and rotary inertia take less than 1e-3 at this slenderness."""
    model = strip(24)
    omega = 1.8751**2 * np.sqrt(MODULUS * THICKNESS**2 / 12 / STUFF.density) / LENGTH**2
    exact, b = 2 * np.pi / omega, 1.8751
    x = model.reference[:, 0] / LENGTH
    k = (np.cosh(b) + np.cos(b)) / (np.sinh(b) + np.sin(b))
    start = 1e-5 * (np.cosh(b * x) - np.cos(b * x) - k * (np.sinh(b * x) - np.sin(b * x)))
    c = at_rest(model)
    slope = 1e-5 * b * (np.sinh(b * x) + np.sin(b * x) - k * (np.cosh(b * x) - np.cos(b * x)))
    state = dynamics.at_rest(
        replace(
            c,
            x=c.x + np.outer(start, [0, 0, 1.0]),
            d=c.d - np.outer(slope, [1.0, 0, 0]),
        )
    )
    acceleration = -(omega**2) * np.outer(start, [0, 0, 1.0])
    state = replace(state, acceleration=acceleration, turning=omega**2 * np.outer(slope, [1, 0, 0]))
    tip, dt = [], exact / 80
    for _ in range(70):
        tip.append(state.configuration.x[-1, 2])
        state, _ = advance(model, state, NO_TENSION, dt, STUFF, OPTIONS)
    assert period(np.array(tip), dt) == pytest.approx(exact, rel=5e-3)


def test_a_free_sheet_flies_straight_and_keeps_its_energy():
    X, quads = plate(1.0, 0.5, 4, 2)
    model = sheet(X, quads, MODULUS, 0.3, THICKNESS)
    rng = np.random.default_rng(0)
    state = replace(dynamics.at_rest(at_rest(model)), velocity=0.1 * rng.normal(size=X.shape))
    mass = masses(model, STUFF)[0]
    momentum, energy = mass @ state.velocity, kinetic_energy(model, state, STUFF)
    assert mass.sum() == pytest.approx(STUFF.density * THICKNESS * 0.5)
    for _ in range(20):
        state, solution = advance(model, state, NO_TENSION, 2e-4, STUFF, OPTIONS)
    assert mass @ state.velocity == pytest.approx(momentum, abs=1e-9)
    elastic = model.evaluate(state.configuration, NO_TENSION, False).energy
    assert 0.01 * energy < elastic
    assert kinetic_energy(model, state, STUFF) + elastic == pytest.approx(energy, rel=0.02)
    assert solution.residual < 1e-6


def test_directors_that_turn_have_the_energy_of_a_plates_section():
    """rho h^3 / 12 times the area, whatever the mesh."""
    X, quads = plate(LENGTH, 0.1, 5, 2)
    model = sheet(X, quads, MODULUS, 0.0, THICKNESS)
    spin = np.tile([0.0, 3.0, 0.0], (len(X), 1))
    state = replace(dynamics.at_rest(at_rest(model)), spin=spin)
    inertia = STUFF.density * THICKNESS**3 / 12 * LENGTH * 0.1
    assert kinetic_energy(model, state, STUFF) == pytest.approx(inertia * 3.0**2 / 2)


def test_viscosity_makes_the_swing_decay():
    """Kelvin and Voigt's bar: the amplitude falls by exp(-pi omega eta / E) a period."""
    model = strip(8)
    exact = 4 * LENGTH / np.sqrt(MODULUS / STUFF.density)
    eta = 0.02 * MODULUS * exact / np.pi
    start = 1e-4 * np.sin(np.pi / 2 * model.reference[:, 0] / LENGTH)
    dt = exact / 160
    tip = swing(model, start, 0, dt, 181, replace(STUFF, viscosity=eta))
    loss = tip[120:].max() / tip[0]
    expected = np.exp(-np.pi * (2 * np.pi / exact) * eta / MODULUS)
    assert expected < 0.9
    assert loss == pytest.approx(expected, rel=0.02)


def test_a_section_with_a_damper_tells_of_its_tension_field():
    base = one_law(TensionField(Isotropic(1e6, 0.3)), np.full(2, 1e-3))
    strain = np.zeros((2, 4, 8))
    strain[..., 0] = [[0.01], [-0.01]]
    strain[..., 1] = -0.02
    damper = one_law(Isotropic(1e3, 0.0), np.full(2, 1e-3))
    viscous = Viscous(base, damper, strain)
    assert viscous.smoothing == base.smoothing
    assert viscous.with_smoothing(1e-3).smoothing == 1e-3
    assert list(viscous.tension_state(strain)) == list(base.tension_state(strain)) == [1, 2]


def test_numerical_damping_takes_energy_and_none_does_not():
    model = strip(8)
    period_ = 4 * LENGTH / np.sqrt(MODULUS / STUFF.density)
    start = 1e-4 * np.sin(np.pi / 2 * model.reference[:, 0] / LENGTH)
    free, damped = (swing(model, start, 0, period_ / 20, 42, damping=a) for a in (0.0, 0.2))
    assert free[30:].max() > 0.98 * start.max()
    assert damped[30:].max() < 0.9 * start.max()


@pytest.mark.parametrize(
    "make",
    [
        lambda: Substance(0.0),
        lambda: Substance(float("nan")),
        lambda: Substance(1.0, -1.0),
        lambda: advance(shells.index_hood().model, None, np.zeros(4), -1.0, STUFF, OPTIONS),
    ],
)
def test_bad_substances_and_steps_are_refused(make):
    with pytest.raises(InputError, match=r"density|viscosity|dt"):
        make()
