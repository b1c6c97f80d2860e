"""From a coupled motion to a result: the end in numbers, the history as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim import __version__
from cosim.build.double_count import pairs
from cosim.case.schema import Case
from cosim.coupling.motion import Frame, Moment
from cosim.fingers.kinds import held_by
from cosim.hoods.view import drawn
from cosim.port import Array
from cosim.results.air import air_data, air_end
from cosim.results.audit import missed_bounds
from cosim.results.conventions import COMPONENTS, IN_METACARPAL
from cosim.results.data import LedgerRow, Result, Scene
from cosim.results.fmu import OPEN
from cosim.results.load_and_rest import NO_UNLOADED

if TYPE_CHECKING:
    import xarray

    from cosim.build.motion import Together


def motion_result(
    case: Case,
    t: Together,
    frames: Sequence[Frame],
    tips: Sequence[Array],
    end: Moment,
    wall: float,
) -> Result:
    """Everything that a coupled motion leaves behind; tips: (6,) N and N m of the fingertip on the
    world, for each frame."""
    return Result(
        _summary(case, t, frames, tips, end, wall),
        _dataset(t, frames, tips),
        tuple(_ledger(t, frames, tips)),
        _scene(t, end, tips[-1]),
    )


def _summary(
    case: Case,
    t: Together,
    frames: Sequence[Frame],
    tips: Sequence[Array],
    end: Moment,
    wall: float,
) -> dict[str, Any]:
    finger, hood, last = t.finger, t.hood, frames[-1]
    coupled, energy = end.coupled, end.coupled.energy
    force = IN_METACARPAL @ tips[-1][:3]
    audit = {
        "hood_force_balance": max(f.imbalance[0] for f in frames),
        "hood_moment_balance": max(f.imbalance[1] for f in frames),
    }
    gained = last.energy - frames[0].energy
    work = energy.tendons + energy.own
    stored = energy.tendons - energy.hood
    artificial = work - gained - stored - end.dissipated
    effort = max(energy.effort, 1e-12)
    steps = len(frames) - 1
    out: dict[str, Any] = {
        "case": case.name,
        "version": __version__,
        "converged": True,
        "wall_s": round(wall, 4),
        "fingertip_device": held_by(case.finger),
        "posture_deg": dict(zip(finger.joints, np.rad2deg(last.angles).tolist(), strict=True)),
        "last_rate_rad_per_s": float(np.abs(last.rates).max()),
        "tension_N": dict(
            zip((*hood.tendons, *finger.tendons), last.tension.tolist(), strict=True)
        ),
        "excursion_mm": dict(zip(hood.tendons, (1e3 * last.excursion).tolist(), strict=True)),
        "fingertip_force_N": force.tolist(),
        "fingertip_magnitude_N": float(np.linalg.norm(force)),
        "energy_mJ": {
            "tendons": 1e3 * energy.tendons,
            "own_tendons": 1e3 * energy.own,
            "finger": 1e3 * gained,
            "hood_stored": 1e3 * stored,
            "joints_dissipated": 1e3 * end.dissipated,
            "artificial": 1e3 * artificial,
        },
        "largest_interface_residual": max(f.residual for f in frames),
        "coupling_scheme": case.coupling.scheme,
        "audit": {**audit, "artificial_energy_over_effort": abs(artificial) / effort},
        "audit_missed": missed_bounds(audit),
        "rest": {"exempt": NO_UNLOADED},
        "iterations": {"steps": steps, "hood_solves": coupled.solves},
    }
    if case.forward is not None and case.forward.adaptive is not None:
        out["step_control"] = _steps(end, frames)
    if names := t.moves.driven.names:
        reached = 1e3 * (end.draw.found - end.draw.start)
        out["drawn_mm"] = dict(zip(names, reached.tolist(), strict=True))
    if not case.finger.is_native:
        out["not_in_ledger"] = OPEN
    if twice := [str(pair) for pair in pairs(case, hood, finger)]:
        out["double_counted"] = twice
    if lengths := t.pulls.lengths(end.puller):
        out["muscle"] = {
            name: {"normalised_fibre_length": length} for name, length in lengths.items()
        }
    if t.pulls.cylinders:
        out["air"] = air_end(t.pulls.cylinders, last.drive)
    return out


def _steps(end: Moment, frames: Sequence[Frame]) -> dict[str, Any]:
    """What became of steps whose length follows from their error, each of them two halves."""
    taken = np.diff([f.time for f in frames])
    return {
        "accepted": end.pace.accepted,
        "rejected": end.pace.rejected,
        "largest_error_deg": float(np.rad2deg(end.pace.error)),
        "shortest_half_ms": 1e3 * float(taken.min()),
        "longest_half_ms": 1e3 * float(taken.max()),
    }


def _dataset(t: Together, frames: Sequence[Frame], tips: Sequence[Array]) -> xarray.Dataset:
    import xarray

    finger, hood = t.finger, t.hood
    split = len(hood.tendons)

    def over_time(dims: tuple[str, ...], unit: str, values: list[Any], what: str) -> Any:
        return (("time", *dims), np.array(values), {"units": unit, "long_name": what})

    data = {
        "angle": over_time(("joint",), "rad", [f.angles for f in frames], "joint angle"),
        "rate": over_time(("joint",), "rad/s", [f.rates for f in frames], "joint rate"),
        "tension": over_time(("tendon",), "N", [f.tension[:split] for f in frames], "tension"),
        "own_tension": over_time(
            ("muscle",), "N", [f.tension[split:] for f in frames], "of the finger's tendons"
        ),
        "excursion": over_time(("tendon",), "m", [f.excursion for f in frames], "excursion"),
        "wrench": over_time(
            ("body", "source", "component"),
            "N, N m",
            [f.wrench for f in frames],
            "wrench of the hood about the body's origin, at the scheme's pose",
        ),
        "total": over_time(
            ("body", "component"), "N, N m", [f.total for f in frames], "of the hood at the pose"
        ),
        "tip_force": over_time(
            ("axis",), "N", [tip[:3] for tip in tips], "force of the tip on the world"
        ),
        "step": over_time(
            (), "s", np.diff([f.time for f in frames], prepend=0.0).tolist(), "that ended here"
        ),
        "residual": over_time((), "1", [f.residual for f in frames], "interface residual"),
        "finger_energy": over_time((), "J", [f.energy for f in frames], "energy of the finger"),
    }
    coords = {
        "time": ("time", [f.time for f in frames], {"units": "s"}),
        "joint": list(finger.joints),
        "tendon": list(hood.tendons),
        "muscle": list(finger.tendons),
        "body": list(hood.bodies),
        "source": list(hood.sources),
        "component": list(COMPONENTS),
        "axis": ["x", "y", "z"],
    }
    air, cylinders = air_data(t.pulls.cylinders, np.array([f.drive for f in frames]))
    return xarray.Dataset({**data, **air}, {**coords, **cylinders})


def _ledger(t: Together, frames: Sequence[Frame], tips: Sequence[Array]) -> list[LedgerRow]:
    """Every body's forces at every step, closing to zero with the joints' and inertia."""
    finger, sources = t.finger, t.hood.sources
    rows = []
    for before, now, tip in zip(frames, frames[1:], tips[1:], strict=False):
        split = len(t.hood.tendons)
        books = finger.ledger(
            (before.angles, before.rates),
            (now.angles, now.rates),
            now.time - before.time,
            now.total,
            now.tension[split:],
            tip,
        )
        by_source = {f"hood {s}": now.wrench[:, i] for i, s in enumerate(sources)}
        off = now.total - now.wrench.sum(axis=1)
        for b, body in enumerate(finger.bodies):
            for source, wrench in {**by_source, "hood linearisation": off, **books}.items():
                if np.any(wrench[b]):
                    label = f"{now.time:.9g} s"
                    rows.append(LedgerRow(label, body, source, wrench[b, :3], wrench[b, 3:]))
    return rows


def _scene(t: Together, end: Moment, tip: Array) -> Scene:
    finger = t.finger
    angles = finger.angles(end.coupled.finger)
    motion, point = finger.motion(angles), finger.tip(angles)
    bones = []
    for body, (vertices, faces) in t.bones.items():
        position, rotation = motion.of(body)
        bones.append((body, vertices @ rotation.T + position, faces))
    hood = drawn(t.view(end.coupled.hood)) if t.view else None
    lines = {**t.lines(motion), **finger.lines(angles)}
    force = None if point is None else (point, tip[:3])
    return Scene(hood, tuple(bones), tuple(lines.items()), force)
