"""The muscles of the index finger as the thesis states them.

Jadelis, "Index finger extensor hood mechanics ...", Table 2 (after Barry 2016): maximum isometric
force, optimal fibre length, tendon slack length and pennation angle.  What it does not state,
largest velocity, damping and activation dynamics, is OpenSim's default, and so are the curves.
It states neither a path nor a fibre length in a posture: see `millard.path_length`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cosim.errors import InputError
from cosim.port import Array
from rigid.muscle import curves
from rigid.muscle.millard import balance, pull
from rigid.muscle.parameters import DAMPED, Muscles

WITHOUT_DAMPING = replace(
    DAMPED,
    active=curves.active_force_length(minimum=0.1),
    velocity=curves.force_velocity(concentric=(0.125, 0.25), eccentric=(0.075, 0.15)),
)
"""The curves of OpenSim's muscle without damping over an elastic tendon: f_AL at least 0.1, and f_V
with half of its slopes near the largest velocities at them, so that each force has a velocity."""
TABLE_2 = {
    # N, m, m, degrees
    "FDP": (79.12, 0.075, 0.26812, 7.0),
    "FDS": (58.9, 0.084, 0.29932, 6.0),
    "FDIm": (72.8, 0.030, 0.02520, 15.0),
    "FDIl": (72.8, 0.033, 0.02569, 15.0),
    "EDC": (34.69, 0.070, 0.26468, 3.0),
    "FPI": (30.94, 0.031, 0.08978, 6.3),
    "EI": (35.47, 0.059, 0.18479, 6.0),
    "LUM": (25.04, 0.068, 0.05470, 1.2),
}


def index_muscles(*names: str, rigid_tendon: bool = False) -> Muscles:
    """Those `names` of Table 2 in that order; all eight without a name.

    Raises InputError for another name."""
    chosen = names or tuple(TABLE_2)
    for name in chosen:
        if name not in TABLE_2:
            raise InputError(f"muscle {name!r}: expected one of {', '.join(TABLE_2)}")
    force, fibre, slack, degrees = np.array([TABLE_2[name] for name in chosen]).T
    return Muscles(chosen, force, fibre, slack, np.deg2rad(degrees), rigid_tendon=rigid_tendon)


def activation_rate(muscles: Muscles, activation: Array, excitation: Array) -> Array:
    """1/s, d activation / dt (Thelen 2003, J Biomech Eng 125:70; as OpenSim's muscle): the time
    constant is t_a (0.5 + 1.5 a) rising, t_d / (0.5 + 1.5 a) falling."""
    a, u = muscles.effective(activation), muscles.effective(excitation)
    factor = 0.5 + 1.5 * a
    rise, fall = muscles.activation_time * factor, muscles.deactivation_time / factor
    return (u - a) / np.where(u > a, rise, fall)


def rigid_force(muscles: Muscles, activation: Array, path: Array, path_rate: Array) -> Array:
    """The tendon forces (..., n) N over a rigid tendon while the path lengthens at `path_rate`
    (m/s)."""
    s = np.maximum(path - muscles.tendon_slack_length, muscles.shortest_along)
    s, rate = np.broadcast_arrays(s, path_rate)
    length, raised = np.sqrt(s * s + muscles.scales.width2), muscles.effective(activation)
    at = balance(muscles, raised, path, s, length - rate * s / length, 1.0)
    return pull(muscles, at, s)[0]
