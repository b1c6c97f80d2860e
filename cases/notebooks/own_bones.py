# ---
# jupyter:
#   jupytext:
#     formats: py:percent
# ---

# %% [markdown]
# # From a segmentation to a result
#
# What a scan gives is a volume of labels: which voxel is which bone. Here the volume is made from
# our own bones, 0.5 mm to a voxel, and turned as a hand lies in a scanner; it stands for yours.
# (pyvista, of the extra `view`, makes volumes and surfaces here; any program that segments does.)

# %%
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyvista
from scipy.spatial.transform import Rotation

import cosim
from meshes.bones import bone_surface

VOXEL = 0.5  # mm
turn = Rotation.from_euler("xyz", [20, -35, 70], degrees=True).as_matrix()
bones = ("metacarpal", "proximal", "middle", "distal")


def scan(bone):
    """A volume of zeros and ones, mm: what is inside the bone."""
    points, triangles = bone_surface(bone)
    surface = pyvista.PolyData.from_regular_faces(1e3 * points @ turn.T, triangles.tolist())
    low, high = np.array(surface.bounds).reshape(3, 2).T
    volume = pyvista.ImageData(
        dimensions=np.ceil((high - low) / VOXEL + 9).astype(int),
        spacing=3 * [VOXEL],
        origin=low - 4 * VOXEL,
    )
    distance = volume.compute_implicit_distance(surface)["implicit_distance"]
    volume["label"] = (distance < 0).astype(float)
    return volume


volumes = {bone: scan(bone) for bone in bones}
{bone: int(volume["label"].sum()) for bone, volume in volumes.items()}

# %% [markdown]
# A surface through a smoothed label has no steps of voxels. Each bone is a file of its own, closed,
# in mm. They may lie anywhere; the four need no common origin.

# %%
for bone, volume in volumes.items():
    smooth = volume.gaussian_smooth(std_dev=1.0, scalars="label")
    surface = smooth.contour([0.5], scalars="label").triangulate().clean()
    assert surface.is_manifold
    surface.save(f"{bone}.stl")
    print(bone, surface.n_cells, "triangles")

# %% [markdown]
# The command lays our bones on yours, finds the joints, carries the tendons over, lays the hood.
# Read what it says before any number: the distances after each fit, what the heads show of the
# joints, and how the slips came out. `mine/mine.html` shows it.

# %%
words = ["cosim", "new", "mine", "--finger-kind", "index", "--hand", "right"]
words += ["--bones", *(f"{bone}.stl" for bone in bones)]
done = subprocess.run([sys.executable, "-m", *words], capture_output=True, check=True)
print(done.stdout.decode("utf-8"))
assert Path("mine/mine.html").is_file()

# %% [markdown]
# The case extends the whole index finger. EDC at 10 %, beside our own finger: these are our bones,
# so that what differs is what the voxels cost.

# %%
yours, ours = (
    cosim.run(cosim.load(case, ["tendons.EDC.activation=0.1"]))
    for case in ("mine/mine.toml", "base/index_finger.toml")
)
assert yours.audit.passed
cosim.compare(yours, ours).loc[lambda table: table.index.str.startswith("fingertip_force_N")]

# %%
yours.plot()
