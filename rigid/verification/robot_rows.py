"""The robotic finger: table III, its paths, fan, control and excursion experiment.

"Design of an Anthropomorphic Robotic Finger System with Biomimetic Artificial Joints".
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from cosim.verification import Row, Study
from rigid.robot import checks
from rigid.robot.finger import robot_finger
from rigid.robot.tables import JOINTS, TABLE_III, TENDONS
from rigid.robot.tracking import Step

PAPER = "Design of an Anthropomorphic Robotic Finger System with Biomimetic Artificial Joints"
POSTURES = 40
"""Random ones, for the checks that difference or sweep."""


def arm_rows() -> Iterator[Row]:
    """Table III side by side, and over all of table II."""
    table = partial(Row, "table III", tolerance=0.01, source=f"{PAPER}, table III")
    arms = checks.table_iii(robot_finger())
    for j, joint in enumerate(JOINTS):
        for t, tendon in enumerate(TENDONS):
            name = f"{tendon} at {joint}, mm"
            yield table(name, TABLE_III[j, t], float(arms[j, t]), measure="absolute")
    yield from _path_rows("paths over table II, five tendons", six=False)
    yield from _path_rows("paths over table II, six tendons", six=True)


def _path_rows(name: str, six: bool) -> Iterator[Row]:
    model = robot_finger(six)
    some = checks.poses(POSTURES, seed=2)
    least = checks.least_arms(model, checks.workspace())
    source = f"{PAPER}, tables II and III: no arm changes its sign"
    flips = float((least < 0).sum())
    yield Row(name, "arms that change their sign", 0.0, flips, 0.0, source, "absolute")
    row = partial(Row, name, target=0.0, measure="absolute")
    jump = checks.jump(model, some[:6])
    yield row("length less what the arms add up to, mm", computed=jump, tolerance=1e-3,
              source="trapezoidal rule over sweeps of each joint in 400 postures")  # fmt: skip
    yield row("ten_J less differences of the length, mm/rad",
              computed=checks.difference(model, some), tolerance=1e-6,
              source="central differences, 1e-5 rad")  # fmt: skip
    length, arms = checks.beside_closed_forms(model, some)
    yield row("length less closed forms, m", computed=length, tolerance=1e-12,
              source="rigid.robot.paths: cylinders unrolled")  # fmt: skip
    yield row("arms less differences of closed forms, m/rad", computed=arms, tolerance=1e-9,
              source="rigid.robot.paths, central differences")  # fmt: skip


def fan_rows() -> Iterator[Row]:
    """The fan of fingertip accelerations, and what the second extensor changes."""
    five, six = checks.reached(False), checks.reached(True)
    row = partial(Row, "fan of accelerations", source=f"{PAPER}, section V")
    flat = [float(np.median(r.flatness)) for r in (five, six)]
    yield row("third singular value over the first, five tendons, median: near a plane", 0.1,
              flat[0], 0.0, measure="bound")  # fmt: skip
    yield row("the same with six: the problem remains", 0.1, flat[1], 0.0, measure="bound")
    hold = [float(r.hold.max()) for r in (five, six)]
    yield row("largest force to hold a pose, six over five: alleviated", 1.0, hold[1] / hold[0],
              0.0, measure="bound")  # fmt: skip


def control_rows() -> Iterator[Row]:
    """Steps through 50 random poses: joint space against tendon space, the same plant and noise."""
    joint = partial(Row, "joint space, six tendons, one gain set", source=f"{PAPER}, section VII")
    steps = checks.joint_steps(True)
    yield joint("unstable of 50 poses", 0.0, _unstable(steps), 0.0, measure="absolute")
    settling = np.array([s.settling for s in steps[1:]])
    yield joint("joints that do not settle within 2 deg", 0.0, float(np.isinf(settling).sum()),
                0.0, measure="absolute")  # fmt: skip
    tendon = partial(Row, "tendon space, six tendons", source=f"{PAPER}, section VII")
    home = checks.tuned(True).steps
    yield tendon("unstable at the pose of tuning", 0.0, _unstable(home), 0.0, measure="absolute")
    fails = _unstable(checks.tendon_steps(True))
    yield tendon("poses of 50 stable with the same gains, at most 49", 49.0, checks.POSES - fails,
                 0.0, measure="bound")  # fmt: skip
    five = partial(Row, "joint space, five tendons", source=f"{PAPER}, section VII, not all poses")
    yield five("unstable of 50 poses", 0.0, _unstable(checks.joint_steps(False)), 0.0,
               measure="comparison")  # fmt: skip


def _unstable(steps: list[Step]) -> float:
    return float(sum(s.unstable for s in steps))


def excursion_rows() -> Iterator[Row]:
    """Section VI as a virtual experiment."""
    row = partial(Row, "virtual excursion experiment", source=f"{PAPER}, section VI")
    e = checks.excursions()
    yield row("times of rest found", 460.0, float(len(e.meant.residual)), 0.0, measure="absolute")
    kept = float(len(e.meant.angle))
    yield row("poses kept at 7 mm", 400.0, kept, 60.0, measure="comparison")
    mean = 1e3 * float(e.meant.residual.mean())
    yield row("mean residual of the markers, mm", 5.0, mean, 1.0, measure="comparison")
    yield row("markers' places found to, mm", 1.0, 1e3 * e.misplaced, 0.0, measure="bound")
    before, after = checks.rms(e.meant), checks.rms(e.found)
    for tendon, b, a in zip(TENDONS, before, after, strict=True):
        yield row(f"RMS of the {tendon}'s excursion, places found, mm (0 without noise)", 0.0,
                  1e3 * float(a), 1e3 * float(b), measure="comparison")  # fmt: skip


STUDIES = (
    Study("moment arms", arm_rows),
    Study("fan", fan_rows),
    Study("control", control_rows),
    Study("excursions", excursion_rows),
)
