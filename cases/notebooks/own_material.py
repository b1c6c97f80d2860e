# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # A material of your own
#
# Each region of the hood has a material law. `cosim list materials` has them all; `cosim explain
# hood.regions.central_slip` says what the numbers of each are. Here the central slip becomes a
# plain isotropic sheet, soft and stiff, and we look at what that does to the strain.

# %%
import cosim

case = cosim.load("isometric_edc").replace({"hood.mesh.quads": 300})


def with_modulus(text: str) -> cosim.Case:
    """The case with an isotropic central slip of this modulus."""
    law = {"kind": "isotropic", "modulus": text, "poisson": 0.4}
    return case.replace({"hood.regions.central_slip": law}, name=f"central slip {text}")


soft, stiff = cosim.run_many([with_modulus("20 MPa"), with_modulus("200 MPa")])

# %% [markdown]
# Longitudinal is along the finger, lateral across it. These are the strains of the hood's central
# region, in per cent.

# %%
soft.strain

# %%
stiff.strain

# %% [markdown]
# A softer central slip leaves more of the load to the terminal slip.

# %%
assert soft.slips["central"] < stiff.slips["central"]
{"soft": soft.slips, "stiff": stiff.slips}

# %% [markdown]
# All arrays are in `data`, with names and units: strains of each quad along and across its fibres,
# forces of the springs, contact pressure.

# %%
stiff.data.strain

# %%
stiff.plot()
