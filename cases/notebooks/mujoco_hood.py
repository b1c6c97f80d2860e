# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # An extensor hood in a MuJoCo hand
#
# Hand models in MuJoCo run each extensor over the finger on one fixed path, so that the extensor
# digitorum communis (EDC) has the same arm at the PIP joint whatever the DIP joint does and however
# hard it pulls. In a hand its tension parts between a central slip, which ends behind the PIP, and
# lateral bands, which run on to the DIP. `cosim export --attach` puts such a hood into the model,
# in MuJoCo's own words: it runs without this package.
#
# Name your hand by the environment variable `HAND`, for example MyoSuite's
# `myosuite/simhive/myo_sim/hand/myohand.xml`. Without it the notebook takes a stand-in: a finger of
# ours whose extensors part in fixed shares.

# %%
import os
import subprocess
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import mujoco
import numpy as np

from cosim.case.file import load_case
from cosim.models.build import mjcf_of
from cosim.scoring.names import match_names
from cosim.scoring.scores import score_models
from rigid.mjcf.read import part_names

hand = Path(os.environ.get("HAND", "stand_in.xml"))
if "HAND" not in os.environ:
    print("no HAND is named: a stand-in takes its place")
    hand.write_text(mjcf_of(load_case("free_split_edc")), encoding="utf-8")
hooded = Path("hand_with_hood.xml")
command = [sys.executable, "-m", "cosim", "export", "--attach", str(hand), "-o", str(hooded)]
print(subprocess.run(command, check=True, capture_output=True, encoding="utf-8").stdout)

# %% [markdown]
# ## The arm of EDC at the PIP switches
#
# The finger is held in postures, the extensor pulls with a known force, and the torque that the PIP
# joint feels over that force is the effective arm (negative: it extends). All joints are held by a
# huge inertia while the hood's junctions come to rest.

# %%
names = match_names(part_names(hand), "index").names
tendon, joints = names["EDC"], [names[joint] for joint in ("MCP", "PIP", "DIP")]
STEP, SETTLE = 0.002, 300  # s, steps


class HeldHand:
    """A hand whose own joints do not move, and whose EDC pulls with a force of ours."""

    def __init__(self, path: Path) -> None:
        self.spec = mujoco.MjSpec.from_file(str(path))
        for actuator in self.spec.actuators:
            self.spec.delete(actuator)
        # MuJoCo's actuators push along a tendon, so that a pull is a negative gain.
        self.spec.add_actuator(
            name="pull",
            target=tendon,
            trntype=mujoco.mjtTrn.mjTRN_TENDON,
            gaintype=mujoco.mjtGain.mjGAIN_FIXED,
            gainprm=[-1.0] + 9 * [0.0],
        )
        for key in self.spec.keys:
            self.spec.delete(key)
        self.model = self.spec.compile()
        self.data = mujoco.MjData(self.model)
        own = ["_hood_" not in self.model.joint(j).name for j in range(self.model.njnt)]
        self.held = [i for i in range(self.model.nv) if own[self.model.dof_jntid[i]]]
        self.places = [self.model.jnt_qposadr[self.model.dof_jntid[i]] for i in self.held]
        self.model.dof_armature[self.held] = 1e4
        self.model.jnt_limited[:] = 0  # what is left of constraints is the hood
        self.model.opt.disableflags |= (
            mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS
        )
        self.model.opt.gravity[:], self.model.opt.timestep = 0.0, STEP

    def arm(self, angles: tuple[float, ...], force: float) -> float:
        """The torque at the PIP over the force, m, with MCP, PIP and DIP at angles (rad)."""
        model, data = self.model, self.data
        mujoco.mj_resetData(model, data)
        for joint, angle in zip(joints, angles, strict=True):
            data.joint(joint).qpos[0] = angle
        data.ctrl[0] = force
        posture = data.qpos[self.places].copy()
        for _ in range(SETTLE):
            mujoco.mj_step(model, data)
            data.qpos[self.places], data.qvel[self.held] = posture, 0.0
        mujoco.mj_forward(model, data)
        dof = model.joint(names["PIP"]).dofadr[0]
        return float(data.qfrc_actuator[dof] + data.qfrc_constraint[dof]) / force


before, after = HeldHand(hand), HeldHand(hooded)
PIP, DIPS, FORCES = np.radians(np.linspace(5, 90, 35)), (0.0, 20.0, 40.0), (1.0, 5.0, 20.0)
MCP = np.radians(30)
fixed = {dip: [1e3 * before.arm((MCP, pip, np.radians(dip)), 5.0) for pip in PIP] for dip in DIPS}
switched = {
    (dip, force): [1e3 * after.arm((MCP, pip, np.radians(dip)), force) for pip in PIP]
    for dip in DIPS
    for force in FORCES
}

figure, axes = plt.subplots(1, 3, figsize=(11, 3.8), sharey=True, layout="constrained")
for axis, dip in zip(axes, DIPS, strict=True):
    axis.plot(np.degrees(PIP), fixed[dip], "k--", label="fixed path, any force")
    looks = zip(FORCES, ("#0072b2", "#e69f00", "#009e73"), (5.0, 2.5, 1.0), strict=True)
    for force, colour, width in looks:  # thin over wide, where they lie on each other
        label = f"with hood, EDC {force:g} N"
        axis.plot(np.degrees(PIP), switched[dip, force], color=colour, lw=width, label=label)
    axis.set(title=f"DIP at {dip:g} deg", xlabel="PIP flexion, deg")
