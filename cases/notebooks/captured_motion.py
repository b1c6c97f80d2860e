# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # A captured flexion, followed by all muscles
#
# Cameras saw markers on a finger. Which muscle forces make this motion, and does the finger do it
# under them? Here the markers are those of a trial that comes with the program. It was made, not
# captured: by known angles, and with 0.3 mm of noise.

# %%
from pathlib import Path

import numpy as np
import pandas as pd

import cases
import cosim

trial = Path(cases.__file__).parent / "motion"
damped = {"damping": "0.002 N*m*s/rad"}
case = cosim.load(
    {
        "extends": "free_split_edc",
        "title": "A finger that follows a motion",
        "finger": {"passive": {"MCP": damped, "PIP": damped, "DIP": damped}},
        "forward": {"step": "2 ms", "duration": "1 s", "must_rest": False},
    }
)

# %% [markdown]
# `track` finds the angles that the markers show, smooths them, and moves the finger along them:
# every 10 ms it compares the finger with the motion and plans the tensions anew. What comes back
# is the case that runs under these tensions; it knows nothing of the motion any more.

# %%
found = cosim.track(
    case,
    trial / "flexion.trc",
    "tracked",
    markers=trial / "flexion_markers.csv",
    cutoff="6 Hz",
)
result = cosim.run(found)

# %% [markdown]
# By how much the run misses the motion, in degrees: the root of the mean square of each joint.

# %%
(folder,) = Path("tracked").iterdir()
wanted = pd.read_csv(folder / "estimate.csv").filter(like="_wanted_deg")
angle = np.degrees(result.data.angle)
missed = np.sqrt(((angle - wanted.to_numpy()) ** 2).mean("time"))
assert float(missed.max()) < 2.0
missed.to_series().round(2)

# %% [markdown]
# The shipped case `motion_flexion` is what this gives with the shell hood: it takes some minutes,
# and its film and page show force and strain over the motion:
#
#     cosim run motion_flexion
#     cosim show runs/motion_flexion -o flexion.gif
#     cosim show runs/motion_flexion -o flexion.html

# %% [markdown]
# The tensions, which stay between zero and what each muscle can pull.

# %%
tension = result.data.own_tension.to_pandas()
tension.plot(xlabel="time, s", ylabel="tension, N", title="Tensions that flex the finger")
