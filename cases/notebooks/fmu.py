# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # The hood in another simulator
#
# `cosim fmu` writes the hood, the finger or both as a Functional Mock-up Unit, for any simulator
# that reads FMI 2 or 3. Here FMPy loads a hood and asks it for its load on the bones. Writing needs
# `pip install '.[fmu]'`.

# %%
from pathlib import Path

from fmpy import read_model_description, simulate_fmu

import cosim
from cosim.fmu_export.write import write_fmu

case = cosim.load("pulley_edc")
path = Path("hood.fmu")
write_fmu(case, "hood", 3, path)

# %%
described = read_model_description(str(path))
[(v.name, v.causality, v.unit) for v in described.modelVariables if v.causality == "output"]

# %% [markdown]
# FMPy keeps the inputs at their start values: the poses of the case and no tension.

# %%
outputs = simulate_fmu(str(path), stop_time=0.1, output_interval=0.05)
outputs.dtype.names[:6]

# %% [markdown]
# The other way round, `hood.kind = "fmu"` and `finger.kind = "fmu"` take a unit into a case, ours
# or another's; the result is that of the native parts.
