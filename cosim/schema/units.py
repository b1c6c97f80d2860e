"""Quantities: text with a unit in, SI floats out.

An angle is a dimension of its own here, so that a stiffness per radian is no torque.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from decimal import Decimal
from functools import cache
from typing import Any

_DEFINITIONS = """
giga- = 1e9 = G-
mega- = 1e6 = M-
kilo- = 1e3 = k-
centi- = 1e-2 = c-
milli- = 1e-3 = m-
micro- = 1e-6 = µ- = μ- = u-
meter = [length] = m = metre
base_mass = [mass]
gram = 1e-3 * base_mass = g
second = [time] = s
minute = 60 * second = min
hour = 3600 * second = h
hertz = 1 / second = Hz
radian = [angle] = rad
degree = 0.017453292519943295 * radian = deg = °
newton = base_mass * meter / second ** 2 = N
newton_meter = newton * meter = Nm
newton_millimeter = 1e-3 * newton * meter = Nmm
pascal = newton / meter ** 2 = Pa
watt = newton * meter / second = W
volt = [voltage] = V
kelvin = [temperature] = K
"""

_DIGITS = r"(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
_NUMBER = re.compile(rf"\s*([-+]?(?:{_DIGITS}|(?i:nan|infinity|inf)\b))")
_PREFIX = "(?:giga|mega|kilo|centi|milli|micro|[GMkcmµμu])?"
_NAMES = {
    "meter": "m|met(?:er|re)s?",
    "gram": "g|grams?",
    "second": "s|seconds?",
    "minute": "min|minutes?",
    "hour": "h|hours?",
    "hertz": "Hz|hertz",
    "radian": "rad|radians?",
    "degree": "deg|degrees?",
    "newton": "N|newtons?",
    "newton_meter": "Nm|newton_meters?",
    "newton_millimeter": "Nmm|newton_millimeters?",
    "pascal": "Pa|pascals?",
    "watt": "W|watts?",
    "volt": "V|volts?",
    "kelvin": "K|kelvins?",
}
"""How each unit may be written after its prefix, as regular expressions that JSON Schema can hold
too.  A kilogram is a prefix and a gram: as a unit of its own it would send pint round in circles,
from "kilograms" (kilo and grams) to gram (a part of a kilogram)."""


def _pattern(units: Iterable[str]) -> str:
    """The regular expression of any of these units with its prefix."""
    names = list(units)
    sign = "|°" if "degree" in names else ""
    return f"(?:{_PREFIX}(?:{'|'.join(_NAMES[name] for name in names)}){sign})"


_FACTOR = rf"{_pattern(_NAMES)}(?:(?:\*\*|\^)-?[1-9])?"
_TIMES = r"(?:\s*[*/·]\s*| )"
_UNIT = re.compile(rf"{_FACTOR}(?:{_TIMES}{_FACTOR}){{0,5}}")


@dataclass(frozen=True)
class Kind:
    """A physical quantity: its name, the unit it is best read in, its SI unit, an example, and
    between what values those of a finger usually lie (assumed: a tenth of what is known and less,
    ten times and more); empty where nothing is usual."""

    name: str
    unit: str
    si: str
    example: str
    usual: tuple[str, ...] = ()

    @property
    def advice(self) -> str:
        """What to write instead of a value without a unit, or with another's."""
        article = "an" if self.name[0] in "aeiou" else "a"
        return f'write {article} {self.name} with its unit, for example "{self.example}"'


LENGTH = Kind("length", "mm", "m", "0.6 mm", ("0.001 mm", "500 mm"))
FORCE = Kind("force", "N", "N", "3.4 N", ("0.001 N", "500 N"))
AREA = Kind("area", "mm**2", "m**2", "1.5 mm**2", ("0.001 mm**2", "50 mm**2"))
PRESSURE = Kind("pressure", "MPa", "Pa", "105 MPa", ("0.0001 MPa", "50000 MPa"))
ANGLE = Kind("angle", "deg", "rad", "30 deg")
ARM_SLOPE = Kind("length per angle", "mm/rad", "m/rad", "2.4 mm/rad")
ACCELERATION = Kind("acceleration", "m/s**2", "m/s**2", "9.81 m/s**2")
STIFFNESS = Kind("stiffness", "N/mm", "N/m", "1000 N/mm", ("0.001 N/mm", "1e6 N/mm"))
CONTACT_STIFFNESS = Kind(
    "pressure per length", "N/mm**3", "N/m**3", "100 N/mm**3", ("0.1 N/mm**3", "1e5 N/mm**3")
)
LIMIT_STIFFNESS = Kind("torque per angle", "N*m/deg", "N*m/rad", "20 N*m/deg")
JOINT_STIFFNESS = Kind("torque per angle", "N*m/rad", "N*m/rad", "0.04 N*m/rad")
FREQUENCY = Kind("frequency", "Hz", "Hz", "2 Hz")
MASS = Kind("mass", "g", "kg", "15 g", ("0.01 g", "1000 g"))
INERTIA = Kind("moment of inertia", "kg*mm**2", "kg*m**2", "22 kg*mm**2")
TORQUE = Kind("torque", "N*mm", "N*m", "20 N*mm")
ENERGY = Kind("energy", "N*mm", "N*m", "20 N*mm")
TIME = Kind("time", "s", "s", "2 s", ("1e-6 s", "100 s"))
PATIENCE = Kind("time", "s", "s", "60 s")
JOINT_DAMPING = Kind("torque per rate", "N*m*s/rad", "N*m*s/rad", "0.001 N*m*s/rad")
LIMIT_DAMPING = Kind("torque per rate", "N*m*s/deg", "N*m*s/rad", "0.01 N*m*s/deg")
DISSIPATION = Kind("time per length", "s/m", "s/m", "0.99 s/m")
DRAG = Kind("time per length", "s/m", "s/m", "0.6 s/m")
VOLUME = Kind("volume", "mm**3", "m**3", "5000 mm**3")
VOLTAGE = Kind("voltage", "V", "V", "5.2 V")
CONDUCTANCE = Kind("sonic conductance", "mm**3/s/Pa", "m**3/s/Pa", "3.8 mm**3/s/Pa")
HEAT = Kind("power per temperature", "W/K", "W/K", "0.5 W/K")
ANGULAR_RATE = Kind("angle per time", "rad/s", "rad/s", "500 rad/s")
SPEED = Kind("speed", "m/s", "m/s", "0.1 m/s")


