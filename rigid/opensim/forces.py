"""What OpenSim's forces hold in numbers: muscles, coordinate limits, coordinate springs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TypeVar

from cosim.errors import InputError
from rigid.chain.joint_torques import LIMIT_STIFFNESS, LIMIT_TRANSITION, JointLaw, joint_law
from rigid.opensim.losses import Loss, change_of
from rigid.opensim.xml import OsimTag

DEGREES = math.degrees(1.0)
PATH = "GeometryPath"
MUSCLE = {
    "max_isometric_force": (0.0, 1e5, "N"),
    "optimal_force": (-1e5, 1e5, "N"),
    "optimal_fiber_length": (1e-4, 10.0, "m"),
    "tendon_slack_length": (0.0, 10.0, "m"),
    "pennation_angle_at_optimal": (0.0, 1.5, "rad"),
}
"""Between what a muscle's numbers lie; no animal's lie beyond."""
OPENSIM: Mapping[str, float] = {
    **{"max_isometric_force": 1000.0, "optimal_fiber_length": 0.1, "tendon_slack_length": 0.2},
    "pennation_angle_at_optimal": 0.0,
}
"""Numbers of a muscle whose file states none."""
Property = float | bool | str
UNBOUNDED = ("min_control", "max_control")
"""What OpenSim writes as infinite where there is no bound."""


@dataclass(frozen=True)
class CoordinateLimit:
    """CoordinateLimitForce: torque stiffness * s(x / transition) * x at x beyond a limit, and
    damping * s * speed; rad, N m/rad, N m s/rad of a hinge, m, N/m, N s/m of a slide.

    OpenSim's file has degrees, N m/deg and N m s/deg for a hinge."""

    coordinate: str
    lower: float
    upper: float
    lower_stiffness: float
    upper_stiffness: float
    damping: float
    transition: float


@dataclass(frozen=True)
class Spring:
    """SpringGeneralizedForce: -stiffness (q - rest) - damping * speed. Units: `CoordinateLimit`."""

    coordinate: str
    stiffness: float
    rest: float
    damping: float


def read_limit(tag: OsimTag, slide: bool) -> CoordinateLimit:
    """Read a CoordinateLimitForce; the file's degrees become rad, unless the coordinate is a
    `slide`.

    Raises InputError for values that are no numbers."""
    scale = 1.0 if slide else DEGREES
    tag.flag("compute_dissipation_energy", False)
    return CoordinateLimit(
        tag.word("coordinate", ""),
        tag.value("lower_limit", 0.0) / scale,
        tag.value("upper_limit", 0.0) / scale,
        tag.value("lower_stiffness", 1.0) * scale,
        tag.value("upper_stiffness", 1.0) * scale,
        tag.value("damping", 0.001) * scale,
        tag.value("transition", 0.1) / scale,
    )


def read_spring(tag: OsimTag) -> Spring:
    """Read a SpringGeneralizedForce.  Raises InputError for values that are no numbers."""
    return Spring(
        tag.word("coordinate", ""),
        tag.value("stiffness", 0.0),
        tag.value("rest_length", 0.0),
        tag.value("viscosity", 0.0),
    )


def muscle_properties(tag: OsimTag) -> tuple[dict[str, Property], list[Loss]]:
    """The `properties` of a muscle or actuator, of a muscle also the numbers that OpenSim takes
    where none is stated, as it writes none; and what is to be told of them.

    Raises InputError, with the line, for a number that no muscle has."""
    for kind, (least, most, unit) in MUSCLE.items():
        child = tag.one(kind)
        if child is not None and not least <= (value := child.numbers(1)[0]) <= most:
            raise child.fault(f"expected {least:g} to {most:g} {unit}, got {value:g}")
    stated = dict(properties(tag))
    made_up = {key: value for key, value in OPENSIM.items() if key not in stated}
    if "Muscle" not in tag.kind or not made_up:
        return stated, []
    own = ", ".join(f"{key} {value:g} {MUSCLE[key][2]}" for key, value in made_up.items())
    return {**made_up, **stated}, [change_of(tag, f"states no {own}, which is OpenSim's own then")]


def properties(tag: OsimTag, way: str = "") -> Iterator[tuple[str, Property]]:
    """Each number, flag or word that the file states of a force, by its place below the tag
    ("ActiveForceLengthCurve/minimum_value"); what is not stated has OpenSim's default.

    Raises InputError for a number that is not finite; bounds of a control may be infinite."""
    for child in tag.children:
        if child.kind == PATH:
            continue
        child.used = True
        if child.children:
            yield from properties(child, f"{way}{child.kind}/")
        elif child.text.strip():
            yield f"{way}{child.kind}", _value(child)


def _value(tag: OsimTag) -> Property:
    text = tag.text.strip()
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    try:
        number = float(text)
    except ValueError:
        return text
    return text if math.isinf(number) and tag.kind in UNBOUNDED else tag.numbers(1)[0]


def law_of(
    joints: tuple[str, ...], limits: Mapping[str, CoordinateLimit], springs: Mapping[str, Spring]
) -> JointLaw:
    """Our own law for joints (in this order) with the imported limits and springs.

    Raises InputError where two limits differ in stiffness, damping or transition, or one joint has
    two."""
    here = _single([x for x in limits.values() if x.coordinate in joints], "limits")
    pulled = _single([x for x in springs.values() if x.coordinate in joints], "springs")
    hard = {(x.lower_stiffness, x.transition, x.damping) for x in here.values()}
    if len(hard) > 1 or any(x.lower_stiffness != x.upper_stiffness for x in here.values()):
        raise InputError(
            "imported limits: our joint law has one stiffness, transition and damping for all, "
            f"got {sorted(hard)} and the upper stiffnesses "
            f"{sorted({x.upper_stiffness for x in here.values()})}"
        )
    stiffness, transition, damping = next(iter(hard), (LIMIT_STIFFNESS, LIMIT_TRANSITION, 0.0))
    return joint_law(
        joints,
        stiffness={name: x.stiffness for name, x in pulled.items()},
        rest={name: x.rest for name, x in pulled.items()},
        lower={name: x.lower for name, x in here.items()},
        upper={name: x.upper for name, x in here.items()},
        limit_stiffness=stiffness,
        transition=transition,
        limit_damping=damping,
        damping={name: x.damping for name, x in pulled.items()},
    )


Force = TypeVar("Force", CoordinateLimit, Spring)


def _single(forces: list[Force], what: str) -> dict[str, Force]:
    """By coordinate."""
    out = {force.coordinate: force for force in forces}
    if len(out) < len(forces):
        raise InputError(f"imported {what}: several act on one of the joints {sorted(out)}")
    return out
