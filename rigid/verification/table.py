"""The studies that verify fingers, muscles, devices and files."""

from __future__ import annotations

from cosim.checks import Study
from rigid.verification import dynamics_rows, finger_rows, muscle_rows, osim_rows

STUDIES = (
    Study("muscles", muscle_rows.rows),
    Study("OpenSim file, imported", osim_rows.rows),
    Study("planar finger", finger_rows.planar_rows),
    Study("devices, twin, rest", dynamics_rows.rows),
    Study("middle finger", finger_rows.single_tendon_rows),
    Study("free finger", finger_rows.free_motion_rows),
)
