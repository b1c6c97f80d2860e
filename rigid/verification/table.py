"""The studies that verify fingers, muscles, devices and files, and hoods in lumped form."""

from __future__ import annotations

from cosim.checks import Study
from rigid.verification import (
    contact_rows,
    dynamics_rows,
    finger_rows,
    friction_rows,
    hood_rows,
    muscle_rows,
    network_study_rows,
    osim_rows,
    sharing_rows,
)

FINGER_STUDIES = (
    Study("muscles", muscle_rows.rows),
    Study("OpenSim file, imported", osim_rows.rows),
    Study("planar finger", finger_rows.planar_rows),
    Study("devices, twin, rest", dynamics_rows.rows),
    Study("middle finger", finger_rows.single_tendon_rows),
    Study("free finger", finger_rows.free_motion_rows),
    Study("friction of tendons", friction_rows.rows),
)
HOOD_STUDIES = (
    Study("network", hood_rows.network_rows),
    Study("two bands", hood_rows.two_band_rows),
    Study("point contact", contact_rows.rows),
    Study("force sharing", sharing_rows.rows),
    Study("switch", network_study_rows.switch_rows),
    Study("identification", network_study_rows.identification_rows),
    Study("inverse prediction", network_study_rows.inverse_rows),
    Study("virtual testbed", network_study_rows.testbed_rows),
)
