# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # A motion that is stopped, and goes on
#
# EDC and FDP pull on a free finger whose hood is a cable over pulleys. A `Session` with a folder
# for checkpoints keeps what a motion has done; here we stop it on purpose.

# %%
import cosim

case = cosim.load(
    {
        "extends": "pulley_edc",
        "title": "A free finger under EDC",
        "finger": {"tip": {"kind": "free"}},
        "forward": {
            "duration": "60 ms",
            "step": "1 ms",
            "must_rest": False,
            "checkpoint": 10,  # steps
        },
    }
)
heard: list[str] = []


def stop_early(stage: str) -> None:
    """Interrupt the motion, as Ctrl-C does, once it has a checkpoint behind it."""
    heard.append(stage)
    if len(heard) == 20:
        raise KeyboardInterrupt


try:
    cosim.run(case, cosim.Session(checkpoints="unfinished"), stop_early)
except KeyboardInterrupt:
    print("stopped after:", heard[-1])

# %% [markdown]
# The same call goes on from the last checkpoint and ends in the same bytes as a motion that nobody
# stopped.

# %%
resumed = cosim.run(case, cosim.Session(checkpoints="unfinished"))
whole = cosim.run(case)
assert resumed.data.angle.identical(whole.data.angle)

# %% [markdown]
# The energy that the tendons put in, and where it went, in mJ.

# %%
resumed.summary["energy_mJ"]

# %% [markdown]
# Angles and fingertip force over time.

# %%
resumed.plot("history")
