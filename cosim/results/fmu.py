"""From the equilibria of a finger in an FMU to a result."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.build.double_count import counted_twice
from cosim.case.file import resolved_toml
from cosim.case.schema import Case
from cosim.fmu.finger import FmuFinger, Met
from cosim.port import Array, Progress
from cosim.results.audit import missed_bounds
from cosim.results.conventions import COMPONENTS, IN_METACARPAL
from cosim.results.load_and_rest import rest_block, rest_warnings
from cosim.results.parts import LedgerRow, Scene
from cosim.results.result import Result
from cosim.solve.fmu import Settled, settled
from cosim.version import __version__

if TYPE_CHECKING:
    import xarray


OPEN = "the FMU's own: tendons, joints, limits"
"""What no ledger of a finger in an FMU holds."""


def settled_result(case: Case, progress: Progress) -> Result:
    """Solve and summarise.  Raises InputError and ConvergenceError."""
    started = time.perf_counter()
    progress("building the models")
    found = settled(case, progress)
    rows = [row for name, state in found.states.items() for row in _ledger(found, name, state)]
    scene = _scene(case, found.states["loaded"])
    wall = time.perf_counter() - started
    return Result(
        _summary(case, found, wall),
        _dataset(found),
        tuple(rows),
        scene,
        resolved_toml(case),
        case.name,
    )


def _summary(case: Case, found: Settled, wall: float) -> dict[str, Any]:
    """As that of any equilibrium, so far as a unit tells it; every key ends in its unit."""
    now = found.states["loaded"]
    force, moment = now.response.load.imbalance(now.motion)
    audit = {"hood_force_balance": force, "hood_moment_balance": moment}
    loaded, unloaded = (_state(found, found.states[name]) for name in ("loaded", "unloaded"))
    rest = rest_block(loaded, unloaded, found.hood.tendons)
    change = np.subtract(loaded["fingertip_force_N"], unloaded["fingertip_force_N"])
    out = {
        "case": case.name,
        "version": __version__,
        "converged": True,
        "wall_s": round(wall, 4),
        **loaded,
        "unloaded": unloaded,
        "rest": rest,
        "warnings": rest_warnings(rest, unloaded, is_laid=False),
        "difference": {
            "fingertip_force_N": change.tolist(),
            "fingertip_magnitude_N": float(np.linalg.norm(change)),
        },
        "audit": {**audit, "last_turn_rad": now.turn},
        "audit_missed": missed_bounds(audit),
        "not_in_ledger": OPEN,
        "iterations": {"coupling": now.rounds},
    }
    twice = counted_twice(found.hood.sources, found.hood.tendons, found.finger.tendons)
    return out | ({"double_counted": [str(pair) for pair in twice]} if twice else {})


def _state(found: Settled, at: Met) -> dict[str, Any]:
    finger, hood = found.finger, found.hood
    force = IN_METACARPAL @ at.finger.tip_force
    phalanx = IN_METACARPAL @ at.motion.rotation[-1].T @ at.finger.tip_force
    out: dict[str, Any] = {
        "posture_deg": _by_joint(finger, np.rad2deg(at.finger.angles)),
        "tension_N": dict(
            zip((*hood.tendons, *finger.tendons), np.concatenate(at.tension).tolist(), strict=True)
        ),
        "excursion_mm": dict(zip(hood.tendons, 1e3 * at.response.excursion, strict=True)),
        "fingertip_force_N": force.tolist(),
        "fingertip_force_in_phalanx_N": phalanx.tolist(),
        "fingertip_magnitude_N": float(np.linalg.norm(force)),
    }
    if finger.kinematics.tells_any:
        jacobian = finger.kinematics.jacobian(at.finger.angles)
        arms = 1e3 * jacobian.T @ at.jacobian.load_tension
        names = zip(hood.tendons, arms.T, strict=True)
        out["moment_arm_mm"] = {tendon: _by_joint(finger, arm) for tendon, arm in names}
    return out


def _by_joint(finger: FmuFinger, values: Array) -> dict[str, float]:
    return {j: float(v) for j, v in zip(finger.joints, values, strict=True)}


def _dataset(found: Settled) -> xarray.Dataset:
    """All arrays against the load axis `state`, SI units, under the names of any equilibrium."""
    import xarray

    finger, hood, each = found.finger, found.hood, list(found.states.values())
    loads = [at.response.load for at in each]
    fields: dict[str, tuple[tuple[str, ...], str, list[Array]]] = {
        "angle": (("joint",), "rad", [at.finger.angles for at in each]),
        "position": (("body", "axis"), "m", [at.motion.position for at in each]),
        "rotation": (("body", "axis", "body_axis"), "1", [at.motion.rotation for at in each]),
        "tension": (("tendon",), "N", [at.tension[0] for at in each]),
        "own_tension": (("muscle",), "N", [at.tension[1] for at in each]),
        "excursion": (("tendon",), "m", [at.response.excursion for at in each]),
        "wrench": (("body", "source", "component"), "N, N m", [load.wrench for load in loads]),
        "pull": (("tendon", "component"), "N, N m", [load.pull for load in loads]),
        "tip_force": (("axis",), "N", [at.finger.tip_force for at in each]),
    }
    data = {
        name: (("state", *dims), np.stack(values), {"units": unit})
        for name, (dims, unit, values) in fields.items()
    }
    coords: dict[str, Any] = {
        "state": list(found.states),
        "joint": list(finger.joints),
        "body": list(finger.bodies),
        "axis": ["x", "y", "z"],
        "body_axis": ["x", "y", "z"],
        "tendon": list(hood.tendons),
        "muscle": list(finger.tendons),
        "source": list(hood.sources),
        "component": list(COMPONENTS),
    }
    return xarray.Dataset(data, coords)


def _ledger(found: Settled, name: str, at: Met) -> list[LedgerRow]:
    """What the hood does to each body, and the world to the fingertip where its point is known."""
    rows = [
        LedgerRow(name, body, f"hood {source}", wrench[:3], wrench[3:])
        for body, wrenches in zip(found.finger.bodies, at.response.load.wrench, strict=True)
        for source, wrench in zip(found.hood.sources, wrenches, strict=True)
        if np.any(wrench)
    ]
    tip, held = at.finger.pose.tip, -at.finger.tip_force
    if tip is None or not held.any():
        return rows
    moment = np.cross(tip - at.finger.motion.position[-1], held)
    return [*rows, LedgerRow(name, found.finger.bodies[-1], "fingertip", held, moment)]


def _scene(case: Case, at: Met) -> Scene:
    """Bones as a line through the bodies' origins; the hood's cables, where it has any."""
    pose = at.finger.pose
    lines = {"bones": pose.line, **case.hood.lines(at.motion)}
    force = None if pose.tip is None else (pose.tip, at.finger.tip_force)
    return Scene(None, (), tuple(lines.items()), force)
