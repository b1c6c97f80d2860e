"""What a sensitivity study varies of a shell hood; the study itself says why."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from cosim.hoods.kind import HoodKind
from cosim.hoods.shell.table import MaterialConfig, ShellHoodConfig
from cosim.hoods.variation import (
    Settings,
    Side,
    Variation,
    format_si,
    no_variation,
    scale,
    settings_text,
    shift,
    words,
)
from cosim.hoods.view import STRAIN, Colour
from cosim.schema import units
from meshes.hood_mesh import REGIONS, has_lateral_fibres

ABSENT = "1e-6 N/mm"
"""Stiffness of a ligament that is not there."""
SECTION_RANGE = (0.3e-6, 1.8e-6)
"""m2."""
COEFFICIENTS = (0.1, 0.3)
"""Coefficients of friction for a case that has none."""
CROSSED = ("lateral_slip", "oblique_fibres")
"""What a region's name begins with that is a sheet of crossing fibres."""
SHEETS = tuple(name for name in REGIONS if has_lateral_fibres(name) or name.startswith(CROSSED))
"""Regions that are no cables and so have no cross-section of their own."""
LIGAMENTS = {
    "radial adhesion": ("ligament_radial",),
    "ulnar adhesion": ("ligament_ulnar",),
    "sagittal bands' ends": ("sagittal_radial", "sagittal_ulnar"),
    "sagittal bands' hold sideways": ("sagittal_hold_radial", "sagittal_hold_ulnar"),
    "interosseous hood": ("interosseous_hood_radial", "interosseous_hood_ulnar"),
    "retinacular ligaments": ("retinacular_radial", "retinacular_ulnar"),
    "oblique retinacular ligaments": ("oblique_retinacular_radial", "oblique_retinacular_ulnar"),
}
MODULI = {
    "isotropic": ("modulus",),
    "neo_hookean": ("modulus",),
    "transversely_isotropic": ("modulus_along", "modulus_across", "shear_modulus", "modulus"),
    "trans_iso_mooney_rivlin": ("c1", "c2", "c3", "c5", "bulk_modulus"),
    "holzapfel_gasser_ogden": ("c", "k1", "bulk_modulus"),
}
ACROSS = {
    "transversely_isotropic": ("modulus_across", "shear_modulus"),
    "trans_iso_mooney_rivlin": ("c1", "c2"),
    "holzapfel_gasser_ogden": ("c",),
}
"""What acts across the fibres and in shear."""


def variations(hood: ShellHoodConfig) -> Iterator[Variation]:
    """The variations of a shell hood in a fixed order; what does not apply to it says why."""
    yield scale("modulus", _fields(hood, MODULI), (0.5, 1.5), units.PRESSURE)
    yield _bending(hood)
    yield _thickness(hood)
    yield _sections(hood)
    yield _across(hood)
    yield _toe(hood)
    for slip, length in hood.extra_length:
        key = f"hood.extra_length.{slip}"
        yield shift(f"rest length of the {words(slip)}", {key: length}, 2e-4, units.LENGTH)
    for name, sets in LIGAMENTS.items():
        yield from _ligament(hood, name, [s for s in sets if s in hood.springs])
    if hood.contact.layer is not None:
        moduli = {f"hood.contact.layer.{place}": modulus for place, modulus in hood.contact.layer}
        yield scale("modulus of the tissue under the hood", moduli, (0.3, 3.0), units.PRESSURE)
    for body, offset in hood.contact.offset:
        key = f"hood.contact.offset.{body}"
        yield shift(f"contact offset, {body}", {key: offset}, 3e-4, units.LENGTH, 0.0)
    yield _friction(hood)
    yield from _mesh(hood)


def scale_moduli(hood: ShellHoodConfig, factor: float) -> Settings:
    """What multiplies all moduli of the regions by `factor`, those of second families too."""
    values = _fields(hood, MODULI)
    return settings_text(((key, factor * value) for key, value in values.items()), units.PRESSURE)


def _bending(hood: ShellHoodConfig) -> Variation:
    if not hood.bending_stiffness:
        return no_variation("bending stiffness", "the sheet bends as its materials do")
    key = {"hood.bending_stiffness": hood.bending_stiffness}
    return scale("bending stiffness", key, (0.5, 2.0), units.TORQUE)


def _thickness(hood: ShellHoodConfig) -> Variation:
    regions = {f"hood.regions.{n}.thickness": r.thickness for n, r in hood.regions.items()}
    sections = {f"hood.regions.{n}.section": r.section for n, r in hood.regions.items()}
    factors = (0.5, 1.5)
    every = scale("thickness", {"hood.thickness": hood.thickness, **regions}, factors, units.LENGTH)
    more = scale("", sections, factors, units.AREA)
    low = Side(every.low.label, every.low.settings + more.low.settings)
    return Variation(
        "thickness", low, Side(every.high.label, every.high.settings + more.high.settings)
    )


def _sections(hood: ShellHoodConfig) -> Variation:
    cables = {n: r for n, r in hood.regions.items() if n not in SHEETS}
    thick = [n for n, r in cables.items() if r.thickness is not None]
    if thick:
        return no_variation("sections", f"{', '.join(thick)}: their thickness is given instead")

    def side(area: float) -> Side:
        text = format_si(area, units.AREA)
        return Side(text, tuple(f"hood.regions.{n}.section={text}" for n in cables))

    return Variation("sections of the tendons", *map(side, SECTION_RANGE))