@cache
def _registry() -> Any:
    """The dozen units of a case; pint's own registry of a thousand takes longer to load."""
    import pint

    registry: Any = pint.UnitRegistry(None, non_int_type=Decimal)
    registry.load_definitions(_DEFINITIONS.strip().splitlines())
    return registry


@cache
def _unit(text: str) -> tuple[Decimal, Any]:
    """SI factor and dimensions of a unit; ValueError when it is none we know.

    Decimal, so that 1 mm**3 is 1e-9 m**3 to the last bit."""
    if not _UNIT.fullmatch(text):
        raise ValueError(f"`{text[:30]}` is not a unit known here")
    plain = text.replace("·", "*").replace("°", "deg")
    quantity = _registry().Quantity(Decimal(1), plain).to_root_units()
    return Decimal(quantity.magnitude), quantity.dimensionality


def is_unit(text: str) -> bool:
    """Whether a text is a unit of a case, as `N m/rad` or `mm2`.

    >>> is_unit("N m/rad"), is_unit("mm2"), is_unit("furlong")
    (True, True, False)
    """
    try:
        _unit(re.sub(r"(?<=[a-z])([2-9])", r"**\1", text))
    except ValueError:
        return False
    return True


@cache
def parse(text: str, kind: Kind) -> float:
    """The SI value of a text with a unit.

    >>> parse("0.6 mm", LENGTH)
    0.0006

    Raises ValueError, with what to write instead: no number, no unit, a unit that is not known or
    of another dimension, a value that is not finite.
    """
    advice = kind.advice
    number = _NUMBER.match(text)
    if not number:
        raise ValueError(f"is not a number with a unit; {advice}")
    unit = text[number.end() :].strip()
    if not unit:
        raise ValueError(f"has no unit; {advice}")
    try:
        factor, dimensions = _unit(unit)
    except ValueError as error:
        raise ValueError(f"{error}; {advice}") from None
    if dimensions != _unit(kind.unit)[1]:
        raise ValueError(f"`{unit}` is no unit of {kind.name}; {advice}")
    plain = float(number[1])
    value = float(Decimal(repr(plain)) * factor) if math.isfinite(plain) else math.inf
    if not math.isfinite(value):
        raise ValueError(f"is not finite; {advice}")
    return value


@cache
def pattern(kind: Kind) -> str:
    """A regular expression of the texts that `parse` may take for a kind, for a JSON Schema.

    It decides a single unit and its power ("40 mm" is no angle).  Of a product it decides that all
    units are known, and that each base dimension of the kind occurs: "5 N/mm" is no angle, but
    passes for a length, and `parse` refuses it."""
    wanted = _unit(kind.unit)[1]
    dimensions = {name: _unit(name)[1] for name in _NAMES}
    single = [
        _pattern([unit]) + (rf"(?:(?:\*\*|\^){power})" + ("?" if power == 1 else ""))
        for unit in _NAMES
        for power in range(-9, 10)
        if power and dimensions[unit] ** power == wanted
    ]
    needed = "".join(
        rf"(?=(?:.*[\s\d*/·])?{_pattern(u for u in _NAMES if base in dimensions[u])}(?![A-Za-z_]))"
        for base in sorted(wanted)
    )
    product = rf"{needed}{_FACTOR}(?:{_TIMES}{_FACTOR}){{1,5}}"
    return rf"^\s*[-+]?{_DIGITS}\s*(?:{'|'.join([*single, product])})\s*$"


def in_unit(value: float, kind: Kind) -> float:
    """An SI value in the kind's own unit.

    >>> in_unit(0.0006, LENGTH)
    0.6
    """
    return float(f"{value / float(_unit(kind.unit)[0]):.12g}")


def spell(value: float, kind: Kind) -> str:
    """Text that `parse` turns back into exactly `value`, in the kind's own unit where it can."""
    text = f"{value / float(_unit(kind.unit)[0]):.12g} {kind.unit}"
    return text if parse(text, kind) == value else f"{value!r} {kind.si}"
