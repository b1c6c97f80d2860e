"""What `cosim estimate` leaves: numbers, tables and a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from cosim.analyses.estimate.capacity import Capacity
from cosim.analyses.estimate.feasible import ForceSet
from cosim.analyses.estimate.of_case import EstimateAnswer, MotionEstimate, Setup
from cosim.analyses.estimate.plot import draw_estimate, draw_motion, draw_tracking
from cosim.analyses.estimate.tensions import format_components
from cosim.analyses.estimate.tracking import Tracking
from cosim.case.file import moved_toml, resolved_toml
from cosim.files import output_folder
from cosim.json_text import json_text
from cosim.port import Array
from cosim.results.picture import write_figure
from cosim.version import __version__

MARK = "estimate.json"
DPI = 140


def muscle_table(bear: Capacity, tension: Array) -> pd.DataFrame:
    """A row for each muscle."""
    return pd.DataFrame(
        {
            "muscle": bear.names,
            "tension_N": tension,
            "greatest_N": bear.most,
            "activation": tension / bear.most,
            "area_cm2": 1e4 * bear.area,
            "stress_N_per_cm2": tension / (1e4 * bear.area),
            "greatest_from": [m for _, m in bear.sources],
            "area_from": [a for a, _ in bear.sources],
        }
    )


def write_answer(
    folder: Path, s: Setup, answer: EstimateAnswer | None, forces: ForceSet | None, wall: float
) -> None:
    """An estimate and the set of feasible forces, either of which may lack.  Raises InputError."""
    tension = None if answer is None else answer.estimate.tension
    wanted = None if answer is None or answer.demand.unit != "N" else answer.target
    with output_folder(folder, MARK) as part:
        summary = {**_head(s, wall), **({} if answer is None else _as_table(s, answer))}
        if forces is not None:
            summary["feasible_force"] = _set(s, forces)
            names = [f"{name}_N" for name in forces.names]
            _csv(part / "feasible_force.csv", pd.DataFrame(forces.vertices, columns=names))
        _json(part / MARK, summary)
        if tension is not None:
            _csv(part / "estimate.csv", muscle_table(s.capacity, tension))
        exact = s.case.hood.shares_fixed
        asked = (
            ""
            if answer is None
            else f", asked for {format_components(answer.demand, answer.target)}"
        )
        title = f"{s.case.name}{asked}"
        sheet = draw_estimate(s.capacity, tension, forces, wanted, title, exact)
        write_figure(sheet, part / "estimate.png", DPI)


def write_motion(folder: Path, s: Setup, result: MotionEstimate, wall: float) -> None:
    """Tensions along a motion.  Raises InputError."""
    joints = s.models.finger.joints
    table = {"time_s": result.motion.time}
    table |= {f"{j}_deg": np.degrees(result.motion.angle[:, k]) for k, j in enumerate(joints)}
    table |= {f"{j}_torque_Nmm": 1e3 * result.required_torque[:, k] for k, j in enumerate(joints)}
    table |= {f"{j}_made_Nmm": 1e3 * result.torque[:, k] for k, j in enumerate(joints)}
    table |= {f"{n}_N": result.tension[:, k] for k, n in enumerate(s.capacity.names)}
    with output_folder(folder, MARK) as part:
        audit: dict[str, Any] = {
            "worst_miss": result.worst,
            "largest_torque_lacking_Nmm": 1e3
            * float(np.abs(result.torque - result.required_torque).max()),
            "hood_solves": result.rounds,
        }
        if result.stopped is not None:
            audit["stopped"] = str(result.stopped) or "by the user"
        if (miss := result.motion.markers_miss) is not None:
            audit["markers_miss_mm"] = 1e3 * miss
        most = dict(zip(s.capacity.names, result.tension.max(axis=0), strict=True))
        _json(part / MARK, {**_head(s, wall), "largest_tension_N": most, "audit": audit})
        _csv(part / "estimate.csv", pd.DataFrame(table))
        sheet = draw_motion(s.capacity.names, joints, result, s.case.name)
        write_figure(sheet, part / "estimate.png", DPI)


def forward_path(folder: Path) -> Path:
    """The case that runs forward under the tensions of a folder."""
    return folder / f"{folder.name}_forward.toml"


def write_tracking(folder: Path, s: Setup, tracking: Tracking, wall: float) -> None:
    """Tensions that move the finger forward along a motion, in full precision, the angles beside
    those wanted, and the case of `forward_path`, which runs under these tensions.

    Raises InputError."""
    joints, names = s.models.finger.joints, s.capacity.names
    angles = {"time_s": tracking.step_time}
    for k, joint in enumerate(joints):
        angles |= {
            f"{joint}_deg": np.degrees(tracking.angle[:, k]),
            f"{joint}_wanted_deg": np.degrees(tracking.wanted[:, k]),
        }
    pulls = pd.DataFrame(tracking.tension, columns=list(names))
    pulls.insert(0, "time", tracking.time)
    off = np.degrees(np.abs(tracking.angle - tracking.wanted).max(axis=0))
    summary = {
        **_head(s, wall),
        "largest_tension_N": dict(zip(names, tracking.tension.max(axis=0), strict=True)),
        "angle_rms_deg": dict(zip(joints, np.degrees(tracking.error), strict=True)),
        "angle_most_deg": dict(zip(joints, off, strict=True)),
        "audit": {
            "largest_torque_lacking_Nmm": 1e3 * tracking.lacking,
            "strays_alone_deg": float(np.degrees(tracking.astray)),
            "hood_solves_of_plans": tracking.rounds,
            "missed": tracking.faults(),
        },
    }
    if (miss := tracking.motion.markers_miss) is not None:
        summary["audit"]["markers_miss_mm"] = 1e3 * miss
    if tracking.stopped is not None:
        summary["audit"]["stopped"] = str(tracking.stopped)
    with output_folder(folder, MARK) as part:
        table = part / "forward_tensions.csv"
        pulls.to_csv(table, index=False)
        signals = {
            name: {"signal": {"kind": "file", "path": str(table), "column": name}} for name in names
        }
        made = {
            "title": f"{s.case.title}, along a motion",
            "tendons": signals,
            "forward.duration": f"{float(tracking.step_time[-1])!r} s",
        }
        case = s.case.replace(made)
        text = moved_toml(resolved_toml(case), part)
        (part / forward_path(folder).name).write_text(text, encoding="utf-8")
        _csv(part / "estimate.csv", pd.DataFrame(angles))
        _json(part / MARK, summary)
        sheet = draw_tracking(names, joints, tracking, s.case.name)
        write_figure(sheet, part / "estimate.png", DPI)


def _head(s: Setup, wall: float) -> dict[str, Any]:
    kinds = {1: "linear", 2: "quadratic", 3: "cubic"}
    return {
        "case": s.case.name,
        "version": __version__,
        "cost": kinds[s.cost.power],
        "weights": dict(zip(s.capacity.names, s.cost.weight, strict=True)),
        "bounds_N": {
            name: [low, high]
            for name, low, high in zip(
                s.capacity.names, s.capacity.least, s.capacity.most, strict=True
            )
        },
        "wall_s": round(wall, 3),
    }


def _as_table(s: Setup, answer: EstimateAnswer) -> dict[str, Any]:
    unit = answer.demand.unit.replace(" ", "")
    named = answer.demand.names
    joints = s.models.finger.joints
    return {
        f"target_{unit}": dict(zip(named, answer.target, strict=True)),
        "tension_N": dict(zip(s.capacity.names, answer.estimate.tension, strict=True)),
        "audit": {
            f"made_forward_{unit}": dict(zip(named, answer.audit.components, strict=True)),
            "largest_difference": float(np.abs(answer.audit.components - answer.target).max()),
            "joints_turned_deg": dict(
                zip(joints, np.degrees(answer.audit.joint_change), strict=True)
            ),
            "equations_miss": answer.estimate.gap,
            "optimality_miss": answer.estimate.optimum.miss,
            "hood_solves": answer.estimate.rounds,
        },
    }


def _set(s: Setup, forces: ForceSet) -> dict[str, Any]:
    low, high = forces.vertices.min(axis=0), forces.vertices.max(axis=0)
    return {
        "exact": s.case.hood.shares_fixed,
        "vertices": len(forces.vertices),
        "range_N": {name: [a, b] for name, a, b in zip(forces.names, low, high, strict=True)},
    }


def _json(path: Path, summary: dict[str, Any]) -> None:
    path.write_text(json_text(summary, 2, ensure_ascii=True) + "\n", encoding="utf-8")


def _csv(path: Path, table: pd.DataFrame) -> None:
    table.to_csv(path, index=False, float_format="%.9g")
