"""The studies that verify hoods in lumped form."""

from __future__ import annotations

from cosim.checks import Study
from rigid.verification import contact_rows, hood_rows, network_study_rows, sharing_rows

STUDIES = (
    Study("network", hood_rows.network_rows),
    Study("two bands", hood_rows.two_band_rows),
    Study("point contact", contact_rows.rows),
    Study("force sharing", sharing_rows.rows),
    Study("switch", network_study_rows.switch_rows),
    Study("identification", network_study_rows.identification_rows),
    Study("inverse prediction", network_study_rows.inverse_rows),
    Study("virtual testbed", network_study_rows.testbed_rows),
)
