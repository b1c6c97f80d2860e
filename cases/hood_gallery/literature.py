"""What the hood's figures are compared with: published numbers, couplings of the joints, and which
postures the packaged hood was fitted in."""

from __future__ import annotations

from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np

from cases.hood_gallery.poses import JOINTS, Posture
from cosim.analyses.identify.cases import stated_cases
from cosim.case.file import find_case
from cosim.measured import measured_at, measured_of_kind
from cosim.port import Array
from cosim.text_tables import packaged_rows
from rigid.hoods.two_band import coupled_dip, lateral_band

REST_TORQUE, REST_SLIP = 3.0, 0.4
"""N mm and N: the most that a hood at rest may have."""
LEE_RATIO, LEE_BAND = measured_at("lee2008:slip_ratio").number(), (1.0, 2.5)
"""Terminal over central slip: Lee et al. 2008 (n 5), nearly constant; and the target's band."""
LEE_TENSION = 11.8
"""N of EDC, of Lee et al. 2008."""
LEAST_SHARE = 0.1
"""The part of EDC's tension that each slip is to bear at least."""
AN_HEIGHT = {
    "MCP": -measured_at("an1979:arm.EDC.MCP").number(),
    "PIP": measured_at("an1979:tendon_height.EDC.PIP").number(),
    "DIP": measured_at("an1979:tendon_height.EDC.DIP").number(),
}
"""mm of EDC over the joint's axis: An et al. 1979, in units of O2O3 = 20 mm, index finger.  That at
the DIP is the terminal slip's, of which EDC's arm is the slip's share."""
FULL_FLEXION = 80.0
"""deg of the MCP at which an angle "at full flexion" is put here; an assumption."""
YOUNG_RAYAN = {
    float(mcp) if (mcp := m.posture.partition("/")[0]) else FULL_FLEXION: m.number()
    for m in measured_of_kind("band_angle")
    if m.cited.source == "young2000"
}
"""deg of the sagittal bands' fibres from the square of the tendon, by MCP flexion: Young and Rayan
2000, 48 digits; the last is of full flexion, put at 80 deg here."""
DIP_RANGE = (0.0, 70.0)
FDP_RATIO = round(
    measured_at("nimbarte2008:rotation.FDP.DIP").number()
    / measured_at("nimbarte2008:rotation.FDP.PIP").number(),
    1,
)
"""DIP over PIP as FDP flexes a free index finger: Nimbarte et al. 2008, rounded."""
OFF = 15.0
"""deg that the DIP is moved off the two couplings."""


def buchner_dip(pip: float) -> float:
    """The DIP's angle (deg) on Buchner's coupling curve R'12/R13 PIP^2, 1.21 mm/rad over 3.5 mm."""
    return float(np.degrees(coupled_dip(np.radians(np.asarray(pip)))))


def fdp_dip(pip: float) -> float:
    """The DIP's angle (deg) as FDP flexes the finger."""
    return FDP_RATIO * pip


def buchner_height(pip: Array) -> Array:
    """The height (mm) of the lateral bands over the PIP's axis at PIP angles in deg, 5 - 2.42 PIP
    (rad): Buchner et al. 1988.  An assumption with the right ends of the range, not a
    measurement."""
    constant, slope = lateral_band()["PIP"]
    return -1e3 * (constant + slope * np.radians(pip))


COUPLINGS = {
    f"Buchner less {OFF:g} deg": lambda pip: buchner_dip(pip) - OFF,
    "Buchner": buchner_dip,
    f"{FDP_RATIO:g} PIP": fdp_dip,
    f"{FDP_RATIO:g} PIP and {OFF:g} deg": lambda pip: fdp_dip(pip) + OFF,
}
"""deg of the DIP by that of the PIP, before `DIP_RANGE` and rounding."""


def dip_on_coupling(name: str, pip: float) -> float:
    """The DIP's angle (deg) on a coupling's line, a whole number within `DIP_RANGE`."""
    return float(np.clip(round(COUPLINGS[name](pip)), *DIP_RANGE))


@cache
def fitted_postures(quantity: str) -> frozenset[Posture]:
    """Postures in which the packaged hood was fitted to quantities that contain `quantity`:
    cases/data/hood_fit.toml and hood_fit_rows.csv."""

    data = Path(str(resources.files("cases") / "data"))
    rows = [row.cells for row in packaged_rows("hood_fit_rows")]
    names = {row["case"] for row in rows if quantity in row["quantity"]}
    cases = stated_cases([find_case("hood_rest")], (), data / "hood_fit.toml")
    return frozenset(
        _posture(case.load().native_finger().posture.angles())
        for case in cases
        if "" in names or case.name in names
    )


def _posture(angles: dict[str, float]) -> Posture:
    mcp, pip, dip = (round(float(np.degrees(angles[joint])), 3) for joint in JOINTS)
    return mcp, pip, dip
