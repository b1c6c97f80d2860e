"""A measured or wanted motion: joint angles over time from a table."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cosim.errors import InputError, ReadingWarning
from cosim.port import Array
from cosim.text_tables import read_csv
from rigid.opensim.sto import coordinate_of, read_sto

UNITS = {"deg": np.pi / 180.0, "rad": 1.0}
FEWEST = 4
"""Times, of a spline with accelerations."""
ORDER = 4
"""Order of the Butterworth filter, which is run both ways."""


@dataclass(frozen=True)
class JointMotion:
    """n times (s), joint angles (n, nq) rad with rates and accelerations."""

    time: Array
    angle: Array
    rate: Array
    acceleration: Array
    markers_miss: float | None = None
    """m, root of the mean square by which the markers that it is from miss the finger's."""

    def first(self, count: int) -> JointMotion:
        """Its first times, so many."""
        n = slice(count)
        return replace(
            self,
            time=self.time[n],
            angle=self.angle[n],
            rate=self.rate[n],
            acceleration=self.acceleration[n],
        )


def read_motion(
    path: Path,
    joints: Sequence[str],
    posture: Mapping[str, float],
    samples: int | None = None,
    cutoff: float | None = None,
) -> JointMotion:
    """Angles of `joints` from a .sto or .mot, or a .csv with columns `time` (s) and JOINT_deg or
    JOINT_rad; a joint without a column stays at its angle of `posture` (rad).

    Rates and accelerations are those of a cubic spline through the angles, after a low-pass filter
    at `cutoff` Hz where one is given; `samples` times in equal steps replace the file's.  Raises
    InputError."""
    time, columns = (_csv if path.suffix.lower() == ".csv" else _sto)(path, joints)
    if not columns:
        raise InputError(
            f"{path}: has no column of a joint; the joints are {', '.join(joints)}, and a .csv "
            "names its unit, for example PIP_deg"
        )
    angle = np.column_stack(
        [columns.get(joint, np.full(len(time), posture.get(joint, 0.0))) for joint in joints]
    )
    return as_motion(path, time, angle, samples, cutoff)


def as_motion(
    path: Path, time: Array, angle: Array, samples: int | None, cutoff: float | None
) -> JointMotion:
    """Angles (n, nq) rad of a file at times (n,) s, as `read_motion` smooths them.  Raises
    InputError."""
    if len(time) < FEWEST:
        raise InputError(f"{path}: has {len(time)} times; a motion needs at least {FEWEST}")
    if not (np.diff(time) > 0).all():
        k = int(np.argmax(np.diff(time) <= 0))
        raise InputError(
            f"{path}: times must rise from row to row; {time[k]:g} s is followed by "
            f"{time[k + 1]:g} s"
        )
    if not np.isfinite(angle).all():
        raise InputError(f"{path}: holds an angle that is not finite")
    smooth = angle if cutoff is None else _filter(path, time, angle, cutoff)
    return _spline(time, smooth, samples)


def _spline(time: Array, angle: Array, samples: int | None) -> JointMotion:
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(time, angle)
    at = time if samples is None else np.linspace(time[0], time[-1], samples)
    return JointMotion(at, spline(at), spline(at, 1), spline(at, 2))


def _filter(path: Path, time: Array, angle: Array, cutoff: float) -> Array:
    from scipy.signal import butter, sosfiltfilt

    step = np.diff(time)
    if np.ptp(step) > 1e-3 * step.mean():
        raise InputError(f"{path}: --cutoff needs times in equal steps")
    nyquist = 0.5 / float(step.mean())
    if not 0 < cutoff < nyquist:
        raise InputError(f"--cutoff: expected between 0 and {nyquist:.4g} Hz, half the file's rate")
    filtered: Array = sosfiltfilt(butter(ORDER // 2, cutoff / nyquist, output="sos"), angle, axis=0)
    return filtered


def _sto(path: Path, joints: Sequence[str]) -> tuple[Array, dict[str, Array]]:
    table = read_sto(path, joints)
    columns = enumerate(map(coordinate_of, table.columns))
    return table.time, {name: table.values[:, k] for k, name in columns if name in joints}


def _csv(path: Path, joints: Sequence[str]) -> tuple[Array, dict[str, Array]]:
    table = read_csv(path, "time,PIP_deg")
    columns = {
        joint: UNITS[unit] * table.numbers(f"{joint}_{unit}")
        for joint in joints
        for unit in UNITS
        if f"{joint}_{unit}" in table.columns
    }
    time = table.numbers("time")
    known = {"time", *(f"{joint}_{unit}" for joint in joints for unit in UNITS)}
    strange = [name for name in table.columns if name not in known]
    if strange and columns:
        warnings.warn(
            ReadingWarning(
                f"{path}: left out, no angle of a joint: {', '.join(strange)}; the joints are "
                f"{', '.join(joints)}, in columns like {joints[-1]}_deg"
            ),
            stacklevel=2,
        )
    return time, columns
