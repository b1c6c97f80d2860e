# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # The hood in another simulator
#
# `cosim export` writes the hood, the finger or both as a Functional Mock-up Unit, for any simulator
# that reads FMI 2 or 3. Here FMPy loads a hood and asks it for its load on the bones. Writing needs
# `pip install '.[fmu]'`.

# %%
import shutil
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from fmpy import extract, instantiate_fmu, read_model_description

import cosim
from cosim.fmu_export.write import write_fmu

case = cosim.load("pulley_edc")
path = Path("hood.fmu")
write_fmu(case, "hood", 3, path)

# %%
described = read_model_description(str(path))
[(v.name, v.causality, v.unit) for v in described.modelVariables if v.causality != "parameter"]

# %% [markdown]
# The poses of the bones keep their start values, those of the case; the tension of EDC goes up. The
# unit gives the force on each bone from each source: the tendons, and the points that guide them.

# %%
place = {variable.name: variable.valueReference for variable in described.modelVariables}
folder = extract(str(path))
unit = instantiate_fmu(folder, described, fmi_type="CoSimulation")
unit.enterInitializationMode(startTime=0.0)
unit.exitInitializationMode()

pulls, step = np.linspace(0.5, 5.0, 10), 0.1  # N, s
forces = []
for k, pull in enumerate(pulls):
    unit.setFloat64([place["tension"]], [pull, 0.0, 0.0, 0.0])
    unit.doStep(k * step, step)
    force = np.array(unit.getFloat64([place["force"]], nValues=24)).reshape(4, 2, 3)
    forces.append(np.linalg.norm(force.sum(axis=1), axis=1))
unit.terminate()
unit.freeInstance()
shutil.rmtree(folder)

# %% [markdown]
# A cable without friction passes its tension on: what a bone bears is in proportion to the pull.

# %%
forces = np.array(forces)
assert np.allclose(forces / pulls[:, None], forces[-1] / pulls[-1])

# %% [markdown]
# The other way round, `hood.kind = "fmu"` and `finger.kind = "fmu"` take a unit into a case, ours
# or another's; the result is that of the native parts.

# %%
figure, axes = plt.subplots(layout="constrained")
for bone, size in zip(("metacarpal", "proximal", "middle", "distal"), forces.T, strict=True):
    axes.plot(pulls, size, "o-", label=f"{bone} bone")
axes.set(xlabel="tension of EDC, N", ylabel="force of the hood on the bone, N")
axes.legend()
plt.show()
