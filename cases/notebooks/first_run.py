# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # A first run
#
# The extensor digitorum communis (EDC) pulls on the extensor hood of an index finger that stands at
# 30/45/15 degrees (MCP, PIP, DIP), with its fingertip held. We ask for the force that the fingertip
# makes, and for what the hood passes on to the middle and to the distal phalanx.

# %%
import cosim

case = cosim.load("isometric_edc").replace({"hood.mesh.quads": 300})  # a coarse mesh, for a start
result = cosim.run(case)
result

# %% [markdown]
# The forces on the world, in newtons, along the axes of the metacarpal; palmar is minus dorsal.

# %%
result.tip_force

# %% [markdown]
# The central slip pulls on the middle phalanx, the terminal slip on the distal one.

# %%
result.slips

# %% [markdown]
# Every result carries its own audit: the residuals of the equilibrium and the balance of all forces
# on the hood, each with the bound that it must keep.

# %%
assert result.audit.passed
result.audit.figures

# %% [markdown]
# The ledger has every force on every bone by its source; those of one bone add up to zero.

# %%
ledger = result.ledger
loaded = ledger[ledger.state == "loaded"]
loaded.groupby("body")[["force_distal", "force_radial", "force_dorsal"]].sum().abs().max()

# %% [markdown]
# ## The same under another load
#
# `replace` takes keys of the case file with their units. A wrong key or value is refused with the
# nearest one that is right.

# %%
stronger = cosim.run(case.replace({"tendons.EDC.tension": "5 N"}, name="EDC 5 N"))
table = cosim.compare(result, stronger)
table.loc[[row for row in table.index if row.startswith(("tension_N.EDC", "slip_force_N"))]]

# %%
result.plot()
