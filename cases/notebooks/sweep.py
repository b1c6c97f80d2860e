# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # A sweep
#
# One case at many tensions, with the hood as a network of tendons, which is solved in milliseconds.
# `run_many` shares the models and the unloaded equilibrium among cases that differ only in their
# tendons, and gives the same bytes for any number of `workers`.

# %%
import matplotlib.pyplot as plt
import pandas

import cosim

case = cosim.load("network_edc")
tensions = [1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0]
results = cosim.run_many(
    [case.replace({"tendons.EDC.tension": f"{n} N"}, name=f"{n:g} N") for n in tensions]
)

# %%
table = pandas.DataFrame([result.tip_force for result in results], index=tensions)
table["central slip"] = [result.slips["central"] for result in results]
table["terminal slip"] = [result.slips["terminal"] for result in results]
table

# %% [markdown]
# The more EDC pulls, the harder the slips pull.

# %%
assert table["central slip"].is_monotonic_increasing

# %% [markdown]
# Over postures a result should be a smooth curve. `plot_over` draws quantities over a parameter of
# the case, leaves a gap where a run failed, and says how rough each is: the rms of what a cubic
# leaves.

# %%
postures = [
    case.replace({"finger.posture.PIP": f"{angle} deg"}, name=f"{angle} deg")
    for angle in range(30, 61, 2)
]
cosim.plot_over(
    cosim.run_many(postures, keep_errors=True),
    "finger.posture.PIP",
    ["fingertip_force_N.distal", "fingertip_force_N.dorsal", "joint_torque_Nmm.hood.PIP"],
)

# %% [markdown]
# For thousands of points, with distributions and sensitivity indices, write a study file:
# `cosim study network_saltelli --workers 2` is one. `cosim study --sensitivity CASE` varies what a
# case assumes, one thing at a time.

# %%
figure, axes = plt.subplots(layout="constrained")
table.plot(ax=axes, marker="o", xlabel="tension of EDC, N", ylabel="force, N")
plt.show()
