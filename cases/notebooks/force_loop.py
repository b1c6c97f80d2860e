# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # A force controller in your own loop
#
# `cosim.Loop` steps a finger and its hood in time, as environments of reinforcement learning do:
# `reset`, `step(action)`, numbers by name. Here a proportional and integral controller holds the
# dorsal force of a fingertip with the extensor digitorum communis (EDC), over a motor that follows
# with a lag. The hood is a network of tendons; any case of a finger with mass would do.

# %%
import matplotlib.pyplot as plt
import numpy as np

import cosim

JOINTS = ("MCP", "MCP_abduction", "PIP", "DIP")
damping = {f"finger.passive.{joint}.damping": "0.003 N*m*s/rad" for joint in JOINTS}
case = cosim.load("network_edc").replace(damping)  # assumed: the case has no damping of its own
loop = cosim.Loop(case, step="2 ms")

# %% [markdown]
# What can be commanded and what is seen, with units:

# %%
for name, channel in loop.actions.items():
    print(f"{name:8} {channel.unit:4} {channel.meaning}, {channel.least:g} to {channel.most:g}")
for name in ("angle.PIP", "tip.dorsal", "tip_force.dorsal", "excursion.EDC", "slip_force.central"):
    print(f"{name:20} {loop.observations[name].unit:4} {loop.observations[name].meaning}")


# %% [markdown]
# The controller measures the force, and its motor has a lag of 60 ms. A tendon cannot push, so that
# the command stays between the resting tension and what the motor has; the sum stops there, so that
# it does not wind up.


# %%
class Controller:
    """Tension of EDC (N) for a dorsal force of the fingertip (N)."""

    proportional, integral = 4.0, 60.0  # N/N, N/(N s)
    lag, least, most = 0.06, 0.05, 12.0  # s, N, N

    def __init__(self) -> None:
        self.tension, self.sum = self.least, 0.0

    def step(self, error: float, dt: float) -> float:
        """The tension after a step, for what the force lacks."""
        wanted = self.least + self.proportional * error + self.integral * (self.sum + dt * error)
        command = min(max(wanted, self.least), self.most)
        if command == wanted:
            self.sum += dt * error
        self.tension += dt / (dt + self.lag) * (command - self.tension)
        return self.tension


# %% [markdown]
# The loop. Half-way the fingertip is asked for more than this motor has, and then for less.

# %%
STEPS = 900
time = loop.dt * np.arange(1, STEPS + 1)
asked = np.select([time < 0.6, time < 1.2], [0.3, 2.0], 0.5)
controller, seen = Controller(), loop.reset(action={"EDC": 0.05})
log = []
for wanted in asked:
    tension = controller.step(wanted - seen["tip_force.dorsal"], loop.dt)
    seen = loop.step({"EDC": tension})
    log.append([seen[name] for name in ("tip_force.dorsal", "tension.EDC", "slip_force.central")])
force, tension, slip = np.array(log).T
assert abs(force[290] - 0.3) < 0.01
assert abs(force[-1] - 0.5) < 0.01
assert tension.max() <= Controller.most

# %% [markdown]
# A step that does not converge raises `cosim.ConvergenceError` and leaves the loop where it was. A
# state that was kept can be gone back to, which is what a planner needs:

# %%
before = loop.state
first = loop.step({"EDC": 5.0})
loop.state = before
assert loop.step({"EDC": 5.0}) == first

# %%
figure, (of_force, of_tension) = plt.subplots(2, 1, sharex=True, layout="constrained")
of_force.plot(time, asked, "--", color="0.5", label="asked")
of_force.plot(time, force, color="#0072b2", label="reached")
of_tension.plot(time, tension, color="#0072b2", label="tension of EDC")
of_tension.plot(time, slip, "-.", color="#d55e00", label="central slip")
for axes in (of_force, of_tension):
    axes.grid(alpha=0.3)
    axes.legend()
of_force.set_ylabel("dorsal force, N")
of_tension.set_ylabel("force, N")
of_tension.set_xlabel("time, s")
plt.show()
