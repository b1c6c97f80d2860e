"""Steps of the robotic finger under both controllers: figure 10, and what joint space does."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from cosim.papers.figure import Figure
from cosim.papers.lines import framed
from cosim.port import Array
from rigid.mujoco_finger import MujocoFinger
from rigid.robot import checks
from rigid.robot.finger import robot_finger
from rigid.robot.tables import JOINTS
from rigid.robot.tracking import Step

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Sheet

SHOWN = 8
"""Steps drawn of the fifty."""
FIGURE_10 = ("extensor", "dip_flexor", "abduction")
"""Figure 10 shows three tendons and does not say which: ours."""
JOINT, TENDON = "#0b5394", "#b45309"


def step_figures() -> list[Figure]:
    """Tendon lengths where the gains were tuned, and both controllers through random poses."""
    return [_tendon_figure(), _joint_figure()]


def _tendon_figure() -> Figure:
    tuned = checks.tuned(True)
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
            framed(axes, "time, s" if k == 2 else "", f"{FIGURE_10[k]}, mm")
            if k == 0:
                axes.legend(frameon=False, ncols=2, fontsize=8)

    g = tuned.gains
    caption = (
        f"A step and back at the pose at which the gains were tuned ({g.p:g} N/m, integral "
        f"{g.i:g} N/(m s), differential {g.d:g} N s/m, the best of {len(checks.CANDIDATES)} sets): "
        "as in the paper, lengths follow. Six tendons; the actuators are a stand-in of first "
        "order, at 95 % after 50 ms."
    )
    columns = {f"{n}_{what}_mm": x[:, k] for what, x in (("wanted", wanted), ("got", got))
               for k, n in enumerate(FIGURE_10)}  # fmt: skip
    data = pd.DataFrame({"time_s": time, **columns})
    title = "Figure 10: steps in tendon space, at the pose of tuning"
    return Figure("figure_10_tendon_space", title, caption, draw, {"figure_10": data}, (7.0, 5.2))


def _joint_figure() -> Figure:
    joint, tendon = checks.joint_steps(True), checks.tendon_steps(True)
    five = checks.joint_steps(False)
    time = _times(joint[:SHOWN])

    def draw(sheet: Sheet) -> None:
        for k, axes in enumerate(sheet.subplots(len(JOINTS), 1, sharex=True)):
            for steps, colour, name in (
                (tendon, TENDON, "tendon space"),
                (joint, JOINT, "joint space"),
            ):
                axes.plot(time, _angles(steps[:SHOWN], k), color=colour, lw=1.3, label=name)
            goal = np.concatenate([np.full(len(s.time), s.goal[k]) for s in joint[:SHOWN]])
            axes.plot(time, np.degrees(goal), color="0.2", lw=1.0, ls="--", label="wanted")
            last = k == len(JOINTS) - 1
            framed(axes, "time, s" if last else "", f"{JOINTS[k].replace('_', ' ')}, deg")
        handles, names = sheet.axes[0].get_legend_handles_labels()
        sheet.legend(handles, names, loc="outside lower center", ncols=3, frameon=False)

    settled = np.array([s.settling for s in joint[1:]])
    unstable = [sum(s.unstable for s in steps) for steps in (joint, tendon, five)]
    caption = (
        f"The first {SHOWN} of {checks.POSES} random poses, one after another. Joint space, one "
        f"set of gains: {unstable[0]} unstable, each joint within 2 deg after at most "
        f"{settled.max():.2f} s (median {np.median(settled):.2f}). Tendon space, with the gains of "
        f"figure 10: {unstable[1]} unstable, the same finger, actuators and noise. With five "
        f"tendons, the same gains and the same poses joint space is unstable at {unstable[2]}. "
        "Unstable: a joint still swings by more than 5 deg in the last 0.3 s of a step of 1.5 s."
    )
    kinds = {"joint space, six tendons": joint, "tendon space, six tendons": tendon,
             "joint space, five tendons": five}  # fmt: skip
    table = pd.concat([_table(name, steps) for name, steps in kinds.items()], ignore_index=True)
    title = "Steps through random poses, in joint space and in tendon space"
    return Figure("steps_over_workspace", title, caption, draw, {"steps": table}, (8.0, 7.2))


def _table(name: str, steps: Sequence[Step]) -> pd.DataFrame:
    """A row for each step, settling (inf: not) and overshoot by joint."""
    rows = [
        {"control": name, "step": i, "unstable": s.unstable, "error_deg": np.degrees(s.error)}
        | {f"{j}_goal_deg": v for j, v in zip(JOINTS, np.degrees(s.goal), strict=True)}
        | {f"{j}_settling_s": v for j, v in zip(JOINTS, s.settling, strict=True)}
        | {f"{j}_overshoot_deg": v for j, v in zip(JOINTS, np.degrees(s.overshoot), strict=True)}
        for i, s in enumerate(steps)
    ]
    return pd.DataFrame(rows)


def _times(steps: Sequence[Step]) -> Array:
    each = steps[0].time
    return np.concatenate([each + i * (each[-1] + each[1]) for i in range(len(steps))])


def _angles(steps: Sequence[Step], joint: int) -> Array:
    return np.degrees(np.concatenate([s.angle[:, joint] for s in steps]))
