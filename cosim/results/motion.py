"""From a motion to a result: the end in numbers, the history as arrays."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from cosim.case.file import resolved_toml
from cosim.case.schema import Case
from cosim.coupling.checkpoint import MotionHistory
from cosim.coupling.motion import MotionFrame, MotionState
from cosim.fingers.kinds import tip_support_kind
from cosim.fmu.quantity import OPEN
from cosim.hoods.view import audit_of, field_of, hood_field
from cosim.models.double_count import pairs
from cosim.models.motion import MovingModels
from cosim.port import AXES, Array
from cosim.results.arrays import Arrays, along
from cosim.results.audit import HOOD_BALANCES, MOST_DAMPING, missed_bounds
from cosim.results.conventions import attributes, by_axis, by_name
from cosim.results.give_way import event_arrays, events_block
from cosim.results.joint_limits import is_in_range, joints_ever_at_limit, limits_of, tie_block
from cosim.results.load_and_rest import NO_UNLOADED
from cosim.results.parts import LedgerRow, Scene, head_block, ledger_rows, muscle_block, state_block
from cosim.results.result import Result
from cosim.results.scene import coarse_bones, posed_scene, with_measures
from cosim.results.tip_reach import motion_over_reach
from cosim.solve.motion import SolvedMotion

MOST_TIMES = 250
"""In a ledger: of more steps, as many are booked as evenly as can be, the last among them."""
OF_POINTS = ("point_displacement_mm", "point_strain_percent", "gauge_strain_percent")
"""What a hood's view says of the points of the user's."""
SMALL_TORQUE = 1e-12
"""N m."""


def observe_motion(case: Case, moved: SolvedMotion, wall: float) -> Result:
    """Everything that a motion leaves behind."""
    scene = _scene(moved.models, moved.history)
    values = _arrays(case, moved.models, moved.history, scene)
    return Result(
        _summary(case, moved, wall),
        values,
        tuple(_ledger(moved.models, moved.history)),
        with_measures(scene, values, -1, case),
        resolved_toml(case),
        case.name,
    )


def _summary(case: Case, moved: SolvedMotion, wall: float) -> dict[str, Any]:
    t, frames, tips, end = (
        moved.models,
        moved.history.frames,
        moved.history.tips,
        moved.history.moment,
    )
    finger, hood, last = t.finger, t.hood, frames[-1]
    energy, artificial = _energy(moved)
    out: dict[str, Any] = {
        **head_block(case, moved.failure is None, wall),
        "fingertip_device": tip_support_kind(case.finger),
        "came_to_rest": moved.rest.is_reached,
        "last_rate_rad_per_s": moved.rest.rate,
        "last_force_change_N": moved.rest.change,
        **state_block(finger, hood, last.angles, last.tension, last.excursion, tips[-1][:3]),
        "fingertip_moment_Nmm": by_axis(1e3 * np.asarray(tips[-1][3:])),
        "energy_mJ": energy,
        "largest_interface_residual": max(f.residual for f in frames),
        "coupling_scheme": case.coupling.scheme,
        **_largest_of_hood(moved),
        "audit": {
            **by_name(HOOD_BALANCES, np.max([f.imbalance for f in frames], axis=0)),
            **_balance_at_rest(moved),
            "artificial_energy_over_effort": abs(artificial),
            "energy_put_in_over_effort": max(-artificial, 0.0),
        },
        "rest": {"exempt": NO_UNLOADED},
        "iterations": {"steps": len(frames) - 1, "hood_solves": end.coupled.solves},
    }
    over_reach = motion_over_reach(case, moved)
    match over_reach:
        case str():
            out["audit_not_judged"] = {"tip_force_over_reach": over_reach}
        case _:
            out["audit"]["tip_force_over_reach"] = over_reach
    out["audit_missed"] = missed_bounds(
        out,
        posture_in_range=is_in_range(finger.joints, np.array([f.angles for f in frames]), t.ranges),
        at_rest=moved.rest.is_reached or not moved.must_rest,
        little_numerical_damping=moved.must_rest or artificial <= MOST_DAMPING,
    )
    if moved.failure is not None:
        out["failure"] = str(moved.failure)
    if at_limit := _limits_block(case, moved):
        out["joints_at_limit"] = at_limit
    out |= tie_block(getattr(t.finger, "finger", None), last.angles)
    if case.forward is not None and case.forward.adaptive is not None:
        out["step_control"] = _steps(end, frames)
    if names := t.moves.prescribed.names:
        reached = 1e3 * (end.draw.excursion - end.draw.start)
        out["prescribed_excursion_mm"] = by_name(names, reached)
    if not case.finger.is_native:
        out["not_in_ledger"] = OPEN
    if t.built.points.names and t.built.view is not None:
        seen = t.built.view(end.coupled.hood).summary()
        out |= {key: seen[key] for key in OF_POINTS if key in seen}
    if twice := [str(pair) for pair in pairs(case, hood, finger)]:
        out["double_counted"] = twice
    out |= events_block(t.giving_parts, end.events)
    out |= muscle_block(case, t.pulls.lengths(end.drive))
    if t.pulls.motors:
        out["motor"] = {
            name: {"drawn_mm": 1e3 * float(drawn), "torque_Nmm": 1e3 * float(torque)}
            for name, (drawn, torque) in zip(t.pulls.motors, last.motors, strict=True)
        }
    if t.pulls.cylinders:
        out["air"] = {
            name: {"command_V": float(volts), "pressure_kPa": 1e-3 * float(pressure)}
            for name, (volts, pressure) in zip(t.pulls.cylinders, last.drive, strict=True)
        }
    return out


def _largest_of_hood(moved: SolvedMotion) -> dict[str, float]:
    """The hood's own figures that have a bound, the largest of its end and of its stored shapes."""
    view, kept = moved.models.built.view, moved.history
    if view is None:
        return {}
    end = view(kept.moment.coupled.hood).audit()
    every = [end, *(audit_of(shape) for shape in kept.shapes)]
    return {name: max(figures[name] for figures in every) for name in end}


