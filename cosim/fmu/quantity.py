"""Inputs and outputs of an FMU: quantities of the port with their axes, units and names.

An FMI 3 unit has an array for each quantity; an FMI 2 one a scalar for each entry, named after the
quantity and the labels of its axes: `force.distal.insertion.x`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import product
from string import Formatter
from typing import Literal

import numpy as np

from cosim.port import Array, Hand, mirror, mirror_axial

Values = Mapping[str, Array]
"""Arrays by the quantity's name."""
Axis = tuple[str, tuple[str, ...]]
"""What an axis runs over, and the labels along it."""

OPEN_AXES = frozenset({"body", "source", "tendon"})
"""Axes whose labels are the case's own."""
XYZ = ("x", "y", "z")
TWIST = ("x", "y", "z", "rx", "ry", "rz")
WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
MIRRORED = np.concatenate([mirror(np.ones(3)), mirror_axial(np.ones(3))])
"""Of twists and wrenches."""
UNITS: Mapping[str, Mapping[str, int]] = {
    "m": {"m": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N.m": {"kg": 1, "m": 2, "s": -2},
    "m/N": {"kg": -1, "s": 2},
    "rad/s": {"rad": 1, "s": -1},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
}
"""Exponents of the base units; a quantity of none of these has no unit, or several in one array."""
OPEN = "the FMU's own: tendons, joints, limits"
"""What no ledger of a finger in an FMU holds."""


@dataclass(frozen=True)
class Quantity:
    """A quantity: `axes` with their labels, and what it means; none of them for a single number."""

    name: str
    causality: Literal["input", "output", "parameter"]
    unit: str
    meaning: str
    axes: tuple[Axis, ...] = ()
    switch: bool = False
    """A Boolean in the unit; here 0 or 1."""

    @property
    def shape(self) -> tuple[int, ...]:
        """The array's shape; () for a single number."""
        return tuple(len(labels) for _, labels in self.axes)

    @property
    def template(self) -> str:
        """`force.{body}.{source}.{axis}`: the name of an entry."""
        return ".".join([self.name, *("{" + what + "}" for what, _ in self.axes)])

    def entries(self, template: str) -> list[str]:
        """Names of all entries in the array's order (the last axis runs fastest); a placeholder
        takes the labels of an axis, or with `_index` behind it their numbers from 1 on.

        Raises KeyError for a placeholder that is no axis."""
        every = product(
            *([(what, i, label) for i, label in enumerate(labels, 1)] for what, labels in self.axes)
        )
        return [
            template.format_map(
                {what: label for what, _, label in chosen}
                | {f"{what}_index": i for what, i, _ in chosen}
            )
            for chosen in every
        ]

    def signs(self, hand: Hand) -> Array:
        """Return what its entries are multiplied by between the frame of that hand and the
        program's, which is the right one's: 1, or -1 of components that a mirror turns."""
        out = np.ones(self.shape)
        if hand == "right":
            return out
        turn = mirror_axial if "moment" in self.name else mirror
        of = {XYZ: turn(np.ones(3)), TWIST: MIRRORED, WRENCH: MIRRORED}
        for i, (_, labels) in enumerate(self.axes):
            if labels in of:
                out *= of[labels].reshape([-1 if k == i else 1 for k in range(out.ndim)])
        return out

    def others(self, template: str, names: Iterable[str]) -> list[str]:
        """Of some names those that fit the template with another body, source or tendon."""
        every = set(self.entries(template))
        pieces = list(Formatter().parse(template))
        found = set[str]()
        for open_axis in OPEN_AXES & {what for what, _ in self.axes}:
            labels = {what: "|".join(map(re.escape, each)) for what, each in self.axes}
            labels |= {f"{what}_index": r"\d+" for what, _ in self.axes}
            labels[open_axis] = ".+"
            parts = (re.escape(text) + (f"(?:{labels[k]})" if k else "") for text, k, *_ in pieces)
            pattern = re.compile("".join(parts))
            found |= {name for name in names if name not in every and pattern.fullmatch(name)}
        return sorted(found)

    def zero(self) -> Array:
        """The array with every entry at zero."""
        return np.zeros(self.shape)


STATIC_STEP = Quantity(
    "static",
    "parameter",
    "",
    "Every step ends in static equilibrium, however short it is.",
    (),
    True,
)
TOLERANCE = Quantity(
    "tolerance",
    "parameter",
    "",
    "Relative force residual that a step may leave; 0: the case's own.",
)
WITH_TANGENT = Quantity(
    "with_tangent", "parameter", "", "Compute the tangent, which is zero otherwise.", (), True
)
KINEMATICS = Quantity(
    "kinematics",
    "parameter",
    "",
    "A step moves nothing and puts out the poses, the fingertip and the paths at asked_angle.",
    (),
    True,
)


def motion_of(bodies: tuple[str, ...], causality: Literal["input", "output"]) -> list[Quantity]:
    """Poses: world positions of the bodies' origins, and rotation matrices, body to world, whose
    entry {axis}.{column} is the component along the world's {axis} of the body's axis {column}."""
    over: Axis = ("body", bodies)
    origin, turn = "Origin of the body, world frame.", "Rotation matrix, body to world."
    return [
        Quantity("position", causality, "m", origin, (over, ("axis", XYZ))),
        Quantity("rotation", causality, "", turn, (over, ("axis", XYZ), ("column", XYZ))),
    ]


def tensions_of(tendons: tuple[str, ...]) -> list[Quantity]:
    """The input of an FMU by which these tendons pull, N."""
    return [Quantity("tension", "input", "N", "Tension of the tendon.", (("tendon", tendons),))]


def load_of(
    bodies: tuple[str, ...], sources: tuple[str, ...], tendons: tuple[str, ...]
) -> list[Quantity]:
    """What a hood answers: `cosim.port.Load` and the excursions."""
    on: tuple[Axis, ...] = (("body", bodies), ("source", sources), ("axis", XYZ))
    by: tuple[Axis, ...] = (("tendon", tendons), ("axis", XYZ))
    about = "Moment on the body about its origin, world frame."
    pulled = "Moment about the world's origin of the tendon's force on the hood."
    return [
        Quantity("force", "output", "N", "Force on the body, world frame.", on),
        Quantity("moment", "output", "N.m", about, on),
        Quantity("pull_force", "output", "N", "Force of the tendon on the hood.", by),
        Quantity("pull_moment", "output", "N.m", pulled, by),
        Quantity("excursion", "output", "m", "Of the tendon's end since rest.", by[:1]),
    ]


def tangent_of(bodies: tuple[str, ...], tendons: tuple[str, ...]) -> list[Quantity]:
    """`cosim.port.HoodJacobian`, in SI units; a twist is a translation of the body's origin (m) and
    a rotation vector (rad), both in the world frame."""
    load: tuple[Axis, ...] = (("body", bodies), ("load", WRENCH))
    twist: tuple[Axis, ...] = (("moved", bodies), ("twist", TWIST))
    pulled: Axis = ("tendon", tendons)
    pulls: Axis = ("pulled", tendons)
    return [
        Quantity("load_motion", "output", "", "d wrench / d twist, SI.", (*load, *twist)),
        Quantity("load_tension", "output", "", "d wrench / d tension, SI.", (*load, pulled)),
        Quantity("excursion_motion", "output", "", "d excursion / d twist, SI.", (pulled, *twist)),
        Quantity("excursion_tension", "output", "m/N", "d excursion / d tension.", (pulled, pulls)),
    ]


def hood_quantities(
    bodies: tuple[str, ...],
    sources: tuple[str, ...],
    tendons: tuple[str, ...],
    *,
    tangent: bool = True,
) -> tuple[Quantity, ...]:
    """All that a unit of a hood has, with or without its tangent."""
    return (
        *motion_of(bodies, "input"),
        *tensions_of(tendons),
        *load_of(bodies, sources, tendons),
        *(STATIC_STEP, TOLERANCE),
        *((*tangent_of(bodies, tendons), WITH_TANGENT) if tangent else ()),
    )


def affine_load_of(bodies: tuple[str, ...]) -> list[Quantity]:
    """A load that follows the bodies: its wrench at the poses that the unit put out last, and its
    derivative by their twists (zero: the load is held)."""
    on: tuple[Axis, ...] = (("body", bodies), ("axis", XYZ))
    slope: tuple[Axis, ...] = (
        *(("body", bodies), ("load", WRENCH), ("moved", bodies), ("twist", TWIST)),
    )
    about = "Moment on the body about its origin, world frame."
    return [
        Quantity("force", "input", "N", "Force of the hood on the body, world frame.", on),
        Quantity("moment", "input", "N.m", about, on),
        Quantity("load_motion", "input", "", "d wrench / d twist of the hood, SI.", slope),
    ]


def finger_answers(joints: tuple[str, ...]) -> list[Quantity]:
    """The outputs of a finger in an FMU: joint angles (rad) and fingertip force (N)."""
    tip = ("axis", XYZ)
    return [
        Quantity("angle", "output", "rad", "Joint angle.", (("joint", joints),)),
        Quantity("tip_force", "output", "N", "Of the fingertip on the world.", (tip,)),
    ]


def places_of(
    bodies: tuple[str, ...], joints: tuple[str, ...], tendons: tuple[str, ...]
) -> list[Quantity]:
    """Where a finger's parts are, and how to ask where they would be at other joint angles."""
    asked = "Joint angle at which kinematics asks for the poses."
    return [
        *motion_of(bodies, "output"),
        Quantity("tip", "output", "m", "The fingertip's point.", (("axis", XYZ),)),
        Quantity("path", "output", "m", "Length of the tendon.", (("tendon", tendons),)),
        Quantity("asked_angle", "input", "rad", asked, (("joint", joints),)),
        KINEMATICS,
    ]


def finger_quantities(
    bodies: tuple[str, ...],
    joints: tuple[str, ...],
    tendons: tuple[str, ...],
    *,
    tangent: bool = True,
) -> tuple[Quantity, ...]:
    """All that a unit of a static finger has; nothing of tendons where it has none, and without
    the load's tangent where the load is always held."""
    whole = (
        *affine_load_of(bodies)[: None if tangent else -1],
        *tensions_of(tendons),
        *finger_answers(joints),
        *places_of(bodies, joints, tendons),
    )
    return tuple(q for q in whole if 0 not in q.shape)


def moving_answers(joints: tuple[str, ...]) -> list[Quantity]:
    """What a finger in motion puts out beside its poses."""
    about, damped = (
        "Of the fingertip on the world, about its point.",
        "Power that joints dissipate.",
    )
    energy = "Kinetic energy, and potential energy of height and of the finger's own springs."
    return [
        *finger_answers(joints),
        Quantity("rate", "output", "rad/s", "Joint rate.", (("joint", joints),)),
        Quantity("tip_moment", "output", "N.m", about, (("axis", XYZ),)),
        Quantity("energy", "output", "J", energy),
        Quantity("dissipation", "output", "W", damped),
    ]


def moving_quantities(
    bodies: tuple[str, ...],
    joints: tuple[str, ...],
    tendons: tuple[str, ...],
    *,
    tangent: bool = True,
) -> tuple[Quantity, ...]:
    """All that a unit of a finger in motion has.  Its load holds at the step's end: it follows the
    bodies with `load_motion` from the poses `load_position` and `load_rotation`, where there is a
    tangent, and else is held."""
    over: Axis = ("body", bodies)
    at, turned = "Origin of the body where the load was taken.", "Its rotation matrix there."
    poses = [
        Quantity("load_position", "input", "m", at, (over, ("axis", XYZ))),
        Quantity("load_rotation", "input", "", turned, (over, ("axis", XYZ), ("column", XYZ))),
    ]
    load = affine_load_of(bodies)
    whole = (
        *([*load, *poses] if tangent else load[:-1]),
        *tensions_of(tendons),
        *moving_answers(joints),
        *places_of(bodies, joints, tendons),
    )
    return tuple(q for q in whole if 0 not in q.shape)


HOOD_QUANTITIES = tuple(q.name for q in hood_quantities((), (), ()))
FINGER_QUANTITIES = tuple(
    dict.fromkeys(
        q.name
        for quantities in (finger_quantities, moving_quantities)
        for q in quantities(("",), ("",), ("",))
    )
)
"""Names that a map may have, for the schema of a case."""
