"""The muscle against the facts that define its curves, against differences, and against OpenSim."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec

import numpy as np

from cosim.port import Array
from rigid.muscle.curves import Curve
from rigid.muscle.dynamics import at_rest, fibre_velocity, step
from rigid.muscle.millard import equilibrium, path_length
from rigid.muscle.parameters import DAMPED
from tests.helpers.folders import TEST_DATA
from tests.helpers.rows import Row
from tests.proofs.fingers import opensim_reference
from tests.proofs.fingers.index_muscles import index_muscles

TABLE = TEST_DATA / "opensim" / "millard_opensim.npz"
MILLARD = "Millard, Uchida, Seth, Delp 2013, J Biomech Eng 135:021005"
DEFAULTS = "default parameters of OpenSim's curves"
FORCE_TOLERANCE = 1e-4
"""Tolerance as a share of F0; 0.5 % is what has to be met."""


def rows() -> Iterator[Row]:
    """All of them; those of a live OpenSim only where it is installed."""
    yield from curve_rows()
    yield from derivative_rows()
    yield from rest_rows()
    yield from table_rows()
    if find_spec("opensim") is not None:
        yield from live_rows()


def curve_rows() -> Iterator[Row]:
    """Values and slopes where the construction states them."""
    facts: dict[str, tuple[Curve, list[tuple[float, float, float]]]] = {
        "active force-length": (DAMPED.active, [(0.4441, 0, 0), (1, 1, 0), (1.8123, 0, 0)]),
        "passive force-length": (DAMPED.passive, [(1, 0, 0), (1.7, 1, 2 / 0.7)]),
        "force-velocity": (DAMPED.velocity, [(-1, 0, 0), (0, 1, 5), (1, 1.4, 0)]),
        "tendon force-length": (DAMPED.tendon, [(1, 0, 0), (1.049, 1, 1.375 / 0.049)]),
    }
    for name, (curve, points) in facts.items():
        for x, value, slope in points:
            y, dy, _ = curve.evaluate(np.array(x))
            yield Row(name, f"at {x:g}", value, float(y), 1e-12, DEFAULTS, "absolute")
            yield Row(name, f"slope at {x:g}", slope, float(dy), 1e-10, DEFAULTS, "absolute")
        jump = curvature_jump(curve)
        yield Row(name, "jump of curvature at the knots", 0.0, jump, 1e-9, MILLARD, "absolute")


def curvature_jump(curve: Curve) -> float:
    """Largest difference of the second derivatives on both sides of a knot, over the curve's
    largest."""
    inner = curve.knots[0, 1:-1]
    sides = [curve.evaluate(np.nextafter(inner, way))[2] for way in (-np.inf, np.inf)]
    largest = np.abs(curve.evaluate(np.linspace(*curve.domain, 2001))[2]).max()
    return float(np.abs(sides[1] - sides[0]).max() / largest)


def derivative_rows() -> Iterator[Row]:
    """dF/dL and dF/da of the isometric equilibrium against central differences."""
    muscles = index_muscles()
    activation = np.linspace(0.05, 0.95, 10)[:, None, None]
    path = path_length(muscles, np.linspace(0.6, 1.5, 19)[:, None], activation)
    at = equilibrium(muscles, activation, path)
    small = 1e-5
    move = small * muscles.optimal_fibre_length

    def share(by: float, along: float) -> Array:
        shifted = equilibrium(muscles, activation + by * small, path + along * move)
        return np.asarray(shifted.force / muscles.max_force)

    by_length = (share(0, 1) - share(0, -1)) / (2 * small)
    by_activation = (share(1, 0) - share(-1, 0)) / (2 * small)
    stiffness = at.stiffness * muscles.optimal_fibre_length / muscles.max_force
    for name, gap in [
        ("largest error of dF/dL l_opt / F0", stiffness - by_length),
        ("largest error of dF/da / F0", at.gain / muscles.max_force - by_activation),
    ]:
        worst = float(np.abs(gap).max())
        yield Row("isometric muscle", name, 0.0, worst, 1e-6, "central differences", "absolute")


def rest_rows() -> Iterator[Row]:
    """A muscle that is stepped until it rests has the isometric equilibrium's force."""
    muscles = index_muscles()
    path = path_length(muscles, 1.0, 0.01)
    state = at_rest(muscles, 0.01, path)
    excitation = np.full(len(muscles.names), 0.5)
    for _ in range(2000):
        state, force, _ = step(muscles, state, excitation, path, 1e-3)
    gap = np.abs(force - equilibrium(muscles, 0.5, path).force) / muscles.max_force
    source = "isometric equilibrium"
    name = "2 s at 1 ms, force less the equilibrium's, F0"
    yield Row("muscle stepped to rest", name, 0.0, float(gap.max()), 1e-9, source, "absolute")


def table_rows() -> Iterator[Row]:
    """Against the committed table: tendon force over 11 activations x 41 path lengths for each
    muscle, and fibre velocities in random states of motion."""
    muscles = index_muscles()
    with np.load(TABLE) as table:
        at = equilibrium(muscles, table["activation"][:, None, None], table["path"])
        gap = np.abs(at.force - table["force"]) / muscles.max_force
        velocity = velocity_gap(table["velocity"])
        source = str(table["provenance"]).split(",")[0] + ", committed table"
    for name, worst in zip(muscles.names, gap.max(axis=(0, 1)), strict=True):
        yield force_row(name, float(worst), source)
    yield velocity_row(velocity, source)


def live_rows() -> Iterator[Row]:
    """Yield the rows of muscles against the installed OpenSim."""
    import opensim

    muscles = index_muscles()
    source = f"OpenSim {opensim.GetVersion()}, installed"
    reference, _ = opensim_reference.resting_table(muscles)
    activation = opensim_reference.ACTIVATIONS[:, None, None]
    at = equilibrium(muscles, activation, opensim_reference.path_lengths(muscles))
    gap = np.abs(at.force - reference) / muscles.max_force
    yield force_row("all muscles", float(gap.max()), source)
    yield velocity_row(velocity_gap(opensim_reference.velocity_table(muscles)), source)


def force_row(name: str, worst: float, source: str) -> Row:
    """The largest difference of tendon force over the grid, in F0."""
    quantity = "largest difference of tendon force, F0, 11 activations x 41 paths"
    return Row(f"isometric {name}", quantity, 0.0, worst, FORCE_TOLERANCE, source, "absolute")


def velocity_gap(reference: Array) -> float:
    """Largest difference of fibre velocity at `opensim_reference.motion_states`, in v_max l_opt."""
    muscles = index_muscles()
    ours = fibre_velocity(muscles, *opensim_reference.motion_states(muscles))
    scale = muscles.max_velocity * muscles.optimal_fibre_length
    return float((np.abs(ours - reference) / scale).max())


def velocity_row(worst: float, source: str) -> Row:
    """The largest difference of fibre velocity."""
    quantity = "largest difference of fibre velocity, v_max, 100 states x 8 muscles"
    return Row("muscle in motion", quantity, 0.0, worst, 1e-6, source, "absolute")
