"""The kind of hood that is a sheet of shell elements: all of it that needs no solver."""

from __future__ import annotations

from cosim.hoods.kind import HoodKind
from cosim.hoods.shell.table import ShellHoodConfig
from cosim.hoods.shell.variation import scale_moduli, variations
from cosim.hoods.view import STRAIN, Colour

_COLOURS: tuple[tuple[str, str, str, tuple[str, int | None], float, str, float, bool], ...] = (
    ("along", "Green-Lagrange strain along the fibres", "%", ("strain", 0), 100, STRAIN, 100, True),
    (
        *("across", "Green-Lagrange strain across the fibres", "%"),
        *(("strain", 1), 100, "transverse_strain", 100, True),
    ),
    ("shear", "Green-Lagrange shear strain", "%", ("strain", 2), 50, "shear_strain", 100, True),
    (
        *("stress_along", "Stress along the fibres (2nd P-K)", "MPa"),
        *(("stress", 0), 1e-6, "fibre_stress", 1e-6, True),
    ),
    (
        *("stress_across", "Stress across the fibres (2nd P-K)", "MPa"),
        *(("stress", 1), 1e-6, "transverse_stress", 1e-6, True),
    ),
    (
        *("pressure", "Contact pressure", "MPa"),
        *(("pressure", None), 1e-6, "contact_pressure", 1e-6, False),
    ),
    (
        *("energy_density", "Strain energy density", "kJ/m3"),
        *(("strain_energy_density", None), 1e-3, "strain_energy_density", 1e-3, False),
    ),
    (
        *("thickness_stretch", "Stretch of the thickness", ""),
        *(("thickness_stretch", None), 1, "thickness_stretch", 1, False),
    ),
    (
        *("tension_state", "Tension field: 0 taut, 1 wrinkled, 2 slack (-1: bears compression)"),
        *("", ("tension_state", None), 1, "tension_state", 1, False),
    ),
)
COLOURS = tuple(Colour(*row) for row in _COLOURS)
KIND = HoodKind(
    ShellHoodConfig, "cosim.hoods.shell.build:BUILDER", COLOURS, variations, scale_moduli
)
