"""What the sensitivity study varies: pairs of settings of what a case has, each with its reason.

Ranges are those of issue and literature where there are any, and else assumptions: moduli and
joint stiffness +-50 %, cross-sections 0.3 to 1.8 mm2 (what network models of the hood take for its
parts: Dogadov et al., arXiv:2507.15389), rest lengths +-0.2 mm, contact offsets +-0.3 mm, postures
+-5 deg, meshes of 2 and 4 times the quads; bending, springs, limits, friction and fibres by factors
of 2, slack by 1 mm.  A hood that slides without friction gets a coefficient of 0.1 and of 0.3.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from cosim.case.schema import Case
from cosim.fingers.fmu import FmuFinger
from cosim.hoods.shell.table import Material, ShellHood
from cosim.hoods.split import SplitHood
from cosim.schema import units
from cosim.schema.units import Kind
from meshes.hood_mesh import REGIONS, runs_round

Settings = tuple[str, ...]
ABSENT = "1e-6 N/mm"
"""Stiffness of a ligament that is not there."""
SECTION_RANGE = (0.3e-6, 1.8e-6)
"""m2."""
COEFFICIENTS = (0.1, 0.3)
"""Of friction, where a case has none."""
CROSSED = ("lateral_slip", "oblique_fibres")
"""What a region's name begins with that is a sheet of crossing fibres."""
SHEETS = tuple(name for name in REGIONS if runs_round(name) or name.startswith(CROSSED))
"""Regions that are no cables and so have no cross-section of their own."""
LIGAMENTS = {
    "radial adhesion": ("ligament_radial",),
    "ulnar adhesion": ("ligament_ulnar",),
    "sagittal bands' ends": ("sagittal_radial", "sagittal_ulnar"),
    "retinacular ligaments": ("retinacular_radial", "retinacular_ulnar"),
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


@dataclass(frozen=True)
class Side:
    """One end of a variation: what is set, in short, and the settings; or why there is no such
    end."""

    label: str
    settings: Settings = ()
    why_not: str = ""


@dataclass(frozen=True)
class Variation:
    """Something that the case assumes, at a lower and a higher value."""

    name: str
    low: Side
    high: Side


def variations(case: Case) -> tuple[Variation, ...]:
    """All that this study varies, in a fixed order; what does not apply to the case says why."""
    return (*_of_hood(case), *_of_finger(case))


def _of_hood(case: Case) -> Iterator[Variation]:
    hood = case.hood
    if isinstance(hood, SplitHood):
        yield _added("central slip's share", {"hood.central": hood.central}, 0.1, None)
    if not isinstance(hood, ShellHood):
        for name in ("modulus", "thickness", "mesh"):
            yield _without(name, f"a hood of kind {hood.kind!r} has none")
        return
    yield _scaled("modulus", _fields(hood, MODULI), (0.5, 1.5), units.PRESSURE)
    yield _bending(hood)
    yield _thickness(hood)
    yield _sections(hood)
    yield _across(hood)
    yield _toe(hood)
    for slip, length in hood.extra_length:
        key = f"hood.extra_length.{slip}"
        yield _added(f"rest length of the {_words(slip)}", {key: length}, 2e-4, units.LENGTH)
    for name, sets in LIGAMENTS.items():
        yield from _ligament(hood, name, [s for s in sets if s in hood.springs])
    for body, offset in hood.contact.offset:
        key = f"hood.contact.offset.{body}"
        yield _added(f"contact offset, {body}", {key: offset}, 3e-4, units.LENGTH, 0.0)
    yield _friction(hood)
    yield from _mesh(hood)


def _of_finger(case: Case) -> Iterator[Variation]:
    finger = case.finger
    if isinstance(finger, FmuFinger):
        yield _without("posture", "the finger is an FMU, which holds its posture")
        return
    held = "the bones are held" if finger.tip.kind == "posture" else ""
    stiff = {
        f"finger.passive.{joint}.stiffness": p.stiffness
        for joint, p in finger.passive.items()
        if p.stiffness
    }
    limit = finger.limit
    if held or not stiff:
        yield _without("joint stiffness", held or "no joint has a linear stiffness")
    else:
        yield _scaled("joint stiffness", stiff, (0.5, 1.5), units.JOINT_STIFFNESS)
    if held or limit is None:
        yield _without("limit law", held or "the finger has no limit")
    else:
        free, stiffness = limit.half_range, limit.stiffness
        key = "finger.limit"
        yield _scaled("limit's half range", {f"{key}.half_range": free}, (0.5, 2.0), units.ANGLE)
        slope = {f"{key}.stiffness": stiffness}
        yield _scaled("limit's stiffness", slope, (0.5, 2.0), units.LIMIT_STIFFNESS)
    for joint in ("MCP", "PIP", "DIP"):
        angle = finger.posture.angles()[joint]
        step = units.parse("5 deg", units.ANGLE)
        yield _added(f"posture, {joint}", {f"finger.posture.{joint}": angle}, step, units.ANGLE)


def scaled_moduli(case: Case, factor: float) -> Settings:
    """What multiplies all moduli of a sheet's regions by `factor`, those of second families too;
    nothing of a hood that is no sheet."""
    if not isinstance(case.hood, ShellHood):
        return ()
    values = _fields(case.hood, MODULI)
    return _spelt(((key, factor * value) for key, value in values.items()), units.PRESSURE)


def _bending(hood: ShellHood) -> Variation:
    if not hood.bending_stiffness:
        return _without("bending stiffness", "the sheet bends as its materials do")
    key = {"hood.bending_stiffness": hood.bending_stiffness}
    return _scaled("bending stiffness", key, (0.5, 2.0), units.TORQUE)


def _thickness(hood: ShellHood) -> Variation:
    own = {f"hood.regions.{n}.thickness": r.thickness for n, r in hood.regions.items()}
    sections = {f"hood.regions.{n}.section": r.section for n, r in hood.regions.items()}
    factors = (0.5, 1.5)
    every = _scaled("thickness", {"hood.thickness": hood.thickness, **own}, factors, units.LENGTH)
    more = _scaled("", sections, factors, units.AREA)
    low = Side(every.low.label, every.low.settings + more.low.settings)
    return Variation(
        "thickness", low, Side(every.high.label, every.high.settings + more.high.settings)
    )


def _sections(hood: ShellHood) -> Variation:
    cables = {n: r for n, r in hood.regions.items() if n not in SHEETS}
    thick = [n for n, r in cables.items() if r.thickness is not None]
    if thick:
        return _without("sections", f"{', '.join(thick)}: their thickness is given instead")

    def side(area: float) -> Side:
        text = written(area, units.AREA)
        return Side(text, tuple(f"hood.regions.{n}.section={text}" for n in cables))

    return Variation("sections of the tendons", *map(side, SECTION_RANGE))


def _across(hood: ShellHood) -> Variation:
    name = "stiffness across fibres"
    fields = _fields(hood, ACROSS)
    if fields:
        return _scaled(name, fields, (0.5, 2.0), units.PRESSURE)
    even = {n: r for n, r in hood.regions.items() if r.kind == "isotropic"}
    if not even:
        return _without(name, "no region has fibres")
    tenth = tuple(f"hood.regions.{n}={_tenth(r)}" for n, r in even.items())
    return Variation(name, Side("a tenth of that along", tenth), Side("", why_not="isotropic"))


def _tenth(region: Material) -> str:
    """The isotropic law with a tenth of its modulus across and of its shear modulus."""
    values = dict(region)
    modulus, ratio = values["modulus"], values["poisson"]
    along, across = written(modulus, units.PRESSURE), written(modulus / 10, units.PRESSURE)
    shear = written(modulus / (20 * (1 + ratio)), units.PRESSURE)
    same = "".join(
        f', {key} = "{written(values[key], kind)}"'
        for key, kind in (("thickness", units.LENGTH), ("section", units.AREA))
        if values[key] is not None
    )
    return (
        f'{{ kind = "transversely_isotropic", modulus_along = "{along}", modulus_across = '
        f'"{across}", shear_modulus = "{shear}", poisson = {ratio!r}, poisson_across = {ratio!r}'
        f"{same}, tension_field = {str(values['tension_field']).lower()} }}"
    )


def _toe(hood: ShellHood) -> Variation:
    """The stretch at which fibres are straight; the modulus runs on smoothly into c5."""
    name = "toe of the fibres"
    fibres = {n: r for n, r in hood.regions.items() if r.kind == "trans_iso_mooney_rivlin"}
    if not fibres:
        return _without(name, "no region has a law with a toe")

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
        f"{key}.c3={written(c3, units.PRESSURE)}",
    )