def _energy(moved: SolvedMotion) -> tuple[dict[str, float], float]:
    """Where the work of tendons and gravity went since the start (mJ); and what the method took
    from it (negative: gave to it), over the tendons' work without its signs."""
    t, frames, end = moved.models, moved.history.frames, moved.history.moment
    done, of_hood = end.coupled.energy, end.events[:, 0] < len(getattr(t.moves.giving, "names", ()))
    given, shed = (float(end.events[which, 5].sum()) for which in (of_hood, ~of_hood))
    stored = done.tendons - done.hood - given
    rubbed, held, from_stretch = end.friction.tolist()
    lost, own = end.dissipated + end.slipped + rubbed + held + given + shed, done.own + from_stretch
    artificial = done.tendons + own - (frames[-1].energy - frames[0].energy) - stored - lost
    first, last = (t.finger.stored_energy(at) for at in (t.initial_state, end.coupled.finger))
    gained = {kind: last[kind] - first[kind] for kind in last}
    of_state = t.built.energy if t.relaxes else None
    for_good = stored if of_state is None else of_state(end.coupled.hood)
    parts = (
        {
            "gravity": -gained["height"],
            "kinetic": gained["kinetic"],
            "joints_stored": gained["joints"],
            "device_stored": gained["device"],
        }
        if gained
        else {"finger": frames[-1].energy - frames[0].energy}
    )
    energy = {
        "tendons": done.tendons,
        "own_tendons": own,
        **parts,
        "hood_stored": for_good,
        **({"hood_relaxed": stored - for_good} if t.relaxes else {}),
        "joints_dissipated": end.dissipated,
        "device_dissipated": end.slipped,
        **({"guides_dissipated": rubbed, "guides_held": held} if end.friction.any() else {}),
        **({"gave_way": given} if of_hood.any() else {}),
        **({"splints": shed} if (~of_hood).any() else {}),
        "artificial": artificial,
    }
    in_mJ = {name: 1e3 * value for name, value in energy.items()}
    return in_mJ, artificial / max(done.effort, 1e-12)


def _limits_block(case: Case, moved: SolvedMotion) -> dict[str, dict[str, float]]:
    t, frames, tips = moved.models, moved.history.frames, moved.history.tips

    def torque(k: int) -> Array:
        """Torques (nq,) N m of the limits on the joints at the k-th time, of the first at the
        second."""
        k = max(k, 1)
        books = _books(t, frames[k - 1], frames[k], tips[k])
        if "limit" not in books:
            return np.zeros(len(t.finger.joints))
        return np.asarray(t.finger.jacobian(frames[k].angles).T @ books["limit"].ravel())

    return joints_ever_at_limit(
        limits_of(case, t.ranges),
        t.finger.joints,
        [f.time for f in frames],
        np.array([f.angles for f in frames]),
        torque,
    )


def _balance_at_rest(moved: SolvedMotion) -> dict[str, float]:
    """The largest joint torque of inertia over the largest of any source, of a finger that came to
    rest and tells its forces."""
    t, frames, tips = moved.models, moved.history.frames, moved.history.tips
    books = _books(t, frames[-2], frames[-1], tips[-1])
    if not moved.rest.is_reached or "inertia" not in books:
        return {}
    jacobian = t.finger.jacobian(frames[-1].angles)
    torque = {name: np.abs(jacobian.T @ w.ravel()).max() for name, w in books.items()}
    return {
        "torque_balance_at_rest": float(torque["inertia"] / max(*torque.values(), SMALL_TORQUE))
    }


def _books(t: MovingModels, start: MotionFrame, end: MotionFrame, tip: Array) -> dict[str, Array]:
    """Wrenches (nb, 6) on each body by source of the finger, at the end of a step."""
    return t.finger.ledger(
        (start.angles, start.rates),
        (end.angles, end.rates),
        end.time - start.time,
        end.total,
        end.tension[len(t.hood.tendons) :],
        tip,
        end.grip,
        end.joint_torques,
    )


