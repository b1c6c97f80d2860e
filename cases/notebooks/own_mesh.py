# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # A hood mesh and bones of your own
#
# `cosim new` makes a case of files that you have: a mesh of quads with named sets (Abaqus .inp,
# .feb, gmsh .msh, .vtu) and four closed surfaces of bones (.stl, .obj). Here the files are those of
# the shipped example `own_edc`, which stand for yours.

# %%
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

import meshio

import cosim

own = Path(str(files("cases") / "own"))
mesh = meshio.read(own / "hood.inp")
mesh

# %% [markdown]
# The sets name the regions of the hood, its ends where tendons pull, the nodes that are tied to
# bones and those that springs hold. Sets with other names are mapped by `--set-name OURS=YOURS`.

# %%
print("quads:", *sorted(mesh.cell_sets))
print("nodes:", *sorted(mesh.point_sets))

# %% [markdown]
# The command says what it found, what it assumed, and what it dropped. Read this before any number.

# %%
bones = [str(own / f"{bone}.stl") for bone in ("metacarpal", "proximal", "middle", "distal")]
words = ["cosim", "new", "mine", "--hood", str(own / "hood.inp"), "--bones", *bones]
done = subprocess.run([sys.executable, "-m", *words], capture_output=True, check=True)
print(done.stdout.decode("utf-8"))

# %% [markdown]
# The case is a text file that extends the whole index finger; what it does not say is the base
# case's. We pull on EDC and look: does the sheet lie on the bones, do the fibres run along the
# slips?

# %%
case = cosim.load("mine/mine.toml").replace({"tendons.EDC.tension": "3 N"})
result = cosim.run(case)
assert result.audit.passed
result.tip_force, result.slips

# %%
result.plot()