def _ligament(hood: ShellHood, name: str, sets: list[str]) -> Iterator[Variation]:
    if not sets:
        yield _without(name, "the hood has no such springs")
        return
    key = "hood.springs"
    stiffness = {f"{key}.{s}.stiffness": hood.springs[s].stiffness for s in sets}
    slack = {f"{key}.{s}.slack": hood.springs[s].slack for s in sets}
    yield _scaled(f"{name}, stiffness", stiffness, (0.5, 2.0), units.STIFFNESS)
    yield _added(f"{name}, slack", slack, 1e-3, units.LENGTH, 0.0)
    taut = tuple(f"{text}=0 mm" for text in slack)
    loose = any(slack.values())
    yield Variation(
        f"{name}, presence",
        Side("absent", tuple(f"{text}={ABSENT}" for text in stiffness)),
        Side("taut as laid out", taut) if loose else Side("", why_not="taut as it is"),
    )


def _friction(hood: ShellHood) -> Variation:
    name, key, own = "friction over the bones", "hood.contact.friction", hood.contact.friction
    if own:
        return _scaled(name, {key: own}, (0.5, 2.0), None)
    return Variation(name, *(Side(f"{mu:g}", _spelt([(key, mu)], None)) for mu in COEFFICIENTS))


def _mesh(hood: ShellHood) -> Iterator[Variation]:
    mesh = hood.mesh
    if mesh.kind != "generated":
        yield _without("mesh", "it is a file")
        return
    sides = (Side(f"x {m}", (f"hood.mesh.quads={m * mesh.quads}",)) for m in (2, 4))
    yield Variation("quads of the mesh", *sides)
    step = units.parse("5 deg", units.ANGLE)
    for joint in ("MCP", "PIP", "DIP"):
        angle = {f"hood.mesh.rest_posture.{joint}": mesh.rest_posture.angles()[joint]}
        yield _added(f"stress-free posture, {joint}", angle, step, units.ANGLE)


