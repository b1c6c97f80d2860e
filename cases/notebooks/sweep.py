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
tensions = [1.0, 2.0, 3.0, 4.0, 5.0]
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
# For thousands of points, with distributions and sensitivity indices, write a study file:
# `cosim study network_saltelli --workers 2` is one. `cosim sensitivity CASE` varies what a case
# assumes, one thing at a time.

# %%
figure, axes = plt.subplots(layout="constrained")
table.plot(ax=axes, marker="o", xlabel="tension of EDC, N", ylabel="force, N")
plt.show()
