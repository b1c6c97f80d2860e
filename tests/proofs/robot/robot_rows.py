"""The robotic finger of Xu et al. 2012: table III, paths, fan, control, excursion experiment."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from cases.papers.models.xu2012 import checks
from cases.papers.models.xu2012.tracking import SETTLED, STEP_SECONDS, StepResponse
from rigid.fingers.robot import robot_finger
from rigid.fingers.robot_tables import JOINTS, TABLE_III, TENDONS
from tests.helpers.rows import Row

PAPER = "Design of an Anthropomorphic Robotic Finger System with Biomimetic Artificial Joints"
POSTURES = 40
"""Random ones, for the checks that difference or sweep."""
UNSEEN = 1
"""The seed of poses other than those through which the gains were tried."""
SEEDS = 10
"""Worlds of the excursion experiment."""


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
    length, arms = checks.closed_form_errors(model, some)
    yield row("length less closed forms, m", computed=length, tolerance=1e-12,
              source="xu2012.paths: cylinders unrolled, great circles")  # fmt: skip
    yield row("arms less differences of closed forms, m/rad", computed=arms, tolerance=1e-9,
              source="xu2012.paths, central differences")  # fmt: skip


def fan_rows() -> Iterator[Row]:
    """The fan of fingertip accelerations, and what the second extensor changes."""
    five, six = checks.reach_targets(False), checks.reach_targets(True)
    row = partial(Row, "fan of accelerations", source=f"{PAPER}, section V")
    flat = [float(np.median(r.flatness)) for r in (five, six)]
    yield row("third singular value over the first, five tendons, median: near a plane", 0.1,
              flat[0], 0.0, measure="bound")  # fmt: skip
    yield row("the same with six: the problem remains", 0.1, flat[1], 0.0, measure="bound")
    hold = [float(r.hold.max()) for r in (five, six)]
    yield row("largest force to hold a pose, six over five: alleviated", 1.0, hold[1] / hold[0],
              0.0, measure="bound")  # fmt: skip


def air_control_rows() -> Iterator[Row]:
    """Steps through 50 random poses on the air itself; some five minutes."""
    yield from _control_rows("on air", air=True)


def lag_control_rows() -> Iterator[Row]:
    """Yield the rows of control on a stand-in of first order."""
    yield from _control_rows("on a lag of 50 ms", air=False)


def _control_rows(drive: str, air: bool) -> Iterator[Row]:
    """Joint space against tendon space, the same plant and noise."""
    source = f"{PAPER}, section VII"
    joint = partial(Row, f"joint space {drive}, six tendons, one gain set", source=source)
    six = checks.quality(checks.joint_steps(True, air))
    yield joint("unstable of 50 poses", 0.0, float(six.unstable), 0.0, measure="absolute")
    yield joint("joints that do not settle within 2 deg in 1.5 s", 0.0, float(six.unsettled), 0.0,
                measure="absolute")  # fmt: skip
    other = checks.quality(checks.joint_steps(True, air, UNSEEN))
    yield joint("unstable of 50 poses that no gain was chosen on", 0.0, float(other.unstable), 0.0,
                measure="absolute")  # fmt: skip
    yield from _quality_rows(joint.args[0], six)
    tendon = partial(Row, f"tendon space {drive}, six tendons", source=source)
    home = checks.tune(True, air).steps
    yield tendon("unstable at the pose of tuning", 0.0, _unstable(home), 0.0, measure="absolute")
    fails = _unstable(checks.tendon_steps(True, air))
    yield tendon("poses of 50 stable with the same gains, at most 49", 49.0, checks.POSES - fails,
                 0.0, measure="bound")  # fmt: skip
    five = checks.quality(checks.joint_steps(False, air))
    name, source = f"joint space {drive}, five tendons, the same gains", f"{source}, not all poses"
    yield Row(name, "unstable of 50 poses", 0.0, float(five.unstable), 0.0, source, "comparison")
    yield Row(name, "joints that do not settle within 2 deg in 1.5 s", 0.0, float(five.unsettled),
              0.0, source, "comparison")  # fmt: skip
    yield from _quality_rows(name, five)


def _quality_rows(name: str, found: checks.Quality) -> Iterator[Row]:
    """Settling beside a step's length, overshoot beside the band; targets of ours."""
    row = partial(Row, name, source="the paper prints no such number", measure="comparison")
    for k, joint in enumerate(JOINTS):
        median, longest = found.median_settling[k], found.longest_settling[k]
        yield row(f"settling of {joint}, s, median", 0.0, float(median), STEP_SECONDS)
        yield row(f"settling of {joint}, s, longest", 0.0, float(longest), STEP_SECONDS)
        past = float(found.largest_overshoot[k])
        yield row(f"largest overshoot of {joint}, deg", 0.0, past, np.degrees(SETTLED))


def _unstable(steps: list[StepResponse]) -> float:
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
    for seed in range(SEEDS):
        off = 1e3 * checks.excursions(seed).marker_error
        yield row(f"markers' places found to, mm, seed {seed}", 1.0, off, 0.0, measure="bound")
    before, after = checks.rms(e.meant), checks.rms(e.found)
    for tendon, b, a in zip(TENDONS, before, after, strict=True):
        yield row(f"RMS of the {tendon}'s excursion, places found, mm (0 without noise)", 0.0,
                  1e3 * float(a), 1e3 * float(b), measure="comparison")  # fmt: skip