def _fields(hood: ShellHood, wanted: Mapping[str, tuple[str, ...]]) -> dict[str, float]:
    """Key -> value of the fields that every region's law and its second family have."""
    return {
        f"hood.regions.{name}.{part}{field}": value
        for name, region in hood.regions.items()
        for part, law in (("", region), ("second.", getattr(region, "second", None)))
        for field in wanted.get(region.kind, ())
        if (value := getattr(law, field, None)) is not None
    }


def _scaled(
    name: str, values: Mapping[str, float | None], factors: tuple[float, float], kind: Kind | None
) -> Variation:
    """All values that there are by the same factor."""

    def side(factor: float) -> Side:
        stated = ((key, value) for key, value in values.items() if value is not None)
        return Side(f"x {factor:g}", _spelt(((k, factor * v) for k, v in stated), kind))

    return Variation(name, side(factors[0]), side(factors[1]))


def _added(
    name: str,
    values: Mapping[str, float],
    step: float,
    kind: Kind | None,
    least: float = float("-inf"),
) -> Variation:
    """All values less and more the same step, but none below `least`."""

    def side(sign: int) -> Side:
        new = {key: max(value + sign * step, least) for key, value in values.items()}
        moved = max((new[key] - values[key] for key in values), key=abs)
        if not moved:
            return Side("", why_not=f"it is {_shown(least, kind)} as it is, which is the least")
        return Side(
            f"{'+' if sign > 0 else '-'}{_shown(abs(moved), kind)}", _spelt(new.items(), kind)
        )

    return Variation(name, side(-1), side(1))


def _spelt(values: Iterable[tuple[str, float]], kind: Kind | None) -> Settings:
    return tuple(f"{k}={v!r}" if kind is None else f"{k}={written(v, kind)}" for k, v in values)


def _shown(value: float, kind: Kind | None) -> str:
    return f"{value:.4g}" if kind is None else written(value, kind, 4)


def written(value: float, kind: Kind, digits: int = 10) -> str:
    """An SI value in the kind's own unit."""
    return f"{value / units.parse(f'1 {kind.unit}', kind):.{digits}g} {kind.unit}"


def _without(name: str, reason: str) -> Variation:
    return Variation(name, Side("", why_not=reason), Side("", why_not=reason))


def _words(key: str) -> str:
    return key.replace("_", " ")