axes[0].set_ylabel("arm of EDC at the PIP, mm\n(negative: extends)")
axes[0].legend(frameon=False, fontsize="small")
figure.suptitle("Arm of EDC at the PIP by a fixed path, and by the hood (MCP at 30 deg)")
plt.show()

# %% [markdown]
# ## Fingertip forces beside measured ones
#
# `cosim score` clamps the fingertip and pulls at one muscle after another, as in the experiments of
# its collection. The hood is that of the case `network_edc`, from two papers; no number of it was
# chosen for this hand or by these measurements. In MyoSuite's hand directions come nearer to those
# measured, and sizes move away: the lumbrical, with 1.8 times the measured force on its fixed path,
# gets 3.7 times. Its arm at the MCP is an uncertain entry of a scanned table (11.5 mm). EI keeps
# its fixed path in the file, and is not judged beside a hood.

# %%
scores = score_models([hand, hooded], finger="index", workers=1)
table = scores.table
sizes = table[(table.group == "fingertip forces: size") & table.value.notna()]
wide = sizes.pivot(index="row", columns="model", values="value").reindex(sizes.row.unique())
measured = sizes.groupby("row").measured.first().reindex(wide.index)
places = np.arange(len(wide))

figure, axis = plt.subplots(figsize=(9, 3.8), layout="constrained")
axis.plot(places, measured, "k_", markersize=26, label="measured (Cohn and Valero-Cuevas 2017)")
for model, label, colour, side in (
    (hand.stem, "fixed paths", "#999999", -0.18),
    (hooded.stem, "with hood", "#0072b2", 0.18),
):
    axis.bar(places + side, wide[model], 0.34, color=colour, label=label)
words = [row.partition(":")[0].replace(" ", "\n", 1) for row in wide.index]
axis.set_xticks(places, words, fontsize="small")
axis.set(ylabel="fingertip force over tension, 1", xlabel="muscle; MCP/PIP/DIP flexion, deg")
axis.legend(frameon=False)
plt.show()
print(scores.summary[["model", "group", "skill"]].dropna().to_string(index=False))

# %% [markdown]
# ## A closed loop without a learned policy
#
# A proportional and integral controller holds the PIP joint at an angle by flexor digitorum
# profundus and EDC, in plain MuJoCo and in both hands. The gains are the same. What the DIP does
# meanwhile is the extensor's: with a fixed path its arms decide alone, with the hood the lateral
# bands go slack as the PIP flexes and let the DIP bend.

# %%
SECONDS, GAIN, INTEGRAL, BOTH = 12.0, 0.8, 1.0, 0.03  # s, 1/rad, 1/(rad s), least part of both
GREATEST_FORCE = 8.0  # N, of an actuator whose control is a force
asked = np.radians([25.0, 55.0, 35.0])  # of the PIP, 4 s each


def closed_loop(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) s, and the angles (n, 2) deg of PIP and DIP."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data, step = mujoco.MjData(model), model.opt.timestep
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    pulled = {int(model.actuator_trnid[a, 0]): a for a in range(model.nu)}
    flexor, extensor = (pulled[model.tendon(names[m]).id] for m in ("FDP", "EDC"))
    limited = model.actuator_ctrllimited.astype(bool)
    most = np.where(limited, model.actuator_ctrlrange[:, 1], GREATEST_FORCE)
    place, total, rows = model.joint(names["PIP"]).qposadr[0], 0.0, []
    dip = model.joint(names["DIP"]).qposadr[0]
    for k in range(round(SECONDS / step)):
        lacking = asked[int(3 * k * step / SECONDS)] - data.qpos[place]
        total = float(np.clip(total + step * INTEGRAL * lacking, -1.0, 1.0))
        command = float(np.clip(GAIN * lacking + total, -1.0, 1.0))
        data.ctrl[flexor] = most[flexor] * max(command, BOTH)
        data.ctrl[extensor] = most[extensor] * max(-command, BOTH)
        mujoco.mj_step(model, data)
        rows.append(np.degrees(data.qpos[[place, dip]]))
    return step * np.arange(len(rows)), np.array(rows)


figure, axes = plt.subplots(1, 2, figsize=(10, 3.6), sharex=True, layout="constrained")
for path, label, colour in ((hand, "fixed paths", "#999999"), (hooded, "with hood", "#0072b2")):
    seconds, angles = closed_loop(path)
    for axis, values in zip(axes, angles.T, strict=True):
        axis.plot(seconds, values, color=colour, label=label)
goal = np.degrees(asked[np.minimum((3 * seconds / SECONDS).astype(int), 2)])
axes[0].plot(seconds, goal, "k:", label="asked for")
axes[0].set(title="PIP, which is controlled", xlabel="time, s", ylabel="flexion, deg")
axes[1].set(title="DIP, which follows", xlabel="time, s", ylabel="flexion, deg")
axes[0].legend(frameon=False)
plt.show()