def _across(hood: ShellHoodConfig) -> Variation:
    name = "stiffness across fibres"
    fields = _fields(hood, ACROSS)
    if fields:
        return scale(name, fields, (0.5, 2.0), units.PRESSURE)
    even = {n: r for n, r in hood.regions.items() if r.kind == "isotropic"}
    if not even:
        return no_variation(name, "no region has fibres")
    tenth = tuple(f"hood.regions.{n}={_tenth(r)}" for n, r in even.items())
    return Variation(name, Side("a tenth of that along", tenth), Side("", why_not="isotropic"))


def _tenth(region: MaterialConfig) -> str:
    """The isotropic law with a tenth of its modulus across and of its shear modulus."""
    values = dict(region)
    modulus, ratio = values["modulus"], values["poisson"]
    along, across = format_si(modulus, units.PRESSURE), format_si(modulus / 10, units.PRESSURE)
    shear = format_si(modulus / (20 * (1 + ratio)), units.PRESSURE)
    return (
        f'{{ kind = "transversely_isotropic", modulus_along = "{along}", modulus_across = '
        f'"{across}", shear_modulus = "{shear}", poisson = {ratio!r}, poisson_across = {ratio!r} }}'
    )


def _toe(hood: ShellHoodConfig) -> Variation:
    """The stretch at which fibres are straight; the modulus runs on smoothly into c5."""
    name = "toe of the fibres"
    fibres = {n: r for n, r in hood.regions.items() if r.kind == "trans_iso_mooney_rivlin"}
    if not fibres:
        return no_variation(name, "no region has a law with a toe")

    def side(factor: float) -> Side:
        return Side(
            f"x {factor:g}",
            tuple(
                setting
                for n, r in fibres.items()
                for part, law in ((n, r), (f"{n}.second", r.second))
                if law is not None
                for setting in toe_settings(part, law.c5, law.c4, factor * (law.lam_max - 1))
            ),
        )

    return Variation(name, side(0.5), side(1.5))


def toe_settings(region: str, c5: float, c4: float, toe: float) -> Settings:
    """Fibres that are straight at a stretch of 1 + toe, with the c3 for which the modulus along
    them, c3 c4 exp(c4 (l - 1)), runs smoothly into c5 (Pa) there."""
    from math import exp

    key = f"hood.regions.{region}"
    c3 = c5 / (c4 * exp(c4 * toe))
    return (
        f"{key}.lam_max={1 + toe!r}",
        f"{key}.c4={c4!r}",
        f"{key}.c3={format_si(c3, units.PRESSURE)}",
    )


def _ligament(hood: ShellHoodConfig, name: str, sets: list[str]) -> Iterator[Variation]:
    if not sets:
        yield no_variation(name, "the hood has no such springs")
        return
    key = "hood.springs"
    stiffness = {f"{key}.{s}.stiffness": hood.springs[s].stiffness for s in sets}
    slack = {f"{key}.{s}.slack": hood.springs[s].slack for s in sets}
    yield scale(f"{name}, stiffness", stiffness, (0.5, 2.0), units.STIFFNESS)
    yield shift(f"{name}, slack", slack, 1e-3, units.LENGTH, 0.0)
    taut = tuple(f"{text}=0 mm" for text in slack)
    loose = any(slack.values())
    yield Variation(
        f"{name}, presence",
        Side("absent", tuple(f"{text}={ABSENT}" for text in stiffness)),
        Side("taut as laid out", taut) if loose else Side("", why_not="taut as it is"),
    )


def _friction(hood: ShellHoodConfig) -> Variation:
    name, key, friction = "friction over the bones", "hood.contact.friction", hood.contact.friction
    if friction:
        return scale(name, {key: friction}, (0.5, 2.0), None)
    return Variation(
        name, *(Side(f"{mu:g}", settings_text([(key, mu)], None)) for mu in COEFFICIENTS)
    )


def _mesh(hood: ShellHoodConfig) -> Iterator[Variation]:
    mesh = hood.mesh
    if mesh.kind != "generated":
        yield no_variation("mesh", "it is a file")
        return
    sides = (Side(f"x {m}", (f"hood.mesh.quads={m * mesh.quads}",)) for m in (2, 4))
    yield Variation("quads of the mesh", *sides)
    step = units.parse("5 deg", units.ANGLE)
    for joint in ("MCP", "PIP", "DIP"):
        angle = {f"hood.mesh.rest_posture.{joint}": mesh.rest_posture.angles()[joint]}
        yield shift(f"stress-free posture, {joint}", angle, step, units.ANGLE)


def _fields(hood: ShellHoodConfig, wanted: Mapping[str, tuple[str, ...]]) -> dict[str, float]:
    """Key -> value of the fields that every region's law and its second family have."""
    return {
        f"hood.regions.{name}.{part}{field}": value
        for name, region in hood.regions.items()
        for part, law in (("", region), ("second.", getattr(region, "second", None)))
        for field in wanted.get(region.kind, ())
        if (value := getattr(law, field, None)) is not None
    }


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
