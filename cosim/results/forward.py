"""From a motion to a result: the end in numbers, the history as arrays and as a plot."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim import __version__
from cosim.build.models import drawn_bones
from cosim.case.schema import Case
from cosim.fingers.kinds import held_by
from cosim.port import Array, Load
from cosim.results.air import air_data, air_end
from cosim.results.audit import missed_bounds
from cosim.results.conventions import IN_METACARPAL
from cosim.results.data import LedgerRow, Result, Scene
from cosim.results.load_and_rest import NO_UNLOADED

if TYPE_CHECKING:
    import xarray

    from cosim.solve.forward import Moved


def forward_result(case: Case, moved: Moved, wall: float) -> Result:
    """Everything that a motion leaves behind."""
    finger, simulation = moved.finger, moved.simulation
    state = finger.start({})
    wrench = -np.concatenate([simulation.force[-1], simulation.moment[-1]])
    state = replace(state, angles=simulation.angles[-1], reaction=wrench)
    bodies = finger.bodies
    none = Load(bodies, ("hood",), np.zeros((len(bodies), 1, 6)), np.zeros((0, 6)))
    ledger = finger.ledger(state, none, simulation.tension[-1])
    rows = tuple(
        LedgerRow("end", body, source, wrench[b, :3], wrench[b, 3:])
        for b, body in enumerate(bodies)
        for source, wrench in ledger.items()
        if np.any(wrench[b])
    )
    motion = finger.motion(state)
    bones = []
    for body, (vertices, faces) in drawn_bones(case).items():
        position, rotation = motion.of(body)
        bones.append((body, vertices @ rotation.T + position, faces))
    tendons = tuple(finger.tendon_paths(state).items())
    scene = Scene(None, tuple(bones), tendons, (finger.tip(state), simulation.force[-1]))
    balance = finger.balance(state, none, simulation.tension[-1])
    gap = (
        balance.residual[: len(finger.joints)]
        + finger.law.viscous(simulation.angles[-1], simulation.rates[-1])[0]
    )
    imbalance = float(np.abs(gap).max() / balance.scale)
    return Result(_summary(case, moved, imbalance, wall), _dataset(moved), rows, scene)


def _summary(case: Case, moved: Moved, imbalance: float, wall: float) -> dict[str, Any]:
    s, finger, energy = moved.simulation, moved.finger, moved.simulation.energy
    force = IN_METACARPAL @ s.force[-1]
    audit = {"torque_balance_at_rest": imbalance} if s.at_rest else {}
    out: dict[str, Any] = {
        "case": case.name,
        "version": __version__,
        "converged": True,
        "wall_s": round(wall, 4),
        "fingertip_device": held_by(case.finger),
        "came_to_rest": s.at_rest,
        "last_rate_rad_per_s": s.last_rate,
        "last_force_change_N": s.last_change,
        "posture_deg": dict(zip(finger.joints, np.rad2deg(s.angles[-1]).tolist(), strict=True)),
        "tension_N": dict(zip(finger.tendons, s.tension[-1].tolist(), strict=True)),
        "fingertip_force_N": force.tolist(),
        "fingertip_magnitude_N": float(np.linalg.norm(force)),
        "fingertip_moment_Nmm": (1e3 * IN_METACARPAL @ s.moment[-1]).tolist(),
        "energy_mJ": {
            name: 1e3 * getattr(energy, name)
            for name in (
                *("tendons", "gravity", "kinetic", "joints_stored", "device_stored"),
                *("joints_dissipated", "device_dissipated", "artificial"),
            )
        },
        "audit": audit,
        "audit_missed": missed_bounds(audit),
        "rest": {"exempt": NO_UNLOADED},
        "steps": len(s.time) - 1,
    }
    if moved.normalised_length:
        out["muscle"] = {
            name: {
                "activation": case.tendons[name].activation,
                "normalised_fibre_length": length,
                "assumed_normalised_fibre_length_unloaded": _assumed(case, name),
            }
            for name, length in moved.normalised_length.items()
        }
    if moved.cylinders:
        out["air"] = air_end(moved.cylinders, moved.drive[-1])
    return out


def _assumed(case: Case, name: str) -> float | None:
    muscle = case.tendons[name].muscle
    return None if muscle is None else muscle.fibre_length


def _dataset(moved: Moved) -> xarray.Dataset:
    import xarray

    s, finger = moved.simulation, moved.finger

    def over_time(dim: str, unit: str, values: Array, what: str) -> Any:
        return (("time", dim), values, {"units": unit, "long_name": what})

    data = {
        "angle": over_time("joint", "rad", s.angles, "joint angle"),
        "rate": over_time("joint", "rad/s", s.rates, "joint rate"),
        "own_tension": over_time("muscle", "N", s.tension, "tension of the finger's tendons"),
        "tip_force": over_time("axis", "N", s.force, "force of the tip on the world"),
        "tip_moment": over_time("axis", "N m", s.moment, "its moment about the fingertip"),
    }
    coords = {
        "time": ("time", s.time, {"units": "s"}),
        "joint": list(finger.joints),
        "muscle": list(finger.tendons),
        "axis": ["x", "y", "z"],
    }
    air, cylinders = air_data(moved.cylinders, moved.drive)
    return xarray.Dataset({**data, **air}, {**coords, **cylinders})
