# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # A finger as an environment for learners
#
# `cosim.gym.FingerEnv` is `cosim.Loop` as an environment of Gymnasium (`pip install '.[gym]'`),
# which libraries of learners take. Nothing learns here: a random policy and a proportional and
# integral (PI) one hold the dorsal force of a fingertip with the extensor digitorum communis
# (EDC), each as well as it can. A learner can be compared with both.

# %%
import gymnasium
import matplotlib.pyplot as plt
import numpy as np

import cosim
import cosim.gym

JOINTS = ("MCP", "MCP_abduction", "PIP", "DIP")
damping = {f"finger.passive.{joint}.damping": "0.003 N*m*s/rad" for joint in JOINTS}
case = cosim.load("network_edc").replace(
    {**damping, "tendons.EDC.tension": "0.05 N", "tendons.EDC.max_force": "6 N"}
)  # assumed: damping, which the case has none of, and a motor of 6 N
ASKED = 0.3  # N

# %% [markdown]
# The reward is a function of what is observed after a step, and of the action, both by name: here
# the force that is missed, and a little for the tension. Spaces follow from the case: the action is
# a tension of EDC, from zero to what the motor has.


# %%
def reward(seen, action):
    return -abs(seen["tip_force.dorsal"] - ASKED) - 0.001 * action["EDC"]


keys = {
    "case": case,
    "reward": reward,
    "step": "4 ms",
    "duration": "0.6 s",
    "commanded": ("EDC",),
    "observed": ("time", "angle.PIP", "rate.PIP", "tip_force.dorsal", "tension.EDC"),
    "spread": "3 deg",
}
env = gymnasium.make("cosim/Finger-v0", **keys)
print(env.action_space)
print(env.observation_space)

# %% [markdown]
# A policy is what gives an action for an observation. The random one draws from the action space;
# the other adds up what is missed, and stops adding where the motor has no more.


# %%
class RandomPolicy:
    """Any tension that the motor has."""

    def __init__(self, space, seed):
        self.random, self.space = np.random.default_rng(seed), space

    def __call__(self, seen):
        return self.random.uniform(self.space.low, self.space.high)


class PIPolicy:
    """Tension by the force that is missed, and by its sum over time."""

    proportional, integral = 2.0, 150.0  # N/N, N/(N s)

    def __init__(self, space, dt):
        self.low, self.high, self.dt, self.sum = space.low, space.high, dt, 0.0

    def __call__(self, seen):
        error = ASKED - seen["tip_force.dorsal"]
        wanted = self.proportional * error + self.integral * (self.sum + self.dt * error)
        tension = np.clip(wanted, self.low, self.high)
        if tension == wanted:
            self.sum = self.sum + self.dt * error
        return tension


# %% [markdown]
# Three episodes each, from the same seeds: they begin in the same postures, up to 3 degrees off
# the case's.


# %%
def episode(policy, seed):
    """The sum of the rewards, and time, force and tension over the steps."""
    seen, _ = env.reset(seed=seed)
    total, log, is_over = 0.0, [], False
    while not is_over:
        seen, gained, terminated, truncated, info = env.step(policy(seen))
        assert not info  # of a step that does not converge it says why
        total += gained
        log.append([seen[name].item() for name in ("time", "tip_force.dorsal", "tension.EDC")])
        is_over = terminated or truncated
    return total, np.array(log).T


dt = env.unwrapped.loop.dt
policies = {
    "random": lambda seed: RandomPolicy(env.action_space, seed),
    "PI": lambda seed: PIPolicy(env.action_space, dt),
}
episodes = {name: [episode(new(seed), seed) for seed in range(3)] for name, new in policies.items()}
for name, of in episodes.items():
    print(f"{name:8}" + "".join(f"{total:10.1f}" for total, _ in of))
assert max(total for total, _ in episodes["random"]) < min(total for total, _ in episodes["PI"])
assert all(abs(log[1, -1] - ASKED) < 0.03 for _, log in episodes["PI"])

# %% [markdown]
# Several at once: observations, rewards and ends are arrays. With `vectorization_mode="async"` each
# has a process of its own.

# %%
several = gymnasium.make_vec("cosim/Finger-v0", num_envs=3, vectorization_mode="sync", **keys)
seen, _ = several.reset(seed=0)
for _ in range(20):
    seen, gained, *_ = several.step(several.action_space.sample())
print(seen["tip_force.dorsal"].ravel(), gained)
several.close()

# %%
figure, (of_force, of_tension) = plt.subplots(2, 1, sharex=True, layout="constrained")
for (name, of), colour in zip(episodes.items(), ("#d55e00", "#0072b2"), strict=True):
    for k, (_, (time, force, tension)) in enumerate(of):
        style = {
            "color": colour,
            "alpha": 0.5 if name == "random" else 1.0,
            "label": name if k == 0 else None,
        }
        of_force.plot(time, force, **style)
        of_tension.plot(time, tension, **style)
of_force.axhline(ASKED, linestyle="--", color="0.5", label="asked")
for axes in (of_force, of_tension):
    axes.grid(alpha=0.3)
    axes.legend()
of_force.set_ylabel("dorsal force, N")
of_tension.set_ylabel("tension of EDC, N")
of_tension.set_xlabel("time, s")
plt.show()
