# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # Your measurements beside the model
#
# A CSV file needs two columns: the quantity, by its path in the summary of a run, and the value
# that you measured. `sd`, `low` and `high` say how far off is too far; `source` says where the
# number is from.

# %%
from pathlib import Path

import matplotlib.pyplot as plt

import cosim

result = cosim.run(cosim.load("isometric_edc").replace({"hood.mesh.quads": 300}))
rows = """\
name,quantity,value,sd,low,high,source
Fingertip force,fingertip_magnitude_N,0.46,0.10,,,an example
Terminal over central slip,slip_ratio,,,0.5,2.0,an example
Moment arm of EDC at the PIP,moment_arm_mm.EDC.PIP,-4.0,1.0,,,an example
"""
Path("measured.csv").write_text(rows, encoding="utf-8")
beside = cosim.compare(result, data="measured.csv")
beside[["name", "model", "reference", "sd", "low", "high", "verdict"]]

# %% [markdown]
# Which quantities there are is in the summary; a misspelt one is refused, with the nearest.

# %%
try:
    Path("wrong.csv").write_text("quantity,value\nfingertip_magnitud_N,0.5\n", encoding="utf-8")
    cosim.compare(result, data="wrong.csv")
except cosim.InputError as error:
    print(error)

# %% [markdown]
# `cosim show RUN --data measured.csv -o page.html` puts the same rows into one HTML page with
# the finger in space. `cosim identify` fits parameters of a case to such rows.

# %% [markdown]
# Each number of the model over what was measured, with one SD:

# %%
known = beside.dropna(subset=["reference"])
spread = known.sd / known.reference.abs()
figure, axes = plt.subplots(figsize=(6, 2), layout="constrained")
axes.errorbar([1] * len(known), known.name, xerr=spread, fmt="|", color="black", label="measured")
axes.plot(known.model / known.reference, known.name, "o", color="#0072b2", label="model")
axes.set_xlabel("over what was measured")
axes.margins(y=0.4)
axes.legend(loc="upper left", bbox_to_anchor=(1, 1))
plt.show()