def _steps(end: MotionState, frames: Sequence[MotionFrame]) -> dict[str, Any]:
    """What became of steps whose length follows from their error, each of them two halves."""
    taken = np.diff([f.time for f in frames])
    return {
        "accepted": end.pace.accepted,
        "rejected": end.pace.rejected,
        "largest_error_deg": float(np.rad2deg(end.pace.error)),
        "shortest_half_ms": 1e3 * float(taken.min()),
        "longest_half_ms": 1e3 * float(taken.max()),
    }


def _arrays(case: Case, t: MovingModels, kept: MotionHistory, scene: Scene) -> Arrays:
    finger, hood, frames = t.finger, t.hood, kept.frames
    split = len(hood.tendons)

    values: dict[str, Any] = {
        "angle": [f.angles for f in frames],
        "rate": [f.rates for f in frames],
        "own_tension": [f.tension[split:] for f in frames],
        "tip_force": [tip[:3] for tip in kept.tips],
        "tip_moment": [tip[3:] for tip in kept.tips],
        "step": np.diff([f.time for f in frames], prepend=0.0),
        "finger_energy": [f.energy for f in frames],
    }
    coords: dict[str, Any] = {
        "time": ("time", [f.time for f in frames], {"units": "s"}),
        "joint": list(finger.joints),
        "muscle": list(finger.tendons),
        "axis": list(AXES),
    }
    if hood.tendons:
        values |= {
            "tension": [f.tension[:split] for f in frames],
            "excursion": [f.excursion for f in frames],
            "hood_force": [f.wrench[..., :3] for f in frames],
            "hood_moment": [f.wrench[..., 3:] for f in frames],
            "total_force": [f.total[:, :3] for f in frames],
            "total_moment": [f.total[:, 3:] for f in frames],
            "residual": [f.residual for f in frames],
        }
        coords |= {
            "tendon": list(hood.tendons),
            "body": list(hood.bodies),
            "source": list(hood.sources),
        }
    if frames[0].grip.size:
        values |= {
            "insertion_tension": [
                finger.at_insertions(f.angles, f.tension[split:], f.grip) for f in frames
            ],
            "guide_loss": [f.friction[0] for f in frames],
            "path_length": [finger.path_lengths(f.angles) for f in frames],
        }
    if t.built.points.names:
        values["hood_point_position"] = [f.points for f in frames]
        coords["hood_point"] = list(t.built.points.names)
    if t.pulls.motors:
        wound = np.array([f.motors for f in frames])
        values |= {"motor_position": wound[..., 0], "motor_torque": wound[..., 1]}
        coords["motor"] = list(t.pulls.motors)
    if t.pulls.cylinders:
        drive = np.array([f.drive for f in frames])
        values |= {"command": drive[..., 0], "pressure": drive[..., 1]}
        coords["cylinder"] = list(t.pulls.cylinders)
    every = along("time", values)
    if len(kept.moment.events):
        coords["event"], times = event_arrays(t.giving_parts, kept.moment.events)
        every |= along("event", {"event_time": times})
    if scene.frames and (names := list(scene.frames[0][1].lines)):
        lines = [list(shape.lines.values()) for _, shape in scene.frames]
        every |= along("frame", {"tendon_line": lines})
        coords["frame"] = ("frame", [time for time, _ in scene.frames], {"units": "s"})
        coords["line_tendon"] = names
    return Arrays.of(every, coords, **attributes(case.title, case.name, case.finger.side()))


def _ledger(t: MovingModels, kept: MotionHistory) -> Iterator[LedgerRow]:
    """Every body's forces at the end of a step, closing to zero with the joints' and inertia."""
    frames, bodies = kept.frames, t.finger.bodies
    steps = len(frames) - 1
    times = np.unique(np.linspace(1, steps, min(steps, MOST_TIMES)).round().astype(int))
    for k in times:
        frame = frames[k]
        by_source = {f"hood {s}": frame.wrench[:, i] for i, s in enumerate(t.hood.sources)}
        off = {"hood linearisation": frame.total - frame.wrench.sum(axis=1)}
        every = {**by_source, **off, **_books(t, frames[k - 1], frame, kept.tips[k])}
        yield from ledger_rows(f"{frame.time:.9g} s", bodies, every)


def _scene(t: MovingModels, kept: MotionHistory) -> Scene:
    finger, coupled = t.finger, kept.moment.coupled
    angles = finger.angles(coupled.finger)
    motion, point = finger.motion(angles), finger.tip(angles)
    view = t.built.view_of(coupled.hood)
    hood = None if view is None else hood_field(view)
    of_hood = {} if view is None else view.lines()
    lines = {**t.lines(motion), **of_hood, **finger.lines(angles)}
    force = None if point is None else (point, kept.tips[-1][:3])
    frames = tuple(
        (float(shape["time"]), field_of(shape, hood.quads)) for shape in kept.shapes if hood
    )
    return posed_scene(hood, coarse_bones(t.bones), motion, lines, force, finger.joints, frames)
