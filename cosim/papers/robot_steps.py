"""Steps of the robotic finger under both controllers: figure 10, and what joint space does."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from cosim.port import Array
from cosim.report.figures import Figure, style_axes
from rigid.fingers.robot import robot_finger
from rigid.fingers.robot_tables import JOINTS
from rigid.mujoco.finger import MujocoFinger
from rigid.papers.xu2012 import checks
from rigid.papers.xu2012.tracking import StepResponse

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Sheet

SHOWN = 8
"""Steps drawn of the fifty."""
FIGURE_10 = ("extensor", "dip_flexor", "abduction")
"""Figure 10 shows three tendons and does not say which: ours."""
JOINT, TENDON = "#0b5394", "#b45309"
COLOURS = ("#0b5394", "#b45309", "#3f7d3f", "#8e4585")
"""Colours of `JOINTS`."""


def step_figures() -> list[Figure]:
    """Tendon lengths where the gains were tuned, and both controllers through random poses; some
    four minutes."""
    return [_tendon_figure(), _joint_figure(), _quality_figure()]


def _tendon_figure() -> Figure:
    tuned = checks.tune(True, air=True)
    finger = MujocoFinger(robot_finger(True))
    index = [finger.tendons.index(name) for name in FIGURE_10]
    time = _times(tuned.steps)
    length = [1e3 * finger.tendon_lengths(q) for s in tuned.steps for q in s.angle]
    goal = [1e3 * finger.tendon_lengths(s.goal) for s in tuned.steps for _ in s.angle]
    got, wanted = np.array(length)[:, index], np.array(goal)[:, index]
    got, wanted = got - wanted[-1], wanted - wanted[-1]

    def draw(sheet: Sheet) -> None:
        for k, axes in enumerate(sheet.subplots(len(FIGURE_10), 1, sharex=True)):
            axes.plot(time, wanted[:, k], color="0.5", lw=1.2, ls="--", label="wanted")
            axes.plot(time, got[:, k], color=TENDON, lw=1.6, label="got")
            style_axes(axes, "time, s" if k == 2 else "", f"{FIGURE_10[k]}, mm")
            if k == 0:
                axes.legend(frameon=False, ncols=2, fontsize=8)

    g = tuned.gains
    caption = (
        f"A step and back at the pose at which the gains were tuned ({g.p:g} N/m, integral "
        f"{g.i:g} N/(m s), differential {g.d:g} N s/m, the best of {len(checks.AIR_CANDIDATES)} "
        "sets): as in the paper, lengths follow. Six tendons, each on a cylinder and valve."
    )
    columns = {f"{n}_{what}_mm": x[:, k] for what, x in (("wanted", wanted), ("got", got))
               for k, n in enumerate(FIGURE_10)}  # fmt: skip
    data = pd.DataFrame({"time_s": time, **columns})
    title = "Figure 10: steps in tendon space, at the pose of tuning"
    return Figure("figure_10_tendon_space", title, caption, draw, {"figure_10": data}, (7.0, 5.2))


def _joint_figure() -> Figure:
    joint, tendon = checks.joint_steps(True, air=True), checks.tendon_steps(True, air=True)
    often = np.convolve([s.unstable for s in tendon], np.ones(SHOWN), "valid")
    shown = slice(int(np.argmax(often)), int(np.argmax(often)) + SHOWN)
    time = _times(joint[shown])

    def draw(sheet: Sheet) -> None:
        for k, axes in enumerate(sheet.subplots(len(JOINTS), 1, sharex=True)):
            for steps, colour, name in (
                (tendon, TENDON, "tendon space"),
                (joint, JOINT, "joint space"),
            ):
                axes.plot(time, _angles(steps[shown], k), color=colour, lw=1.3, label=name)
            goal = np.concatenate([np.full(len(s.time), s.goal[k]) for s in joint[shown]])
            axes.plot(time, np.degrees(goal), color="0.2", lw=1.0, ls="--", label="wanted")
            last = k == len(JOINTS) - 1
            style_axes(axes, "time, s" if last else "", f"{JOINTS[k].replace('_', ' ')}, deg")
        handles, names = sheet.axes[0].get_legend_handles_labels()
        sheet.legend(handles, names, loc="outside lower center", ncols=3, frameon=False)

    found, fails = checks.quality(joint), sum(s.unstable for s in tendon)
    caption = (
        f"Of {checks.POSES} random poses one after another those {SHOWN}, from step {shown.start} "
        "on, among which tendon space fails most often; six tendons on the air itself. Joint "
        f"space, one set of gains: {found.unstable} unstable, each joint within "
        f"2 deg after at most {found.longest_settling.max():.2f} s (medians "
        f"{found.median_settling.min():.2f} to {found.median_settling.max():.2f}). Tendon space, "
        f"with the gains of figure 10: {fails} unstable, the same finger, air and noise. Unstable: "
        "a joint still swings by more than 5 deg in the last 0.3 s of a step of 1.5 s."
    )
    table = pd.concat([_table(name, steps) for name, steps in _kinds().items()], ignore_index=True)
    title = "Steps through random poses, in joint space and in tendon space"
    return Figure("steps_over_workspace", title, caption, draw, {"steps": table}, (8.0, 7.2))


def _kinds() -> dict[str, list[StepResponse]]:
    """Every set of steps by its name."""
    return {
        f"{space} space, {count} tendons, {drive}": steps(count == "six", air)
        for drive, air in (("air", True), ("lag of 50 ms", False))
        for space, count, steps in (
            ("joint", "six", checks.joint_steps),
            ("joint", "five", checks.joint_steps),
            ("tendon", "six", checks.tendon_steps),
        )
    }


def _quality_figure() -> Figure:
    kinds = _kinds()
    data = pd.concat([_quality(name, steps) for name, steps in kinds.items()], ignore_index=True)
    unstable = {name: sum(s.unstable for s in steps) for name, steps in kinds.items()}
    hold = [float(checks.reach_targets(six).hold.max()) for six in (False, True)]

    def draw(sheet: Sheet) -> None:
        left, right = sheet.subplots(1, 2, sharey=True)
        for n, steps in enumerate(kinds.values()):
            for k, colour in enumerate(COLOURS):
                at = -(n + 0.18 * (k - 1.5))
                time = np.array([s.settling[k] for s in steps[1:]])
                past = np.degrees([s.overshoot[k] for s in steps[1:]])
                for axes, x in ((left, time[np.isfinite(time)]), (right, past)):
                    axes.plot(x, np.full(len(x), at), "|", color=colour, ms=7, alpha=0.6)
        left.set_yticks(
            -np.arange(len(kinds)),
            [f"{n}\n{unstable[n]} of {checks.POSES} unstable" for n in kinds],
        )
        style_axes(left, "settling to 2 deg, s (of joints that do)", "")
        style_axes(right, "overshoot, deg", "")
        right.set_xscale("symlog", linthresh=1.0)
        for k, colour in enumerate(COLOURS):
            right.plot([], [], "|", color=colour, ms=9, mew=2, label=JOINTS[k].replace("_", " "))
        sheet.legend(loc="outside lower center", ncols=4, frameon=False)

    caption = (
        f"All {checks.POSES} steps, a mark for each joint. The air's gains are lower than the "
        "stand-in's, since its force comes 70 ms after the command. What the sixth tendon changes: "
        "with five, the same gains and the same poses, "
        f"{unstable['joint space, five tendons, air']} are unstable on air; the largest force that "
        f"holds any of the poses is {hold[0]:.0f} N with five and {hold[1]:.0f} N with six, and "
        "what a tendon turns an abducted finger further by goes with its force."
    )
    title = "Settling and overshoot, on air and on its stand-in, with six tendons and five"
    tables = {"settling_and_overshoot": data}
    return Figure("settling_and_overshoot", title, caption, draw, tables, (9.0, 6.0))


def _quality(name: str, steps: list[StepResponse]) -> pd.DataFrame:
    found = checks.quality(steps)
    return pd.DataFrame(
        {
            "control": name,
            "joint": JOINTS,
            "unstable_of_all": found.unstable,
            "joints_unsettled_of_all": found.unsettled,
            "settling_median_s": found.median_settling,
            "settling_longest_s": found.longest_settling,
            "overshoot_median_deg": found.median_overshoot,
            "overshoot_largest_deg": found.largest_overshoot,
        }
    )


def _table(name: str, steps: Sequence[StepResponse]) -> pd.DataFrame:
    """A row for each step, settling (inf: not) and overshoot by joint."""
    rows = [
        {"control": name, "step": i, "unstable": s.unstable, "error_deg": np.degrees(s.error)}
        | {f"{j}_goal_deg": v for j, v in zip(JOINTS, np.degrees(s.goal), strict=True)}
        | {f"{j}_settling_s": v for j, v in zip(JOINTS, s.settling, strict=True)}
        | {f"{j}_overshoot_deg": v for j, v in zip(JOINTS, np.degrees(s.overshoot), strict=True)}
        for i, s in enumerate(steps)
    ]
    return pd.DataFrame(rows)


def _times(steps: Sequence[StepResponse]) -> Array:
    each = steps[0].time
    return np.concatenate([each + i * (each[-1] + each[1]) for i in range(len(steps))])


def _angles(steps: Sequence[StepResponse], joint: int) -> Array:
    return np.degrees(np.concatenate([s.angle[:, joint] for s in steps]))
